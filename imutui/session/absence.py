"""Whether the unit is away, for how long and what is being waited for; and what is said of it, then and afterwards."""

import math
import time
from dataclasses import replace

from imutui.instrument.clock import Gap, Stamp
from imutui.session.packet_stamps import gap_text
from imutui.session.reconnection import LineLost, LineReturned, StillAway
from imutui.session.snapshot import ReconnectingSnapshot
from imutui.session.timebase import Timebase

# the unit's own rate is known to less than a percent
_FASTEST = 1.01


class Absence:
    """Follows what the reader says of the line.

    `timebase`: monotonic to UTC.
    `rate_hz`: packets a second that would have come: the unit's own rate, or that of the requests.
    `since_ns`: when the last packet was read, monotonic; None while the unit is there.
    """

    def __init__(self, timebase: Timebase, rate_hz: float) -> None:
        self.since_ns: int | None = None
        self._timebase = timebase
        self._rate_hz = rate_hz
        self._waits_for = ""
        self._said: set[str] = set()
        self._found = ""

    def lost(self, event: LineLost) -> str:
        """The line is lost; returns what to say."""
        if self.since_ns is None:
            self.since_ns = event.since_ns
            self._said.clear()
        self._waits_for = "the same unit to come back"
        return f"{event.message} The acquisition goes on and waits for the same unit."

    def still(self, event: StillAway) -> str | None:
        """Something else is waited for; returns what to say, once of each unit that is refused."""
        self._waits_for = event.waits_for
        if not event.refused or event.waits_for in self._said:
            return None
        self._said.add(event.waits_for)
        return f"refused: {event.waits_for}"

    def returned(self, event: LineReturned, before_ns: int) -> None:
        """The unit is back; its first packet is awaited to say more. `before_ns` is the last stamp before."""
        self.since_ns = before_ns
        self._found = event.found

    def over(self, stamp: Stamp) -> str | None:
        """A packet has come; returns what to say if it is the first one after the unit was away."""
        if not self._found or self.since_ns is None:
            return None
        before_ns, found = self.since_ns, self._found
        self.since_ns, self._found = None, ""
        if stamp.gap is None:
            seconds = (stamp.monotonic_ns - before_ns) / 1e9
            stamp = replace(stamp, gap=Gap(seconds, 0, math.floor(seconds * self._rate_hz * _FASTEST)))
        between = f"{_utc(self._timebase, before_ns)} to {_utc(self._timebase, stamp.monotonic_ns)} UTC"
        return f"{gap_text(stamp)}, {between}; the unit is back: {found}"

    def snapshot(self, now_ns: int) -> ReconnectingSnapshot | None:
        """For viewers; None while the unit is there."""
        if self.since_ns is None:
            return None
        return {"seconds": (now_ns - self.since_ns) / 1e9, "waits_for": self._waits_for}

    def at_the_end(self, now_ns: int) -> str | None:
        """What to say if the acquisition ends without the unit; None if it is there."""
        if self.since_ns is None:
            return None
        last, away_s = _utc(self._timebase, self.since_ns), (now_ns - self.since_ns) / 1e9
        return (
            f"the unit was gone at the end: its last packet came at {last} UTC, {away_s:.0f} s before; waited for"
            f" {self._waits_for}. What came is recorded and the file is finished."
        )


def _utc(timebase: Timebase, monotonic_ns: int) -> str:
    utc_ns = timebase.utc_ns(monotonic_ns)
    return f"{time.strftime('%H:%M:%S', time.gmtime(utc_ns // 1_000_000_000))}.{utc_ns // 1_000_000 % 1000:03d}"
