"""A bias and its band over the whole run as dots: pure arithmetic of the band plot."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from imutui.estimate_history import EstimateHistory
from imutui.tui.terminal.glyphs import Glyphs
from imutui.tui.widgets import raster
from imutui.tui.widgets.raster import Bits, Envelope

Limits = tuple[float, float]
SCALES = ("auto", "whole run", "Table 1")
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
EMPTY, LINE, BAND, ESTIMATE = 0, 1, 2, 3
"""What a cell shows, later ones over earlier ones."""


@dataclass(frozen=True, slots=True)
class BiasEnvelope:
    """An estimate and its band in dot columns from the run's begin on."""

    estimate: Envelope
    band: Envelope


def span_s(seconds: float) -> float:
    """Length of the time axis for a run: it grows in steps, so that what is drawn stays where it is."""
    if seconds <= _SHORTEST_S:
        return _SHORTEST_S
    unit = 60.0 if seconds < 3600.0 else 3600.0
    power = 10.0 ** np.floor(np.log10(seconds / unit))
    return float(next(step for step in _STEPS if step * power * unit >= seconds) * power * unit)


def envelope(history: EstimateHistory, column: int, span: float, columns: int) -> BiasEnvelope:
    """Extremes of each dot column.

    Parameters
    ----------
    history : EstimateHistory
        With at least one row.
    column : int
        Which estimate.
    span : float
        Length of the time axis, s.
    columns : int
        Dot columns.
    """
    t = history.instants() - history.begin
    end = span - 0.5 * span / columns

    def extremes(low: raster.Floats, high: raster.Floats) -> Envelope:
        known = ~np.isnan(low)
        bottom = raster.envelope(t[known], low[known], end, span, columns).low
        return Envelope(bottom, raster.envelope(t[known], high[known], end, span, columns).high)

    return BiasEnvelope(extremes(*history.estimate(column)), extremes(*history.band(column)))


def extent(envelope: BiasEnvelope, scale: str, limit: float) -> Limits | None:
    """What the axis has to contain; None without an estimate."""
    if scale == "Table 1":
        return -_ROOM * limit, _ROOM * limit
    filled = np.flatnonzero(~np.isnan(envelope.estimate.low))
    if not filled.size:
        return None
    # the first estimates are as uncertain as the bias was before: they would hide all that comes later
    settled = filled[int(_UNSETTLED * filled.size) :] if scale == "auto" else filled
    parts = [Envelope(e.low[settled], e.high[settled]).limits() for e in (envelope.estimate, envelope.band)]
    known = [part for part in parts if part is not None]
    return min(low for low, _ in known), max(high for _, high in known)


def shading(area: Bits) -> Bits:
    """An area as a light pattern, with a broken line at its edges."""
    row, column = np.indices(area.shape)
    inside = (row % 4 == 1) & (column % 4 == 0)
    edge = area.copy()
    edge[1:-1] &= ~(area[:-2] & area[2:])
    edge[[0, -1]] = False  # an area that goes on beyond the scale has no edge there
    return np.asarray((area & inside) | (edge & (column % 2 == 0)))


def level_line(level: float, limits: Limits, rows: int, columns: int) -> Bits:
    """Dots of a broken level line; none outside the limits."""
    bits = np.zeros((rows, columns), bool)
    low, high = limits
    if low <= level <= high:
        bits[round((high - level) * (rows - 1) / (high - low)), ::3] = True
    return bits


def cells(
    envelope: BiasEnvelope, limits: Limits, levels: list[float], rows: int, glyphs: Glyphs
) -> tuple[list[str], npt.NDArray[np.int64]]:
    """Lines of characters, and what each cell shows.

    Parameters
    ----------
    envelope : BiasEnvelope
        In dot columns.
    limits : tuple of float
        Of the axis.
    levels : list of float
        Level lines: zero and the data sheet's limits.
    rows : int
        Lines.
    glyphs : Glyphs
        Signs of the terminal.
    """
    dots, columns = rows * glyphs.rows, envelope.estimate.low.size
    estimate = raster.dots(envelope.estimate, limits, dots)
    area = raster.dots(envelope.band, limits, dots)
    line = np.any([level_line(level, limits, dots, columns) for level in levels], axis=0) if levels else area & False
    shows = np.full((rows, columns // glyphs.columns), EMPTY)
    for kind, bits in ((LINE, line), (BAND, area), (ESTIMATE, estimate)):
        shows[_any(bits, glyphs)] = kind
    if glyphs.name == "braille":
        behind = (shading(area) | line) & ~_whole(shows == ESTIMATE, glyphs)
        return raster.cells(estimate | behind, glyphs), shows
    signs = np.array([" ", glyphs.text("-"), {"block": "░"}.get(glyphs.name, "~"), ""])
    drawn = raster.cells(estimate, glyphs)
    lines = [
        "".join(sign if kind == ESTIMATE else str(signs[kind]) for sign, kind in zip(text, kinds, strict=True))
        for text, kinds in zip(drawn, shows, strict=True)
    ]
    return lines, shows


def _any(bits: Bits, glyphs: Glyphs) -> Bits:
    """Whether a cell has a dot."""
    rows, columns = bits.shape[0] // glyphs.rows, bits.shape[1] // glyphs.columns
    return np.asarray(bits.reshape(rows, glyphs.rows, columns, glyphs.columns).any(axis=(1, 3)))


def _whole(cells: Bits, glyphs: Glyphs) -> Bits:
    """All dots of some cells."""
    return np.repeat(np.repeat(cells, glyphs.rows, axis=0), glyphs.columns, axis=1)


def ticks(begin: float, span: float, most: int) -> list[float]:
    """Round instants on a time axis, at most `most` of them."""
    step = next((step for step in _TICKS_S if span / step <= most - 1), span)
    first, last = int(np.ceil(begin / step)), int(np.floor((begin + span) / step))
    return [k * step for k in range(first, last + 1)]


def duration(seconds: float) -> str:
    """Time on an axis: s below two minutes, then min, then h."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.3g} min" if seconds < 7200.0 else f"{seconds / 3600.0:.3g} h"
