"""The form that connects: ports and running acquisitions, how to read them, and what the button would do.

Nothing is sent to a port unless it is asked for: a probe writes bytes, and whatever is on the line gets them.
"""

from typing import ClassVar

from textual import events, work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.message import Message
from textual.reactive import reactive
from textual.widget import Widget
from textual.widgets import Button, Input, Label, OptionList, Static
from textual.widgets.option_list import Option

from filters.errors import InputError
from imutui.session import client as session
from imutui.session.plan import MAX_RATE_HZ, PAPER_PLACE, VIRTUAL_PORT, Driver, Plan, of_model, parse_place
from imutui.settings import SETTINGS
from imutui.tui import formatting
from imutui.tui.background import in_thread
from imutui.tui.pages import requests
from imutui.tui.pages.base import Page
from imutui.tui.pages.connect import text

_CHOSEN = {each.name: dict(each.setting.offers) for each in SETTINGS.values() if each.setting.offers}
_LABELS = {each.name: each.setting.label for each in SETTINGS.values()}


class PortList(OptionList):
    """Ports and running acquisitions; Enter connects."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "select", "connect", key_display="enter")]


class ConnectForm(Vertical):
    """Lead or error, list of ports, fields, button with a summary; posts `requests.Start` and `requests.Resume`."""

    def __init__(self) -> None:
        super().__init__(id="form")
        self._choices: list[text.Choice] = []
        self._looking = False
        self._answers: dict[str, str] = {}
        self._models: dict[str, str] = {}
        self._has_gravity = self._asked_site = False

    def compose(self) -> ComposeResult:
        yield Static(id="lead")
        with VerticalScroll(id="error", can_focus=False):
            yield Static(id="error-text")
        yield PortList(id="ports", compact=True, markup=False)
        with Horizontal(classes="row"):
            yield Label("other port")
            yield Input(id="port", placeholder="path, stable id, socket://host:port", compact=True)
        with Horizontal(classes="row"):
            yield Label("controller")
            yield Input(id="controller", placeholder="of the table, such as acutrol://HOST:PORT; or none", compact=True)
        with Horizontal(classes="row"):
            yield Label(_LABELS["rate_hz"])
            yield Input(f"{MAX_RATE_HZ:g}", id="rate", compact=True)
            yield Static(id="rate-verdict")
        for name, values in _CHOSEN.items():
            with Horizontal(classes="row"):
                yield Label(_LABELS[name])
                yield Radio(values, id=name)
        with Horizontal(classes="row"):
            yield Label("site")
            yield Input(id="site", placeholder="LAT,LON,H of the table in degrees and metres", compact=True)
        with Horizontal(classes="row"):
            yield Label("mode")
            yield Static(id="mode")
        with Horizontal(classes="row", id="go"):
            yield Label("")
            yield Button("Connect", id="connect", variant="primary", compact=True)
            yield Static(id="summary")

    def on_mount(self) -> None:
        self._say_rate()

    def fill(self, plan: Plan) -> None:
        """Put in what was asked for on the command line, to be mended here."""
        if plan.port != VIRTUAL_PORT:
            self.query_one("#port", Input).value = plan.port
        self.query_one("#rate", Input).value = f"{plan.rate_hz or MAX_RATE_HZ:g}"
        self.query_one("#controller", Input).value = plan.controller.removeprefix(VIRTUAL_PORT)
        self.query_one("#site", Input).value = "" if plan.site is None else ",".join(map(repr, plan.site))
        self._has_gravity = plan.gravity is not None
        for name in _CHOSEN:
            self.query_one(f"#{name}", Radio).choose(getattr(plan, name), plan.reference_file[0])

    def say_error(self, error: str, title: str = "Could not connect.") -> None:
        """Say why it could not connect in place of the lead; the lead again if it is empty."""
        self.set_class(bool(error), "-failed")
        body = Content.assemble((f"{title}  ", "bold $text-error"), error) if error else Content("")
        self.query_one("#error-text", Static).update(body)

    def _say_rate(self) -> None:
        """What the unit gives that is chosen, and what the Connect button would do."""
        offer = self._offered()
        try:
            text.parse_rate(self.query_one("#rate", Input).value, offer)
            said = Content.styled(text.rates(offer), "dim")
        except InputError as error:
            said = Content.styled(str(error), "bold $text-error")
        self.query_one("#rate-verdict", Static).update(said)
        self.query_one("#mode", Static).update(Content.styled(offer.mode_words, "dim"))
        self._say_summary()

    def _offered(self) -> type[Driver]:
        """What the unit gives that answered at the port that is chosen; the usual one's where none was asked."""
        choice = self._choice()
        return of_model("" if choice is None else self._models.get(choice.value, ""))

    def _say_summary(self) -> None:
        """What the Connect button would do."""
        choice = self._choice()
        if choice is None:
            said = ""
        elif choice.kind == "attach":
            said = f'looks at the running acquisition "{choice.value}"'
        elif choice.kind == "batch":
            said = f'looks at all units of the running batch "{choice.value}"'
        else:
            rate = self.query_one("#rate", Input).value
            said = f"{formatting.port_name(choice.value, 30)}, {rate} Hz, {self._value('sampling')}"
        self.query_one("#summary", Static).update(Content(said))

    # looking for ports

    def look(self) -> None:
        """Look for ports and running acquisitions, unless that is being done."""
        # one that takes long is not begun anew: it would never come to its end
        if not self._looking:
            self._looking = True
            self._look()

    @work
    async def _look(self) -> None:
        said = ""
        try:
            found = await in_thread(_choices)
        except (session.SessionError, OSError) as error:
            found, said = text.choices([], []), str(error)
        finally:
            self._looking = False
        if not self.query("#ports"):  # the page has gone meanwhile
            return
        if said:
            self.say_error(said)
        if found != self._choices:
            self._offer(found)

    def _offer(self, found: list[text.Choice]) -> None:
        """Fill the list; the highlight stays where somebody has put it, else it is on the likeliest line."""
        before = self._highlighted()
        chosen = before in found and before != text.likely(self._choices)
        self._choices = found
        self._fill_list(found.index(before if chosen and before is not None else text.likely(found)))
        self.query_one("#lead", Static).update(Content.assemble(*text.lead(found)))

    def _fill_list(self, highlighted: int | None) -> None:
        ports = self.query_one("#ports", OptionList)
        ports.clear_options()
        ports.add_options([Option(Content(text.label(choice, self._answers))) for choice in self._choices])
        ports.highlighted = highlighted
        self._say_rate()

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

    def probe(self) -> None:
        """Ask on the port that is chosen: typed in, or highlighted."""
        choice = self._choice()
        if choice is None or not choice.asks:
            said = "nothing to ask there: p asks on the port that is chosen, a on all of the list"
            self.post_message(Page.Say(said, "wait"))
        else:
            self._probe([choice.value])

    def probe_all(self) -> None:
        ports = [choice.value for choice in self._choices if choice.asks]
        if ports:
            self._probe(ports)
        else:
            self.post_message(Page.Say("this machine has no serial port to ask on", "wait"))

    @work(exclusive=True, group="probe")
    async def _probe(self, ports: list[str]) -> None:
        for port in ports:
            self._heard(port, "asking ...")
            try:
                found = await in_thread(lambda port=port: session.probe(port))  # type: ignore[misc]
            except (session.SessionError, OSError) as error:
                found = session.not_answered(port, str(error))
            if not self.query("#ports"):  # the page has gone meanwhile
                return
            self._found(port, found["instrument"])
            self._heard(port, text.answered(found))
            said = found["error"] or f"{formatting.port_name(port)}: {self._answers[port]}"
            self.post_message(Page.Say(said, "good" if found["answers"] and not found["error"] else "wait"))

    def _found(self, port: str, model: str) -> None:
        """Which unit answers at a port; a rate that nobody has chosen becomes one that it gives."""
        before = self._offered()
        self._models[port] = model
        rate, after = self.query_one("#rate", Input), self._offered()
        if rate.value == f"{before.most_rate_hz:g}" and after != before:
            rate.value = f"{after.most_rate_hz:g}"

    def _heard(self, port: str, answer: str) -> None:
        self._answers[port] = answer
        self._fill_list(self.query_one("#ports", OptionList).highlighted)

    # what the user does

    def on_option_list_option_highlighted(self) -> None:
        self._say_rate()

    def on_option_list_option_selected(self) -> None:
        """Enter on the list takes that line, whatever is typed below."""
        self._connect(self._highlighted())

    def on_radio_changed(self) -> None:
        self._say_summary()

    def on_input_changed(self) -> None:
        self._say_rate()

    def on_input_submitted(self) -> None:
        self.connect()

    def on_button_pressed(self) -> None:
        self.connect()

    def connect(self) -> None:
        self._connect(self._choice())

    def _connect(self, choice: text.Choice | None) -> None:
        if choice is None:
            return
        self.say_error("")
        if choice.kind in ("batch", "attach"):
            request = requests.OpenRack if choice.kind == "batch" else requests.Resume
            self.post_message(request(choice.value))
            return
        try:
            rate = text.parse_rate(self.query_one("#rate", Input).value, self._offered())
        except InputError as error:
            self.say_error(f"The rate is {error}.")
            self.query_one("#rate").focus()
            return
        chosen = {name: self._value(name) for name in _CHOSEN}
        try:
            site = self._site(choice)
        except InputError as error:
            self.say_error(f"The site is {error}.")
            self.query_one("#site").focus()
            return
        if not (site["site"] or self._has_gravity or self._asked_site or chosen["filter"] == "none"):
            self._asked_site = True
            self.say_error(text.ASK_SITE, "Where does the table stand?")
            self.query_one("#site").focus()
            return
        own = VIRTUAL_PORT if choice.value == VIRTUAL_PORT else ""  # a virtual unit stands on a table of its own
        controller = self.query_one("#controller", Input).value.strip() or own
        asked = {"port": choice.value, "rate_hz": rate, "controller": controller}
        self.post_message(requests.Start({**asked, **site, **chosen}))

    def _site(self, choice: text.Choice) -> dict[str, object]:
        """Return what the plan has for the site; raises InputError if what is typed does not read as one."""
        if choice.value == VIRTUAL_PORT:  # where that unit stands, wherever the user does
            return {"site": PAPER_PLACE, "gravity": None}
        typed = self.query_one("#site", Input).value.strip()
        return {"site": parse_place(typed) if typed else None}


class Radio(Widget, can_focus=True):
    """One line: all values, the chosen one crossed, and what that one means: "(x) stream  ( ) polled   …".

    `values`: value and what it means; the first one is chosen.
    """

    DEFAULT_CSS = """
    Radio { width: 1fr; height: 1; background: $surface; text-wrap: nowrap; text-overflow: ellipsis; }
    Radio:focus { background: $block-cursor-blurred-background; text-style: bold; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "app.focus_previous", show=False),
        Binding("down,j", "app.focus_next", show=False),
        Binding("left,h", "step(-1)", "other", show=False),
        Binding("right,l,space", "step(1)", "other", show=False),
    ]
    value: reactive[str] = reactive("")

    class Changed(Message):
        """Another value is chosen."""

    def __init__(self, values: dict[str, str], *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._values = dict(values)
        self.set_reactive(Radio.value, next(iter(values)))

    def render(self) -> Content:
        return Content(f"{'  '.join(self._cells())}   {self._values[self.value]}")

    def _cells(self) -> list[str]:
        return [f"({'x' if value == self.value else ' '}) {value}" for value in self._values]

    def choose(self, value: str, meaning: str) -> None:
        """Choose a value, offering it from now on if it was not one of them."""
        self._values.setdefault(value, meaning)
        self.value = value
        self.refresh()

    def watch_value(self) -> None:
        self.post_message(self.Changed())

    def action_step(self, step: int) -> None:
        values = list(self._values)
        self.value = values[(values.index(self.value) + step) % len(values)]

    def on_click(self, event: events.Click) -> None:
        start = 0
        for value, cell in zip(self._values, self._cells(), strict=True):
            if start <= event.x < start + len(cell):
                self.value = value
            start += len(cell) + 2


def _choices() -> list[text.Choice]:
    """What there is to choose from on this machine."""
    return text.choices(session.running(), session.ports())
