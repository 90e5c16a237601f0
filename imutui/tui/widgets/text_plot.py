"""Plots as lines of styled text, for pages that scroll: curves with or without a band. Pure functions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imutui.estimate_history import EstimateHistory
from imutui.tui.formatting import StyledText
from imutui.tui.terminal.glyphs import Glyphs
from imutui.tui.widgets import history_cells, raster
from imutui.tui.widgets.history_cells import GUTTER, BiasEnvelope, Cells
from imutui.tui.widgets.raster import Envelope, Floats, Limits, Line

_SHORTEST_S = 10.0
_QUIET, _SHADE = "$foreground 60%", "on $primary 35%"
_STYLES = {
    history_cells.HALF: "$primary 35%",
    history_cells.ESTIMATE: "$text-warning",
    history_cells.CONVERGED: "bold $text-primary",
}


@dataclass(frozen=True, slots=True)
class PlotLook:
    """What plots are drawn with: characters of a line, signs, and whether a band may be the background's colour."""

    width: int
    glyphs: Glyphs
    shades: bool


def of_history(history: EstimateHistory, column: int, title: str, rows: int, look: PlotLook) -> list[Line]:
    """An estimate of a run with its band over time, in so many lines; under it the time axis."""
    cells = look.width - GUTTER
    # a result is over: its axis ends where it does
    span = max(float(history.newest), _SHORTEST_S) if len(history) else _SHORTEST_S
    columns = cells * look.glyphs.columns
    envelope = history_cells.envelope(history, column, span, columns) if len(history) else _nothing(columns)
    extent = history_cells.extent(envelope, "auto", None)
    ends = history_cells.duration(0.0), history_cells.duration(span)
    return _plot(title, envelope, extent, ends, rows, look)


def of_curve(
    x: Sequence[float], y: Sequence[float | None], title: str, limits: Limits | None, ends: tuple[str, str],
    rows: int, look: PlotLook,
) -> list[Line]:  # fmt: skip
    """A curve over x, which increases; interrupted where it is None.

    `limits`: what the y axis has to contain; None for the curve alone.
    `ends`: what stands at both ends of the x axis.
    """
    columns = (look.width - GUTTER) * look.glyphs.columns
    at, values = np.array(x, float), np.array([np.nan if value is None else value for value in y], float)
    known = np.isfinite(values)
    if not known.any():
        return _plot(title, _nothing(columns), None, ends, rows, look)
    at = at - at[0]
    width = max(float(at[-1]), 1e-9) / (columns - 0.5)
    low, high = raster.column_extremes(at[known], values[known][:, None], width, 0, columns, _step(at, width))
    curve = Envelope(low[0], high[0])
    return _plot(title, _settled(curve, _nothing(columns).band), limits or curve.limits(), ends, rows, look)


def of_band(
    x: Sequence[float], y: Sequence[float], sd: Sequence[float], title: str, ends: tuple[str, str],
    rows: int, look: PlotLook,
) -> list[Line]:  # fmt: skip
    """A curve through knots with three standard deviations around it; parameters as of `of_curve`."""
    columns = (look.width - GUTTER) * look.glyphs.columns
    at = np.linspace(x[0], x[-1], columns)
    middle, half = np.interp(at, x, y), 3.0 * np.interp(at, x, sd)
    band = Envelope(middle - half, middle + half)
    return _plot(title, _settled(Envelope(middle, middle), band), band.limits(), ends, rows, look)


def beside(left: list[Line], right: list[Line], width: int) -> list[Line]:
    """Two blocks side by side, the left one filled up to a width."""
    made = []
    for row in range(max(len(left), len(right))):
        first = left[row] if row < len(left) else []
        room = max(width - sum(len(text) for text, _ in first), 0)
        made.append([*first, (" " * room, ""), *(right[row] if row < len(right) else [])])
    return made


def text(lines: list[Line]) -> StyledText:
    """Lines as parts of a styled text, a line break after each."""
    made: StyledText = []
    for line in lines:
        made += [(said, style) if style else said for said, style in line]
        made.append("\n")
    return made


def _nothing(columns: int) -> BiasEnvelope:
    unknown = np.full(columns, np.nan)
    return BiasEnvelope(Envelope(unknown, unknown), Envelope(unknown, unknown), np.zeros(columns, bool))


def _settled(curve: Envelope, band: Envelope) -> BiasEnvelope:
    return BiasEnvelope(curve, band, np.ones(curve.low.size, bool))


def _step(at: Floats, width: float) -> float:
    return max(2.0 * float(np.median(np.diff(at))) / width, 1.0) if at.size > 1 else 1.0


def _plot(
    title: str, envelope: BiasEnvelope, extent: Limits | None, ends: tuple[str, str], rows: int, look: PlotLook
) -> list[Line]:
    glyphs, width = look.glyphs, look.width
    head = raster.titled(f"── {title} ", (), width, glyphs)
    if extent is None:
        return [[(head, _QUIET)], [("no estimate".rjust(GUTTER + 13).ljust(width), _QUIET)]]
    limits = raster.nice_range(*extent)
    made = history_cells.cells(envelope, limits, [0.0], rows, glyphs, shades=look.shades)
    begin, end = (glyphs.text(label) for label in ends)
    axis = " " * GUTTER + begin + end.rjust(width - GUTTER - len(begin))
    return [[(head, _QUIET)], *_rows(made, limits, glyphs), [(axis[:width].ljust(width), _QUIET)]]


def _rows(made: Cells, limits: Limits, glyphs: Glyphs) -> list[Line]:
    labels = history_cells.labels(limits, None, len(made.lines))
    return [
        [(glyphs.text(label), _QUIET), *((said, _style(*look)) for said, look in parts)]
        for label, parts in zip(labels, made.parts(), strict=True)
    ]


def _style(kind: int, shaded: bool) -> str:
    style = _STYLES.get(kind, _QUIET)
    return f"{style} {_SHADE}" if shaded else style
