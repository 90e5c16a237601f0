"""What is around a page's own widgets: header, notice, events, keys, cost of drawing, or that there is no room."""

import re

from textual.content import Content
from textual.geometry import Size
from textual.widget import Widget
from textual.widgets import Footer

from imutui import __version__
from imutui.session.snapshot import EventLine, Snapshot
from imutui.tui import formatting, messages
from imutui.tui.connection.model import View
from imutui.tui.terminal.glyphs import Glyphs
from imutui.tui.widgets.text_lines import LEVEL_STYLES, TextLines

_PORT_ROOM = 14
_FIELDS = re.compile(r" \([a-z_]+=.*")


class StatusHeader(TextLines):
    """Two lines: unit, port, recording and time; pages and the filter's badge.

    `pages`: the first is shown while a batch is looked at.
    """

    DEFAULT_CSS = "StatusHeader { height: 2; background: $panel; }"

    def __init__(self, pages: list[tuple[str, str]], current: str, glyphs: Glyphs | None = None) -> None:
        super().__init__(glyphs)
        self._pages = pages
        self._current = current

    def lines(self, view: View, width: int) -> list[Content]:
        now = view.now
        tabs = self._tabs()
        return [self._first(now, width), self.spread(tabs, self._filter(view, width - tabs.cell_length - 2), width)]

    def _first(self, now: Snapshot | None, width: int) -> Content:
        right = self.line("  ", *self._recording(now), "  ", self._time(now), " ")
        left = self._identity(now)
        if now is not None:
            room = width - left.cell_length - right.cell_length
            port = formatting.port_name(now["port"], max(room, 0))
            # a name without its middle is no name when little is left of it
            left = left.append(self.glyphs.text(port if room >= _PORT_ROOM or "…" not in port else ""))
        return self.spread(left, right, width)

    def _identity(self, now: Snapshot | None) -> Content:
        if now is None:
            return self.line(" ", ("imutui", "bold"), f" {__version__}  not connected")
        simulated = now["kind"] == "simulated"
        return self.line(
            " ",
            ("imutui", "bold"),
            f"  {now['instrument']} #{now['serial_number']}  ",
            (" SIMULATED ", "bold reverse") if simulated else "",
            "  " if simulated else "",
        )

    def _time(self, now: Snapshot | None) -> str:
        if now is None:
            return ""
        state = "" if now["state"] == "running" else f"{now['state'].upper()}  "
        return f"{state}{formatting.utc_time(now.get('utc'))} UTC"

    def _tabs(self) -> Content:
        parts = []
        rack = getattr(self.screen, "rack", None)
        for key, title in self._pages if rack is not None else self._pages[1:]:
            style = "bold reverse" if title == self._current else ""
            parts.append(Content.assemble(" ", (f"{key} {title}", style)))
        return Content(" ").join(parts)

    def _filter(self, view: View, room: int) -> Content:
        """The filter's badge, cut where it does not fit: the tabs stay whole. A table under command is more urgent."""
        if messages.table_is_commanded(view.now) or messages.investigates(view.now):
            said = " TABLE MOVES " if messages.table_moves(view.now) else " TABLE MAY MOVE "
            return self.line((said[: max(room, 0)], "bold reverse $text-error"), " ")
        verdict = view.verdict
        if verdict is None:
            return self.line(" ")
        said = verdict.short if len(verdict.short) <= room else verdict.short.removeprefix("filter ")
        return self.line((said[: max(room, 0)], LEVEL_STYLES[verdict.level]), " ")

    def _recording(self, now: Snapshot | None) -> tuple[str | tuple[str, str], ...]:
        if now is None:
            return ()
        recording = now["recording"]
        if recording is None:
            return ("not recording" if now["state"] == "running" else "",)
        return ((f"● REC {formatting.clock(recording['seconds'])}", "bold $text-error"),)


class DebugLine(TextLines):
    """Frames and bytes a second, processor, age of the newest sample, queue."""

    DEFAULT_CSS = "DebugLine { height: 1; display: none; color: $foreground 60%; }"

    def lines(self, view: View, width: int) -> list[Content]:
        return [self.line(f" {view.debug}"[:width])]


class Notice(TextLines):
    """The most urgent message in one line, more for a long one."""

    # docked: whatever else has to give way, what is said is seen
    DEFAULT_CSS = (
        "Notice { dock: bottom; height: auto; min-height: 1; max-height: 8; background: $surface; padding: 0 1; }"
    )

    def show(self, view: View) -> None:
        """Take a view; a longer message makes room for itself."""
        before = self._made
        super().show(view)
        if before is None or self._made is None or before.plain != self._made.plain:
            self.refresh(layout=True)

    def lines(self, view: View, width: int) -> list[Content]:
        level, said = _chosen(view)
        said = formatting.folded(said, width)
        return [self.line((said, "" if level == "event" else LEVEL_STYLES[level]))]


def _chosen(view: View) -> tuple[str, str]:
    now = view.now
    silent = messages.silence(now) if now is not None else None
    if silent is not None:
        return "bad", silent
    if now is not None and now["state"] == "running" and now["error"]:
        return "bad", now["error"]
    if view.notice[1]:
        return view.notice
    if view.frozen:
        return "wait", "FROZEN view: the acquisition goes on. space follows it again."
    if now is not None and now["findings"]:
        return "bad", now["findings"][-1]
    events = now["events"] if now is not None else []
    return "event", event_text(events[-1]) if events else ""


def event_text(event: EventLine) -> str:
    """Time, kind and text of an event, without the fields that stand there for programs."""
    kind = "" if event["name"] == "acquisition" else f"{event['name'].replace('_', ' ')}: "
    return f"{formatting.utc_time(event['utc'])}  {kind}{_FIELDS.sub('', event['text'])}"


class EventList(TextLines):
    """The last events of the acquisition, newest at the bottom: as many as there are lines."""

    DEFAULT_CSS = "EventList { height: 100%; padding: 0 1; }"

    def lines(self, view: View, width: int) -> list[Content]:
        events = (view.now["events"] if view.now is not None else [])[-max(self.content_size.height - 1, 1) :]
        head = self.line(("events, UTC".ljust(width), "bold underline"))
        rows = [self.line(event_text(event)).truncate(width, ellipsis=True) for event in events]
        return [head, *(rows or [self.line(("none yet", "dim"))])]


class KeysLine(Footer):
    """Textual's footer, made anew only when it would show something else.

    Textual says that keys may have changed whenever the focus moves or a page comes to the front; mostly they have not,
    and a new widget for each of them costs more than all else that is drawn.
    """

    def __init__(self) -> None:
        super().__init__(compact=True, show_command_palette=False)
        self._made_of: list[object] | None = None

    async def recompose(self) -> None:
        if not self.is_attached:  # its page went meanwhile
            return
        wanted: list[object] = [
            (active.binding, active.enabled, active.tooltip)
            for active in self.screen.active_bindings.values()
            if active.binding.show
        ]
        if wanted != self._made_of:
            self._made_of = wanted
            await super().recompose()


NEEDED = (80, 24)


def is_too_small(size: Size) -> bool:
    """Whether a terminal has less than any page needs."""
    return size.width < NEEDED[0] or size.height < NEEDED[1]


class TooSmall(Widget):
    """Says which size is needed, and which it is; whether a file is being written is seen here too."""

    DEFAULT_CSS = "TooSmall { width: 1fr; height: 1fr; content-align: center middle; text-align: center; }"

    recording = False

    def show(self, *, recording: bool) -> None:
        if recording != self.recording:
            self.recording = recording
            self.refresh()

    def render(self) -> Content:
        size, (width, height) = self.app.size, NEEDED
        return Content(
            f"imutui needs {width}x{height} characters;\nthis terminal has {size.width}x{size.height}.\n\n"
            f"Make it larger, or the font smaller.\nThe {'RECORDING' if self.recording else 'acquisition'} goes on."
            " q quits, d detaches; no other key acts."
        )
