"""Live plot: one lane a series, each with its own scale, so that nothing hides and colour is not needed."""

from rich.segment import Segment
from textual.strip import Strip
from textual.widget import Widget

from imutui.tui import raster, text
from imutui.tui.glyphs import Glyphs, choose
from imutui.tui.series import Series

_GUTTER = 11
_LANE_STYLES = ("plot--first", "plot--second", "plot--third")


class Plot(Widget):
    """Lanes of one quantity's axes over the last seconds.

    Parameters
    ----------
    title : str
        With the unit.
    names : tuple of str
        One a lane.
    columns : slice
        Of the series, one a lane.
    """

    COMPONENT_CLASSES = {"plot--title", "plot--axis", "plot--first", "plot--second", "plot--third"}  # noqa: RUF012 - Textual's way
    DEFAULT_CSS = """
    Plot { height: 1fr; min-height: 4; }
    Plot > .plot--title { color: $foreground 80%; }
    Plot > .plot--axis { color: $foreground 60%; }
    Plot > .plot--first { color: $text-primary; }
    Plot > .plot--second { color: $text-success; }
    Plot > .plot--third { color: $text-accent; }
    """

    def __init__(
        self,
        title: str,
        names: tuple[str, ...],
        columns: slice,
        glyphs: Glyphs | None = None,
        *,
        id: str | None = None,  # noqa: A002 - Textual's name
    ) -> None:
        super().__init__(id=id)
        self._title = title
        self._names = names
        self._columns = columns
        self._glyphs = glyphs or choose()
        self._ranges: list[tuple[float, float] | None] = [None] * len(names)
        self._series: Series | None = None
        self._span = 30.0
        self._locked = False
        self._frozen = False
        self._strips: list[Strip] | None = None

    def show(self, series: Series, span: float, *, locked: bool = False, frozen: bool = False) -> None:
        """Draw the last `span` seconds of a series; locked keeps the scales."""
        if not locked and self._locked:
            self._ranges = [None] * len(self._names)
        self._series, self._span, self._locked, self._frozen = series, span, locked, frozen
        self._strips = None
        self.refresh()

    def on_resize(self) -> None:
        """Draw anew for another size."""
        self._strips = None

    def render_line(self, y: int) -> Strip:
        """One line of the widget."""
        if self._strips is None:
            self._strips = self._draw(self.size.width, self.size.height)
        return self._strips[y] if y < len(self._strips) else Strip.blank(self.size.width, self.rich_style)

    def _draw(self, width: int, height: int) -> list[Strip]:
        """Title, lanes, and a time axis if a line is left over."""
        lane_rows, left = divmod(max(height - 1, 0), len(self._names))
        if lane_rows < 1 or width <= _GUTTER + 2:
            return []
        strips = []
        outside = []
        for i, name in enumerate(self._names):
            lane, beyond = self._lane(i, lane_rows, width - _GUTTER)
            strips += lane
            outside += [name] * beyond
        axis = [self._time_axis(width)] if left else []
        return [self._head(width, outside), *strips, *axis]

    def _lane(self, index: int, rows: int, width: int) -> tuple[list[Strip], bool]:
        """Strips of one lane, and whether a locked scale leaves something out."""
        glyphs, name = self._glyphs, self._names[index]
        band = self._band(index, width * glyphs.columns)
        extent = band.limits() if band is not None else None
        if band is None or extent is None:
            return [self._strip(label, " " * width, index) for label in self._labels(name, None, rows)], False
        limits = self._ranges[index] if self._locked else None
        if limits is None:
            limits = self._ranges[index] = raster.keep_range(self._ranges[index], *extent)
        lines = raster.cells(raster.dots(band, limits, rows * glyphs.rows), glyphs)
        labels = self._labels(name, limits, rows)
        beyond = extent[0] < limits[0] or extent[1] > limits[1]
        return [self._strip(label, line, index) for label, line in zip(labels, lines, strict=True)], beyond

    def _band(self, index: int, columns: int) -> raster.Envelope | None:
        if self._series is None or not len(self._series):
            return None
        # One column more than the window, so that the oldest one is never half filled.
        t, values = self._series.last(self._span * (1 + 1 / columns))
        return raster.envelope(t, values[:, self._columns][:, index], float(t[-1]), self._span, columns)

    def _labels(self, name: str, limits: tuple[float, float] | None, rows: int) -> list[str]:
        """Gutter of a lane: upper limit, name, lower limit."""
        room = _GUTTER - 2
        if limits is None or rows < 2:
            return [f" {name if row == rows // 2 else '':<{room}}│" for row in range(rows)]
        decimals = raster.label_decimals(limits)
        low, high = (text.number(value, room, decimals) for value in limits)
        labels = [f" {'':<{room}}│"] * rows
        labels[0], labels[-1] = f" {high}┤", f" {low}┤"
        if rows == 2:
            labels[0] = f" {name:<3}{high.strip():>{room - 3}}┤"
        else:
            labels[rows // 2] = f" {name:<{room}}│"
        return labels

    def _strip(self, label: str, line: str, index: int) -> Strip:
        # Every segment has a style: Textual's monochrome filter, under NO_COLOR, fails on one that has none.
        axis = self.get_component_rich_style("plot--axis")
        lane = self.get_component_rich_style(_LANE_STYLES[index % len(_LANE_STYLES)])
        return Strip([Segment(self._glyphs.text(label), axis), Segment(line, lane)], _GUTTER + len(line))

    def _head(self, width: int, outside: list[str]) -> Strip:
        scale = "scale locked" if self._locked else "autoscale"
        beyond = f", {' '.join(outside)} outside" if outside else ""
        left = self._glyphs.text(f"── {self._title} ")
        frozen = " FROZEN," if self._frozen else ""
        right = self._glyphs.text(f"{frozen} last {_duration(self._span)}, {scale}{beyond} ──")
        middle = self._glyphs.text("─") * max(width - len(left) - len(right), 0)
        style = self.get_component_rich_style("plot--title")
        return Strip([Segment((left + middle + right)[:width].ljust(width), style)], width)

    def _time_axis(self, width: int) -> Strip:
        """Times before the newest sample, at the quarters of the window."""
        room = width - _GUTTER
        line = [" "] * width
        for quarter in range(5):
            label = "now" if quarter == 4 else f"-{_duration(self._span * (4 - quarter) / 4)}"
            start = _GUTTER + quarter * (room - 1) // 4
            start = min(max(start - (len(label) // 2 if quarter else 0), 0), width - len(label))
            line[start : start + len(label)] = label
        return Strip([Segment("".join(line), self.get_component_rich_style("plot--axis"))], width)


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:g} s"
    return f"{seconds / 60:g} min" if seconds < 7200 else f"{seconds / 3600:g} h"
