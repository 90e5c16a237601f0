"""The time of logs: UTC of a clock, in the range that the stamps of ROS can hold.

ROS counts the seconds of a stamp from 1970 on in 32 bits with a sign, and MCAP its nanoseconds without one. A clock
without a battery, or one that is set wrongly, may be before 1970 or after 2038-01-19. Such a time is moved by a whole
number of spans of 10,000 days, to a day between 2000 and 2027: the time of day stays, and so does the order of logs.
"""

import time
from dataclasses import dataclass

_S_NS = 1_000_000_000
_DAY_NS = 86_400 * _S_NS
LEAST_NS, MOST_NS = 60 * _S_NS, (2**31 - 1) * _S_NS
"""First and last time that a log may have, UTC, ns; what belongs to a first packet may be a little before it."""
_FROM_NS = 946_684_800 * _S_NS  # 2000-01-01
_SPAN_NS = 10_000 * _DAY_NS
_ROOM_NS = 366 * _DAY_NS
_READINGS = 5


def fitted_ns(utc_ns: int, room_ns: int = _ROOM_NS) -> int:
    """Return a time that a log can begin with and hold `room_ns` more, UTC, ns: the same one where that is possible."""
    if LEAST_NS <= utc_ns <= MOST_NS - room_ns:
        return utc_ns
    return _FROM_NS + (utc_ns - _FROM_NS) % _SPAN_NS


def now_ns() -> int:
    """Return the time of the system's clock, UTC, ns, as a log can hold it."""
    return fitted_ns(time.time_ns())


def why_fitted(utc_ns: int, room_ns: int = _ROOM_NS) -> str:
    """Return what to report of a time that a log can't begin with, and of the stamps instead; "" of any other."""
    fitted = fitted_ns(utc_ns, room_ns)
    if fitted == utc_ns:
        return ""
    days = (utc_ns - fitted) // _DAY_NS
    return (
        f"{_date(utc_ns)} is outside of what stamps of ROS hold (1970 to 2038-01-19), so the log is stamped"
        f" {_date(fitted)}: {abs(days)} days {'later' if days < 0 else 'earlier'}"
    )


def _date(utc_ns: int) -> str:
    return time.strftime("%Y-%m-%d", time.gmtime(utc_ns // _S_NS))


@dataclass(frozen=True, slots=True)
class Timebase:
    """UTC derived from the monotonic clock: setting the system's clock during a run does not move stamps.

    `moved_ns`: by how much the time of the start was moved into the range of logs.
    """

    utc_minus_monotonic_ns: int
    moved_ns: int = 0

    @classmethod
    def now(cls) -> "Timebase":
        """Take the time of the system's clock; one that stamps cannot hold is moved, see `fitted_ns`."""
        clock_ns, now_ns = utc_minus_monotonic_ns(), time.monotonic_ns()
        moved_ns = fitted_ns(clock_ns + now_ns) - (clock_ns + now_ns)
        return cls(clock_ns + moved_ns, moved_ns)

    def utc_ns(self, monotonic_ns: int) -> int:
        """Return the UTC of a monotonic instant, ns."""
        return monotonic_ns + self.utc_minus_monotonic_ns

    def step_ns(self) -> int:
        """Return by how much the system's clock was set since the start."""
        return utc_minus_monotonic_ns() + self.moved_ns - self.utc_minus_monotonic_ns

    def why_moved(self) -> str:
        """Return what to report of a clock that stamps cannot hold; "" of any other."""
        why = why_fitted(self.utc_ns(time.monotonic_ns()) - self.moved_ns) if self.moved_ns else ""
        return why and f"the system's clock is wrong: {why}. Set it (`timedatectl set-time`) before the next recording"


def utc_minus_monotonic_ns() -> int:
    """System clock less monotonic clock; the least of a few readings, since this thread may be held up between two."""
    return min(time.time_ns() - time.monotonic_ns() for _ in range(_READINGS))
