"""Where in a table's profile the readings depart from the model: by position, channel and size, and what it may be.

A departure is the mean of (raw residual - estimated bias) over one segment. Its size tells an effect of some per cent
from a reference that belongs to something else, and what it does to the length of gravity tells a unit from its table.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from filters.imu import STANDARD_GRAVITY
from filters.kalman.consistency import TOLERANCE
from filters.types import Array

_LEAST_S = 3.0
_CERTAIN_SD = 5.0  # standard deviations from which a departure is told: there are six for each of many positions
_TURNING = np.deg2rad(1.0)
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


@dataclass(slots=True)
class _Position:
    """Sums over the whole blocks of a segment whose motion is known."""

    seconds: float
    residual: Array
    rate: Array
    force: Array


class Departures:
    """Mean residuals of each segment of a profile, while they come."""

    def __init__(self) -> None:
        self._positions: dict[int, _Position] = {}

    def add(self, segment: int, seconds: float, residual: Array, rate: Array, force: Array) -> None:
        """Take a block.

        `segment`: that it lies in.
        `seconds`: its length.
        `residual`: mean raw residual, accelerometer then gyro, body axes, SI, shape (6,).
        `rate`, `force`: what a perfect unit reads there, rad/s and m/s², body axes, shape (3,).
        """
        before = self._positions.get(segment)
        sums = (
            (np.zeros(6), np.zeros(3), np.zeros(3)) if before is None else (before.residual, before.rate, before.force)
        )
        total = seconds + (before.seconds if before is not None else 0.0)
        added = (value + seconds * more for value, more in zip(sums, (residual, rate, force), strict=True))
        self._positions[segment] = _Position(total, *added)

    def worst(self, bias: Array, bias_sd: Array, noise: Array | None, least: Array = TOLERANCE) -> Departure | None:
        """The departure that is most certain; None while all are as noise and the biases' uncertainty allow.

        `bias`, `bias_sd`: estimates and their standard deviations, shape (6,).
        `noise`: white noise densities of the readings, shape (6,); None while they are not known.
        `least`: size below which nothing is told, however certain, shape (6,).
        """
        found: Departure | None = None
        if noise is None:
            return None
        for segment, position in self._positions.items():
            if position.seconds < _LEAST_S:
                continue
            size = position.residual / position.seconds - bias
            sds = np.abs(size) / np.sqrt(noise**2 / position.seconds + bias_sd**2)
            sds[np.abs(size) < least] = 0.0
            channel = int(np.argmax(sds))
            if sds[channel] > max(_CERTAIN_SD, found.sds if found is not None else 0.0):
                known = position.rate / position.seconds, position.force / position.seconds
                cause, share = _cause(size, channel, *known)
                found = Departure(segment, channel, size, float(sds[channel]), cause, share)
        return found


def _cause(size: Array, channel: int, rate: Array, force: Array) -> tuple[Cause, float]:
    """What a departure looks like, and its share or angle."""
    return _of_force(size[:3], channel, force) if channel < 3 else _of_rate(float(size[channel]), channel - 3, rate)


def _of_force(size: Array, axis: int, force: Array) -> tuple[Cause, float]:
    gravity = float(np.linalg.norm(force))
    if np.max(np.abs(size)) > _GROSS_FORCE:
        return "another angle", float(np.arccos(np.clip(force @ (force + size) / gravity**2, -1.0, 1.0)))
    longer = abs(float(np.linalg.norm(force + size)) - gravity)
    if abs(force[axis]) > 0.5 * gravity and longer > _LENGTH_SHARE * abs(size[axis]):
        return "scale factor", float(size[axis] / force[axis])
    return "tilt", float(np.linalg.norm(size)) / gravity


def _of_rate(size: float, axis: int, rate: Array) -> tuple[Cause, float]:
    if abs(rate[axis]) > _TURNING:
        share = size / float(rate[axis])
        return ("another rate" if abs(share) > _GROSS_SHARE else "scale factor"), share
    turning = float(np.linalg.norm(rate))
    return ("cross-axis", size / turning) if turning > _TURNING else ("motion", 0.0)
