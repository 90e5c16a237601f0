"""Packets to output samples at the asked rate: the mean over each period."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Sample:
    """One output sample."""

    stamp_ns: int  # mean of its packets' sampling instants, monotonic, ns
    counts: np.ndarray  # mean counts of rates and accelerations, instrument axes, shape (6,)
    temperature: float  # mean counts of the temperature sensor
    packets: int  # how many packets it is the mean of


class Averager:
    """Groups packets by time, not by number: 133.3 Hz is no multiple of most rates, and packets may be lost.

    `rate_hz`: asked rate. A period runs from a whole multiple of 1/rate after the first packet to the next; its sample
      comes with the first packet after it. A period without packets gives no sample.
    `each`: whether every packet is a sample, as at a rate of the unit's own.
    """

    def __init__(self, rate_hz: float, *, each: bool = False) -> None:
        self._each = each
        self._period_ns = 1e9 / rate_hz
        self._first_ns: int | None = None
        self._number = 0
        self._stamps: list[int] = []
        self._counts = np.zeros(7)

    def add(self, stamp_ns: int, counts: tuple[int, ...], temperature: int) -> Sample | None:
        """Take a packet; return the sample of the period before, when this packet is the first after it."""
        values = np.array([*counts, temperature], float)
        if self._each:
            return Sample(stamp_ns, values[:6], float(values[6]), 1)
        if self._first_ns is None:
            self._first_ns = stamp_ns
        number = int((stamp_ns - self._first_ns) / self._period_ns)
        done = self._close() if number > self._number else None
        self._number = max(number, self._number)
        self._stamps.append(stamp_ns)
        self._counts += values
        return done

    def _close(self) -> Sample | None:
        n = len(self._stamps)
        if not n:
            return None
        first = self._stamps[0]
        stamp = first + round(sum(s - first for s in self._stamps) / n)
        mean = self._counts / n
        self._stamps, self._counts = [], np.zeros(7)
        return Sample(stamp, mean[:6], float(mean[6]), n)
