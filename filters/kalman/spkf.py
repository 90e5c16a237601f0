"""The 15-state sigma-point Kalman filter, equations (11)-(15) and the correction of (10).

Written to be read, in numpy: all 31 sigma points go through `strapdown.propagate` in one array. The errors live in the
tangent space of the state (metres, m/s, rotation vector in n, biases), so that neither latitude's nor attitude's size
matters and no attitude is special. What runs is `kernels`, the same step compiled; a test holds the two together.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from filters import state
from filters.errors import InputError
from filters.imu import Noise
from filters.kalman import strapdown
from filters.state import NavState
from filters.types import Array

PAPER_KAPPA = -12.0
"""κ with n + κ = 3, as the paper suggests; the centre weight is then -4 and P can lose definiteness without updates."""


class DivergenceError(InputError):
    """The covariance lost definiteness, or the state stopped being finite."""


@dataclass(frozen=True, slots=True)
class Belief:
    """Estimate and its covariance."""

    nav: NavState  # the 15 estimated quantities
    P: Array  # covariance of their errors, shape (15, 15), order of `filters.state`, SI


@dataclass(frozen=True, slots=True)
class Innovation:
    """Reference minus prediction, before the update."""

    nu: Array  # shape (m,): m, m/s, rad
    S: Array  # its covariance H P Hᵀ + R, shape (m, m)
    nis: float  # νᵀ S⁻¹ ν; chi-square with m degrees of freedom if ν is a draw from S
    accepted: bool = True  # whether it passed the gate; if not, the update was left out


def start(nav: NavState, P0_sd: Array) -> Belief:
    """Belief before the first sample: what is known, and standard deviations of its errors, shape (15,)."""
    if P0_sd.shape != (state.SIZE,):
        raise ValueError(f"`P0_sd` has shape {P0_sd.shape}, not ({state.SIZE},)")
    return Belief(nav, np.diag(P0_sd**2))


def common(belief: Belief) -> Belief:
    """Belief in the errors of `filters.state`: this filter's own."""
    return belief


of_common = common  # the inverse of `common`


def predict(
    belief: Belief, gyro: Array, accel: Array, dt: float, gravity: float, Q_d: Array, kappa: float = 0.0
) -> Belief:
    """Prediction phase, equations (11)-(15) with Q_d added in (15).

    χ⁰ = x̂, χ^{i, i+n} = x̂ ± (columns of L √(n+κ)), P = L Lᵀ; each integrated over dt; the mean is that of the
    differences to the propagated centre, which is exact where the plain sum of angles is not.

    `belief`: at the start of the step.
    `gyro`, `accel`: readings at the start and the end of the step, linear between, rad/s and m/s², body, shape (2, 3);
      or held over the step, shape (3,).
    `dt`: s, positive.
    `gravity`: local gravity, m/s².
    `Q_d`: discrete process noise, shape (15, 15).
    `kappa`: κ of (11); n + κ must be positive. 0 keeps every weight non-negative.
    Returns at the end of the step.
    Raises DivergenceError if P has no Cholesky factor or the state is not finite.
    Raises ValueError if `dt` or n + `kappa` is not positive.
    """
    deviations, weights = sigma_points(belief.P, kappa)
    points = strapdown.propagate(belief.nav.plus(deviations), gyro, accel, dt, gravity)
    centre = points.at(0)
    mean, P = moments(points.minus(centre), weights)
    return Belief(centre.plus(mean), P + Q_d)


def sigma_points(P: Array, kappa: float) -> tuple[Array, Array]:
    """Deviations (2n + 1, n) of the sigma points (11) of a covariance (n, n), the centre first, and their weights.

    Raises DivergenceError if P has no Cholesky factor, ValueError if n + `kappa` is not positive.
    """
    n = len(P)
    if not n + kappa > 0.0:
        raise ValueError(f"`kappa` is {kappa}: n + kappa must be positive, n = {n}")
    L = np.sqrt(n + kappa) * cholesky(P, "state covariance")
    weights = np.full(2 * n + 1, 0.5 / (n + kappa))
    weights[0] = kappa / (n + kappa)
    return np.concatenate([np.zeros((1, n)), L.T, -L.T]), weights


def moments(errors: Array, weights: Array) -> tuple[Array, Array]:
    """Mean (14) and covariance (15), without Q_d, of weighted points (2n + 1, n)."""
    mean = weights @ errors
    spread = errors - mean
    return mean, (weights * spread.T) @ spread


def process_noise(noise: Noise, C_nb: Array, dt: float, held: float = 1.0, turned: float = 0.0) -> Array:
    """Q_d = G Q Gᵀ dt: white noise on velocity and attitude, turned into n, and the walk of the biases.

    `noise`: densities, body axes. The paper's set has no bias walk.
    `C_nb`: attitude, shape (3, 3).
    `dt`: s.
    `held`: how many sample periods one sample stands for. Across a gap it stands for many, and its noise, held, adds up
      coherently: the variance grows with dt times this number.
    `turned`: angle that the unit may have turned unseen, in a gap, rad.
    Returns shape (15, 15).
    """
    Q_d = np.zeros((state.SIZE, state.SIZE))
    Q_d[state.VELOCITY, state.VELOCITY] = (C_nb * np.square(noise.accel_vrw) * dt * held) @ C_nb.T
    Q_d[state.ATTITUDE, state.ATTITUDE] = (C_nb * np.square(noise.gyro_arw) * dt * held) @ C_nb.T
    Q_d[state.ATTITUDE, state.ATTITUDE] += np.eye(3) * turned**2
    np.fill_diagonal(Q_d[state.ACCEL_BIAS, state.ACCEL_BIAS], np.square(noise.accel_walk) * dt)
    np.fill_diagonal(Q_d[state.GYRO_BIAS, state.GYRO_BIAS], np.square(noise.gyro_walk) * dt)
    return Q_d


def correct(
    belief: Belief,
    known: NavState,
    rows: NDArray[np.int_],
    R_sd: Array,
    drawn: Array | None = None,
    gate: float = np.inf,
) -> tuple[Belief, Innovation]:
    """Correction phase, equation (10) with H the identity on the known rows, P in Joseph's form.

    `belief`: predicted.
    `known`: the reference.
    `rows`: indices of the error states that are known, shape (m,).
    `R_sd`: standard deviations of those rows, m, m/s, rad about n, shape (m,).
    `drawn`: a draw from N(0, I), shape (m,): the pseudo-measurement is then the reference plus noise of covariance R,
      and NIS is a test. None feeds the reference exact.
    `gate`: NIS above which the update is left out.
    Returns corrected.
    Returns before the update.
    Raises DivergenceError if S has no Cholesky factor.
    """
    nu = known.minus(belief.nav)[rows]
    if drawn is not None:
        nu = nu + R_sd * drawn
    K, P, innovation = gain(belief.P, nu, rows, R_sd)
    if innovation.nis > gate:
        return belief, replace(innovation, accepted=False)
    return Belief(belief.nav.plus(K @ nu), P), innovation


def gain(P: Array, nu: Array, rows: NDArray[np.int_], R_sd: Array) -> tuple[Array, Array, Innovation]:
    """Gain (n, m) and covariance (n, n) of (10), for any number of states n, and the innovation with S and NIS.

    `P`: covariance before, shape (n, n).
    `nu`, `rows`, `R_sd`: innovation, which states it is of, standard deviations of the measurement; shape (m,).
    """
    PHt = P[:, rows]
    S = PHt[rows] + np.diag(R_sd**2)
    L = cholesky(S, "innovation covariance")
    K, nis = gain_and_nis(L, PHt, nu)
    A = np.eye(len(P))
    A[:, rows] -= K
    after = A @ P @ A.T + (K * R_sd**2) @ K.T
    return K, 0.5 * (after + after.T), Innovation(nu, S, nis)


def gain_and_nis(L: Array, PHt: Array, nu: Array) -> tuple[Array, float]:
    """K = P Hᵀ S⁻¹, shape (n, m), and νᵀ S⁻¹ ν, from the lower factor of S, P Hᵀ (n, m), and the innovation (m,)."""
    # here, since the compiled filter shares this module's records and should not wait for it
    from scipy import linalg

    # one triangular solve serves the gain and NIS: S⁻¹ = L⁻ᵀ L⁻¹
    whitened = linalg.solve_triangular(L, np.column_stack([PHt.T, nu]), lower=True, check_finite=False)
    K = linalg.solve_triangular(L, whitened[:, :-1], lower=True, trans=1, check_finite=False).T
    return K, float(whitened[:, -1] @ whitened[:, -1])


def cholesky(P: Array, name: str) -> Array:
    """Lower factor of P; its definiteness does not depend on the states' units, so nothing is added to help it."""
    try:
        return np.asarray(np.linalg.cholesky(P), float)
    except np.linalg.LinAlgError as error:
        raise DivergenceError(f"the {name} is not positive definite") from error
