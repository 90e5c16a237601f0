"""A bias with its band of 3 sd over the whole run: the paper's Figures 3 and 4 as they come about."""

from dataclasses import dataclass

from rich.style import Style

from imutui.estimate_history import EstimateHistory
from imutui.tui.terminal.glyphs import Glyphs
from imutui.tui.widgets import history_cells, raster
from imutui.tui.widgets.history_cells import GUTTER, BiasEnvelope
from imutui.tui.widgets.plot_widget import PlotWidget
from imutui.tui.widgets.raster import Limits, Line

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
    unseen: str  # why there is no estimate now; empty if there is one, or one will come
    banded: bool = True  # whether it has a band of 3 sd, and a zero to be seen from


class BiasPlot(PlotWidget):
    """One plot: estimate as a line, band behind it, broken lines at zero and at the data sheet's limits, pauses marked.

    The band is the background's colour; without colours, or with sixteen only, its edges are drawn.

    `column`: bias that it shows; None for the chosen one.
    """

    PREFIX = "biasplot"
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
        super().__init__(glyphs, id=id)
        self.column = column
        self._range: tuple[float, float] | None = None
        self._history: EstimateHistory | None = None
        self._settings: BiasPlotSettings | None = None
        self._shown: tuple[object, ...] | None = None

    def show(self, history: EstimateHistory, settings: BiasPlotSettings) -> None:
        """Draw the past of a bias; nothing is sent to the terminal as long as it looks the same."""
        before = self._settings
        if before is None or (before.column, before.scale) != (settings.column, settings.scale):
            self._range = None
        self._history, self._settings = history, settings
        # a row a second: what comes within it is drawn with it
        second = history.newest // 1.0 if len(history) else None
        shown = (settings, id(history), len(history), second)
        if shown != self._shown:
            self._shown = shown
            self.redraw()

    def drawn(self, width: int, height: int) -> list[Line]:
        history, settings = self._history, self._settings
        if history is None or settings is None:
            return []
        axis = int(height >= _ROWS_FOR_AXIS)
        rows, columns = height - 1 - axis, width - GUTTER
        if rows < 1 or columns < 4:
            return []
        seconds = float(history.newest) if len(history) else 0.0
        span = history_cells.span_s(seconds)
        envelope = (
            history_cells.envelope(history, settings.column, span, columns * self.glyphs.columns)
            if len(history)
            else None
        )
        extent = history_cells.extent(envelope, settings.scale, settings.limit) if envelope is not None else None
        head = self._head(settings, history, None if axis else span, width)
        tail = [self._time_axis(history, span, width)] if axis else []
        if envelope is None or extent is None:
            return [head, *self._empty(settings, rows, width), *tail]
        limits = self._range = raster.keep_range(self._range, *extent)
        return [head, *self._plot(envelope, limits, settings, rows), *tail]

    @property
    def _shades(self) -> bool:
        """Whether the terminal has a colour between its background and its text."""
        return not (self.app.no_color or self.app.native_ansi_color or self.glyphs.name == "ascii")

    def _plot(self, envelope: BiasEnvelope, limits: Limits, settings: BiasPlotSettings, rows: int) -> list[Line]:
        limit, shades = settings.limit, self._shades and settings.banded
        levels = [] if not settings.banded else [0.0] if limit is None else [0.0, limit, -limit]
        made = history_cells.cells(envelope, limits, levels, rows, self.glyphs, shades=shades)
        labels = history_cells.labels(limits, limit, rows)
        return [
            [(self.glyphs.text(label), "axis"), *((said, _name(*look)) for said, look in parts)]
            for label, parts in zip(labels, made.parts(), strict=True)
        ]

    def style_of(self, name: str) -> Style:
        """The look of a style's name; over the band if it ends in "shaded", half a cell of the band if it is that."""
        band = self.get_component_rich_style("biasplot--band").bgcolor
        kind, _, shaded = name.partition(" ")
        if kind == "band":
            return super().style_of("axis") + Style(color=band)
        return super().style_of(kind) + Style(bgcolor=band) if shaded else super().style_of(kind)

    def _head(self, settings: BiasPlotSettings, history: EstimateHistory, span: float | None, width: int) -> Line:
        ends = (history_cells.duration(part) for part in (0.0, span or 0.0))
        axis = "" if span is None else " to ".join(ends)
        limits = "no limits known" if settings.limit is None else "scale: limits"
        scale = {"auto": "", "whole run": "scale: whole run", "limits": limits}[settings.scale]
        left = f"{'─>' if settings.chosen else '──'} {settings.name}, {settings.unit} "
        band = "" if not settings.banded else "± 3 sd shaded" if self._shades else "± 3 sd edged"
        parts = ((settings.hint, band, scale, axis), (settings.hint, scale, axis), (scale, axis))
        rights = [", ".join(part for part in right if part) for right in (*parts, (axis,), ())]
        style = "chosen" if settings.chosen else "title"
        return [(raster.titled(left, rights, width, self.glyphs), style)]

    def _empty(self, settings: BiasPlotSettings, rows: int, width: int) -> list[Line]:
        why = f"{settings.unseen}: there is no estimate" if settings.unseen else "no estimate yet"
        said = [f"{' ' * (GUTTER - 1)}│ {why if row == rows // 2 else ''}" for row in range(rows)]
        return [[(self.glyphs.text(line)[:width].ljust(width), "axis")] for line in said]

    def _time_axis(self, history: EstimateHistory, span: float, width: int) -> Line:
        """Round times since the run's first sample."""
        room, line, free = width - GUTTER, [" "] * width, 0
        for t in history_cells.ticks(span, room // _TICK):
            label = history_cells.duration(t)
            start = GUTTER + round(t / span * (room - 1)) - len(label) // 2
            start = min(start, width - len(label))
            if start >= free:
                line[start : start + len(label)] = label
                free = start + len(label) + 1
        return [("".join(line), "axis")]


def _name(kind: int, shaded: bool) -> str:
    return f"{_STYLES[kind]} shaded" if shaded else _STYLES[kind]
