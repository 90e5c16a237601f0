"""Mixtures of normal distributions: what is known of a value where the variances that it rests on are known in part."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from filters.types import Array

_HALVINGS = 30
_PROBABILITIES = (0.025, float(ndtr(-1.0)), 0.5, float(ndtr(1.0)), 0.975)


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value and how well it is known."""

    value: float  # median
    # half the interval that holds 68.3 %: the standard deviation of a normal distribution, and defined, too, where few
    # units make tails so long that none exists
    sd: float
    # low, high: ends of the interval that holds 95 %, wider than 2 · 1.96 sd where few units or power-ons are behind it
    low: float
    high: float


def estimates(weights: Array, means: Array, variances: Array) -> list[Estimate]:
    """Of each of K mixtures of G normal distributions.

    `weights`: shape (G,), of sum 1.
    `means`, `variances`: shape (G, K); variances positive.
    """
    sds = np.sqrt(variances)
    found = np.stack([quantile(weights, means, sds, p) for p in _PROBABILITIES])
    return [Estimate(float(q[2]), 0.5 * float(q[3] - q[1]), float(q[0]), float(q[4])) for q in found.T]


def quantile(weights: Array, means: Array, sds: Array, probability: float) -> Array:
    """A quantile of each mixture, shape (K,), by bisection between those of its normal distributions."""
    each = means + sds * ndtri(probability)
    low, high = each.min(axis=0), each.max(axis=0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = weights @ ndtr((middle - means) / sds) < probability
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    made: Array = 0.5 * (low + high)
    return made


def two_sided(weights: Array, means: Array, sds: Array) -> float:
    """Probability of a value as far from 0 by chance, on either side; means and sds of shape (G,)."""
    below = float(weights @ ndtr(-means / sds))
    above = float(weights @ ndtr(means / sds))
    return min(1.0, 2.0 * min(below, above))
