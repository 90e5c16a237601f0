"""The time counter in an instrument's packets; no I/O, reads no clock."""

from dataclasses import dataclass
from typing import Any, TypeVar

from numpy.typing import NDArray

Ticks = TypeVar("Ticks", int, NDArray[Any])

SPAN = 1 << 16
"""Counters are words of 16 bits: ticks of one wrap."""


@dataclass(frozen=True, slots=True)
class CounterSpec:
    """A counter of 16 bits that steps from packet to packet."""

    tick_ns: float  # nominal length of a tick, ns
    tick_tolerance: float  # standard deviation of a unit's tick from that, as a part of it
    direction: int  # +1 if it counts up, -1 if it counts down

    def step(self, before: Ticks, after: Ticks) -> Ticks:
        """Return the ticks from one value to a later one, less whole wraps; arrays are taken element by element."""
        steps: Ticks = self.direction * (after - before) % SPAN
        return steps
