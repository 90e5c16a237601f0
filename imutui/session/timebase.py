"""UTC from the monotonic clock: whoever sets the system's clock meanwhile moves no stamp, and is told of."""

import contextlib
import time
from collections.abc import Iterator
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


class EventClock:
    """When an event is, monotonic: now, or when that came which is being handled.

    What a packet tells is of its arrival. Later ones may have come meanwhile, and log time does not go back: where
    something was told while a packet was held, what that packet tells is of no earlier time.
    """

    def __init__(self) -> None:
        self._handled_ns: int | None = None
        self._last_ns = 0

    def now_ns(self) -> int:
        """Of an event, ns; never before the last one's."""
        self._last_ns = max(self._last_ns, time.monotonic_ns() if self._handled_ns is None else self._handled_ns)
        return self._last_ns

    @contextlib.contextmanager
    def at(self, instant_ns: int) -> Iterator[None]:
        """Handle what came then."""
        self._handled_ns = instant_ns
        try:
            yield
        finally:
            self._handled_ns = None


def utc_minus_monotonic_ns() -> int:
    """System clock less monotonic clock; the least of a few readings, since this thread may be held up between two."""
    return min(time.time_ns() - time.monotonic_ns() for _ in range(_READINGS))
