"""The jobs of the logs page: each runs in a process beside the screen, and its result is made into what is shown."""

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from textual.content import Content
from textual.message import Message
from textual.widget import Widget

from imutui.jobs import log_files, tasks
from imutui.jobs.worker import RUNNING, Worker
from imutui.report import logs
from imutui.settings import SETTINGS
from imutui.tui import formatting
from imutui.tui.pages.logs import result_text
from imutui.tui.pages.logs.result_text import Outcome
from imutui.tui.pages.table import text
from imutui.tui.terminal.glyphs import choose

if TYPE_CHECKING:
    from imutui.jobs.documents import TraceDocument


@dataclass(frozen=True, slots=True)
class Job:
    """A job that has not begun."""

    what: str  # in words: "replay of a.mcap"
    worker: Worker  # runs it
    made: Callable[[Any], Outcome]  # what its result comes to


def over_one(
    kind: str, path: Path, writing: Collection[Path] = (), mode: int = int(SETTINGS["paths.file_mode"].default, 8)
) -> Job:
    """Info, check, recover or replay of a recording.

    `kind`, `path`: what is done to which.
    `writing`: files that are not finished yet.
    `mode`: permissions of a file that is made.
    """
    recovered = log_files.free_name(path, "_recovered.mcap")
    kinds: dict[str, tuple[Any, ...]] = {
        "info": ("info of", logs.info_text, tasks.look_at_log, kind, path),
        "check": ("check of", logs.check_text, tasks.look_at_log, kind, path),
        "recover": ("recovered from", logs.recover_text, tasks.recover_log, path, recovered, False, mode),
        "replay": ("replay of", partial(result_text.replayed, writing), tasks.replay_log, path),
    }
    title, words, *task = kinds[kind]

    def made(document: Any) -> Outcome:
        return Outcome(kind, f"{title} {path.name}", path, document, partial(words, document))

    return Job(f"{kind} of {path.name}", Worker(*task), made)


def trace(paths: Sequence[Path], writing: Collection[Path] = ()) -> Job:
    """Trace of logs, the last of several held out; `writing` are files that are not finished yet."""
    names = ", ".join(path.name for path in paths[:2]) + (f" and {len(paths) - 2} more" if len(paths) > 2 else "")
    held = f"; {paths[-1].name} held out" if len(paths) > 1 else ""

    def made(result: "TraceDocument") -> Outcome:
        experiment = result["separating_experiment"]
        return Outcome(
            "trace",
            formatting.shorten(result["source"], 56),
            log_files.base(paths),
            result,
            result_text.traced(result, writing),
            result["effects_file"],
            "" if experiment is None else experiment["profile"],
        )

    return Job(f"trace of {names}{held}", Worker(tasks.trace_logs, list(paths)), made)


_BAR = 24
_POLL_S = 0.2


class JobLine(Widget):
    """Lines about the job that it runs, and what it has found so far; empty without one. Posts `Ended`."""

    DEFAULT_CSS = """
    JobLine { height: auto; max-height: 6; padding: 0 1; background: $panel; display: none; }
    JobLine.-on { display: block; }
    """

    @dataclass
    class Ended(Message):
        """A job is over, done or not: the worker says which."""

        job: Job
        worker: Worker

    def __init__(self) -> None:
        super().__init__()
        self._what, self._share, self._doing, self._since = "", 0.0, "", 0.0
        self.job: Job | None = None  # the job that runs
        self._worker: Worker | None = None

    def on_mount(self) -> None:
        self.set_interval(_POLL_S, self._poll)

    def begin(self, job: Job, room: int) -> None:
        """Run a job, whose name is shown in so many characters."""
        self._what, self._share, self._doing = formatting.shorten(job.what, room), 0.0, "starting"
        self._since = time.monotonic()
        self.job, self._worker = job, job.worker
        self._worker.start()
        self.add_class("-on")
        self.refresh()

    def cancel(self, said: str | None = None) -> None:
        """End the job that runs; `said` is shown until it has ended."""
        if self._worker is not None:
            self._worker.cancel()
            self._doing = said or self._doing
            self.refresh()

    def _poll(self) -> None:
        job, worker = self.job, self._worker
        if job is None or worker is None:
            return
        if news := worker.poll():
            self._share, self._doing = news[-1].share, news[-1].text or self._doing
        self.refresh(layout=self._doing.count("\n") > 0)  # without news the seconds go on
        if worker.state != RUNNING:
            self.job = self._worker = None
            self.remove_class("-on")
            self.post_message(self.Ended(job, worker))

    def render(self) -> Content:
        seconds = time.monotonic() - self._since
        bar = text.bar(self._share, _BAR)
        first = f"{self._what}   {formatting.clock(seconds)}   Esc cancels"
        lines = f"{first}\n{bar} {100.0 * self._share:3.0f} %  {self._doing}"
        return Content(choose().text(lines))
