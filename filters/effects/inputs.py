"""What the effects are functions of: time, temperature and its memory, true inputs, the table's angles.

The same names serve the tracer, which has whole runs, and the filter, which has the past only.
"""

from dataclasses import dataclass

import numpy as np

from filters.imu import AxisMap
from filters.types import Array

REFERENCE_DEGC = 25.0  # temperature at which thermal terms are zero, degC

SENSED = ("wx", "wy", "wz", "fx", "fy", "fz")
"""What the six channels sense, as drivers are named: rates and specific forces along the instrument's axes."""

SMOOTH_S, SLOPE_S = 5.0, 15.0
"""Time constants over which temperature and its rate are smoothed, s."""

LAGS = (20.0, 40.0, 60.0, 80.0, 100.0, 130.0, 180.0, 320.0, 640.0, 1280.0, 2560.0)
"""Time constants of the lagged temperatures, s."""
SHORT_LAGS = 7  # so many of them, the first, are tried whatever a run's length and range of temperature

PLAY_WIDTHS = (3.0, 10.0, 30.0, 60.0, 100.0)  # widths of the banks of play operators, K
NARROW_PLAYS = 3  # so many of them, the first, are tried whatever a run's range of temperature
PLAY_STARTS = (0.0, -1.0, 1.0)
"""Where in its band each operator of a bank is at the start: in the middle, at the lower end, at the upper."""
BANKS = tuple((width, start) for start in PLAY_STARTS for width in PLAY_WIDTHS)
"""Width, K, and start of every bank of play operators."""
PLAYS = 6  # play operators in a bank
PLAY_HALF_WIDTHS: Array = np.array([width * k / PLAYS for width, _ in BANKS for k in range(1, PLAYS + 1)])
"""Of every operator of every bank, K, shape (BANKS · PLAYS,)."""
PLAYS_AT_START: Array = np.repeat([start for _, start in BANKS], PLAYS) * PLAY_HALF_WIDTHS
"""Where every operator is before anything is known of it, K from the start's temperature, shape (BANKS · PLAYS,)."""

FOLLOWED = (*SENSED, "rate_norm")  # what operators with a memory follow of motion: the inputs, and the size of the rate


@dataclass(frozen=True, kw_only=True)
class Inputs:
    """Drivers at n instants of one run; instrument axes and sign, SI. Of a still unit, rows may stand for all."""

    t: Array  # s since the run's first sample (its power-on), shape (n,)
    x: Array  # what a perfect unit reads, rad/s and m/s², shape (n, 6)
    x_dot: Array  # its time derivative, shape (n, 6)
    # temperature, temperature_rate: degC, K/s, shape (n,); NaN where there is none
    temperature: Array
    temperature_rate: Array
    lagged: Array  # T_tau for `LAGS`, following T from equality at the start, degC, shape (n, LAGS)
    # for each of `BANKS` the mean of `PLAYS` play operators over the width; they follow T from the start's temperature
    # with half-widths 1 … 6 sixths of the width; shape (n, BANKS)
    plays: Array
    spin: Array  # Earth rate as the gyros see it, rad/s, shape (n, 3)
    # reading of the accelerometers per rad of tilt of the base about north and about east, m/s², shape (n, 3, 2)
    horizontal: Array
    # reading of the accelerometers per m of lever arm along instrument x, y, z, 1/s², shape (n, 3, 3)
    centripetal: Array
    # angles, rates: rotations of the table, rad (unwrapped), and rad/s, shape (n, 3)
    angles: Array
    rates: Array
    table_accel: Array  # norm of the derivative of `rates`, rad/s², shape (n,)
    since_motion: Array  # s since the table last moved (since the start if it never did), shape (n,)
    direction: Array  # sign of the last motion of each axis, 0 before the first, shape (n, 3)
    # `FOLLOWED`, once a block, rad/s and m/s², shape (n, FOLLOWED); NaN where the motion is not known
    followed: Array


def tilted(axes: AxisMap, C: Array, gravity: float) -> Array:
    """Reading of the accelerometers per rad of tilt about north and about east, m/s², of attitudes (n, 3, 3).

    δ × (0, 0, -γ) of a tilt about north is γ east, about east -γ north. Shape (n, 3, 2).
    """
    return gravity * np.stack([axes.accel_to_instrument(C[:, 1]), -axes.accel_to_instrument(C[:, 0])], axis=2)


def levered(axes: AxisMap, turning: Array, turning_dot: Array) -> Array:
    """ω × (ω × r) + ω' × r as the accelerometers read it, for r along the instrument's x, y, z; shape (n, 3, 3)."""
    columns = []
    for r in axes.mount.T:
        force = np.cross(turning, np.cross(turning, r)) + np.cross(turning_dot, r)
        columns.append(axes.accel_to_instrument(force))
    return np.stack(columns, axis=2)
