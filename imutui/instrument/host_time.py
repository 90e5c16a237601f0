"""Fit the unit's counter to the host's clock: a Kalman filter of two states (instant, tick); no I/O, reads no clock.

The counter steps precisely, but its tick is known to some parts of a thousand only. Arrivals are absolute; the
operating system, an adapter or a network makes them late, never early. So the filter takes the least late arrival of
each block of packets, and one that is later than expected has little weight.
"""

from imutui.instrument.counter_spec import CounterSpec

# random walk of the tick for each packet, as a part of it
_TICK_WALK = 1e-8
# the least of n arrivals that are late by up to twice their mean: about an nth of that, and adapters' bursts repeat
_LEAST_LATE_SD_NS = 0.15e6
_SD_OF_LEAST = 8.0
# a block that is off by more was late, or those before it were
_SURPRISE = 4.0
_SURPRISING_NS = 5.0e6
_ANCHOR_SD_NS = 0.5e6
_MOVED_SD_NS = 5.0e6
_LATE_NS = 20.0e6
_FIRST_BLOCK, _BLOCK = 16, 64
# blocks in a row that may be late before the tick is to blame
_MOST = 3
_FLOOR_NS = 0.5e6


class _Block:
    """The least late of some packets in a row."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.count = 0
        self.total = 0.0
        self.least = float("inf")
        self.ticks_since = 0
        self.ticks = 0
        self.first_ns = self.last_ns = 0.0

    def is_backlog(self, tick_ns: float) -> bool:
        """Return True if they came faster than the unit sends: then all of them were late."""
        return self.last_ns - self.first_ns < 0.5 * self.ticks * tick_ns

    def add(self, late: float, step: int, arrival_ns: float) -> None:
        """Take a packet that is `late` by so many ns, `step` ticks after the one before."""
        self.count += 1
        self.ticks += step
        self.first_ns = arrival_ns if self.count == 1 else self.first_ns
        self.last_ns = arrival_ns
        self.total += min(late, _LATE_NS)
        self.ticks_since += step
        if late < self.least:
            self.least, self.ticks_since = late, 0


class HostTime:
    """Host's monotonic time of the newest packet's sampling, and of each tick from there.

    `counter`: nominal length of its tick, and the tolerance of that.
    `tick_ns`: length of a tick as estimated so far.
    """

    def __init__(self, counter: CounterSpec) -> None:
        self.tick_ns = counter.tick_ns
        self._tick_sd = counter.tick_tolerance * counter.tick_ns
        self._tick_walk = _TICK_WALK * counter.tick_ns
        self._origin = 0
        self._instant = 0.0
        self._P = [0.0, 0.0, self._tick_sd**2]
        self._spread = 0.0
        self._block = _Block(_FIRST_BLOCK)
        self._early = 0
        self._late = 0
        self._doubt_ns = 0.0
        self._anchored = 0  # ticks up to the last packet that `anchor` has used

    @property
    def instant_ns(self) -> int:
        """Host's time of the newest packet's sampling, ns."""
        return self._origin + round(self._instant)

    @property
    def tick_sd_ns(self) -> float:
        """Standard deviation of the tick's length, ns."""
        return float(max(self._P[2], 0.0) ** 0.5)

    @property
    def uncertainty_ns(self) -> float:
        """Greatest distance of the newest instant from the truth, ns: three standard deviations, and the mean lateness.

        While it is open whether a late block was late or the instant is early, it includes that block's lateness.
        """
        return 3.0 * float(max(self._P[0], 0.0) ** 0.5) + self._spread + _FLOOR_NS + self._doubt_ns

    def anchor(self, arrivals: list[float], ticks: list[int]) -> None:
        """Begin at the first of some packets by the least late of them; the length of the tick stays as known.

        `arrivals`: when each packet arrived, less its time on the line; monotonic, ns.
        `ticks`: ticks from the first packet to each.
        """
        self._origin = int(arrivals[0])
        since = [a - self._origin - t * self.tick_ns for a, t in zip(arrivals, ticks, strict=True)]
        least = min(range(len(since)), key=since.__getitem__)
        self._spread = sum(since) / len(since) - since[least]
        sd = _ANCHOR_SD_NS + self._spread / len(since)
        self._instant = since[least] + ticks[least] * self.tick_ns
        self._P = [sd * sd, 0.0, self._P[2]]
        self._block = _Block(_FIRST_BLOCK)
        self._early = self._late = 0
        self._doubt_ns = 0.0
        self._go_on(-ticks[least])
        self._anchored = ticks[-1]

    def lateness(self, arrival_ns: float, step: int) -> float:
        """Return how late a packet is, ns, that was sampled `step` ticks after the newest one."""
        return arrival_ns - self._origin - self._instant - step * self.tick_ns

    def advance(self, step: int, arrival_ns: float) -> float:
        """Go on to a packet, `step` ticks after the newest one; return how late instants turned out to be, ns."""
        self._go_on(step)
        if self._anchored > 0:
            self._anchored -= step
            return 0.0
        block = self._block
        block.add(self.lateness(arrival_ns, 0), step, arrival_ns)
        return self._use(block) if block.count >= block.size else 0.0

    def _go_on(self, step: int) -> None:
        p, c, q = self._P
        self._instant += step * self.tick_ns
        self._P = [p + 2.0 * step * c + step * step * q, c + step * q, q + self._tick_walk**2]

    def _use(self, block: _Block) -> float:
        least = block.least
        if least > _LATE_NS and block.is_backlog(self.tick_ns):
            self._block = _Block(block.size)
            return 0.0
        self._block = _Block(min(2 * block.size, _BLOCK))
        spread = max(0.0, block.total / block.count - least)
        self._spread += 0.5 * (spread - self._spread)
        sd = max(_LEAST_LATE_SD_NS, _SD_OF_LEAST * spread / block.count)
        surprise = max(_SURPRISING_NS, _SURPRISE * (self._variance(block.ticks_since) + sd * sd) ** 0.5)
        self._late = self._late + 1 if least > surprise else 0
        self._early = self._early + 1 if least < -surprise else 0
        self._doubt_ns = least if self._late else 0.0
        if self._late and self._late <= _MOST:
            return 0.0  # perhaps no packet of the block came in time
        if self._early or self._late:
            return self._move(least)
        self._update(least, block.ticks_since, sd)
        return 0.0

    def _move(self, innovation: float) -> float:
        """Correct the instant at once, and the tick soon.

        No packet arrives early: the earlier ones were late. If block after block is late, the tick is wrong, or wraps
        went by unseen.
        """
        self._instant += innovation
        tick_sd = self._tick_sd if max(self._late, self._early) > _MOST else 0.0
        self._P = [_MOVED_SD_NS**2, 0.0, max(self._P[2], tick_sd**2)]
        self._late, self._doubt_ns = 0, 0.0
        self._block = _Block(_FIRST_BLOCK)
        return max(0.0, innovation)

    def _variance(self, ticks_since: int) -> float:
        """Return the variance of the instant so many ticks ago, ns²."""
        p, c, q = self._P
        return max(0.0, p - 2.0 * ticks_since * c + ticks_since * ticks_since * q)

    def _update(self, innovation: float, ticks_since: int, sd: float) -> None:
        p, c, q = self._P
        # it was seen some ticks ago: H = (1, -ticks_since)
        a, b = p - ticks_since * c, c - ticks_since * q
        S = a - ticks_since * b + sd * sd
        self._instant += a / S * innovation
        self.tick_ns += b / S * innovation
        self._P = [p - a * a / S, c - a * b / S, q - b * b / S]
