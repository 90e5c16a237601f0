"""A reference that knows how the unit is turned and nothing of where it is: an optical one, a quaternion's.

Gyro biases and attitude can be estimated with it. Position and velocity start at the site, at rest; velocity is held
within what a unit that is carried reaches, only so that it stays a number, and nothing is concluded from it.
"""

from dataclasses import dataclass

import numpy as np

from filters import attitude
from filters.motion.reference import PAPER_R_SD, VARIANCES, VELOCITY, Path, Reference, Trajectory
from filters.state import ATTITUDE, NavState, Site
from filters.types import Array

_SPEED_SD = 30.0  # m/s: of the velocity that is held
_START_SPEED_SD = 1.0
_OFFSET_SD = 5e-3  # s: of the time of one recording in the other's, which a turning unit sees as an angle
_HELD_S = 1.0  # from one row of velocity to the next, s


def knows_attitude_only(trajectory: Trajectory) -> bool:
    """Whether a trajectory has attitudes, and nowhere both position and velocity."""
    known = np.isfinite(trajectory.values)
    return bool(np.any(known[:, 6:9].all(axis=1))) and not bool(np.any(known[:, :6].all(axis=1)))


@dataclass
class Turning(Path):
    """Attitude rows of a trajectory, each used once, and a velocity that is held loosely."""

    def known(self, t: Array, before: float, gyro: Array) -> Array:
        """Rows for samples at `t`: attitude where there is a new one, and once a second a velocity near zero."""
        rows = super().known(t, before, gyro)
        late = np.sum(gyro**2, axis=1)[:, None] * _OFFSET_SD**2
        attitudes = rows[:, VARIANCES][:, ATTITUDE]
        rows[:, VARIANCES.start + ATTITUDE.start : VARIANCES.start + ATTITUDE.stop] = np.where(
            attitudes > 0.0, attitudes + late, attitudes
        )
        second = np.floor(t / _HELD_S)
        held = second > np.append(np.floor(before / _HELD_S) if np.isfinite(before) else -np.inf, second[:-1])
        rows[held, VELOCITY] = 0.0
        rows[held, VARIANCES.start + 3 : VARIANCES.start + 6] = _SPEED_SD**2
        return rows

    def observable(self, bias_sd: Array, P0_sd: Array) -> tuple[bool, ...]:
        """Gyro biases as far as the attitude has made them known; accelerometer biases never."""
        return (False, False, False, *super().observable(bias_sd, P0_sd)[3:])


class Starting:
    """Attitude at the first sample: the first one known, carried back by the gyros.

    `trajectory`: with attitudes.
    `site`: where position is held.
    """

    def __init__(self, trajectory: Trajectory, site: Site) -> None:
        rows = np.flatnonzero(np.isfinite(trajectory.values[:, 6:9]).all(axis=1))
        values = np.full((rows.size, 9), np.nan)
        values[:, 6:9] = trajectory.values[rows, 6:9]
        self._trajectory = Trajectory(trajectory.t[rows], values)
        self._site = site
        past = np.flatnonzero(self._trajectory.t <= 0.0)
        self._first = int(past[-1]) if past.size else 0

    def enough(self, t: float, count: int) -> bool:
        """When the first attitude is known."""
        return t >= float(self._trajectory.t[self._first])

    def found(self, t: Array, gyro: Array, accel: Array) -> Reference:
        """Reference with its initial state."""
        C_nb = attitude.from_rpy(*map(float, self._trajectory.values[self._first, 6:9]))
        until = min(float(self._trajectory.t[self._first]), float(t[-1]))
        before = t < until
        steps = np.diff(np.append(t[before], until))[:, None]
        for turn in (gyro[before] * steps)[::-1]:
            C_nb = C_nb @ attitude.exp(-turn)
        nav = NavState.at_rest(self._site, C_nb)
        P0_sd = PAPER_R_SD.copy()
        P0_sd[3:6] = _START_SPEED_SD
        return Turning(self._trajectory, nav, P0_sd)
