"""Detect from the counter of S1 that a unit was reset or exchanged; no I/O, reads no clock.

The counter of a 381 and a 383 counts time, 65536 a second, so that it wraps each second: missing whole seconds do not
show in it, and at 1 Hz it is useless. Documents of the 440 and the 380 have it count packets: such a counter is not
used. `clock.Clock` counts the packets that are missing.
"""

import math

from imutui.instrument.counter_spec import SPAN

COUNTS_PER_SECOND = 65536
"""Some drivers use 65535; a unit that was recorded keeps to this exactly."""

# tolerance of a single step, as a part of it: the loop of some units is less regular
_TOLERANCE = 0.1
# tolerance of a multiple, as a part of the step that it is a multiple of, and in counts: steps are rounded to counts
_IRREGULAR, _COUNTS = 0.02, 2.0
# the unit's loop: after so many packets on its grid, all are expected there
_LOOP, _SURELY_ON_GRID = COUNTS_PER_SECOND / 100, 50
# so many packets in a row that are as far apart show another rate
_SLOWER, _SLOWER_IN_A_ROW = 1.5, 8
# after this much silence the unit may have been replaced
_ABSENT_S, _ABSENT_PERIODS = 1.0, 3.5
# no unit is up again sooner
_LEAST_PAUSE_S = 0.05
# difference between counter and arrival behind a pause that no line explains
_LEAST_MISMATCH_S = 0.02
# the least late packet so far may have been late by so much
_MOST_AHEAD_S = 0.1
# packets that are later than usual by so much for so long are not late: a line that was held up has caught up by then
_LATE_S, _LATE_FOR_S, _MOST_SKEW = 0.1, 3.0, 1e-3
_ONE_BY_ONE_S, _ONE_BY_ONE_PERIODS = 0.02, 1.5


class CounterWatch:
    """Asks of each packet of a stream whether it goes on where the last one was.

    A unit of the family streams from power-up on, at its own rate: only the counter shows that it was reset, exchanged,
    or sends at another rate than asked.

    `rate_hz`: packets a second that the host asked for.
    Raises ValueError if `rate_hz` is not positive.
    """

    def __init__(self, rate_hz: float) -> None:
        if not rate_hz > 0.0:
            raise ValueError(f"`rate_hz` must be positive, not {rate_hz}")
        self._rate_hz = rate_hz
        self._period = COUNTS_PER_SECOND / rate_hz
        self._absent_s = max(_ABSENT_S, _ABSENT_PERIODS / rate_hz)
        self._runs = False  # True once a step was that of the next packet
        self._last: int | None = None
        self._in_time: int | None = None  # counter of the last packet that was read in time
        self._was_in_time = False
        self._step, self._alike = 0, 0
        self._on_grid = 0
        self._late_s = self._late_for_s = 0.0

    def began_anew(self, counter: int, elapsed_s: float | None) -> bool:
        """Take a packet; return True if it does not go on where the last one was.

        `elapsed_s`: since the arrival of the last packet that had it, s; None if the arrival is of no use, since the
          host reads late.
        """
        last, self._last = self._last, counter
        in_time, follows = self._in_time, self._was_in_time
        self._was_in_time = elapsed_s is not None
        if self._was_in_time:
            self._in_time = counter
        if last is None or self._period >= SPAN:  # at 1 Hz the counter stands still
            return False
        step = (counter - last) % SPAN
        if not self._runs:
            self._runs = self._is_next(step)
            return False
        if self._is_other_rate(step):
            return True
        regular = self._on_grid >= _SURELY_ON_GRID
        self._on_grid = self._on_grid + 1 if _is_whole(step, _LOOP) else 0
        if elapsed_s is None or in_time is None:
            return False
        step = (counter - in_time) % SPAN
        late_s = self._lateness(step, elapsed_s)
        if regular and elapsed_s > 1.0 / self._rate_hz + _LEAST_PAUSE_S and not _is_whole(step, _LOOP):
            # a host or a line that is held up changes no step
            return True
        if elapsed_s <= _LEAST_PAUSE_S or (follows and self._is_next(step)):
            return self._stays_late(late_s, elapsed_s)
        absent = follows and elapsed_s > self._absent_s
        # a line that was held up, perhaps again and again, delivers whole packets at any time; one unit in twenty-five
        # that began anew has its counter there
        explained = _is_whole(step, self._period) or abs(math.remainder(late_s, 1.0)) <= _LEAST_MISMATCH_S
        return absent or not explained or self._stays_late(late_s, elapsed_s)

    def _is_next(self, step: int) -> bool:
        return abs(step - self._period) <= _TOLERANCE * self._period

    def _is_other_rate(self, step: int) -> bool:
        """Return True if packets come faster than the host asked, or slower for long."""
        is_slower = step > _SLOWER * self._period and abs(step - self._step) <= _TOLERANCE * self._period
        self._step, self._alike = step, self._alike + 1 if is_slower else 0
        return 0 < step < (1.0 - _TOLERANCE) * self._period or self._alike >= _SLOWER_IN_A_ROW

    def _lateness(self, step: int, elapsed_s: float) -> float:
        """Return how late a packet is against the least late so far, s, from -0.1 to 0.9: whole seconds do not show.

        The least late follows the difference between the two clocks. `step` and `elapsed_s` are since the last packet
        that was read in time.
        """
        late_s = self._late_s + elapsed_s - step / COUNTS_PER_SECOND
        late_s = (late_s + _MOST_AHEAD_S) % 1.0 - _MOST_AHEAD_S
        self._late_s = max(0.0, late_s - _MOST_SKEW * elapsed_s)
        return late_s

    def _stays_late(self, late_s: float, elapsed_s: float) -> bool:
        """Return True if packets that come one by one are late for long: a line in time brings none late."""
        # of a burst that a line kept back only the last counts
        took_s = min(elapsed_s, _ONE_BY_ONE_S + _ONE_BY_ONE_PERIODS / self._rate_hz)
        self._late_for_s = self._late_for_s + took_s if late_s > _LATE_S else 0.0
        return self._late_for_s > max(_LATE_FOR_S, _SLOWER_IN_A_ROW / self._rate_hz)


def _is_whole(step: int, of: float) -> bool:
    """Return True if a step is a multiple of another, within 2 % of that and 2 counts."""
    return abs(math.remainder(step, of)) <= max(_IRREGULAR * of, _COUNTS)
