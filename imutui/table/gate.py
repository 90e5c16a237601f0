"""What may be commanded of a table, and whether it does what it was commanded: no link, no clock.

Limits come from the controller or from the operator; where both say one, the narrower counts. A command is checked
before it is sent, a profile before it begins, and each reading against what the last command makes of it.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from filters.errors import InputError
from filters.motion.profile import Profile
from filters.motion.segments import AXES, Dwell, Rate, Sampled, Sine
from imutui.table.controller import AxisLimits, TableState

FOLLOW_DEG, FOLLOW_S = 0.5, 1.0
"""How far, and for how long, angles may be off what limits of rate and acceleration explain."""
# a link of 40 ms a command, three axes, and an acceleration that begins gently: angles may be so late, s
_LATE_S = 0.25
# what a rate's own error adds up to is forgotten over so many seconds
_FORGET_S = 20.0
_BEYOND_RATE = 1.1, 1.0  # share, deg/s: faster than its limit by so much is out of control
_EPSILON = 1e-6  # deg: no way to go
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
    )


def to_angle(now_deg: float, angle_deg: float, limits: AxisLimits) -> float:
    """Where an axis is to go, on its own count: one without stops takes the short way."""
    if limits.low_deg is not None or limits.high_deg is not None:
        return angle_deg
    return now_deg + math.remainder(angle_deg - now_deg, 360.0)


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
    """Refuse an oscillation about an angle that goes beyond limits; raises InputError."""
    if not (math.isfinite(amplitude_deg) and amplitude_deg >= 0.0 and math.isfinite(hz) and hz > 0.0):
        raise InputError(f"`amplitude_deg` is {amplitude_deg} and `hz` {hz}, not a size and a frequency")
    omega = 2.0 * math.pi * hz
    rate, accel = amplitude_deg * omega, amplitude_deg * omega**2
    for angle in (about_deg - amplitude_deg, about_deg + amplitude_deg):
        limits.check(axis, angle_deg=angle, rate_dps=rate, accel_dps2=accel)


def in_degrees(angle: float) -> float:
    """An angle, or a rate, of radians; without what the conversion itself adds."""
    return round(math.degrees(angle), 9)


def braking_deg(rate_dps: float, limits: AxisLimits) -> float:
    """What an axis turns on, from a rate until it stands."""
    return rate_dps**2 / (2.0 * limits.accel_dps2)


def check_profile(profile: Profile, limits: Mapping[str, AxisLimits], begin_deg: Sequence[float]) -> None:
    """Refuse a profile of which any part would go beyond limits, from the table's angles at its beginning, (3,).

    Moves between dwells are made no faster than limits allow; all else is as the profile has it.
    Raises InputError that names the segment, counted from 1.
    """
    angles = dict(zip(AXES, begin_deg, strict=True))
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
                    # a second each for the rate to be there, and for whoever ends it
                    turned = rate * (segment.seconds + 2.0) + math.copysign(2.0 * braking_deg(rate, own), rate)
                    angles[segment.axis] += turned
                    own.check(segment.axis, angle_deg=angles[segment.axis], rate_dps=rate)
                case Sine():
                    own = limits_of(segment.axis, limits)
                    check_swing(segment.axis, angles[segment.axis], own, in_degrees(segment.amplitude), segment.hz)
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
    """Compares readings with commands; `angles_deg` are the axes' own counts, on through whole turns."""

    limits: Mapping[str, AxisLimits]
    slack: float = 1.0  # how much more patience than usual: the times that time runs faster
    angles_deg: list[float] = field(default_factory=list)
    rates_dps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mode: str = "off"  # that was commanded last
    _expected: dict[str, _Expected] = field(default_factory=dict)
    _swung: dict[str, deque[tuple[float, float]]] = field(default_factory=dict)
    _other_mode_since_s: float | None = None

    @property
    def _late_s(self) -> float:
        return _LATE_S * self.slack

    def commanded(
        self, axis: str, mode: str, t_s: float, target: float, speed: float = 0.0, accel: float = 1.0,
        *, took_s: float = 0.0,
    ) -> None:  # fmt: skip
        """Take a command: `target` angle, rate, or amplitude; `speed` of a move, or frequency of an oscillation.

        The axis may have begun at any time from `t_s` on that the command `took_s` to be sent.
        """
        k = AXES.index(axis)
        rate = self.rates_dps[k] if mode == "rate" else speed
        self._expected[axis] = _Expected(
            mode, t_s, self.angles_deg[k], rate, target, accel, speed, self._late_s + took_s
        )
        self._swung[axis] = deque()
        self.mode = mode

    def stopped(self) -> None:
        """Expect nothing any more."""
        self.mode = "off"
        self._expected.clear()

    def wrong(self, state: TableState) -> str:
        """What is wrong with a reading, in words; "" of one that is as commanded."""
        t_s = state.stamp_ns / 1e9
        self._take(state)
        if state.fault:
            return f"the controller says: {state.fault}"
        if self.mode == "off":
            return ""
        for k, axis in enumerate(AXES):
            if axis in self.limits and (said := self._out_of_control(axis, k) or self._strays(axis, k, t_s)):
                return said
        return self._left_mode(state.mode, t_s)

    def _take(self, state: TableState) -> None:
        if not self.angles_deg:
            self.angles_deg = list(state.angles_deg)
        for k, angle in enumerate(state.angles_deg):
            self.angles_deg[k] += math.remainder(angle - self.angles_deg[k], 360.0)
        self.rates_dps = state.rates_dps

    def _out_of_control(self, axis: str, k: int) -> str:
        limits, angle, rate = self.limits[axis], self.angles_deg[k], self.rates_dps[k]
        low = -math.inf if limits.low_deg is None else limits.low_deg - FOLLOW_DEG
        high = math.inf if limits.high_deg is None else limits.high_deg + FOLLOW_DEG
        if not low <= angle <= high:
            return f"{axis} is at {angle:.2f}°, beyond its limits"
        if abs(rate) > _BEYOND_RATE[0] * limits.rate_dps + _BEYOND_RATE[1]:
            return f"{axis} turns at {rate:.1f} deg/s, above its limit of {limits.rate_dps:g} deg/s"
        expected = self._expected.get(axis)
        if expected is not None and expected.mode == "rate" and expected.target:
            ahead = angle + math.copysign(braking_deg(rate, limits), expected.target) + self._late_s * rate
            if not low <= ahead <= high:
                return f"{axis} at {rate:+.1f} deg/s comes to its limit: it is at {angle:.1f}°"
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
