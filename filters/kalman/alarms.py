"""What contradicts the model: sentences for the operator, and where in a table's profile readings depart from it.

A departure is the mean of (raw residual - estimated bias) over one segment. Its size tells an effect of some per cent
from a reference that belongs to something else, and what it does to the length of gravity tells a unit from its table.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from filters.imu import STANDARD_GRAVITY, ImuSpec
from filters.kalman.consistency import TOLERANCE, Convergence
from filters.specification import NOT_KNOWN
from filters.types import Array

_ALARM_FACTOR = 3.0
_TURNING = np.deg2rad(0.2)
_TURNING_HARD = np.deg2rad(5.0)
_ONE_WAY = 0.25


@dataclass(slots=True)
class Turns:
    """Sums over samples with a known rate, of what tells a bias from the effects that look like it."""

    count: int = 0
    first: Array = field(default_factory=lambda: np.zeros(4))
    second: Array = field(default_factory=lambda: np.zeros(4))

    def add(self, rates: Array) -> None:
        """Take known angular rates (N, 3), rad/s, NaN where not known."""
        rates = rates[np.isfinite(rates[:, 0])]
        if rates.size:
            values = np.column_stack([rates, np.sum(rates**2, axis=1)])
            self.count += len(values)
            self.first = self.first + values.sum(axis=0)
            self.second = self.second + np.sum(values**2, axis=0)

    def confounded(self) -> list[str]:
        """Sentences on biases that this motion cannot tell from other effects, body axes."""
        out: list[str] = []
        if not self.count:
            return out
        # of the rates and of the squared rate: mean, mean square, and whether it has been the same all the time
        mean, square = self.first / self.count, self.second / self.count
        same = np.sqrt(np.maximum(square - mean**2, 0.0)) < 0.25 * np.abs(mean)
        for i, axis in enumerate("xyz"):
            if same[i] and abs(mean[i]) > _TURNING:
                out.append(
                    f"{axis} gyro bias: the table turned at {np.rad2deg(mean[i]):.1f} deg/s about {axis} all the time,"
                    f" where scale factor and delay look like bias; turn both ways, at two rates"
                )
            elif mean[i] ** 2 > _ONE_WAY * square[i] and abs(mean[i]) > _TURNING_HARD:
                dps = np.rad2deg(mean[i])
                out.append(
                    f"{axis} gyro bias: the table turned about {axis} mostly one way, {dps:.1f} deg/s in the mean; 1 %"
                    f" of scale factor would shift the bias by {abs(dps) * 0.01:.2f} deg/s. Turn both ways alike"
                )
        if same[3] and mean[3] > _TURNING_HARD**2:
            out.append(
                f"accelerometer biases: the table turned at {np.rad2deg(np.sqrt(mean[3])):.1f} deg/s all the time,"
                " where a lever arm looks like bias; add a dwell or a second rate"
            )
        return out


def causes(reference: str) -> str:
    """What puts the accelerometers far off a reference of that name."""
    table = ", or the table is not where the segment says" if reference == "profile" else ""
    return f"wrong accelerometer sign, mounting or attitude{table}"


def of_residuals(
    convergence: Convergence, spec: ImuSpec, observable: tuple[bool, ...], reference: str = "level"
) -> list[str]:
    """Sentences on readings that are off the reference by more than a bias can be; none without a mean raw residual."""
    apparent, out = convergence.apparent, list[str]()
    if apparent is None:
        return out
    if np.any(np.abs(apparent[:3]) > 0.5 * STANDARD_GRAVITY):
        size = float(np.max(np.abs(apparent[:3]))) / STANDARD_GRAVITY
        out.append(f"accelerometers are off the reference by {size:.2f} g: {causes(reference)}")
    limits = np.array([spec.accel_bias_limit] * 3 + [spec.gyro_bias_limit] * 3)
    names = ("x accel", "y accel", "z accel", "x gyro", "y gyro", "z gyro")
    most = "what the filter expects of a bias" if spec == NOT_KNOWN else f"the bias limit of {spec.source}"
    for i in np.flatnonzero(np.abs(apparent) > _ALARM_FACTOR * limits):
        if observable[i] and abs(apparent[i]) < 0.5 * STANDARD_GRAVITY:
            out.append(
                f"{names[i]} (body axes) is off by {abs(apparent[i]) / limits[i]:.1f} times {most}: tilt, scale, a"
                " moving table, or a faulty sensor"
            )
    return out


# --------------------------------------------------------------------------------------------------------- departures
# Where in a table's profile the readings depart from the model: by position, channel and size, and what it may be.
#
# A departure is the mean of (raw residual - estimated bias) over one segment. Its size tells an effect of some per cent
# from a reference that belongs to something else, and what it does to the length of gravity tells a unit from its
# table.

_LEAST_S = 3.0
_CERTAIN_SD = 5.0  # standard deviations from which a departure is told: there are six for each of many positions
_KNOWN_TO_TURN = np.deg2rad(1.0)
_GROSS_FORCE = 0.3 * STANDARD_GRAVITY
_GROSS_SHARE = 0.2
_LENGTH_SHARE = 0.7

Cause = Literal["scale factor", "another rate", "another angle", "tilt", "cross-axis", "motion"]


@dataclass(frozen=True, slots=True)
class Departure:
    """Readings that depart from the model in one segment."""

    segment: int  # of the profile, from 0
    channel: int  # accelerometer x, y, z, then gyro; body axes
    size: Array  # departure of all six channels, m/s² and rad/s, shape (6,)
    sds: float  # that of the channel over its standard deviation
    cause: Cause  # what it looks like
    # of a scale factor or of another rate: departure over what is known; of a tilt: the angle, rad; else nothing
    share: float

    @property
    def gross(self) -> bool:
        """Whether it is more than an effect of some per cent: reference and readings do not belong together."""
        return self.cause in ("another angle", "another rate")


class Departures:
    """Mean residuals of each segment of a profile, while they come."""

    def __init__(self) -> None:
        # of each segment the seconds of its blocks, and times those the residual (6), the rate (3), the force (3)
        self._sums: dict[int, Array] = {}

    def add(self, segment: int, seconds: float, residual: Array, rate: Array, force: Array) -> None:
        """Take a block of so many seconds, which lies in one segment.

        `residual`: mean raw residual, accelerometer then gyro, body axes, SI, shape (6,).
        `rate`, `force`: what a perfect unit reads there, rad/s and m/s², body axes, shape (3,).
        """
        block = seconds * np.concatenate([[1.0], residual, rate, force])
        self._sums[segment] = self._sums.get(segment, np.zeros(13)) + block

    def worst(self, bias: Array, bias_sd: Array, noise: Array | None, least: Array = TOLERANCE) -> Departure | None:
        """The departure that is most certain; None while all are as noise and the biases' uncertainty allow.

        `bias`, `bias_sd`: estimates and their standard deviations, shape (6,).
        `noise`: white noise densities of the readings, shape (6,); None while they are not known.
        `least`: size below which nothing is told, however certain, shape (6,).
        """
        found: Departure | None = None
        if noise is None:
            return None
        for segment, (seconds, *sums) in self._sums.items():
            if seconds < _LEAST_S:
                continue
            mean = np.array(sums) / seconds
            size = mean[:6] - bias
            sds = np.abs(size) / np.sqrt(noise**2 / seconds + bias_sd**2)
            sds[np.abs(size) < least] = 0.0
            channel = int(np.argmax(sds))
            if sds[channel] > max(_CERTAIN_SD, found.sds if found is not None else 0.0):
                rate, force = mean[6:9], mean[9:]
                cause, share = (
                    _of_force(size[:3], channel, force)
                    if channel < 3
                    else _of_rate(float(size[channel]), channel - 3, rate)
                )
                found = Departure(segment, channel, size, float(sds[channel]), cause, share)
        return found


def _of_force(size: Array, axis: int, force: Array) -> tuple[Cause, float]:
    gravity = float(np.linalg.norm(force))
    if np.max(np.abs(size)) > _GROSS_FORCE:
        return "another angle", float(np.arccos(np.clip(force @ (force + size) / gravity**2, -1.0, 1.0)))
    longer = abs(float(np.linalg.norm(force + size)) - gravity)
    if abs(force[axis]) > 0.5 * gravity and longer > _LENGTH_SHARE * abs(size[axis]):
        return "scale factor", float(size[axis] / force[axis])
    return "tilt", float(np.linalg.norm(size)) / gravity


def _of_rate(size: float, axis: int, rate: Array) -> tuple[Cause, float]:
    if abs(rate[axis]) > _KNOWN_TO_TURN:
        share = size / float(rate[axis])
        return ("another rate" if abs(share) > _GROSS_SHARE else "scale factor"), share
    turning = float(np.linalg.norm(rate))
    return ("cross-axis", size / turning) if turning > _KNOWN_TO_TURN else ("motion", 0.0)
