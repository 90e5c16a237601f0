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
        self._t_sum = 0.0
        self._sum = 0.0

    def take(self, t: Array, temperature: Array) -> None:
        """Take samples at `t` s, (N,), and their temperatures, degC, (N,); NaN where one is not known."""
        known = np.isfinite(temperature)
        if not known.any():
            return
        t, temperature = t[known], temperature[known]
        seconds = np.floor(t).astype(np.int64)
        edges = np.flatnonzero(np.diff(seconds, prepend=seconds[0] - 1, append=seconds[-1] + 1))
        for first, last in pairwise(edges.tolist()):
            self._add(int(seconds[first]), t[first:last], temperature[first:last])

    def _add(self, second: int, t: Array, temperature: Array) -> None:
        if second != self._second:
            self._close()
            self._second, self._count, self._t_sum, self._sum = second, 0, 0.0, 0.0
        self._count += t.size
        # a running sum adds one after the other, which a sum of many need not
        self._t_sum = float(np.cumsum(np.concatenate([[self._t_sum], t]))[-1])
        self._sum = float(np.cumsum(np.concatenate([[self._sum], temperature]))[-1])

    def _close(self) -> None:
        if self._count:
            self._means.append((self._t_sum / self._count, self._sum / self._count))

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
