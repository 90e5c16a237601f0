"""What the counter of S1 counts, and whether a unit began anew by it; no I/O, reads no clock.

The documents of the 440 and the 380 have it count packets. The 381 that was recorded, and the 383, count time, 65536 a
second, so that the counter wraps each second: whole seconds that are missing can't be seen in it, and at 1 Hz it says
nothing at all. Its step tells which it is. How many packets are missing is told by `clock.Clock`.
"""

import enum
import math

SPAN = 1 << 16
COUNTS_PER_SECOND = 65536
"""Where it counts time. Some drivers have 65535 for it; a unit that was recorded keeps to this exactly."""

# a step of time differs by so much from a packet's, as a part of it, where the loop of another unit is less regular
_TOLERANCE = 0.1
# a step over several packets is that of none where it is so far from whole ones; steps are rounded to whole counts
_IRREGULAR, _COUNTS = 0.02, 2.0
# of a unit's loop, on which each of its packets is, once so many were
_LOOP, _SURELY_ON_GRID = COUNTS_PER_SECOND / 100, 50
# so many packets in a row that are as far apart: the unit sends at another rate
_SLOWER, _SLOWER_IN_A_ROW = 1.5, 8
# who was silent for so long may be another by now
_ABSENT_S, _ABSENT_PERIODS = 1.0, 3.5
# no unit is up again sooner; and a host that was held up makes nobody begin anew
_LEAST_PAUSE_S, _LEAST_MISMATCH_S, _MOST_AHEAD_S = 0.05, 0.02, 0.1
# so much later than usual for so long: a line that was held up has caught up by then
_LATE_S, _LATE_FOR_S, _MOST_SKEW = 0.1, 3.0, 1e-3
_ONE_BY_ONE_S, _ONE_BY_ONE_PERIODS = 0.02, 1.5
# a count of packets that is so much ahead of the time of arrival, or behind it, is another's
_PACKETS_AHEAD_S, _PACKETS_BEHIND_S = 10.0, 0.5


class Meaning(enum.Enum):
    """What the counter counts."""

    UNKNOWN = "unknown"
    PACKETS = "packets"
    TIME = "time"


class CounterWatch:
    """Tells from each packet's counter whether the unit was reset, exchanged, or sends at another rate than asked.

    A unit of the family streams by itself from power-up on, at its own rate: nothing but the counter tells.

    `rate_hz`: packets a second, as the unit was told.
    Raises ValueError if `rate_hz` is not positive.
    `meaning`: what the counter counts, as far as it is known.
    """

    def __init__(self, rate_hz: float) -> None:
        if not rate_hz > 0.0:
            raise ValueError(f"`rate_hz` must be positive, not {rate_hz}")
        self.meaning = Meaning.UNKNOWN
        self._rate_hz = rate_hz
        self._period = COUNTS_PER_SECOND / rate_hz
        self._last: int | None = None
        self._in_time: int | None = None
        self._was_in_time = False
        self._step, self._alike = 0, 0
        self._on_grid = 0
        self._late_s = self._late_for_s = 0.0

    def began_anew(self, counter: int, elapsed_s: float | None) -> bool:
        """Take a packet; whether it does not go on where the last one was.

        `elapsed_s`: since the arrival of the last packet that had it, s; None if an arrival says nothing, since the
          host reads what came earlier.
        """
        last, self._last = self._last, counter
        in_time, follows = self._in_time, self._was_in_time
        self._was_in_time = elapsed_s is not None
        if self._was_in_time:
            self._in_time = counter
        if last is None or self._period >= SPAN:  # at 1 Hz a counter of time stands still
            return False
        step = (counter - last) % SPAN
        if self.meaning is Meaning.UNKNOWN:
            self._learn(step)
            return False
        if self.meaning is Meaning.TIME and self._is_other_rate(step):
            return True
        regular = self._on_grid >= _SURELY_ON_GRID
        self._on_grid = self._on_grid + 1 if _is_whole(step, _LOOP) else 0
        if elapsed_s is None or in_time is None:
            return False
        step = (counter - in_time) % SPAN
        if self.meaning is Meaning.PACKETS:
            return self._is_other_count(step, elapsed_s, follows=follows)
        # of a unit whose packets all are of whole loops, behind a pause: what a host or a line does changes no step
        if regular and elapsed_s > 1.0 / self._rate_hz + _LEAST_PAUSE_S and not _is_whole(step, _LOOP):
            return True
        return self._is_other_time(step, elapsed_s, follows=follows) or self._stays_late(step, elapsed_s)

    def _learn(self, step: int) -> None:
        if step == 1:  # as a time, no packet is so short
            self.meaning = Meaning.PACKETS
        elif self._is_next(step):
            self.meaning = Meaning.TIME

    def _is_next(self, step: int) -> bool:
        return abs(step - self._period) <= _TOLERANCE * self._period

    def _is_other_count(self, step: int, elapsed_s: float, *, follows: bool) -> bool:
        """As `_is_other_time`, of a counter of packets."""
        ahead_s = step / self._rate_hz - elapsed_s
        absent = follows and step > 1 and elapsed_s > self._absent_s
        return ahead_s > _PACKETS_AHEAD_S or (absent and ahead_s < -_PACKETS_BEHIND_S)

    def _is_other_rate(self, step: int) -> bool:
        """Whether packets come faster than the unit was told, or slower for long."""
        is_slower = step > _SLOWER * self._period and abs(step - self._step) <= _TOLERANCE * self._period
        self._step, self._alike = step, self._alike + 1 if is_slower else 0
        return 0 < step < (1.0 - _TOLERANCE) * self._period or self._alike >= _SLOWER_IN_A_ROW

    def _is_other_time(self, step: int, elapsed_s: float, *, follows: bool) -> bool:
        """Whether no unit that goes on could have its counter there.

        `step` and `elapsed_s` are since the last packet that was read in time; `follows` if none was read since. One
        that began anew has its counter among those of whole packets in one case of twenty-five.
        """
        if elapsed_s <= _LEAST_PAUSE_S or (follows and self._is_next(step)):
            return False
        if follows and elapsed_s > self._absent_s:
            return True
        if _is_whole(step, self._period):
            # whole packets: a line that was held up, perhaps again and again, delivers them whenever it does
            return False
        late_s = elapsed_s - step / COUNTS_PER_SECOND
        return late_s < -_MOST_AHEAD_S or abs(math.remainder(late_s, 1.0)) > _LEAST_MISMATCH_S

    def _stays_late(self, step: int, elapsed_s: float) -> bool:
        """Whether packets that come one by one are late for long: once a line is not held up any more, none is.

        `step` and `elapsed_s` as for `_is_other_time`.
        """
        # more than the least so far, which follows what the two clocks differ by; whole seconds do not show
        late_s = self._late_s + elapsed_s - step / COUNTS_PER_SECOND
        self._late_s = (late_s + _MOST_AHEAD_S) % 1.0 - _MOST_AHEAD_S
        self._late_s = max(0.0, self._late_s - _MOST_SKEW * elapsed_s)
        # of a burst that a line kept back only the last counts
        took_s = min(elapsed_s, _ONE_BY_ONE_S + _ONE_BY_ONE_PERIODS / self._rate_hz)
        self._late_for_s = self._late_for_s + took_s if self._late_s > _LATE_S else 0.0
        return self._late_for_s > max(_LATE_FOR_S, _SLOWER_IN_A_ROW / self._rate_hz)

    @property
    def _absent_s(self) -> float:
        return max(_ABSENT_S, _ABSENT_PERIODS / self._rate_hz)


def _is_whole(step: int, of: float) -> bool:
    """Whether a step is a multiple of another, but for rounding and a little."""
    return abs(math.remainder(step, of)) <= max(_IRREGULAR * of, _COUNTS)
