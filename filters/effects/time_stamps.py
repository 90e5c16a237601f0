"""Time stamps of one run: readings that are missing (dropout), stamps that are off (jitter)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.types import Array

JITTER = 0.02
"""Of the period: stamps off by less are not reported. At 100 deg/s² and 7.5 ms it is 0.015 deg/s, 2 % of one
reading's noise in Table 1."""

_SPAN = 50  # readings over which host stamps that come in bursts have their mean period
_LONG_SPAN = 1000
_AROUND = 250  # readings before and after a gap, to see whether what comes late stays late
_REGULAR = 0.2  # of the period: a median step that differs by more is that of bursts
_OFF = 0.2  # of the period: a step that is off
_OFF_SHARE = 0.01
_STAYS = 0.6  # of a gap: what is lost stays lost, a late burst makes up for it


@dataclass(frozen=True, slots=True)
class StampQuality:
    """What the stamps of a run are like."""

    period: float  # between readings, s
    jitter: float  # standard deviation of a stamp's error, s
    bursts: bool  # whether readings arrive several at once
    gaps: NDArray[np.intp]  # numbers of the readings before a gap
    off: NDArray[np.intp]  # numbers of the readings before a step that is off and no gap

    @property
    def is_off(self) -> bool:
        """Whether stamps are worth a word: bursts, steps back, or errors above `JITTER` of the period."""
        return self.bursts or self.jitter > JITTER * self.period


def analyse(t: Array) -> StampQuality:
    """Period, jitter, gaps of a run's stamps.

    A gap is a step above max(2.5 T, T + 8 jitter), T the period; from 1.5 T on, if the steps beside it do not make up
    for it: a single reading is lost then. The period is the median step, whatever is lost; where
    stamps are of arrival in bursts, it is the median over 1000 readings, and a gap is one only if what follows stays
    late.

    `t`: s, shape (N,), N ≥ 3.
    """
    step = np.diff(t)
    period, bursts = _period(t, step)
    jitter = _burst_jitter(t, period) if bursts else _jitter(step, period)
    gaps = np.flatnonzero(step > max((2.5 if bursts else 1.5) * period, period + 8.0 * jitter))
    stays = _stays_late if bursts else _is_not_made_up
    gaps = np.array([k for k in gaps if (step[k] > 2.5 * period and not bursts) or stays(t, int(k), period)], np.intp)
    wrong = np.abs(step - period) > _OFF * period
    wrong[gaps] = False
    return StampQuality(period, jitter, bursts, gaps, np.flatnonzero(wrong))


def _period(t: Array, step: Array) -> tuple[float, bool]:
    span = min(_SPAN, step.size)
    mean = float(np.median(t[span:] - t[:-span])) / span
    median = float(np.median(step))
    # lost readings make the mean longer, up to 1 in 3; bursts make the median a fraction of it
    if median > (1.0 - 2.0 * _REGULAR) * mean:
        return median, False
    span = min(_LONG_SPAN, step.size)
    return float(np.median(t[span:] - t[:-span])) / span, True


def _jitter(step: Array, period: float) -> float:
    """Of independent errors: second differences of stamps have variance 6 s²; few large ones count too."""
    robust = 1.4826 * float(np.median(np.abs(np.diff(step)))) / np.sqrt(6.0)
    # a step of a whole number of periods has lost readings in it, not wrong stamps
    error = step - period * np.maximum(1.0, np.rint(step / period))
    if np.mean(np.abs(error) > _OFF * period) > _OFF_SHARE or np.any(step <= 0.0):
        return float(max(robust, np.sqrt(np.mean(error**2) / 2.0)))
    return float(robust)


def _burst_jitter(t: Array, period: float) -> float:
    """Spread of lateness against a line through each 50 readings."""
    late = t - period * np.arange(t.size)
    rows = late[: late.size // _SPAN * _SPAN].reshape(-1, _SPAN)
    return float(np.median(np.std(rows, axis=1))) if rows.size else float(np.std(late))


def _is_not_made_up(t: Array, k: int, period: float) -> bool:
    """Whether the three steps around reading k and the next are longer together by most of a period."""
    first, last = max(0, k - 1), min(t.size - 1, k + 2)
    return bool(t[last] - t[first] > (last - first + 0.5) * period)


def _stays_late(t: Array, k: int, period: float) -> bool:
    """Whether the earliest of the stamps after reading k stay late by most of the gap."""
    first, last = max(0, k + 1 - _AROUND), min(t.size, k + 1 + _AROUND)
    late = t[first:last] - period * np.arange(first, last)
    before, after = late[: k + 1 - first], late[k + 1 - first :]
    return bool(after.min() - before.min() > _STAYS * (t[k + 1] - t[k]))
