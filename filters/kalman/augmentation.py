"""Effects that join the filter: extra states with a regressor, noise that depends on the sample, samples not used.

An effect that was found in the residual (e = φ(k) x) is taken along instead of being subtracted: its coefficients x are
p more states, whose prior is what was found, so that the filter goes on estimating them and its covariance knows what
it does not know of them:

    b_eff(k) = b + φ(k) x(k)        reading - b_eff(k) is what (1)-(4) integrate
    x' = -x/τ + w                   τ infinite and w zero: a constant; else a drift, whose φ is 1 on its channel

Here are the boundary, `Effects`, and the filter on 15 + p states written to be read. What runs is `kernels`, which
takes 15 lanes through whatever p is; a test holds the two together. Left out: which effects there are, and their
physics.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from filters import state
from filters.errors import InputError
from filters.kalman import spkf, strapdown
from filters.kalman.spkf import Belief, Innovation
from filters.state import NavState
from filters.types import Array

_ROUNDING = 1e-9


class Effects(Protocol):
    """What joins the filter, for one run: an instance may remember what it was shown, such as a lagged temperature."""

    names: tuple[str, ...]  # one a state, for messages and results
    # mean, covariance: of the states before the first sample, shapes (p,) and (p, p)
    mean: Array
    covariance: Array
    tau: Array  # time constants, s, shape (p,); infinity for what does not decay
    q: Array  # noise densities, unit of the state per √s, shape (p,); 0 for what is constant

    def rows(
        self, t: Array, gyro: Array, accel: Array, temperature: Array, known: Array
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Regressor, noise and use of the next samples.

        Causal, and the same to the last bit whether samples come one by one or many at once.

        `t`: s since the first sample, shape (N,); each sample is shown once, in order.
        `gyro`, `accel`: readings, rad/s and m/s², body axes, shape (N, 3).
        `temperature`: degC, shape (N,); NaN where it is not known.
        `known`: what the reference says of these samples, shape (N, 25), columns of `filters.motion.reference`.
        Returns `phi`, regressor, shape (N, 6, p), accelerometer then gyro, body axes, SI; finite.
        Returns `noise_scale`, factor on the standard deviation of white noise, shape (N, 6), same order; finite, not
          negative.
        Returns `use`, whether the sample is a reading, shape (N,); if not, the filter predicts through it.
        """
        ...


MakeEffects = Callable[[], Effects]
"""Makes the effects of one run: they may have a memory, so that two runs never share them."""


def check(effects: Effects) -> None:
    """Refuse effects whose numbers do not belong together.

    Raises InputError naming what is wrong.
    """
    p = len(effects.names)
    for name, value, shape in (
        ("mean", effects.mean, (p,)),
        ("covariance", effects.covariance, (p, p)),
        ("tau", effects.tau, (p,)),
        ("q", effects.q, (p,)),
    ):
        if np.shape(value) != shape:
            raise ValueError(f"`{name}` of the effects has shape {np.shape(value)}, not {shape}: {p} states are named")
        if not np.isfinite(value).all() and name != "tau":
            raise InputError(f"`{name}` of the effects is not finite: {value}")
    if not np.all(effects.tau > 0.0):
        raise InputError(f"`tau` of the effects is {effects.tau} s, not positive")
    if not np.all(effects.q >= 0.0):
        raise InputError(f"`q` of the effects is {effects.q}, negative")
    P = effects.covariance
    sd = np.sqrt(np.maximum(np.diag(P), 0.0))
    unit = P / np.outer(np.where(sd > 0.0, sd, 1.0), np.where(sd > 0.0, sd, 1.0))
    if not np.allclose(unit, unit.T, atol=_ROUNDING) or (p and np.linalg.eigvalsh(unit)[0] < -_ROUNDING):
        raise InputError("`covariance` of the effects is not symmetric and positive")


def check_rows(names: tuple[str, ...], t: Array, phi: Array, scale: Array, use: NDArray[np.bool_]) -> None:
    """Refuse rows that no filter can use; samples that are not used may hold anything.

    Raises InputError naming the state and the time of the first one.
    """
    n, p = t.size, len(names)
    for name, value, shape in (("phi", phi, (n, 6, p)), ("noise_scale", scale, (n, 6)), ("use", use, (n,))):
        if np.shape(value) != shape:
            raise ValueError(f"`{name}` of the effects has shape {np.shape(value)}, not {shape}")
    wrong = use[:, None] & ~np.isfinite(phi).all(axis=1)
    if wrong.any():
        k, j = np.argwhere(wrong)[0]
        raise InputError(
            f'the effect "{names[j]}" depends on what is not known at {t[k]:.3f} s, such as a temperature that the'
            " readings come without"
        )
    wrong = use[:, None] & ~(np.isfinite(scale) & (scale >= 0.0))
    if wrong.any():
        k, channel = np.argwhere(wrong)[0]
        raise InputError(f"`noise_scale` of the effects is {scale[k, channel]} at {t[k]:.3f} s")


# --------------------------------------------------------------------------------------- the filter, written to be read


@dataclass(frozen=True, slots=True)
class Augmented:
    """Estimate with extra states."""

    nav: NavState  # the 15 estimated quantities
    x: Array  # the extra states, shape (p,)
    P: Array  # covariance of all errors, shape (15 + p, 15 + p)

    def belief(self) -> Belief:
        """The part without extra states."""
        return Belief(self.nav, self.P[: state.SIZE, : state.SIZE])


def start(nav: NavState, P0_sd: Array, effects: Effects) -> Augmented:
    """Belief before the first sample; the extra states are not correlated with the 15."""
    p = effects.mean.size
    P = np.zeros((state.SIZE + p, state.SIZE + p))
    P[: state.SIZE, : state.SIZE] = np.diag(P0_sd**2)
    P[state.SIZE :, state.SIZE :] = effects.covariance
    return Augmented(nav, effects.mean.copy(), P)


def drift(belief: Augmented, tau: Array, q: Array, dt: float) -> Augmented:
    """The extra states `dt` s later: x e^(-dt/τ), with variance q² τ/2 (1 - e^(-2 dt/τ)) more, q² dt for τ infinite."""
    keep = np.exp(-dt / tau)
    A = np.concatenate([np.ones(state.SIZE), keep])
    P = belief.P * np.outer(A, A)
    lasting = np.isinf(tau)
    finite = np.where(lasting, 1.0, tau)
    grown = np.where(lasting, dt, -0.5 * finite * np.expm1(-2.0 * dt / finite))
    P[state.SIZE :, state.SIZE :] += np.diag(q**2 * grown)
    return Augmented(belief.nav, belief.x * keep, P)


def predict(
    belief: Augmented,
    gyro: Array,
    accel: Array,
    phi: Array,
    dt: float,
    gravity: float,
    Q_d: Array,
    kappa: float = 0.0,
) -> Augmented:
    """Prediction (11)-(15) on 15 + p states: each sigma point takes its own φ x from the readings.

    The extra states of `belief` are those of the step's end, by `drift`, and constant over the step. `phi`: regressors
    at start and end, shape (2, 6, p); twice that of the end for readings that are held. Else as `spkf.predict`.
    """
    deviations, weights = spkf.sigma_points(belief.P, kappa)
    x = belief.x + deviations[:, state.SIZE :]
    effects = np.einsum("eip,kp->eki", phi, x)
    readings = gyro[:, None] - effects[..., 3:], accel[:, None] - effects[..., :3]
    points = strapdown.propagate(belief.nav.plus(deviations[:, : state.SIZE]), *readings, dt, gravity)
    centre = points.at(0)
    errors = np.concatenate([points.minus(centre), deviations[:, state.SIZE :]], axis=1)
    mean, P = spkf.moments(errors, weights)
    P[: state.SIZE, : state.SIZE] += Q_d
    return Augmented(centre.plus(mean[: state.SIZE]), belief.x, P)


def correct(
    belief: Augmented,
    known: NavState,
    rows: NDArray[np.int_],
    R_sd: Array,
    drawn: Array | None = None,
    gate: float = np.inf,
) -> tuple[Augmented, Innovation]:
    """Correction (10) of all 15 + p states; parameters and result as `spkf.correct`."""
    nu = known.minus(belief.nav)[rows]
    if drawn is not None:
        nu = nu + R_sd * drawn
    K, P, innovation = spkf.gain(belief.P, nu, rows, R_sd)
    if innovation.nis > gate:
        return belief, replace(innovation, accepted=False)
    change = K @ nu
    return Augmented(belief.nav.plus(change[: state.SIZE]), belief.x + change[state.SIZE :], P), innovation
