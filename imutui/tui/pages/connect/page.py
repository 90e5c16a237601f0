"""Connect: choose a port and how to read it, or take up a running acquisition; once connected, what that is."""

import time
from collections.abc import Iterable
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.content import Content
from textual.widget import Widget
from textual.widgets import Button, Static

from imutui.session.plan import Plan, of_model
from imutui.tui import messages
from imutui.tui.connection.model import View
from imutui.tui.pages import requests
from imutui.tui.pages.base import Page
from imutui.tui.pages.connect import text
from imutui.tui.pages.connect.form import ConnectForm
from imutui.tui.pages.dialogs.choice import zero_dialog

_LOOK_EVERY_S = 2.0
_ALIVE = ("connecting", "running", "stopping")
_PARTS = {"connected": "#stop", "waiting": "", "form": "#ports"}
"""Parts of which one is shown, and what has the focus in it."""


class ConnectPage(Page):
    """A form; while connecting, what is waited for; after a failure, why; then what is connected."""

    TITLE = "Connect"
    AUTO_FOCUS = "#ports"
    CSS = """
    #form, #connected { height: auto; padding: 0 1; }
    #lead, #error { height: auto; min-height: 4; margin-bottom: 1; }
    #error { display: none; max-height: 8; }
    #form.-failed #error { display: block; }
    #form.-failed #lead { display: none; }
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

    def __init__(self) -> None:
        super().__init__()
        self._form = ConnectForm()
        self._target: str | None = None
        self._since = 0.0
        self._part = ""

    def body(self) -> Iterable[Widget]:
        with Vertical(id="connected"):
            yield Static(id="connected-text")
            with Horizontal(classes="row"):
                yield Button("z  zero the rate sensors", id="zero", compact=True)
                yield Button("s  stop this acquisition", id="stop", compact=True)
            yield Static(id="next-step")
        yield Static(id="waiting")
        yield self._form

    def on_mount(self) -> None:
        super().on_mount()
        self.set_interval(_LOOK_EVERY_S, self._look_again)
        self.set_interval(0.5, self._say_waiting)
        self._state()
        self.action_look()

    # what is shown

    def show(self, view: View) -> None:
        super().show(view)
        self._state()

    def fill(self, plan: Plan) -> None:
        self._form.fill(plan)

    def waiting(self, target: str) -> None:
        self._target, self._since = target, time.monotonic()
        self._form.say_error("")
        self._state()
        self._say_waiting()

    def ready(self, error: str = "") -> None:
        """Offer the form again, with what went wrong."""
        self._target = None
        self._form.say_error(error)
        self._state()
        self.action_look()

    def _state(self) -> None:
        """Exactly one of connected, waiting, form."""
        now = self.now
        if self._target is not None:
            part = "waiting"
        elif now is not None and now["state"] in _ALIVE:
            part = "connected"
            self.query_one("#connected-text", Static).update(Content.assemble(*text.connected(now)))
            self.query_one("#zero").display = self._zeroes_rates
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

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action in ("connect", "next_field", "probe", "probe_all", "demo"):
            return self._part == "form"
        if action == "zero":
            return self._part == "connected" and self._zeroes_rates
        if action == "stop":
            return self._part == "connected" and not messages.investigates(self.now)
        return True

    @property
    def _zeroes_rates(self) -> bool:
        """Whether the unit that is connected has a command for it."""
        now = self.now
        return now is None or of_model(now["instrument"]).zeroes_rates

    # what the user does

    def action_look(self) -> None:
        if self._target is None:
            self._form.look()

    def _look_again(self) -> None:
        if self.is_current and self._part == "form":
            self.action_look()

    def action_probe(self) -> None:
        self._form.probe()

    def action_probe_all(self) -> None:
        self._form.probe_all()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        if event.button.id == "stop":
            self.action_stop()
        elif event.button.id == "zero":
            self.action_zero()

    def action_stop(self) -> None:
        self.post_message(requests.Stop())

    def action_zero(self) -> None:
        if self.recording is not None:
            said = "not while recording: zeroing shifts all that is read after it. r finishes the file"
            self.say(said, "wait")
        else:
            self.app.push_screen(zero_dialog(), self._zero)

    def _zero(self, answer: str | None) -> None:
        if answer == "zero":
            busy = "zeroing the rate sensors: keep the unit still; no data come until it is done"
            self.post_message(self.Ask(lambda client: client.zero(text.ZERO_ARGUMENT), busy))

    def action_demo(self) -> None:
        self.post_message(requests.StartDemo())

    def action_next_field(self) -> None:
        self.focus_next()

    def action_connect(self) -> None:
        if self._part == "form":
            self._form.connect()

    def action_back(self) -> None:
        """Cancel; or from a field to the list; or to the page before."""
        ports = self.query_one("#ports")
        if self._target is not None:
            self.post_message(requests.Cancel())
        elif self._part == "form" and self.focused is not ports:
            ports.focus()
        else:
            self.app.call_later(self.app.run_action, "live")
