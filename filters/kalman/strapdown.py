"""Strapdown mechanisation, equations (1)-(4), one step at a time.

Attitude is propagated in closed form (rotation vectors), so that no pitch is special; velocity and position by the
classical Runge-Kutta rule with that attitude at the start, the middle and the end of the step. The transport rate is
that of the middle of the step.
"""

from dataclasses import dataclass

import numpy as np

from filters import attitude, earth
from filters.state import NavState
from filters.types import Array

MAX_STEP_ANGLE = 0.2  # rad a substep may turn: RK4's error stays below 2e-4 deg a step
MAX_STEP = 1.0  # s a substep may last


def propagate(state: NavState, gyro: Array, accel: Array, dt: float, gravity: float) -> NavState:
    """State after `dt`: equations (1)-(4) with the biases of (5) constant.

    `state`: one state, or many along leading axes.
    `gyro`: measured angular rate, rad/s, body: held over the step, shape (3,); or at its start and end and linear
      between, shape (2, 3), or (2, ..., 3) where each of many states has its own.
    `accel`: measured specific force, m/s², body, likewise.
    `dt`: s, positive.
    `gravity`: local gravity, m/s².
    Returns same leading shape.
    """
    rates = [reading - state.gyro_bias for reading in _ends(gyro)]
    forces = [reading - state.accel_bias for reading in _ends(accel)]
    n = substeps(rates, dt)
    for k in range(n):
        at = np.array([k, k + 0.5, k + 1.0]) / n
        rate_b = [rates[0] + a * (rates[1] - rates[0]) for a in at]
        force_b = [forces[0] + a * (forces[1] - forces[0]) for a in at]
        state = _substep(state, rate_b, force_b, dt / n, gravity)
    return state


def _ends(reading: Array) -> Array:
    return reading if reading.ndim > 1 else np.broadcast_to(reading, (2, 3))


def substeps(rates: list[Array], dt: float) -> int:
    """Number of substeps that `dt` needs: none longer than 1 s, none that turns more than 0.2 rad.

    `rates`: angular rates at the start and the end, rad/s, shape (..., 3); the fastest counts.
    `dt`: s.
    Raises ValueError if `dt` is not positive.
    """
    if not dt > 0.0:
        raise ValueError(f"`dt` is {dt}, not positive")
    fastest = float(np.sqrt(max(np.max(np.sum(rate**2, axis=-1)) for rate in rates)))
    return max(1, int(np.ceil(dt * max(fastest / MAX_STEP_ANGLE, 1.0 / MAX_STEP) - 1e-9)))


def substep_readings(gyro: Array, accel: Array, gyro_bias: Array, dt: float) -> tuple[float, Array, Array]:
    """Length of a substep, s, and rates and forces at the start, the middle and the end of each, shape (2n + 1, 3).

    `gyro`, `accel`, `dt`: as in `propagate`, for one state or for many with the same readings.
    `gyro_bias`: of all states, shape (..., 3).
    """
    gyro, accel = _ends(gyro), _ends(accel)
    n = substeps([reading - gyro_bias for reading in gyro], dt)
    share = np.linspace(0.0, 1.0, 2 * n + 1)[:, None]
    return dt / n, gyro[0] + share * (gyro[1] - gyro[0]), accel[0] + share * (accel[1] - accel[0])


def _substep(x: NavState, rate_b: list[Array], force_b: list[Array], h: float, gravity: float) -> NavState:
    """One substep; rates and forces at its start, middle and end."""
    # Radii and trigonometry of latitude are held over the substep: a metre a second moves them by 2e-7 of themselves.
    earth_shape = _EarthShape.at(x.latitude, x.height)
    v = x.velocity_n
    f0 = np.squeeze(x.C_nb @ force_b[0][..., None], -1)
    a1 = earth_shape.acceleration(f0, v, gravity)
    v2 = v + 0.5 * h * a1
    # the transport rate of the middle of the step serves all of it
    rate_n = earth_shape.navigation_rate(v2)
    half_n = attitude.exp(-0.5 * h * rate_n)
    # the mean rate of each half turns it; the commutator of the two is left to the 0.2 rad of a substep
    C_mid = half_n @ x.C_nb @ attitude.exp(0.25 * h * (rate_b[0] + rate_b[1]))
    C_end = half_n @ C_mid @ attitude.exp(0.25 * h * (rate_b[1] + rate_b[2]))
    f1 = np.squeeze(C_mid @ force_b[1][..., None], -1)
    f2 = np.squeeze(C_end @ force_b[2][..., None], -1)

    a2 = earth_shape.acceleration(f1, v2, gravity)
    v3 = v + 0.5 * h * a2
    a3 = earth_shape.acceleration(f1, v3, gravity)
    v4 = v + h * a3
    a4 = earth_shape.acceleration(f2, v4, gravity)
    moved = h / 6.0 * (v + 2.0 * (v2 + v3) + v4)
    return NavState(
        x.latitude + moved[..., 0] / earth_shape.R_n,
        x.longitude + moved[..., 1] / (earth_shape.R_e * earth_shape.cos),
        x.height - moved[..., 2],
        v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4),
        C_end,
        x.accel_bias,
        x.gyro_bias,
    )


@dataclass(frozen=True, slots=True)
class _EarthShape:
    """Radii including height and the latitude's sine, cosine and tangent; shapes (...)."""

    R_n: Array
    R_e: Array
    sin: Array
    cos: Array
    tan: Array

    @classmethod
    def at(cls, latitude: Array, height: Array) -> "_EarthShape":
        s, c = np.sin(latitude), np.cos(latitude)
        return cls(*earth.curvature(latitude, height), s, c, s / c)

    def navigation_rate(self, velocity_n: Array) -> Array:
        """Rate of the navigation frame against inertial space, the last bracket of equation (3); rad/s, (..., 3)."""
        v_n, v_e = velocity_n[..., 0], velocity_n[..., 1]
        out = np.empty_like(velocity_n)
        out[..., 0] = earth.EARTH_RATE * self.cos + v_e / self.R_e
        out[..., 1] = -v_n / self.R_n
        out[..., 2] = -earth.EARTH_RATE * self.sin - v_e * self.tan / self.R_e
        return out

    def acceleration(self, force_n: Array, velocity_n: Array, gravity: float) -> Array:
        """Equation (2); m/s², shape (..., 3)."""
        v_n, v_e, v_d = velocity_n[..., 0], velocity_n[..., 1], velocity_n[..., 2]
        north, east = v_n / self.R_n, v_e / self.R_e
        two_omega = 2.0 * earth.EARTH_RATE
        spin = two_omega * self.sin + east * self.tan
        out = np.empty_like(velocity_n)
        out[..., 0] = force_n[..., 0] - spin * v_e + north * v_d
        out[..., 1] = force_n[..., 1] + spin * v_n + (two_omega * self.cos + east) * v_d
        out[..., 2] = force_n[..., 2] + gravity - (two_omega * self.cos + east) * v_e - north * v_n
        return out
