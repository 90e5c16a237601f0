"""Rack: the units of a batch, a line each; what is asked there goes to all of them, or to those that are chosen."""

import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import ClassVar

from textual import work
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.widget import Widget
from textual.widgets import Static

from imutui.session import batch
from imutui.session.client import Client
from imutui.session.plan import RecordingWish
from imutui.session.snapshot import Snapshot
from imutui.tui import formatting, messages
from imutui.tui.background import in_thread
from imutui.tui.connection.model import View
from imutui.tui.connection.rack import Rack, UnitView
from imutui.tui.context import FAULTS
from imutui.tui.pages import requests
from imutui.tui.pages.base import PAGES, RACK, Page
from imutui.tui.pages.dialogs.choice import Answer, ChoiceDialog
from imutui.tui.pages.dialogs.note import MarkDialog, NoteDialog
from imutui.tui.pages.rack import text
from imutui.tui.pages.table import profiles
from imutui.tui.pages.table import text as table_text
from imutui.tui.widgets.option_rows import OptionRows
from imutui.tui.widgets.page_frame import StatusHeader
from imutui.tui.widgets.text_lines import LEVEL_STYLES, WrappedText

_LOUD = LEVEL_STYLES["bad"]
_NEWS_S, _DRAW_EVERY_S, _LOOK_EVERY_S = 0.25, 1.0, 5.0
_OF_A_UNIT = ",".join(key for key, title in PAGES if title in ("Live", "Record", "Filter", "Table"))


class RackHeader(StatusHeader):
    """Batch, how many units are at which level, how many record; pages."""

    def _first(self, now: Snapshot | None, width: int) -> Content:
        rack = getattr(self.screen, "rack", None)
        if not isinstance(rack, Rack):
            return super()._first(now, width)
        units = rack.units()
        records = sum(unit.now is not None and unit.now["recording"] is not None for unit in units)
        utc = next((unit.now["utc"] for unit in units if unit.now is not None), None)
        said = f"● REC {records} of {len(units)}" if records else "not recording"
        right = self.line((said, "bold $text-error" if records else ""), f"  {formatting.utc_time(utc)} UTC ")
        left = self.line(" ", ("imutui", "bold"), f"  batch {rack.name}  ")
        room = width - left.cell_length - right.cell_length - 1
        left = left.append(self.glyphs.text(text.summary(units, room)))
        return self.spread(left, right, width)


class RackPage(Page):
    """The units of a batch, with what is wrong with each; which step the table's profile is at."""

    TITLE = "Rack"
    AUTO_FOCUS = "#units"
    CSS = """
    RackPage #step { height: auto; min-height: 2; padding: 0 1; }
    RackPage #columns { height: 1; text-style: bold underline; }
    RackPage #units { height: 1fr; }
    RackPage #detail { height: 5; padding: 0 1; }
    RackPage #more { height: 1; color: $foreground 60%; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "unit('live')", "unit", key_display="enter", tooltip="The pages of this unit"),
        *(Binding(key, f"unit('{title.lower()}')", show=False) for key, title in PAGES if key in _OF_A_UNIT),
        Binding("x,space", "pick", "choose", key_display="x", tooltip="Choose units: keys then act on those alone"),
        Binding("w", "order", "worst first", tooltip="Worst first, or as in the batch's file"),
        Binding("r", "record", "record", tooltip="Start recordings; where all record, finish them"),
        Binding("m", "mark", "mark", tooltip="The same mark into the recording of each unit"),
        Binding("n", "note", "note", show=False, tooltip="The same note into the recording of each unit"),
        Binding("b", "guide('begin')", "begin", tooltip="Record, and be guided through the table profile"),
        Binding("t", "guide('next')", "there", tooltip="The table is where the segment wants it, for all units"),
        Binding("c", "guide('cancel')", "cancel", show=False, tooltip="Stop being guided; the recordings go on"),
        Binding("p", "profile", "profile", show=False, tooltip="Have all filters go by one table profile"),
        Binding("s", "stop", "stop", show=False, tooltip="Stop units, after asking"),
        Binding(
            "S", "start", "start", show=False, tooltip="Start units that do not run: others may be in their places"
        ),
        Binding("d", "app.detach", "detach", show=False, tooltip="Leave the screen, the acquisitions go on"),
        Binding("escape", "none", "choose none", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._rows = OptionRows(id="units")
        self._shown: list[UnitView] = []
        self._chosen: set[str] = set()
        self._worst_first = False
        self._step = text.step(())
        self._looked_at = self._drawn_at = 0.0

    def header(self) -> StatusHeader:
        return RackHeader([RACK, *PAGES], self.TITLE)

    def body(self) -> Iterable[Widget]:
        yield Static(id="step")
        yield Static(id="columns")
        yield self._rows
        yield WrappedText("", id="detail")
        yield Static(Content(text.MORE), id="more")

    def on_mount(self) -> None:
        super().on_mount()
        self.set_interval(_NEWS_S, self._draw_news)
        self._look()

    def on_screen_resume(self) -> None:
        super().on_screen_resume()
        if self.rack is not None:
            self.rack.seen = True
            self.rack.hurry()
        self._draw()

    # what is shown

    def show(self, view: View) -> None:
        self.view = view
        self._draw()
        super().show(view)

    def _draw_news(self) -> None:
        """Draw once a second if a unit has answered, at once before all have, and look for others now and then."""
        rack = self.rack
        if rack is None or not self.is_whole:
            return
        rack.seen = self.app.screen_stack[0] is self
        if rack.seen and time.monotonic() - self._looked_at > _LOOK_EVERY_S:
            self._look()
        due = time.monotonic() - self._drawn_at > _DRAW_EVERY_S or any(unit.answer is None for unit in self._shown)
        if rack.seen and due and rack.news.is_set():
            rack.news.clear()
            self._drawn_at = time.monotonic()
            self.redraw()

    @work(exclusive=True, group="look")
    async def _look(self) -> None:
        self._looked_at = time.monotonic()
        if self.rack is not None:
            await in_thread(self.rack.look)

    def _draw(self) -> None:
        rack = self.rack
        if rack is None or not self.is_whole:
            return
        here, units, width = self._here, rack.units(), self.app.size.width
        self._shown = text.worst_first(units) if self._worst_first else units
        self._chosen &= {unit.name for unit in units}
        header = self.query_one(RackHeader)
        line = header.line
        self._step = text.step(self._targets())
        right = f"{len(self._chosen)} chosen, Esc: none" if self._chosen else "worst first" * self._worst_first
        first = header.spread(line((self._step.said, "bold")), line(f"  {right}"), width - 2)
        lines = [first, line(self._step.then), *([line((common, _LOUD))] if (common := text.common(units)) else [])]
        self.query_one("#step", Static).update(Content("\n").join(lines))
        self.query_one("#columns", Static).update(line(text.heading(width).ljust(width)))
        self._rows.fill([line(*row) for row in text.rows(self._shown, self._chosen, width - 1)])
        at = next((n for n, unit in enumerate(self._shown) if here is not None and unit.name == here.name), None)
        if at is not None and self._rows.highlighted != at:
            self._rows.highlighted = at
        self._say_detail()

    def _say_detail(self) -> None:
        detail = "\n".join(part for part in text.detail(self._here) if part)
        widget = self.query_one("#detail", WrappedText)
        if detail != getattr(self, "_said", None):
            self._said = detail
            widget.update(detail)

    def on_option_list_option_highlighted(self) -> None:
        self._say_detail()

    @property
    def _here(self) -> UnitView | None:
        """The unit under the cursor."""
        at = self._rows.cursor
        return self._shown[at] if at is not None and at < len(self._shown) else None

    def as_text(self) -> str:
        return f"{text.heading(self.app.size.width)}\n{self._rows.as_text()}"

    # which units

    def _targets(self) -> list[UnitView]:
        """The chosen units that run, else all that do."""
        runs = [unit for unit in self._shown if unit.now is not None]
        return [unit for unit in runs if unit.name in self._chosen] if self._chosen else runs

    def action_pick(self) -> None:
        here = self._here
        if here is not None:
            self._chosen ^= {here.name}
            self._draw()
            self._rows.action_cursor_down()

    def action_none(self) -> None:
        self._chosen.clear()
        self._draw()

    def action_order(self) -> None:
        """Worst first, with the cursor on the worst; or as in the batch's file."""
        self._worst_first = not self._worst_first
        self._draw()
        if self._worst_first and self._shown:
            self._rows.highlighted = 0

    def action_unit(self, page: str) -> None:
        here = self._here
        if here is not None and here.now is None:
            self.say(f"{text.label(here)} does not run: there is nothing to look at", "wait")
        elif here is not None:
            self.post_message(requests.LookAt(here.name, page))

    # what is asked of them

    def action_record(self) -> None:
        """Start recordings where none runs, after asking for a note where there is none; else finish all."""
        targets = self._targets()
        idle = [unit for unit in targets if unit.now is not None and unit.now["recording"] is None]
        if idle and all(unit.now is not None and unit.now["note"] for unit in idle):
            self._ask(idle, "recording", lambda client: client.record())
        elif idle:
            self._ask_note(lambda note: self._ask(idle, "recording", lambda c: c.record(RecordingWish(note=note))))
        elif targets:
            self._confirm("Finish the files?", "f", "finish them", targets, self._finish)

    def _finish(self, units: Sequence[UnitView]) -> None:
        self._ask(units, "finished", lambda client: client.stop_recording(), busy="finishing the files")

    def action_mark(self) -> None:
        targets = self._recording()
        if targets:

            def said(mark: str | None) -> None:
                if mark is not None:
                    self._ask(targets, f"marked: {mark}", lambda client: client.mark(mark))

            self.app.push_screen(MarkDialog(), said)

    def action_note(self) -> None:
        targets = self._recording()
        if targets:
            self._ask_note(lambda note: self._ask(targets, "noted", lambda client: client.describe(note)))

    def _ask_note(self, then: Callable[[str], object]) -> None:
        def entered(answer: tuple[str, str] | None) -> None:
            if answer is not None:
                then(answer[0])

        self.app.push_screen(NoteDialog("A note for the recordings", text.NOTE_HINT), entered)

    def _recording(self) -> list[UnitView]:
        """Units that record, of those that are meant; that none does is said."""
        found = [unit for unit in self._targets() if unit.now is not None and unit.now["recording"] is not None]
        if not found:
            self.say("no unit records: r starts recordings", "wait")
        return found

    def action_guide(self, do: str) -> None:
        do = "resume" if do == "begin" and "resume" in self._step.can else do
        names = self._step.can.get(do, [])
        targets = [unit for unit in self._targets() if unit.name in names]
        if targets:
            self._ask(targets, text.GUIDED[do], lambda client: client.guide(do))
        else:
            self.say(f"not now: {self._step.said} {self._step.then}", "wait")

    @work(group="profile", exclusive=True)
    async def action_profile(self) -> None:
        """Choose a table profile, which the operator moves the table through by hand."""
        targets = self._targets()
        if any(unit.now is not None and unit.now["recording"] is not None for unit in targets):
            self.say(text.NO_PROFILE, "wait")
            return
        self.say(table_text.LOOKING, "wait")
        logs = Path(getattr(self.app, "logs_folder", "logs"))
        found = await in_thread(
            lambda: [profiles.by_hand(one) for one in profiles.found([Path(), logs]) if not one.error]
        )
        offers = {str(n): offer for n, offer in enumerate(found[:9], 1)}
        answers = [Answer(key, key, f"{offer.name}, {offer.segments} segments") for key, offer in offers.items()]

        def chosen(key: str | None) -> None:
            if key is not None:
                offer = offers[key]
                file = (offer.file, offer.text)
                self._ask(targets, f"{offer.name} is taken", lambda client: client.configure(reference_file=file))

        self.app.push_screen(ChoiceDialog("A table profile for all", text.PROFILES, answers), chosen)

    def action_stop(self) -> None:
        here = self._here
        targets = self._targets() if self._chosen else [here] if here is not None and here.now is not None else []
        if targets:
            self._confirm("Stop these units?", "s", "stop them; their files are finished", targets, self._stop)

    def action_start(self) -> None:
        """Start the unit under the cursor, or the chosen ones, where they do not run."""
        meant = self._chosen or ({self._here.name} if self._here is not None else set())
        names = [unit.name for unit in self._shown if unit.name in meant and unit.now is None]
        if names and self.rack is not None:
            self.post_message(requests.StartUnits(names, self.rack.hurry))
        else:
            self.say("it runs: s stops it, then S starts what is there by then", "wait")

    def _stop(self, units: Sequence[UnitView]) -> None:
        self._ask(units, "stopped", lambda client: client.stop("the screen"), busy="stopping")

    def _confirm(
        self, title: str, key: str, what: str, units: Sequence[UnitView], then: Callable[[Sequence[UnitView]], None]
    ) -> None:
        """Ask before something ends."""

        def answered(answer: str | None) -> None:
            if answer is not None:
                then(units)

        said = ", ".join(text.label(unit) for unit in units)
        dialog = ChoiceDialog(title, f"{formatting.plural(len(units), 'unit')}: {said}", [Answer(key, "yes", what)])
        self.app.push_screen(dialog, answered)

    @work(group="ask")
    async def _ask(self, units: Sequence[UnitView], done: str, do: Callable[[Client], object], busy: str = "") -> None:
        """Have units do something, all at once, and say what came of it."""
        if busy:
            self.say(busy, "wait")
        try:
            replies = await in_thread(lambda: batch.each([unit.name for unit in units], do))
        except FAULTS as error:
            self.say(messages.fault(error), "bad")
        else:
            self.say(*messages.of_several(done, replies))
        if self.rack is not None:
            self.rack.hurry()
