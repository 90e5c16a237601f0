"""What a controller of a turn table is: degrees and seconds, axes by the names of `filters.motion.segments.AXES`."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from filters.errors import InputError

OFF, POSITION, RATE, OSCILLATION = "off", "position", "rate", "oscillation"
MODES = (OFF, POSITION, RATE, OSCILLATION)
"""Of an axis, the less active first."""

RESTS_DPS = 0.01
"""An axis that turns slower than this stands still."""


class TableError(Exception):
    """The table can't do it, or does not as it should; says what, where, and what next."""


class TableLinkError(TableError):
    """The controller can't be reached, or does not answer; what the table does meanwhile is not known."""


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """What an axis may do, as read from the controller or given by the operator."""

    rate_dps: float  # positive
    accel_dps2: float  # positive
    low_deg: float | None  # low_deg, high_deg: None: it turns without end
    high_deg: float | None

    def check(self, axis: str, *, angle_deg: float = math.nan, rate_dps: float = 0.0, accel_dps2: float = 0.0) -> None:
        """Raise InputError if what is asked of an axis is not within its limits.

        `angle_deg`: where it is to go; NaN where it is not told to go anywhere.
        `rate_dps`: of either sign.
        """
        for what, asked, most, unit in (
            ("rate", abs(rate_dps), self.rate_dps, "deg/s"),
            ("acceleration", accel_dps2, self.accel_dps2, "deg/s^2"),
        ):
            if not 0.0 <= asked <= most:
                raise InputError(f"the {axis} axis is asked for a {what} of {asked:g} {unit}; its limit is {most:g}")
        low = -math.inf if self.low_deg is None else self.low_deg
        high = math.inf if self.high_deg is None else self.high_deg
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
    """A controller on the line. All methods wait for their end.

    They raise TableError where the table does not do it, TableLinkError where it can't be asked, and InputError for
    what is not within the limits: then nothing was sent.
    """

    axes: tuple[str, ...]  # which of AXES it has, in the order of its numbers

    def identify(self) -> str:
        """What it says of itself."""
        ...

    def limits(self) -> Mapping[str, AxisLimits]:
        """Limits of each axis that it has, as the controller says them."""
        ...

    def enable(self) -> None:
        """Close the interlock, so that drives are ready, with the mode of all axes off."""
        ...

    def position(self, axis: str, angle_deg: float, rate_dps: float, accel_dps2: float) -> None:
        """Begin to go there, not faster than that."""
        ...

    def rate(self, axis: str, rate_dps: float, accel_dps2: float) -> None:
        """Begin to turn at a rate of either sign, which is reached with no more than that acceleration."""
        ...

    def oscillate(self, axis: str, amplitude_deg: float, hz: float) -> None:
        """Begin to swing about where the axis is; an amplitude of 0.0 ends it."""
        ...

    def read(self) -> TableState:
        """Where the axes are now."""
        ...

    def stop(self) -> None:
        """Rate zero, then, when they rest, mode off, of all axes; an axis that is off already stays so."""
        ...

    def disable(self) -> None:
        """Stop, and open the interlock."""
        ...

    def close(self) -> None:
        """Close the link; the table goes on with what it was told."""
        ...
