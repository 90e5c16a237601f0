"""White noise and drift of a log's own samples, for a filter that is to expect these instead of a data sheet's."""

from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np

from filters.allan import RunningAllan
from filters.errors import InputError
from filters.imu import Noise
from filters.kalman.settings import GAP_PERIODS
from imutui.jobs.replay_input import Part
from imutui.logbook.session_info import SessionInfo

_OVERLAP = 2**15
"""Differences of means of so many samples are all taken, those of longer ones at a stride: a deviation then moves by
less than 1e-4 of its own standard deviation."""


def measured(info: SessionInfo, parts: Callable[[], Iterable[Part]]) -> Noise:
    """White noise and drift of the samples themselves, by Allan deviation, from the longest stretch without a gap.

    `info`: with the reference in force.
    `parts`: gives the samples from the first one on, each time that it is called.
    Raises InputError if the unit moves by its reference, or the log is too short.
    """
    if info.reference not in ("level", "gravity"):
        raise InputError(
            f'`noise` is "log" with reference "{info.reference}": noise is measured on a unit at rest. Measure it on a'
            " still log, or leave filter.noise at table1."
        )
    period = 1.0 / info.rate_hz
    first, last = _longest(parts(), period)
    running, at = RunningAllan(6, _OVERLAP), 0
    unread: tuple[bool, ...] = ()
    for part in parts():
        rows = slice(max(first - at, 0), max(last - at, 0))
        running.add(np.column_stack([part.accel[rows], part.gyro[rows]]))
        at += part.t.size
        unread = part.unread
    levels = running.noise(period)
    white, drift = (_like_the_others(each, unread).tolist() for each in (levels.white, levels.drift))
    return Noise(tuple(white[:3]), tuple(white[3:]), tuple(drift[:3]), tuple(drift[3:]))


def _longest(parts: Iterable[Part], period: float) -> tuple[int, int]:
    """Number of the first sample of the longest stretch without a gap, and of the first one behind it."""
    begin = count = breaks = 0
    longest, last = (0, 0), np.empty(0)
    for part in parts:
        steps = np.diff(part.t, prepend=last)
        found = np.flatnonzero(steps > GAP_PERIODS * period) + count + part.t.size - steps.size
        breaks, count = breaks + found.size, count + part.t.size
        edges = [begin, *found.tolist(), count]
        stretch = max(pairwise(edges), key=lambda ends: ends[1] - ends[0])
        longest = max(longest, stretch, key=lambda ends: ends[1] - ends[0])
        begin, last = edges[-2], part.t[-1:]
    # bursts of a host's stamps are no gaps in the samples
    return (0, count) if breaks > 0.001 * count else longest


def _like_the_others(levels: np.ndarray, unread: tuple[bool, ...]) -> np.ndarray:
    """Levels of six channels; one that was not read has no noise of its own, and gets the most of its kind."""
    if not unread:
        return levels
    kinds = np.where(unread, 0.0, levels).reshape(2, 3)
    return np.where(unread, np.repeat(kinds.max(axis=1), 3), levels)
