"""What the counter in an instrument's packets counts; no I/O, reads no clock."""

from dataclasses import dataclass, replace
from typing import Any, TypeVar

from numpy.typing import NDArray

Ticks = TypeVar("Ticks", int, NDArray[Any])

SPAN = 1 << 16
"""Counters are words of 16 bits, whatever they count."""


@dataclass(frozen=True, slots=True)
class CounterSpec:
    """A counter of 16 bits that steps from packet to packet."""

    tick_ns: float  # nominal length of a tick, ns
    tick_tolerance: float  # one standard deviation of what a unit's tick differs from that, as a part of it
    direction: int  # +1 if it counts up, -1 if it counts down
    # whether units of the kind are known whose counter counts packets instead: its step tells
    may_count_packets: bool = False
    # whether it does: then it tells how many are missing even where the unit may have paused
    counts_packets: bool = False

    def step(self, before: Ticks, after: Ticks) -> Ticks:
        """Ticks from one value to a later one, less whole wraps; of arrays too, element by element."""
        steps: Ticks = self.direction * (after - before) % SPAN
        return steps

    def of_packets(self, period_ns: float) -> "CounterSpec":
        """The same where each packet counts one, a period apart."""
        return replace(self, tick_ns=period_ns, may_count_packets=False, counts_packets=True)
