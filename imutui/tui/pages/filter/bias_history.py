"""A bias with its band of 3 sd over the whole run: the paper's Figures 3 and 4 as they come about."""

from dataclasses import dataclass
from typing import Any

from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip
from textual.widget import Widget

from imutui.estimate_history import EstimateHistory
from imutui.tui import formatting
from imutui.tui.terminal.glyphs import Glyphs, choose
from imutui.tui.widgets import history_cells, raster
from imutui.tui.widgets.history_cells import BiasEnvelope, Limits

_GUTTER = 10
_STYLES = {
    history_cells.EMPTY: "axis",
    history_cells.LINE: "axis",
    history_cells.EDGE: "edge",
    history_cells.HALF: "band",
    history_cells.GAP: "axis",
    history_cells.ESTIMATE: "estimate",
    history_cells.CONVERGED: "converged",
}
_ROWS_FOR_AXIS = 6
_TICK = 10


@dataclass(frozen=True, slots=True)
class BiasPlotSettings:
    """What is to be drawn, apart from the past itself; equal ones are drawn alike."""

    name: str
    unit: str
    limit: float | None
    column: int
    scale: str
    hint: str
    chosen: bool
    observable: bool


class BiasPlot(Widget):
    """One plot: estimate as a line, band behind it, broken lines at zero and at the data sheet's limits, pauses marked.

    The band is the background's colour; without colours, or with sixteen only, its edges are drawn.

    `column`: bias that it shows; None for the chosen one.
    """

    COMPONENT_CLASSES = {  # noqa: RUF012 - Textual's way
        "biasplot--title", "biasplot--chosen", "biasplot--axis", "biasplot--band", "biasplot--edge",
        "biasplot--estimate", "biasplot--converged",
    }  # fmt: skip
    DEFAULT_CSS = """
    BiasPlot { height: 1fr; width: 1fr; min-height: 3; }
    BiasPlot > .biasplot--title { color: $foreground 80%; }
    BiasPlot > .biasplot--chosen { text-style: bold; }
    BiasPlot > .biasplot--axis { color: $foreground 60%; }
    BiasPlot > .biasplot--band { background: $primary 35%; }
    BiasPlot > .biasplot--edge { color: $text-accent; }
    BiasPlot > .biasplot--estimate { color: $text-warning; }
    BiasPlot > .biasplot--converged { color: $text-primary; text-style: bold; }
    """

    def __init__(
        self,
        column: int | None = None,
        glyphs: Glyphs | None = None,
        *,
        id: str | None = None,  # noqa: A002 - Textual's name
    ) -> None:
        super().__init__(id=id)
        self.column = column
        self._glyphs = glyphs or choose()
        self._range: tuple[float, float] | None = None
        self._history: EstimateHistory | None = None
        self._settings: BiasPlotSettings | None = None
        self._drawn: tuple[Any, ...] | None = None
        self._strips: list[Strip] = []

    def show(self, history: EstimateHistory, settings: BiasPlotSettings) -> None:
        """Draw the past of a bias; nothing is sent to the terminal as long as it looks the same."""
        before = self._settings
        if before is None or (before.column, before.scale) != (settings.column, settings.scale):
            self._range = None
        self._history, self._settings = history, settings
        if self._draw():
            self.refresh()

    def render_line(self, y: int) -> Strip:
        """One line of the widget."""
        self._draw()
        return self._strips[y] if y < len(self._strips) else Strip.blank(self.size.width, self.rich_style)

    def notify_style_update(self) -> None:
        """Draw anew in another theme's colours."""
        self._drawn = None
        super().notify_style_update()

    def _draw(self) -> bool:
        """Make the lines anew if anything has changed since; whether they look different."""
        history, settings, size = self._history, self._settings, self.size
        if history is None or settings is None:
            return False
        # a row a second: what comes within it is drawn with it
        second = history.newest // 1.0 if len(history) else None
        stamp = (settings, size, id(history), len(history), history.attached_late, second)
        if stamp == self._drawn:
            return False
        self._drawn, before = stamp, self._strips
        self._strips = self._lines(history, settings, size.width, size.height)
        return before != self._strips

    def _lines(self, history: EstimateHistory, settings: BiasPlotSettings, width: int, height: int) -> list[Strip]:
        axis = int(height >= _ROWS_FOR_AXIS)
        rows, columns = height - 1 - axis, width - _GUTTER
        if rows < 1 or columns < 4:
            return []
        seconds = float(history.newest - history.begin) if len(history) else 0.0
        span = history_cells.span_s(seconds)
        envelope = (
            history_cells.envelope(history, settings.column, span, columns * self._glyphs.columns)
            if len(history)
            else None
        )
        extent = history_cells.extent(envelope, settings.scale, settings.limit) if envelope is not None else None
        head = self._head(settings, history, None if axis else span, width)
        tail = [self._time_axis(history, span, width)] if axis else []
        if envelope is None or extent is None:
            return [head, *self._empty(settings, rows, width), *tail]
        limits = self._range = raster.keep_range(self._range, *extent)
        return [head, *self._plot(envelope, limits, settings.limit, rows), *tail]

    @property
    def _shades(self) -> bool:
        """Whether the terminal has a colour between its background and its text."""
        return not (self.app.no_color or self.app.native_ansi_color or self._glyphs.name == "ascii")

    def _plot(self, envelope: BiasEnvelope, limits: Limits, limit: float | None, rows: int) -> list[Strip]:
        levels = [] if limit is None else [0.0, limit, -limit]
        shades = self._shades and limit is not None
        made = history_cells.cells(envelope, limits, levels, rows, self._glyphs, shades=shades)
        labels = _labels(limits, limit, rows)
        kinds = zip(labels, made.lines, made.shows.tolist(), made.shaded.tolist(), strict=True)
        return [self._strip(label, line, list(zip(shown, behind, strict=True))) for label, line, shown, behind in kinds]

    def _strip(self, label: str, line: str, kinds: list[tuple[int, bool]]) -> Strip:
        # every segment has a style: Textual's monochrome filter, under NO_COLOR, fails on one that has none
        segments = [self._segment(self._glyphs.text(label), "axis")]
        begin = 0
        for i in range(1, len(kinds) + 1):
            if i == len(kinds) or kinds[i] != kinds[begin]:
                kind, behind = kinds[begin]
                segments.append(self._segment(line[begin:i], _STYLES[kind], shaded=behind))
                begin = i
        return Strip(segments, _GUTTER + len(line))

    def _segment(self, said: str, style: str, *, shaded: bool = False) -> Segment:
        if style == "band":  # half a cell in the band's colour
            half = self.get_component_rich_style("biasplot--axis")
            return Segment(said, half + Style(color=self.get_component_rich_style("biasplot--band").bgcolor))
        look = self.get_component_rich_style(f"biasplot--{style}")
        if shaded:
            look += Style(bgcolor=self.get_component_rich_style("biasplot--band").bgcolor)
        return Segment(said, look)

    def _head(self, settings: BiasPlotSettings, history: EstimateHistory, span: float | None, width: int) -> Strip:
        axis = (
            ""
            if span is None
            else f"{history_cells.duration(history.begin)} to {history_cells.duration(history.begin + span)}"
        )
        since = "since attached" if history.attached_late else ""
        scale = {"auto": "", "whole run": "scale: whole run", "limits": "scale: limits"}[settings.scale]
        left = f"{'─>' if settings.chosen else '──'} {settings.name}, {settings.unit} "
        rights = (
            (settings.hint, self._band_name(settings), scale, since, axis),
            (settings.hint, scale, since, axis),
            (scale, since, axis),
        )
        for right in (*rights, (since, axis), (axis,)):
            said = self._glyphs.text(" " + ", ".join(part for part in right if part) + " ──" if any(right) else "")
            if len(left) + len(said) <= width:
                break
        else:
            said = ""
        left = self._glyphs.text(left)
        middle = self._glyphs.text("─") * max(width - len(left) - len(said), 0)
        style = "chosen" if settings.chosen else "title"
        return Strip([self._segment((left + middle + said)[:width].ljust(width), style)], width)

    def _band_name(self, settings: BiasPlotSettings) -> str:
        if settings.limit is None:
            return ""
        return "± 3 sd shaded" if self._shades else "± 3 sd edged"

    def _empty(self, settings: BiasPlotSettings, rows: int, width: int) -> list[Strip]:
        why = "no estimate yet" if settings.observable else "unobservable in this setup: there is no estimate"
        said = [f"{' ' * (_GUTTER - 1)}│ {why if row == rows // 2 else ''}" for row in range(rows)]
        return [Strip([self._segment(self._glyphs.text(line)[:width].ljust(width), "axis")], width) for line in said]

    def _time_axis(self, history: EstimateHistory, span: float, width: int) -> Strip:
        """Round times since the run's first sample."""
        room, line, free = width - _GUTTER, [" "] * width, 0
        for t in history_cells.ticks(history.begin, span, room // _TICK):
            label = history_cells.duration(t)
            start = _GUTTER + round((t - history.begin) / span * (room - 1)) - len(label) // 2
            start = min(start, width - len(label))
            if start >= free:
                line[start : start + len(label)] = label
                free = start + len(label) + 1
        return Strip([self._segment("".join(line), "axis")], width)


def _labels(limits: Limits, limit: float | None, rows: int) -> list[str]:
    """Gutter: both ends of the axis, and the level lines between them."""
    room, (low, high) = _GUTTER - 2, limits
    decimals = raster.label_decimals(limits)
    labels = [f"{'':<{room}} │"] * rows
    named = () if limit is None else ((0.0, "0"), (limit, f"+{limit:g}"), (-limit, f"-{limit:g}"))
    for level, name in named:
        if low <= level <= high and rows > 1:
            labels[round((high - level) * (rows - 1) / (high - low))] = f"{name:>{room}} ┤"
    labels[0] = f"{formatting.number(high, room, decimals)} ┤"
    if rows > 1:
        labels[-1] = f"{formatting.number(low, room, decimals)} ┤"
    return labels
