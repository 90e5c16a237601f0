"""Motions that a table with a controller is given to do: each of some minutes, with rests, within what its axes can.

`start` is what an unknown unit is taken through first, `rounds` is chosen from afterwards, `held_out` judges at the
end. What it leaves out: which of them is worth its time (`planning`); motions that an operator makes, and temperatures
(`candidate_motions`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from filters.motion.profile import Profile
from filters.motion.segments import AXES, SIX, TWELVE, Dwell, Rate, Segment, Sine, positions
from filters.tracing.candidate_motions import CandidateMotion

_FASTEST = math.radians(120.0)  # rad/s: the unit's range has to hold errors too
_AMPLITUDE = math.radians(20.0)
_FIRST_S = 5.0  # of rests and rates that every unit is taken through: as short as shows all that no hour is needed for
_HOLD_S, _HOLD_LONG_S, _STILL_ROUND_S, _TURN_S, _SWING_S = 8.0, 20.0, 180.0, 8.0, 12.0
_BRISK = math.radians(60.0)  # rate of moves, if the axes can
_PAUSE = Dwell((0.0, 0.0, 0.0), 15.0)  # level, before a motion and after: its constant is judged by that
_CHECK_HZ = 20.0
_UNUSED = ((20, 0, 0), (-60, 0, 45), (0, 25, 0), (0, -65, 120), (110, 0, 0), (-30, 30, -60), (0, 0, 75), (0, 0, -140))
_JUDGED_S = 330.0  # of the run that judges, at least: of 300 s there is a verdict
_TILTS = ((45, 0, 0), (-45, 0, 0), (90, 0, 0), (0, 45, 0), (0, -45, 0))
_FOUR, _OFTEN = (0.2, -0.2, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0), (0.5, -0.5) * 5
_HALF_TURN = math.radians(179.0)
_SHARE = 0.95  # of what an axis can, that is asked of it


@dataclass(frozen=True, slots=True)
class AxisRange:
    """What an axis of a table can do."""

    rate: float  # rad/s
    accel: float  # rad/s²
    # low, high: where it stops, rad; without end if infinite
    low: float = -math.inf
    high: float = math.inf

    @property
    def swing(self) -> float:
        """How far it goes both ways from zero, rad."""
        return min(-self.low, self.high)


Table = Mapping[str, AxisRange]  # axes that a table has, by their names in `AXES`


def fits(profile: Profile, table: Table) -> bool:
    """Whether a table can do all of a motion: no axis beyond its rate, its acceleration or its stops."""
    t = np.arange(math.ceil(profile.duration * _CHECK_HZ) + 1) / _CHECK_HZ
    angles, rates = profile.angles(t), profile.rates(t)
    for number, axis in enumerate(AXES):
        own = table.get(axis)
        if own is None:
            if np.abs(angles[:, number]).max() > 1e-9:
                return False
            continue
        sines = [s for s in profile.segments if isinstance(s, Sine) and s.axis == axis]
        swings = [s.amplitude * (2.0 * math.pi * s.hz) ** 2 for s in sines]
        if (
            np.abs(rates[:, number]).max() > own.rate * (1.0 + 1e-9)
            or max([profile.accel if np.ptp(angles[:, number]) else 0.0, *swings]) > own.accel * (1.0 + 1e-9)
            or angles[:, number].min() < own.low - 1e-9
            or angles[:, number].max() > own.high + 1e-9
        ):
            return False
    return True


def start(table: Table) -> list[CandidateMotion]:
    """What an unknown unit is taken through first, in parts: rests in many attitudes, rates of both signs.

    Together they let every effect of the catalogue that motion shows be told at plausible sizes
    (`detectability.of_motion`), but those that take an hour: an accelerometer's cubic nonlinearity, Earth rate.
    """
    shares = (0.4, -0.4, 1.0, -1.0)
    spun = [s for axis in table for s in turned(table, axis, shares, _FIRST_S, rest_s=_FIRST_S)[1:]]
    made = [
        ("hold positions all around", held((*SIX, *TWELVE), _FIRST_S)),
        ("turn each axis both ways at two rates", [_PAUSE, *spun, _PAUSE]),
    ]
    wanted = [commanded(description, segments, table) for description, segments in made]
    return [motion for motion in wanted if motion is not None]


def rounds(table: Table, degc: float | None) -> list[CandidateMotion]:
    """Motions of some minutes each that a table can do, at the temperature that there is, degC."""
    tilts = [tilt for tilt in _TILTS if _reachable(_tilted(tilt, 1.0), table)]
    made: list[tuple[str, list[Segment]]] = [
        ("rest level", [Dwell((0.0, 0.0, 0.0), _STILL_ROUND_S)]),
        ("hold six positions, each axis up and down", held(SIX, _HOLD_LONG_S)),
        ("hold positions in between", held(TWELVE, _HOLD_S)),
    ]
    for axis in table:
        made += [
            (f"hold the {axis} axis at steps of 30 deg, up and down again", _stairs(axis)),
            (f"turn the {axis} axis both ways at four rates", turned(table, axis, _FOUR)),
            (f"turn the {axis} axis both ways, starting and stopping often", turned(table, axis, _OFTEN, 4.0)),
            (f"swing the {axis} axis at four rates of swing", _swung(table, axis, (0.15, 0.3, 0.5, 0.8))),
        ]
    if "inner" in table:
        for tilt in ((0, 0, 0), *tilts):
            made.append((f"turn the inner axis slowly, once round each way{_at(tilt)}", _slow(tilt)))
        for tilt in tilts:
            tilted = turned(table, "inner", (0.4, -0.4, 0.8, -0.8), tilt=tilt)
            made.append((f"turn the inner axis both ways at two rates{_at(tilt)}", tilted))
    wanted = [commanded(description, segments, table, degc) for description, segments in made]
    return [motion for motion in wanted if motion is not None]


def held_out(table: Table, degc: float | None, again: int = 0) -> CandidateMotion | None:
    """A run that judges: level for a minute, then positions and rates that no other has; None if nothing can move.

    `again`: how many such runs there have been: each is another.
    """
    shares = [sign * (share - 0.02 * again) for share in (0.3, 0.65) for sign in (1.0, -1.0)]
    spun = [s for axis in table for s in turned(table, axis, shares, 6.0)[1:]]
    unused = [(o - 2 * again if o else 0, m + 3 * again if m else 0, i - 4 * again) for o, m, i in _UNUSED]
    segments = [Dwell((0.0, 0.0, 0.0), 65.0), *held(unused, _HOLD_S), *spun]
    description = "hold positions and turn at rates that were not used"
    made = commanded(description, segments, table, degc)
    if made is None or made.seconds >= _JUDGED_S:
        return made
    return commanded(description, [*segments, Dwell((0.0, 0.0, 0.0), _JUDGED_S - made.seconds + 15.0)], table, degc)


def commanded(
    description: str, segments: Sequence[Segment], table: Table, degc: float | None = None
) -> CandidateMotion | None:
    """A motion with moves as brisk as the axes can; positions that the table can't take are left out, or all of it."""
    rate = min([_BRISK, *(_SHARE * own.rate for own in table.values())])
    accel = min([math.radians(100.0), *(_SHARE * own.accel for own in table.values())])
    able = _by_halves(_able(segments, table))
    moves = any(not isinstance(s, Dwell) or any(s.angles) for s in able)
    if not able or (not moves and len(segments) > 1):
        return None
    profile = Profile(tuple(able), align="marks", slew=rate, accel=accel)
    if not fits(profile, table):
        return None
    thermal = None if degc is None else ((0.0, degc), (profile.duration, degc))
    return CandidateMotion(description, profile, thermal)


def _able(segments: Sequence[Segment], table: Table) -> list[Segment]:
    return [s for s in segments if not isinstance(s, Dwell) or _reachable(s, table)]


def _by_halves(segments: Sequence[Segment]) -> list[Segment]:
    """Segments with a short rest amid each half turn between two others: that has two ways, and one must be said."""
    made: list[Segment] = []
    for segment in segments:
        before = made[-1] if made else None
        if isinstance(segment, Dwell) and isinstance(before, Dwell):
            pairs = list(zip(before.angles, segment.angles, strict=True))
            if any(abs(math.remainder(a - b, 2.0 * math.pi)) > _HALF_TURN for a, b in pairs):
                o, m, i = (0.5 * (a + b) for a, b in pairs)
                made.append(Dwell((o, m, i), 1.0))
        made.append(segment)
    return made


def _reachable(dwell: Dwell, table: Table) -> bool:
    none = AxisRange(0.0, 0.0, 0.0, 0.0)
    ends = [table.get(axis, none) for axis in AXES]
    return all(own.low - 1e-9 <= angle <= own.high + 1e-9 for own, angle in zip(ends, dwell.angles, strict=True))


def held(angles_deg: Sequence[tuple[float, float, float]], seconds: float) -> list[Segment]:
    """Rests at angles, between rests level."""
    return [_PAUSE, *positions(angles_deg, seconds)[:-1], _PAUSE]


def _stairs(axis: str) -> list[Segment]:
    ups = [*range(-90, 91, 30), *range(60, -91, -30)]
    angles = [tuple(float(a) if axis == own else 0.0 for own in AXES) for a in ups]
    return held([(a, b, c) for a, b, c in angles], 8.0)


def _at(tilt: tuple[float, float, float]) -> str:
    said = [f"{angle:g} deg of {axis}" for axis, angle in zip(AXES, tilt, strict=True) if angle]
    return f" with {' and '.join(said)}" if said else ""


def _tilted(tilt_deg: tuple[float, float, float], seconds: float) -> Dwell:
    o, m, i = (math.radians(angle) for angle in tilt_deg)
    return Dwell((o, m, i), seconds)


def _slow(tilt_deg: tuple[float, float, float]) -> list[Segment]:
    slow, once_s = math.radians(6.0), 60.0
    pause = _tilted(tilt_deg, 15.0)
    return [pause, Rate("inner", slow, once_s), pause, Rate("inner", -slow, once_s), pause]


def turned(
    table: Table,
    axis: str,
    shares: Sequence[float],
    seconds: float = _TURN_S,
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rest_s: float = 8.0,
) -> list[Segment]:
    """An axis turned at shares of its fastest rate, a rest after each; from stop to stop where it has stops."""
    own = table[axis]
    fastest = _SHARE * min(own.rate, _FASTEST)
    pause, made = _tilted(tilt, rest_s), list[Segment]()
    for share in shares:
        rate = share * fastest
        if math.isfinite(own.swing):
            reach = _SHARE * own.swing
            from_there = -math.copysign(reach, rate)
            angles = [from_there if axis == name else math.radians(t) for name, t in zip(AXES, tilt, strict=True)]
            ramps = 2.0 * abs(rate) / max(1e-9, min(math.radians(100.0), _SHARE * own.accel))
            made += [Dwell((angles[0], angles[1], angles[2]), 4.0)]
            made += [Rate(axis, rate, max(1.0, min(seconds, 2.0 * reach / abs(rate) - ramps)))]
        else:
            made += [Rate(axis, rate, seconds)]
        made += [pause]
    return [_PAUSE, *([pause] if any(tilt) else []), *made]


def _swung(table: Table, axis: str, rates_hz: Sequence[float]) -> list[Segment]:
    """An axis swung at several rates, as wide as it can up to 20 deg."""
    own, made = table[axis], list[Segment]()
    for hz in rates_hz:
        omega = 2.0 * math.pi * hz
        able = min(_SHARE * own.rate / omega, _SHARE * own.accel / omega**2, _SHARE * own.swing)
        made += [Sine(axis, min(_AMPLITUDE, able), hz, _SWING_S), _PAUSE]
    return [_PAUSE, *made]
