"""Figures of curves over two axes, linear or logarithmic, as lines of characters. Pure functions.

Data are drawn solid, what they are compared with dotted, so that both are told apart without colour.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from imutui.report.axes import log_ticks, number_text
from imutui.tui import formatting
from imutui.tui.terminal.glyphs import Glyphs
from imutui.tui.widgets import raster
from imutui.tui.widgets.raster import Bits, Envelope, Floats, Line

GUTTER = 10
BLANK, DATA, COMPARED, CURSOR = "blank", "data", "compared", "cursor"

_DOTTED = 3
_ROWS_OF_NUMBER = 3
_AXIS_LINES = 1
_CELLS_OF_NUMBER = 8
_SLACK = 1e-9


@dataclass(frozen=True, slots=True)
class Axis:
    """Range of an axis; both ends positive if it is logarithmic."""

    low: float
    high: float
    log: bool

    def place(self, values: Floats | float) -> Floats:
        """Where values lie: 0 at the low end, 1 at the high one."""
        low, high = self._scaled(self.low), self._scaled(self.high)
        return np.asarray((self._scaled(values) - low) / (high - low), float)

    def _scaled(self, values: Floats | float) -> Floats:
        return np.asarray(np.log10(values) if self.log else values, float)

    def ticks(self, most: int) -> list[tuple[float, str]]:
        """Places of numbers in the range, and the numbers."""
        if self.log:
            found = [
                value for value in log_ticks(self.low, self.high) if self.low / 1.001 <= value <= self.high * 1.001
            ]
            return [(float(self.place(value)), number_text(value)) for value in found]
        step = _round_step((self.high - self.low) / max(most, 1))
        first = int(np.ceil(self.low / step - _SLACK))
        decimals = max(0, -int(np.floor(np.log10(step))))
        values = [k * step for k in range(first, int(np.floor(self.high / step + _SLACK)) + 1)]
        return [(float(self.place(value)), formatting.number(value, 0, decimals)) for value in values]


def log_axis(low: float, high: float) -> Axis:
    """A logarithmic axis between round numbers around both values."""
    return Axis(_round_down(low), _round_step(high * (1.0 - _SLACK)), log=True)


@dataclass(frozen=True, slots=True)
class Curve:
    """Points with increasing x; `low` and `high` are equal but for error bars and peaks.

    `solid` is for data, and what is not `joined` stands apart.
    """

    x: Floats
    low: Floats
    high: Floats
    solid: bool = True
    joined: bool = True


@dataclass(frozen=True, slots=True)
class Figure:
    """What is drawn."""

    # x, y: both axes; `x_unit` stands at the end of the x axis
    x: Axis
    y: Axis
    x_unit: str
    curves: tuple[Curve, ...] = ()  # data and what they are compared with
    bars: Floats | None = None  # heights of bars of equal width all over the x axis, instead of data
    cursor: float | None = None  # x that is read


def draw(figure: Figure, width: int, height: int, glyphs: Glyphs) -> list[Line]:
    """Lines of a figure in parts of the kinds above, in a size; the last one has the numbers of the x axis."""
    rows, cells = height - _AXIS_LINES, width - GUTTER
    if rows < 2 or cells < 10:
        return [[(" " * width, BLANK)]] * max(height, 0)
    columns = cells * glyphs.columns
    solid, dotted = _dots(figure, columns, rows * glyphs.rows)
    if figure.bars is not None:
        found, over = raster.codes_with_line(solid, dotted, glyphs), raster.cells_of(dotted, glyphs)
        kinds = np.where(over, COMPARED, np.where(raster.cells_of(solid, glyphs), DATA, BLANK))
    else:
        dotted &= (np.arange(columns) // glyphs.columns * glyphs.columns % _DOTTED == 0)[None, :]
        found, over = raster.codes(solid | dotted, glyphs), raster.cells_of(solid, glyphs)
        kinds = np.where(over, DATA, np.where(raster.cells_of(dotted, glyphs), COMPARED, BLANK))
    if figure.cursor is not None:
        _put_cursor(figure, found, kinds, glyphs)
    labels = _labels(figure.y, rows, glyphs)
    body = [
        [(label, BLANK), *raster.runs(line, kind)]
        for label, line, kind in zip(labels, raster.lines(found), kinds.tolist(), strict=True)
    ]
    return [*body, [(_numbers(figure, cells).ljust(width)[:width], BLANK)]]


def _dots(figure: Figure, columns: int, rows: int) -> tuple[Bits, Bits]:
    solid = dotted = np.zeros((rows, columns), bool)
    if figure.bars is not None:
        index = np.minimum(np.arange(columns) * len(figure.bars) // columns, len(figure.bars) - 1)
        top = np.where(figure.bars[index] > 0.0, figure.y.place(np.maximum(figure.bars[index], 0.0)), np.nan)
        solid = raster.dots(Envelope(np.where(np.isnan(top), np.nan, 0.0), top), (0.0, 1.0), rows)
    for curve in figure.curves:
        bits = raster.dots(_columns(curve, figure, columns), (0.0, 1.0), rows)
        if curve.solid:
            solid = solid | bits
        else:
            dotted = dotted | bits
    return solid, dotted


def _columns(curve: Curve, figure: Figure, columns: int) -> Envelope:
    """Lowest and highest place of a curve in each column; straight between points."""
    at = figure.x.place(curve.x) * columns
    inside = (at >= -_SLACK) & (at <= columns + _SLACK)
    if not inside.any():
        return Envelope(np.full(columns, np.nan), np.full(columns, np.nan))
    at = np.clip(at[inside], 0.0, columns - 0.5)
    places = np.stack([figure.y.place(curve.low[inside]), figure.y.place(curve.high[inside])], axis=1)
    low, high = raster.column_extremes(at, places, 1.0, 0, columns, 0.0)
    if not curve.joined:
        return Envelope(low[0], high[1])
    middle = np.interp(np.arange(columns) + 0.5, at, places.mean(axis=1))
    between = np.isnan(low[0]) & (np.arange(columns) >= int(at[0])) & (np.arange(columns) <= int(at[-1]))
    return Envelope(np.where(between, middle, low[0]), np.where(between, middle, high[1]))


def _put_cursor(figure: Figure, found: raster.Codes, kinds: npt.NDArray[np.str_], glyphs: Glyphs) -> None:
    cells = found.shape[1]
    assert figure.cursor is not None
    at = min(max(int(float(figure.x.place(figure.cursor)) * cells), 0), cells - 1)
    column = found[:, at]
    column[column == raster.SPACE] = ord(glyphs.text("│"))
    kinds[:, at] = CURSOR


def _labels(axis: Axis, rows: int, glyphs: Glyphs) -> list[str]:
    """Numbers of the y axis at their rows, none beside another."""
    room = GUTTER - 2
    labels = [f"{'':{room}} │"] * rows
    spans = []
    for place, text in axis.ticks(max(rows // _ROWS_OF_NUMBER, 2)):
        row = min(int((1.0 - place) * rows), rows - 1)
        if len(text) <= room:
            spans.append((row, row + 1, text))
    for row, _, text in _apart(spans, log=axis.log):
        labels[row] = f"{text:>{room}} ┤"
    return [glyphs.text(label) for label in labels]


def _numbers(figure: Figure, cells: int) -> str:
    """Numbers of the x axis under their places, and its unit."""
    line = [" "] * (GUTTER + cells)
    unit = f" {figure.x_unit}"
    last = GUTTER + cells - len(unit)
    line[last:] = unit
    spans = []
    for place, text in figure.x.ticks(cells // _CELLS_OF_NUMBER):
        start = max(GUTTER + min(int(place * cells), cells - 1) - len(text) // 2, 0)
        if start + len(text) <= last:
            spans.append((start, start + len(text), text))
    for start, end, text in _apart(spans, log=figure.x.log):
        line[start:end] = text
    return "".join(line)


def _apart(spans: list[tuple[int, int, str]], *, log: bool) -> list[tuple[int, int, str]]:
    """Numbers with a space between them at least: all, else powers of ten, else as many as fit."""
    spans = sorted(spans)
    powers = [span for span in spans if span[2].strip("0.").startswith("1")] if log else []
    for wanted in (spans, powers):
        if len(wanted) > 1 and all(after[0] > before[1] for before, after in pairwise(wanted)):
            return wanted
    kept: list[tuple[int, int, str]] = []
    for span in spans:
        if not kept or span[0] > kept[-1][1]:
            kept.append(span)
    return kept


def _round_step(value: float) -> float:
    power = 10.0 ** np.floor(np.log10(max(value, 1e-30)))
    return float(next(step for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1.0 - _SLACK)) * power)


def _round_down(value: float) -> float:
    power = 10.0 ** np.floor(np.log10(value * (1.0 + _SLACK)))
    return float(max(step for step in (1.0, 2.0, 5.0) if step * power <= value * (1.0 + 2.0 * _SLACK)) * power)
