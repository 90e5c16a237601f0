"""What a table is told to do: dwells, constant rates, swings, sampled angles.

    dwell    Rests at `angles` for `seconds`. If the table is elsewhere it moves there first, all axes at once and along
             a straight line in the angles: a trapezoid of rate, limited by `slew` and `accel` on the axis that has
             farthest to go. `seconds` count from the end of that move. A profile that begins with a dwell begins at
             its angles; any other begins at zero angles.
    rate     Turns one axis at constant `rate` for `seconds`. Speeding up and slowing down at `accel` come before and
             after, and are not in `seconds`. Whole turns made so are not unwound: on that axis the next dwell takes the
             short way round.
    sine     Swings one axis about where it is: amplitude · u(t) · sin(2π hz t). The envelope u is 1 for `seconds`;
             before and after, each one period long and not in `seconds`, it is half a cosine from 0 and back to 0, so
             that angle and rate start and end at zero. `slew` and `accel` do not limit it.
    samples  Angles at given times, between them monotone cubics (no overshoot, so a table at rest stays at rest).

Left out: the moves between segments and any number at a given time (`filters.motion.kinematics`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from filters.errors import InputError

AXES = ("outer", "middle", "inner")  # of the table, in the order of all arrays of three table angles


@dataclass(frozen=True, slots=True)
class Dwell:
    """At rest."""

    angles: tuple[float, float, float]  # outer, middle, inner, rad
    seconds: float  # at rest, without the move there

    def __post_init__(self) -> None:
        if len(self.angles) != 3 or not np.isfinite(self.angles).all():
            raise InputError(f"`angles` is {self.angles}, not three finite angles: outer, middle, inner")
        check_positive("seconds", self.seconds)


@dataclass(frozen=True, slots=True)
class Rate:
    """One axis at constant rate."""

    axis: str
    rate: float  # rad/s, not zero
    seconds: float  # at that rate, without the ramps

    def __post_init__(self) -> None:
        axis_number(self.axis)
        if not math.isfinite(self.rate) or self.rate == 0.0:
            raise InputError(f"`rate` is {self.rate}, not a finite rate other than zero")
        check_positive("seconds", self.seconds)


@dataclass(frozen=True, slots=True)
class Sine:
    """One axis swinging."""

    axis: str
    amplitude: float  # rad, positive
    hz: float  # frequency
    seconds: float  # at full amplitude, without the period before and the period after

    def __post_init__(self) -> None:
        axis_number(self.axis)
        check_positive("amplitude", self.amplitude)
        check_positive("hz", self.hz)
        check_positive("seconds", self.seconds)


@dataclass(frozen=True, slots=True)
class Sampled:
    """Recorded or computed angles."""

    t: tuple[float, ...]  # s, increasing, at least two. Only differences count: the segment starts with the first.
    angles: tuple[tuple[float, float, float], ...]  # outer, middle, inner at those times, rad

    def __post_init__(self) -> None:
        t, angles = np.array(self.t), np.array(self.angles)
        if t.size < 2 or angles.shape != (t.size, 3):
            raise InputError(f"`t` has {t.size} times and `angles` shape {angles.shape}: at least 2, and 3 angles each")
        finite = np.isfinite(t) & np.isfinite(angles).all(axis=1)
        if not finite.all():
            row = int(np.argmin(finite))
            raise InputError(f"`angles` or `t` is not finite in row {row}")
        if not (np.diff(t) > 0.0).all():
            row = int(np.argmin(np.diff(t) > 0.0)) + 1
            raise InputError(f"`t` does not increase in row {row}: {t[row]:g} after {t[row - 1]:g}")


Segment = Dwell | Rate | Sine | Sampled


def axis_number(axis: str) -> int:
    """Column of an axis in arrays of table angles; raises InputError if there is none of that name."""
    if axis not in AXES:
        raise InputError(f'`axis` is "{axis}", not one of: {", ".join(AXES)}')
    return AXES.index(axis)


def check_positive(name: str, value: float) -> None:
    """Raise InputError that names the argument unless its value is positive and finite."""
    if not 0.0 < value < math.inf:
        raise InputError(f"`{name}` is {value}, not a positive finite number")


# ------------------------------------------------------------------------------ motions that many profiles are made of

LEVEL = Dwell((0.0, 0.0, 0.0), 10.0)  # a short rest, level
SIX = ((0, 0, 0), (90, 0, 0), (180, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0))
"""Each axis up and down: outer, middle, inner, deg."""
TWELVE = (
    *((0, 0, 90), (0, 0, 180), (45, 0, 0), (-45, 0, 30), (0, 45, 60), (0, -45, 0)),
    *((45, 45, 0), (30, -45, 90), (135, 0, 0), (-135, 0, 0), (90, 0, 90), (-90, 0, 45)),
)
"""Twelve more, in between."""


def positions(angles_deg: Sequence[tuple[float, float, float]], seconds: float) -> list[Segment]:
    """Dwells at angles, and back to level."""
    made = [Dwell((math.radians(o), math.radians(m), math.radians(i)), seconds) for o, m, i in angles_deg]
    return [*made, LEVEL]


def turns(axis: str, rates: Sequence[float]) -> list[Segment]:
    """One axis turned at each of some rates, rad/s, between rests."""
    return [LEVEL, *(Rate(axis, rate, 24.0) for rate in rates), LEVEL]
