"""A job under way: what, how far, what is being done, for how long."""

import time

from textual.content import Content
from textual.message import Message
from textual.widget import Widget

from imutui.jobs.worker import RUNNING, Worker
from imutui.tui import formatting
from imutui.tui.pages.logs.jobs import Job
from imutui.tui.pages.table import text
from imutui.tui.terminal.glyphs import choose

_BAR = 24
_POLL_S = 0.2


class JobLine(Widget):
    """Two lines about the job that it runs; empty without one. Posts `Ended`."""

    DEFAULT_CSS = """
    JobLine { height: 2; padding: 0 1; background: $panel; display: none; }
    JobLine.-on { display: block; }
    """

    class Ended(Message):
        """A job is over, done or not: the worker says which."""

        def __init__(self, job: Job, worker: Worker) -> None:
            super().__init__()
            self.job = job
            self.worker = worker

    def __init__(self) -> None:
        super().__init__()
        self._what, self._share, self._doing, self._since = "", 0.0, "", 0.0
        self.job: Job | None = None
        """The job that runs."""
        self._worker: Worker | None = None

    def on_mount(self) -> None:
        """Keep asking the worker how far it is."""
        self.set_interval(_POLL_S, self._poll)

    def begin(self, job: Job, room: int) -> None:
        """Run a job, whose name is shown in so many characters."""
        self._what, self._share, self._doing = formatting.shorten(job.what, room), 0.0, "starting"
        self._since = time.monotonic()
        self.job, self._worker = job, job.worker()
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
        self.refresh()  # without news the seconds go on
        if worker.state != RUNNING:
            self.job = self._worker = None
            self.remove_class("-on")
            self.post_message(self.Ended(job, worker))

    def render(self) -> Content:
        """What; bar, share, what is being done."""
        seconds = time.monotonic() - self._since
        bar = text.bar(self._share, _BAR)
        first = f"{self._what}   {formatting.clock(seconds)}   Esc cancels"
        lines = f"{first}\n{bar} {100.0 * self._share:3.0f} %  {self._doing}"
        return Content(choose().text(lines))
