"""Weighted least squares with an error of the model beside the noise, and what a fit says of each of its parts.

Observations come in groups; each group has a variance beyond its noise, which is fitted too: no rest is perfectly
still, no unit is quite linear. What is left out: what the observations are.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from filters.types import Array

Residuals = Callable[[Array], tuple[Array, Array]]  # residuals (n,) and their derivatives (n, p) at parameters (p,)
_ROUNDS = 6


@dataclass(frozen=True)
class Fit:
    """A fit, and its neighbourhood taken as linear."""

    theta: Array  # parameters, shape (p,)
    covariance: Array  # of them, with the error of the model in it, shape (p, p)
    residual: Array  # of the observations, shape (n,)
    slope: Array  # derivative of the residuals, shape (n, p)
    noise: Array  # variance of the residuals by noise alone, shape (n,)
    excess: Array  # variance beyond it, of each group
    group: NDArray[np.int_]  # of each observation, shape (n,)
    prior: Array  # standard deviations that the fit began with, shape (p,)

    @property
    def variance(self) -> Array:
        """Of the residuals, noise and error of the model, shape (n,)."""
        return np.asarray(self.noise + self.excess[self.group])

    @property
    def chi2(self) -> float:
        """Weighted sum of squares."""
        return float(np.sum(self.residual**2 / self.variance))

    @property
    def sd(self) -> Array:
        """Of the parameters, shape (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def gain(self, which: slice | NDArray[np.int_]) -> float:
        """By how much chi-square would grow without some of the parameters."""
        part = self.theta[which]
        rows = np.arange(self.theta.size)[which]
        return float(part @ np.linalg.solve(self.covariance[np.ix_(rows, rows)], part)) if rows.size else 0.0

    def without(self, which: slice | NDArray[np.int_]) -> "Fit":
        """The fit with some parameters held at zero, taken as linear; they are no longer in it."""
        rows = np.arange(self.theta.size)[which]
        rest = np.setdiff1d(np.arange(self.theta.size), rows)
        step = -self.covariance[:, rows] @ np.linalg.solve(self.covariance[np.ix_(rows, rows)], self.theta[rows])
        slope = self.slope[:, rest]
        return replace(
            self,
            theta=(self.theta + step)[rest],
            covariance=_covariance(slope, self.variance, self.prior[rest]),
            residual=self.residual + self.slope @ step,
            slope=slope,
            prior=self.prior[rest],
        )

    def left_out(self, rows: NDArray[np.int_]) -> Array:
        """Residuals of some observations under a fit to all others, taken as linear."""
        part = self.slope[rows]
        leverage = part @ self.covariance @ part.T / self.variance[rows]
        # what nothing but these observations says has no residual without them: the prior's
        return np.asarray(np.linalg.solve(np.eye(rows.size) - np.minimum(leverage, 1.0 - 1e-9), self.residual[rows]))


def fit(
    residuals: Residuals,
    start: Array,
    noise: Array,
    group: NDArray[np.int_],
    prior: Array,
    excess: Array | None = None,
) -> Fit:
    """Fit parameters and, unless it is given, the error of the model of each group.

    `residuals`: see `Residuals`.
    `start`: parameters to begin from, shape (p,).
    `noise`: variance of the residuals by noise alone, shape (n,).
    `group`: group of each, from 0, shape (n,).
    `prior`: wide standard deviations of the parameters about zero, shape (p,).
    `excess`: variance beyond the noise, of each group; None has it fitted.
    """
    theta = start
    rounds = 1 if excess is not None else _ROUNDS
    own = np.zeros(int(group.max(initial=-1)) + 1) if excess is None else excess
    made = _solved(residuals, theta, noise, group, prior, own)
    for _ in range(rounds - 1):
        found = _excess(made)
        done = np.allclose(found, own, rtol=1e-3, atol=1e-30)
        own = found
        made = _solved(residuals, made.theta, noise, group, prior, own)
        if done:
            break
    return made


def _solved(
    residuals: Residuals, start: Array, noise: Array, group: NDArray[np.int_], prior: Array, excess: Array
) -> Fit:
    sd = np.sqrt(noise + excess[group])
    known: dict[bytes, tuple[Array, Array]] = {}

    def both(theta: Array) -> tuple[Array, Array]:
        # residuals and slopes come of one pass through the readings, and are asked for one after the other
        if theta.tobytes() not in known:
            known.clear()
            known[theta.tobytes()] = residuals(theta)
        return known[theta.tobytes()]

    if start.size:
        solved = optimize.least_squares(
            lambda theta: np.concatenate([both(theta)[0] / sd, theta / prior]),
            start,
            lambda theta: np.vstack([both(theta)[1] / sd[:, None], np.diag(1.0 / prior)]),
            x_scale=prior,
            xtol=1e-6,
            ftol=1e-9,
            max_nfev=30,
        )
        start = np.asarray(solved.x)
    r, J = both(start)
    return Fit(start, _covariance(J, sd**2, prior), r, J, noise, excess, group, prior)


def _covariance(slope: Array, variance: Array, prior: Array) -> Array:
    # scaled by the prior, so that parameters of very different units are inverted alike
    scaled = slope * prior
    return np.asarray(np.linalg.inv((scaled.T / variance) @ scaled + np.eye(prior.size)) * np.outer(prior, prior))


def _excess(made: Fit) -> Array:
    """Variance beyond the noise of each group that makes its residuals as likely as can be."""
    leverage = np.einsum("ip,pq,iq->i", made.slope, made.covariance, made.slope) / made.variance
    out = np.zeros(made.excess.size)
    for g in range(out.size):
        at = made.group == g
        n = int(at.sum())
        if not n:
            continue
        # parameters make residuals smaller than errors are
        free = max(1.0, n - float(np.minimum(leverage[at], 1.0).sum()))
        squares, noise = made.residual[at] ** 2 * (n / free), made.noise[at]
        out[g] = _likeliest(squares, noise) if squares.mean() > 1e-3 * noise.mean() else 0.0
    return out


def _likeliest(squares: Array, noise: Array) -> float:
    least = 1e-3 * float(noise.mean())
    most = 10.0 * float(squares.max()) + least

    def cost(log: float) -> float:
        variance = noise + np.exp(log)
        return float(np.sum(np.log(variance) + squares / variance))

    found = optimize.minimize_scalar(cost, bounds=(float(np.log(least)), float(np.log(most))), method="bounded")
    nothing = float(np.sum(np.log(noise) + squares / noise))
    return float(np.exp(found.x)) if found.fun < nothing else 0.0
