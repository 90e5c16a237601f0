"""Estimates as records, and as the rows of numbers that engines keep and give (`filters.kalman.layout`)."""

from dataclasses import dataclass

import numpy as np

from filters import attitude, state
from filters.kalman import layout
from filters.kalman.layout import STRIDE
from filters.kalman.spkf import Belief
from filters.state import NavState
from filters.types import Array


@dataclass(frozen=True, slots=True)
class Estimate:
    """What the filter holds after one sample."""

    index: int  # number of the sample, from 0
    t: float  # s since the first sample
    belief: Belief  # after the update
    nu: Array  # innovation of the nine rows, m, m/s, rad; NaN where a row was not known; shape (9,)
    # normalised innovation squared; NaN without an update, as for the first sample, which only sets the clock
    nis: float
    dof: int  # rows of the update


def estimate_of(row: Array) -> Estimate:
    """Estimate of a row of output, `filters.kalman.layout.OUT_*`."""
    return Estimate(
        int(row[layout.OUT_INDEX]),
        float(row[layout.OUT_T]),
        Belief(nav_of(row[layout.OUT_NAV : layout.OUT_NIS]), covariance_of(row[layout.OUT_P :])),
        row[layout.OUT_NU : layout.OUT_P].copy(),
        float(row[layout.OUT_NIS]),
        int(row[layout.OUT_DOF]),
    )


@dataclass(frozen=True, slots=True)
class Moments:
    """Mean and covariance of state errors against the reference, after convergence; shapes (15,) and (15, 15)."""

    count: int
    mean: Array
    covariance: Array


def nav_of(row: Array) -> NavState:
    """Navigation state of 16 numbers, `filters.kalman.layout.NAV_*`: position, velocity, quaternion, biases.

    `row`: shape (..., 16), as many states.
    """
    C_nb = attitude.from_quaternion(row[..., 6:10])
    return NavState.of(row[..., :3], row[..., 3:6], C_nb, row[..., 10:13], row[..., 13:16])


def row_of(nav: NavState) -> Array:
    """Inverse of `nav_of`, shape (16,)."""
    position = [nav.latitude, nav.longitude, nav.height]
    return np.concatenate([position, nav.velocity_n, attitude.to_quaternion(nav.C_nb), nav.accel_bias, nav.gyro_bias])


def covariance_of(padded: Array) -> Array:
    """Covariance (..., 15, 15) of its padded rows, (..., 15 · STRIDE)."""
    return np.array(padded.reshape(*padded.shape[:-1], state.SIZE, STRIDE)[..., : state.SIZE])


def padded(P: Array) -> Array:
    """Inverse of `covariance_of`."""
    out = np.zeros((state.SIZE, STRIDE))
    out[:, : state.SIZE] = P
    return out.ravel()
