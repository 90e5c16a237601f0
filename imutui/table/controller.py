"""What a controller of a turn table is: degrees and seconds, axes by the names of `filters.motion.segments.AXES`."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from filters.errors import InputError

OFF, POSITION, RATE, OSCILLATION = "off", "position", "rate", "oscillation"
MODES = (OFF, POSITION, RATE, OSCILLATION)
"""Of an axis, the less active first."""

RESTS_DPS = 0.01
"""An axis that turns slower than this stands still."""

LAG_S = 0.1
"""Time by which an axis follows the reference of its drive, where the controller says nothing of its jerk."""


class TableError(Exception):
    """The table can't do it, or does not as it should; says what, where, and what next."""


class TableLinkError(TableError):
    """The controller can't be reached, or does not answer; what the table does meanwhile is not known."""


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

    def check(self, axis: str, *, angle_deg: float = math.nan, rate_dps: float = 0.0, accel_dps2: float = 0.0) -> None:
        """Raise InputError if an angle, a rate or an acceleration is beyond the limits of an axis.

        `angle_deg`: the angle that a command names; NaN if the command names none.
        `rate_dps`: of either sign.
        """
        for what, asked, most, unit in (
            ("rate", abs(rate_dps), self.rate_dps, "deg/s"),
            ("acceleration", accel_dps2, self.accel_dps2, "deg/s^2"),
        ):
            if not 0.0 <= asked <= most:
                raise InputError(f"the {axis} axis is asked for a {what} of {asked:g} {unit}; its limit is {most:g}")
        low, high = self.ends
        if math.isinf(angle_deg) or not (math.isnan(angle_deg) or low <= angle_deg <= high):
            raise InputError(
                f"the {axis} axis is asked for {angle_deg:g} deg; its limits are {low:g} to {high:g} deg. Nothing was"
                " sent"
            )


@dataclass(frozen=True, slots=True)
class TableState:
    """What a controller says of its axes: outer, middle, inner; an axis that the table has not is at 0.0."""

    stamp_ns: int  # host's monotonic time, half-way between question and answer
    uncertainty_ns: int  # half of the time between
    angles_deg: tuple[float, float, float]  # without jumps where an axis turns without end
    rates_dps: tuple[float, float, float]
    mode: str  # one of MODES, the most active one of the axes
    fault: str  # in words; "" where there is none

    @property
    def rests(self) -> bool:
        """Whether all axes stand still."""
        return all(abs(rate) < RESTS_DPS for rate in self.rates_dps)


class TableController(Protocol):
    """A controller on the line. Every method returns when it is done.

    Methods raise TableError if the table does not do it, TableLinkError if the controller cannot be asked, and
    InputError if a value is beyond the limits. After an InputError nothing has been sent.
    """

    axes: tuple[str, ...]  # which of AXES it has, in the order of its numbers
    meanwhile: Callable[[], None]  # called before each command, and while an answer is awaited; it may raise

    def identify(self) -> str:
        """Return the controller's identification."""
        ...

    def limits(self) -> Mapping[str, AxisLimits]:
        """Return the limits of each axis, as the controller reports them."""
        ...

    def enable(self) -> None:
        """Close the interlock, so that drives are ready, with the mode of all axes off.

        Raises InputError if a mode is on or an axis turns: another host commands the table.
        """
        ...

    def position(
        self, axis: str, angle_deg: float, rate_dps: float, accel_dps2: float, *, as_it_is: bool = False
    ) -> None:
        """Begin to go to an angle, no faster than a rate.

        `as_it_is`: send the angle as it is. Otherwise an axis that turns without end is sent one within 0 to 360.
        """
        ...

    def rate(self, axis: str, rate_dps: float, accel_dps2: float) -> None:
        """Begin to turn at a rate of either sign, which the axis reaches with no more than an acceleration."""
        ...

    def oscillate(self, axis: str, amplitude_deg: float, hz: float) -> None:
        """Begin to swing about the present angle; an amplitude of 0.0 ends the swing."""
        ...

    def read(self) -> TableState:
        """Return the present angles and rates."""
        ...

    def stop(self, brakes_s: float | None = None) -> None:
        """Bring all axes to rest: rate zero and rate mode of every axis, then mode off of every axis, unasked.

        `brakes_s`: time that the axes take to come to rest, at most. Then nothing is asked before the mode is off.
          Without it the controller is asked for rates until all axes rest.
        Raises TableError if the controller does not confirm that all axes rest with their modes off.
        """
        ...

    def disable(self) -> None:
        """Open the interlock, after a stop if a mode is on."""
        ...

    def close(self) -> None:
        """Close the link; the table goes on with what it does."""
        ...
