"""How fast the temperature changes, from the samples that a filter is fed: the same live and in a replay.

Straight line through the means of the last minute's seconds. Sums are made in the order of the samples, whatever number
of them comes at once.
"""

from collections import deque
from itertools import pairwise

import numpy as np

from filters.types import Array

SPAN_S = 60
_LEAST_S = 30.0


class TemperatureTrend:
    """Means of temperature over seconds, as many as a minute has."""

    def __init__(self) -> None:
        self._means: deque[tuple[float, float]] = deque(maxlen=SPAN_S)
        self._second = -1
        self._count = 0
        self._sums = np.zeros(2)  # of times and of temperatures

    def take(self, t: Array, temperature: Array) -> None:
        """Take samples at `t` s, (N,), and their temperatures, degC, (N,); NaN where one is not known."""
        known = np.isfinite(temperature)
        if not known.any():
            return
        t, temperature = t[known], temperature[known]
        seconds = np.floor(t).astype(np.int64)
        edges = np.flatnonzero(np.diff(seconds, prepend=seconds[0] - 1, append=seconds[-1] + 1))
        for first, last in pairwise(edges.tolist()):
            if seconds[first] != self._second:
                if self._count:
                    self._means.append((self._sums[0] / self._count, self._sums[1] / self._count))
                self._second, self._count, self._sums = int(seconds[first]), 0, np.zeros(2)
            self._count += last - first
            # a running sum adds one after the other, which a sum of many need not
            rows = np.stack([t[first:last], temperature[first:last]], axis=1)
            self._sums = np.cumsum(np.vstack([self._sums, rows]), axis=0)[-1]

    def k_per_min(self) -> float | None:
        """Slope over the last minute, K/min; None before half of one has come."""
        if len(self._means) < 3:
            return None
        t, temperature = np.array(self._means).T
        recent = t >= t[-1] - SPAN_S
        t, temperature = t[recent], temperature[recent]
        if t[-1] - t[0] < _LEAST_S - 2.0 or t.size < 3:
            return None
        centred = t - t.mean()
        return float(60.0 * np.sum(centred * temperature) / np.sum(centred**2))
