"""UTC from the monotonic clock: whoever sets the system's clock meanwhile moves no stamp, and is told of."""

import time
from dataclasses import dataclass

_READINGS = 5


@dataclass(frozen=True, slots=True)
class Timebase:
    """UTC at start plus the monotonic clock: steps of the system's clock never reach a log."""

    utc_minus_monotonic_ns: int

    @classmethod
    def now(cls) -> "Timebase":
        """From the system's clock as it stands."""
        return cls(utc_minus_monotonic_ns())

    def utc_ns(self, monotonic_ns: int) -> int:
        """UTC of a monotonic instant, ns."""
        return monotonic_ns + self.utc_minus_monotonic_ns


def utc_minus_monotonic_ns() -> int:
    """System clock less monotonic clock; the least of a few readings, since this thread may be held up between two."""
    return min(time.time_ns() - time.monotonic_ns() for _ in range(_READINGS))
