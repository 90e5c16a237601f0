"""Live plot: one lane a series, each with its own scale, so that nothing hides and colour is not needed."""

from itertools import pairwise, repeat
from typing import NamedTuple

from rich.segment import Segment
from rich.style import Style  # noqa: TC002 - an attribute's type
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from imutui.tui import formatting
from imutui.tui.connection.packet_series import PacketSeries
from imutui.tui.terminal.glyphs import Glyphs, choose
from imutui.tui.terminal.pacing import NUMBERS, SCROLL, SWEEP
from imutui.tui.widgets import raster
from imutui.tui.widgets.plot_lanes import Frame, PlotLanes, Range

_NUMBER = 7
_GUTTER = _NUMBER + 5
_TALL = 5
_AXIS = "plot--axis"
_TITLE = "plot--title"
_MEAN = "plot--mean"
_LANE_STYLES = ("plot--first", "plot--second", "plot--third")


class _Line(NamedTuple):
    """Gutter and cells of a line, the style of the cells, and at which cells the running mean begins and ends."""

    gutter: str
    cells: str
    style: str
    mean: tuple[int, ...] = ()


class Plot(Widget):
    """Lanes of one quantity's axes over the last seconds.

    `title`: with the unit.
    `names`: one a lane.
    `columns`: of the series, one a lane.
    """

    COMPONENT_CLASSES = {_TITLE, _AXIS, _MEAN, *_LANE_STYLES}  # noqa: RUF012 - Textual's way
    DEFAULT_CSS = """
    Plot { height: 1fr; min-height: 4; }
    Plot > .plot--title { color: $foreground 80%; }
    Plot > .plot--axis { color: $foreground 60%; }
    Plot > .plot--mean { color: $foreground; text-style: bold; }
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
        self._glyphs = glyphs or choose()
        self.choose(title, names, columns)
        self._series: PacketSeries | None = None
        self._span = 30.0
        self._mode, self._note = SCROLL, ""
        self._locked = False
        self._frozen = False
        self._lines: list[_Line] = []
        self._strips: list[Strip] = []
        self._styles: dict[str, Style] = {}

    def choose(self, title: str, names: tuple[str, ...], columns: slice) -> None:
        """Take other columns; they are drawn with the next `show`."""
        self._title, self._names = title, names
        self._lanes = PlotLanes(columns, len(names), self._glyphs)

    def show(
        self,
        series: PacketSeries,
        span: float,
        *,
        mode: str = SCROLL,
        note: str = "",
        locked: bool = False,
        frozen: bool = False,
    ) -> None:
        """Draw the last `span` seconds of a series; only lines that changed are drawn anew.

        `series`: the data.
        `span`: s.
        `mode`: "scroll", "sweep", or "numbers" for no plot.
        `note`: why it is this mode, for the title.
        `locked`: whether the scales stay.
        `frozen`: whether the view stands still.
        """
        if not locked and self._locked:
            self._lanes.follow_scales()
        self._series, self._span, self._mode, self._note = series, span, mode, note
        self._locked, self._frozen = locked, frozen
        self._redraw()

    def on_resize(self) -> None:
        """Draw anew for another size."""
        self._redraw()

    def notify_style_update(self) -> None:
        """Take the colours of another theme."""
        super().notify_style_update()
        self._styles, self._lines, self._strips = {}, [], []

    def render_line(self, y: int) -> Strip:
        """One line of the widget."""
        if not self._strips:
            self._make()
        return self._strips[y] if y < len(self._strips) else Strip.blank(self.size.width, self.rich_style)

    def _redraw(self) -> None:
        if not self.size or not self.display:
            return
        changed = self._make()
        if len(changed) == len(self._strips):
            self.refresh()
        elif changed:
            self.refresh(*(Region(0, y, self.size.width, 1) for y in changed))

    def _make(self) -> list[int]:
        """Make the strips of lines that read otherwise than before; returns which."""
        if not self._styles:
            names = (_TITLE, _AXIS, _MEAN, *_LANE_STYLES)
            self._styles = {name: self.get_component_rich_style(name) for name in names}
        lines = self._drawn(self.size.width, self.size.height)
        if len(lines) != len(self._lines):
            self._lines, self._strips = [], []
        changed = [y for y, line in enumerate(lines) if y >= len(self._lines) or line != self._lines[y]]
        self._strips = [*self._strips, *(Strip([]) for _ in lines[len(self._strips) :])]
        for y in changed:
            self._strips[y] = self._strip(lines[y])
        self._lines = lines
        return changed

    def _strip(self, line: _Line) -> Strip:
        # Every segment has a style: Textual's monochrome filter, under NO_COLOR, fails on one that has none.
        parts = [Segment(line.gutter, self._styles[_AXIS])]
        styles = self._styles[line.style], self._styles[_MEAN]
        for i, (begin, end) in enumerate(pairwise((0, *line.mean, len(line.cells)))):
            parts.append(Segment(line.cells[begin:end], styles[i % 2]))
        return Strip([part for part in parts if part.text], len(line.gutter) + len(line.cells))

    def _drawn(self, width: int, height: int) -> list[_Line]:
        """Title, lanes, and a time axis if a line is left over."""
        rows, left = divmod(max(height - 1, 0), len(self._names))
        if len(self._names) == 1 and rows > _TALL:  # a lane that is alone can spare the line
            rows, left = rows - 1, 1
        gutter = self._gutter(rows)
        if rows < 1 or width <= gutter + 2:
            return []
        if self._mode == NUMBERS:
            return self._without(width, height)
        frame = Frame(self._span, width - gutter, rows)
        if self._series is None:
            lanes = [[" " * frame.cells] * rows] * len(self._names)
        else:
            lanes = self._lanes.update(self._series, frame, sweep=self._mode == SWEEP, locked=self._locked)
        means = self._means(rows)
        drawn = []
        for i, name in enumerate(self._names):
            labels = self._labels(name, self._lanes.ranges[i], rows, gutter)
            style = _LANE_STYLES[i % len(_LANE_STYLES)]
            texts = [self._glyphs.text(label) for label in labels]
            drawn += [_Line(*line) for line in zip(texts, lanes[i], repeat(style), means, strict=False)]
        axis = [_Line("", self._time_axis(width, gutter), _AXIS)] if left else []
        blank = [_Line("", " " * width, _AXIS)] * (left - len(axis))
        return [_Line("", self._head(width), _TITLE), *drawn, *axis, *blank]

    def _means(self, rows: int) -> list[tuple[int, ...]]:
        """Where the mean has a colour of its own: in a lane that is alone. In several it is told by its dots alone."""
        runs = self._lanes.mean_runs(0, sweep=self._mode == SWEEP) if len(self._names) == 1 else []
        return runs or [()] * rows

    def _without(self, width: int, height: int) -> list[_Line]:
        """Only the title: numbers are enough."""
        empty = _Line("", " " * width, _AXIS)
        return [_Line("", self._head(width), _TITLE), *[empty] * (height - 1)]

    def _gutter(self, rows: int) -> int:
        """Width of names and limits: in one row both limits stand beside the name."""
        return _GUTTER if rows > 1 else max(len(name) for name in self._names) + 2 * _NUMBER + 4

    def _labels(self, name: str, limits: Range | None, rows: int, gutter: int) -> list[str]:
        """Gutter of a lane: upper limit, name, lower limit; in a tall one the value in the middle as well."""
        room = gutter - 2
        if limits is None:
            return [f" {name if row == rows // 2 else '':<{room}}│" for row in range(rows)]
        decimals = raster.label_decimals(limits)
        low, high = (formatting.number(value, _NUMBER, decimals) for value in limits)
        if rows == 1:
            return [f" {name:<{room - 2 * _NUMBER - 2}} {low} {high}│"]
        labels = [f" {'':<{room}}│"] * rows
        labels[0], labels[-1] = f" {high:>{room}}┤", f" {low:>{room}}┤"
        if rows == 2:
            labels[0] = f" {name:<3}{high.strip():>{room - 3}}┤"
        elif rows >= _TALL and rows % 2:
            middle = formatting.number(sum(limits) / 2, _NUMBER, decimals + 1)
            labels[rows // 2] = f" {name:<3}{middle.strip():>{room - 3}}┤"
        else:
            labels[rows // 2] = f" {name:<{room}}│"
        return labels

    def _head(self, width: int) -> str:
        """Title at the left; span, mode and scale at the right, shorter where there is no room."""
        left = self._glyphs.text(f"── {self._title} ")
        for right in self._said():
            right = self._glyphs.text(f" {right} ──")
            if len(left) + len(right) <= width:
                break
        return (left + self._glyphs.text("─") * (width - len(left) - len(right)) + right)[:width].ljust(width)

    def _said(self) -> list[str]:
        """What the title says of the plot, from long to short."""
        frozen = ["FROZEN"] if self._frozen else []
        if self._mode == NUMBERS:
            return [", ".join([*frozen, f"no plot: {self._note or 'numbers only'}"]), "no plot"]
        names = " ".join(name for name, out in zip(self._names, self._lanes.outside, strict=True) if out)
        scale = ["scale locked" if self._locked else "autoscale", *([f"{names} outside"] if names else [])]
        span = f"last {_duration(self._span)}"
        modes = [f"{self._mode}: {self._note}"] if self._note else []
        return [", ".join([*frozen, span, mode, *scale]) for mode in (*modes, self._mode)]

    def _time_axis(self, width: int, gutter: int) -> str:
        """Quarters of the window: times before the newest sample, or places of the sweep."""
        room = width - gutter
        line = [" "] * width
        for quarter in range(5):
            label = self._time(quarter)
            start = gutter + quarter * (room - 1) // 4
            start = min(max(start - (len(label) // 2 if quarter else 0), 0), width - len(label))
            line[start : start + len(label)] = label
        return "".join(line)

    def _time(self, quarter: int) -> str:
        if self._mode == SWEEP:
            return _duration(self._span * quarter / 4)
        return "now" if quarter == 4 else f"-{_duration(self._span * (4 - quarter) / 4)}"


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:g} s"
    return f"{seconds / 60:g} min" if seconds < 7200 else f"{seconds / 3600:g} h"
