"""What the searches for faults of data share: the record of a fault, one channel's readings, stretches in words."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.effects import quantisation
from filters.types import Array

Flags = NDArray[np.bool_]

FALSE = 1e-3  # false faults expected in a run
_SHOWN = 3


@dataclass(frozen=True, slots=True)
class DataFault:
    """A fault of the data, on one channel, or on all for stamps."""

    effect: str  # "spikes", "stuck", "saturation", "coarse", "dropout" or "jitter"
    channels: tuple[str, ...]  # of gx, gy, gz, ax, ay, az
    # spikes; stretches stuck; readings at the limit; readings on a coarse lattice; gaps; steps between stamps that are
    # off
    count: int
    where: str  # where and what, in words: "12.3 s, 44.1 s and 10 more"
    # median size of the spikes, the limit, or the lattice, in rad/s or m/s²; the longest stretch stuck, the longest
    # gap, or the standard deviation of stamps, in s
    size: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelReadings:
    """One channel of a run, and what its readings are like."""

    name: str
    t: Array
    reading: Array
    error: Array  # reading minus perfect, (N,); the reading itself where that is unknown
    perfect: Array  # (N,) or (1,), NaN where unknown
    lsb: float | None
    lattice: float
    others: tuple[Array, Array]  # readings of the two channels beside it, (N,)
    width: int
    scales: Array  # noise of each window of `width`; of windows in which nothing changes, the median of the others


def noise_scales(error: Array, reading: Array, width: int, order: int = 1) -> Array:
    """Noise of each window; where the reading is stuck all the while, that of the others."""
    scales = quantisation.scales(error, width, order)
    moved = reading[1:] != reading[:-1]
    changed = np.add.reduceat(moved, np.arange(scales.size) * min(width, error.size - 1)) > 0
    return np.where(changed, scales, np.median(scales[changed])) if np.any(changed) else scales


def edges_of_equal(x: Array) -> NDArray[np.intp]:
    """First rows of the runs of equal values, and the end, shape (M + 1,)."""
    differ = np.ones(x.size + 1, np.bool_)
    np.not_equal(x[1:], x[:-1], out=differ[1:-1])
    return np.flatnonzero(differ)


def runs_of(flags: Flags) -> NDArray[np.intp]:
    """First and end of each run of set flags, shape (M, 2)."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    return edges.reshape(-1, 2)


def times_in_words(t: Array) -> str:
    """The first few times, s, and how many more."""
    return _listed([f"{at:.1f} s" for at in t[: _SHOWN + 1]], t.size)


def stretches_in_words(t: Array, runs: NDArray[np.intp]) -> str:
    """The first few stretches, from their first and end rows (M, 2), and how many more."""

    def words(first: int, end: int) -> str:
        return f"{t[first]:.1f} s" if t[end - 1] - t[first] < 0.1 else f"{t[first]:.1f}-{t[end - 1]:.1f} s"

    return _listed([words(int(first), int(end)) for first, end in runs[: _SHOWN + 1]], len(runs))


def _listed(words: list[str], count: int) -> str:
    if count <= _SHOWN:
        return ", ".join(words)
    return f"{', '.join(words[: _SHOWN - 1])} and {count - _SHOWN + 1} more"
