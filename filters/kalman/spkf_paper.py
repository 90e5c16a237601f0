"""The sigma-point filter as the paper writes it, equations (1)-(15), with its misprints corrected.

State: latitude, longitude (rad), height (m), V_N, V_E, V_D (m/s), roll, pitch, yaw (rad, 3-2-1), b_a (m/s²),
b_g (rad/s). For comparison and teaching: near ±90° of pitch Euler angles are singular and the biases go wrong without
a word from the covariance, so `alarm` has one from 85° on. `filters.kalman.spkf` has no such place.

Corrected: sigma points are columns of the lower Cholesky factor in (11); (13) integrates from t_k to t_{k+1} with the
measured input, by the classical Runge-Kutta rule; (14) and (15) average differences to the centre point, those of
angles wrapped; Q_d is added in (15); P in (10) is (I - KH) P, here in Joseph's form.

Units at the edge: Q_d, P0 and R arrive in the errors of `filters.state` (m, m/s, rotation vector in n), x = x̂ + T e
to first order takes them here: T is diag(1/R_n, 1/(R_e cos φ), -1) for position and `attitude.rpy_jacobian` for
attitude. Level and at zero yaw, T of the attitude is the identity.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters import attitude, earth
from filters.kalman import spkf, strapdown
from filters.kalman.spkf import DivergenceError, Innovation, cholesky, gain_and_nis
from filters.state import ACCEL_BIAS, ATTITUDE, GYRO_BIAS, NAVIGATION, POSITION, SIZE, VELOCITY, NavState
from filters.types import Array

LATITUDE, LONGITUDE, HEIGHT, ROLL, PITCH, YAW = 0, 1, 2, 6, 7, 8
_CIRCULAR = [LONGITUDE, ROLL, PITCH, YAW]

PITCH_ALARM = np.deg2rad(85.0)  # rad of pitch up to which the biases were measured to be right
_PITCH_LIMIT = np.deg2rad(89.99)


@dataclass(frozen=True, slots=True)
class PaperBelief:
    """Estimate and its covariance in the paper's coordinates."""

    # lat, lon (rad), h (m), V_N, V_E, V_D (m/s), roll, pitch, yaw (rad), b_a (m/s²), b_g (rad/s); shape (15,).
    # Longitude, roll and yaw within ±π.
    x: Array
    P: Array  # covariance in the squares of those units, shape (15, 15)


def start(nav: NavState, P0_sd: Array) -> PaperBelief:
    """Belief before the first sample, as `spkf.start`; raises DivergenceError if the pitch of `nav` is ±90°."""
    if P0_sd.shape != (SIZE,):
        raise ValueError(f"`P0_sd` has shape {P0_sd.shape}, not ({SIZE},)")
    x = _from_nav(nav)
    T = _to_paper(x) * P0_sd
    return PaperBelief(x, T @ T.T)


def of_common(belief: spkf.Belief) -> PaperBelief:
    """Inverse of `common`; raises DivergenceError if the pitch is ±90°."""
    x = _from_nav(belief.nav)
    T = _to_paper(x)
    return PaperBelief(x, T @ belief.P @ T.T)


def predict(
    belief: PaperBelief, gyro: Array, accel: Array, dt: float, gravity: float, Q_d: Array, kappa: float = 0.0
) -> PaperBelief:
    """Prediction phase, equations (11)-(15) with Q_d added in (15).

    χ⁰ = x̂, χ^{i, i+n} = x̂ ± (columns of L √(n+κ)), P = L Lᵀ; each integrated over dt by (1)-(4).

    Parameters as `spkf.predict`, `Q_d` in the errors of `filters.state`; `spkf.PAPER_KAPPA` is the paper's κ.
    Raises DivergenceError also if the pitch reaches ±90°.
    """
    deviations, weights = spkf.sigma_points(belief.P, kappa)
    points = integrate(belief.x + deviations, gyro, accel, dt, gravity)
    # the branch of the centre point is kept until all is averaged: 179.9° and -179.9° are 0.2° apart
    mean, P = spkf.moments(_wrapped(points - points[0]), weights)
    x = points[0] + mean
    T = _to_paper(x)
    P = P + T @ Q_d @ T.T
    return PaperBelief(_wrapped(x), 0.5 * (P + P.T))


def correct(
    belief: PaperBelief,
    known: NavState,
    rows: NDArray[np.int_],
    R_sd: Array,
    drawn: Array | None = None,
    gate: float = np.inf,
) -> tuple[PaperBelief, Innovation]:
    """Correction phase, equation (10) with H the identity on the known rows, P in Joseph's form.

    Parameters as `spkf.correct`; rows 6, 7 and 8 are roll, pitch and yaw here. Known rows of attitude that turn into
    them together are correlated, as T of the known attitude makes them.
    Returns the belief corrected, and the innovation: m north, east, down, m/s, and rad of roll, pitch, yaw.
    Raises DivergenceError also if the known or corrected pitch reaches ±90°.
    """
    z = _from_nav(known)
    T_known = _to_paper(z)
    T = T_known[np.ix_(rows, rows)] * R_sd
    nu = _wrapped(z - belief.x)[rows]
    if drawn is not None:
        nu = nu + T @ drawn
    R = T @ T.T
    PHt = belief.P[:, rows]
    S = PHt[rows] + R
    L = cholesky(S, "innovation covariance")
    K, nis = gain_and_nis(L, PHt, nu)
    # only position has other units than the innovation that is handed out
    units = np.ones(SIZE)
    units[POSITION] = 1.0 / np.diag(T_known)[POSITION]
    units = units[rows]
    innovation = Innovation(units * nu, units[:, None] * S * units, nis, not nis > gate)
    if not innovation.accepted:
        return belief, innovation
    A = np.eye(SIZE)
    A[:, rows] -= K
    P = A @ belief.P @ A.T + K @ R @ K.T
    x = _wrapped(belief.x + K @ nu)
    _refuse_vertical(x)
    return PaperBelief(x, 0.5 * (P + P.T)), innovation


def common(belief: PaperBelief) -> spkf.Belief:
    """Estimate and covariance in the errors of `filters.state`: metres and the rotation vector in n, to first order."""
    x = belief.x
    C_nb = attitude.from_rpy(x[ROLL], x[PITCH], x[YAW])
    nav = NavState.of(x[POSITION], x[VELOCITY], C_nb, x[ACCEL_BIAS], x[GYRO_BIAS])
    T = _from_paper(x)
    P = T @ belief.P @ T.T
    return spkf.Belief(nav, 0.5 * (P + P.T))


def alarm(belief: PaperBelief) -> str | None:
    """Sentence about a pitch at which this filter is not to be believed; None below 85°.

    At 88° the gyro biases were measured to be off by 1.3 standard deviations, at 89° by 7.5, at 89.9° by 50.
    """
    pitch = float(belief.x[PITCH])
    if abs(pitch) < PITCH_ALARM:
        return None
    return (
        f"pitch is {np.rad2deg(pitch):.1f}°: Euler angles are singular at 90°, biases are no longer to be trusted;"
        " use --filter spkf"
    )


def integrate(x: Array, gyro: Array, accel: Array, dt: float, gravity: float) -> Array:
    """States after `dt`: equations (1)-(5) by the classical Runge-Kutta rule, all points in step.

    `x`: states, shape (..., 15).
    `gyro`, `accel`, `dt`, `gravity`: as in `spkf.predict`; cut into substeps as in `strapdown`.
    Returns same shape; angles on the branch they started on.
    """
    h, rates, forces = strapdown.substep_readings(gyro, accel, x[..., GYRO_BIAS], dt)
    for i in range(0, len(rates) - 1, 2):
        k1 = derivative(x, rates[i], forces[i], gravity)
        k2 = derivative(x + 0.5 * h * k1, rates[i + 1], forces[i + 1], gravity)
        k3 = derivative(x + 0.5 * h * k2, rates[i + 1], forces[i + 1], gravity)
        k4 = derivative(x + h * k3, rates[i + 2], forces[i + 2], gravity)
        x = x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return x


def derivative(x: Array, gyro: Array, accel: Array, gravity: float) -> Array:
    """Time derivative of the state, equations (1)-(5) as printed.

    `x`: states, shape (..., 15).
    `gyro`, `accel`: readings, rad/s and m/s², body, shape (3,).
    `gravity`: local gravity, m/s².
    Returns units of the state per second, same shape.
    """
    phi, height, roll, pitch = (x[..., i] for i in (LATITUDE, HEIGHT, ROLL, PITCH))
    v_n, v_e, v_d = x[..., 3], x[..., 4], x[..., 5]
    s, c, t = np.sin(phi), np.cos(phi), np.tan(phi)
    R_n, R_e = earth.curvature(phi, height)
    spin = earth.EARTH_RATE
    C_nb = attitude.from_rpys(x[..., ATTITUDE])
    f_n, f_e, f_d = np.moveaxis(np.squeeze(C_nb @ (accel - x[..., ACCEL_BIAS])[..., None], -1), -1, 0)  # (4)
    rate_n = np.stack([spin * c + v_e / R_e, -v_n / R_n, -spin * s - v_e * t / R_e], axis=-1)
    # the braces of (3): body against navigation frame, in body axes
    p, q, r = np.moveaxis(
        gyro - x[..., GYRO_BIAS] - np.squeeze(np.swapaxes(C_nb, -1, -2) @ rate_n[..., None], -1), -1, 0
    )
    out = np.zeros_like(x)
    out[..., LATITUDE] = v_n / R_n  # (1)
    out[..., LONGITUDE] = v_e / (R_e * c)
    out[..., HEIGHT] = -v_d
    out[..., 3] = f_n - 2.0 * spin * v_e * s + v_n * v_d / R_n - v_e**2 * t / R_e  # (2)
    out[..., 4] = f_e + 2.0 * spin * (v_n * s + v_d * c) + v_e * (v_n * t + v_d) / R_e
    out[..., 5] = f_d + gravity - 2.0 * spin * v_e * c - v_e**2 / R_e - v_n**2 / R_n
    turning = q * np.sin(roll) + r * np.cos(roll)
    out[..., ROLL] = p + turning * np.tan(pitch)  # (3)
    out[..., PITCH] = q * np.cos(roll) - r * np.sin(roll)
    out[..., YAW] = turning / np.cos(pitch)
    return out


def _from_nav(nav: NavState) -> Array:
    """The paper's coordinates of one state, shape (15,)."""
    position = np.array([nav.latitude, nav.longitude, nav.height], float)
    rpy = attitude.to_rpy(nav.C_nb)
    return _wrapped(np.concatenate([position, nav.velocity_n, rpy, nav.accel_bias, nav.gyro_bias]))


def _wrapped(x: Array) -> Array:
    """The same states, or differences of states, with longitude and angles within ±π; shape (..., 15)."""
    out = x.copy()
    angles = x[..., _CIRCULAR]
    # those within are left to the bit
    out[..., _CIRCULAR] = np.where(np.abs(angles) > np.pi, np.remainder(angles + np.pi, 2 * np.pi) - np.pi, angles)
    return out


def _to_paper(x: Array) -> Array:
    """T of dx = T e at a state: from the errors of `filters.state` to the paper's coordinates, shape (15, 15)."""
    _refuse_vertical(x)
    T = np.diag(_position_units(x))
    T[ATTITUDE, ATTITUDE] = attitude.rpy_jacobian(attitude.from_rpy(x[ROLL], x[PITCH], x[YAW]))
    return T


def _from_paper(x: Array) -> Array:
    """The inverse of `_to_paper`, which exists at every pitch, shape (15, 15)."""
    T = np.diag(1.0 / _position_units(x))
    sp, cp, sy, cy = np.sin(x[PITCH]), np.cos(x[PITCH]), np.sin(x[YAW]), np.cos(x[YAW])
    # columns: the axes about which roll, pitch and yaw turn, in n
    T[ATTITUDE, ATTITUDE] = np.array([[cy * cp, -sy, 0.0], [sy * cp, cy, 0.0], [-sp, 0.0, 1.0]])
    return T


def _position_units(x: Array) -> Array:
    """rad or m of the state a metre north, east, down; ones for all other states; shape (15,)."""
    R_n, R_e = earth.curvature(x[LATITUDE], x[HEIGHT])
    out = np.ones(SIZE)
    out[POSITION] = 1.0 / R_n, 1.0 / (R_e * np.cos(x[LATITUDE])), -1.0
    return out


def _refuse_vertical(x: Array) -> None:
    if not np.all(np.isfinite(x[NAVIGATION])):
        raise DivergenceError("the state is not finite")
    if abs(x[PITCH]) > _PITCH_LIMIT:
        raise DivergenceError(f"pitch is {np.rad2deg(x[PITCH]):.2f}°: Euler angles are singular at 90°")
