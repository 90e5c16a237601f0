"""The application: pages, keys, and what they ask of the acquisition.

Calls to the acquisition run in threads; the event loop only takes their results. So a slow instrument never
freezes the screen, and a frozen terminal never delays the acquisition.
"""

import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, cast

from textual import work
from textual.app import App, SystemCommand
from textual.binding import Binding, BindingType
from textual.driver import Driver
from textual.screen import ModalScreen, Screen
from textual.widgets import Input

from imutui.session import client as session
from imutui.session.client import Client, SessionError
from imutui.session.plan import VIRTUAL_PORT, Plan, demo
from imutui.session.snapshot import RecordingSnapshot
from imutui.tui import messages, palette, pictures
from imutui.tui.background import in_thread
from imutui.tui.connection.attempt import Attempt
from imutui.tui.connection.model import ConnectionModel
from imutui.tui.connection.poller import Poller
from imutui.tui.pages import PAGES, SCREENS, ConnectPage, Page, RecordPage
from imutui.tui.pages.dialogs.help import HelpDialog
from imutui.tui.pages.dialogs.mark import MarkDialog
from imutui.tui.pages.dialogs.quit import ended_dialog, jobs_dialog, quit_dialog, stop_dialog
from imutui.tui.pages.logs.page import LogsPage
from imutui.tui.pages.logs.result_page import ResultPage
from imutui.tui.pages.record import text as report
from imutui.tui.pages.table.page import TablePage
from imutui.tui.terminal import glyphs
from imutui.tui.terminal.appearance import Appearance
from imutui.tui.terminal.driver import measured
from imutui.tui.terminal.frames import FrameMonitor
from imutui.tui.terminal.pacing import PacingController, is_remote
from imutui.tui.terminal.painter import Painter

_PURPOSES = {"r": "record", "m": "mark", "d": "detach from"}
_OVER = ("stopped", "failed")
_GIVE_UP_S = 40.0
FAULTS = (SessionError, OSError)
"""What a call to the acquisition may raise: its own refusals, and a socket that does not answer."""


class ImutuiApp(App[int]):
    """The terminal UI.

    Parameters
    ----------
    client : Client or None
        Acquisition to look at.
    plan : Plan or None
        Acquisition to start at once.
    logs : str
        Folder of recordings of acquisitions that are started from here.
    defaults : Plan or None
        What such acquisitions have beside port, rate and sampling (signs, mounting, site, ...): the configuration's.
        Its own `logs` counts.
    appearance : Appearance or None
        Theme, signs, speed and plots.
    """

    TITLE = "imutui"
    CSS_PATH = "app.tcss"
    MODES: ClassVar[dict[str, Any]] = dict(SCREENS)
    DEFAULT_MODE = "connect"
    BINDINGS: ClassVar[list[BindingType]] = [
        *(
            Binding(key, f"page('{name}')", title, show=False)
            for (key, title), name in zip(PAGES, SCREENS, strict=True)
        ),
        Binding("r", "record", "record", tooltip="Start a recording"),
        Binding("r", "finish", "finish", tooltip="Finish the recording's file"),
        Binding("m", "mark", "mark", tooltip="Put a mark into the recording"),
        *(Binding(key, f"missing('{purpose}')", show=False) for key, purpose in _PURPOSES.items()),
        Binding("d", "detach", "detach", show=False, tooltip="Leave the screen, the acquisition goes on"),
        Binding("y", "copy_page", "copy", show=False, tooltip="Copy the numbers of this page as text"),
        Binding("P", "picture", "picture", show=False, tooltip="Save a picture of the screen (SVG) with the logs"),
        Binding("question_mark", "help", "help", key_display="?", tooltip="Help in plain language"),
        Binding("f1", "help", "help", show=False),
        Binding("q", "quit", "quit", tooltip="Quit, after asking about the acquisition"),
        Binding("ctrl+q", "quit", "quit", show=False, priority=True),
        Binding(
            "ctrl+z", "suspend_process", "suspend", show=False, tooltip="Back to the shell for a while; fg returns"
        ),
        Binding("ctrl+b", "debug_line", "debug line", show=False, tooltip="Show what drawing costs, or hide it"),
    ]

    def __init__(
        self,
        client: Client | None = None,
        *,
        plan: Plan | None = None,
        logs: str = "logs",
        defaults: Plan | None = None,
        appearance: Appearance | None = None,
    ) -> None:
        super().__init__()
        self.appearance = appearance or Appearance()
        self._painter = Painter()
        self._frames = FrameMonitor(
            PacingController(self.appearance.plot, self.appearance.fps, remote=is_remote(os.environ))
        )
        if client is not None:
            self.DEFAULT_MODE = "live"  # type: ignore[misc]  # no form that only flashes up
        self.farewell: list[str] = []
        """Lines for the terminal after the UI has gone."""
        self._first_client = client
        self._first_plan = plan
        # a plan that failed is mended in the form: what the form does not ask stays as it was
        self._defaults = plan or defaults or Plan(VIRTUAL_PORT, logs=str(Path(logs).resolve()))
        self._link = ConnectionModel()
        self._link.set_pacing(self._frames.pacing)
        self._attempt: Attempt | None = None
        self._given_up: list[Attempt] = []
        self._exit_code = 0
        self._finished: list[tuple[str, str]] = []
        self.animation_level = "none"
        self.set_class(glyphs.choose().name == "ascii", "-ascii")
        self.theme = self.appearance.theme_for(os.environ.get("TERM", "")) or self.theme

    def on_mount(self) -> None:
        """Begin with the acquisition that was given, if any."""
        self.app_resume_signal.subscribe(self, self._repaint)
        if self._first_client is not None:
            self._look_at(self._first_client)
            return
        self._connect_page().fill(self._defaults)
        if self._first_plan is not None:
            self._start(self._first_plan)

    @property
    def logs_folder(self) -> str:
        """Folder of recordings: the acquisition's, else that of one that would be started."""
        newest = self._link.newest
        return (newest["logs"] if newest is not None else "") or self._defaults.logs

    @property
    def page(self) -> Page | None:
        """The page in front, also under a dialog."""
        return next((screen for screen in reversed(self.screen_stack) if isinstance(screen, Page)), None)

    def _redraw(self) -> None:
        if self.page is not None:
            self._show(self.page)

    def _show(self, page: Page) -> None:
        # while the application ends, pages lose their widgets before data stop coming
        if page.is_mounted and self.is_running:
            page.show(self._link.view())

    def _say(self, said: str, level: str = "none") -> None:
        self._link.say(said, level)
        self._redraw()

    # drawing

    def get_driver_class(self) -> type[Driver]:
        """Textual's driver for this terminal, made to measure."""
        return measured(super().get_driver_class())

    def _display(self, screen: Screen[Any], renderable: Any) -> None:
        """Send only the cells that changed."""
        super()._display(screen, self._painter.exact(renderable))

    def _repaint(self, _: object) -> None:
        """Back from the shell: nothing of what was drawn is there any more."""
        self._painter.forget()
        for screen in self.screen_stack:
            screen.refresh(layout=True)
            for widget in screen.walk_children():
                widget.refresh()

    def action_plot_mode(self) -> None:
        """Let plots scroll, or sweep, or be away, or let that be chosen."""
        self._link.set_pacing(self._frames.controller.cycle(), self._frames.debug)
        self._redraw()

    def action_debug_line(self) -> None:
        """Show what drawing costs, or hide it."""
        self.toggle_class("-debug")
        self._redraw()

    # connecting

    def on_connect_page_chosen(self, message: ConnectPage.Chosen) -> None:
        """Start an acquisition."""
        try:
            plan = replace(self._defaults, **message.changes)
        except ValueError as error:
            self._connect_page().ready(str(error))
            return
        self._start(plan)

    def on_connect_page_demo_asked(self) -> None:
        """Start the demo, or look at the one that runs."""
        plan = demo(self._defaults)
        if plan.name in session.running():
            self._resume(plan.name)
        else:
            self._start(plan)

    def on_connect_page_resumed(self, message: ConnectPage.Resumed) -> None:
        """Look at a running acquisition."""
        self._resume(message.name)

    def _resume(self, name: str) -> None:
        self._begin(Attempt(lambda: session.attach(name), stops=False), f'acquisition "{name}"')

    def on_connect_page_cancelled(self) -> None:
        """Give up connecting."""
        self._give_up()
        self._connect_page().ready()

    def _start(self, plan: Plan) -> None:
        target = "the virtual instrument" if plan.port == VIRTUAL_PORT else plan.port
        self._begin(Attempt(lambda: session.start(plan)), target, plan)

    @work
    async def _begin(self, attempt: Attempt, target: str, plan: Plan | None = None) -> None:
        self._attempt = attempt
        await self.switch_mode("connect")
        if plan is not None:
            self._connect_page().fill(plan)
        self._connect_page().waiting(target)
        try:
            await in_thread(attempt.run)
        except FAULTS as error:
            if self._attempt is attempt:
                self._failed(error)
            return
        client = attempt.take()
        if client is not None and self._attempt is attempt:
            self._attempt = None
            self._connect_page().ready()
            self._look_at(client)

    def _failed(self, error: Exception) -> None:
        self._attempt = None
        self._exit_code = getattr(error, "exit_code", 4)
        self._connect_page().ready(messages.fault(error))

    def _give_up(self) -> None:
        if self._attempt is not None:
            self._attempt.give_up()
            self._given_up.append(self._attempt)
            self._attempt = None

    def _connect_page(self) -> ConnectPage:
        page = self._screen_stacks["connect"][0]
        assert isinstance(page, ConnectPage)
        return page

    def _look_at(self, client: Client) -> None:
        self._exit_code = 0
        self._link.attach(client, self.post_message)
        self.switch_mode("live")
        self.screen.refresh_bindings()

    # what comes from the acquisition

    def on_poller_arrived(self, message: Poller.Arrived) -> None:
        """A snapshot has come; only the page in front draws it."""
        if self._link.owns(message.poller):
            recorded = self._recording() is not None
            self._link.take(message.snapshot)
            if recorded != (self._recording() is not None):
                self.screen.refresh_bindings()  # r begins, or finishes
            draws = self._frames.admit(self._driver, message.snapshot, message.asked_at)
            self._link.set_pacing(self._frames.pacing, self._frames.debug)
            if draws:
                self._redraw()
            if message.snapshot["state"] in _OVER:
                self._ended(None)
        message.poller.taken()

    def on_poller_lost(self, message: Poller.Lost) -> None:
        """The acquisition does not answer."""
        if self._link.owns(message.poller):
            self._ended(message.error)

    def _ended(self, error: str | None) -> None:
        """Say that the acquisition is over, and offer to connect again."""
        reason = messages.ended(self._link.newest, error)
        self._release()
        self._link.over()
        self._close_dialogs()
        self._link.say("the acquisition has ended; 1 connects again", "bad")
        self._redraw()
        self.push_screen(ended_dialog(reason), self._after_end)

    def _after_end(self, answer: str | None) -> None:
        if answer == "connect":
            self.action_page("connect")

    def _close_dialogs(self) -> None:
        while isinstance(self.screen, ModalScreen):
            self.pop_screen()

    def _release(self) -> None:
        """Let go of the client without waiting for it."""
        client = self._link.leave()
        if client is not None:
            in_thread(client.close)

    def on_page_wanted(self, message: Page.Wanted) -> None:
        """A page has come to the front."""
        if isinstance(message.page, RecordPage):
            message.page.finished(self._finished)
        self._show(message.page)

    def on_page_say(self, message: Page.Say) -> None:
        """A page has something to say."""
        self._say(message.text, message.level)

    def on_page_ask(self, message: Page.Ask) -> None:
        """A page asks something of the acquisition."""
        if self._connected("ask"):
            self._ask(message)

    @work
    async def _ask(self, message: Page.Ask) -> None:
        client = self._link.client
        if client is None:
            return
        if message.busy:
            self._say(message.busy, "wait")
        try:
            if said := await in_thread(lambda: message.function(client)):
                self._say(said, "good")
        except FAULTS as error:
            self._say(messages.fault(error), "bad")
            return
        if message.done is not None:
            message.done()

    def on_result_page_effects_chosen(self, message: ResultPage.EffectsChosen) -> None:
        """Found effects shall join the live filter."""
        self._logs_page().load_effects(message.name, message.text)

    def on_result_page_profile_written(self, message: ResultPage.ProfileWritten) -> None:
        """The table page offers a profile that was just written."""
        page = next(iter(self._screen_stacks.get("table", [])), None)
        if isinstance(page, TablePage):
            page.look(message.path)

    def _logs_page(self) -> LogsPage:
        page = self._screen_stacks["logs"][0]
        assert isinstance(page, LogsPage)
        return page

    # keys

    async def action_trace_recording(self) -> None:
        """Trace the recording that runs, up to now."""
        recording = self._recording()
        if recording is None:
            self._say("not recording: 6 Logs traces a finished recording", "wait")
            return
        await self.switch_mode("logs")
        self._logs_page().trace_wanted(Path(recording["path"]))

    async def action_load_effects(self) -> None:
        """Choose found effects for the live filter."""
        if self._connected("load effects into"):
            await self.switch_mode("logs")
            self._logs_page().choose_effects()

    def action_page(self, name: str) -> None:
        """Go to a page."""
        if self._attempt is None:
            self.switch_mode(name)

    def action_live(self) -> None:
        """To the live page, unless there is nothing to see."""
        if self._link.newest is not None:
            self.action_page("live")

    def action_freeze(self) -> None:
        """Let the view stand still, or follow again."""
        if self._link.newest is not None:
            self._link.freeze(not self._link.frozen)
            self._redraw()

    def action_follow(self) -> None:
        """Follow again, if frozen."""
        if self._link.frozen:
            self.action_freeze()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer what needs an acquisition only with one, and no letters as keys while text is being typed."""
        if action in ("record", "finish") and (action == "finish") != (self._recording() is not None):
            return False
        if action in ("record", "finish", "mark", "detach"):
            return self._link.client is not None and not self._typing()
        if action == "missing":
            return self._link.client is None
        return not (action == "help" and self._typing())

    def _typing(self) -> bool:
        return isinstance(self.focused, Input)

    def action_missing(self, purpose: str) -> None:
        """Say what a key lacks that needs an acquisition."""
        self._connected(purpose)

    def action_record(self) -> None:
        """Start a recording as the Record page's form says."""
        if self._connected("record"):
            self._toggle_recording()

    def action_finish(self) -> None:
        """Finish the recording."""
        self.action_record()

    @work(exclusive=True, group="record")
    async def _toggle_recording(self) -> None:
        client, recording, page = self._link.client, self._recording(), self._record_page()
        if client is None:
            return
        try:
            if recording is None:
                wish = page.wish() if page is not None else None
                path = await in_thread(lambda: client.record(wish))
                self._tell_record_page([])
                self._say(messages.recording_to(path, self._link.newest), "good")
            else:
                self._say("finishing the file", "wait")
                result = cast("messages.RecordingResult", await in_thread(client.stop_recording))
                self._tell_record_page(report.finished(recording, result))
                shown = isinstance(self.page, RecordPage)
                self._say("the file is finished" if shown else messages.finished(recording, result), "good")
        except ValueError as error:
            self._say(f"not recorded: {error}", "bad")
        except FAULTS as error:
            self._say(messages.fault(error), "bad")

    def on_table_page_begin_asked(self) -> None:
        """Begin to guide, with a recording as the Record page's form says."""
        if self._connected("record"):
            self._begin_guide()

    @work(exclusive=True, group="record")
    async def _begin_guide(self) -> None:
        client, recording, page = self._link.client, self._recording(), self._record_page()
        if client is None:
            return
        try:
            wish = page.wish() if page is not None and recording is None else None
            self._say("starting the recording" if recording is None else "beginning", "wait")
            await in_thread(lambda: client.guide("begin", wish))
            self._tell_record_page([])
            self._say("recording; the line in bold above says what to do", "good")
        except ValueError as error:
            self._say(f"not recorded: {error}", "bad")
        except FAULTS as error:
            self._say(messages.fault(error), "bad")

    def _record_page(self) -> RecordPage | None:
        return next((page for page in self._pages() if isinstance(page, RecordPage)), None)

    def _tell_record_page(self, finished: list[tuple[str, str]]) -> None:
        """What was written last stays on the Record page, which need not exist yet."""
        self._finished = finished
        page = self._record_page()
        if page is not None:
            page.finished(finished)

    def _recording(self) -> RecordingSnapshot | None:
        newest = self._link.newest
        return newest["recording"] if newest is not None else None

    def _connected(self, purpose: str) -> bool:
        if self._link.client is None:
            self._say(f"nothing to {purpose}: not connected. 1 connects; there, v starts the demo", "wait")
        return self._link.client is not None

    def action_mark(self) -> None:
        """Ask for a mark's text."""
        if not self._connected("mark"):
            return
        if self._recording() is None:
            self._say("not recording, so there is nothing to mark: r starts a recording", "wait")
            return
        self.push_screen(MarkDialog(), self._mark)

    def _mark(self, said: str | None) -> None:
        if said is not None and self._link.client is not None:
            self._set_mark(self._link.client, said)

    # Dialogs' callbacks run in the app's own message queue: whatever takes a while must be a worker.

    @work
    async def _set_mark(self, client: Client, said: str) -> None:
        try:
            await in_thread(lambda: client.mark(said))
            self._say(f"marked: {said}", "good")
        except FAULTS as error:
            self._say(messages.fault(error), "bad")

    def action_copy_page(self) -> None:
        """Copy the numbers of the page in front."""
        page = self.page
        if page is None:
            return
        copied = page.as_text()
        self.copy_to_clipboard(copied)
        self._say(messages.copied(page.TITLE or "", copied, os.environ), "none")

    def action_picture(self) -> None:
        """Save a picture of the screen."""
        self.call_after_refresh(self._picture)

    def _picture(self) -> None:
        page = (self.page.TITLE or "").lower() if self.page is not None else ""
        folder = self.logs_folder
        try:
            path = pictures.save(self.export_screenshot(title=f"imutui {page}"), Path(folder), page)
            self._say(f"picture of the screen: {pictures.near(path)}", "good")
        except OSError as error:
            self._say(f"no picture saved: {error}. Start imutui in a folder that you may write to.", "bad")

    def action_help(self) -> None:
        """Help in plain language."""
        self.push_screen(HelpDialog())

    # leaving

    def action_detach(self) -> None:
        """Leave the screen; the acquisition goes on."""
        if not self._connected("detach from"):
            return
        self.farewell += messages.left(self._link.newest)
        self._release()
        self.exit(0)

    async def action_quit(self) -> None:
        """Quit, after asking what becomes of the acquisition; in a dialog, close that."""
        if isinstance(self.screen, ModalScreen):
            self.screen.dismiss(None)
        elif self._link.client is not None:
            self.push_screen(quit_dialog(self._link.newest, self._jobs()), self._after_quit)
        elif self._jobs():
            self.push_screen(jobs_dialog(self._jobs()), self._after_jobs)
        else:
            if self._attempt is not None:
                self.farewell.append("The acquisition that was being started is stopped.")
            self.exit(self._exit_code)

    def _pages(self) -> list[Page]:
        return [screen for stack in self._screen_stacks.values() for screen in stack if isinstance(screen, Page)]

    def _jobs(self) -> Sequence[str]:
        return [job for page in self._pages() for job in page.busy()]

    def _after_jobs(self, answer: str | None) -> None:
        if answer == "quit":
            self.exit(self._exit_code)

    def action_help_quit(self) -> None:
        """Ctrl+C asks as q does."""
        self.call_later(self.action_quit)

    def _after_quit(self, answer: str | None) -> None:
        if answer == "leave":
            self.action_detach()
        elif answer == "stop":
            self._stop_and_quit()

    @work
    async def _stop_and_quit(self) -> None:
        error = await self._stop_acquisition()
        self.farewell.append(error or self._link.notice_text())
        self.exit(0 if error is None else 4)

    def on_connect_page_stop_asked(self) -> None:
        """Ask before stopping."""
        if self._link.client is not None:
            self.push_screen(stop_dialog(self._link.newest), self._after_stop)

    def _after_stop(self, answer: str | None) -> None:
        if answer == "stop":
            self._stop_only()

    @work
    async def _stop_only(self) -> None:
        error = await self._stop_acquisition()
        if error is not None:
            self._say(error, "bad")

    async def _stop_acquisition(self) -> str | None:
        """Stop it and say so; the error if it ended with one."""
        client, recording = self._link.client, self._recording()
        if client is None:
            return None
        self._link.pause()
        self._say("stopping: finishing the file" if recording else "stopping the acquisition", "wait")
        try:
            result = cast("messages.RecordingResult | None", await in_thread(client.stop))
        except FAULTS as error:
            return messages.fault(error)
        finally:
            self._release()
            self._link.over()
        done = [messages.finished(recording, result)] if recording else []
        self._tell_record_page(report.finished(recording, result) if recording else [])
        self._say("\n".join([*done, "the acquisition is stopped"]), "good")
        return None

    def finish(self) -> None:
        """After the UI has gone: wait for what was being started, so that it does not run on unseen."""
        self._give_up()
        for attempt in self._given_up:
            attempt.wait(_GIVE_UP_S)

    # palette

    def get_system_commands(self, screen: Screen[Any]) -> Iterable[SystemCommand]:
        """Every action, with its key, and Textual's own except those that imutui has better."""
        yield from palette.commands(self, self.page, self.action_page)
        yield from (c for c in super().get_system_commands(screen) if c.title not in ("Quit", "Screenshot", "Keys"))


def run(
    client: Client | None = None,
    plan: Plan | None = None,
    logs: str = "logs",
    defaults: Plan | None = None,
    appearance: Appearance | None = None,
) -> int:
    """Run the UI in this terminal, as `ImutuiApp` says; returns the exit code."""
    if appearance is not None:
        os.environ[glyphs.ASKED] = appearance.glyphs  # every widget chooses its signs when it is made
    app = ImutuiApp(client, plan=plan, logs=logs, defaults=defaults, appearance=appearance)
    code = app.run()
    app.finish()
    for line in app.farewell:
        print(line, file=sys.stderr)
    return app.return_code or 0 if code is None else code
