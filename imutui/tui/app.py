"""The application: keys and pages. What they do: `connecting`, `recording`, `drawing`.

Calls to the acquisition run in threads; the event loop only takes their results. So a slow instrument never
freezes the screen, and a frozen terminal never delays the acquisition.
"""

import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from textual import events, on
from textual.app import App, SystemCommand
from textual.binding import Binding, BindingType
from textual.dom import DOMNode
from textual.driver import Driver
from textual.filter import LineFilter
from textual.screen import ModalScreen, Screen
from textual.widgets import Input

from imutui import defects
from imutui.plain_text import visible
from imutui.session.client import Client
from imutui.session.plan import VIRTUAL_PORT, Plan
from imutui.tui import messages
from imutui.tui.connecting import Connector, FromPoller, Leaving
from imutui.tui.connection.poller import Poller
from imutui.tui.connection.rack import Rack
from imutui.tui.context import AppContext
from imutui.tui.drawing import Drawing
from imutui.tui.pages import requests
from imutui.tui.pages.base import PAGES, RACK, Page
from imutui.tui.pages.dialogs.base import Dialog
from imutui.tui.pages.dialogs.help import HelpDialog
from imutui.tui.recording import RecordingControl
from imutui.tui.terminal import glyphs, textual_private
from imutui.tui.terminal.appearance import Appearance, ControlCharacterFilter, draw_scroll_bars_with
from imutui.tui.terminal.driver import Terminal
from imutui.tui.widgets.page_frame import is_too_small

if TYPE_CHECKING:
    from textual.actions import ActionParseResult

_PURPOSES = {"r": "record", "m": "mark", "d": "detach from"}
_LEAVING = ("quit", "detach", "suspend_process", "stop_table")  # what acts in a terminal of any size
_NEEDS_ACQUISITION = ("record", "mark", "detach")


class ImutuiApp(textual_private.WithoutTraceback):
    """The terminal UI.

    `logs`: folder of recordings of acquisitions that are started from here.
    `defaults`: what such acquisitions have beside port, rate and sampling (signs, mounting, site, ...): the
      configuration's. Its own `logs` counts.
    `rack`: units of a batch, to begin with.
    """

    TITLE = "imutui"
    CSS_PATH = "app.tcss"
    DEFAULT_MODE = "connect"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(RACK[0], "page('rack')", "rack", show=False, tooltip="Back to all units of the batch"),
        *(Binding(key, f"page('{title.lower()}')", title, show=False) for key, title in PAGES),
        Binding("r", "record('begin')", "record", tooltip="Start a recording"),
        Binding("r", "record('finish')", "finish", tooltip="Finish the recording's file"),
        Binding("m", "mark", "mark", tooltip="Put a mark into the recording"),
        *(Binding(key, f"missing('{purpose}')", show=False) for key, purpose in _PURPOSES.items()),
        Binding("d", "detach", "detach", show=False, tooltip="Leave the screen, the acquisition goes on"),
        Binding("y", "copy_page", "copy", show=False, tooltip="Copy the numbers of this page as text"),
        Binding("question_mark", "help", "help", key_display="?", tooltip="Help in plain language"),
        Binding("f1", "help", "help", show=False),
        Binding("q", "quit", "quit", tooltip="Quit, after asking about the acquisition"),
        Binding("ctrl+q", "quit", "quit", show=False, priority=True),
        # before whatever else Esc means on a page or in a dialog
        Binding("escape", "stop_table", "stop the table", show=False, priority=True),
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
        rack: Rack | None = None,
    ) -> None:
        super().__init__()
        textual_private.keep_parsed_styles(self)
        self.appearance = appearance or Appearance()
        self._control_characters = ControlCharacterFilter()
        self._first_client = client
        self._first_plan = plan
        self.context = AppContext(self, rack)
        self.drawing = Drawing(self.context, self.appearance)
        # a plan that failed is mended in the form: what the form does not ask stays as it was
        usual = plan or defaults or Plan(VIRTUAL_PORT, logs=str(Path(logs).resolve()))
        self._recorder = RecordingControl(self.context)
        self._connector = Connector(self.context, usual, self._recorder.tell_finished)
        self._leaving = Leaving(self.context, self._connector, self._recorder)
        self.experiment: requests.ExperimentFound | None = None
        """What the last trace of this screen recommends to be done next."""
        self.farewell = self._leaving.farewell  # lines for the terminal after the UI has gone
        self.animation_level = "none"
        self.set_class(glyphs.choose().name == "ascii", "-ascii")
        draw_scroll_bars_with(glyphs.choose())
        self.theme = self.appearance.theme_for(os.environ.get("TERM", "")) or self.theme

    def on_mount(self) -> None:
        self.app_resume_signal.subscribe(self, self.drawing.repaint)
        if self._first_client is not None:
            self._connector.look_at(self._first_client)
            return
        self.context.connect_page.fill(self._connector.defaults)
        if self._first_plan is not None:
            self._connector.start(self._first_plan)
        if self.context.rack is not None:
            self.switch_mode("rack")

    @property
    def logs_folder(self) -> str:
        """Folder of recordings: the acquisition's, else that of one that would be started."""
        newest = self.context.connection.newest
        return (newest["logs"] if newest is not None else "") or self._connector.defaults.logs

    @property
    def file_mode(self) -> int:
        return self._connector.defaults.mode

    @property
    def page(self) -> Page | None:
        return self.context.front

    def finish(self) -> None:
        """After the UI has gone: wait for what was being started, so that it does not run on unseen."""
        self._connector.give_up()
        self._connector.wait()
        if self.context.rack is not None:
            self.context.rack.close()

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Textual's, and one that lets no control character of a text through."""
        return [*super().get_line_filters(), self._control_characters]

    def get_driver_class(self) -> type[Driver]:
        base = super().get_driver_class()
        return Terminal if base is textual_private.LinuxDriver else base

    # what comes from the acquisition and from pages

    def on_from_poller(self, message: FromPoller) -> None:
        if isinstance(message.event, Poller.Arrived):
            self._connector.take(message.event, self.drawing.draw)
        else:
            self._connector.lost(message.event)

    @on(requests.ConnectRequest)
    def connect_asked(self, message: requests.ConnectRequest) -> None:
        """The connect page asks to start, to look at what runs, to stop, or to give up."""
        if isinstance(message, requests.Stop):
            self._leaving.ask_to_stop()
        else:
            self._connector.answer(message)

    @on(requests.LogsRequest)
    async def logs_asked(self, message: requests.LogsRequest) -> None:
        """A page asks the logs page to trace the recording, or to load effects into the live filter."""
        if not isinstance(message, requests.ChooseEffects) or self.context.connected("load effects into"):
            await self.switch_mode("logs")
            self.context.logs_page.answer(message)

    def on_experiment_found(self, message: requests.ExperimentFound) -> None:
        self.experiment = message
        if self.context.table_page is not None:
            self.context.table_page.look()

    async def on_offer_profile(self, message: requests.OfferProfile) -> None:
        await self.switch_mode("table")
        if self.context.table_page is not None:
            self.context.table_page.offer(message.path)

    def on_begin_guide(self, message: requests.BeginGuide) -> None:
        if self.context.connected("record"):
            self._recorder.begin_guide(yes_move=message.yes_move)

    def on_page_wanted(self, message: Page.Wanted) -> None:
        self._recorder.show_finished(message.page)
        self.context.arrived(message.page)

    def on_page_say(self, message: Page.Say) -> None:
        self.context.say(message.text, message.level)

    def on_page_ask(self, message: Page.Ask) -> None:
        if self.context.connected("ask"):
            self._recorder.ask(message)

    # keys

    def on_key(self, event: events.Key) -> None:
        """A letter that was on its way when a field got the focus is typed into the field, and no key of the page."""
        waiting = self.screen.first_field if isinstance(self.screen, Dialog) else None
        field = self.focused if isinstance(self.focused, Input) else waiting
        if isinstance(field, Input) and event.is_printable and event.character is not None:
            event.prevent_default()
            field.insert_text_at_cursor(event.character)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer what needs an acquisition only with one, and no letters as keys while text is being typed."""
        typing, connected = isinstance(self.focused, Input), self.context.connection.client is not None
        if action == "record" and (parameters == ("finish",)) != (self.context.recording is not None):
            return False
        if action == "page" and parameters == ("rack",):
            return self.context.rack is not None and not typing
        if action == "detach" and self.context.rack is not None:
            return not typing
        if action in _NEEDS_ACQUISITION:
            is_others = action != "detach" and messages.investigates(self.context.connection.newest)
            return connected and not typing and not is_others
        if action == "stop_table":
            return messages.table_is_commanded(self.context.connection.newest)
        if action == "missing":
            return not connected
        return not (action == "help" and typing)

    async def run_action(
        self,
        action: "str | ActionParseResult",
        default_namespace: DOMNode | None = None,
        namespaces: Mapping[str, DOMNode] | None = None,
    ) -> bool:
        """Run what a key means, unless the terminal is too small for a page: nobody sees then what it would do.

        A dialog is seen in any terminal.
        """
        name = action if isinstance(action, str) else action[1]
        hidden = is_too_small(self.size) and not isinstance(self.screen, ModalScreen)
        if hidden and name.rpartition(".")[2].partition("(")[0] not in _LEAVING:
            return False
        return await super().run_action(action, default_namespace, namespaces)

    def action_page(self, name: str) -> None:
        """Go to a page. Back on that of all units, none of them is looked at by itself any more."""
        if self._connector.connecting:
            return
        if name == "rack":
            self._connector.release()
            self.context.connection.forget()
        self.switch_mode(name)

    def action_live(self) -> None:
        if self.context.connection.newest is not None:
            self.action_page("live")

    def action_freeze(self) -> None:
        connection = self.context.connection
        if connection.newest is not None:
            connection.freeze(not connection.frozen)
            self.context.redraw()

    def action_follow(self) -> None:
        if self.context.connection.frozen:
            self.action_freeze()

    def action_plot_mode(self) -> None:
        self.drawing.cycle_plots()

    def action_debug_line(self) -> None:
        self.toggle_class("-debug")
        self.context.redraw()

    def action_stop_table(self) -> None:
        self._recorder.stop_table()

    def action_missing(self, purpose: str) -> None:
        self.context.connected(purpose)

    def action_record(self, _: str) -> None:
        if self.context.connected("record"):
            self._recorder.toggle()

    def action_mark(self) -> None:
        if self.context.connected("mark"):
            self._recorder.ask_for_mark()

    def action_copy_page(self) -> None:
        if self.page is not None:
            copied = self.page.as_text()
            self.copy_to_clipboard(copied)
            self.context.say(messages.copied(self.page.TITLE or "", copied, os.environ), "none")

    def action_help(self) -> None:
        page = self.screen
        self.push_screen(HelpDialog(page.TITLE or "" if isinstance(page, Page) else ""))

    def action_detach(self) -> None:
        self._leaving.detach()

    async def action_quit(self) -> None:
        """Quit, after asking what becomes of the acquisition; in a dialog, close that."""
        self._leaving.quit()

    def action_help_quit(self) -> None:
        self.call_later(self.action_quit)

    def get_system_commands(self, screen: Screen[Any]) -> Iterable[SystemCommand]:
        """Every action, with its key, and Textual's own except those that imutui has better."""
        yield from _commands(self)
        yield from (c for c in super().get_system_commands(screen) if c.title not in ("Quit", "Screenshot", "Keys"))


def run(
    client: Client | None = None,
    plan: Plan | None = None,
    logs: str = "logs",
    defaults: Plan | None = None,
    appearance: Appearance | None = None,
    batch: str = "",
) -> int:
    """Run the UI in this terminal, as `ImutuiApp` says; returns the exit code.

    `batch`: name of the batch whose units are looked at, empty for none.
    """
    if appearance is not None:
        os.environ[glyphs.ASKED] = appearance.glyphs  # every widget chooses its signs when it is made
    rack = Rack(batch) if batch else None
    app = ImutuiApp(client, plan=plan, logs=logs, defaults=defaults, appearance=appearance, rack=rack)
    code = app.run()
    app.finish()
    told = [] if app.unforeseen is None else [f"imutui: {defects.told(app.unforeseen)} The acquisition goes on."]
    driver = textual_private.driver_of(app)
    if isinstance(driver, Terminal) and driver.is_gone:
        # what an interpreter does at its end takes longer than all of the above, and nobody waits for it
        os._exit(app.return_code or 0 if code is None else code)
    for line in (*app.farewell, *told):
        print(visible(line), file=sys.stderr)
    return app.return_code or 0 if code is None else code


def _commands(app: ImutuiApp) -> Iterable[SystemCommand]:
    """Pages, then the actions of the page in front, then the application's."""
    for key, title in PAGES:
        yield SystemCommand(f"{title} page", f"key {key}", partial(app.action_page, title.lower()))
    for namespace in (app.page, app):
        for binding in namespace.BINDINGS if namespace is not None else ():
            if isinstance(binding, Binding) and (binding.show or binding.tooltip):
                yield _command(app, namespace, binding)


def _command(app: App[Any], namespace: Page | App[Any] | None, binding: Binding) -> SystemCommand:
    tip = binding.tooltip
    title = binding.description.capitalize() + (f": {tip[0].lower()}{tip[1:]}" if tip else "")

    async def run() -> None:
        app.screen.set_focus(None)  # in a field, letters are text and no action answers to them
        await app.run_action(binding.action, namespace)

    return SystemCommand(title, f"key {binding.key_display or _shown(binding.key)}", run)


def _shown(key: str) -> str:
    """First of a binding's keys as people write it."""
    *modifiers, last = key.partition(",")[0].split("+")
    return "-".join([*(modifier.capitalize() for modifier in modifiers), last])
