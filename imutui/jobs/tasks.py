"""The jobs that a screen starts in a worker: each takes what can be pickled, tells its progress, returns records.

What is heavy is imported by the process that does the work, never by the one that shows a screen.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from filters.tracing.trace_document import TraceDocument
    from imutui.jobs.documents import CheckDocument, InfoDocument, RecoverDocument
    from imutui.logbook.results import ResultDocument

Tell = Callable[[float, str], None]


@dataclass(frozen=True, slots=True)
class TraceResult:
    """What comes of a trace, as text: figures and residuals stay in the worker."""

    document: "TraceDocument"  # contracts section 6
    source: str  # which logs it is of
    damage: tuple[str, ...]  # what is wrong with the files, a sentence each
    effects: str  # TOML of the found effects, for the filter
    # names of the effects in it with their channels, such as "thermal_lin (gx)"; empty if nothing was found
    included: tuple[str, ...]
    experiment: str  # profile (TOML) of the motion that would separate the causes; empty if none is needed


def replay_log(path: Path, tell: Tell) -> "ResultDocument":
    """The filter over one log: the result document, docs/formats.md."""
    from imutui.jobs import replay

    tell(0.0, f"reading {path.name}")
    return replay.replay(path, progress=lambda share: tell(share, f"filtering {path.name}"), course=True)


def trace_logs(logs: Sequence[Path], tell: Tell) -> TraceResult:
    """A trace over logs, one log a run; while it goes on, what is found so far stands below what is being done."""
    tell(0.0, "starting")
    from imutui.jobs import trace

    found: list[str] = []
    traced = trace.trace(
        list(logs),
        progress=lambda share, what: tell(share, "\n".join([what, *found])),
        so_far=lambda text: found.extend([text] if text else []),
    )
    experiment = traced.document["separating_experiment"]
    return TraceResult(
        traced.document,
        traced.source,
        traced.damage,
        traced.effects,
        tuple(f"{effect.effect} ({' '.join(effect.channels)})" for effect in traced.trace.included),
        "" if experiment is None else experiment["profile"],
    )


def look_at_log(kind: str, path: Path, tell: Tell) -> "InfoDocument | CheckDocument":
    """Info or check of a log, see `jobs.info` and `jobs.check`."""
    from imutui.jobs import check, info

    return info.info(path, tell) if kind == "info" else check.check(path, tell)


def recover_log(path: Path, output: Path, overwrite: bool, mode: int, tell: Tell) -> "RecoverDocument":
    """A finished file from an unfinished or damaged one."""
    from imutui.jobs import recover

    return recover.recover(path, output, overwrite, tell, mode)
