"""Residuals of a trace as curves for figures: over time, their spectrum, their Allan deviation, before and after.

Few enough points for a document, in deg/s and mg.
"""

from collections.abc import Sequence

import numpy as np
from scipy import signal

from filters import allan
from filters.channels import CHANNELS, STANDARD_GRAVITY
from filters.tracing.result import RunSeries
from filters.tracing.trace_document import ChannelCurvesEntry, CurveEntry, RunCurvesEntry
from filters.types import Array

_SCALE = np.repeat([180.0 / np.pi, 1e3 / STANDARD_GRAVITY], 3)
_POINTS = 300
_BINS = 100
_LEAST = 64
_DIGITS = 5


def curves(series: Sequence[RunSeries], heldout: str | None) -> list[RunCurvesEntry]:
    """Curves of all runs.

    `series`: residuals, as a trace gives them.
    `heldout`: name of the run that nothing was fitted to.
    """
    return [
        {
            "run": run.run,
            "heldout": run.run == heldout,
            "channels": {name: _channel(run, c) for c, name in enumerate(CHANNELS)},
        }
        for run in series
    ]


def _channel(run: RunSeries, c: int) -> ChannelCurvesEntry:
    both = np.column_stack([run.before[:, c], run.after[:, c]]) * _SCALE[c]
    good = np.isfinite(both).all(axis=1)
    if not good.any():
        nothing: CurveEntry = {"x": [], "before": [], "after": []}
        return {"residual": nothing, "spectrum": nothing, "allan": nothing, "bridged": False}
    whole = _bridged(both, good)
    return {
        "residual": _residual(run.t, both, good),
        "spectrum": _spectrum(whole, run.period),
        "allan": _entry(*allan.deviation(whole, run.period)),
        "bridged": not bool(good[np.argmax(good) : good.size - np.argmax(good[::-1])].all()),
    }


def _residual(t: Array, both: Array, good: Array) -> CurveEntry:
    """Means over a few hundred cells, each curve without its own mean (the bias), or else noise hides the rest.

    Cells begin where a stretch of readings begins and end where it ends: a mean over a cell that is filled in part
    only, at the edge of a dwell, is noisier than its neighbours, and would look like an effect.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int))).reshape(-1, 2)
    lengths = edges[:, 1] - edges[:, 0]
    size = min(max(1, t.size // _POINTS), int(lengths.max()))
    rows: list[Array] = []
    for first, last in edges[2 * lengths >= size]:
        cells = np.array_split(np.arange(first, last), max(1, round((last - first) / size)))
        if rows:
            rows.append(np.array([float(t[first]), np.nan, np.nan]))
        rows += [np.concatenate([[t[cell].mean()], both[cell].mean(axis=0)]) for cell in cells]
    table = np.array(rows)
    return _entry(table[:, 0], table[:, 1:] - np.nanmean(table[:, 1:], axis=0))


def _spectrum(whole: Array, period: float) -> CurveEntry:
    """Amplitude density (Welch), means over bins of equal ratio where there are many frequencies."""
    length = min(len(whole), max(_LEAST, 1 << int(np.log2(max(_LEAST, len(whole) // 8)))))
    hz, power = signal.welch(whole, 1.0 / period, nperseg=length, axis=0)
    hz, power = hz[1:], power[1:]
    if not hz.size:
        return {"x": [], "before": [], "after": []}
    edges = np.geomspace(hz[0], hz[-1] * 1.000001, _BINS + 1)
    starts = np.unique(np.searchsorted(hz, edges[:-1]))
    starts = starts[starts < hz.size]
    counts = np.diff(np.append(starts, hz.size))
    return _entry(
        np.add.reduceat(hz, starts) / counts, np.sqrt(np.add.reduceat(power, starts, axis=0) / counts[:, None])
    )


def _bridged(both: Array, good: Array) -> Array:
    """Columns without gaps: straight lines over what has no weight, less the mean."""
    k = np.arange(len(both))
    filled = np.stack([np.interp(k, k[good], column[good]) for column in both.T], axis=1)
    return np.asarray(filled - filled.mean(axis=0))


def _entry(x: Array, both: Array) -> CurveEntry:
    return {
        "x": [float(f"{value:.{_DIGITS + 2}g}") for value in x],
        "before": _rounded(both[:, 0]),
        "after": _rounded(both[:, 1]),
    }


def _rounded(values: Array) -> list[float | None]:
    return [float(f"{value:.{_DIGITS}g}") for value in values]
