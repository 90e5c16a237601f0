"""Spikes: isolated readings that are off, told from knocks, which ring and are felt along other axes too."""

import numpy as np
from numpy.typing import NDArray

from filters.effects import quantisation
from filters.effects.fault_records import FALSE, ChannelReadings, DataFault, Flags, times_in_words
from filters.types import Array

SPIKE = 7.0  # standard deviations of one reading, from the median of it and its two neighbours
_FELT = 3.0  # standard deviations
NEAR = 8  # readings on each side of a spike that are quiet
_CHANCE_OF_POWERS = 0.05
_AT_ONCE = 1 << 18


def isolated(channel: ChannelReadings) -> tuple[NDArray[np.intp], Array, Array]:
    """Readings that are off by themselves: their numbers, by how much, and the noise there; shape (spikes,) each.

    What counts is the distance of a reading from the median of it and its neighbours. For white noise
    P(∣d∣ > h σ) ≈ 0.034 exp(-h²/3), d that distance; 7 is enough up to half a million readings. Correlated noise has
    less of it.
    """
    count = channel.error.size
    most = max(SPIKE, float(np.sqrt(3.0 * np.log(0.034 * 6.0 * count / FALSE))))
    s = channel.scales
    around = np.maximum(s, np.maximum(np.append(s[1:], 0.0), np.append(0.0, s[:-1])))
    around = np.maximum(around, np.median(s))
    found = []
    for first in range(1, count - 1, _AT_ONCE):
        last = min(first + _AT_ONCE, count - 1)
        off = _off_neighbours(channel.error[first - 1 : last + 1])
        sd = quantisation.spread(around, channel.width, np.arange(first, last))
        rows = np.flatnonzero(off > np.maximum(most * sd, 2.5 * channel.lattice))
        alone = np.array([_is_isolated(channel, first + k, float(off[k]) / most) for k in rows.tolist()], np.bool_)
        found.append((first + rows[alone], off[rows][alone], sd[rows][alone]))
    numbers, sizes, sds = (np.concatenate(own) for own in zip(*found, strict=True))
    return numbers, sizes, sds


def _off_neighbours(e: Array) -> Array:
    """Distance of each reading but the first and the last from the median of it and its neighbours."""
    left, middle, right = e[:-2], e[1:-1], e[2:]
    return np.abs(middle - np.clip(middle, np.minimum(left, right), np.maximum(left, right)))


def faults(channel: ChannelReadings, spikes: Flags, sizes: Array, sd: Array) -> list[DataFault]:
    """What is told of a channel's spikes.

    `spikes`: which readings they are, shape (N,).
    `sizes`, `sd`: distance of each spike from its neighbours and the noise there, SI, shape (spikes,).
    """
    if not sizes.size:
        return []
    where = times_in_words(channel.t[spikes]) + _powers(sizes, sd, channel.lsb or channel.lattice)
    return [DataFault("spikes", (channel.name,), sizes.size, where, float(np.median(sizes)))]


def _is_isolated(channel: ChannelReadings, k: int, sd: float) -> bool:
    """Whether readings around reading k change by less than noise of `sd` does: a knock rings, a spike does not.

    Where the input is known only the median change counts, for other spikes may be near. Where it is not, a hand may
    have done it: each change counts, and a knock is felt along other axes too.
    """
    near = np.abs(_changes_beside(channel.error, k))
    if not near.size:
        return True
    if not np.isnan(channel.perfect[k % channel.perfect.size]):
        return bool(np.median(near) / 0.6745 < np.sqrt(2.0) * sd)
    return bool(_rms(near) < np.sqrt(2.0) * sd) and not any(_is_knocked(x, k) for x in channel.others)


def _is_knocked(x: Array, k: int) -> bool:
    """Whether a channel beside moves at reading k, or next to it, by more than its noise does."""
    change = np.abs(np.diff(x[max(0, k - 2) : k + 3]))
    return bool(np.max(change) > _FELT * _rms(_changes_beside(x, k)))


def _changes_beside(x: Array, k: int) -> Array:
    """Differences of the readings before reading k, and of those after it."""
    return np.concatenate([np.diff(x[max(0, k - NEAR) : k]), np.diff(x[k + 1 : k + 1 + NEAR])])


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _powers(sizes: Array, sd: Array, count: float) -> str:
    """A word on spikes that are all powers of two of a count, where that is not by chance."""
    if count <= 0.0:
        return ""
    power = np.rint(np.log2(sizes / count))
    near = 3.0 * np.sqrt(1.5) * sd
    if np.any(power < 1) or np.any(np.abs(sizes - 2.0**power * count) > near):
        return ""
    # of sizes spread evenly over an octave
    chance = np.minimum(1.0, 2.0 * near / (2.0**power * count * np.log(2.0)))
    if np.sum(np.log(chance)) > np.log(_CHANCE_OF_POWERS):
        return ""
    bits = sorted({int(p) for p in power})
    return f"; bit flip: {', '.join(f'2^{bit}' for bit in bits)} counts"
