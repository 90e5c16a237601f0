"""The 15-state sigma-point Kalman filter, equations (11)-(15) and the correction of (10).

Written to be read, in numpy: all 31 sigma points go through `strapdown.propagate` in one array. The errors live in the
tangent space of the state (metres, m/s, rotation vector in n, biases), so that neither latitude's nor attitude's size
matters and no attitude is special.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from filters import state, strapdown
from filters.imu import ImuSpec
from filters.reference import Reference
from filters.state import NavState
from filters.types import Array

PAPER_KAPPA = -12.0
"""κ with n + κ = 3, as the paper suggests; the centre weight is then -4 and P can lose definiteness without updates."""

P0_ACCEL_BIAS_SD = 18e-3 * 9.80665
"""m/s²; 1.5 times Table 1."""
P0_GYRO_BIAS_SD = 1.5 * np.pi / 180.0
"""rad/s; 1.5 times Table 1."""


class DivergenceError(ArithmeticError):
    """The covariance lost definiteness, or the state stopped being finite."""


@dataclass(frozen=True, slots=True)
class Belief:
    """Estimate and its covariance.

    Attributes
    ----------
    nav : NavState
        The 15 estimated quantities.
    P : Array
        Covariance of their errors, shape (15, 15), order of `filters.state`, SI.
    """

    nav: NavState
    P: Array


@dataclass(frozen=True, slots=True)
class Innovation:
    """Reference minus prediction, before the update.

    Attributes
    ----------
    nu : Array
        Shape (m,): m, m/s, rad.
    S : Array
        Its covariance H P Hᵀ + R, shape (m, m).
    nis : float
        νᵀ S⁻¹ ν; chi-square with m degrees of freedom if ν is a draw from S.
    """

    nu: Array
    S: Array
    nis: float


def start(reference: Reference) -> Belief:
    """Belief before the first sample: the reference itself, no biases, P0 of the paper's noise set.

    Parameters
    ----------
    reference : Reference
        What is known.

    Returns
    -------
    Belief
    """
    sd = np.concatenate([reference.P0_sd, np.full(3, P0_ACCEL_BIAS_SD), np.full(3, P0_GYRO_BIAS_SD)])
    return Belief(reference.nav, np.diag(sd**2))


def predict(
    belief: Belief, gyro: Array, accel: Array, dt: float, gravity: float, Q_d: Array, kappa: float = 0.0
) -> Belief:
    """Prediction phase, equations (11)-(15) with Q_d added in (15).

    χ⁰ = x̂, χ^{i, i+n} = x̂ ± (columns of L √(n+κ)), P = L Lᵀ; each integrated over dt; the mean is that of the
    differences to the propagated centre, which is exact where the plain sum of angles is not.

    Parameters
    ----------
    belief : Belief
        At the start of the step.
    gyro, accel : Array
        The sample held over the step, rad/s and m/s², body, shape (3,).
    dt : float
        s, positive.
    gravity : float
        Local gravity, m/s².
    Q_d : Array
        Diagonal of the discrete process noise, shape (15,).
    kappa : float
        κ of (11); n + κ must be positive. 0 keeps every weight non-negative.

    Returns
    -------
    Belief
        At the end of the step.

    Raises
    ------
    DivergenceError
        If P has no Cholesky factor or the state is not finite.
    ValueError
        If `dt` or n + `kappa` is not positive.
    """
    if not dt > 0.0:
        raise ValueError(f"`dt` is {dt}, not positive")
    n = state.SIZE
    if not n + kappa > 0.0:
        raise ValueError(f"`kappa` is {kappa}: n + kappa must be positive, n = {n}")
    L = np.sqrt(n + kappa) * _cholesky(belief.P, "state covariance")
    deviations = np.concatenate([np.zeros((1, n)), L.T, -L.T])
    weights = np.full(2 * n + 1, 0.5 / (n + kappa))
    weights[0] = kappa / (n + kappa)

    points = strapdown.propagate(belief.nav.plus(deviations), gyro, accel, dt, gravity)
    centre = NavState(
        points.latitude[0],
        points.longitude[0],
        points.height[0],
        points.velocity_n[0],
        points.C_nb[0],
        points.accel_bias[0],
        points.gyro_bias[0],
    )
    errors = points.minus(centre)
    mean = weights @ errors
    spread = errors - mean
    P = (weights * spread.T) @ spread + np.diag(Q_d)
    return Belief(centre.plus(mean), P)


def process_noise(spec: ImuSpec, dt: float, held: float = 1.0) -> Array:
    """Diagonal of Q_d: white noise of Table 1 times dt on velocity and attitude, no bias walk.

    Parameters
    ----------
    spec : ImuSpec
        Noise densities.
    dt : float
        s.
    held : float
        How many sample periods one sample stands for. Across a gap it stands for many, and its noise, held,
        adds up coherently: the variance grows with dt times this number.

    Returns
    -------
    Array
        Shape (15,).
    """
    Q_d = np.zeros(state.SIZE)
    Q_d[state.VELOCITY] = spec.accel_vrw**2 * dt * held
    Q_d[state.ATTITUDE] = spec.gyro_arw**2 * dt * held
    return Q_d


def correct(belief: Belief, reference: Reference, drawn: Array | None = None) -> tuple[Belief, Innovation]:
    """Correction phase, equation (10) with H the identity on the known rows, P in Joseph's form.

    Parameters
    ----------
    belief : Belief
        Predicted.
    reference : Reference
        The known navigation state, its rows and R.
    drawn : Array or None
        A draw from N(0, I), shape (m,): the pseudo-measurement is then the reference plus noise of covariance R, and
        NIS is a test. None feeds the reference exact.

    Returns
    -------
    Belief
        Corrected.
    Innovation
        Before the update.

    Raises
    ------
    DivergenceError
        If S has no Cholesky factor.
    """
    rows = reference.rows
    nu = reference.nav.minus(belief.nav)[rows]
    if drawn is not None:
        nu = nu + reference.R_sd * drawn
    R = np.diag(reference.R_sd**2)
    PHt = belief.P[:, rows]
    S = PHt[rows] + R
    L = _cholesky(S, "innovation covariance")
    # one triangular solve serves the gain and NIS: S⁻¹ = L⁻ᵀ L⁻¹
    whitened = linalg.solve_triangular(L, np.column_stack([PHt.T, nu]), lower=True, check_finite=False)
    K = linalg.solve_triangular(L, whitened[:, :-1], lower=True, trans=1, check_finite=False).T
    nis = float(whitened[:, -1] @ whitened[:, -1])
    A = np.eye(state.SIZE)
    A[:, rows] -= K
    P = A @ belief.P @ A.T + (K * reference.R_sd**2) @ K.T
    return Belief(belief.nav.plus(K @ nu), 0.5 * (P + P.T)), Innovation(nu, S, nis)


def _cholesky(P: Array, name: str) -> Array:
    """Lower factor of P; its definiteness does not depend on the states' units, so nothing is added to help it."""
    try:
        return np.asarray(np.linalg.cholesky(P), float)
    except np.linalg.LinAlgError as error:
        raise DivergenceError(f"the {name} is not positive definite") from error
