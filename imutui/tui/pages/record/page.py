"""Record: what is being written, how fast, and what goes into it."""

from collections.abc import Iterable
from typing import ClassVar

from textual import events
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.content import Content
from textual.widget import Widget
from textual.widgets import Input, Label, Static

from filters.errors import InputError
from imutui.session.plan import RecordingWish
from imutui.session.snapshot import RecordingSnapshot, Snapshot
from imutui.tui import formatting
from imutui.tui.connection.model import View
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.note import describe_recording
from imutui.tui.pages.record import text
from imutui.tui.widgets.page_frame import EventList
from imutui.tui.widgets.text_lines import LEVEL_STYLES, TextLines

_ROWS = (("operator", "place"), ("table", "rotate_minutes"), ("note", "rotate_mb"))


class RecordPage(Page):
    """State of the recording, the form for the next one, marks."""

    TITLE = "Record"
    AUTO_FOCUS = ""
    CSS = """
    #take { height: 1fr; }
    #take-left { width: 80; max-width: 100%; height: 1fr; }
    RecordPage EventList { width: 1fr; height: 1fr; }
    #wish { height: 5; padding: 0 1; }
    #wish-head { height: 1; }
    #wish-wrong { height: 1; color: $text-error; text-style: bold; }
    .wish-row { height: 1; }
    .wish-row Label { width: 10; }
    .wish-row Label.number { width: 21; margin-left: 2; }
    .wish-row Input { width: 1fr; }
    .wish-row Input.number { width: 9; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("e", "edit", "edit form", tooltip="Type operator, place, table, note, rotation"),
        Binding("n", "note", "note", tooltip="Change note and operator of the file that is being written"),
        Binding("escape", "leave_form", "done", tooltip="Back from the form to the keys"),
        Binding("tab", "next_field", "next field"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._touched: set[str] = set()
        self._filled: dict[str, str] = {}

    def body(self) -> Iterable[Widget]:
        with Horizontal(id="take"):
            with Vertical(id="take-left"):
                yield RecordingState()
                with Vertical(id="wish"):
                    yield from self._form()
                yield MarkList()
            yield EventList()

    def _form(self) -> Iterable[Widget]:
        yield Static(id="wish-head")
        for row in _ROWS:
            with Horizontal(classes="wish-row"):
                for name in row:
                    kind = "number" if name in text.NUMBERS else ""
                    yield Label(text.FIELDS[name], classes=kind)
                    yield Input(
                        id=f"wish-{name}", compact=True, classes=kind, placeholder="never" if kind else "not set"
                    )
        yield Static(id="wish-wrong")

    def show(self, view: View) -> None:
        """Show a view; fields that nobody has typed into follow the acquisition."""
        super().show(view)
        if view.now is not None:
            self._prefill(text.prefilled(view.now))
        self._say_form()

    def _prefill(self, values: dict[str, str]) -> None:
        for name, value in values.items():
            if name not in self._touched and self._filled.get(name) != value:
                self._filled[name] = value
                with self.prevent(Input.Changed):
                    self.query_one(f"#wish-{name}", Input).value = value

    def _say_form(self) -> None:
        recording = self.recording
        title = "the recording after this gets" if recording else "the next recording gets"
        key = "Esc done" if isinstance(self.focused, Input) else "e edits"
        width = self.query_one("#wish").content_size.width or 78
        head = self.query_one(RecordingState).rule(title, width, key)
        self.query_one("#wish-head", Static).update(head)

    def finished(self, said: list[tuple[str, str]]) -> None:
        """Show what was written last; empty while something is being written."""
        state = self.query_one(RecordingState)
        state.finished = said
        state.refresh()

    def begun(self) -> None:
        """A recording has begun: the acquisition has what was typed into the form."""
        self._touched.clear()

    def wish(self) -> RecordingWish:
        """What was typed into the form; InputError if it cannot be. The rest shows what the acquisition has anyway."""
        return text.wish({name: self.query_one(f"#wish-{name}", Input).value for name in self._touched})

    def on_input_changed(self, event: Input.Changed) -> None:
        self._touched.add((event.input.id or "").removeprefix("wish-"))
        try:
            self.wish()
            wrong = ""
        except InputError as error:
            wrong = str(error)
        self.query_one("#wish-wrong", Static).update(Content(wrong))

    def on_input_submitted(self) -> None:
        self.focus_next(Input)

    def on_descendant_focus(self, _: events.DescendantFocus) -> None:
        self._say_form()

    def on_descendant_blur(self, _: events.DescendantBlur) -> None:
        self._say_form()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        typing = isinstance(self.focused, Input)
        if action == "edit":
            return not typing
        if action == "note":
            return not typing and self.recording is not None
        return typing if action in ("leave_form", "next_field") else True

    def action_edit(self) -> None:
        self.set_focus(self.query_one("#wish-operator"))  # at once: what is typed next goes there

    def action_note(self) -> None:
        describe_recording(self)

    def action_next_field(self) -> None:
        self.focus_next(Input)

    def action_leave_form(self) -> None:
        self.set_focus(None)


_NAME = 10


class RecordingState(TextLines):
    """Whether it records, in big; hint; and every number of the file and the line."""

    DEFAULT_CSS = "RecordingState { height: 8; padding: 0 1; }"

    def __init__(self) -> None:
        super().__init__()
        self.finished: list[tuple[str, str]] = []  # what was written last: names and values

    def lines(self, view: View, width: int) -> list[Content]:
        now = view.now
        level, said = text.state(now)
        style = LEVEL_STYLES[level]
        badge = self.line((f" {said} ", f"{style} reverse"), "  ", (text.hint(now), "bold"))
        if now is None:
            return [badge]
        recording = now["recording"]
        rows = self._idle(now, width) if recording is None else self._file(now, recording, width)
        return [row.truncate(width, ellipsis=True) for row in (badge, *rows, *self._link(now, width))]

    def _row(self, name: str, said: str, level: str = "none") -> Content:
        return self.line((f"{name:{_NAME}}", "dim"), (said, "" if level == "none" else LEVEL_STYLES[level]))

    def _file(self, now: Snapshot, recording: RecordingSnapshot, width: int) -> list[Content]:
        full = text.fill_words(recording, now["free_bytes"])
        level, flushed = text.flush(recording)
        size = f"{formatting.size(recording['bytes'])}, {text.growth(recording)}; disk {full}"
        return [
            self._row("file", formatting.shorten_path(recording["path"], width - _NAME)),
            self._row("size", size, text.room(recording)),
            self._row("rotation", f"{text.part(recording, now)}; {formatting.plural(recording['samples'], 'sample')}"),
            self._row("disk", flushed, level),
        ]

    def _idle(self, now: Snapshot, width: int) -> list[Content]:
        free = now["free_bytes"]
        space = "" if free is None else f"; {formatting.size(free)} free"
        if self.finished:
            (name, path), *others = self.finished
            rows = [self._row(name, formatting.shorten_path(path, width - _NAME))]
            rows += [self._row(name, formatting.shorten(said, width - _NAME)) for name, said in others]
            again = "" if now["state"] == "ended" else "; r records again"
            rows += [self._row("next", f"6 Logs opens it: info, check, replay, trace{again}", "good")]
            return [*rows, *[Content("")] * (4 - len(rows))]
        if now["state"] == "ended":
            folder = formatting.shorten_path(now["logs"] or "the logs folder", width - _NAME)
            return [self._row("files", folder), self._row("", "6 Logs lists them"), Content(""), Content("")]
        return [
            self._row("r writes", formatting.shorten_path(text.will_write(now), width - _NAME)),
            self._row("", f"every packet, onto the disk each second{space}"),
            self._row("", "the filter begins anew with it, so that a replay gives the same"),
            Content(""),
        ]

    def _link(self, now: Snapshot, width: int) -> list[Content]:
        measured, packets = now["measured_hz"], now["packet_hz"]
        rate = f"asked {now['rate_hz']:g} Hz, measured {formatting.number(measured, 0, 2)} Hz"
        if packets is not None:
            rate += f"; {packets:.2f} packets/s, {formatting.plural(now['packets'], 'packet')}"
        trouble, losses = text.losses(now)
        if len(losses) > width - _NAME:  # counts whole, rather than half an advice
            losses = losses.partition(": ")[0]
        level, line = text.line(now)
        return [self._row("rate", rate), self._row("losses", losses, trouble), self._row("line", line, level)]


class MarkList(TextLines):
    """The last marks, newest at the bottom."""

    DEFAULT_CSS = "MarkList { height: 1fr; padding: 0 1; min-height: 3; }"

    def lines(self, view: View, width: int) -> list[Content]:
        marks = view.now["marks"] if view.now is not None else []
        room = max(self.content_size.height - 1, 1)
        head = self.rule(f"marks: {len(marks)}" if marks else "marks", width, "UTC, time in the file, text")
        if not marks:
            return [
                head,
                self.line(
                    ("none yet: m adds one" if view.recording is not None else "none: they go into a recording", "dim")
                ),
            ]
        return [head, *(self.line(text.mark_line(mark)).truncate(width, ellipsis=True) for mark in marks[-room:])]
