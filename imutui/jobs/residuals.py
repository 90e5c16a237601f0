"""Residuals as curves for figures: over time, their spectrum, their Allan deviation; of a trace, before and after.

Few enough points for a document, in deg/s and mg. A log's own, against its reference, also gives each channel's noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from filters import allan
from filters.channels import CHANNELS, STANDARD_GRAVITY
from filters.errors import InputError
from filters.tracing.result import RunSeries
from filters.tracing.trace_document import ChannelCurvesEntry, CurveEntry, RunCurvesEntry
from filters.types import Array
from imutui.jobs import runs
from imutui.logbook.reading import Reading

_SCALE = np.repeat([180.0 / np.pi, 1e3 / STANDARD_GRAVITY], 3)
_POINTS = 300
_BINS = 100
_LEAST = 64
_DIGITS = 5


def curves(series: Sequence[RunSeries], heldout: str | None) -> list[RunCurvesEntry]:
    """Return the curves of all runs; nothing was fitted to the one named `heldout`."""
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


# ----------------------------------------------------------------------------------------------------- residual noise
# Residual of a log against its reference, with its spectrum and Allan deviation, and the noise of each channel.

_MOST_ROWS = 500_000
_SHORTEST_S = 5.0
_FEWEST = 8
_SURE_SD = 3.0
_MEANS, _LEAST_SPAN_K, _MOST = 100, 1.0, 0.5


@dataclass(frozen=True, slots=True)
class NoiseLevel:
    """Noise of a channel by Allan deviation, SI: white noise, its standard deviation, random walk; 0 where none shows.

    White noise in rad/s or m/s² per √Hz, random walk in rad/s² or m/s³ per √Hz. Where slow errors follow the
    temperature, a walk is not told from what temperature does.
    """

    white: float
    white_sd: float
    walk: float
    follows_temperature: bool = False


@dataclass(frozen=True, slots=True)
class Residual:
    """Of a log."""

    # by channel, before and after alike; empty where there are none
    curves: dict[str, ChannelCurvesEntry] = field(default_factory=dict)
    levels: dict[str, NoiseLevel] = field(default_factory=dict)  # noise by channel, of those whose noise can be told
    why: str = ""  # why there are none, a sentence; empty where there are


def of_log(path: Path, reading: Reading) -> Residual:
    """Residual of a log, its spectrum and Allan deviation by channel, and its noise.

    `reading`: reference and overrides of the session, and the part of it.
    """
    from filters.tracing import residual

    try:
        read = runs.read_run(path, path.stem, reading, _SHORTEST_S)
    except InputError as error:
        return Residual(why=f"{path.name}: the residual and its Allan deviation are left out ({error}).")
    run = read.run
    start, end = (-np.inf if reading.start is None else reading.start), (np.inf if reading.end is None else reading.end)
    use = (run.t >= start) & (run.t <= end)
    first, last = (int(np.argmax(use)), int(use.size - np.argmax(use[::-1]))) if use.any() else (0, run.t.size)
    part = slice(first, last)
    raw = residual.residual(run, part)
    follows = np.zeros(6, bool) if run.temperature is None else follow_temperature(raw, run.temperature[part])
    t, r, period = _thinned(run.t[part], raw, 1.0 / run.rate_hz)
    if t.size < _FEWEST:
        return Residual(why=f"{path.name} is too short for a residual.")
    (entry,) = curves([RunSeries(path.stem, period, t, r, r)], None)
    return Residual(entry["channels"], _levels(r, period, follows))


def _thinned(t: Array, r: Array, period: float) -> tuple[Array, Array, float]:
    """Means over blocks, of so many samples that what is left fits into memory several times over."""
    m = -(-t.size // _MOST_ROWS)
    if m == 1:
        return t, r, period
    n = t.size // m * m
    return t[:n].reshape(-1, m).mean(axis=1), r[:n].reshape(-1, m, 6).mean(axis=1), period * m


def _levels(r: Array, period: float, follows: NDArray[np.bool_]) -> dict[str, NoiseLevel]:
    """Noise of the longest stretch without a gap, by channel; channels that the log lacks are left out."""
    seen = np.asarray(np.isfinite(r).any(axis=0))
    good = np.isfinite(r[:, seen]).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int))).reshape(-1, 2)
    if not len(edges):
        return {}
    first, last = edges[np.argmax(edges[:, 1] - edges[:, 0])]
    try:
        found = allan.noise_of(r[first:last][:, seen], period)
    except InputError:
        return {}
    names = [name for name, s in zip(CHANNELS, seen.tolist(), strict=True) if s]
    walks = np.where(_shows(found, last - first, period), found.drift, 0.0)
    columns = zip(
        names, found.white.tolist(), found.white_sd.tolist(), walks.tolist(), follows[seen].tolist(), strict=True
    )
    return {name: NoiseLevel(white, *rest) for name, white, *rest in columns if white > 0.0}


def follow_temperature(r: Array, temperature: Array) -> NDArray[np.bool_]:
    """Whether a curve in temperature takes most of the power out of slow means of the residual, shape (6,).

    `r`: residual, shape (N, 6), NaN where there is none.
    `temperature`: degC, shape (N,).
    """
    m = max(1, len(r) // _MEANS)
    n = len(r) // m * m
    y = r[:n].reshape(-1, m, 6).mean(axis=1)
    T = temperature[:n].reshape(-1, m).mean(axis=1)
    use = np.isfinite(T)
    if np.count_nonzero(use) < _FEWEST or np.ptp(T[use]) < _LEAST_SPAN_K:
        return np.zeros(6, bool)
    out = np.zeros(6, bool)
    for c in range(6):
        good = use & np.isfinite(y[:, c])
        if np.count_nonzero(good) >= _FEWEST:
            own = y[good, c] - y[good, c].mean()
            curve = np.polynomial.Polynomial.fit(T[good], own, 2)
            out[c] = float(np.sum((own - curve(T[good])) ** 2)) < (1.0 - _MOST) * float(np.sum(own**2))
    return out


def _shows(found: allan.NoiseLevels, count: int, period: float) -> NDArray[np.bool_]:
    """Whether a random walk stands out, at the longest averaging time, from how uncertain the rest is there."""
    factors = allan.octaves(1, count // 4)[-1:]
    tau, dof = float(factors[0]) * period, float(allan.degrees_of_freedom(count, factors)[0])
    rest = found.white**2 / tau + found.instability**2
    return np.asarray(found.drift**2 * tau / 3.0 > _SURE_SD * np.sqrt(2.0 / dof) * rest)
