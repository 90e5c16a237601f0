"""Saturation: readings that piled up at the largest value that there is, or at the smallest."""

import numpy as np
from scipy import special

from filters.effects.fault_records import FALSE, ChannelReadings, DataFault, Flags, runs_of, stretches_in_words
from filters.types import Array

_LEAST_PILE = 5
_PILE = 3.0  # times what a smooth distribution has


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
    x = side * channel.reading
    extreme = float(np.max(x[~spikes]))
    tolerance = max(0.25 * channel.lattice, 1e-9 * abs(extreme))
    at = (np.abs(x - extreme) <= tolerance) & ~spikes
    count, none = int(np.sum(at)), np.zeros(at.size, np.bool_)
    if count < _LEAST_PILE:
        return none
    noise, beyond = float(np.median(channel.scales)), _beyond(channel, side, extreme)
    if 2.0 * channel.lattice > noise:
        # a few values make up all the noise, and the last of them may hold much of it: only a known input tells
        least = 5.0 * noise + 3.0 * channel.lattice + 0.02 * abs(extreme)
        return at & (beyond > least) if np.sum(at & (beyond > least)) >= _LEAST_PILE else none
    inside = int(np.sum((x < extreme - tolerance) & (x > extreme - 0.5 * noise - tolerance)))
    expected = _PILE * inside * channel.lattice / (0.5 * noise) + 0.1
    if special.pdtrc(count - 1, expected) > FALSE / 1000.0:
        return none
    if len(runs_of(at)) <= 2 and not np.median(beyond[at]) > -noise:
        return none  # held, and nothing says that there was more to show
    return at


def _beyond(channel: ChannelReadings, side: float, extreme: float) -> Array:
    """By how much the reading to expect is beyond the extreme one, shape (N,); NaN where unknown."""
    known = ~np.isnan(channel.perfect)
    if not np.any(known):
        return np.full(channel.t.size, np.nan)
    bias = float(np.median(channel.error[np.broadcast_to(known, channel.t.shape)]))
    return np.asarray(np.broadcast_to(side * (channel.perfect + bias) - extreme, channel.t.shape))
