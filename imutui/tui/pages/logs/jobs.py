"""The jobs of the logs page: what runs in a process beside the screen, and what to make of its result."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imutui.jobs import tasks
from imutui.jobs.worker import Worker
from imutui.report import logs
from imutui.session.plan import FILE_MODE
from imutui.tui import formatting
from imutui.tui.pages.logs import result_text
from imutui.tui.pages.logs.result_text import Outcome

KINDS = ("info", "check", "recover", "replay")
"""Jobs over one recording."""


@dataclass(frozen=True, slots=True)
class Job:
    """A job that has not begun."""

    what: str  # in words: "replay of a.mcap"
    worker: Callable[[], Worker]  # makes the worker that runs it
    made: Callable[[Any], Outcome]  # what its result comes to


def over_one(kind: str, path: Path, writing: Collection[Path] = (), mode: int = int(FILE_MODE, 8)) -> Job:
    """Info, check, recover or replay of a recording.

    `kind`, `path`: what is done to which.
    `writing`: files that are not finished yet.
    `mode`: permissions of a file that is made.
    """
    match kind:
        case "info":
            return _job(kind, path, lambda: Worker(tasks.info_log, path), "info of", logs.info_text)
        case "check":
            return _job(kind, path, lambda: Worker(tasks.check_log, path), "check of", logs.check_text)
        case "recover":
            return _job(kind, path, lambda: _recovery(path, mode), "recovered from", logs.recover_text)
        case "replay":
            return _job(
                kind,
                path,
                lambda: Worker(tasks.replay_log, path, None),
                "replay of",
                lambda document, width: result_text.wrapped(result_text.replayed(document, writing), width),
            )
    raise ValueError(f"`kind` is {kind!r}; there are: {', '.join(KINDS)}")


def _job(kind: str, path: Path, worker: Callable[[], Worker], title: str, words: Callable[[Any, int], str]) -> Job:
    def made(document: Any) -> Outcome:
        return Outcome(kind, f"{title} {path.name}", path, document, lambda width: words(document, width))

    return Job(f"{kind} of {path.name}", worker, made)


def _recovery(path: Path, mode: int) -> Worker:
    from imutui.jobs import sidecar_files

    return Worker(tasks.recover_log, path, sidecar_files.free_name(path, "_recovered.mcap"), False, mode)


def _base(paths: Sequence[Path]) -> Path:
    from imutui.jobs import sidecar_files

    return sidecar_files.base(paths)


def trace(paths: Sequence[Path], writing: Collection[Path] = ()) -> Job:
    """Trace of logs, the last of several held out; `writing` are files that are not finished yet."""
    names = ", ".join(path.name for path in paths[:2]) + (f" and {len(paths) - 2} more" if len(paths) > 2 else "")
    held = f"; {paths[-1].name} held out" if len(paths) > 1 else ""

    def made(result: tasks.TraceResult) -> Outcome:
        return Outcome(
            "trace",
            formatting.shorten(result.source, 56),
            _base(paths),
            result.document,
            result_text.traced(result, writing),
            result.effects,
            result.experiment,
            result.included,
        )

    return Job(f"trace of {names}{held}", lambda: Worker(tasks.trace_logs, list(paths), None), made)
