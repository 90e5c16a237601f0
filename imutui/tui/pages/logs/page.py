"""Logs: recordings, what is in them, and what can be made of them. Jobs run in a process of their own."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from textual import work
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.screen import ModalScreen
from textual.widget import Widget
from textual.widgets import OptionList, Static

from imutui.jobs import tasks
from imutui.jobs.worker import CANCELLED, DONE, RUNNING, Worker
from imutui.report import logs
from imutui.session.client import Client
from imutui.tui import formatting
from imutui.tui.background import in_thread
from imutui.tui.connection.model import View
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.choice import Answer, ChoiceDialog
from imutui.tui.pages.dialogs.path import PathDialog
from imutui.tui.pages.logs import result_text
from imutui.tui.pages.logs import text as told
from imutui.tui.pages.logs.effects_dialog import EffectsDialog
from imutui.tui.pages.logs.job_line import JobLine
from imutui.tui.pages.logs.result_page import ResultPage
from imutui.tui.pages.logs.result_text import Outcome
from imutui.tui.terminal.glyphs import choose
from imutui.tui.widgets.option_rows import OptionRows

if TYPE_CHECKING:
    from imutui.jobs.info import Brief
    from imutui.jobs.sidecar_files import EffectsFile

_LOOK_EVERY_S = 3.0
_POLL_S = 0.2
_WRITING = "being written"
_MORE = " also: c check  v recover  e load effects  o open another folder or file"


@dataclass(frozen=True, slots=True)
class _Job:
    """What runs, and what to make of its result."""

    what: str
    worker: Worker
    made: Callable[[Any], Outcome]


class LogsPage(Page):
    """The recordings of a folder, newest first; a job above them while one runs."""

    TITLE = "Logs"
    AUTO_FOCUS = "#recordings"
    CSS = """
    LogsPage #logs-lead, LogsPage #logs-columns, LogsPage #logs-more { height: 1; }
    LogsPage #logs-columns, LogsPage #logs-more { color: $foreground 60%; }
    LogsPage #logs-detail { height: 2; padding: 0 1; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("i", "info", "info", tooltip="What is in the recording"),
        Binding("enter", "info", "info", show=False),
        Binding("c", "check", "check", show=False, tooltip="Whether every byte of it is sound"),
        Binding("v", "recover", "recover", show=False, tooltip="A finished file from an unfinished or damaged one"),
        Binding("p", "replay", "replay", tooltip="The filter over the recording"),
        Binding("t", "trace", "trace", tooltip="What the model lacks, over the chosen recordings"),
        Binding("x,space", "pick", "choose", key_display="x", tooltip="Choose for a trace: one log is one run"),
        Binding("e", "effects", "effects", show=False, tooltip="Load found effects into the live filter"),
        Binding("o", "open", "open", show=False, tooltip="Another folder or file"),
        Binding("escape", "back", "back", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._folder: Path | None = None
        self._extra: list[Path] = []
        self._briefs: list[Brief] | None = None
        self._chosen: set[Path] = set()
        self._job: _Job | None = None
        self._pending: Outcome | None = None
        self._wanted: Path | None = None

    def body(self) -> Iterable[Widget]:
        """Where, what, the job, more of the line with the cursor, more keys."""
        yield Static(id="logs-lead")
        yield JobLine()
        yield Static(id="logs-columns")
        yield OptionRows(id="recordings")
        yield Static(id="logs-detail")
        yield Static(Content(_MORE), id="logs-more")

    def on_mount(self) -> None:
        """Look, and keep looking."""
        super().on_mount()
        self.set_interval(_LOOK_EVERY_S, self._look_again)
        self.set_interval(_POLL_S, self._poll)
        self._look()

    def on_screen_resume(self) -> None:
        """Look; a result that came meanwhile is shown."""
        super().on_screen_resume()
        self._look()
        if self._pending is not None:
            self.call_later(self._show_pending)

    def busy(self) -> Sequence[str]:
        """The job that runs."""
        return [self._job.what] if self._job is not None else []

    def abandon(self) -> None:
        """End it."""
        if self._job is not None:
            self._job.worker.cancel()

    def as_text(self) -> str:
        """The recordings."""
        rows = self.query_one("#recordings", OptionRows)
        return f"{self.folder}\n{told.heading(self.app.size.width - 1)}\n{rows.as_text()}"

    def show(self, view: View) -> None:
        """The folder may have become known."""
        before = self.folder if self.view is not None else None
        super().show(view)
        if self.folder != before:
            self._look()

    @property
    def folder(self) -> Path:
        """Whose recordings are listed: the one that was opened, else the acquisition's, else the configured one."""
        return self._folder or Path(getattr(self.app, "logs_folder", "logs"))

    # the list

    def _look_again(self) -> None:
        if self.is_current:
            self._look()

    @work(exclusive=True, group="look")
    async def _look(self) -> None:
        folder, extra = self.folder, list(self._extra)
        found = await in_thread(lambda: _look(extra, folder))
        here = self._brief()  # the line that the cursor is on moves when a newer recording comes
        self._briefs = found
        self._chosen &= {b.path for b in found}
        wanted, self._wanted = self._wanted, None
        self._list(wanted or (here.path if here is not None else None))

    def _list(self, cursor: Path | None = None) -> None:
        """Show the list, with the cursor on a recording, or where it is."""
        width = self.app.size.width
        left, right = told.lead(self.folder, self._briefs, self._chosen, width)
        line = f" {left}".ljust(width - len(right) - 2) + right
        glyphs = choose().text
        self.query_one("#logs-lead", Static).update(Content.styled(glyphs(line), "bold"))
        self.query_one("#logs-columns", Static).update(Content(glyphs(told.heading(width - 1))))
        rows = self.query_one("#recordings", OptionRows)
        briefs = self._briefs or []
        rows.fill([Content(glyphs(told.row(b, b.path in self._chosen, width - 1))) for b in briefs])
        number = next((n for n, b in enumerate(briefs) if b.path == cursor), None)
        if number is not None:
            rows.highlighted = number
        self._say_detail()

    def _brief(self) -> "Brief | None":
        at, briefs = self.query_one("#recordings", OptionRows).cursor, self._briefs or []
        return briefs[at] if at is not None and at < len(briefs) else None

    def _say_detail(self) -> None:
        said = told.detail(self._brief())
        self.query_one("#logs-detail", Static).update(Content(choose().text(said)))

    def on_option_list_option_highlighted(self) -> None:
        """Say more of it."""
        self._say_detail()

    def on_option_list_option_selected(self, _: OptionList.OptionSelected) -> None:
        """A click only puts the cursor there."""

    def action_pick(self) -> None:
        """Choose, or choose no more; on to the next."""
        here = self._brief()
        if here is not None:
            self._chosen ^= {here.path}
            self._list()
            self.query_one("#recordings", OptionRows).action_cursor_down()

    # jobs

    def action_info(self) -> None:
        """What is in it."""
        self._on_one("info", lambda path: Worker(tasks.info_log, path), _text("info", "info of", logs.info_text))

    def action_check(self) -> None:
        """Whether it is sound."""
        self._on_one("check", lambda path: Worker(tasks.check_log, path), _text("check", "check of", logs.check_text))

    def action_replay(self) -> None:
        """The filter over it."""
        writing = self._writing()
        made = _text(
            "replay", "replay of", lambda d, width: result_text.wrapped(result_text.replayed(d, writing), width)
        )
        self._on_one("replay", lambda path: Worker(tasks.replay_log, path, None), made)

    def _writing(self) -> set[Path]:
        """Files that are being written, by the names that results have for them."""
        return {p for b in self._briefs or [] if b.state == _WRITING for p in (b.path, b.path.resolve())}

    def action_recover(self) -> None:
        """A finished file beside it."""
        here = self._brief()
        if here is not None and here.state == _WRITING:
            self.post_message(self.Say("it is being written: r finishes it", "wait"))
        else:
            self._on_one("recover", _recovery, _text("recover", "recovered from", logs.recover_text))

    def _on_one(self, what: str, worker: Callable[[Path], Worker], made: Callable[[Path, Any], Outcome]) -> None:
        here = self._brief()
        if here is None:
            self.post_message(self.Say("no recording here; o opens another folder", "wait"))
            return
        path = here.path
        self._begin(f"{what} of {path.name}", lambda: worker(path), lambda document: made(path, document))

    def action_trace(self) -> None:
        """What the model lacks, over the chosen ones, else that with the cursor."""
        chosen = [b for b in self._briefs or [] if b.path in self._chosen]
        here = self._brief()
        if chosen or here is not None:
            self.trace(told.order(chosen) if chosen else [here.path] if here is not None else [])

    def trace(self, logs: Sequence[Path]) -> None:
        """Trace logs, the last of several held out."""
        names = ", ".join(path.name for path in logs[:2]) + (f" and {len(logs) - 2} more" if len(logs) > 2 else "")
        held = f"; {logs[-1].name} held out" if len(logs) > 1 else ""

        writing = self._writing()

        def made(result: tasks.TraceResult) -> Outcome:
            return Outcome(
                "trace",
                formatting.shorten(result.source, 56),
                logs[0],
                result.document,
                result_text.traced(result, writing),
                result.effects,
                result.experiment,
                result.included,
            )

        self._begin(f"trace of {names}{held}", lambda: Worker(tasks.trace_logs, list(logs), None), made)

    def trace_wanted(self, path: Path) -> None:
        """Trace a recording that another page names."""
        self._wanted = path
        self._look()
        self.trace([path])

    def _begin(self, what: str, worker: Callable[[], Worker], made: Callable[[Any], Outcome]) -> None:
        if self._job is not None:
            self.post_message(self.Say(f"one at a time: {self._job.what} runs, Esc cancels it", "wait"))
            return
        self._job = _Job(what, worker(), made)
        self._job.worker.start()
        self.query_one(JobLine).begin(formatting.shorten(what, self.app.size.width - 32))

    def _poll(self) -> None:
        job, line = self._job, self.query_one(JobLine)
        if job is None:
            return
        news = job.worker.poll()
        if news:
            line.tell(news[-1].share, news[-1].text)
        else:
            line.tell()
        if job.worker.state != RUNNING:
            self._job = None
            line.end()
            self._ended(job)

    def _ended(self, job: _Job) -> None:
        state, failure = job.worker.state, job.worker.failure
        if state == DONE:
            self._pending = job.made(job.worker.result)
            if self._in_front():
                self._show_pending()
            else:
                self.post_message(self.Say(f"{job.what} is done: 6 shows it", "good"))
        elif state == CANCELLED:
            self.post_message(self.Say(f"cancelled: {job.what}", "wait"))
        elif failure is not None:
            self.post_message(self.Say(f"{job.what}: {failure.sentence()}", "bad"))
        self._look()

    def _in_front(self) -> bool:
        return self.app.current_mode == "logs" and not isinstance(self.app.screen, ModalScreen)

    def _show_pending(self) -> None:
        if self._pending is not None and self._in_front():
            outcome, self._pending = self._pending, None
            self.app.push_screen(ResultPage(outcome))

    # effects

    def action_effects(self) -> None:
        """Choose effects for the live filter."""
        self.choose_effects()

    @work(exclusive=True, group="effects")
    async def choose_effects(self) -> None:
        """Ask which effects the live filter shall take."""
        folders = list(dict.fromkeys([self.folder, Path()]))
        files = await in_thread(lambda: _effects_files(folders))
        now = self.view.now if self.view is not None else None
        loaded = now is not None and bool(now["effects"])
        self.app.push_screen(EffectsDialog(files, loaded), self._effects_chosen)

    def _effects_chosen(self, file: "EffectsFile | str | None") -> None:
        if file == "none":
            self.load_effects("no effects", "")
        elif file == "open":
            hint = "A TOML file that a trace wrote. Enter opens it, Esc cancels."
            self.app.push_screen(PathDialog("Effects file", hint, f"{self.folder}/"), self._effects_typed)
        elif file is not None and not isinstance(file, str):
            self.load_effects(file.path.name, file.text)

    def _effects_typed(self, entered: str | None) -> None:
        if entered is not None:
            self._open_effects(entered)

    @work(exclusive=True, group="effects")
    async def _open_effects(self, entered: str) -> None:
        file = await in_thread(lambda: _effects_file(Path(entered).expanduser()))
        if file.error:
            self.post_message(self.Say(f"{entered}: {file.error}", "bad"))
        else:
            self.load_effects(file.path.name, file.text)

    def load_effects(self, name: str, content: str) -> None:
        """Have the live filter take effects; it begins anew."""
        refused = told.refused(self.view.recording if self.view is not None else None, "effects")
        if refused is not None:
            self.post_message(self.Say(refused, "wait"))
            return

        def ask(client: Client) -> str:
            client.configure(effects=content)
            return f"loaded {name}: the filter began anew with it"

        self.post_message(self.Ask(ask, f"loading {name}"))

    # other folders, and back

    def action_open(self) -> None:
        """Type a folder or a file."""
        hint = "A folder of recordings, or one recording. Enter opens it, Esc cancels."
        self.app.push_screen(PathDialog("Open", hint, f"{self.folder}/"), self._opened)

    def _opened(self, entered: str | None) -> None:
        if entered is None:
            return
        path = Path(entered).expanduser()
        if path.is_dir():
            self._folder, self._extra, self._briefs = path, [], None
        elif path.is_file():
            self._extra = [path, *(p for p in self._extra if p != path)] if path.parent != self.folder else self._extra
            self._wanted = path
        else:
            self.post_message(self.Say(f"{path}: there is no such folder or file", "bad"))
            return
        self._look()

    def action_back(self) -> None:
        """Cancel the job, after asking; without one to the live page."""
        if self._job is None:
            self.app.call_later(self.app.run_action, "live")
            return
        answers = [Answer("y", "yes", "yes, cancel it"), Answer("n", "no", "no, let it go on")]
        self.app.push_screen(ChoiceDialog(f"Cancel {self._job.what}?", "Nothing of it is kept.", answers), self._cancel)

    def _cancel(self, answer: str | None) -> None:
        if answer == "yes" and self._job is not None:
            self._job.worker.cancel()
            self.query_one(JobLine).tell(None, "cancelling")


def _text(kind: str, title: str, words: Callable[[Any, int], str]) -> Callable[[Path, Any], Outcome]:
    def made(path: Path, document: Any) -> Outcome:
        return Outcome(kind, f"{title} {path.name}", path, document, lambda width: words(document, width))

    return made


def _recovery(path: Path) -> Worker:
    from imutui.jobs import sidecar_files

    return Worker(tasks.recover_log, path, sidecar_files.free_name(path, "_recovered.mcap"), False)


def _effects_files(folders: list[Path]) -> "list[EffectsFile]":
    from imutui.jobs import sidecar_files

    return sidecar_files.effects_files(folders)


def _effects_file(path: Path) -> "EffectsFile":
    from imutui.jobs import sidecar_files

    return sidecar_files.effects_file(path)


def _look(extra: Sequence[Path], folder: Path) -> "list[Brief]":
    """Files named one by one, then a folder's; reading logs is loaded here, as the first page need not wait for it."""
    from imutui.jobs.info import brief, recordings

    return [*(brief(path) for path in extra), *recordings(folder)]
