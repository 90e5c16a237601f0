"""The only place that knows limits, paths and braking room of a table: no link, no clock.

Limits come from the controller or from the operator; the narrower one counts. The gate checks a command before the
keeper sends it, a profile before it begins, and each reading against the last command.

Angles are unwrapped: they go on through whole turns. A path may never leave the limits, and an axis must always have
room to stop: with the acceleration of its own command, which its drive brakes with, after the lag of the table and the
latency of the link. An axis outside its limits may move back towards them, and no farther out.
"""

import math
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from filters.errors import InputError
from filters.motion.profile import Profile
from filters.motion.segments import AXES, Dwell, Rate, Sampled, Sine
from imutui.table.controller import RESTS_DPS, AxisLimits, TableState

FOLLOW_DEG, FOLLOW_S = 0.5, 1.0
"""How far, and for how long, angles may be off what limits of rate and acceleration explain."""
# a link of 40 ms a command, three axes, and an acceleration that begins gently: angles may be so late, s
_LATE_S = 0.25
# what a rate's own error adds up to is forgotten over so many seconds
_FORGET_S = 20.0
_BEYOND_RATE = 1.1, 1.0  # share, deg/s: faster than its limit by so much is out of control
_EPSILON = 1e-6  # deg: no way to go
# a controller that counts modulo 360 takes the short way: no command may ask for half a turn
_LEG_DEG = 170.0
_STANDS_DPS = 1.0  # an axis that is slower than this may be sent to an angle
_LINES = 8  # that the link carries from the check of a rate to the first reading after it
_OVER_S = 2.0  # a second each for a rate to be recognised, and for its end to be sent
_LIMITS = 'such as "inner=200/100, outer=30/50/-90/90": deg/s, deg/s^2, and of an axis with stops low and high deg'


def parse_limits(text: str) -> dict[str, AxisLimits]:
    """Limits as an operator gives them; raises InputError that shows how they are written."""
    found = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        axis, _, numbers = part.partition("=")
        try:
            values = [float(number) for number in numbers.split("/")]
        except ValueError:
            values = []
        is_whole = len(values) in (2, 4) and all(map(math.isfinite, values)) and min(values[:2], default=0.0) > 0.0
        if axis.strip() not in AXES or not is_whole or (len(values) == 4 and values[2] >= values[3]):
            raise InputError(f'`limits` has "{part}"; they are written {_LIMITS}')
        low, high = values[2:] or (None, None)
        found[axis.strip()] = AxisLimits(values[0], values[1], low, high)
    return found


def narrower(read: Mapping[str, AxisLimits], given: Mapping[str, AxisLimits]) -> dict[str, AxisLimits]:
    """Limits of each axis of which some are known."""
    return {
        axis: _both(*[limits[axis] for limits in (read, given) if axis in limits])
        for axis in AXES
        if axis in read or axis in given
    }


def _both(one: AxisLimits, other: AxisLimits | None = None) -> AxisLimits:
    if other is None:
        return one
    lows = [low for low in (one.low_deg, other.low_deg) if low is not None]
    highs = [high for high in (one.high_deg, other.high_deg) if high is not None]
    return AxisLimits(
        min(one.rate_dps, other.rate_dps),
        min(one.accel_dps2, other.accel_dps2),
        max(lows, default=None),
        min(highs, default=None),
        max(one.lag_s, other.lag_s),
    )


def to_angle(now_deg: float, angle_deg: float, limits: AxisLimits) -> float:
    """Return the unwrapped angle that a command asks for; an axis without stops takes the short way."""
    if limits.has_stops:
        return angle_deg
    return now_deg + math.remainder(angle_deg - now_deg, 360.0)


def legs(now_deg: float, target_deg: float) -> list[float]:
    """Return the angles to go to one after the other, so that the short way to each is the way wanted."""
    count = max(1, math.ceil(abs(target_deg - now_deg) / _LEG_DEG))
    return [now_deg + (target_deg - now_deg) * n / count for n in range(1, count)] + [target_deg]


def _reaching(limits: AxisLimits, angle_deg: float) -> AxisLimits:
    """Return the limits widened to the angle of an axis that is outside them, so that it may move back."""
    low = None if limits.low_deg is None else min(limits.low_deg, angle_deg)
    high = None if limits.high_deg is None else max(limits.high_deg, angle_deg)
    return replace(limits, low_deg=low, high_deg=high)


def pace(profile: Profile, limits: Mapping[str, AxisLimits]) -> dict[str, tuple[float, float]]:
    """Return rate (deg/s) and acceleration (deg/s²) that a profile commands each axis with."""
    slew, accel = in_degrees(profile.slew), in_degrees(profile.accel)
    return {axis: (min(slew, own.rate_dps), min(accel, own.accel_dps2)) for axis, own in limits.items()}


def limits_of(axis: str, limits: Mapping[str, AxisLimits]) -> AxisLimits:
    """Limits of an axis that is to be moved; raises InputError if the table has no such axis, or none are known."""
    if axis not in AXES:
        raise InputError(f'`axis` is "{axis}", not one of: {", ".join(AXES)}')
    if axis not in limits:
        raise InputError(
            f"the table has no {axis} axis, or the controller does not say its limits: give them, {_LIMITS}"
        )
    return limits[axis]


def check_swing(axis: str, about_deg: float, limits: AxisLimits, amplitude_deg: float, hz: float) -> None:
    """Refuse an oscillation about an angle that goes beyond limits; raises InputError.

    A swing that is stopped stays within its ends: its drive then brakes with the limit's acceleration, which is no less
    than that of the swing.
    """
    if not (math.isfinite(amplitude_deg) and amplitude_deg >= 0.0 and math.isfinite(hz) and hz > 0.0):
        raise InputError(f"`amplitude_deg` is {amplitude_deg} and `hz` {hz}, not a size and a frequency")
    omega = 2.0 * math.pi * hz
    rate, accel = amplitude_deg * omega, amplitude_deg * omega**2
    for angle in (about_deg - amplitude_deg, about_deg + amplitude_deg):
        limits.check(axis, angle_deg=angle, rate_dps=rate, accel_dps2=accel)


def in_degrees(angle: float) -> float:
    """Convert an angle or a rate from radians, without the rounding of the conversion."""
    return round(math.degrees(angle), 9)


def braking_deg(rate_dps: float, accel_dps2: float, late_s: float = 0.0) -> float:
    """Return the way of an axis until it rests, deg.

    `accel_dps2`: acceleration that its drive brakes with, which is that of its last command.
    `late_s`: time before it begins to brake.
    """
    return abs(rate_dps) * late_s + rate_dps**2 / (2.0 * accel_dps2)


def _check_turn(axis: str, now: float, limits: AxisLimits, rate_dps: float, way_deg: float, accel_dps2: float) -> None:
    """Refuse a turn whose way leaves limits; raises InputError."""
    low, high = limits.ends
    room = high - now if rate_dps > 0.0 else now - low
    if way_deg > room:
        raise InputError(
            f"the {axis} axis at {rate_dps:g} deg/s turns by {way_deg:.1f} deg until it stands, at {accel_dps2:g}"
            f" deg/s^2, with the lags of link and table; it has {max(room, 0.0):.1f} deg to its limit. Nothing was sent"
        )


def check_profile(profile: Profile, limits: Mapping[str, AxisLimits], begin_deg: Sequence[float]) -> None:
    """Refuse a profile of which any part would go beyond limits, from the table's angles at its beginning, (3,).

    Moves between dwells are no faster than limits allow. A rate is reached and left with the profile's acceleration.
    Raises InputError that names the segment, counted from 1.
    """
    angles, paces = dict(zip(AXES, begin_deg, strict=True)), pace(profile, limits)
    for number, segment in enumerate(profile.segments, 1):
        try:
            match segment:
                case Dwell():
                    for axis, angle in zip(AXES, map(in_degrees, segment.angles), strict=True):
                        if axis in limits:
                            angles[axis] = to_angle(angles[axis], angle, limits[axis])
                            limits[axis].check(axis, angle_deg=angles[axis])
                        elif abs(angle) > _EPSILON:
                            limits_of(axis, limits)
                case Rate():
                    own, rate = limits_of(segment.axis, limits), in_degrees(segment.rate)
                    own.check(segment.axis, rate_dps=rate)
                    begin, accel = angles[segment.axis], paces[segment.axis][1]
                    ramps = 2.0 * braking_deg(rate, accel)
                    longest = ramps + abs(rate) * (segment.seconds + _OVER_S + own.lag_s)
                    _check_turn(segment.axis, begin, _reaching(own, begin), rate, longest, accel)
                    angles[segment.axis] += math.copysign(ramps + abs(rate) * segment.seconds, rate)
                case Sine():
                    own, begin = limits_of(segment.axis, limits), angles[segment.axis]
                    check_swing(segment.axis, begin, own, in_degrees(segment.amplitude), segment.hz)
                case Sampled():
                    raise InputError("a controller is commanded by dwells, rates and sines; this is a row of angles")
        except InputError as error:
            raise InputError(f"segment {number} of the profile: {error}. Nothing was moved.") from error


@dataclass(slots=True)
class _Expected:
    """Where an axis should be since a command; deg, s."""

    mode: str
    since_s: float
    angle: float
    rate: float = 0.0
    target: float = 0.0  # angle or rate
    accel: float = 1.0
    hz: float = 0.0
    late_s: float = _LATE_S
    has_its_rate: bool = False  # of a constant rate: its change is over, and the axis was seen to follow it
    off_since_s: float | None = None

    def at(self, t_s: float) -> tuple[float, float]:
        """Angle and rate, of a motion that begins gently by no more than `late_s`."""
        t = max(0.0, t_s - self.since_s)
        if self.mode == "rate":
            ramp_s = abs(self.target - self.rate) / self.accel
            a = math.copysign(self.accel, self.target - self.rate)
            on = min(t, ramp_s)
            rate = self.target if t >= ramp_s else self.rate + a * t
            return self.angle + self.rate * on + a * on * on / 2.0 + self.target * max(0.0, t - ramp_s), rate
        far = abs(self.target - self.angle)
        if self.mode != "position" or far < _EPSILON:
            return (self.target if self.mode == "position" else self.angle), 0.0
        peak = min(self.rate, math.sqrt(far * self.accel))
        ramp_s = peak / self.accel
        whole_s = far / peak + ramp_s
        if t < ramp_s:
            gone, rate = self.accel * t * t / 2.0, self.accel * t
        elif t < whole_s - ramp_s:
            gone, rate = peak * (t - ramp_s / 2.0), peak
        else:
            left = max(0.0, whole_s - t)
            gone, rate = far - self.accel * left * left / 2.0, self.accel * left
        way = math.copysign(1.0, self.target - self.angle)
        return self.angle + way * gone, way * rate


@dataclass(slots=True)
class Follower:
    """Checks commands against the newest reading, and readings against the commands.

    `slack`: how much more patience than usual: the times that time runs faster.
    `wraps`: axes that the controller counts modulo 360.
    `angles_deg`: angles of all axes, unwrapped.
    """

    limits: Mapping[str, AxisLimits]
    slack: float = 1.0
    wraps: Collection[str] = AXES
    angles_deg: list[float] = field(default_factory=list)
    rates_dps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mode: str = "off"  # that was commanded last
    must_stop_s: float = math.inf  # time by which a stop must be sent if no other reading comes, monotonic
    _expected: dict[str, _Expected] = field(default_factory=dict)
    _brakes: dict[str, float] = field(default_factory=dict)  # acceleration that an axis brakes with, deg/s²
    _reach: dict[str, AxisLimits] = field(default_factory=dict)  # limits, widened to an axis outside them
    _link_s: float = 0.0  # from a question to its answer, the longest of late
    _swung: dict[str, deque[tuple[float, float]]] = field(default_factory=dict)
    _other_mode_since_s: float | None = None

    @property
    def _late_s(self) -> float:
        return _LATE_S * self.slack

    def path(self, axis: str, angle_deg: float, rate_dps: float, accel_dps2: float) -> list[float]:
        """Return angles to send an axis to, one after the other; raises InputError if the path leaves its limits."""
        own, k = limits_of(axis, self.limits), AXES.index(axis)
        now, turns = self.angles_deg[k], self.rates_dps[k]
        target = to_angle(now, angle_deg, own)
        self._reach[axis].check(axis, angle_deg=target, rate_dps=rate_dps, accel_dps2=accel_dps2)
        if not (rate_dps > 0.0 and accel_dps2 > 0.0):
            raise InputError(f"`rate_dps` is {rate_dps:g} and `accel_dps2` {accel_dps2:g}; both must be positive")
        if abs(turns) > _STANDS_DPS:
            raise InputError(f"the {axis} axis turns still; have it stand first: a rate of zero")
        if abs(turns) > RESTS_DPS:
            way = braking_deg(turns, accel_dps2, own.lag_s + self._late_s)
            _check_turn(axis, now, self._reach[axis], turns, way, accel_dps2)
        return legs(now, target) if own.has_stops and axis in self.wraps else [target]

    def check_rate(self, axis: str, rate_dps: float, accel_dps2: float) -> None:
        """Refuse a rate from which an axis cannot stop within its limits; raises InputError.

        A rate that only slows an axis down, no more gently than it brakes already, is never refused.
        """
        own, k = limits_of(axis, self.limits), AXES.index(axis)
        own.check(axis, rate_dps=rate_dps, accel_dps2=accel_dps2)
        if not accel_dps2 > 0.0:
            raise InputError(f"`accel_dps2` is {accel_dps2:g}; it must be positive")
        now, turns = self.angles_deg[k], self.rates_dps[k]
        slows = abs(rate_dps) <= abs(turns) and rate_dps * turns >= 0.0
        if slows and self.mode != "off" and accel_dps2 >= self._braking(axis):
            return
        late_s = own.lag_s + self._late_s + (2 + _LINES) * self._link_s
        for way in (rate_dps, turns):
            if abs(way) > RESTS_DPS:
                _check_turn(axis, now, self._reach[axis], way, braking_deg(way, accel_dps2, late_s), accel_dps2)

    def check_swing(self, axis: str, amplitude_deg: float, hz: float) -> None:
        """Refuse an oscillation that leaves the limits of an axis; raises InputError.

        One that swings already may go on about its centre, or about where it is.
        """
        limits_of(axis, self.limits)
        for about in (self.angles_deg[AXES.index(axis)], self._centre(axis)):
            check_swing(axis, about, self._reach[axis], amplitude_deg, hz)

    def _centre(self, axis: str) -> float:
        before = self._expected.get(axis)
        return before.angle if before and before.mode == "oscillation" else self.angles_deg[AXES.index(axis)]

    def _braking(self, axis: str) -> float:
        return self._brakes.get(axis, self.limits[axis].accel_dps2)

    def braking_s(self) -> float:
        """Return the time after which all axes rest if they begin to brake now, at most."""
        of = [(abs(self.rates_dps[AXES.index(axis)]), own, self._braking(axis)) for axis, own in self.limits.items()]
        return max((rate / accel + own.lag_s + self._late_s for rate, own, accel in of), default=0.0)

    def commanded(
        self, axis: str, mode: str, t_s: float, target: float, speed: float = 0.0, accel: float = 1.0,
        *, took_s: float = 0.0,
    ) -> None:  # fmt: skip
        """Take a command: `target` angle, rate, or amplitude; `speed` of a move, or frequency of an oscillation.

        The axis may have begun at any time from `t_s` on that the command `took_s` to be sent.
        """
        k = AXES.index(axis)
        rate = self.rates_dps[k] if mode == "rate" else speed
        angle = self._centre(axis) if mode == "oscillation" else self.angles_deg[k]
        self._expected[axis] = _Expected(mode, t_s, angle, rate, target, accel, speed, self._late_s + took_s)
        self._brakes[axis] = self.limits[axis].accel_dps2 if mode == "oscillation" else accel
        self._swung[axis] = deque()
        self.mode = mode

    def is_there(self, axis: str, angle_deg: float) -> bool:
        """Return whether an axis rests at an angle."""
        k = AXES.index(axis)
        return abs(self.angles_deg[k] - angle_deg) < FOLLOW_DEG and abs(self.rates_dps[k]) < RESTS_DPS

    def stopped(self) -> None:
        """Forget the commands: the table stands."""
        self.mode, self.must_stop_s = "off", math.inf
        self._expected.clear()

    def wrong(self, state: TableState) -> str:
        """Take a reading; returns how it disagrees with the commands, in words, or ""."""
        t_s = state.stamp_ns / 1e9
        self._take(state)
        if state.fault:
            return f"the controller says: {state.fault}"
        if self.mode == "off":
            return ""
        self.must_stop_s = math.inf
        for k, axis in enumerate(AXES):
            if axis in self.limits and (said := self._out_of_control(axis, k, t_s) or self._strays(axis, k, t_s)):
                return said
        return self._left_mode(state.mode, t_s)

    def _take(self, state: TableState) -> None:
        before = self.angles_deg or [self._first(axis) for axis in AXES]
        self.angles_deg = [
            was + math.remainder(angle - was, 360.0) if axis in self.wraps else angle
            for axis, was, angle in zip(AXES, before, state.angles_deg, strict=True)
        ]
        self.rates_dps = state.rates_dps
        self._link_s = max(0.95 * self._link_s, 2e-9 * state.uncertainty_ns)
        for axis, own in self.limits.items():
            now = _reaching(own, self.angles_deg[AXES.index(axis)])
            # an axis that comes back from beyond its limits does not go there again
            was = self._reach.get(axis, now) if self.mode != "off" else now
            self._reach[axis] = _both(was, now)

    def _first(self, axis: str) -> float:
        """Return the angle that the first reading of an axis is the nearest turn to: the middle of its limits."""
        low, high = self.limits[axis].ends if axis in self.limits else (-math.inf, math.inf)
        return (low + high) / 2.0 if math.isfinite(low) and math.isfinite(high) else 0.0

    def _out_of_control(self, axis: str, k: int, t_s: float) -> str:
        limits, angle, rate = self.limits[axis], self.angles_deg[k], self.rates_dps[k]
        low, high = self._reach[axis].ends
        if not low - FOLLOW_DEG <= angle <= high + FOLLOW_DEG:
            return f"{axis} is at {angle:.2f}°, beyond its limits"
        if abs(rate) > _BEYOND_RATE[0] * limits.rate_dps + _BEYOND_RATE[1]:
            return f"{axis} turns at {rate:.1f} deg/s, above its limit of {limits.rate_dps:g} deg/s"
        expected = self._expected.get(axis)
        if expected is None or expected.mode != "rate" or not expected.target:
            return ""
        late_s, accel = limits.lag_s + self._late_s + 2.0 * self._link_s, self._braking(axis)
        for way, room in ((1.0, high - angle), (-1.0, angle - low)):
            # its drive may be ahead of it on the way to the rate commanded, and goes on there until a stop comes
            turns = max(way * rate, 0.0)
            fastest = max(turns, min(way * expected.target, turns + accel * late_s))
            if fastest < RESTS_DPS or math.isinf(room):
                continue
            spare_s = (room - braking_deg(fastest, accel, late_s)) / fastest
            if spare_s <= 0.0:
                return f"{axis} at {rate:+.1f} deg/s comes to its limit: it is at {angle:.1f}°"
            self.must_stop_s = min(self.must_stop_s, t_s + spare_s + self._late_s / 2.0)
        return ""

    def _strays(self, axis: str, k: int, t_s: float) -> str:
        expected = self._expected.get(axis)
        if expected is None:
            return ""
        angle = self.angles_deg[k]
        if expected.mode == "oscillation":
            return self._stands_still(axis, expected, angle, t_s)
        should, rate = expected.at(t_s)
        fastest = max(abs(rate), abs(expected.at(t_s - expected.late_s)[1]))
        if expected.mode == "rate" and not expected.has_its_rate:
            fastest = max(abs(expected.rate), abs(expected.target))
        if abs(angle - should) <= FOLLOW_DEG + expected.late_s * fastest:
            expected.off_since_s = None
            if expected.mode == "rate":
                self._forget(expected, angle, t_s)
            return ""
        expected.off_since_s = t_s if expected.off_since_s is None else expected.off_since_s
        if t_s - expected.off_since_s < FOLLOW_S * self.slack:
            return ""
        return f"{axis} does not follow: it is at {angle:.2f}° and should be at {should:.2f}° for {FOLLOW_S:g} s"

    @staticmethod
    def _forget(expected: _Expected, angle: float, t_s: float) -> None:
        """Draw what is expected of a constant rate to where the axis is, so that a scale error does not add up.

        What the axis was late by when its rate changed is forgotten at once, when the change is over.
        """
        ramp_s = abs(expected.target - expected.rate) / expected.accel
        if t_s - expected.since_s <= ramp_s + FOLLOW_S:
            return
        should, _ = expected.at(t_s)
        share = min(1.0, (t_s - expected.since_s) / _FORGET_S) if expected.has_its_rate else 1.0
        expected.angle, expected.rate = should + share * (angle - should), expected.target
        expected.since_s, expected.has_its_rate = t_s, True

    def _stands_still(self, axis: str, expected: _Expected, angle: float, t_s: float) -> str:
        """Of an oscillation its size is known, not its phase."""
        amplitude, period_s = expected.target, 1.0 / expected.hz
        swung = self._swung[axis]
        swung.append((t_s, angle))
        while swung[0][0] < t_s - max(period_s, FOLLOW_S):
            swung.popleft()
        if amplitude and abs(angle - expected.angle) > amplitude + FOLLOW_DEG + self._late_s * amplitude:
            return f"{axis} swings to {angle:.2f}°, farther than the {amplitude:g}° commanded"
        if t_s - expected.since_s < period_s + 2.0 * FOLLOW_S or amplitude < FOLLOW_DEG:
            return ""
        span = max(value for _, value in swung) - min(value for _, value in swung)
        if span >= amplitude:
            return ""
        return f"{axis} does not follow: it swings by ±{span / 2.0:.2f}° of ±{amplitude:g}°"

    def _left_mode(self, mode: str, t_s: float) -> str:
        if mode != "off":
            self._other_mode_since_s = None
            return ""
        since_s = self._other_mode_since_s = self._other_mode_since_s or t_s
        if t_s - since_s < FOLLOW_S * self.slack:
            return ""
        return f"the controller has left the mode {self.mode} by itself and is off"
