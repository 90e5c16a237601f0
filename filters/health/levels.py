"""Noise and drift of channels at rest, from means over spans of readings.

The noise is seen twice: in the differences of successive means, as an Allan deviation, and in second differences of
single readings. Only what both show is noise: the first sees slow changes too, the second is blind to the band below.
"""

import numpy as np

from filters.allan import CHI2_MEDIAN
from filters.types import Array

_KEPT = 512  # differences of means, at most
_FEWEST = 8
_SECOND = 6.0  # variance of a second difference of white noise over that of a reading


class Levels:
    """White noise and straight trend of each channel, over all spans so far."""

    def __init__(self, channels: int) -> None:
        self._means = np.zeros((_KEPT, channels))
        self._fast = np.zeros((_KEPT, channels))
        self._seconds = np.zeros(_KEPT)
        self._spans = self._steps = 0
        self._readings = 1  # in a span
        self._before: Array | None = None
        self._t_first = 0.0
        self._first = np.zeros(channels)
        # sums for the trend, from the first span on: t, t², x, t·x
        self._sums = np.zeros((4, channels))

    def add(self, t: Array, x: Array) -> None:
        """Take a span of readings: times (n,), values (n, channels)."""
        mean, middle, self._readings = x.mean(axis=0), float(t.mean()), t.size
        if self._spans == 0:
            self._first, self._t_first = mean, middle
        d = x[2:] - 2.0 * x[1:-1] + x[:-2]
        row = self._steps % _KEPT
        if self._before is not None:
            self._means[row] = (mean - self._before) ** 2
            self._fast[row] = np.median(d**2, axis=0)
            self._seconds[row] = (t[-1] - t[0]) * t.size / max(t.size - 1, 1)
            self._steps += 1
        self._before = mean
        since, off = middle - self._t_first, mean - self._first
        self._sums += np.stack([np.full(off.size, since), np.full(off.size, since**2), off, since * off])
        self._spans += 1

    def density(self) -> tuple[Array, Array] | None:
        """White noise density by slow and by fast differences, unit·√s, shape (channels,) each.

        Returns None before there are enough spans.
        """
        count = min(self._steps, _KEPT)
        if count < _FEWEST:
            return None
        seconds = float(np.median(self._seconds[:count]))
        if seconds <= 0.0:
            return None
        slow = np.median(self._means[:count], axis=0) / CHI2_MEDIAN / 2.0
        fast = np.median(self._fast[:count], axis=0) / CHI2_MEDIAN / _SECOND
        return np.sqrt(slow * seconds), np.sqrt(fast * seconds / self._readings)

    def trend(self) -> tuple[Array, Array, float] | None:
        """Change along a straight line over all spans, its standard deviation by the noise, and over how many seconds.

        Returns None before there are enough spans.
        """
        count = min(self._steps, _KEPT)
        if count < 2 * _FEWEST:
            return None
        n = self._spans
        t, tt, x, tx = self._sums
        spread = tt[0] - t[0] ** 2 / n
        if spread <= 0.0:
            return None
        slope = (tx - t * x / n) / spread
        noise = np.sqrt(np.median(self._means[:count], axis=0) / CHI2_MEDIAN / 2.0)
        # spans lie evenly: their spread gives the time that they cover
        seconds = float(np.sqrt(12.0 * spread / n))
        return slope * seconds, noise / np.sqrt(spread) * seconds, seconds
