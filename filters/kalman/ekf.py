"""The extended Kalman filter, equations (6)-(10), for comparison with the sigma-point filter.

State, errors and correction are those of `filters.kalman.spkf`; the mean goes through `strapdown.propagate`, the
covariance through the Jacobian (6). Leaves out noise levels and references: both come from the caller.

Corrections to (6) as printed, checked against central differences of the mechanisation
    Its attitude rows and columns are those of a misalignment C_nb ← exp(ε) C_nb in n, not of Euler angles: taken so,
    all nine are right. The columns of the biases are missing: -C_nb in the velocity rows for b_a and in the attitude
    rows for b_g. F36 is -1, not -1/R_a. R_n and R_e, both with height, stand apart instead of R_a = √(R_n R_e), and
    their own change with latitude is kept. Position errors are metres north, east, down, so that the first three
    rows follow from (1) by the product rule. F63 and F61 have no gradient of gravity, because gravity is given, not
    computed from height.
"""

import numpy as np

from filters import attitude, earth
from filters.kalman import strapdown
from filters.kalman.spkf import Belief, common, correct, of_common, start
from filters.state import ACCEL_BIAS, ATTITUDE, GYRO_BIAS, POSITION, SIZE, VELOCITY, NavState
from filters.types import Array

__all__ = ["Belief", "common", "correct", "jacobian", "of_common", "predict", "start", "transition"]


def predict(
    belief: Belief, gyro: Array, accel: Array, dt: float, gravity: float, Q_d: Array, kappa: float = 0.0
) -> Belief:
    """Prediction phase, equations (8) and (9) in discrete form: P ← Φ P Φᵀ + Q_d.

    Parameters as `spkf.predict`. `kappa` is there so that all filters are called alike: this one has no sigma points.
    """
    nav, Phi = transition(belief.nav, gyro, accel, dt, gravity)
    P = Phi @ belief.P @ Phi.T + Q_d
    return Belief(nav, 0.5 * (P + P.T))


def transition(nav: NavState, gyro: Array, accel: Array, dt: float, gravity: float) -> tuple[NavState, Array]:
    """State after `dt` and the matrix Φ that takes its errors there: Φ̇ = F(t) Φ, Φ(0) = I.

    By the classical Runge-Kutta rule over the substeps of `strapdown`, F being taken along the propagated mean at the
    start, the middle and the end of each.

    `nav`: one state, at the start; the readings, `dt` and `gravity` as in `spkf.predict`.
    Returns the state at the end, and Φ, shape (15, 15).
    """
    h, rates, forces = strapdown.substep_readings(gyro, accel, nav.gyro_bias, dt)
    Phi = np.eye(SIZE)
    for i in range(0, len(rates) - 1, 2):
        middle = strapdown.propagate(nav, rates[i : i + 2], forces[i : i + 2], 0.5 * h, gravity)
        end = strapdown.propagate(nav, rates[i : i + 3 : 2], forces[i : i + 3 : 2], h, gravity)
        F0, F1, F2 = jacobian(nav, forces[i]), jacobian(middle, forces[i + 1]), jacobian(end, forces[i + 2])
        K1 = F0
        K2 = F1 + 0.5 * h * F1 @ K1
        K3 = F1 + 0.5 * h * F1 @ K2
        K4 = F2 + h * F2 @ K3
        Phi = Phi + h / 6.0 * (K1 + 2.0 * (K2 + K3) + K4) @ Phi
        nav = end
    return nav, Phi


def jacobian(nav: NavState, accel: Array) -> Array:
    """Equation (6), corrected: F of ė = F e for the 15 errors e of `filters.state`, to first order.

    `nav`: one state.
    `accel`: measured specific force, m/s², body, shape (3,). Angular rate does not appear: the error ε is in n.
    Returns shape (15, 15), SI.
    """
    phi, h = float(nav.latitude), float(nav.height)
    s, c, t = np.sin(phi), np.cos(phi), np.tan(phi)
    v_n, v_e, v_d = nav.velocity_n
    R_n, R_e = (float(radius) for radius in earth.curvature(nav.latitude, nav.height))
    # change of both radii with latitude
    flattening = earth.ECCENTRICITY_SQUARED * s * c / (1.0 - earth.ECCENTRICITY_SQUARED * s * s)
    dR_n, dR_e = 3.0 * (R_n - h) * flattening, (R_e - h) * flattening
    spin = earth.EARTH_RATE
    rate_n = np.array([spin * c + v_e / R_e, -v_n / R_n, -spin * s - v_e * t / R_e])
    force_n = nav.C_nb @ (accel - nav.accel_bias)

    # derivatives of V̇ in (2) and of the navigation frame's rate in (3) by latitude, height and velocity
    dv_dphi = np.array(
        [
            -2.0 * spin * v_e * c - v_n * v_d * dR_n / R_n**2 - v_e**2 / (R_e * c * c) + v_e**2 * t * dR_e / R_e**2,
            2.0 * spin * (v_n * c - v_d * s) + v_e * v_n / (R_e * c * c) - v_e * (v_n * t + v_d) * dR_e / R_e**2,
            2.0 * spin * v_e * s + v_e**2 * dR_e / R_e**2 + v_n**2 * dR_n / R_n**2,
        ]
    )
    dv_dh = np.array(
        [
            v_e**2 * t / R_e**2 - v_n * v_d / R_n**2,
            -v_e * (v_n * t + v_d) / R_e**2,
            v_e**2 / R_e**2 + v_n**2 / R_n**2,
        ]
    )
    dv_dv = np.array(
        [
            [v_d / R_n, -2.0 * (spin * s + v_e * t / R_e), v_n / R_n],
            [2.0 * spin * s + v_e * t / R_e, (v_n * t + v_d) / R_e, 2.0 * spin * c + v_e / R_e],
            [-2.0 * v_n / R_n, -2.0 * (spin * c + v_e / R_e), 0.0],
        ]
    )
    dw_dphi = np.array(
        [
            -spin * s - v_e * dR_e / R_e**2,
            v_n * dR_n / R_n**2,
            -spin * c - v_e / (R_e * c * c) + v_e * t * dR_e / R_e**2,
        ]
    )
    dw_dh = np.array([-v_e / R_e**2, v_n / R_n**2, v_e * t / R_e**2])
    dw_dv = np.array([[0.0, 1.0 / R_e, 0.0], [-1.0 / R_n, 0.0, 0.0], [0.0, -t / R_e, 0.0]])

    F = np.zeros((SIZE, SIZE))
    F[POSITION, VELOCITY] = np.eye(3)
    # δp_N = R_n δφ and δp_E = R_e cos φ δλ: the radii of the moving mean change as well
    F[0, 0], F[0, 2] = -v_d / R_n, v_n / R_n
    F[1, 0] = v_e / R_n * (t - dR_e / R_e)
    F[1, 1], F[1, 2] = (dR_e * v_n / R_n - v_d) / R_e - t * v_n / R_n, v_e / R_e
    F[VELOCITY, 0], F[VELOCITY, 2] = dv_dphi / R_n, -dv_dh
    F[VELOCITY, VELOCITY] = dv_dv
    F[VELOCITY, ATTITUDE] = -attitude.skew(force_n)
    F[VELOCITY, ACCEL_BIAS] = -nav.C_nb
    F[ATTITUDE, 0], F[ATTITUDE, 2] = -dw_dphi / R_n, dw_dh
    F[ATTITUDE, VELOCITY] = -dw_dv
    F[ATTITUDE, ATTITUDE] = -attitude.skew(rate_n)
    F[ATTITUDE, GYRO_BIAS] = -nav.C_nb
    return F
