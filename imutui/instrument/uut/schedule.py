"""When a virtual unit of the family samples: its loop, and which of the loop's instants its packets have."""

import math

from imutui.instrument.transmitter import SAME_INSTANT_S


class Schedule:
    """The loop, which runs from time 0 on, and the number of its instant that the stream's next packet has.

    `loop_hz`: rate of the loop.
    `next`: the loop's instant of the next packet.
    """

    def __init__(self, loop_hz: int) -> None:
        self.loop_hz = loop_hz
        self.next = 0

    def instant(self, number: int) -> float:
        """When one of the loop's instants is, s: a quotient, so that no rounding piles up."""
        return number / self.loop_hz

    def newest(self, now: float) -> int:
        """The loop's last instant by a time."""
        return math.floor((now + SAME_INSTANT_S) * self.loop_hz)

    def begin(self, now: float) -> None:
        """Let the next packet be of the loop's next instant."""
        self.next = self.newest(now) + 1

    def advance(self, rate_hz: int) -> None:
        """Go on to the packet after the next, at so many a second."""
        self.next += self.loop_hz // rate_hz

    def skip_to(self, now: float, rate_hz: int) -> None:
        """Leave out packets, so that the next one is the newest at a time."""
        step = self.loop_hz // rate_hz
        self.next += max(0, (self.newest(now) - self.next) // step) * step
