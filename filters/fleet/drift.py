"""Which units drift: slope of a value over time, beside that over temperature where temperature varies.

Tests are many, one a unit and channel: `multiple.holm` corrects them, over all that a caller asks of at once. What it
leaves out: what a slope is after a power-on; each power-on is one value here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import chdtrc

from filters.fleet import grid, mixture
from filters.fleet.grid import Grid
from filters.fleet.mixture import Estimate
from filters.types import Array

# --------------------------------------------------------------------------------------------------------- regression
# Each unit's values as a line over time and temperature, with one scatter between power-ons common to all units.
#
#     y_ij = x_ijᵀ β_i + b_ij + e_ij,   b_ij ~ N(0, σ_p²),   e_ij ~ N(0, s_ij²), s_ij known
#
# With W = diag(1/(σ_p² + s_ij²)) and M = XᵀWX, unit by unit, the restricted log likelihood is a sum of
#
#     -½ [-log det W + log det M + rᵀWr],   r = y - X M⁻¹XᵀW y
#
# and its information of ½ [tr W² - 2 tr M⁻¹XᵀW³X + tr (M⁻¹XᵀW²X)²]. Integrated over σ_p with Jeffreys' prior, a slope
# has
# Student's distribution where all variances are equal.

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
    return grid.integrate(density, max(float(np.ptp(line.y)) for line in lines), variances, 1)


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


# -------------------------------------------------------------------------------------------------------------- drift

Verdict = Literal["drift", "temperature", "drift_or_temperature", "none", "too_few"]

LEAST = 3  # Power-ons at different times that a slope takes
LEVEL = 0.05  # of the test, after Holm's correction
_LEAST_KELVIN = 1.0
_CLOSE = 1e-6


@dataclass(frozen=True, slots=True)
class Course:
    """A unit's values over time."""

    # y, variances: one value a power-on and its variance of measurement, shape (J,)
    y: Array
    variances: Array
    t: Array  # when, in any unit, shape (J,)
    temperature: Array | None  # degC, shape (J,); None where it is not known of each


@dataclass(frozen=True, slots=True)
class Drift:
    """Whether a unit drifts."""

    # "drift", "temperature" (it follows temperature, and time explains nothing beside it), "drift_or_temperature"
    # (values change, and time and temperature changed together: not told apart), "none", "too_few"
    verdict: Verdict
    slope: Estimate | None = None  # value a unit of time; beside temperature where `per_kelvin` is there
    # p, p_holm: probability of such a slope by chance, and corrected for all tests
    p: float | None = None
    p_holm: float | None = None
    # value a kelvin; None where temperature is not known, varies by less than 1 K, or power-ons are too few
    per_kelvin: Estimate | None = None
    alone: Estimate | None = None  # slope as if temperature did nothing


@dataclass(frozen=True, slots=True)
class _Fit:
    """Coefficients of a course: time and temperature beside each other, and each alone; None where there is none."""

    time: Coefficient | None = None
    kelvin: Coefficient | None = None
    time_alone: Coefficient | None = None
    kelvin_alone: Coefficient | None = None
    collinear: bool = False


def drifts(groups: Sequence[Sequence[Course]]) -> list[list[Drift]]:
    """Drift of each unit in each group, corrected over all of them.

    `groups`: units that share a scatter between power-ons: those of one model and one channel.
    """
    fits = [fit for group in groups for fit in _fits(group)]
    names = ("time", "kelvin", "time_alone", "kelvin_alone")
    corrected = [_corrected([getattr(fit, name) for fit in fits]) for name in names]
    told = (
        _told(fit, [_sure(one) for one in p], p[0]) for fit, p in zip(fits, zip(*corrected, strict=True), strict=True)
    )
    return [[next(told) for _ in group] for group in groups]


def _told(fit: _Fit, sure: Sequence[bool], p_holm: float | None) -> Drift:
    """What a course shows, by which of its coefficients are sure."""
    time, kelvin, time_alone, kelvin_alone = sure
    alone = fit.time_alone.estimate if fit.time_alone else None
    changes = time_alone or kelvin_alone
    if fit.time is None:
        if not fit.collinear:
            return Drift("too_few")
        return Drift("drift_or_temperature" if changes else "none", alone=alone)
    verdict: Verdict = "drift" if time else "temperature" if kelvin else "none"
    if changes and verdict == "none":
        # each alone explains the change, and neither adds to the other, unless time alone explains nothing
        verdict = "drift_or_temperature" if fit.time_alone and fit.time_alone.p < LEVEL else "temperature"
    return Drift(verdict, fit.time.estimate, fit.time.p, p_holm, fit.kelvin.estimate if fit.kelvin else None, alone)


def _sure(p: float | None) -> bool:
    return p is not None and p < LEVEL


def _corrected(found: Sequence[Coefficient | None]) -> list[float | None]:
    """Probabilities of those that were tested, corrected for their number."""
    tested = [k for k, one in enumerate(found) if one is not None]
    made: list[float | None] = [None] * len(found)
    p = np.array([one.p for one in found if one is not None])
    for k, value in zip(tested, holm(p), strict=True):
        made[k] = float(value)
    return made


def _fits(courses: Sequence[Course]) -> list[_Fit]:
    """All coefficients of the units of a group."""
    enough = [k for k, one in enumerate(courses) if one.y.size >= LEAST and np.ptp(one.t) > 0.0]
    varied = [k for k in enough if _temperature_varies(courses[k])]
    together = [k for k in varied if _told_apart(courses[k])]
    single = [k for k in enough if k not in varied]
    best = _coefficients({k: _line(courses[k], "tT" if k in together else "t") for k in (*together, *single)})
    time = _coefficients({k: _line(courses[k], "t") for k in varied})
    kelvin = _coefficients({k: _line(courses[k], "T") for k in varied})
    return [
        _Fit(
            _column(best.get(k), 1),
            _column(best.get(k), 2),
            _column(time.get(k), 1),
            _column(kelvin.get(k), 1),
            collinear=k in varied and k not in together,
        )
        for k in range(len(courses))
    ]


def _temperature_varies(course: Course) -> bool:
    return course.temperature is not None and float(np.ptp(course.temperature)) >= _LEAST_KELVIN


def _told_apart(course: Course) -> bool:
    """Whether time and temperature did not change as one."""
    assert course.temperature is not None
    return bool(np.corrcoef(course.t, course.temperature)[0, 1] ** 2 < 1.0 - _CLOSE)


_Scaled = tuple[Line, tuple[float, ...]]


def _line(course: Course, over: str) -> _Scaled:
    """A line whose columns are of like size, and what its coefficients are to be divided by."""
    every = [course.t if which == "t" else course.temperature for which in over]
    columns = [column - column.mean() for column in every if column is not None]
    scales = [float(np.ptp(column)) for column in columns]
    X = np.column_stack([np.ones(course.y.size), *(c / s for c, s in zip(columns, scales, strict=True))])
    return Line(course.y, course.variances, X), (1.0, *scales)


def _coefficients(lines: dict[int, _Scaled]) -> dict[int, tuple[Coefficient, ...] | None]:
    found = coefficients([line for line, _ in lines.values()])
    return {
        k: None if one is None else tuple(map(_scaled, one, scales))
        for (k, (_, scales)), one in zip(lines.items(), found, strict=True)
    }


def _scaled(found: Coefficient, scale: float) -> Coefficient:
    e = found.estimate
    return Coefficient(Estimate(e.value / scale, e.sd / scale, e.low / scale, e.high / scale), found.p)


def _column(found: tuple[Coefficient, ...] | None, number: int) -> Coefficient | None:
    return found[number] if found is not None and number < len(found) else None


# ----------------------------------------------------------------------------------------------------------- multiple
# Many tests at once: Holm's correction, by which any false discovery among all is as rare as the level says.


def holm(p: Array) -> Array:
    """Probabilities corrected for their number; they hold however the tests depend on each other.

    In rising order, p_(k) becomes the greatest of min(1, (n - l + 1) p_(l)) for l = 1 to k.

    `p`: shape (n,), each between 0 and 1.

    References
    ----------
    S. Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6, 1979.
    """
    order = np.argsort(p)
    raised = np.minimum(1.0, (p.size - np.arange(p.size)) * p[order])
    made = np.empty(p.size)
    made[order] = np.maximum.accumulate(raised)
    return made
