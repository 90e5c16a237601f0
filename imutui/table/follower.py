"""Compares readings of a table with the motions that were commanded. No link and no clock.

The follower has the last motion of each axis and the time at which it was commanded, and unwraps the controller's
angles. It checks the next motion from where the axis is.
"""

import math
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, field

from filters.motion.profile import Profile
from filters.motion.segments import AXES, Dwell, Rate, Segment
from imutui.table.motion import (
    OFF,
    RESTS_DPS,
    AxisLimits,
    Begin,
    Limits,
    Motion,
    Move,
    Swing,
    TableState,
    Turn,
    braking_deg,
    limits_of,
)

FOLLOW_DEG, FOLLOW_S = 0.5, 1.0
"""Angles may be off the expected ones by so much, or by more for so long."""
_LATE_S = 0.25  # delay of angles: a link of 40 ms a command, three axes, an acceleration that begins gently
_FORGET_S = 20.0  # an angle that the error of a rate has added up is forgotten within this time
_BEYOND_RATE = 1.1, 1.0  # share of the limit of rate, and deg/s more: an axis that is faster is out of control
_LEG_DEG = 170.0  # a controller that counts modulo 360 goes the short way: a leg is less than half a turn
_LINES = 8  # that the link carries from the check of a rate to the first reading after it
_LEAD = Dwell((0.0, 0.0, 0.0), 1.0)  # rest with which an expected motion begins
_FOR_EVER_S = 1e9


class Expected:
    """Angle and rate that an axis should have after a motion was commanded.

    `begin`: the axis at that time, `since_s`. The motion may begin up to `late_s` later.
    """

    def __init__(self, motion: Move | Turn, begin: Begin, since_s: float, late_s: float) -> None:
        self.motion, self.begin, self.since_s, self.late_s = motion, begin, since_s, late_s
        self.turns_dps = begin.rate_dps if isinstance(motion, Turn) else 0.0  # the profile is added to it
        self.forgot_s: float | None = None  # time of the last reading that an axis at constant rate was brought to
        self.off_since_s: float | None = None
        self.angle_deg = begin.angle_deg  # the profile is relative to it
        segment: Segment = _LEAD
        if isinstance(motion, Move):
            segment = Dwell((0.0, 0.0, math.radians(motion.angle_deg - begin.angle_deg)), _FOR_EVER_S)
        elif motion.rate_dps != begin.rate_dps:
            segment = Rate("inner", math.radians(motion.rate_dps - begin.rate_dps), _FOR_EVER_S)
        slew = motion.rate_dps if isinstance(motion, Move) else 1.0
        self._profile = Profile((_LEAD, segment), slew=math.radians(slew), accel=math.radians(motion.accel_dps2))
        self._piece, self._cubic = (math.inf, 0.0), [0.0] * 4

    def at(self, t_s: float) -> tuple[float, float]:
        """Return angle and rate at a time."""
        since = max(0.0, t_s - self.since_s)
        x = since + _LEAD.seconds
        if not self._piece[0] <= x < self._piece[1]:  # looking at the profile takes 20 times as long
            start, end, cubics = self._profile.piece(x)
            self._piece = start, end
            self._cubic = [math.degrees(inner) for _, _, inner in cubics]
        x, (a, b, c, d) = x - self._piece[0], self._cubic
        angle, rate = ((d * x + c) * x + b) * x + a, (3.0 * d * x + 2.0 * c) * x + b
        return self.angle_deg + self.turns_dps * since + angle, self.turns_dps + rate

    def forget(self, angle_deg: float, t_s: float) -> None:
        """Draw the expected angle of a constant rate to where the axis is, so that a scale error does not add up.

        The lag of a change of rate is forgotten at once, when the change is over.
        """
        motion = self.motion
        if not isinstance(motion, Turn):
            return
        if self.forgot_s is None:
            ramp_s = abs(motion.rate_dps - self.begin.rate_dps) / motion.accel_dps2
            if t_s - self.since_s <= ramp_s + FOLLOW_S:
                return
        elif t_s - self.forgot_s <= FOLLOW_S:
            return
        share = 1.0 if self.forgot_s is None else min(1.0, (t_s - self.forgot_s) / _FORGET_S)
        self.angle_deg += share * (angle_deg - self.at(t_s)[0])
        self.forgot_s = t_s

    def strays(self, angle_deg: float, t_s: float) -> str:
        """Take an angle of the axis; returns in words how it does not follow, or ""."""
        should, rate = self.at(t_s)
        fastest = max(abs(rate), abs(self.at(t_s - self.late_s)[1]))
        if isinstance(self.motion, Turn) and self.forgot_s is None:
            fastest = max(abs(self.turns_dps), abs(self.motion.rate_dps))
        if abs(angle_deg - should) <= FOLLOW_DEG + self.late_s * fastest:
            self.off_since_s = None
            self.forget(angle_deg, t_s)
            return ""
        self.off_since_s = t_s if self.off_since_s is None else self.off_since_s
        if t_s - self.off_since_s < FOLLOW_S:
            return ""
        axis = self.motion.axis
        return f"{axis} does not follow: it is at {angle_deg:.2f}° and should be at {should:.2f}° for {FOLLOW_S:g} s"


class ExpectedSwing:
    """An axis that should swing; its amplitude is known, not its phase."""

    def __init__(self, motion: Swing, begin: Begin, since_s: float) -> None:
        self.motion, self.since_s = motion, since_s
        self.centre_deg = begin.angle_deg if begin.centre_deg is None else begin.centre_deg
        self._swung = deque[tuple[float, float]]()

    def strays(self, angle_deg: float, t_s: float) -> str:
        """Take an angle of the axis; returns in words how it does not follow, or ""."""
        axis, amplitude, period_s = self.motion.axis, self.motion.amplitude_deg, 1.0 / self.motion.hz
        self._swung.append((t_s, angle_deg))
        while self._swung[0][0] < t_s - max(period_s, FOLLOW_S):
            self._swung.popleft()
        if amplitude and abs(angle_deg - self.centre_deg) > amplitude + FOLLOW_DEG + _LATE_S * amplitude:
            return f"{axis} swings to {angle_deg:.2f}°, farther than the {amplitude:g}° commanded"
        if t_s - self.since_s < period_s + 2.0 * FOLLOW_S or amplitude < FOLLOW_DEG:
            return ""
        span = max(value for _, value in self._swung) - min(value for _, value in self._swung)
        if span >= amplitude:
            return ""
        return f"{axis} does not follow: it swings by ±{span / 2.0:.2f}° of ±{amplitude:g}°"


@dataclass(slots=True)
class Follower:
    """Checks motions from where the axes are, and readings against the motions.

    `wraps`: axes that the controller counts modulo 360.
    `angles_deg`: angles of all axes, unwrapped.
    """

    limits: Limits
    wraps: Collection[str] = AXES
    angles_deg: list[float] = field(default_factory=list)
    mode: str = OFF  # that was commanded last
    must_stop_s: float = math.inf  # time by which a stop must be sent if no other reading comes, monotonic
    _rates_dps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    _expected: dict[str, Expected | ExpectedSwing] = field(default_factory=dict)
    _brakes: dict[str, float] = field(default_factory=dict)  # acceleration that an axis brakes with, deg/s²
    _reach: dict[str, AxisLimits] = field(default_factory=dict)  # limits, widened to an axis outside them
    _link_s: float = 0.0  # from a question to its answer, the longest of late
    _other_mode_since_s: float | None = None

    def _begin(self, axis: str) -> Begin:
        k, before = AXES.index(axis), self._expected.get(axis)
        return Begin(
            self.angles_deg[k],
            self._rates_dps[k],
            0.0 if self.mode == OFF else self._braking(axis),
            _LATE_S + (2 + _LINES) * self._link_s,
            before.centre_deg if isinstance(before, ExpectedSwing) else None,
        )

    def check(self, motion: Motion) -> None:
        """Refuse a motion from where its axis is now if it goes beyond the limits; raises InputError."""
        limits_of(motion.axis, self.limits)
        motion.check(self._begin(motion.axis), self._reach)

    def legs(self, motion: Motion) -> list[Motion]:
        """Return the legs of a motion, to be commanded in turn; a long move between stops has several."""
        if isinstance(motion, Move):
            count_turns = self.limits[motion.axis].has_stops and motion.axis in self.wraps
            return [*motion.legs(self._begin(motion.axis), self.limits, _LEG_DEG if count_turns else math.inf)]
        return [motion]

    def begin(self, motion: Motion, since_s: float, took_s: float = 0.0) -> None:
        """Expect a motion that was commanded; it began at any time while the command was sent."""
        begin = self._begin(motion.axis)
        self._expected[motion.axis] = (
            ExpectedSwing(motion, begin, since_s)
            if isinstance(motion, Swing)
            else Expected(motion, begin, since_s, _LATE_S + took_s)
        )
        self._brakes[motion.axis] = motion.accel_dps2
        self.mode = motion.mode

    def has_passed(self, leg: Motion) -> bool:
        """Return whether the axis rests at the end of a leg."""
        k = AXES.index(leg.axis)
        near = isinstance(leg, Move) and abs(self.angles_deg[k] - leg.angle_deg) < FOLLOW_DEG
        return near and abs(self._rates_dps[k]) < RESTS_DPS

    def stopped(self) -> None:
        """Forget the motions: the table stands."""
        self.mode, self.must_stop_s = OFF, math.inf
        self._expected.clear()

    def _braking(self, axis: str) -> float:
        return self._brakes.get(axis, self.limits[axis].accel_dps2)

    def braking_s(self) -> float:
        """Return the time after which all axes rest if they begin to brake now, at most."""
        of = [(abs(self._rates_dps[AXES.index(axis)]), own, self._braking(axis)) for axis, own in self.limits.items()]
        return max((rate / accel + own.lag_s + _LATE_S for rate, own, accel in of), default=0.0)

    def wrong(self, state: TableState) -> str:
        """Take a reading; returns in words how it disagrees with the motions, or ""."""
        t_s = state.stamp_ns / 1e9
        self._take(state)
        if state.fault:
            return f"the controller says: {state.fault}"
        if self.mode == OFF:
            return ""
        self.must_stop_s = math.inf
        for axis in filter(self.limits.__contains__, AXES):
            expected, k = self._expected.get(axis), AXES.index(axis)
            said = self._out_of_control(axis, k, t_s)
            if not said and expected is not None:
                said = expected.strays(self.angles_deg[k], t_s)
            if said:
                return said
        return self._left_mode(state.mode, t_s)

    def _take(self, state: TableState) -> None:
        before = self.angles_deg or [self._first(axis) for axis in AXES]
        self.angles_deg = [
            was + math.remainder(angle - was, 360.0) if axis in self.wraps else angle
            for axis, was, angle in zip(AXES, before, state.angles_deg, strict=True)
        ]
        self._rates_dps = state.rates_dps
        self._link_s = max(0.95 * self._link_s, 2e-9 * state.uncertainty_ns)
        for axis, own in self.limits.items():
            now = own.reaching(self.angles_deg[AXES.index(axis)])
            # an axis that comes back from beyond its limits does not go there again
            was = self._reach.get(axis, now) if self.mode != OFF else now
            self._reach[axis] = was.narrowed(now)

    def _first(self, axis: str) -> float:
        """Return the angle that the first reading of an axis is the nearest turn to: the middle of its limits."""
        low, high = self.limits[axis].ends if axis in self.limits else (-math.inf, math.inf)
        return (low + high) / 2.0 if math.isfinite(low) and math.isfinite(high) else 0.0

    def _out_of_control(self, axis: str, k: int, t_s: float) -> str:
        limits, angle, rate = self.limits[axis], self.angles_deg[k], self._rates_dps[k]
        low, high = self._reach[axis].ends
        if not low - FOLLOW_DEG <= angle <= high + FOLLOW_DEG:
            return f"{axis} is at {angle:.2f}°, beyond its limits"
        if abs(rate) > _BEYOND_RATE[0] * limits.rate_dps + _BEYOND_RATE[1]:
            return f"{axis} turns at {rate:.1f} deg/s, above its limit of {limits.rate_dps:g} deg/s"
        expected = self._expected.get(axis)
        motion = None if expected is None else expected.motion
        if not isinstance(motion, Turn) or not motion.rate_dps:
            return ""
        late_s, accel = limits.lag_s + _LATE_S + 2.0 * self._link_s, self._braking(axis)
        for way, room in ((1.0, high - angle), (-1.0, angle - low)):
            # its drive may be ahead of it on the way to the rate commanded, and goes on there until a stop comes
            turns = max(way * rate, 0.0)
            fastest = max(turns, min(way * motion.rate_dps, turns + accel * late_s))
            if fastest < RESTS_DPS or math.isinf(room):
                continue
            spare_s = (room - braking_deg(fastest, accel, late_s)) / fastest
            if spare_s <= 0.0:
                return f"{axis} at {rate:+.1f} deg/s comes to its limit: it is at {angle:.1f}°"
            self.must_stop_s = min(self.must_stop_s, t_s + spare_s + _LATE_S / 2.0)
        return ""

    def _left_mode(self, mode: str, t_s: float) -> str:
        if mode != OFF:
            self._other_mode_since_s = None
            return ""
        since_s = self._other_mode_since_s = self._other_mode_since_s or t_s
        if t_s - since_s < FOLLOW_S:
            return ""
        return f"the controller has left the mode {self.mode} by itself and is off"
