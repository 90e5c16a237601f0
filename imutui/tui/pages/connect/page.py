"""Connect: choose a port and how to read it, or take up a running acquisition; once connected, what that is.

Nothing is sent to a port unless it is asked for: a probe writes bytes, and whatever is on the line gets them.
"""

import time
from collections.abc import Iterable
from typing import Any, ClassVar

from textual import work
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Button, Input, Label, OptionList, Static
from textual.widgets.option_list import Option

from imutui.session import client as session
from imutui.session.plan import MAX_RATE_HZ, MIN_RATE_HZ, VIRTUAL_PORT, Plan
from imutui.tui import formatting
from imutui.tui.background import in_thread
from imutui.tui.connection.model import View
from imutui.tui.pages.base import Page
from imutui.tui.pages.connect import text
from imutui.tui.pages.dialogs.quit import zero_dialog
from imutui.tui.widgets.radio import Radio

_LOOK_EVERY_S = 2.0
_ALIVE = ("connecting", "running", "stopping")
_PARTS = {"connected": "#stop", "waiting": "", "form": "#ports"}
"""Parts of which one is shown, and what has the focus in it."""
_CHOSEN = {"sampling": text.SAMPLINGS, "filter": text.FILTERS, "reference": text.REFERENCES}


class _Ports(OptionList):
    """The list, whose Enter connects."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "select", "connect", key_display="enter")]


class ConnectPage(Page):
    """A form; while connecting, what is waited for; after a failure, why; then what is connected."""

    TITLE = "Connect"
    AUTO_FOCUS = "#ports"
    CSS = """
    #form, #connected { height: auto; padding: 0 1; }
    #lead, #error { height: auto; min-height: 4; margin-bottom: 1; }
    #error { display: none; max-height: 8; }
    ConnectPage.-failed #error { display: block; }
    ConnectPage.-failed #lead { display: none; }
    #ports { height: auto; max-height: 4; margin-bottom: 1; scrollbar-size: 1 1; }
    ConnectPage.-tall #ports { max-height: 12; }
    #waiting, #connected, #form { display: none; }
    #waiting { height: auto; padding: 1 2; }
    #connected-text { margin: 1 0; height: auto; }
    #connected Button { margin: 0 2 1 0; }
    #connected .row { margin-bottom: 1; }
    .row { height: 1; }
    .row > Label { width: 12; }
    .row > Input { width: 1fr; }
    .row > #rate { width: 12; }
    .row > Button { width: auto; }
    #rate-verdict, #summary { width: 1fr; padding: 0 2; }
    #mode { width: 1fr; }
    #form > #go { margin-top: 1; }
    ConnectPage Notice { dock: bottom; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "connect", "connect", key_display="enter"),
        Binding("tab", "next_field", "next field", key_display="tab"),
        Binding("p", "probe", "probe", tooltip="Ask on the chosen port which instrument is there"),
        Binding("a", "probe_all", "probe all", show=False, tooltip="Ask on every serial port"),
        Binding("v", "demo", "demo", tooltip="Start a virtual instrument, record it and show it"),
        Binding("s", "stop", "stop", tooltip="Stop the acquisition, to connect to something else"),
        Binding("z", "zero", "zero rates", tooltip="Zero the rate sensors, after asking"),
        Binding("escape", "back", "back", show=False),
        Binding("f5", "look", "look for ports", show=False, tooltip="Look for ports now"),
    ]

    class Chosen(Message):
        """Connect to a port, with these fields of the plan."""

        def __init__(self, changes: dict[str, Any]) -> None:
            super().__init__()
            self.changes = changes

    class DemoAsked(Message):
        """Show the demo."""

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
        self._choices: list[text.Choice] = []
        self._answers: dict[str, str] = {}
        self._target: str | None = None
        self._since = 0.0
        self._part = ""

    def body(self) -> Iterable[Widget]:
        """Connected, waiting, or the form."""
        with Vertical(id="connected"):
            yield Static(id="connected-text")
            with Horizontal(classes="row"):
                yield Button("z  zero the rate sensors", id="zero", compact=True)
                yield Button("s  stop this acquisition", id="stop", compact=True)
            yield Static(id="next-step")
        yield Static(id="waiting")
        with Vertical(id="form"):
            yield from self._form()

    def _form(self) -> Iterable[Widget]:
        yield Static(id="lead")
        with VerticalScroll(id="error", can_focus=False):
            yield Static(id="error-text")
        yield _Ports(id="ports", compact=True, markup=False)
        with Horizontal(classes="row"):
            yield Label("other port")
            yield Input(id="port", placeholder="path, stable id, socket://host:port", compact=True)
        with Horizontal(classes="row"):
            yield Label("rate, Hz")
            yield Input(f"{MAX_RATE_HZ:g}", id="rate", compact=True)
            yield Static(id="rate-verdict")
        for name, values in _CHOSEN.items():
            with Horizontal(classes="row"):
                yield Label(name)
                yield Radio(values, id=name)
        with Horizontal(classes="row"):
            yield Label("mode")
            yield Static(Content.styled(text.MODE, "dim"), id="mode")
        with Horizontal(classes="row", id="go"):
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

    def fill(self, plan: Plan) -> None:
        """Put into the form what was asked for on the command line, to be mended there."""
        if plan.port != VIRTUAL_PORT:
            self.query_one("#port", Input).value = plan.port
        self.query_one("#rate", Input).value = f"{plan.rate_hz:g}"
        for name in _CHOSEN:
            self.query_one(f"#{name}", Radio).choose(getattr(plan, name), plan.reference_file[0])

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
            self.query_one("#connected-text", Static).update(text.connected(now))
            self.query_one("#next-step", Static).update(Content(text.next_step(now)))
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
            said = text.WAITING.format(target=self._target, seconds=seconds)
            self.query_one("#waiting", Static).update(Content(said))

    def _say_error(self, error: str) -> None:
        self.set_class(bool(error), "-failed")
        body = Content.assemble(("Could not connect.  ", "bold $text-error"), error) if error else Content("")
        self.query_one("#error-text", Static).update(body)

    def _say_rate(self) -> None:
        try:
            text.parse_rate(self.query_one("#rate", Input).value)
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
            rate = self.query_one("#rate", Input).value
            said = f"{formatting.port_name(choice.value, 30)}, {rate} Hz, {self._value('sampling')}"
        self.query_one("#summary", Static).update(Content(said))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer what the form does only with the form, and what needs an acquisition only with one."""
        if action in ("connect", "next_field", "probe", "probe_all", "demo"):
            return self._part == "form"
        return self._part == "connected" if action in ("stop", "zero") else True

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
            found = await in_thread(lambda: text.choices(session.running(), session.ports()))
        except (session.SessionError, OSError) as error:
            found = text.choices([], [])
            self._say_error(str(error))
        if found != self._choices:
            self._offer(found)

    def _offer(self, found: list[text.Choice]) -> None:
        """Fill the list; the highlight stays on its line, or starts on the likeliest."""
        before = self._highlighted()
        self._choices = found
        self._fill_list(found.index(before) if before in found else found.index(text.likely(found)))
        self.query_one("#lead", Static).update(text.lead(found))

    def _fill_list(self, highlighted: int | None) -> None:
        ports = self.query_one("#ports", OptionList)
        ports.clear_options()
        ports.add_options([Option(Content(text.label(choice, self._answers))) for choice in self._choices])
        ports.highlighted = highlighted
        self._say_summary()

    def _highlighted(self) -> text.Choice | None:
        index = self.query_one("#ports", OptionList).highlighted
        return self._choices[index] if index is not None and index < len(self._choices) else None

    def _choice(self) -> text.Choice | None:
        """What is chosen: a port typed in, else the list's line."""
        typed = self.query_one("#port", Input).value.strip()
        return text.Choice("port", typed, typed) if typed else self._highlighted()

    def _value(self, name: str) -> str:
        return self.query_one(f"#{name}", Radio).value

    # asking who is there, only when told to

    def action_probe(self) -> None:
        """Ask on the highlighted port."""
        choice = self._highlighted()
        if choice is None or not choice.asks:
            self.post_message(self.Say("nothing to ask there: p asks on a serial port of the list, a on all", "wait"))
        else:
            self._probe([choice.value])

    def action_probe_all(self) -> None:
        """Ask on every serial port, one after the other."""
        ports = [choice.value for choice in self._choices if choice.asks]
        if ports:
            self._probe(ports)
        else:
            self.post_message(self.Say("this machine has no serial port to ask on", "wait"))

    @work(exclusive=True, group="probe")
    async def _probe(self, ports: list[str]) -> None:
        for port in ports:
            self._heard(port, "asking ...")
            try:
                found = await in_thread(lambda port=port: session.probe(port))  # type: ignore[misc]
            except (session.SessionError, OSError) as error:
                found = text.not_answered(port, str(error))
            self._heard(port, text.answered(found))
            said = found["error"] or f"{formatting.port_name(port)}: {self._answers[port]}"
            self.post_message(self.Say(said, "good" if found["answers"] and not found["error"] else "wait"))

    def _heard(self, port: str, answer: str) -> None:
        self._answers[port] = answer
        self._fill_list(self.query_one("#ports", OptionList).highlighted)

    # what the user does

    def on_option_list_option_highlighted(self) -> None:
        """The summary follows the highlight."""
        self._say_summary()

    def on_option_list_option_selected(self) -> None:
        """Enter on the list takes that line, whatever is typed below."""
        self._connect(self._highlighted())

    def on_radio_changed(self) -> None:
        """The summary follows the sampling."""
        self._say_summary()

    def on_input_changed(self) -> None:
        """Check while typing."""
        self._say_rate()

    def on_input_submitted(self) -> None:
        """Enter in a field connects."""
        self._connect(self._choice())

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Connect, stop, or zero."""
        match event.button.id:
            case "stop":
                self.action_stop()
            case "zero":
                self.action_zero()
            case _:
                self._connect(self._choice())

    def action_stop(self) -> None:
        """Have the acquisition stopped, after asking."""
        self.post_message(self.StopAsked())

    def action_zero(self) -> None:
        """Have the rate sensors zeroed, after asking."""
        if self.view is not None and self.view.recording:
            said = "not while recording: zeroing shifts all that is read after it. r finishes the file"
            self.post_message(self.Say(said, "wait"))
        else:
            self.app.push_screen(zero_dialog(), self._zero)

    def _zero(self, answer: str | None) -> None:
        if answer == "zero":
            busy = "zeroing the rate sensors: keep the unit still; no data come until it is done"
            self.post_message(self.Ask(lambda client: client.zero(text.ZERO_ARGUMENT), busy))

    def action_demo(self) -> None:
        """Show the demo."""
        self.post_message(self.DemoAsked())

    def action_next_field(self) -> None:
        """To the next field."""
        self.focus_next()

    def action_connect(self) -> None:
        """Connect to what is chosen."""
        if self._part == "form":
            self._connect(self._choice())

    def _connect(self, choice: text.Choice | None) -> None:
        if choice is None:
            return
        self._say_error("")
        if choice.kind == "attach":
            self.post_message(self.Resumed(choice.value))
            return
        try:
            rate = text.parse_rate(self.query_one("#rate", Input).value)
        except ValueError as error:
            self._say_error(f"The rate is {error}.")
            self.query_one("#rate").focus()
            return
        chosen = {name: self._value(name) for name in _CHOSEN}
        self.post_message(self.Chosen({"port": choice.value, "rate_hz": rate, **chosen}))

    def action_back(self) -> None:
        """Cancel; or from a field to the list; or to the page before."""
        ports = self.query_one("#ports")
        if self._target is not None:
            self.post_message(self.Cancelled())
        elif self._part == "form" and self.focused is not ports:
            ports.focus()
        else:
            self.app.call_later(self.app.run_action, "live")
