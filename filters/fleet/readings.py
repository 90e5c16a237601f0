"""Values of logs as one value a power-on: logs of one power-on share all but the error of measurement."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.types import Array

_LEAST = 1e-6
_SURE = 0.01
"""Probability below which logs of one power-on are held to differ by more than their standard deviations say."""


@dataclass(frozen=True, slots=True)
class Repeatability:
    """Whether logs of one power-on agree within their standard deviations."""

    # chi2, dof, p: sum of squared differences from the power-ons' means over their variances, its degrees of freedom,
    # and the probability of as much by chance
    chi2: float
    dof: int
    p: float
    # what all standard deviations were multiplied by: 1 unless p is below 0.01, then √(chi2/dof), as Birge's ratio
    scale: float


@dataclass(frozen=True, slots=True)
class PowerOns:
    """One value a power-on, ordered by unit."""

    values: Array  # shape (P,)
    variances: Array  # of the measurement alone, shape (P,), positive
    starts: NDArray[np.intp]  # where each unit begins, shape (U,)
    units: tuple[str, ...]  # names, in this order, U of them
    names: tuple[str, ...]  # names of the power-ons, P of them
    repeat: Repeatability | None = None  # none if no power-on has several logs

    @property
    def counts(self) -> NDArray[np.intp]:
        """Power-ons of each unit, shape (U,)."""
        return np.diff(np.append(self.starts, self.values.size))

    def unit_of(self) -> NDArray[np.intp]:
        """Number of the unit of each power-on, shape (P,)."""
        return np.repeat(np.arange(len(self.units)), self.counts)

    def of_unit(self, number: int) -> slice:
        """Where the power-ons of a unit stand."""
        begin = int(self.starts[number])
        return slice(begin, begin + int(self.counts[number]))


def power_ons(values: Array, sds: Array, units: Sequence[str], names: Sequence[str]) -> PowerOns:
    """Mean of each power-on's logs, weighted with 1/sd²; an sd of less than a millionth of the greatest counts as that.

    `values`, `sds`: one of each log, shape (N,); N at least 1, all finite, `sds` positive.
    `units`, `names`: unit and power-on of each log. Power-ons of equal name are one only if of one unit.
    Raises ValueError if shapes differ, there is none, or a value or standard deviation is not as above.
    """
    if not values.size or not (values.shape == sds.shape == (len(units),) == (len(names),)):
        sizes = ", ".join(map(str, (values.size, sds.size, len(units), len(names))))
        raise ValueError(f"`values`, `sds`, `units`, `names` have {sizes} entries")
    if not (np.all(np.isfinite(values)) and np.all(np.isfinite(sds)) and np.all(sds > 0.0)):
        raise ValueError("`values` and `sds` must be finite, and `sds` positive")
    # further apart their weights would leave no digits to the sums of the others
    sds = np.maximum(sds, _LEAST * sds.max())
    keys = sorted(set(zip(units, names, strict=True)))
    number = {key: k for k, key in enumerate(keys)}
    group = np.array([number[key] for key in zip(units, names, strict=True)])
    weights = sds**-2
    total = np.bincount(group, weights)
    means = np.bincount(group, weights * values) / total
    repeat = _repeatability(float(np.sum(weights * (values - means[group]) ** 2)), values.size - len(keys))
    own, starts = np.unique([unit for unit, _ in keys], return_index=True)
    scale = 1.0 if repeat is None else repeat.scale
    return PowerOns(
        means, scale**2 / total, starts, tuple(map(str, own)), tuple(name for _, name in keys), repeat=repeat
    )


def _repeatability(chi2: float, dof: int) -> Repeatability | None:
    if not dof:
        return None
    from scipy.special import chdtrc

    p = float(chdtrc(dof, chi2))
    return Repeatability(chi2, dof, p, float(np.sqrt(chi2 / dof)) if p < _SURE else 1.0)
