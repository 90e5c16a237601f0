"""The jobs that a screen starts in a worker: each takes what can be pickled, tells its progress, returns records.

What is heavy is imported by the process that does the work, never by the one that shows a screen.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from filters.tracing.trace_document import TraceDocument
    from imutui.jobs.documents import CheckDocument, InfoDocument, RecoverDocument
    from imutui.logbook.results import ResultDocument

Tell = Callable[[float, str], None]


def replay_log(path: Path, tell: Tell) -> "ResultDocument":
    """The filter over one log: the result document, docs/formats.md."""
    from imutui.jobs import replay

    tell(0.0, f"reading {path.name}")
    return replay.replay(path, progress=lambda share: tell(share, f"filtering {path.name}"), course=True)


def trace_logs(logs: Sequence[Path], tell: Tell) -> "TraceDocument":
    """Trace logs, one log a run; while it goes on, what is found so far stands below what is being done."""
    tell(0.0, "starting")
    from imutui.jobs import trace

    found: list[str] = []
    return trace.trace(
        list(logs),
        progress=lambda share, what: tell(share, "\n".join([what, *found])),
        so_far=lambda text: found.extend([text] if text else []),
    )


def look_at_log(kind: str, path: Path, tell: Tell) -> "InfoDocument | CheckDocument":
    """Info or check of a log, see `jobs.info` and `jobs.check`."""
    from imutui.jobs import check, info

    return info.info(path, tell) if kind == "info" else check.check(path, tell)


def recover_log(path: Path, output: Path, overwrite: bool, mode: int, tell: Tell) -> "RecoverDocument":
    """A finished file from an unfinished or damaged one."""
    from imutui.jobs import recover

    return recover.recover(path, output, overwrite, tell, mode)
