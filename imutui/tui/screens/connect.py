"""Connect: choose port, rate and sampling; or take up a running acquisition again."""

import time
from collections.abc import Iterable
from typing import ClassVar

from textual import work
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Button, Input, Label, OptionList, Static
from textual.widgets.option_list import Option

from imutui.session import client as session
from imutui.session.plan import MAX_RATE_HZ, MIN_RATE_HZ, VIRTUAL_PORT
from imutui.tui import offers, text
from imutui.tui.background import in_thread
from imutui.tui.link import View
from imutui.tui.screens.page import Page
from imutui.tui.widgets.one_of import OneOf

_LOOK_EVERY_S = 2.0
_ALIVE = ("connecting", "running", "stopping")
_PARTS = {"connected": "#stop", "waiting": "", "form": "#ports"}
"""Parts of which one is shown, and what has the focus in it."""
_SAMPLING = {"stream": "full rate, averaged over each period", "polled": "one request a period"}


class ConnectPage(Page):
    """A form; while connecting, what is waited for; after a failure, why."""

    TITLE = "Connect"
    AUTO_FOCUS = "#ports"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "connect", "connect"),
        Binding("tab", "next_field", "next field"),
        Binding("escape", "back", "back", show=False),
        Binding("f5", "look", "look for ports", show=False),
    ]

    class Chosen(Message):
        """Connect to a port."""

        def __init__(self, port: str, rate_hz: float, sampling: str) -> None:
            super().__init__()
            self.port = port
            self.rate_hz = rate_hz
            self.sampling = sampling

    class Resumed(Message):
        """Look at a running acquisition."""

        def __init__(self, name: str) -> None:
            super().__init__()
            self.name = name

    class Cancelled(Message):
        """Connect no more."""

    class StopAsked(Message):
        """Stop the acquisition that is connected."""

    def __init__(self) -> None:
        super().__init__()
        self._choices: list[offers.Choice] = []
        self._target: str | None = None
        self._since = 0.0
        self._part = ""

    def body(self) -> Iterable[Widget]:
        """Connected, waiting, or the form; and below, what went wrong."""
        with Vertical(id="connected"):
            yield Static(id="connected-text")
            yield Button("stop this acquisition", id="stop", compact=True)
        yield Static(id="waiting")
        with Vertical(id="form"):
            yield from self._form()
        with VerticalScroll(id="error-room", can_focus=False):
            yield Static(id="error")

    def _form(self) -> Iterable[Widget]:
        yield Static(Content.styled("Choose a port; Enter connects.", "bold"), id="lead")
        yield OptionList(id="ports", compact=True, markup=False)
        with Horizontal(classes="row"):
            yield Label("other port")
            yield Input(id="port", placeholder="path, stable id, socket://host:port", compact=True)
        with Horizontal(classes="row"):
            yield Label("rate, Hz")
            yield Input(f"{MAX_RATE_HZ:g}", id="rate", compact=True)
            yield Static(id="rate-verdict")
        with Horizontal(classes="row"):
            yield Label("sampling")
            yield OneOf(_SAMPLING, id="sampling")
        with Horizontal(classes="row"):
            yield Label("")
            yield Button("Connect", id="connect", variant="primary", compact=True)
            yield Static(id="summary")

    def on_mount(self) -> None:
        """Fill the form; keep looking for ports."""
        super().on_mount()
        self.set_interval(_LOOK_EVERY_S, self._look_again)
        self.set_interval(0.5, self._say_waiting)
        self._say_rate()
        self._state()
        self.action_look()

    # what is shown

    def show(self, view: View) -> None:
        """Show a view."""
        super().show(view)
        self._state()

    def fill(self, port: str, rate_hz: float, sampling: str) -> None:
        """Put into the form what was asked for on the command line, to be mended there."""
        if port != VIRTUAL_PORT:
            self.query_one("#port", Input).value = port
        self.query_one("#rate", Input).value = f"{rate_hz:g}"
        self.query_one(OneOf).value = sampling

    def waiting(self, target: str) -> None:
        """Say what is waited for."""
        self._target, self._since = target, time.monotonic()
        self._say_error("")
        self._state()
        self._say_waiting()

    def ready(self, error: str = "") -> None:
        """Offer the form again, with what went wrong."""
        self._target = None
        self._say_error(error)
        self._state()
        self.action_look()

    def _state(self) -> None:
        """Exactly one of connected, waiting, form."""
        now = self.view.now if self.view is not None else None
        if self._target is not None:
            part = "waiting"
        elif now is not None and now["state"] in _ALIVE:
            part = "connected"
            self.query_one("#connected-text", Static).update(Content(offers.connected(now)))
        else:
            part = "form"
        if part != self._part:
            self._part = part
            for name, focused in _PARTS.items():
                self.query_one(f"#{name}").display = name == part
                if name == part and focused:
                    self.query_one(focused).focus()
            self.refresh_bindings()

    def _say_waiting(self) -> None:
        if self._target is not None:
            seconds = time.monotonic() - self._since
            said = offers.WAITING.format(target=self._target, seconds=seconds)
            self.query_one("#waiting", Static).update(Content(said))

    def _say_error(self, error: str) -> None:
        self.query_one("#error-room").display = bool(error)
        body = Content.assemble(("Could not connect.  ", "bold $text-error"), error) if error else Content("")
        self.query_one("#error", Static).update(body)

    def _say_rate(self) -> None:
        try:
            offers.parse_rate(self.query_one("#rate", Input).value)
            said = Content.styled(f"{MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}", "dim")
        except ValueError as error:
            said = Content.styled(str(error), "bold $text-error")
        self.query_one("#rate-verdict", Static).update(said)
        self._say_summary()

    def _say_summary(self) -> None:
        """What the Connect button would do."""
        choice = self._choice()
        if choice is None:
            said = ""
        elif choice.kind == "attach":
            said = f'looks at the running acquisition "{choice.value}"'
        else:
            said = f"{text.port_name(choice.value, 30)}, {self.query_one('#rate', Input).value} Hz, {self._sampling()}"
        self.query_one("#summary", Static).update(Content(said))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer what the form does only with the form."""
        return self._part == "form" if action in ("connect", "next_field") else True

    # looking for ports

    def action_look(self) -> None:
        """Look for ports and running acquisitions."""
        if self._target is None:
            self._look()

    def _look_again(self) -> None:
        if self.is_current and self._part == "form":
            self.action_look()

    @work(exclusive=True, group="look")
    async def _look(self) -> None:
        try:
            found = await in_thread(lambda: offers.choices(session.running(), session.ports()))
        except (session.SessionError, OSError) as error:
            found = offers.choices([], [])
            self._say_error(str(error))
        if found != self._choices:
            self._offer(found)

    def _offer(self, found: list[offers.Choice]) -> None:
        """Fill the list; the highlight stays on its line, or starts on the first."""
        ports = self.query_one("#ports", OptionList)
        before = self._highlighted()
        self._choices = found
        ports.clear_options()
        ports.add_options([Option(Content(choice.label)) for choice in found])
        ports.highlighted = found.index(before) if before in found else found.index(offers.likely(found))
        self.query_one("#lead", Static).update(offers.lead(found))
        self._say_summary()

    def _highlighted(self) -> offers.Choice | None:
        index = self.query_one("#ports", OptionList).highlighted
        return self._choices[index] if index is not None and index < len(self._choices) else None

    def _choice(self) -> offers.Choice | None:
        """What is chosen: a port typed in, else the list's line."""
        typed = self.query_one("#port", Input).value.strip()
        return offers.Choice("port", typed, typed) if typed else self._highlighted()

    def _sampling(self) -> str:
        return self.query_one(OneOf).value

    # what the user does

    def on_option_list_option_highlighted(self) -> None:
        """The summary follows the highlight."""
        self._say_summary()

    def on_option_list_option_selected(self) -> None:
        """Enter on the list takes that line, whatever is typed below."""
        self._connect(self._highlighted())

    def on_one_of_changed(self) -> None:
        """The summary follows the sampling."""
        self._say_summary()

    def on_input_changed(self) -> None:
        """Check while typing."""
        self._say_rate()

    def on_input_submitted(self) -> None:
        """Enter in a field connects."""
        self._connect(self._choice())

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Connect, or stop."""
        if event.button.id == "stop":
            self.post_message(self.StopAsked())
        else:
            self._connect(self._choice())

    def action_next_field(self) -> None:
        """To the next field."""
        self.focus_next()

    def action_connect(self) -> None:
        """Connect to what is chosen."""
        if self._part == "form":
            self._connect(self._choice())

    def _connect(self, choice: offers.Choice | None) -> None:
        if choice is None:
            return
        if choice.kind == "attach":
            self.post_message(self.Resumed(choice.value))
            return
        try:
            rate = offers.parse_rate(self.query_one("#rate", Input).value)
        except ValueError as error:
            self._say_error(f"The rate is {error}.")
            self.query_one("#rate").focus()
            return
        self.post_message(self.Chosen(choice.value, rate, self._sampling()))

    def action_back(self) -> None:
        """Cancel; or from a field to the list; or to the page before."""
        ports = self.query_one("#ports")
        if self._target is not None:
            self.post_message(self.Cancelled())
        elif self._part == "form" and self.focused is not ports:
            ports.focus()
        else:
            self.app.call_later(self.app.run_action, "live")
