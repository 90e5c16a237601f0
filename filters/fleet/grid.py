"""Integration over standard deviations of components: where the density is, on a grid of their logarithms.

The weight of a point is restricted likelihood times Jeffreys' prior √det I, which for equal variances gives Student's
intervals; see `components`.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from filters.types import Array

_ROUNDS = 6
_RANGE = 1e5
_DROP = 17.0  # logarithm of the density below its greatest at which nothing is left to integrate
_LEAST = 1e-6
_CELLS = 4_000_000
_STEPS = ((40, 25, 51), (400, 25, 27), (sys.maxsize, 13, 15))
"""Up to so many values: points of an axis while looking, and when integrating. Many make a density narrow."""

Density = Callable[[Array], Array]  # logarithm of a density at standard deviations of shape (G, axes), shape (G,)


@dataclass(frozen=True, slots=True)
class Grid:
    """Points and their shares."""

    sds: Array  # standard deviations, shape (G, axes)
    weights: Array  # shape (G,), of sum 1

    def quantiles(self, axis: int, probabilities: Array) -> Array:
        """Quantiles of the standard deviation of an axis, shape of `probabilities`."""
        x, place = np.unique(self.sds[:, axis], return_inverse=True)
        share = np.bincount(place.ravel(), self.weights)
        # a point stands for the cell around it
        middle = np.cumsum(share) - 0.5 * share
        return np.exp(np.interp(probabilities, middle, np.log(x)))


def integrate(density: Density, span: float, variances: Array, axes: int) -> Grid:
    """Grid over the part of the range where a density is.

    The grid is laid anew, several times, over the box that holds all but e⁻¹⁷ of the greatest density. Points with
    less than a millionth of the greatest weight are left out.

    `density`: of the logarithms of standard deviations, given at standard deviations.
    `span`: how far the values that it is made of lie apart; `variances` of their measurement, positive. A grid is finer
      where these are few.
    `axes`: 1 or 2.
    """
    span, size = max(span, float(np.sqrt(variances.max()))), variances.size
    low = 1e-3 * min(float(np.sqrt(variances.min())), span)
    box = np.log([[low, _RANGE * span]] * axes)
    coarse, fine = next((a, b) for most, a, b in _STEPS if size <= most)
    for _ in range(_ROUNDS):
        coordinates = [np.linspace(a, b, coarse) for a, b in box]
        told = _evaluated(density, coordinates, size).reshape([coarse] * axes)
        near = told > told.max() - _DROP
        shrunk = []
        for axis, x in enumerate(coordinates):
            seen = np.flatnonzero(near.any(axis=tuple(k for k in range(axes) if k != axis)))
            shrunk.append([x[max(seen[0] - 1, 0)], x[min(seen[-1] + 1, coarse - 1)]])
        box = np.array(shrunk)
    coordinates = [np.linspace(a, b, fine if axes == 2 else 2 * fine) for a, b in box]
    told = _evaluated(density, coordinates, size)
    weights = np.exp(told - told.max())
    kept = weights > _LEAST
    return Grid(np.exp(_points(coordinates)[kept]), weights[kept] / weights[kept].sum())


def _points(coordinates: list[Array]) -> Array:
    return np.stack([x.ravel() for x in np.meshgrid(*coordinates, indexing="ij")], axis=1)


def _evaluated(density: Density, coordinates: list[Array], size: int) -> Array:
    points = np.exp(_points(coordinates))
    step = max(1, _CELLS // size)
    return np.concatenate([density(points[k : k + step]) for k in range(0, len(points), step)])
