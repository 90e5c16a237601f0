"""Lines whose frequency wanders, by up to a tenth over a run: followed from one stretch to the next.

Spectra of stretches short enough that the frequency hardly moves in one, over the level of each bin, stand one after
the other; the path through them that collects most, from stretch to stretch by two bins at most, is a line if it
collects more than paths through noise do. What stays where it is, is level here: lines that do not wander are
`filters.effects.lines`'. What it leaves out: runs of more than 2^20 samples, where frequencies move too far.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import fft, ndimage
from scipy.signal import windows

from filters.effects import spectra
from filters.types import Array

MOST_SAMPLES = 1 << 20
_BAND = 4.0  # highest over lowest frequency that share a length of stretches
_DRIFT = 12.0  # squared length over (run's length / frequency): two bins in a stretch for a tenth in the run
_SHORTEST_S = 4.0
_STRETCHES = 24
_STEP = 2  # bins from one stretch to the next
_CAP = 12.0  # times the level: no burst is a line
# times the level on average: more than any of 1600 best paths through noise collected, by a half of their spread
_LINE, _LINE_ROOT = 3.0, 5.0  # and this over the root of the number of stretches
_OTHERS = 1.6  # times the level along a path that was found elsewhere
_WANDERS = 4.0  # bins, less is a line that stays
_LEAST = 0.01  # of the frequency
_NEIGHBOURS = 17  # bins of which the level is the median
_GROUP, _GROUPS = 48, 6  # bins of a stretch, at least, of which its own level is the median; levels at most
_SIDE = 3  # bins beside a path that are the line's
_LN2 = float(np.log(2.0))


@dataclass(frozen=True, slots=True)
class Track:
    """Frequency of a line in a run."""

    t: Array  # middle of each stretch, s since the first sample, shape (S,)
    hz: Array  # shape (S,)
    window_s: float  # length of a stretch
    channels: tuple[int, ...]  # in which it was found

    @property
    def low(self) -> float:
        """Lowest frequency, Hz, without the ends' twentieth."""
        return float(np.quantile(self.hz, 0.05))

    @property
    def high(self) -> float:
        """Highest."""
        return float(np.quantile(self.hz, 0.95))


@dataclass(frozen=True, slots=True)
class _Stretches:
    """Spectra of the stretches of one run over their level, shape (channels, S, K), capped."""

    t: Array
    hz: Array
    ratio: NDArray[np.float32]
    window_s: float


def find(fs: float, x: Array, barred: NDArray[np.bool_] | None = None, spacing: float = 1.0) -> list[Track]:
    """Wandering lines of one run.

    `x`: residual, shape (N, C), NaN where there is none.
    `barred`: where none is sought, shape (C, M), bin k at k times `spacing`, Hz.
    `spacing`: see `barred`.
    """
    if x.shape[0] > MOST_SAMPLES:
        return []
    found: list[Track] = []
    low = spectra.LOWEST
    while low < 0.45 * fs:
        high = min(_BAND * low, 0.48 * fs)
        made = _stretches(fs, x, low, high, None)
        if made is not None:
            if barred is not None:
                column = np.minimum(np.round(made.hz / spacing).astype(int), barred.shape[1] - 1)
                made.ratio[barred[:, column][:, None, :].repeat(made.t.size, axis=1)] = 0.0
            found += _tracks(made)
        low = high
    return found


def follow(fs: float, x: Array, low: float, high: float) -> Track | None:
    """The strongest path between two frequencies through what channels, shape (N, C), have in common."""
    made = _stretches(fs, x, low, high, 0.5 * (low + high))
    if made is None:
        return None
    path = _path(made.ratio.sum(axis=0))
    return Track(made.t, _refined(made, path, range(x.shape[1])), made.window_s, tuple(range(x.shape[1])))


def wave(fs: float, x: Array, track: Track, times: int = 1) -> Array:
    """The part of one channel, shape (N,), that goes with a track's frequency, or a multiple of it."""
    t = np.arange(x.size) / fs
    cycles = times * np.cumsum(np.interp(t, track.t, track.hz)) / fs
    good = ~np.isnan(x)
    values = np.where(good, x - np.mean(x[good]), 0.0) if good.any() else np.zeros(x.size)
    size = max(1, round(0.25 * track.window_s * fs))
    weight = np.maximum(_smooth(good.astype(float), size), 1e-3)
    # what the path leaves of the phase moves slowly: its slope mends the frequency
    first = _baseband(values, cycles, size, weight)
    phase = np.unwrap(np.angle(_complex_smooth(first, 2 * size)))
    cycles = cycles + phase / (2.0 * np.pi)
    mended = _baseband(values, cycles, 2 * size, np.maximum(_smooth(good.astype(float), 2 * size), 1e-3))
    return np.asarray(2.0 * (mended * np.exp(2j * np.pi * cycles)).real)


# ----------------------------------------------------------------------------------------------------------- stretches


def _stretches(fs: float, x: Array, low: float, high: float, centre: float | None) -> _Stretches | None:
    """Spectra of half-overlapping stretches between two frequencies; None of too short a run."""
    seconds = x.shape[0] / fs
    window_s = max(_SHORTEST_S, np.sqrt(_DRIFT * seconds / (centre or np.sqrt(low * high))))
    window_s = min(window_s, 2.0 * seconds / (_STRETCHES + 1))
    size = fft.next_fast_len(max(16, round(window_s * fs)), real=True)
    hop = size // 2
    if window_s < _SHORTEST_S or (x.shape[0] - size) // hop + 1 < _STRETCHES:
        return None
    window = windows.hann(size, sym=False).astype(np.float32)
    first, last = int(np.ceil(low * size / fs)), min(int(high * size / fs), size // 2 - 1)
    if last - first < _NEIGHBOURS:
        first, last = max(1, first - _NEIGHBOURS), min(last + _NEIGHBOURS, size // 2 - 1)
    ratios = []
    for column in x.T:
        good = ~np.isnan(column)
        values = np.where(good, column - np.mean(column[good]), 0.0) if good.any() else np.zeros(column.size)
        parts = sliding_window_view(values.astype(np.float32), size)[::hop]
        power = np.abs(fft.rfft(parts * window, axis=1)[:, first : last + 1]) ** 2
        there = sliding_window_view(good, size)[::hop].mean(axis=1) > 0.5
        ratios.append(_over_level(power, there))
    t = (np.arange(len(ratios[0])) * hop + 0.5 * size) / fs
    return _Stretches(t, np.arange(first, last + 1) * fs / size, np.stack(ratios), size / fs)


def _over_level(power: NDArray[np.float32], there: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Power over the level of its bin, and of its stretch, shape (S, K); 0 where there is nothing."""
    out = np.zeros_like(power)
    if np.count_nonzero(there) < _STRETCHES // 2:
        return out
    own = power[there]
    level = np.median(own, axis=0) / _LN2
    level = np.maximum(level, ndimage.median_filter(level, _NEIGHBOURS, mode="nearest"))
    own = own / np.maximum(level, np.finfo(np.float32).tiny)
    # noise may change its colour from stretch to stretch, as that of a measured attitude does between rest and motion
    groups = np.array_split(np.arange(own.shape[1]), min(_GROUPS, max(1, own.shape[1] // _GROUP)))
    centres = [float(group.mean()) for group in groups]
    levels = np.stack([np.median(own[:, group], axis=1) for group in groups], axis=1) / _LN2
    place = np.interp(np.arange(own.shape[1]), centres, np.arange(len(groups)))
    left = place.astype(int)
    right = np.minimum(left + 1, len(groups) - 1)
    local = levels[:, left] + (place - left) * (levels[:, right] - levels[:, left])
    out[there] = np.minimum(own / np.maximum(local, 1e-6), _CAP)
    return out


# --------------------------------------------------------------------------------------------------------------- paths


def _tracks(made: _Stretches) -> list[Track]:
    """Paths that wander, the strongest first; one for all channels that have it."""
    out: list[Track] = []
    free = list(range(made.ratio.shape[0]))
    while free:
        paths = [_path(made.ratio[c]) for c in free]
        means = [float(made.ratio[c][np.arange(p.size), p].mean()) for c, p in zip(free, paths, strict=True)]
        best = int(np.argmax(means))
        if means[best] < _LINE + _LINE_ROOT / np.sqrt(made.t.size):
            break
        path = paths[best]
        along = np.stack([made.ratio[c][np.arange(path.size), path] for c in range(made.ratio.shape[0])])
        channels = tuple(c for c in range(len(along)) if c == free[best] or float(along[c].mean()) > _OTHERS)
        track = Track(made.t, _refined(made, path, channels), made.window_s, channels)
        near = np.abs(np.arange(made.hz.size) - path[:, None]) <= _SIDE
        for c in channels:
            made.ratio[c][near] = 0.0
        bin_hz = float(made.hz[1] - made.hz[0])
        if track.high - track.low > max(_WANDERS * bin_hz, _LEAST * track.low):
            out.append(track)
        elif not near.any():
            break
    return out


def _path(ratio: NDArray[np.float32]) -> NDArray[np.int_]:
    """Bins of the path that collects most, shape (S,)."""
    stretches, bins = ratio.shape
    came = np.zeros((stretches, bins), np.int64)
    total = ratio[0].astype(float)
    shifts = np.arange(-_STEP, _STEP + 1)
    at = np.arange(bins)
    for s in range(1, stretches):
        padded = np.pad(total, _STEP, constant_values=-np.inf)
        choices = np.stack([padded[_STEP + d : _STEP + d + bins] for d in shifts])
        best = np.argmax(choices, axis=0)
        came[s] = at + shifts[best]
        total = choices[best, at] + ratio[s]
    path = np.empty(stretches, np.int64)
    path[-1] = int(np.argmax(total))
    for s in range(stretches - 1, 0, -1):
        path[s - 1] = came[s, path[s]]
    return path


def _refined(made: _Stretches, path: NDArray[np.int_], channels: Sequence[int]) -> Array:
    """Frequencies of a path: the centre of what stands above the level around it."""
    power = np.sum([made.ratio[c] for c in channels], axis=0)
    reach = np.arange(-1, 2)
    columns = np.clip(path[:, None] + reach, 0, made.hz.size - 1)
    weights = np.maximum(np.take_along_axis(power, columns, axis=1) - len(channels), 1e-3)
    hz = np.sum(weights * made.hz[columns], axis=1) / weights.sum(axis=1)
    return np.asarray(hz, float)


# ------------------------------------------------------------------------------------------------------------ baseband


def _baseband(values: Array, cycles: Array, size: int, weight: Array) -> NDArray[np.complex128]:
    return np.asarray(_complex_smooth(values * np.exp(-2j * np.pi * cycles), size) / weight)


def _complex_smooth(z: NDArray[np.complex128], size: int) -> NDArray[np.complex128]:
    return np.asarray(_smooth(z.real, size) + 1j * _smooth(z.imag, size))


def _smooth(x: Array, size: int) -> Array:
    """Two running means, one after the other, of what is zero outside; divided by that of weights it is a mean."""
    once = ndimage.uniform_filter1d(x, size, mode="constant")
    return np.asarray(ndimage.uniform_filter1d(once, size, mode="constant"))
