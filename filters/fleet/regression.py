"""Each unit's values as a line over time and temperature, with one scatter between power-ons common to all units.

    y_ij = x_ijᵀ β_i + b_ij + e_ij,   b_ij ~ N(0, σ_p²),   e_ij ~ N(0, s_ij²), s_ij known

With W = diag(1/(σ_p² + s_ij²)) and M = XᵀWX, unit by unit, the restricted log likelihood is a sum of

    -½ [-log det W + log det M + rᵀWr],   r = y - X M⁻¹XᵀW y

and its information of ½ [tr W² - 2 tr M⁻¹XᵀW³X + tr (M⁻¹XᵀW²X)²]. Integrated over σ_p with Jeffreys' prior, a slope has
Student's distribution where all variances are equal.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from filters.fleet import grid, mixture
from filters.fleet.grid import Grid
from filters.fleet.mixture import Estimate
from filters.types import Array

_RANGE = 1e5
_TINY = 1e-300
_UNLIKE = 0.01
"""Probability below which a unit scatters more about its line than the others do, and is judged by its own scatter."""


@dataclass(frozen=True, slots=True)
class Line:
    """Values of a unit and what they are a line of."""

    # y, variances: values and variances of measurement, shape (J,)
    y: Array
    variances: Array
    X: Array  # columns of full rank, shape (J, k), J at least k

    @property
    def dof(self) -> int:
        """Values less columns."""
        return int(self.y.size - self.X.shape[1])


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A coefficient of a line, with the probability of one as far from 0 by chance."""

    estimate: Estimate
    p: float


@dataclass(frozen=True, slots=True)
class _Given:
    """Of one unit where σ_p is given, for G of them."""

    log_likelihood: Array
    information: Array
    beta: Array
    covariance: Array
    chi2: Array


def coefficients(lines: Sequence[Line]) -> list[tuple[Coefficient, ...] | None]:
    """Coefficients of each unit's line; None of a unit where nothing tells the scatter between power-ons.

    A unit that scatters about its line more than the common σ_p allows (p < 0.01) is judged by its own.

    `lines`: one a unit.
    """
    told = [line for line in lines if line.dof > 0]
    if not told:
        return [None] * len(lines)
    common = _scatter(told)
    return [_of_unit(line, common) for line in lines]


def _of_unit(line: Line, common: Grid) -> tuple[Coefficient, ...]:
    points, given = common, _given(line, common.sds[:, 0])
    if line.dof > 0 and chdtrc(line.dof, float(points.weights @ given.chi2)) < _UNLIKE:
        points = _scatter([line])
        given = _given(line, points.sds[:, 0])
    variances = np.diagonal(given.covariance, axis1=1, axis2=2)
    found = mixture.estimates(points.weights, given.beta, variances)
    return tuple(
        Coefficient(one, mixture.two_sided(points.weights, given.beta[:, k], np.sqrt(variances[:, k])))
        for k, one in enumerate(found)
    )


def _scatter(lines: Sequence[Line]) -> Grid:
    """What is known of the standard deviation between power-ons."""

    def density(sds: Array) -> Array:
        every = [_given(line, sds[:, 0]) for line in lines]
        information = np.sum([one.information for one in every], axis=0)
        likelihood = np.sum([one.log_likelihood for one in every], axis=0)
        told: Array = likelihood + 0.5 * np.log(np.maximum(information, _TINY)) + 2.0 * np.log(sds[:, 0])
        return told

    variances = np.concatenate([line.variances for line in lines])
    spread = max(*(float(np.ptp(line.y)) for line in lines), float(np.sqrt(variances.max())))
    low = 1e-3 * min(float(np.sqrt(variances.min())), spread)
    return grid.integrate(density, low, _RANGE * spread, 1, variances.size)


def _given(line: Line, sds: Array) -> _Given:
    X, y = line.X, line.y
    w = 1.0 / (sds[:, None] ** 2 + line.variances)
    columns = X.shape[1]
    products = (X[:, :, None] * X[:, None, :]).reshape(-1, columns**2)
    M, M2, M3 = ((w**n @ products).reshape(-1, columns, columns) for n in (1, 2, 3))
    inverse = np.asarray(np.linalg.inv(M), np.float64)
    beta = (inverse @ ((w * y) @ X)[:, :, None])[:, :, 0]
    chi2 = np.sum(w * (y - beta @ X.T) ** 2, axis=1)
    told = -np.sum(np.log(w), axis=1) + np.linalg.slogdet(M)[1] + chi2
    A = inverse @ M2
    squares: Array = np.sum(w**2, axis=1) - 2.0 * np.trace(inverse @ M3, axis1=1, axis2=2)
    squares += np.trace(A @ A, axis1=1, axis2=2)
    return _Given(-0.5 * told, 0.5 * np.maximum(squares, 0.0), beta, inverse, chi2)
