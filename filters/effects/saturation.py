"""Saturation: readings that piled up at the largest value that there is, or at the smallest."""

from collections.abc import Iterator

import numpy as np
from scipy import special

from filters.effects.fault_records import FALSE, ChannelReadings, DataFault, Flags, runs_of, stretches_in_words
from filters.types import Array

_LEAST_PILE = 5
_PILE = 3.0  # times what a smooth distribution has
_AT_ONCE = 1 << 18


def saturated(channel: ChannelReadings, spikes: Flags) -> tuple[Flags, list[DataFault]]:
    """Readings at a limit, shape (N,), and what is told of them; spikes do not count."""
    out, faults = np.zeros(spikes.size, np.bool_), []
    for side in (1.0, -1.0):
        at = _at_extreme(channel, side, spikes)
        if np.any(at):
            limit = float(channel.reading[np.argmax(at)])
            where = f"at {limit:.6g}: " + stretches_in_words(channel.t, runs_of(at))
            faults.append(DataFault("saturation", (channel.name,), int(np.sum(at)), where, limit))
            out |= at
    return out, faults


def _at_extreme(channel: ChannelReadings, side: float, spikes: Flags) -> Flags:
    """Readings that piled up at the largest value there is (`side` 1) or the smallest (-1); none if they did not.

    A smooth distribution has about as many readings at its extreme value as at those just inside it, which are counted
    over half a standard deviation of the noise.
    """
    extreme = _extreme(channel.reading, side, spikes)
    tolerance = max(0.25 * channel.lattice, 1e-9 * abs(extreme))
    at = np.zeros(spikes.size, np.bool_)
    noise = float(np.median(channel.scales))
    inside = 0
    for rows in _parts(spikes.size):
        x = side * channel.reading[rows]
        at[rows] = (np.abs(x - extreme) <= tolerance) & ~spikes[rows]
        inside += int(np.sum((x < extreme - tolerance) & (x > extreme - 0.5 * noise - tolerance)))
    count, none = int(np.sum(at)), np.zeros(at.size, np.bool_)
    if count < _LEAST_PILE:
        return none
    beyond = _beyond(channel, side, extreme, at)
    if 2.0 * channel.lattice > noise:
        # a few values make up all the noise, and the last of them may hold much of it: only a known input tells
        least = 5.0 * noise + 3.0 * channel.lattice + 0.02 * abs(extreme)
        at[at] = beyond > least
        return at if np.sum(at) >= _LEAST_PILE else none
    expected = _PILE * inside * channel.lattice / (0.5 * noise) + 0.1
    if special.pdtrc(count - 1, expected) > FALSE / 1000.0:
        return none
    if len(runs_of(at)) <= 2 and not np.median(beyond) > -noise:
        return none  # held, and nothing says that there was more to show
    return at


def _extreme(reading: Array, side: float, spikes: Flags) -> float:
    """The largest reading that is no spike, or the smallest, negative, on side -1."""
    if side > 0.0:
        return float(np.max(reading, where=~spikes, initial=-np.inf))
    return -float(np.min(reading, where=~spikes, initial=np.inf))


def _parts(count: int) -> Iterator[slice]:
    """Rows in parts, so that no copy of all is made."""
    return (slice(first, first + _AT_ONCE) for first in range(0, count, _AT_ONCE))


def _beyond(channel: ChannelReadings, side: float, extreme: float, at: Flags) -> Array:
    """By how much the readings to expect are beyond the extreme one, of those `at` it; NaN where unknown."""
    known = ~np.isnan(channel.perfect)
    count = int(np.count_nonzero(at))
    if not np.any(known):
        return np.full(count, np.nan)
    bias = float(np.median(channel.error if known.all() else channel.error[known]))
    expected = channel.perfect[at] if channel.perfect.size == at.size else np.broadcast_to(channel.perfect, (count,))
    return np.asarray(side * (expected + bias) - extreme)
