"""Model, unit and day: a value of many units as three parts, with intervals, and what is not determined.

Integrated is over the two components with Jeffreys' prior √det I(σ_u², σ_p²), I being the information of the restricted
likelihood (`likelihood`). For equal variances and no error of measurement this gives Student's interval for the model's
value; fixing the components at their estimates would give intervals that are too short for a few units. The components
themselves are told by their restricted maximum likelihood, with intervals from the same integral.

Given both components, and u_i = μ + a_i:

    u_i = μ̂ + (σ_u²/T_i) (m_i - μ̂),   var u_i = σ_u² / (W_i T_i) + c / (W_i T_i)²
    a_i = u_i - μ,                      var a_i = σ_u² / (W_i T_i) + c (σ_u²/T_i)²
    b_ij = h_ij (y_ij - u_i),           var b_ij = σ_p² (1 - h_ij) + h_ij² var u_i,   h_ij = σ_p² w_ij

which are the best linear unbiased predictions.

References: G. E. P. Box, G. C. Tiao, "Bayesian inference in statistical analysis", chapter 5; O. Bodnar, A. Link, B.
Arendacká, A. Possolo, C. Elster, "Bayesian estimation in random effects meta-analysis using a non-informative prior",
Statistics in Medicine 36, 2017.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from filters.fleet import grid, mixture
from filters.fleet.grid import Grid
from filters.fleet.mixture import Estimate
from filters.fleet.readings import PowerOns
from filters.types import Array

# --------------------------------------------------------------------------------------------------------- likelihood
# Restricted likelihood of two nested components of variance beside known variances of measurement.
#
#     y_ij = μ + a_i + b_ij + e_ij,   a_i ~ N(0, σ_u²),   b_ij ~ N(0, σ_p²),   e_ij ~ N(0, s_ij²), s_ij known
#
# for power-on j of unit i. With w_ij = 1/(σ_p² + s_ij²), W_i = Σ_j w_ij, m_i = Σ_j w_ij y_ij / W_i, T_i = σ_u² + 1/W_i,
# c = 1 / Σ_i 1/T_i and μ̂ = c Σ_i m_i/T_i the restricted log likelihood is, but for a constant,
#
#     -½ [Σ_ij -log w_ij + Σ_i log W_i + Σ_i log T_i - log c + Σ_ij w_ij (y_ij - m_i)² + Σ_i (m_i - μ̂)²/T_i]
#
# which costs a sum over power-ons. Its Fisher information is I_kl = ½ tr(P V_k P V_l), P = V⁻¹ - V⁻¹ 1 c 1ᵀ V⁻¹.
# Source:
# S. R. Searle, G. Casella, C. E. McCulloch, "Variance components", chapters 6 and 11, with known variances added.


@dataclass(frozen=True, slots=True)
class Conditional:
    """What follows where both components are given, for G pairs of them."""

    log_likelihood: Array  # restricted, shape (G,)
    # mean, mean_variance: of the model: μ̂ and c, shape (G,)
    mean: Array
    mean_variance: Array
    # unit_means, unit_variances: m_i and 1/W_i, shape (G, U)
    unit_means: Array
    unit_variances: Array
    information: Array  # of σ_u² and σ_p²: I_uu, I_up, I_pp, shape (3, G)


def conditional(data: PowerOns, unit_variance: Array, power_on_variance: Array) -> Conditional:
    """Likelihood, information, and means, at pairs of components.

    `data`: values, P of them of U units.
    `unit_variance`, `power_on_variance`: σ_u² and σ_p², shape (G,), not negative.
    """
    starts = data.starts

    def per_unit(x: Array) -> Array:
        made: Array = np.add.reduceat(x, starts, axis=1)
        return made

    w = 1.0 / (power_on_variance[:, None] + data.variances)
    W = per_unit(w)
    m = per_unit(w * data.values) / W
    deviations = data.values - np.repeat(m, data.counts, axis=1)
    T = unit_variance[:, None] + 1.0 / W
    c = 1.0 / np.sum(1.0 / T, axis=1)
    mean = c * np.sum(m / T, axis=1)
    told = -np.sum(np.log(w), axis=1) + np.sum(np.log(W) + np.log(T), axis=1) - np.log(c)
    squares = np.sum(w * deviations**2, axis=1) + np.sum((m - mean[:, None]) ** 2 / T, axis=1)
    information = _information(per_unit(w**2), per_unit(w**3), W, 1.0 / T, c)
    return Conditional(-0.5 * (told + squares), mean, c, m, 1.0 / W, information)


def _information(w2: Array, w3: Array, W: Array, B: Array, c: Array) -> Array:
    """I_uu, I_up, I_pp; B = 1/T. P is a part within units, which σ_p² alone moves, and one between their means."""
    r = w2 / W**2  # squared length of the weights that make a unit's mean
    k = c[:, None]
    total = np.sum(B**2, axis=1)
    uu = total - 2.0 * c * np.sum(B**3, axis=1) + (c * total) ** 2
    up = np.sum(r * (B**2 - 2.0 * k * B**3 + k**2 * total[:, None] * B**2), axis=1)
    within = np.sum(w2 - 2.0 * w3 / W + r * w2, axis=1)
    across = np.sum((B - k * B**2) * (w3 / W**2 - r * w2 / W), axis=1)
    rr = np.sum((r * B) ** 2, axis=1) - 2.0 * c * np.sum(r**2 * B**3, axis=1) + (c * np.sum(r * B**2, axis=1)) ** 2
    # the difference of nearly equal sums may come out below 0 where there is no information at all
    made: Array = 0.5 * np.maximum(np.stack([uu, up, within + 2.0 * across + rr]), 0.0)
    return made


# --------------------------------------------------------------------------------------------------------- components

_TOLD = 1.92  # log likelihood that a component must add to be told from none: half the 95 % quantile of chi-square
_NOTHING = 1e-6
_TINY = 1e-300


@dataclass(frozen=True, slots=True)
class Component:
    """A standard deviation between units, or between power-ons."""

    sd: float  # restricted maximum likelihood
    # low, high: ends of the interval that holds 95 %; `low` is 0 where the component is not told from none
    low: float
    high: float
    dof: int  # degrees of freedom behind it: units less one, or power-ons less units


@dataclass(frozen=True, slots=True)
class UnitEstimate:
    """Of one unit."""

    name: str  # its serial number
    power_ons: int  # how many it has
    value: Estimate | None  # the mean that its power-ons scatter about; None where no unit was switched on twice
    own: Estimate | None  # the same less the model's value; None as above, and where there is only one unit


@dataclass(frozen=True, slots=True)
class Fleet:
    """A value of many units."""

    model: Estimate | None  # mean over all units that could be made; None of one unit
    # between_units, between_power_ons: standard deviation of units about the model, and of power-ons about their unit;
    # None where not determined
    between_units: Component | None
    between_power_ons: Component | None
    together: Component | None  # of both at once, where each unit has one power-on only
    units: tuple[UnitEstimate, ...]  # in the order of the data
    days: tuple[Estimate, ...] | None  # b_ij of each power-on, in the order of the data; None where not determined


def estimate(data: PowerOns) -> Fleet:
    """Parts of a value, as far as they are determined.

    `data`: values with known variances, of one model of instrument.
    """
    units, repeated = len(data.units), data.values.size > len(data.units)
    if units == 1 and not repeated:
        return Fleet(None, None, None, None, (UnitEstimate(data.units[0], 1, None, None),), None)
    free = (*((0,) if units > 1 else ()), *((1,) if repeated else ()))
    points = _integrated(data, free)
    given = conditional(data, *_variances(points.sds, free))
    found = [_component(data, points, free, axis) for axis in free]
    means = mixture.estimates(points.weights, given.mean[:, None], given.mean_variance[:, None])
    model = means[0] if units > 1 else None
    if not repeated:
        alone = tuple(UnitEstimate(name, 1, None, None) for name in data.units)
        return Fleet(model, None, None, found[0], alone, None)
    sigma = _variances(points.sds, free)
    return Fleet(
        model,
        found[0] if units > 1 else None,
        found[-1],
        None,
        _units(data, points, given, sigma[0]),
        _days(data, points, given, sigma),
    )


def _variances(sds: Array, free: tuple[int, ...]) -> tuple[Array, Array]:
    """σ_u² and σ_p² at points, 0 for what is not free."""
    made = np.zeros((2, len(sds)))
    for column, axis in enumerate(free):
        made[axis] = sds[:, column] ** 2
    return made[0], made[1]


def _integrated(data: PowerOns, free: tuple[int, ...]) -> Grid:
    def density(sds: Array) -> Array:
        given = conditional(data, *_variances(sds, free))
        uu, up, pp = given.information
        det = uu * pp - up**2 if len(free) == 2 else (uu, pp)[free[0]]
        prior = 0.5 * np.log(np.maximum(det, _TINY))
        told: Array = given.log_likelihood + prior + np.sum(2.0 * np.log(sds), axis=1)
        return told

    return grid.integrate(density, float(np.ptp(data.values)), data.variances, len(free))


def _component(data: PowerOns, points: Grid, free: tuple[int, ...], axis: int) -> Component:
    """Restricted maximum likelihood, from the best point of the grid, and interval."""
    column = free.index(axis)

    def lost(sds: Array) -> float:
        return -float(conditional(data, *_variances(np.abs(sds)[None, :], free)).log_likelihood[0])

    told = conditional(data, *_variances(points.sds, free)).log_likelihood
    start = points.sds[int(np.argmax(told))]
    best = minimize(lambda x: lost(x * start), np.ones(len(free)), method="Nelder-Mead", options={"xatol": 1e-5})
    none = np.array(points.sds[np.argsort(told)[-200:]])
    none[:, column] = 0.0
    without = conditional(data, *_variances(none, free)).log_likelihood.max()
    zero = lost(np.where(np.arange(len(free)) == column, 0.0, start * np.abs(best.x)))
    without = max(float(without), -zero)
    low, high = points.quantiles(column, np.array([0.025, 0.975]))
    dof = len(data.units) - 1 if axis == 0 else data.values.size - len(data.units)
    sd = 0.0 if without >= -best.fun - _NOTHING else float(start[column] * abs(best.x[column]))
    return Component(sd, 0.0 if -best.fun - without < _TOLD else float(low), float(high), dof)


def _units(data: PowerOns, points: Grid, given: Conditional, unit_variance: Array) -> tuple[UnitEstimate, ...]:
    if len(data.units) == 1:
        value = mixture.estimates(points.weights, given.unit_means, given.unit_variances)
        return (UnitEstimate(data.units[0], data.values.size, value[0], None),)
    T = unit_variance[:, None] + given.unit_variances
    k = unit_variance[:, None] / T
    mean, c = given.mean[:, None], given.mean_variance[:, None]
    own, left = k * (given.unit_means - mean), k * given.unit_variances
    values = mixture.estimates(points.weights, mean + own, left + (1.0 - k) ** 2 * c)
    owns = mixture.estimates(points.weights, own, left + k**2 * c)
    counts = map(int, data.counts)
    return tuple(UnitEstimate(*one) for one in zip(data.units, counts, values, owns, strict=True))


def _days(data: PowerOns, points: Grid, given: Conditional, sigma: tuple[Array, Array]) -> tuple[Estimate, ...]:
    """Of each power-on, a unit at a time: all at once would take too much memory."""
    made: list[Estimate] = []
    T = sigma[0][:, None] + given.unit_variances
    one = len(data.units) == 1
    k = np.ones_like(T) if one else sigma[0][:, None] / T
    mean, c = given.mean[:, None], given.mean_variance[:, None]
    values = mean + k * (given.unit_means - mean)
    variances = given.unit_variances if one else k * given.unit_variances + (1.0 - k) ** 2 * c
    for number in range(len(data.units)):
        part = data.of_unit(number)
        h = sigma[1][:, None] / (sigma[1][:, None] + data.variances[part])
        u, v = values[:, [number]], variances[:, [number]]
        means = h * (data.values[part] - u)
        made += mixture.estimates(points.weights, means, sigma[1][:, None] * (1.0 - h) + h**2 * v)
    return tuple(made)
