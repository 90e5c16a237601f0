"""What the searches for faults of data share: the record of a fault, one channel's readings, stretches in words."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from filters.effects import quantisation
from filters.types import Array

Flags = NDArray[np.bool_]

FALSE = 1e-3  # false faults expected in a run
DEAD = "dead: "  # how the words on a channel begin that never changes
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


def over_pieces(found: Sequence[Sequence[DataFault]]) -> list[DataFault]:
    """Faults of a run that was looked at piece after piece.

    Those of a channel and a kind are one; of limits, of one limit. Steps of readings and errors of stamps are those of
    the run only if most pieces have them, as each piece by itself would say.
    """
    alike: dict[tuple[str, tuple[str, ...], float], list[DataFault]] = {}
    for fault in itertools.chain(*found):
        limit = fault.size or 0.0 if fault.effect == "saturation" else 0.0
        alike.setdefault((fault.effect, fault.channels, limit), []).append(fault)
    of_all = ("coarse", "jitter")
    return [_one(same) for (kind, *_), same in alike.items() if kind not in of_all or 2 * len(same) > len(found)]


def _one(same: Sequence[DataFault]) -> DataFault:
    first, count = same[0], sum(fault.count for fault in same)
    sizes = [fault.size for fault in same if fault.size is not None]
    if first.effect in ("stuck", "dropout", "jitter"):
        size = max(sizes, default=None)
    else:
        size = float(np.median(np.repeat(sizes, [fault.count for fault in same]))) if sizes else None
    if len(same) == 1 or first.effect in ("coarse", "jitter"):
        return replace(first, count=count, size=size)
    if all(fault.where.startswith(DEAD) for fault in same):
        # from the first piece's begin to the last one's end
        where = first.where.rsplit(" to ", 1)[0] + " to " + same[-1].where.rsplit(" to ", 1)[1]
        return replace(first, where=where, size=sum(sizes))
    where, rest = "; ".join(fault.where for fault in same[:_SHOWN]), sum(fault.count for fault in same[_SHOWN:])
    return replace(first, count=count, size=size, where=f"{where}; and {rest} more" if rest else where)


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
    of: int  # readings of the whole run, of which these are all or a piece: chance has as many tries


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


def poisson_tail(count: int, mean: float) -> float:
    """Return the chance of `count` events or more where `mean` are expected."""
    if count <= mean or mean <= 0.0:
        return 1.0 if count <= mean else 0.0
    # terms fall off at once above the mean
    last = count + 60 + 10 * math.isqrt(count)
    return math.fsum(math.exp(k * math.log(mean) - mean - math.lgamma(k + 1.0)) for k in range(count, last))


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
