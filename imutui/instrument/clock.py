"""From the instrument's time counter to sampling instants on the host's monotonic clock; no I/O, reads no clock.

The counter steps precisely but wraps every 52 ms and its tick is known to 0.6 % only; the host's stamps are absolute
but late by whatever the operating system felt like. A two-state Kalman filter (instant, tick) takes the best of both:
it is fed the least late arrival of every half second, since no packet arrives early.
"""

from dataclasses import dataclass

NOMINAL_TICK_NS = 790.0
WRAP = 1 << 16
_TICK_SD = 0.006 * NOMINAL_TICK_NS
_TICK_WALK = 1e-8 * NOMINAL_TICK_NS
_ANCHOR_SD_NS = 10.0e6
_LEAST_LATE_SD_NS = 0.3e6
_LATE_NS = 20.0e6
# a tick that is off by two standard deviations makes the first whole block so early
_EARLY_NS = 5.0e6
_BLOCK = 64
_AMBIGUOUS_NS = 25.0e6
# blocks in a row that may be early while a backlog is read, up to 3 s of it; and late before it is no wrap that went
_MOST_EARLY = 6
_MOST_LATE = 3


@dataclass(frozen=True, slots=True)
class Stamp:
    """When a packet's sample was taken.

    Attributes
    ----------
    monotonic_ns : int
        Host's monotonic clock, ns.
    lost : int
        Packets that are missing before this one.
    by_host : bool
        Whether the counter could not help, so that the instant is the time of arrival less the line's time.
    """

    monotonic_ns: int
    lost: int
    by_host: bool


def arrival_before(host_ns: int, ticks: int, last_ticks: int) -> int:
    """When a packet arrived that was only recognised together with a later one.

    Parameters
    ----------
    host_ns : int
        When the later one arrived.
    ticks, last_ticks : int
        Time counters of the earlier and the later one, less than a wrap apart.

    Returns
    -------
    int
        Monotonic, ns.
    """
    return host_ns - round((ticks - last_ticks) % WRAP * NOMINAL_TICK_NS)


class _Least:
    """The least late arrival of a block of packets."""

    def __init__(self) -> None:
        self.innovation = float("inf")
        self.ticks_since = 0
        self.count = 0

    def add(self, innovation: float, step: int) -> None:
        """Take a packet, `step` ticks after the one before."""
        self.count += 1
        self.ticks_since += step
        if innovation < self.innovation:
            self.innovation, self.ticks_since = innovation, 0


class Clock:
    """Stamps the packets of a stream, in order.

    Parameters
    ----------
    line_ns : float
        Time that a packet spends on the line, subtracted from its arrival.
    polled : bool
        Whether packets come on request: then steps are longer than the counter's wrap and arrival alone counts.
    """

    def __init__(self, line_ns: float, *, polled: bool = False) -> None:
        self._line_ns = line_ns
        self._polled = polled
        self._ticks: int | None = None
        self._host_ns = 0
        self._origin = 0
        self._instant = 0.0
        self._tick = NOMINAL_TICK_NS
        self._P = [0.0, 0.0, 0.0]
        self._period: float | None = None
        self._last = 0
        self._step = 0
        self._block = 1
        self._least = _Least()
        self._early = 0
        self._late = 0

    @property
    def tick_ns(self) -> float:
        """Length of the counter's tick as estimated so far, ns."""
        return self._tick

    def stamp(self, ticks: int, host_ns: int, *, contiguous: bool) -> Stamp:
        """Instant of one packet.

        Parameters
        ----------
        ticks : int
            Its time counter, 0 to 65535, counting down.
        host_ns : int
            Monotonic clock when its last byte was read.
        contiguous : bool
            Whether it followed the previous packet without a byte between: then no wrap was missed.
        """
        arrival = host_ns - self._line_ns
        if self._ticks is None or self._polled:
            self._anchor(ticks, host_ns, arrival)
            return self._emit(0, by_host=True)
        step = (self._ticks - ticks) % WRAP
        elapsed = host_ns - self._host_ns
        self._ticks, self._host_ns = ticks, host_ns
        if not contiguous:
            expected = arrival - self._origin - self._instant
            if elapsed * (self._P[2] ** 0.5 / self._tick) > _AMBIGUOUS_NS:
                lost = self._missing(expected / self._tick)
                self._anchor(ticks, host_ns, arrival)
                return self._emit(lost, by_host=True)
            step += WRAP * max(0, round((expected / self._tick - step) / WRAP))
        elif self._period is None or step:
            self._period = step if self._period is None else self._period + (step - self._period) / 16.0
        lost = 0 if contiguous else self._missing(step)
        lost += self._advance(step, arrival)
        return self._emit(lost, by_host=False)

    def interrupt(self) -> None:
        """Take note that packets were not asked for since the last one: the next begins a new stretch, none is lost.

        The length of the tick stays known.
        """
        self._ticks = None

    def _anchor(self, ticks: int, host_ns: int, arrival: float) -> None:
        self._ticks, self._host_ns = ticks, host_ns
        self._origin = int(arrival)
        self._instant = arrival - self._origin
        self._P = [_ANCHOR_SD_NS**2, 0.0, _TICK_SD**2 if self._P[2] == 0.0 else self._P[2]]
        self._step, self._block, self._least = 0, 1, _Least()

    def _advance(self, step: int, arrival: float) -> int:
        """Go on by so many ticks; returns packets found missing."""
        p, c, q = self._P
        self._step = step
        self._instant += step * self._tick
        self._P = [p + 2.0 * step * c + step * step * q, c + step * q, q + _TICK_WALK**2]
        self._least.add(arrival - self._origin - self._instant, step)
        if self._least.count < self._block:
            return 0
        # the first blocks are short, so that a late first packet is put right at once
        least, self._least, self._block = self._least, _Least(), min(2 * self._block, _BLOCK)
        whole = least.count == _BLOCK
        early = least.innovation < -_EARLY_NS or (not whole and least.innovation < 0.0)
        self._early = self._early + whole if early else 0
        self._late = self._late + 1 if whole and least.innovation > _LATE_NS else 0
        if self._late > _MOST_LATE:
            self._forget(least.innovation)
        elif self._late:
            return self._catch_up(least.innovation)
        elif early and self._early <= _MOST_EARLY:
            self._move(least.innovation)
        elif whole or least.innovation < _LATE_NS:
            self._update(least.innovation, least.ticks_since)
        return 0

    def _move(self, innovation: float) -> None:
        """Correct the instant alone: no packet arrives early, so those before were late. The tick is not to blame."""
        self._instant += innovation
        self._P = [_ANCHOR_SD_NS**2, 0.0, self._P[2]]

    def _forget(self, innovation: float) -> None:
        """Begin to learn the tick anew: late in block after block, it is wrong, and no wraps are missing."""
        self._tick = NOMINAL_TICK_NS
        self._P[2] = _TICK_SD**2
        self._move(innovation)
        self._late = 0

    def _update(self, innovation: float, ticks_since: int) -> None:
        p, c, q = self._P
        # it was seen some ticks ago: H = (1, -ticks_since)
        a, b = p - ticks_since * c, c - ticks_since * q
        S = a - ticks_since * b + _LEAST_LATE_SD_NS**2
        self._instant += a / S * innovation
        self._tick += b / S * innovation
        self._P = [p - a * a / S, c - a * b / S, q - b * b / S]

    def _catch_up(self, late: float) -> int:
        """Add wraps that went unseen: when for half a second no packet came near its time, whole wraps are missing."""
        wraps = max(1, round(late / (WRAP * self._tick)))
        self._instant += wraps * WRAP * self._tick
        return 0 if self._period is None else round(wraps * WRAP / self._period)

    def _missing(self, step: float) -> int:
        return 0 if not self._period else max(0, round(step / self._period) - 1)

    def _emit(self, lost: int, *, by_host: bool) -> Stamp:
        # a correction backwards must not stop time: the stamp goes on by a quarter of its step at least
        least = self._last + max(1, round(0.25 * self._step * self._tick))
        self._last = max(least, self._origin + round(self._instant))
        return Stamp(self._last, lost, by_host)
