"""What can be done with a unit to see more of it: motions of the table, and temperatures to take it through.

Temperatures are relative to those that the runs at hand went through: their lowest is the room's, their highest that
of the warm unit. Rates go up to the largest observed, within what a table does. What it leaves out: which of them is
worth doing (`filters.tracing.experiment`).
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from filters.motion.profile import Profile
from filters.motion.segments import AXES, LEVEL, SIX, TWELVE, Dwell, Rate, Segment, Sine, positions, turns
from filters.tracing.result import Thermal
from filters.tracing.run import Run
from filters.tracing.stack import Stack
from filters.types import Array

STILL_HZ, MOVING_HZ, SWINGING_HZ = 2.0, 10.0, 20.0
"""Sample rates of a candidate: at rest, in motion, in fast motion."""

_SPAN = 10.0  # a temperature range worth going through, K
_RISE = 1.0  # what a cold start warms by at least, K
_WARM_UP, _WARM_UP_S = 6.0, 600.0  # of a cold start that was not observed, K and s
_REWARM, _REWARM_S = 0.15, 120.0  # of a warm restart: share of the range that is lost while off, s to come back
_RAMP_K_S, _RAMP_S, _SLOWER = 1.5 / 60.0, 300.0, 3.0  # ramps of a chamber: K/s, s at least, and a slow one's factor
_SOAK_S, _DWELL_S, _STILL_S = 120.0, 300.0, 1800.0
_FASTEST, _LEAST_FAST = 120.0, 60.0  # deg/s
_SWING_DEG, _SWING_HZ = 20.0, (0.3, 0.8)
_SWING = f"by {_SWING_DEG:.0f} deg at {_SWING_HZ[0]} and {_SWING_HZ[1]} Hz"
_POINTS = 31


@dataclass(frozen=True)
class CandidateMotion:
    """One run that can be made."""

    description: str  # what an operator does, without how long
    profile: Profile  # of the table
    thermal: Thermal | None  # temperature in the case, s and degC; None where no temperature is known
    chamber: bool = False  # whether it takes a thermal chamber: more than power and a room

    @property
    def seconds(self) -> float:
        """Duration of the run, s."""
        return self.profile.duration

    @property
    def still(self) -> bool:
        """Whether the table rests all the time."""
        return len(self.profile.segments) == 1

    @property
    def rate_hz(self) -> float:
        """Samples a second that show what happens."""
        if self.still:
            return STILL_HZ
        return SWINGING_HZ if any(isinstance(s, Sine) for s in self.profile.segments) else MOVING_HZ

    @property
    def instruction(self) -> str:
        """What an operator does, and for how long."""
        return f"{self.description}{', in a chamber' if self.chamber else ''}, {max(1, round(self.seconds / 60.0))} min"

    def run(self, like: Run) -> Run:
        """The candidate carried out by a unit like that of another run, without readings."""
        t = np.arange(round(self.seconds * self.rate_hz)) / self.rate_hz
        rows = t[:1] if self.still else t
        temperature = None
        if self.thermal is not None:
            temperature = np.interp(t, *np.array(self.thermal).T)
        angles, rates = self.profile.angles(rows), self.profile.rates(rows)
        return Run(
            name=self.description,
            t=t,
            reading=np.zeros((t.size, 6)),
            temperature=temperature,
            angles=angles,
            rates=rates,
            axes=like.axes,
            site=like.site,
            latency=like.latency,
        )


@dataclass(frozen=True)
class ObservedRange:
    """What the runs at hand went through."""

    # room, working: lowest and highest temperature, degC; NaN without temperature
    room: float
    working: float
    warm: float  # the highest of a candidate, degC, above the room's by 10 K at least
    start: Thermal  # temperature after a cold start, s and degC
    rate: float  # largest rate of an axis to ask for, rad/s

    @classmethod
    def of(cls, stack: Stack) -> "ObservedRange":
        """What the runs of a stack went through."""
        temperatures = [b.slow().temperature for b in stack.blocks]
        times = [b.t for b in stack.blocks]
        fastest = max(float(np.nanmax(np.abs(b.run.rates), initial=0.0)) for b in stack.blocks)
        rate = math.radians(10.0 * round(min(_FASTEST, max(_LEAST_FAST, math.degrees(fastest))) / 10.0))
        if not all(np.isfinite(T).all() for T in temperatures):
            return cls(math.nan, math.nan, math.nan, (), rate)
        room = min(float(T.min()) for T in temperatures)
        working = max(float(T.max()) for T in temperatures)
        warm = max(room + _SPAN, working)
        start = _cold_start(times, temperatures, room)
        return cls(round(room, 1), round(working, 1), round(warm, 1), start, rate)


def _cold_start(times: Sequence[Array], temperatures: Sequence[Array], room: float) -> Thermal:
    """The first run that warmed up by itself, or what such a run would be."""
    for t, T in zip(times, temperatures, strict=True):
        if T[-1] - T[0] > _RISE and T[0] <= T.min() + 0.1 * np.ptp(T):
            at = t[-1] * np.linspace(0.0, 1.0, _POINTS) ** 2
            return _points(at, np.interp(at, t, T))
    return _exponential(room + _WARM_UP, -_WARM_UP, _WARM_UP_S)


def _exponential(end: float, start: float, tau: float) -> Thermal:
    """From `start` off the end towards it."""
    at = _STILL_S * np.linspace(0.0, 1.0, _POINTS) ** 2
    return _points(at, end + start * np.exp(-at / tau))


def _points(t: Array, T: Array) -> Thermal:
    return tuple(zip(np.round(t, 1).tolist(), np.round(T, 3).tolist(), strict=True))


def candidates(observed: ObservedRange, moving: bool) -> list[CandidateMotion]:
    """All candidates.

    `observed`: what the runs at hand went through.
    `moving`: whether candidates with motion are wanted.
    """
    known = math.isfinite(observed.room)
    return (_thermal(observed) if known else []) + (_moving(observed, known) if moving else [])


# ------------------------------------------------------------------------------------------------ temperatures, at rest


def _thermal(observed: ObservedRange) -> list[CandidateMotion]:
    """Temperatures with the table level and at rest."""
    made = [(description, thermal, False) for description, thermal in _by_power(observed)]
    made += [(description, thermal, True) for description, thermal in _by_chamber(observed)]
    return [
        CandidateMotion(f"{description}, level and at rest", _resting(T[-1][0]), T, chamber)
        for description, T, chamber in made
    ]


def _by_power(observed: ObservedRange) -> list[tuple[str, Thermal]]:
    """What switching off and on does."""
    lost = -_REWARM * (observed.working - observed.room)
    return [
        ("switch the unit off until it has the room's temperature and start it again", observed.start),
        ("switch the warm unit off for a minute and start it again", _exponential(observed.working, lost, _REWARM_S)),
    ]


def _by_chamber(observed: ObservedRange) -> list[tuple[str, Thermal]]:
    """What a chamber does: one temperature, ramps both ways, two speeds, dwells at both ends, a loop in a loop."""
    room, warm, span = observed.room, observed.warm, f"{observed.warm - observed.room:.0f} K"
    up, slow, middle = _ramp_s(observed), _SLOWER * _ramp_s(observed), 0.5 * (observed.room + observed.warm)
    dwells, slowly = f"with {_DWELL_S / 60.0:.0f} min at each end", f"{_SLOWER:.0f} times as slowly"
    return [
        (f"keep the unit at {warm:.0f} degC from before power-on", ((0.0, warm), (_STILL_S, warm))),
        (
            f"cool the warm unit down by {span} and heat it again",
            _steps((_SOAK_S, warm), (up, room), (up, warm), (_SOAK_S, warm)),
        ),
        (
            f"heat the cold unit by {span} and cool it again",
            _steps((_SOAK_S, room), (up, warm), (up, room), (_SOAK_S, room)),
        ),
        (
            f"heat the cold unit by {span}, cool it again, then heat it {slowly}",
            _steps((_SOAK_S, room), (up, warm), (up, room), (slow, warm)),
        ),
        (
            f"cool the warm unit down by {span} and heat it again {dwells}",
            _steps((_DWELL_S, warm), (up, room), (_DWELL_S, room), (up, warm), (_DWELL_S, warm)),
        ),
        (
            f"heat the cold unit by {span} and cool it again {dwells}, then once {slowly}",
            _steps(
                *((_DWELL_S, room), (up, warm), (_DWELL_S, warm), (up, room), (_DWELL_S, room)),
                *((slow, warm), (_DWELL_S, warm), (slow, room), (_DWELL_S, room)),
            ),
        ),
        (
            f"cool the warm unit down by {span}, then up half of it, down, and up all of it",
            _steps((_SOAK_S, warm), (up, room), (up, middle), (up, room), (up, warm), (_SOAK_S, warm)),
        ),
    ]


def _ramp_s(observed: ObservedRange) -> float:
    """How long a chamber takes through the range, s."""
    return max(_RAMP_S, 30.0 * math.ceil((observed.warm - observed.room) / _RAMP_K_S / 30.0))


def _steps(*legs: tuple[float, float]) -> Thermal:
    """Legs of so many seconds, each ending at a temperature; the first one dwells."""
    ends = itertools.accumulate(seconds for seconds, _ in legs)
    return ((0.0, legs[0][1]), *((end, T) for end, (_, T) in zip(ends, legs, strict=True)))


def _resting(seconds: float) -> Profile:
    return Profile((Dwell((0.0, 0.0, 0.0), seconds),))


# -------------------------------------------------------------------------------------------------------------- motions


def _moving(observed: ObservedRange, known: bool) -> list[CandidateMotion]:
    """Motions of the unit when it has warmed up, and two of them at both ends of the range."""
    fast = observed.rate
    slow = math.radians(5.0 * round(math.degrees(fast) / 15.0))
    both = f"at ±{math.degrees(slow):.0f} and ±{math.degrees(fast):.0f} deg/s"
    spins = {axis: turns(axis, (slow, -slow, fast, -fast)) for axis in AXES}
    swings = {axis: _sines(axis) for axis in AXES}
    eighteen = positions((*SIX, *TWELVE), 15.0)
    all_turns = [segment for axis in AXES for segment in spins[axis]]
    all_swings = [segment for axis in AXES for segment in swings[axis]]
    made = [
        ("hold six positions, each axis up and down", positions(SIX, 30.0)),
        ("hold eighteen positions, some of them at 45 and 30 deg", eighteen),
        *_headings(),
        *((f"turn the {axis} axis {both}", spins[axis]) for axis in AXES),
        (f"turn each axis {both}", all_turns),
        *((f"swing the {axis} axis {_SWING}", swings[axis]) for axis in AXES),
        (f"swing each axis {_SWING}", all_swings),
        (f"hold eighteen positions, turn each axis {both} and swing it {_SWING}", [*eighteen, *all_turns, *all_swings]),
    ]
    warm = [_warm(description, segments, observed, known) for description, segments in made]
    if not known:
        return warm
    return [
        *warm,
        _twice("hold eighteen positions", eighteen, observed),
        _twice(f"turn each axis {both}", all_turns, observed),
    ]


def _warm(description: str, segments: Sequence[Segment], observed: ObservedRange, known: bool) -> CandidateMotion:
    profile = _profile(segments)
    thermal = ((0.0, observed.working), (profile.duration, observed.working)) if known else None
    return CandidateMotion(f"{description}, warmed up" if known else description, profile, thermal)


def _twice(description: str, segments: Sequence[Segment], observed: ObservedRange) -> CandidateMotion:
    """A motion at the room's temperature and again when warm."""
    ramp = _ramp_s(observed)
    cold = _profile(segments).duration
    profile = _profile((*segments, Dwell((0.0, 0.0, 0.0), ramp), *segments))
    thermal = (
        (0.0, observed.room),
        (cold, observed.room),
        (cold + ramp, observed.warm),
        (profile.duration, observed.warm),
    )
    return CandidateMotion(
        f"{description}, at {observed.room:.0f} degC and again at {observed.warm:.0f} degC",
        profile,
        thermal,
        chamber=True,
    )


def _profile(segments: Sequence[Segment]) -> Profile:
    return Profile(tuple(segments), align="gyro")


def _headings() -> list[tuple[str, list[Segment]]]:
    """Slow turns both ways, level and tilted."""
    description = "turn the inner axis slowly, twice round each way, level"
    level, tilted = (_heading((math.radians(outer), 0.0, 0.0)) for outer in (0.0, 45.0))
    return [(description, level), (f"{description} and with 45 deg of outer", [*level, *tilted])]


def _heading(angles: tuple[float, float, float]) -> list[Segment]:
    slow, twice_s = math.radians(4.0), 180.0
    return [Dwell(angles, 10.0), Rate("inner", slow, twice_s), Rate("inner", -slow, twice_s), Dwell(angles, 10.0)]


def _sines(axis: str) -> list[Segment]:
    return [LEVEL, *(Sine(axis, math.radians(_SWING_DEG), hz, 45.0) for hz in _SWING_HZ), LEVEL]
