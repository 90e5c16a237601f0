"""Table: choose a profile, and be guided through it. The guide's state is the acquisition's."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from textual import work
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.content import Content
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Input, Label, OptionList, Static

from imutui.session.client import Client
from imutui.tui import formatting
from imutui.tui.background import in_thread
from imutui.tui.connection.model import Snapshot, View
from imutui.tui.pages.base import WIDE, Page
from imutui.tui.pages.dialogs.choice import Answer, ChoiceDialog
from imutui.tui.pages.table import text
from imutui.tui.pages.table.guide_head import GuideHead, guided
from imutui.tui.terminal.glyphs import choose
from imutui.tui.widgets.option_rows import OptionRows

if TYPE_CHECKING:
    from imutui.jobs.operator_steps import Offer, Step
    from imutui.session.snapshot import ProfileDescription

_NEEDED = 74
_WHO = """\
By hand: this page says where to go, and your Enter joins profile and log. Only what you hold still is used.
By itself: the controller runs the profile; profile and log are joined as the file says."""
_RUNNING = "running"
_LEVEL = "no profile: still and level"
_LEVEL_PREVIEW = "Enter lays the profile aside: the filter takes the unit as still and level"
_LOOKING = "looking for profiles…"
_LEAST_PLACE = 14


class TablePage(Page):
    """The profiles there are; or the chosen one as a list, with what to do now above it."""

    TITLE = "Table"
    AUTO_FOCUS = "#offers"
    CSS = """
    TablePage #choose, TablePage #follow { height: 1fr; }
    TablePage #choose-lead { padding: 0 1; height: auto; }
    TablePage #offers { height: auto; max-height: 50%; margin: 1 0 0 0; }
    TablePage #other-row { height: 1; padding: 0 1; margin: 1 0 0 0; }
    TablePage #other-row Label { width: 12; }
    TablePage #preview { height: 1fr; padding: 0 1; margin: 1 0 0 0; }
    TablePage #columns { height: 1; color: $foreground 60%; }
    TablePage #detail { height: 2; padding: 0 1; color: $foreground 80%; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "take", "take it", key_display="enter", tooltip="Have the filter go by this profile"),
        Binding("enter", "there", "I am there", key_display="enter", tooltip="The table is where the profile wants it"),
        Binding("b", "begin", "begin", tooltip="Record, and be guided through the profile"),
        Binding("b", "resume", "resume", tooltip="Go on with the segment that was cancelled"),
        Binding("c", "cancel", "cancel", tooltip="Stop being guided; the recording goes on"),
        Binding("p", "choose", "other profile", tooltip="Choose another table profile"),
        Binding("o", "other", "other file", tooltip="Type the path of a profile"),
        Binding("escape", "back", "back", show=False),
    ]

    class BeginAsked(Message):
        """Record as the Record page's form says, and guide through the profile."""

    def __init__(self) -> None:
        super().__init__()
        self._offers: list[Offer] = []
        self._looked = False
        self._level = False
        self._profile: Mapping[str, Any] | None = None
        self._shows: Sequence[Sequence[str]] | None = None
        self._known: object = None
        self._choosing = False
        self._at: int | None = None
        self._offered: set[str] = set()
        self._wanted: Path | None = None

    def body(self) -> Iterable[Widget]:
        """The chooser, and the guided list; one of them is shown."""
        with Vertical(id="choose"):
            yield Static(id="choose-lead")
            yield OptionRows(id="offers")
            with Horizontal(id="other-row"):
                yield Label("other file")
                yield Input(id="other", placeholder="path of a TOML or CSV file; o goes here", compact=True)
            yield Static(id="preview")
        with Vertical(id="follow"):
            yield GuideHead()
            yield Static(id="columns")
            yield OptionRows(id="segments")
            yield Static(id="detail")

    def on_mount(self) -> None:
        """Look for profiles."""
        super().on_mount()
        self._say_lead()
        self._part()
        self._list_offers()
        self.look()

    def on_screen_resume(self) -> None:
        """Look again: a profile may have come."""
        super().on_screen_resume()
        self.look()

    # the profiles there are

    def look(self, wanted: Path | None = None) -> None:
        """Look for profiles; with the cursor on one, if it is there."""
        self._wanted = wanted or self._wanted
        self._look([Path(), Path(getattr(self.app, "logs_folder", "logs"))])

    @work(exclusive=True, group="look")
    async def _look(self, folders: list[Path]) -> None:
        found = await in_thread(lambda: _offers(folders))
        if not self.query("#preview"):  # the page has gone meanwhile
            return
        if not self._looked:
            self._looked = True
            self.query_one("#preview", Static).update("")
        known = {(offer.place, offer.name) for offer in found}
        self._offers = [*found, *(o for o in self._offers if (o.place, o.name) not in known and Path(o.place).is_dir())]
        self._list_offers()

    def _list_offers(self) -> None:
        rows, before = self.query_one("#offers", OptionRows), self._level
        self._level = self._looked and self._has_reference()
        name, place = self._widths()
        lines = [self._offer_line(offer, name, place) for offer in self._offers]
        rows.fill([Content(choose().text(line)) for line in ([f" {_LEVEL}"] if self._level else []) + lines])
        at = next((n for n, o in enumerate(self._offers) if self._wanted == Path(o.place) / o.name), None)
        if at is not None:
            rows.highlighted, self._wanted = at + self._level, None
        elif self._level != before and rows.highlighted is not None:  # the cursor stays with its profile
            rows.highlighted = max(rows.highlighted + self._level - before, 0)
        self._preview()

    def _has_reference(self) -> bool:
        """Whether the filter goes by a file, and so can be brought back to level."""
        now = self.view.now if self.view is not None else None
        return now is not None and now["state"] == _RUNNING and bool((now.get("reference") or {}).get("file"))

    def _widths(self) -> tuple[int, int]:
        """Of names and places: as wide as need be; if there is no room for both, places give way first."""
        room = max(self.app.size.width, _NEEDED) - 25
        names, places = (max(map(len, column), default=0) for column in self._named())
        place = min(places, max(room - names, _LEAST_PLACE))
        return min(names, room - place), place

    def _named(self) -> tuple[list[str], list[str]]:
        return [offer.name for offer in self._offers], [offer.place for offer in self._offers]

    def _offer_line(self, offer: "Offer", name: int, place: int) -> str:
        what = "can't be used" if offer.error else f"{offer.segments:3d} segments {text.span(offer.seconds):>6}"
        return f" {formatting.shorten(offer.name, name):<{name}}  {what:<20} {formatting.shorten(offer.place, place)}"

    def _offer(self) -> "Offer | None":
        at = self.query_one("#offers", OptionRows).cursor
        number = -1 if at is None else at - self._level
        return self._offers[number] if 0 <= number < len(self._offers) else None

    def _at_level(self) -> bool:
        """Whether the cursor is on the way back to level."""
        return self._level and self.query_one("#offers", OptionRows).cursor == 0

    @work(exclusive=True, group="preview")
    async def _preview(self) -> None:
        offer = self._offer()
        preview = self.query_one("#preview", Static)
        if offer is None:
            said = _LEVEL_PREVIEW if self._at_level() else "" if self._looked else _LOOKING
            preview.update(Content(choose().text(said)))
        elif offer.error:
            preview.update(Content(f"{offer.name} can't be used: {offer.error}"))
        else:
            steps = await in_thread(lambda: _steps(offer))
            if self.query("#preview"):  # the page may have gone meanwhile
                preview.update(Content(choose().text("\n".join(self._preview_lines(offer, steps)))))

    def _preview_lines(self, offer: "Offer", steps: "list[Step]") -> list[str]:
        room = max(self.query_one("#preview").size.height - 1, 1)
        width = self.app.size.width - 2
        shown = [f"{n:3d}  {step.text.removeprefix('go to ')}, {step.seconds:g} s" for n, step in enumerate(steps, 1)]
        lines = [
            f"{line}   {text.testable(step.shows, width - len(line) - 3)}"
            for line, step in zip(shown, steps, strict=True)
        ]
        if len(lines) > room:
            lines = [*lines[: room - 1], f"  …  and {len(lines) - room + 1} more segments"]
        return ["what to do, and what each segment makes testable", *lines]

    # what the acquisition has

    def show(self, view: View) -> None:
        """Show a view; ask for the profile when the acquisition has another one."""
        if not self.query(GuideHead):  # an answer has come while the page goes away
            return
        super().show(view)
        now = view.now
        reference = now.get("reference") if now is not None else None
        live = now is not None and now["state"] == _RUNNING
        key = (now["pid"], reference["name"], reference["file"]) if now and reference and reference["profile"] else None
        if live and key != self._known:
            self._known = key
            self._forget()
            if key is not None:
                self._fetch()
        if self._looked and self._level != self._has_reference():
            self._list_offers()
        self._say_lead()
        self._part()
        self._list_segments(now)

    def as_text(self) -> str:
        """What is done and what is to be done; or the profiles there are."""
        follow = self._profile is not None and not self._choosing
        head = [super().as_text(), *self._columns()] if follow else []
        return "\n".join([*head, self.query_one("#segments" if follow else "#offers", OptionRows).as_text()])

    def _columns(self) -> list[str]:
        line = f"  #  {'what to do':<{self._room()}}    dwell  state      left    marked "
        return [line + (" makes testable" if self._wide() else "")]

    def _forget(self) -> None:
        self._profile, self._shows, self._at, self._choosing = None, None, None, False

    def _fetch(self) -> None:
        found: list[ProfileDescription | None] = []

        def ask(client: Client) -> str:
            found.append(client.profile())
            return ""

        self.post_message(self.Ask(ask, "", lambda: self._follow(found[0])))

    def _follow(self, profile: Mapping[str, Any] | None) -> None:
        """A profile has come: show it, then work out what it makes testable."""
        self._profile, self._shows, self._choosing = profile, None, False
        self._head()
        if profile is not None:
            self._work_out(profile)

    @work(exclusive=True, group="shows")
    async def _work_out(self, profile: Mapping[str, Any]) -> None:
        shows = await in_thread(lambda: _shows(profile))
        if self._profile is profile:
            self._shows = shows
            self._head()

    def _head(self) -> None:
        self.query_one(GuideHead).profile = self._profile
        if self.view is not None:
            self.show(self.view)

    def _part(self) -> None:
        """Choose, or follow."""
        follow = self._profile is not None and not self._choosing
        part = "#segments" if follow else "#offers"
        if self.query_one("#follow").display != follow or self.query_one("#choose").display == follow:
            self.query_one("#follow").display, self.query_one("#choose").display = follow, not follow
            self.query_one(part).focus()
        offered = self._possible()
        if offered != self._offered:
            self._offered = offered
            self.refresh_bindings()

    def _say_lead(self) -> None:
        now = self.view.now if self.view is not None else None
        if now is None or now["state"] != _RUNNING:
            said = "Table profiles. To follow one, connect first: 1 goes there."
        elif now.get("recording") is not None:
            said = "Table profiles. r finishes the recording that runs; then one can be taken."
        else:
            said = "Choose a table profile; Enter takes it: the filter then goes by it."
        self.query_one("#choose-lead", Static).update(Content.styled(said, "bold"))

    # the list

    def _list_segments(self, now: Snapshot | None) -> None:
        if self._profile is None:
            return
        guide = now.get("guide") if now is not None else None
        rows = self.query_one("#segments", OptionRows)
        rows.fill([self._segment_line(n, segment, guide) for n, segment in enumerate(self._profile["segments"])])
        at = min(int(guide["segment"]), len(self._profile["segments"]) - 1) if guide is not None else None
        if at is not None and at != self._at:
            rows.highlighted = at
        self._at = at
        self._say_columns()
        self._say_detail()

    def _segment_line(self, number: int, segment: Mapping[str, Any], guide: text.Guide | None) -> Content:
        word, left = text.state_word(guide, number), text.left(guide, number)
        marked = text.begun(guide, number)
        parts = [
            f"{number + 1:3d}  ",
            f"{formatting.shorten(str(segment['text']), self._room()):<{self._room()}}",
            f"{float(segment['seconds']):6.0f} s",
            f"  {word:<8}",
            f"{f'{left:4.0f} s' if left is not None else '':>7}",
            f"  {formatting.clock(marked) if marked is not None else '–':>8} ",
        ]
        line = "".join(parts)
        if self._wide():
            shows = None if self._shows is None else self._shows[number] if self._shows else []
            line += f" {text.testable(shows, self.app.size.width - len(line) - 3)}"
        style = {"now": "bold", "next": "", "done": "dim"}.get(word, "")
        return Content.styled(choose().text(line), style)

    def _wide(self) -> bool:
        return self.app.size.width >= WIDE

    def _room(self) -> int:
        """For what to do."""
        return 41 if self._wide() else self.app.size.width - 41

    def _say_columns(self) -> None:
        self.query_one("#columns", Static).update(Content(self._columns()[0]))

    def _say_detail(self) -> None:
        """The cursor's segment, in as many words as there is room for."""
        at = self.query_one("#segments", OptionRows).cursor
        if at is None or self._profile is None or self._shows == []:
            return
        shows = None if self._shows is None else self._shows[at]
        head = f"Segment {at + 1} makes testable: "
        said = text.testable(shows, 2 * (self.app.size.width - 3) - len(head))
        self.query_one("#detail", Static).update(Content(choose().text(head + said)))

    # what the operator does

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer what can be done now."""
        if action in ("take", "other", "there", "begin", "resume", "cancel", "choose"):
            return action in self._possible()
        return True

    def _possible(self) -> set[str]:
        """Actions that make sense now."""
        now = self.view.now if self.view is not None else None
        if self._profile is None or self._choosing:
            return {"take", "other"}
        if now is None or now["state"] != _RUNNING:
            return {"choose"}
        guide = now.get("guide")
        under_way = guide is not None and guide["state"] in ("go", "hold")
        can = text.can(guide, now.get("recording") is not None) if guided(self._profile, now) else set()
        return can | (set() if under_way else {"choose"})

    def on_option_list_option_highlighted(self, event: OptionList.OptionHighlighted) -> None:
        """Say more of the line with the cursor."""
        if event.option_list.id == "offers":
            self._preview()
        else:
            self._say_detail()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Take the file that was typed."""
        if event.value.strip():
            self._open(Path(event.value.strip()).expanduser())

    @work(exclusive=True, group="open")
    async def _open(self, path: Path) -> None:
        offer = await in_thread(lambda: _offer_of(path))
        if offer.error:
            self.post_message(self.Say(f"{path}: {offer.error}", "bad"))
            return
        self._offers = [o for o in self._offers if (o.place, o.name) != (offer.place, offer.name)] + [offer]
        self._wanted = Path(offer.place) / offer.name
        self._list_offers()
        self.query_one("#offers").focus()
        self._choose(offer)

    def action_take(self) -> None:
        """Have the filter go by the profile with the cursor."""
        offer = self._offer()
        if isinstance(self.focused, Input):
            return
        if self._at_level():
            self._go_level()
        elif offer is None:
            return
        elif offer.error:
            self.post_message(self.Say(f"{offer.name} can't be used: {offer.error}", "bad"))
        else:
            self._choose(offer)

    def _choose(self, offer: "Offer") -> None:
        """Take a profile; one that is not joined by marks may be followed by hand all the same."""
        if offer.align == "marks" or offer.file.endswith(".csv"):
            self._configure(offer)
            return
        answers = [Answer("h", "hand", "I do, by hand: guide me"), Answer("t", "table", "the table, by itself")]
        dialog = ChoiceDialog(f"{offer.name}: who moves the table?", _WHO, answers)
        self.app.push_screen(dialog, lambda answer: self._answered(offer, answer))

    def _answered(self, offer: "Offer", answer: str | None) -> None:
        if answer == "hand":
            self._take_by_hand(offer)
        elif answer == "table":
            self._configure(offer)

    @work(exclusive=True, group="open")
    async def _take_by_hand(self, offer: "Offer") -> None:
        self._configure(await in_thread(lambda: _by_hand(offer)))

    def _refused(self) -> bool:
        """Whether a recording runs, which has one reference; it is said then."""
        now = self.view.now if self.view is not None else None
        recording = now is not None and now.get("recording") is not None
        if recording:
            self.post_message(self.Say("a recording runs: r finishes it, then a profile can be taken", "wait"))
        return recording

    def _go_level(self) -> None:
        """Back from a profile to a unit that stands still and level; the next snapshot shows it."""

        def ask(client: Client) -> str:
            client.configure(reference="level", reference_file=("", ""))
            return f"{_LEVEL}; the filter began anew"

        if not self._refused():
            self.post_message(self.Ask(ask, "laying the profile aside"))

    def _configure(self, offer: "Offer") -> None:
        if self._refused():
            return

        def ask(client: Client) -> str:
            client.configure(reference_file=(offer.file, offer.text))
            return f"{offer.name}: the filter goes by it from now on, and began anew"

        self.post_message(self.Ask(ask, f"taking {offer.name}", self._taken))

    def _taken(self) -> None:
        """The same profile again is followed as well."""
        self._choosing = False
        self._known = None
        if self.view is not None:
            self.show(self.view)

    def _guide(self, do: str, busy: str, done: str) -> None:
        def ask(client: Client) -> str:
            client.guide(do)
            return done

        self.post_message(self.Ask(ask, busy))

    def action_there(self) -> None:
        """The table is there."""
        self._guide("next", "", "")

    def action_begin(self) -> None:
        """Record, as the Record page's form says, and be guided."""
        self.post_message(self.BeginAsked())

    def action_resume(self) -> None:
        """Go on where it was cancelled."""
        self._guide("resume", "", "resumed")

    def action_cancel(self) -> None:
        """Be guided no more."""
        self._guide("cancel", "", "cancelled; the recording goes on, b resumes")

    def action_choose(self) -> None:
        """Another profile."""
        self._choosing = True
        self._part()
        self.look()

    def action_other(self) -> None:
        """Type a path."""
        self.query_one("#other").focus()

    def action_back(self) -> None:
        """From the field to the list; from the list to the profile that is followed; then to the live page."""
        if isinstance(self.focused, Input):
            self.query_one("#offers").focus()
        elif self._choosing and self._profile is not None:
            self._choosing = False
            self._part()
        else:
            self.app.call_later(self.app.run_action, "live")


# The jobs load numpy and scipy: in the threads that call these, not when the UI starts.


def _offers(folders: list[Path]) -> "list[Offer]":
    from imutui.jobs import operator_steps

    return operator_steps.offers(folders)


def _offer_of(path: Path) -> "Offer":
    from imutui.jobs import operator_steps

    return operator_steps.offer_of(path)


def _by_hand(offer: "Offer") -> "Offer":
    from imutui.jobs import operator_steps

    return operator_steps.by_hand(offer) or offer


def _steps(offer: "Offer") -> "list[Step]":
    from imutui.jobs import operator_steps

    return operator_steps.steps(operator_steps.load(offer.file, offer.text))


def _shows(profile: Mapping[str, Any]) -> list[list[str]]:
    """What each segment makes testable; empty where the acquisition does not tell all of the motion."""
    from imutui.jobs import operator_steps

    made = operator_steps.from_segments(profile["segments"], str(profile.get("align", "none")))
    return [] if made is None else operator_steps.makes_observable(made)
