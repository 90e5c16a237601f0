"""UTC derived from the monotonic clock. Setting the system's clock during a run does not move stamps."""

import time
from dataclasses import dataclass

from imutui.logbook import log_time

_READINGS = 5


@dataclass(frozen=True, slots=True)
class Timebase:
    """UTC at the start plus the monotonic clock. `moved_ns`: by how much the start was moved into the range of logs."""

    utc_minus_monotonic_ns: int
    moved_ns: int = 0

    @classmethod
    def now(cls) -> "Timebase":
        """Take the time of the system's clock; one that stamps cannot hold is moved, see `log_time`."""
        clock_ns, now_ns = utc_minus_monotonic_ns(), time.monotonic_ns()
        moved_ns = log_time.fitted_ns(clock_ns + now_ns) - (clock_ns + now_ns)
        return cls(clock_ns + moved_ns, moved_ns)

    def utc_ns(self, monotonic_ns: int) -> int:
        """UTC of a monotonic instant, ns."""
        return monotonic_ns + self.utc_minus_monotonic_ns

    def step_ns(self) -> int:
        """Return by how much the system's clock was set since the start."""
        return utc_minus_monotonic_ns() + self.moved_ns - self.utc_minus_monotonic_ns

    def why_moved(self) -> str:
        """Return what to report of a clock that stamps cannot hold; "" of any other."""
        why = log_time.why_fitted(self.utc_ns(time.monotonic_ns()) - self.moved_ns) if self.moved_ns else ""
        return why and f"the system's clock is wrong: {why}. Set it (`timedatectl set-time`) before the next recording"


def utc_minus_monotonic_ns() -> int:
    """System clock less monotonic clock; the least of a few readings, since this thread may be held up between two."""
    return min(time.time_ns() - time.monotonic_ns() for _ in range(_READINGS))
