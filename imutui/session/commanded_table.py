"""A table under the command of an acquisition, which goes through the segments of a profile.

A dwell begins when the table has settled, a rate when the axis turns at it, a sine when the axis swings. The keeper, a
process of its own, has the link and checks all motions; see `imutui.table.keeper`.
"""

import itertools
import time
from collections import deque
from collections.abc import Callable

from filters.errors import InputError
from filters.motion.profile import Profile
from filters.motion.segments import AXES, Segment
from imutui.instrument.driver import InstrumentError
from imutui.session.snapshot import ControllerSnapshot
from imutui.table.links import TableError
from imutui.table.messages import Command
from imutui.table.motion import OFF, Begin, Motion, Readings, TableState, check_profile, of_segment
from imutui.table.owner import KeptTable

_SETTLE_PATIENCE_S = 60.0
_MOVING = 0.1  # deg/s: a table that is faster is reported to move


class CommandedTable:
    """Commands a table through its keeper. `url`, `limits_text`, `starts`: those of `KeptTable`.

    A keeper that has ended, or was not started, is started when a profile is checked.
    Raises InstrumentError if there is no controller.
    """

    has_ramps = False  # a segment begins when the table has its rate

    def __init__(self, url: str, limits_text: str = "", *, starts: bool = True) -> None:
        self.lives: Callable[[], bool] = lambda: True  # returns whether the acquisition works
        self._url, self._limits_text = url, limits_text
        self._kept = self._begin(starts=starts)
        self._readings = Readings()
        self._steps: deque[tuple[Motion, ...]] = deque()  # motions that begin at once; the present ones first
        self._last: tuple[Motion, ...] = ()  # motions of the present segment
        self._counter = itertools.count(1)
        self._stops = self._seen_stops = 0  # stops that were asked for, and those before the table was enabled last
        self._until_ns = 0  # the present step must be done by then
        self.why_failed = ""  # why the table was stopped, if the operator must look at it

    def _begin(self, *, starts: bool) -> KeptTable:
        try:
            return KeptTable(self._url, self._limits_text, lambda: self.lives(), starts=starts)
        except TableError as error:
            raise InstrumentError(str(error)) from error

    @property
    def identity(self) -> str:
        """Identification of the controller."""
        return self._kept.identity

    def check(self, profile: Profile) -> None:
        """Raise InputError for a profile that goes beyond the table's limits; the message names the segment."""
        newest = self._kept.newest
        if self._kept.has_ended:
            try:
                self._kept = self._begin(starts=True)
            except InstrumentError as error:
                raise InputError(str(error)) from error
        check_profile(profile, self._kept.limits, (0.0,) * 3 if newest is None else newest.angles_deg)

    def enable(self) -> None:
        """Close the interlock; the user has allowed the table to move.

        Raises InputError if it does not close, or the keeper has ended.
        """
        try:
            self._seen_stops = self._stops
            self._kept.ask(Command("enable", stops=self._seen_stops))
        except TableError as error:
            raise InputError(str(error)) from error
        self.why_failed = ""

    def warn(self, why: str) -> None:
        """Add to the news why the table was stopped from here."""
        self._kept.news.append((why, True))

    # -- a profile's segments -----------------------------------------------------------------------------------------

    def _is_stopped(self) -> bool:
        """Return whether a stop was asked for since the table was enabled; if so, drop the steps.

        Any thread may ask for a stop; only the worker has steps.
        """
        if self._stops == self._seen_stops:
            return False
        self._steps.clear()
        self._last = ()
        return True

    def go(self, profile: Profile, segment: Segment, now_ns: int) -> None:
        """Begin to go to a segment; does nothing after a stop, until the table is enabled again.

        Raises InputError if a controller can't be commanded so.
        """
        if self._is_stopped():
            return
        motions = of_segment(segment, profile, self._kept.limits)
        ends = tuple(end for motion in self._last if (end := motion.ended()) is not None)
        self._steps += [step for step in (ends, motions) if step]
        self._last = motions
        self._send_first(now_ns)

    def _send_first(self, now_ns: int) -> None:
        step, newest = self._steps[0], self._kept.newest
        self._readings.begin(now_ns, step)
        takes_s = 0.0
        for motion in step:
            k = AXES.index(motion.axis)
            begin = Begin(0.0) if newest is None else Begin(newest.angles_deg[k], newest.rates_dps[k])
            takes_s = max(takes_s, motion.takes_s(begin))
        self._until_ns = now_ns + round((takes_s + _SETTLE_PATIENCE_S) * 1e9)
        # the keeper refuses a command that was decided on before a stop and arrives after it
        self._kept.send(Command("go", step, self._seen_stops))

    def has_arrived(self, now_ns: int) -> bool:
        """Return whether the segment that the table was sent to begins now; once."""
        step = self._steps[0] if self._steps else ()
        is_there = bool(step) and all(motion.is_there(self._readings, self._kept.limits) for motion in step)
        if self._is_stopped() or not is_there:
            return False
        self._steps.popleft()
        if self._steps:
            self._send_first(now_ns)
        return not self._steps

    def leave(self) -> None:
        """Stop: rate zero, then mode off; safe from any thread and signal."""
        self._stops = stops = next(self._counter)
        if self._kept.enabled and not self._kept.has_ended:
            self._kept.send(Command("stop", stops=stops))

    def close(self) -> None:
        """Stop, and close the link."""
        self._kept.close()

    # -- readings and news -------------------------------------------------------------------------------------------

    def take(self, now_ns: int) -> list[TableState]:
        """Return the readings since the last call; stops a table that has not arrived in time."""
        kept, found = self._kept, list[TableState]()
        while kept.states:
            found.append(kept.states.popleft())
        self._readings.add(found)
        if not self._is_stopped() and self._steps and now_ns > self._until_ns:
            self.leave()
            self.warn("the table does not come to rest where it was sent: stopped, rate zero and mode off")
        return found

    def news(self) -> list[tuple[str, bool]]:
        """Return the news since the last call, and whether each is a warning; after one the table does nothing new."""
        found = list[tuple[str, bool]]()
        while self._kept.news:
            found.append(self._kept.news.popleft())
        self.why_failed = next((text for text, is_warning in reversed(found) if is_warning), self.why_failed)
        return found

    @property
    def moves(self) -> bool:
        """True if the table moves under command, or is about to."""
        newest = self._kept.newest
        turns = newest is not None and newest.mode != OFF and max(map(abs, newest.rates_dps)) > _MOVING
        waits = self._stops == self._seen_stops and bool(self._steps or any(motion.ended() for motion in self._last))
        return self._kept.enabled and not self._kept.has_ended and (turns or waits)

    def snapshot(self, *, investigates: bool) -> ControllerSnapshot:
        """Return the table's part of a snapshot."""
        kept, newest = self._kept, self._kept.newest
        return {
            "url": kept.url,
            "identity": kept.identity,
            "axes": list(kept.axes),
            "angles_deg": None if newest is None else list(newest.angles_deg),
            "rates_dps": None if newest is None else list(newest.rates_dps),
            "mode": OFF if newest is None else newest.mode,
            "fault": "" if newest is None else newest.fault,
            "age_s": None if newest is None else (time.monotonic_ns() - newest.stamp_ns) / 1e9,
            "moves": self.moves,
            "error": kept.error,
            "investigates": investigates,
        }
