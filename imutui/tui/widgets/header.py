"""Who is connected, whether it records, which page this is: the two lines at the top of every page."""

from textual.content import Content

from imutui import __version__
from imutui.session.snapshot import Snapshot
from imutui.tui import formatting
from imutui.tui.connection.model import View
from imutui.tui.terminal.glyphs import Glyphs
from imutui.tui.widgets.text_lines import LEVEL_STYLES, TextLines

_PORT_ROOM = 14


class StatusHeader(TextLines):
    """Two lines: unit, port, recording and time; pages and the filter's badge.

    `current`: title of this one.
    """

    DEFAULT_CSS = "StatusHeader { height: 2; background: $panel; }"

    def __init__(self, pages: list[tuple[str, str]], current: str, glyphs: Glyphs | None = None) -> None:
        super().__init__(glyphs)
        self._pages = pages
        self._current = current

    def lines(self, view: View, width: int) -> list[Content]:
        """Identity and time; pages, filter and recording."""
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
        for key, title in self._pages:
            style = "bold reverse" if title == self._current else ""
            parts.append(Content.assemble(" ", (f"{key} {title}", style)))
        return Content(" ").join(parts)

    def _filter(self, view: View, room: int) -> Content:
        """The filter's badge, cut where it does not fit: the tabs stay whole."""
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
