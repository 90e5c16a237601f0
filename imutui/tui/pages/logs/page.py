"""Logs: recordings, what is in them, and what can be made of them. Jobs run in a process of their own."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from textual import work
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.screen import ModalScreen
from textual.widget import Widget
from textual.widgets import Static

from imutui.jobs.info import Brief
from imutui.jobs.worker import CANCELLED, DONE
from imutui.tui.background import in_thread
from imutui.tui.connection.model import View
from imutui.tui.pages import requests
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.base import FieldDialog
from imutui.tui.pages.dialogs.choice import Answer, ChoiceDialog, cancel_dialog
from imutui.tui.pages.logs import jobs, text
from imutui.tui.pages.logs.file_actions import FileActions
from imutui.tui.pages.logs.jobs import JobLine
from imutui.tui.pages.logs.live_effects import LiveEffects
from imutui.tui.pages.logs.recordings import Recordings
from imutui.tui.pages.logs.result_page import ResultPage
from imutui.tui.terminal.glyphs import choose
from imutui.tui.widgets.option_rows import OptionRows

if TYPE_CHECKING:
    from imutui.tui.pages.logs.result_text import Outcome

_LOOK_EVERY_S = 3.0
_MORE = " also: c check  v recover  n note  R rename  D delete  e effects  o open  l last"


class LogsPage(Page):
    """The recordings of a folder, newest first; a job above them while one runs."""

    TITLE = "Logs"
    AUTO_FOCUS = "#recordings"
    CSS = """
    LogsPage #logs-lead, LogsPage #logs-columns, LogsPage #logs-takes, LogsPage #logs-more { height: 1; }
    LogsPage #logs-columns, LogsPage #logs-more { color: $foreground 60%; }
    LogsPage #logs-detail { height: 2; padding: 0 1; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("i", "job('info')", "info", tooltip="What is in the recording"),
        Binding("enter", "job('info')", "info", show=False),
        Binding("c", "job('check')", "check", show=False, tooltip="Whether every byte of it is sound"),
        Binding(
            "v", "job('recover')", "recover", show=False, tooltip="A finished file from an unfinished or damaged one"
        ),
        Binding("p", "job('replay')", "replay", tooltip="The filter over the recording"),
        Binding("t", "trace", "trace", tooltip="What the model lacks, over the chosen recordings"),
        Binding("x,space", "pick", "choose", key_display="x", tooltip="Choose for a trace: one log is one run"),
        Binding("n", "note", "note", show=False, tooltip="Note and operator: into the file, or beside a finished one"),
        Binding("R,f2", "rename", "rename", key_display="R", show=False, tooltip="Another name, for its own files too"),
        Binding("D,delete", "delete", "delete", key_display="D", show=False, tooltip="Delete it, after asking"),
        Binding("e", "effects", "effects", show=False, tooltip="Load found effects into the live filter"),
        Binding("l", "last", "last result", show=False, tooltip="The result that was shown last"),
        Binding("o", "open", "open", show=False, tooltip="Another folder or file"),
        Binding("escape", "back", "back", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._recordings = Recordings()
        self._rows = OptionRows(id="recordings")
        self._job_line = JobLine()
        self._effects = LiveEffects(self)
        self._files = FileActions(self, self._look_at)
        self._results: list[Outcome] = []
        self._outcome: Outcome | None = None
        self._asks: ChoiceDialog | None = None  # whether to cancel the job that runs
        self._failure = ""  # a result that waits until this page is in front
        self._wanted: Path | None = None  # recording that the cursor goes to after the next look

    def body(self) -> Iterable[Widget]:
        yield Static(id="logs-lead")
        yield self._job_line
        yield Static(id="logs-columns")
        yield self._rows
        yield Static(id="logs-takes")
        yield Static(id="logs-detail")
        yield Static(Content(_MORE), id="logs-more")

    def on_mount(self) -> None:
        super().on_mount()

        def look_again() -> None:
            if self.is_current:
                self._look()

        self.set_interval(_LOOK_EVERY_S, look_again)
        self._look()

    def on_screen_resume(self) -> None:
        """Look; a result that came meanwhile is shown, or said why there is none."""
        super().on_screen_resume()
        self._look()
        if self._outcome is not None:
            self.call_later(self._show_outcome)
        self._say_failure()

    def busy(self) -> Sequence[str]:
        return [self._job_line.job.what] if self._job_line.job is not None else []

    def abandon(self) -> None:
        self._job_line.cancel()

    def as_text(self) -> str:
        return f"{self.folder}\n{text.heading(self.app.size.width - 1)}\n{self._rows.as_text()}"

    def show(self, view: View) -> None:
        before = self.folder if self.view is not None else None
        super().show(view)
        if self.folder != before:
            self._look()

    @property
    def folder(self) -> Path:
        """Whose recordings are listed: the one that was opened, else the acquisition's, else the configured one."""
        return self._recordings.opened or Path(getattr(self.app, "logs_folder", "logs"))

    # the list

    @work(exclusive=True, group="look")
    async def _look(self) -> None:
        folder = self.folder
        found = await in_thread(lambda: self._recordings.find(folder))
        if not self.query("#logs-more"):  # the page is still being made, or is going
            if self.is_running:
                self.call_later(self._look)
            return
        here = self._here  # the line that the cursor is on moves when a newer recording comes
        self._recordings.take(found)
        wanted, self._wanted = self._wanted, None
        self._list(wanted or (here.path if here is not None else None))

    def _list(self, cursor: Path | None = None) -> None:
        """Show the list, with the cursor on a recording, or where it is."""
        width, shown, glyphs = self.app.size.width, self._recordings, choose().text
        left, right = text.lead(self.folder, shown.briefs, shown.chosen, width)
        line = f" {left}".ljust(width - len(right) - 2) + right
        self.query_one("#logs-lead", Static).update(Content.styled(glyphs(line), "bold"))
        self.query_one("#logs-columns", Static).update(Content(glyphs(text.heading(width - 1))))
        rows = text.rows(shown.briefs or [], shown.chosen, width - 1)
        self._rows.fill([Content(glyphs(row)) for row in rows])
        number = shown.row_of(cursor)
        if number is not None:
            self._rows.highlighted = number
        self._say_detail()

    @property
    def _here(self) -> Brief | None:
        """The recording under the cursor."""
        return self._recordings.at(self._rows.cursor)

    def _look_at(self, path: Path | None) -> None:
        """Look, then have the cursor on a recording; None leaves it."""
        self._wanted = path
        self._look()

    def _say_detail(self) -> None:
        here, width = self._here, self.app.size.width
        takes = text.takes(self._recordings.chosen_in_order(), here.path if here is not None else None, width - 2)
        self.query_one("#logs-takes", Static).update(Content.styled(choose().text(f" {takes}"), "bold"))
        self.query_one("#logs-detail", Static).update(Content(choose().text(text.detail(here))))

    def on_option_list_option_highlighted(self) -> None:
        self._say_detail()

    def action_pick(self) -> None:
        here = self._here
        if here is not None:
            self._recordings.toggle(here.path)
            self._list()
            self._rows.action_cursor_down()

    # jobs

    def action_job(self, kind: str) -> None:
        here = self._here
        if here is None:
            self.say("no recording here; o opens another folder", "wait")
        elif kind == "recover" and here.state == text.WRITING:
            self.say(text.WRITTEN, "wait")
        else:
            mode = int(getattr(self.app, "file_mode", 0o640))
            self._begin(jobs.over_one(kind, here.path, self._recordings.writing(), mode))

    def action_trace(self) -> None:
        """What the model lacks, over the chosen ones, else that with the cursor; where they differ it asks."""
        chosen, here = self._recordings.chosen_in_order(), self._here
        if not chosen and here is not None:
            self._trace([here.path])
        elif chosen and (here is None or here.path in chosen):
            self._trace(chosen)
        elif chosen and here is not None:
            self._ask_which(chosen, here.path)

    def _ask_which(self, chosen: Sequence[Path], here: Path) -> None:
        answers = [
            Answer("l", "line", f"the line with the cursor: {text.named([here], 30)}"),
            Answer("c", "chosen", f"the {len(chosen)} chosen: {text.named(chosen, 40)}"),
        ]

        def answered(answer: str | None) -> None:
            if answer is not None:
                self._trace([here] if answer == "line" else chosen)

        body = "The line with the cursor is not one of those that x has chosen."
        self.app.push_screen(ChoiceDialog("Trace which?", body, answers), answered)

    def _trace(self, paths: Sequence[Path]) -> None:
        self._begin(jobs.trace(paths, self._recordings.writing()))

    def answer(self, request: requests.LogsRequest) -> None:
        """Do what another page asks: trace a recording that it names, offer effects, or load some."""
        match request:
            case requests.Trace():
                if isinstance(self.app.screen, ResultPage):
                    self.app.pop_screen()  # an older result, in front of what is asked now
                self._look_at(request.path)
                self._trace([request.path])
            case requests.ChooseEffects():
                self.action_effects()
            case requests.LoadEffects():
                self._effects.load(request.name, request.text)

    def _begin(self, job: jobs.Job) -> None:
        if self._job_line.job is not None:
            self.say(f"one at a time: {self._job_line.job.what} runs, Esc cancels it", "wait")
        else:
            self.say("")  # what was refused before has nothing to do with what comes now
            self._job_line.begin(job, self.app.size.width - 32)

    def on_job_line_ended(self, message: JobLine.Ended) -> None:
        """Show what a job came to, now or once this page is in front; or say why it came to nothing."""
        job, state, failure = message.job, message.worker.state, message.worker.failure
        if self._asks is not None and self._asks is self.app.screen:
            self._asks.dismiss(None)  # there is nothing to cancel any more
        if state == DONE:
            self._outcome = job.made(message.worker.result)
            if self._outcome.experiment:
                self.post_message(requests.ExperimentFound(self._outcome.experiment, self._outcome.title))
            if not self._show_outcome():
                self.say(f"{job.what} is done: 6 shows it", "good")
        elif state == CANCELLED:
            self.say(f"cancelled: {job.what}", "wait")
        elif failure is not None:
            self._failure = f"{job.what}: {failure.text}"
            if not self._say_failure():
                self.say(f"{job.what} came to nothing: 6 says why", "wait")
        self._look()

    def _say_failure(self) -> bool:
        """Say why a job came to nothing, if this page is in front; whether it was said."""
        if not self._failure or self.app.current_mode != "logs":
            return False
        self.say(self._failure, "bad")
        self._failure = ""
        return True

    def _show_outcome(self) -> bool:
        """Show the result that waits, if this page is in front; whether it was shown."""
        in_front = self.app.current_mode == "logs" and not isinstance(self.app.screen, ModalScreen)
        if self._outcome is None or not in_front:
            return False
        outcome, self._outcome = self._outcome, None
        self.say("")
        self.app.push_screen(ResultPage(outcome, self._results))
        self._results = [*self._results[-8:], outcome]
        return True

    def action_last(self) -> None:
        if not self._results:
            self.say("no result yet: t traces, p replays, c checks a recording", "wait")
            return
        self.app.push_screen(ResultPage(self._results[-1], self._results[:-1]))

    def action_effects(self) -> None:
        self._effects.choose(self.folder)

    # a recording's own files

    def action_note(self) -> None:
        self._with_file(self._files.note)

    def action_rename(self) -> None:
        self._with_file(self._files.rename)

    def action_delete(self) -> None:
        self._with_file(self._files.delete)

    def _with_file(self, ask: Callable[[Brief], None]) -> None:
        here, job = self._here, self._job_line.job
        if job is not None and ask != self._files.note:
            self.say(f"{job.what} runs: wait for it, or Esc cancels it", "wait")
        elif here is not None:
            ask(here)

    # other folders, and back

    def action_open(self) -> None:
        self._ask_for_path("A folder of recordings, or one recording. Enter opens it, Esc cancels.", f"{self.folder}/")

    def _ask_for_path(self, hint: str, value: str) -> None:
        self.app.push_screen(FieldDialog("Open", hint, value), self._opened)

    def _opened(self, entered: str | None) -> None:
        if entered is None:
            return
        path = Path(entered).expanduser()
        if path.is_dir():
            self._recordings.open_folder(path)
        elif path.is_file():
            self._recordings.open_file(path, self.folder)
            self._wanted = path
        else:
            # asked again at once: what is typed next must not go to the page's keys
            self._ask_for_path("There is no such folder or file. Enter opens another, Esc cancels.", entered)
            return
        self._look()

    def action_back(self) -> None:
        """Cancel the job, after asking; without one choose none; with none chosen to the live page."""
        job = self._job_line.job
        if job is None and self._recordings.chosen:
            self._recordings.chosen.clear()
            self._list()
            return
        if job is None:
            self.app.call_later(self.app.run_action, "live")
            return

        def cancel(answer: str | None) -> None:
            if answer == "yes" and self._job_line.job is job:
                self._job_line.cancel("cancelling")

        self._asks = cancel_dialog(job.what)
        self.app.push_screen(self._asks, cancel)
