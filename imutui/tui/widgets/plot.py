"""Live plot: one lane a series, each with its own scale, so that nothing hides and colour is not needed."""

from imutui.tui import formatting
from imutui.tui.connection.packet_series import PacketSeries
from imutui.tui.terminal.glyphs import Glyphs
from imutui.tui.terminal.pacing import NUMBERS, SCROLL, SWEEP
from imutui.tui.widgets import raster
from imutui.tui.widgets.plot_lanes import Frame, PlotLanes
from imutui.tui.widgets.plot_widget import PlotWidget
from imutui.tui.widgets.raster import Limits, Line

_NUMBER = 7
_GUTTER = _NUMBER + 5
_TALL = 5
_AXIS, _TITLE, _MEAN = "axis", "title", "mean"
_LANE_STYLES = ("first", "second", "third")


class Plot(PlotWidget):
    """Lanes of one quantity's axes over the last seconds."""

    PREFIX = "plot"
    COMPONENT_CLASSES = {f"plot--{name}" for name in (_TITLE, _AXIS, _MEAN, *_LANE_STYLES)}  # noqa: RUF012 - Textual's way
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
        super().__init__(glyphs, id=id)
        self.choose(title, names, columns)
        self._series: PacketSeries | None = None
        self._span = 30.0
        self._mode, self._note = SCROLL, ""
        self._locked = False
        self._frozen = False

    def choose(self, title: str, names: tuple[str, ...], columns: slice) -> None:
        """Take other columns; they are drawn with the next `show`."""
        self._title, self._names = title, names
        self._lanes = PlotLanes(columns, len(names), self.glyphs)

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

        `mode`, `note`: "scroll", "sweep", or "numbers" for no plot; why it is that, for the title.
        `locked`, `frozen`: whether the scales stay; whether the view stands still.
        """
        if not locked and self._locked:
            self._lanes.follow_scales()
        self._series, self._span, self._mode, self._note = series, span, mode, note
        self._locked, self._frozen = locked, frozen
        self.redraw()

    def drawn(self, width: int, height: int) -> list[Line]:
        rows, left = divmod(max(height - 1, 0), len(self._names))
        if len(self._names) == 1 and rows > _TALL:  # a lane that is alone can spare the line
            rows, left = rows - 1, 1
        gutter = self._gutter(rows)
        if rows < 1 or width <= gutter + 2:
            return []
        head: Line = [(self._head(width), _TITLE)]
        if self._mode == NUMBERS:
            return [head, *[[(" " * width, _AXIS)]] * (height - 1)]
        frame = Frame(self._span, width - gutter, rows)
        if self._series is None:
            lanes = [[" " * frame.cells] * rows] * len(self._names)
        else:
            lanes = self._lanes.update(self._series, frame, sweep=self._mode == SWEEP, locked=self._locked)
        drawn = [head]
        for i, name in enumerate(self._names):
            labels = self._labels(name, self._lanes.ranges[i], rows, gutter)
            style = _LANE_STYLES[i % len(_LANE_STYLES)]
            drawn += [
                [(self.glyphs.text(label), _AXIS), *cells]
                for label, cells in zip(labels, self._cells(lanes[i], style), strict=True)
            ]
        if left:
            drawn.append([(self._time_axis(width, gutter), _AXIS)])
        return [*drawn, *[[(" " * width, _AXIS)]] * (left - 1)]

    def _cells(self, lane: list[str], style: str) -> list[Line]:
        """A lane's lines. The mean has a style of its own where the lane is alone; in several, its dots tell it."""
        means = self._lanes.in_mean(0, sweep=self._mode == SWEEP) if len(self._names) == 1 else []
        if not means:
            return [[(line, style)] for line in lane]
        return [
            [(text, _MEAN if mean else style) for text, mean in raster.runs(line, row)]
            for line, row in zip(lane, means, strict=True)
        ]

    def _gutter(self, rows: int) -> int:
        """Width of names and limits: in one row both limits stand beside the name."""
        return _GUTTER if rows > 1 else max(len(name) for name in self._names) + 2 * _NUMBER + 4

    def _labels(self, name: str, limits: Limits | None, rows: int, gutter: int) -> list[str]:
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
        return raster.titled(f"── {self._title} ", self._said(), width, self.glyphs)

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
