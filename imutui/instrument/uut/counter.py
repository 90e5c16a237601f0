"""What the counter of S1 counts, and how many packets are missing by it; no I/O, reads no clock.

The documents of the 440 and the 380 have it count packets. The 381 that was recorded, and the 383, count time, 65536 a
second, so that the counter wraps each second: whole seconds that are missing can't be seen in it, and at 1 Hz it says
nothing at all. Its step tells which it is, and arrival tells of what is beyond its wrap, if only as a bound: a line
that was held up looks the same at first.
"""

import enum
import math
from dataclasses import dataclass

SPAN = 1 << 16
COUNTS_PER_SECOND = 65536
"""Where it counts time. Some drivers have 65535 for it; a unit that was recorded keeps to this exactly."""

# Steps of a time counter are rounded to whole counts, and its loop is its own clock.
_TOLERANCE_COUNTS = 2
# So many steps alike tell the meaning.
_ENOUGH = 2
# A count of packets that is so much ahead of the time of arrival has begun anew.
_ANEW_S = 10.0


class Meaning(enum.Enum):
    """What the counter counts."""

    UNKNOWN = "unknown"
    PACKETS = "packets"
    TIME = "time"


@dataclass(frozen=True, slots=True)
class Missing:
    """Bounds of how many packets are missing before one: equal where the counter decides it."""

    least: int = 0
    most: int = 0


class StepCounter:
    """Tells from each packet's counter how many are missing before it.

    Parameters
    ----------
    rate_hz : float
        Packets a second, as the unit was told.

    Raises
    ------
    ValueError
        If `rate_hz` is not positive.

    Attributes
    ----------
    meaning : Meaning
        What the counter counts, as far as it is known; it stays once it is.
    """

    def __init__(self, rate_hz: float) -> None:
        if not rate_hz > 0.0:
            raise ValueError(f"`rate_hz` must be positive, not {rate_hz}")
        self.meaning = Meaning.UNKNOWN
        self._rate_hz = rate_hz
        self._last: tuple[int, float] | None = None
        self._seen = {Meaning.PACKETS: 0, Meaning.TIME: 0}

    def take(self, counter: int, arrival_s: float) -> Missing:
        """Take a packet.

        Parameters
        ----------
        counter : int
            0 to 65535.
        arrival_s : float
            When it came, s, on any one scale.

        Returns
        -------
        Missing
            Before this packet; none before the first one.
        """
        if self._last is None:
            self._last = counter, arrival_s
            return Missing()
        step, elapsed_s = (counter - self._last[0]) % SPAN, max(arrival_s - self._last[1], 0.0)
        self._last = counter, arrival_s
        self._learn(step)
        if self.meaning is Meaning.PACKETS:
            return self._by_packets(step, elapsed_s)
        return self._by_time(step, elapsed_s) if self.meaning is Meaning.TIME else self._by_arrival(elapsed_s)

    def restart(self) -> None:
        """Take note that the next packet begins a new stretch; the meaning stays known."""
        self._last = None

    def _learn(self, step: int) -> None:
        if self.meaning is not Meaning.UNKNOWN:
            return
        if step == 1:  # as a time, no packet is so short
            self._count(Meaning.PACKETS)
        elif self._is_regular(step) and (round(step / self._period) >= 1 or self._period >= SPAN):
            self._count(Meaning.TIME)

    def _count(self, meaning: Meaning) -> None:
        self._seen[meaning] += 1
        if self._seen[meaning] >= _ENOUGH:
            self.meaning = meaning

    @property
    def _period(self) -> float:
        return COUNTS_PER_SECOND / self._rate_hz

    def _is_regular(self, step: int) -> bool:
        """Whether a step of time is that of whole packets."""
        return abs(math.remainder(step, self._period)) <= _TOLERANCE_COUNTS

    def _by_packets(self, step: int, elapsed_s: float) -> Missing:
        if step / self._rate_hz > elapsed_s + _ANEW_S:
            return self._by_arrival(elapsed_s)
        wraps = max(0, round((elapsed_s * self._rate_hz - step) / SPAN))
        least = max(step - 1, 0)
        return Missing(least, least + SPAN * wraps)

    def _by_time(self, step: int, elapsed_s: float) -> Missing:
        if not self._is_regular(step):
            return self._by_arrival(elapsed_s)  # the unit began anew
        seconds = max(0, round(elapsed_s - step / COUNTS_PER_SECOND))
        least = max(round(step / self._period) - 1, 0)
        most = max(round((step + COUNTS_PER_SECOND * seconds) / self._period) - 1, 0)
        return Missing(least, most)

    def _by_arrival(self, elapsed_s: float) -> Missing:
        return Missing(0, max(round(elapsed_s * self._rate_hz) - 1, 0))
