"""Motions of an axis of a table: check them against limits, and recognise when the axis has reached them.

No link and no clock. Angles are in deg, times in s. Angles are unwrapped: they continue through whole turns.

Limits come from the controller or from the operator; the narrower one counts. A path never leaves the limits, and an
axis must always have room to stop: with the acceleration of its own motion, which its drive brakes with, after the lag
of the table and the latency of the link. An axis outside its limits may move back towards them, and no farther out.
"""

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Literal, TypeAlias

from filters.errors import InputError
from filters.motion.profile import Profile
from filters.motion.segments import AXES, Dwell, Rate, Sampled, Segment

OFF: Final = "off"
POSITION: Final = "position"
RATE: Final = "rate"
OSCILLATION: Final = "oscillation"
MODES = (OFF, POSITION, RATE, OSCILLATION)
"""Modes of an axis, the least active first."""
RESTS_DPS = 0.01
"""An axis that is slower than this stands still."""
LAG_S = 0.1
"""Time by which an axis is behind the reference of its drive, if the controller does not report its jerk."""
SETTLED_DEG, SETTLED_S = 0.02, 1.0
"""A move is there when its axis has been so near to its angle, and has stood still, for so long."""
_STANDS_DPS = 1.0  # an axis that is slower than this may be sent to an angle
_OVER_S = 2.0  # one second until a rate is recognised, and one until its end is sent
_EPSILON = 1e-6  # deg: a smaller angle of a missing axis is zero
_RATE_S, _RATE_SHARE, _RATE_DPS = 0.3, 0.01, 0.05  # a mean rate over so long is reached within a share, or so much
_SWINGS, _PERIODS = 0.9, 3.0  # a swing is there at this share of its amplitude, or after so many periods at half of it
_LIMITS = 'such as "inner=200/100, outer=30/50/-90/90": deg/s, deg/s^2, and of an axis with stops low and high deg'


# --------------------------------------------------------------------------------------------------------------- limits


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Limits of an axis, as the controller reports them or the operator gives them."""

    rate_dps: float  # positive
    accel_dps2: float  # positive
    low_deg: float | None  # low_deg, high_deg: None: the axis turns without end
    high_deg: float | None
    lag_s: float = LAG_S  # by which the axis follows its drive's reference, its jerk included

    @property
    def ends(self) -> tuple[float, float]:
        """Lowest and highest angle, deg; infinite where the axis has no stop."""
        low = -math.inf if self.low_deg is None else self.low_deg
        return low, math.inf if self.high_deg is None else self.high_deg

    @property
    def has_stops(self) -> bool:
        """True if the axis has a stop on either side."""
        return self.low_deg is not None or self.high_deg is not None

    def narrowed(self, other: "AxisLimits") -> "AxisLimits":
        """Return the narrower of two limits."""
        return AxisLimits(
            min(self.rate_dps, other.rate_dps),
            min(self.accel_dps2, other.accel_dps2),
            max((low for low in (self.low_deg, other.low_deg) if low is not None), default=None),
            min((high for high in (self.high_deg, other.high_deg) if high is not None), default=None),
            max(self.lag_s, other.lag_s),
        )

    def reaching(self, angle_deg: float) -> "AxisLimits":
        """Return the limits widened to the angle of an axis that is outside them, so that it may move back."""
        low = None if self.low_deg is None else min(self.low_deg, angle_deg)
        high = None if self.high_deg is None else max(self.high_deg, angle_deg)
        return replace(self, low_deg=low, high_deg=high)

    def off(self, angle_deg: float, target_deg: float) -> float:
        """Return how far an angle is from another, deg; whole turns count only where the axis has stops."""
        off = angle_deg - target_deg
        return off if self.has_stops else math.remainder(off, 360.0)

    def check(self, axis: str, *, rate_dps: float, accel_dps2: float, angles_deg: Iterable[float] = ()) -> None:
        """Raise InputError if a rate of either sign, an acceleration or an angle is beyond the limits of an axis."""
        for what, asked, most, unit in (
            ("rate", abs(rate_dps), self.rate_dps, "deg/s"),
            ("acceleration", accel_dps2, self.accel_dps2, "deg/s^2"),
        ):
            if not 0.0 <= asked <= most:
                raise InputError(f"the {axis} axis is asked for a {what} of {asked:g} {unit}; its limit is {most:g}")
        if not accel_dps2 > 0.0:
            raise InputError(f"the {axis} axis is asked for an acceleration of {accel_dps2:g}; it must be positive")
        low, high = self.ends
        for angle in angles_deg:
            if not (math.isfinite(angle) and low <= angle <= high):
                raise InputError(
                    f"the {axis} axis is asked for {angle:g} deg; its limits are {low:g} to {high:g} deg. Nothing was"
                    " sent"
                )


Limits: TypeAlias = Mapping[str, AxisLimits]
"""By the name of the axis."""


def parse_limits(text: str) -> dict[str, AxisLimits]:
    """Return the limits that an operator gives; raises InputError that shows how they are written."""
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


def narrower(read: Limits, given: Limits) -> dict[str, AxisLimits]:
    """Return the limits of each axis of which the controller or the operator gives some."""
    both = {axis: [limits[axis] for limits in (read, given) if axis in limits] for axis in AXES}
    return {axis: own[0].narrowed(own[-1]) for axis, own in both.items() if own}


def limits_of(axis: str, limits: Limits) -> AxisLimits:
    """Return the limits of an axis that is to be moved.

    Raises InputError if the table has no such axis, or none are known.
    """
    if axis not in AXES:
        raise InputError(f'`axis` is "{axis}", not one of: {", ".join(AXES)}')
    if axis not in limits:
        raise InputError(
            f"the table has no {axis} axis, or the controller does not say its limits: give them, {_LIMITS}"
        )
    return limits[axis]


# ------------------------------------------------------------------------------------------------------------- readings


@dataclass(frozen=True, slots=True)
class TableState:
    """The axes as a controller reports them: outer, middle, inner; an axis that the table lacks is at 0.0."""

    stamp_ns: int  # host's monotonic time, half-way between question and answer
    uncertainty_ns: int  # half of the time between
    angles_deg: tuple[float, float, float]  # from the keeper on unwrapped
    rates_dps: tuple[float, float, float]
    mode: str  # one of MODES, the most active one of the axes
    fault: str  # in words; "" where there is none


class Readings:
    """Readings since motions were commanded, as far back as shows whether they are there."""

    def __init__(self) -> None:
        self._states: deque[TableState] = deque()
        self._begun_ns, self._keep_s = 0, 0.0

    def begin(self, now_ns: int, motions: "Iterable[Motion]") -> None:
        """Forget earlier readings: motions are commanded now."""
        self._states.clear()
        self._begun_ns, self._keep_s = now_ns, 1.5 * max((motion.seen_s for motion in motions), default=SETTLED_S)

    def add(self, states: Iterable[TableState]) -> None:
        """Add readings, the newest last."""
        self._states += states
        while self._states and self._states[0].stamp_ns < self._states[-1].stamp_ns - self._keep_s * 1e9:
            self._states.popleft()

    @property
    def passed_s(self) -> float:
        """Time from the command to the newest reading."""
        return (self._states[-1].stamp_ns - self._begun_ns) / 1e9 if self._states else 0.0

    def last(self, axis: str, seconds: float) -> tuple[list[float], list[float]]:
        """Return angles and rates of an axis in the last seconds; none if the readings do not go back so far."""
        states, k = self._states, AXES.index(axis)
        if not states or (states[-1].stamp_ns - states[0].stamp_ns) / 1e9 < seconds:
            return [], []
        since_ns = states[-1].stamp_ns - seconds * 1e9
        last = [state for state in states if state.stamp_ns >= since_ns]
        return [state.angles_deg[k] for state in last], [state.rates_dps[k] for state in last]

    def stands(self, axis: str) -> bool:
        """Return whether an axis rests; one that swings has a mean rate of zero, and angles that differ."""
        angles, rates = self.last(axis, SETTLED_S / 2.0)
        return bool(rates) and abs(_mean(rates)) < RESTS_DPS and max(angles) - min(angles) < SETTLED_DEG


# -------------------------------------------------------------------------------------------------------------- motions


@dataclass(frozen=True, slots=True)
class Begin:
    """An axis when a motion begins."""

    angle_deg: float
    rate_dps: float = 0.0
    brakes_dps2: float = 0.0  # acceleration that its drive brakes with; 0.0: its mode is off
    late_s: float = 0.0  # from the decision to stop until the drive has the command, at most
    centre_deg: float | None = None  # of its present swing


@dataclass(frozen=True, slots=True)
class Move:
    """An axis goes to an angle and rests there; an axis without stops goes the short way."""

    seen_s: ClassVar[float] = SETTLED_S  # readings over so long show whether the motion is there
    axis: str
    angle_deg: float
    rate_dps: float  # no faster than this
    accel_dps2: float
    mode: Literal["position"] = POSITION

    def check(self, begin: Begin, limits: Limits) -> None:
        """Refuse a move whose path leaves the limits; raises InputError."""
        own = limits_of(self.axis, limits)
        target = self.end_deg(begin, limits)
        own.check(self.axis, rate_dps=self.rate_dps, accel_dps2=self.accel_dps2, angles_deg=[target])
        if not self.rate_dps > 0.0:
            raise InputError(f"the {self.axis} axis is asked to move at {self.rate_dps:g} deg/s; it must be positive")
        _refuse_while_it_turns(self.axis, begin)
        _check_room(self, begin, own, begin.rate_dps)

    def end_deg(self, begin: Begin, limits: Limits) -> float:
        """Return the unwrapped angle at which the motion ends."""
        own = limits_of(self.axis, limits)
        return self.angle_deg if own.has_stops else begin.angle_deg - own.off(begin.angle_deg, self.angle_deg)

    def legs(self, begin: Begin, limits: Limits, longest_deg: float) -> "list[Move]":
        """Return the moves that make up this one, each of at most so many degrees."""
        way = self.end_deg(begin, limits) - begin.angle_deg
        count = max(1, math.ceil(abs(way) / longest_deg))
        ends = [begin.angle_deg + way * n / count for n in range(1, count)] + [begin.angle_deg + way]
        return [replace(self, angle_deg=end) for end in ends]

    def takes_s(self, begin: Begin) -> float:
        """Return the time until the motion is there, at most."""
        return abs(self.angle_deg - begin.angle_deg) / self.rate_dps + self.rate_dps / self.accel_dps2 + SETTLED_S

    def is_there(self, readings: Readings, limits: Limits) -> bool:
        """Return whether the readings show the motion that was asked for."""
        angles, _ = readings.last(self.axis, SETTLED_S)
        near = (abs(limits[self.axis].off(angle, self.angle_deg)) < SETTLED_DEG for angle in angles)
        return bool(angles) and all(near) and readings.stands(self.axis)

    def ended(self) -> "Motion | None":
        """Return the motion that brings the axis to rest; None if it comes to rest by itself."""
        return None


@dataclass(frozen=True, slots=True)
class Turn:
    """An axis changes from its present rate to another, of either sign; at zero it rests."""

    seen_s: ClassVar[float] = SETTLED_S
    axis: str
    rate_dps: float
    accel_dps2: float
    mode: Literal["rate"] = RATE

    def check(self, begin: Begin, limits: Limits) -> None:
        """Refuse a rate from which the axis can't stop within its limits; raises InputError.

        A rate that only slows an axis down, no more gently than it brakes already, is never refused.
        """
        own, turns = limits_of(self.axis, limits), begin.rate_dps
        own.check(self.axis, rate_dps=self.rate_dps, accel_dps2=self.accel_dps2)
        slows = abs(self.rate_dps) <= abs(turns) and self.rate_dps * turns >= 0.0
        if slows and 0.0 < begin.brakes_dps2 <= self.accel_dps2:
            return
        for rate in (self.rate_dps, turns):
            _check_room(self, begin, own, rate)

    def takes_s(self, begin: Begin) -> float:
        return abs(self.rate_dps - begin.rate_dps) / self.accel_dps2 + SETTLED_S

    def is_there(self, readings: Readings, limits: Limits) -> bool:
        if not self.rate_dps:
            return readings.stands(self.axis)
        _, rates = readings.last(self.axis, _RATE_S)
        return bool(rates) and abs(_mean(rates) - self.rate_dps) < max(_RATE_DPS, _RATE_SHARE * abs(self.rate_dps))

    def ended(self) -> "Motion | None":
        return replace(self, rate_dps=0.0)


@dataclass(frozen=True, slots=True)
class Swing:
    """An axis swings about where it is; an amplitude of zero ends the swing."""

    axis: str
    amplitude_deg: float
    hz: float
    accel_dps2: float  # that its drive brakes with when it is stopped
    mode: Literal["oscillation"] = OSCILLATION

    @property
    def peak_dps(self) -> float:
        """Largest rate of the swing."""
        return self.amplitude_deg * 2.0 * math.pi * self.hz

    @property
    def peak_dps2(self) -> float:
        """Largest acceleration of the swing."""
        return self.peak_dps * 2.0 * math.pi * self.hz

    @property
    def seen_s(self) -> float:
        """Readings over so long show that the motion is there."""
        return max(SETTLED_S, 1.0 / self.hz)

    def check(self, begin: Begin, limits: Limits) -> None:
        """Refuse a swing beyond the limits; raises InputError.

        An axis that swings already may go on about its centre, or about where it is. A swing that is stopped stays
        within its ends, since it brakes no more gently than it swings.
        """
        own = limits_of(self.axis, limits)
        size, hz = self.amplitude_deg, self.hz
        if begin.centre_deg is None:
            _refuse_while_it_turns(self.axis, begin)
        if not (math.isfinite(size) and size >= 0.0 and math.isfinite(hz) and hz > 0.0):
            raise InputError(f"`amplitude_deg` is {size} and `hz` {hz}, not a size and a frequency")
        centres = {begin.angle_deg, begin.angle_deg if begin.centre_deg is None else begin.centre_deg}
        ends = [centre + side * size for centre in centres for side in (-1.0, 1.0)]
        own.check(self.axis, rate_dps=self.peak_dps, accel_dps2=max(self.accel_dps2, self.peak_dps2), angles_deg=ends)
        if self.peak_dps2 > self.accel_dps2:
            raise InputError(f"the {self.axis} axis swings with {self.peak_dps2:g} deg/s^2 and brakes more gently")

    def takes_s(self, begin: Begin) -> float:
        return _PERIODS / self.hz + SETTLED_S

    def is_there(self, readings: Readings, limits: Limits) -> bool:
        if not self.amplitude_deg:
            return readings.stands(self.axis)
        angles, _ = readings.last(self.axis, 1.0 / self.hz)
        share = (max(angles) - min(angles)) / (2.0 * self.amplitude_deg) if angles else 0.0
        return share > _SWINGS or (share > 0.5 and readings.passed_s > _PERIODS / self.hz)

    def ended(self) -> "Motion | None":
        return replace(self, amplitude_deg=0.0)


Motion: TypeAlias = Move | Turn | Swing


def braking_deg(rate_dps: float, accel_dps2: float, late_s: float = 0.0) -> float:
    """Return the way of an axis until it rests, deg; `late_s`: time before it begins to brake."""
    return abs(rate_dps) * late_s + rate_dps**2 / (2.0 * accel_dps2)


def _refuse_while_it_turns(axis: str, begin: Begin) -> None:
    if abs(begin.rate_dps) > _STANDS_DPS:
        raise InputError(f"the {axis} axis turns, at {begin.rate_dps:.2f} deg/s; have it stand first: a rate of zero")


def _check_room(motion: Motion, begin: Begin, limits: AxisLimits, rate_dps: float) -> None:
    """Refuse a rate whose way until the axis rests leaves the limits; raises InputError."""
    low, high = limits.ends
    room = high - begin.angle_deg if rate_dps > 0.0 else begin.angle_deg - low
    way = braking_deg(rate_dps, motion.accel_dps2, limits.lag_s + begin.late_s)
    if abs(rate_dps) > RESTS_DPS and way > room:
        raise InputError(
            f"the {motion.axis} axis at {rate_dps:g} deg/s turns by {way:.1f} deg until it stands, at"
            f" {motion.accel_dps2:g} deg/s^2, with the lags of link and table; it has {max(room, 0.0):.1f} deg to its"
            " limit. Nothing was sent"
        )


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


# ------------------------------------------------------------------------------------------------------------- profiles


def _degrees(angle: float) -> float:
    """Convert an angle or a rate from radians, without the rounding of the conversion."""
    return round(math.degrees(angle), 9)


def of_segment(segment: Segment, profile: Profile, limits: Limits) -> tuple[Motion, ...]:
    """Return the motions of a profile's segment, which all begin at once; moves have the pace of the slowest axis.

    Raises InputError if a controller can't be commanded so, or the table has no such axis.
    """
    rate, accel = _degrees(profile.slew), _degrees(profile.accel)
    if isinstance(segment, Dwell):
        angles = dict(zip(AXES, map(_degrees, segment.angles), strict=True))
        wanted = [axis for axis, angle in angles.items() if axis in limits or abs(angle) > _EPSILON]
        every = [limits_of(axis, limits) for axis in wanted]
        rate = min([rate, *(own.rate_dps for own in every)])
        accel = min([accel, *(own.accel_dps2 for own in every)])
        return tuple(Move(axis, angles[axis], rate, accel) for axis in wanted)
    if isinstance(segment, Sampled):
        raise InputError("a controller is commanded by dwells, rates and sines; this is a row of angles")
    own = limits_of(segment.axis, limits)
    if isinstance(segment, Rate):
        return (Turn(segment.axis, _degrees(segment.rate), min(accel, own.accel_dps2)),)
    return (Swing(segment.axis, _degrees(segment.amplitude), segment.hz, own.accel_dps2),)


def check_profile(profile: Profile, limits: Limits, begin_deg: Sequence[float]) -> None:
    """Refuse a profile of which any motion goes beyond the limits, from the table's angles at its beginning, (3,).

    Raises InputError that names the segment, counted from 1.
    """
    angles = dict(zip(AXES, begin_deg, strict=True))
    for number, segment in enumerate(profile.segments, 1):
        try:
            for motion in of_segment(segment, profile, limits):
                begin = Begin(angles[motion.axis], late_s=_OVER_S)
                reach = {motion.axis: limits[motion.axis].reaching(begin.angle_deg)}
                if isinstance(motion, Move):
                    angles[motion.axis] = motion.end_deg(begin, limits)
                elif isinstance(motion, Turn) and isinstance(segment, Rate):  # looked at from when it has its rate on
                    ramp = math.copysign(braking_deg(motion.rate_dps, motion.accel_dps2), motion.rate_dps)
                    begin = Begin(begin.angle_deg + ramp, motion.rate_dps, late_s=_OVER_S + segment.seconds)
                    angles[motion.axis] = begin.angle_deg + motion.rate_dps * segment.seconds + ramp
                motion.check(begin, reach)
        except InputError as error:
            raise InputError(f"segment {number} of the profile: {error}. Nothing was moved.") from error
