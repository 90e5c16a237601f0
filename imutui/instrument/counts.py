"""Readings in counts, as packets have them, and what a count is: in the instrument's own axes and signs."""

from collections import deque
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Triple: TypeAlias = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class PacketDetails:
    """What packets of some units have beside their readings, in counts."""

    rate_temperatures: Triple  # of the rate sensors X, Y, Z
    board_temperature: int
    status: int  # the unit's status word, 16 bits


class DataPacket(Protocol):
    """One set of readings."""

    @property
    def rates(self) -> Triple:
        """X, Y, Z."""
        ...

    @property
    def accels(self) -> Triple:
        """X, Y, Z."""
        ...

    @property
    def temperature(self) -> int:
        """The one that the samples have."""
        ...

    @property
    def ticks(self) -> int:
        """The packet's counter, 0 to 65535."""
        ...

    @property
    def details(self) -> PacketDetails | None:
        """What else it has; None of units whose packets have no more."""
        ...


_LATELY, _MOST_REPEATS = 4, 3
_PART_OF_WRAP = 0.9


class RepeatedPackets:
    """Finds packets that came twice over the line: their counter and all else are equal.

    Packets of a still unit may read the same; their counters distinguish them, unless they stand still or have wrapped.

    `wrap_ns`: how long a wrap of the counter takes. `period_ns`: from packet to packet of a stream; 0 if unknown, and
      then less than a wrap. `count`: of packets that came again.
    """

    def __init__(self, wrap_ns: float, period_ns: float = 0.0) -> None:
        self.count = 0
        self._wrap_ns, self._may_wrap = wrap_ns, period_ns > _PART_OF_WRAP * wrap_ns
        self._recent: deque[tuple[DataPacket, int]] = deque(maxlen=_LATELY)
        self._run = 0

    def take(self, packet: DataPacket, host_ns: int, *, contiguous: bool = False, asked: bool = False) -> bool:
        """Take a packet, and return whether it came before, so that it counts for nothing.

        `host_ns`: when it was read, monotonic, ns.
        `contiguous`: whether it followed the packet before it byte by byte.
        `asked`: whether it is the answer to a request, as all others are.
        """
        places = [k for k, (one, _) in enumerate(self._recent) if one == packet]
        if places and self._is_the_same(places[-1], host_ns, contiguous=contiguous, asked=asked):
            self._run += 1
            self.count += 1
            return True
        self._run = self._run + 1 if places else 0
        self._recent.append((packet, host_ns))
        return False

    def _is_the_same(self, place: int, host_ns: int, *, contiguous: bool, asked: bool) -> bool:
        packets = [one for one, _ in self._recent]
        stands_still = len(packets) > 1 and len({one.ticks for one in packets}) == 1
        if stands_still or self._run >= _MOST_REPEATS:
            return False
        soon = host_ns - self._recent[place][1] < 0.5 * self._wrap_ns
        adjacent = contiguous and not self._may_wrap and place == len(packets) - 1
        vary = len({(one.rates, one.accels) for one in packets}) > 1
        return soon or adjacent or (asked and vary)


COUNT_LIMITS = (-(2**15), 2**15 - 1)
"""Least and largest count of a word of 16 bits with sign; a reading there means "this or more"."""


@dataclass(frozen=True)
class Scaling:
    """Scales of the words in packets: rates and accelerations have 16 bits with sign and are 0 at zero.

    Each method takes an int, a tuple or an array of any shape, and returns a numpy scalar or array of that shape.
    """

    rate_lsb_dps: float  # deg/s a count
    accel_lsb_g: float  # g a count
    # temperature, degC: degc_per_unit · (count · temperature_lsb - temperature_zero)
    temperature_lsb: float
    temperature_zero: float = 0.0
    degc_per_unit: float = 1.0
    temperature_limits: tuple[int, int] = COUNT_LIMITS

    def rates_dps(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Angular rate, deg/s."""
        return np.asarray(counts, np.float64) * self.rate_lsb_dps

    def accels_g(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Acceleration as the unit reads it, g."""
        return np.asarray(counts, np.float64) * self.accel_lsb_g

    def temperature_degc(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Temperature, degC."""
        return self.degc_per_unit * (np.asarray(counts, np.float64) * self.temperature_lsb - self.temperature_zero)

    def rate_counts(self, rates_dps: ArrayLike) -> NDArray[np.int64]:
        """Nearest counts of an angular rate in deg/s, clipped to the word."""
        return nearest(rates_dps, self.rate_lsb_dps)

    def accel_counts(self, accels_g: ArrayLike) -> NDArray[np.int64]:
        """Nearest counts of an acceleration in g, clipped to the word."""
        return nearest(accels_g, self.accel_lsb_g)

    def temperature_counts(self, temperature_degc: ArrayLike) -> NDArray[np.int64]:
        """Nearest counts of a temperature in degC, clipped to the word."""
        units = np.asarray(temperature_degc, np.float64) / self.degc_per_unit + self.temperature_zero
        return nearest(units, self.temperature_lsb, self.temperature_limits)


def nearest(values: ArrayLike, lsb: float, limits: tuple[int, int] = COUNT_LIMITS) -> NDArray[np.int64]:
    """Nearest counts of some values, clipped."""
    return np.clip(np.rint(np.asarray(values, np.float64) / lsb), *limits).astype(np.int64)


def triple(counts: NDArray[np.int64]) -> Triple:
    """Counts of X, Y and Z as a packet has them."""
    x, y, z = counts.tolist()
    return x, y, z
