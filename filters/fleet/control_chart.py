"""Control charts: which power-ons of a unit fall out of what its others, and those of its model, let expect.

A chart of individual values, as after Shewhart. Centre: mean of the unit's power-ons that are in control, weighted.
Limits: centre ± t √(σ_p² + s_ij² + var centre), with t at 0.27 % on both sides together (3 σ of a normal distribution)
for the degrees of freedom behind σ_p. σ_p is the scatter between power-ons of all units of the model that are in
control, by Paule and Mandel: Σ_ij w_ij (y_ij - m_i)² = power-ons less units.

A power-on that falls out would widen the limits that are to show it. So the one that stands out most is set aside and
judged by all others, then the next, up to a fifth of all; the last of them that lies outside its limits is out, and
so are those before it (the generalised extreme Studentised deviate test). In simulated fleets that
are in control up to 0.7 % of power-ons fall out, `benchmarks/fleet.py`.

References: D. C. Montgomery, "Introduction to statistical quality control", chapter 6; R. C. Paule, J. Mandel,
Journal of Research of the NBS 87, 1982; B. Rosner, Technometrics 25, 1983.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import stdtrit

from filters.fleet.readings import PowerOns
from filters.types import Array

FALSE_ALARMS = 0.0027  # share of power-ons in control that fall out by chance
_MOST_OUT = 5  # at most one in so many power-ons is set aside
_MOST_STEPS = 50
_LEAST_DOF = 3


@dataclass(frozen=True, slots=True)
class Chart:
    """Charts of all units of a model, for one channel."""

    power_on_sd: float  # σ_p of what is in control
    dof: int  # degrees of freedom behind it
    # centres, low, high: of each power-on, shape (P,); NaN for a unit with one power-on only
    centres: Array
    low: Array
    high: Array
    outside: NDArray[np.bool_]  # which power-ons are out, shape (P,)


def chart(data: PowerOns) -> Chart | None:
    """Chart of units' power-ons; None where fewer than three degrees of freedom are behind a scatter.

    `data`: values with known variances, of one model of instrument.
    """
    several = data.counts[data.unit_of()] > 1
    kept = several.copy()
    if _dof(data, kept) < _LEAST_DOF:
        return None
    removed: list[int] = []
    last_out = 0
    for step in range(1, min(int(several.sum()) // _MOST_OUT, _MOST_STEPS) + 1):
        sigma, spread, centres = _limits(data, kept)
        candidates = kept & (_kept_in_unit(data, kept) > 1)
        if not candidates.any():
            break
        worst = int(np.argmax(np.where(candidates, np.abs(data.values - centres) / spread, -1.0)))
        kept[worst] = False
        removed.append(worst)
        if _dof(data, kept) < _LEAST_DOF:
            break
        if _is_out(data, kept, worst):
            last_out = step
    outside = np.zeros(data.values.size, bool)
    outside[removed[:last_out]] = True
    kept = several & ~outside
    sigma, spread, centres = _limits(data, kept)
    reach = _reach(_dof(data, kept)) * spread
    middle = np.where(several, centres, np.nan)
    return Chart(sigma, _dof(data, kept), middle, middle - reach, middle + reach, outside)


def _is_out(data: PowerOns, kept: NDArray[np.bool_], place: int) -> bool:
    _, spread, centres = _limits(data, kept)
    return bool(abs(data.values[place] - centres[place]) > _reach(_dof(data, kept)) * spread[place])


def _reach(dof: int) -> float:
    return float(stdtrit(dof, 1.0 - 0.5 * FALSE_ALARMS))


def _kept_in_unit(data: PowerOns, kept: NDArray[np.bool_]) -> NDArray[np.intp]:
    units = data.unit_of()
    return np.bincount(units, kept, len(data.units)).astype(np.intp)[units]


def _dof(data: PowerOns, kept: NDArray[np.bool_]) -> int:
    units = data.unit_of()
    return int(kept.sum()) - int(np.unique(units[kept]).size)


def _limits(data: PowerOns, kept: NDArray[np.bool_]) -> tuple[float, Array, Array]:
    """σ_p, standard deviation of each power-on about its centre, and centres."""
    sigma2 = _scatter(data, kept)
    units = data.unit_of()
    w = np.where(kept, 1.0 / (sigma2 + data.variances), 0.0)
    total = np.maximum(np.bincount(units, w, len(data.units)), np.finfo(float).tiny)
    centres = (np.bincount(units, w * data.values, len(data.units)) / total)[units]
    return float(np.sqrt(sigma2)), np.sqrt(sigma2 + data.variances + 1.0 / total[units]), centres


def _scatter(data: PowerOns, kept: NDArray[np.bool_]) -> float:
    """σ_p² of those kept, 0 where measurement explains their scatter."""
    y, s2 = data.values[kept], data.variances[kept]
    _, units = np.unique(data.unit_of()[kept], return_inverse=True)
    dof = y.size - int(units.max()) - 1

    def excess(sigma2: float) -> float:
        w = 1.0 / (sigma2 + s2)
        means = np.bincount(units, w * y) / np.bincount(units, w)
        return float(np.sum(w * (y - means[units]) ** 2)) - dof

    if excess(0.0) <= 0.0:
        return 0.0
    return float(brentq(excess, 0.0, y.size * float(np.ptp(y)) ** 2, xtol=1e-12 * float(np.ptp(y)) ** 2))
