"""Spikes: isolated readings that are off, told from knocks, which ring and are felt along other axes too."""

import numpy as np

from filters.effects import quantisation
from filters.effects.fault_records import FALSE, ChannelReadings, DataFault, Flags, times_in_words
from filters.types import Array

SPIKE = 7.0
"""Standard deviations of one reading, from the median of it and its two neighbours."""
_FELT = 3.0  # standard deviations
NEAR = 8  # readings on each side of a spike that are quiet
_CHANCE_OF_POWERS = 0.05


def off_neighbours(channel: ChannelReadings) -> tuple[Array, Array]:
    """Distance of each reading from the median of it and its neighbours, and the noise there; each of shape (N,)."""
    e = channel.error
    off = np.zeros(e.size)
    left, middle, right = e[:-2], e[1:-1], e[2:]
    off[1:-1] = middle - np.clip(middle, np.minimum(left, right), np.maximum(left, right))
    s = channel.scales
    around = np.maximum(s, np.maximum(np.append(s[1:], 0.0), np.append(0.0, s[:-1])))
    return off, quantisation.spread(np.maximum(around, np.median(s)), channel.width, e.size)


def isolated(channel: ChannelReadings, off: Array, sd: Array) -> Flags:
    """Whether each reading is off by itself, shape (N,).

    For white noise P(∣d∣ > h σ) ≈ 0.034 exp(-h²/3), d the distance from the median of three; 7 is enough up to half a
    million readings. Correlated noise has less of it.
    """
    most = max(SPIKE, float(np.sqrt(3.0 * np.log(0.034 * 6.0 * off.size / FALSE))))
    spikes = np.abs(off) > np.maximum(most * sd, 2.5 * channel.lattice)
    spikes[spikes] = [_is_isolated(channel, int(k), abs(off[k]) / most) for k in np.flatnonzero(spikes)]
    return np.asarray(spikes)


def faults(channel: ChannelReadings, spikes: Flags, sizes: Array, sd: Array) -> list[DataFault]:
    """What is told of a channel's spikes.

    Parameters
    ----------
    channel : ChannelReadings
    spikes : boolean array
        Which readings they are, shape (N,).
    sizes, sd : Array
        Distance of each spike from its neighbours and the noise there, SI, shape (spikes,).
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
    return bool(_rms(near) < np.sqrt(2.0) * sd) and not any(_is_knocked(x, k) for x in channel.others.T)


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
