"""A bias and its band over the whole run as dots: pure arithmetic of the band plot."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from imutui.estimate_history import EstimateHistory
from imutui.tui import formatting
from imutui.tui.terminal.glyphs import Glyphs
from imutui.tui.widgets import raster
from imutui.tui.widgets.raster import Bits, Envelope, Limits

GUTTER = 10
SCALES = ("auto", "whole run", "limits")
"""What the scale shows: the settled part, everything, or the data sheet's limits."""
_SHORTEST_S = 60.0
_STEPS = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
_TICKS_S = (
    10.0,
    20.0,
    30.0,
    *(60.0 * m for m in (1, 2, 5, 10, 20, 30)),
    *(3600.0 * h for h in (1, 2, 5, 10, 24, 48, 96)),
)
_UNSETTLED = 0.25
_ROOM = 1.08
_GAP = "gap"
EMPTY, LINE, EDGE, HALF, GAP, ESTIMATE, CONVERGED = range(7)
"""What the sign in a cell shows, later ones over earlier ones."""


@dataclass(frozen=True, slots=True)
class BiasEnvelope:
    """An estimate and its band in dot columns from the run's begin on."""

    # estimate, band: extremes
    estimate: Envelope
    band: Envelope
    converged: Bits  # whether the estimate was converged all through a column, (columns,)
    gaps: tuple[tuple[int, int], ...] = ()  # first and last column of each pause


@dataclass(frozen=True, slots=True)
class Cells:
    """Lines of characters, what the sign of each cell shows, and whether the band is behind it, (rows, columns)."""

    lines: list[str]
    shows: npt.NDArray[np.int64]
    shaded: Bits

    def parts(self) -> list[list[tuple[str, tuple[int, bool]]]]:
        """The lines in parts that look alike: what they show, and whether the band is behind."""
        looks = zip(self.lines, self.shows.tolist(), self.shaded.tolist(), strict=True)
        return [raster.runs(line, zip(shows, shaded, strict=True)) for line, shows, shaded in looks]


def span_s(seconds: float) -> float:
    """Length of the time axis for a run: it grows in steps, so that what is drawn stays where it is."""
    if seconds <= _SHORTEST_S:
        return _SHORTEST_S
    unit = 60.0 if seconds < 3600.0 else 3600.0
    power = 10.0 ** np.floor(np.log10(seconds / unit))
    return float(next(step for step in _STEPS if step * power * unit >= seconds) * power * unit)


def envelope(history: EstimateHistory, column: int, span: float, columns: int) -> BiasEnvelope:
    """Extremes of an estimate in each dot column of a time axis of `span` s; the history has at least one row."""
    t = history.instants()
    width = span / columns
    gaps = tuple((_column(begin, history, width), _column(end, history, width)) for begin, end in history.breaks())
    low, high = history.estimate(column)
    bottom, top = history.band(column)
    known = ~np.isnan(low)
    values = np.column_stack([low, high, bottom, top, history.converged(column)])[known]
    lows, highs = raster.column_extremes(t[known], values, width, 0, columns, np.inf)
    for begin, end in gaps:  # at least one column is left out, so that no line is drawn across
        lows[:, begin + 1 : max(end, begin + 2)] = highs[:, begin + 1 : max(end, begin + 2)] = np.nan
    return BiasEnvelope(Envelope(lows[0], highs[1]), Envelope(lows[2], highs[3]), lows[4] > 0.5, gaps)


def _column(t: float, history: EstimateHistory, width: float) -> int:
    return int(t // width)


def extent(envelope: BiasEnvelope, scale: str, limit: float | None) -> Limits | None:
    """What the axis has to contain; None without an estimate. Without a limit there is no scale of it."""
    if scale == "limits" and limit is not None:
        return -_ROOM * limit, _ROOM * limit
    filled = np.flatnonzero(~np.isnan(envelope.estimate.low))
    if not filled.size:
        return None
    # the first estimates are as uncertain as the bias was before: they would hide all that comes later
    settled = filled[int(_UNSETTLED * filled.size) :] if scale == "auto" else filled
    parts = [Envelope(e.low[settled], e.high[settled]).limits() for e in (envelope.estimate, envelope.band)]
    known = [part for part in parts if part is not None]
    return min(low for low, _ in known), max(high for _, high in known)


def edges(area: Bits) -> Bits:
    """The edges of an area as broken lines."""
    edge = area.copy()
    edge[1:-1] &= ~(area[:-2] & area[2:])
    edge[[0, -1]] = False  # an area that goes on beyond the scale has no edge there
    return np.asarray(edge & (np.indices(area.shape)[1] % 2 == 0))


def level_line(level: float, limits: Limits, rows: int, columns: int) -> Bits:
    """Dots of a broken level line; none outside the limits."""
    bits = np.zeros((rows, columns), bool)
    low, high = limits
    if low <= level <= high:
        bits[round((high - level) * (rows - 1) / (high - low)), ::3] = True
    return bits


def cells(
    envelope: BiasEnvelope, limits: Limits, levels: list[float], rows: int, glyphs: Glyphs, *, shades: bool
) -> Cells:
    """What a plot of so many lines shows: the estimate as a line of dots, its band behind it, broken lines at levels.

    `shades`: whether the terminal can show the band as background; else its edges are drawn.
    """
    dots, columns = rows * glyphs.rows, envelope.estimate.low.size
    estimate = raster.dots(envelope.estimate, limits, dots)
    area = raster.dots(envelope.band, limits, dots)
    line = np.any([level_line(level, limits, dots, columns) for level in levels], axis=0) if levels else area & False
    shows = np.full((rows, columns // glyphs.columns), EMPTY)
    edge = area & False if shades else edges(area)
    settled = estimate & envelope.converged
    for kind, bits in ((LINE, line), (EDGE, edge), (ESTIMATE, estimate), (CONVERGED, settled)):
        shows[raster.cells_of(bits, glyphs)] = kind
    drawn = shows >= ESTIMATE
    if glyphs.name == "braille":
        lines = raster.cells(estimate | ((edge | line) & ~_whole(drawn, glyphs)), glyphs)
    else:
        signs = np.array([" ", glyphs.text("-"), "░" if glyphs.name == "block" else "~"])
        text = raster.cells(estimate, glyphs)
        lines = [
            "".join(sign if kind >= ESTIMATE else str(signs[kind]) for sign, kind in zip(*row, strict=True))
            for row in zip(text, shows, strict=True)
        ]
    made = Cells(lines, shows, np.zeros_like(drawn))
    return _with_gaps(_with_band(made, area, glyphs) if shades else made, envelope.gaps, glyphs)


def _with_band(made: Cells, area: Bits, glyphs: Glyphs) -> Cells:
    """The same with the band behind it; what it covers by half is half a block, if nothing is drawn there."""
    rows = made.shows.shape[0]
    upper, lower = area.reshape(rows, 2, glyphs.rows // 2, -1, glyphs.columns).mean(axis=(2, 4)).swapaxes(0, 1) >= 0.5
    touched = (made.shows >= ESTIMATE) & raster.cells_of(area, glyphs)
    texts = [list(line) for line in made.lines]
    lined = (made.shows == LINE).any(axis=1, keepdims=True)  # halves between the dots of a line would look like it
    for row, column in np.argwhere((upper ^ lower) & (made.shows == EMPTY) & ~lined).tolist():
        texts[row][column] = "▀" if upper[row, column] else "▄"
        made.shows[row, column] = HALF
    return Cells(["".join(text) for text in texts], made.shows, (upper & lower) | (lined & upper) | touched)


def _with_gaps(made: Cells, gaps: tuple[tuple[int, int], ...], glyphs: Glyphs) -> Cells:
    """The same with a dotted line at both ends of each pause, and its name between them where there is room."""
    texts, sign = [list(line) for line in made.lines], "┊" if glyphs.name == "braille" else ":"
    for begin, end in gaps:
        first, last = (min(column // glyphs.columns, made.shows.shape[1] - 1) for column in (begin + 1, end))
        for column in (first, max(first, last)):
            for row in np.flatnonzero(made.shows[:, column] < ESTIMATE).tolist():
                texts[row][column] = sign
                made.shows[row, column] = GAP
        if last - first > len(_GAP) + 1:
            row, start = len(texts) // 2, (first + last + 1 - len(_GAP)) // 2
            texts[row][start : start + len(_GAP)] = _GAP
            made.shows[row, start : start + len(_GAP)] = GAP
    return Cells(["".join(text) for text in texts], made.shows, made.shaded)


def _whole(cells: Bits, glyphs: Glyphs) -> Bits:
    """All dots of some cells."""
    return np.repeat(np.repeat(cells, glyphs.rows, axis=0), glyphs.columns, axis=1)


def ticks(span: float, most: int) -> list[float]:
    """Round instants on a time axis, at most `most` of them."""
    step = next((step for step in _TICKS_S if span / step <= most - 1), span)
    return [k * step for k in range(int(span // step) + 1)]


def duration(seconds: float) -> str:
    """Time on an axis: s below two minutes, then min, then h."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.3g} min" if seconds < 7200.0 else f"{seconds / 3600.0:.3g} h"


def labels(limits: Limits, limit: float | None, rows: int) -> list[str]:
    """Gutter: both ends of the axis, and zero and the data sheet's limits between them, if there are any."""
    room, (low, high) = GUTTER - 2, limits
    decimals = raster.label_decimals(limits)
    made = [f"{'':<{room}} │"] * rows
    named = () if limit is None else ((0.0, "0"), (limit, f"+{limit:g}"), (-limit, f"-{limit:g}"))
    for level, name in named:
        if low <= level <= high and rows > 1:
            made[round((high - level) * (rows - 1) / (high - low))] = f"{name:>{room}} ┤"
    made[0] = f"{formatting.number(high, room, decimals)} ┤"
    if rows > 1:
        made[-1] = f"{formatting.number(low, room, decimals)} ┤"
    return made
