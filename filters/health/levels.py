"""Noise and drift of channels at rest, from means over spans of readings.

The noise is seen twice: in the differences of successive means, as an Allan deviation, and in second differences of
single readings. Only what both show is noise: the first sees slow changes too, the second is blind to the band below.
"""

import numpy as np

from filters.allan import CHI2_MEDIAN
from filters.effects.quantisation import KEPT, KEPT_VARIANCE
from filters.types import Array

_KEPT = 512  # differences of means, at most
_FEWEST = 8
_PIECES = 16  # at most; from half as many on
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
        # sums over pieces of equally many spans, one after the other
        self._pieces = np.zeros((_PIECES, channels))
        self._of_piece = 1

    def add(self, t: Array, means: Array, second: Array) -> None:
        """Take spans: times (spans, n), means (spans, channels), second differences (spans, n - 2, channels)."""
        self._readings = t.shape[1]
        middles = t.mean(axis=1)
        if self._spans == 0:
            self._first, self._t_first = means[0], float(middles[0])
        before = means[:1] if self._before is None else self._before[None]
        apart = (means - np.concatenate([before, means[:-1]])) ** 2
        fast, seconds = np.median(second**2, axis=1), (t[:, -1] - t[:, 0]) * self._readings / (self._readings - 1)
        first = int(self._before is None)  # has none before it
        rows = (self._steps + np.arange(len(t) - first)) % _KEPT
        self._means[rows], self._fast[rows], self._seconds[rows] = apart[first:], fast[first:], seconds[first:]
        self._steps += rows.size
        self._before = means[-1]
        since, off = (middles - self._t_first)[:, None], means - self._first
        since = np.broadcast_to(since, off.shape)
        # one after the other: how spans are divided among calls must not show in the last bit
        self._sums = np.add.accumulate([self._sums, *np.stack([since, since**2, off, since * off], axis=1)])[-1]
        for own in off:
            if self._spans == _PIECES * self._of_piece:
                half = _PIECES // 2
                self._pieces[:half] = self._pieces.reshape(half, 2, -1).sum(axis=1)
                self._pieces[half:] = 0.0
                self._of_piece *= 2
            self._pieces[self._spans // self._of_piece] += own
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
        slope, noise = (tx - t * x / n) / spread, self._noise(count)
        # spans lie evenly: their spread gives the time that they cover
        seconds = float(np.sqrt(12.0 * spread / n))
        return slope * seconds, noise / np.sqrt(spread) * seconds, seconds

    def excursion(self) -> tuple[Array, Array] | None:
        """Largest difference among the means of pieces of equal length, and a mean's standard deviation by the noise.

        Returns None before there are enough spans.
        """
        count = min(self._steps, _KEPT)
        if count < 2 * _FEWEST:
            return None
        pieces = self._pieces[: self._spans // self._of_piece] / self._of_piece
        return np.ptp(pieces, axis=0), self._noise(count) / np.sqrt(self._of_piece)

    def _noise(self, count: int) -> Array:
        """Standard deviation of a span's mean, by differences of successive ones, or by fast ones if that is more."""
        kept = max(1, round(KEPT * count))
        squares = np.partition(self._means[:count], kept - 1, axis=0)[:kept]
        slow = squares.mean(axis=0) / KEPT_VARIANCE / 2.0
        # where noise is white the fast differences, of which there are more, know it better
        fast = np.median(self._fast[:count], axis=0) / CHI2_MEDIAN / _SECOND / self._readings
        return np.asarray(np.sqrt(np.maximum(slow, fast)))
