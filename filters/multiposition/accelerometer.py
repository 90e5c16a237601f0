"""Accelerometers from rests: the corrected specific force of every rest has the magnitude of gravity.

The frame is the accelerometers' own: a force along its x is read by x alone, one in its x-y plane not by z, so that
the matrix of misalignment is upper triangular. How the triad as a whole is turned to the case, rests do not show; a
scale factor common to all axes and gravity's magnitude are one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from filters.channels import ACCELS
from filters.effects import deterministic
from filters.effects.hypothesis import Hypothesis
from filters.multiposition import least_squares
from filters.multiposition.least_squares import Fit
from filters.multiposition.rests import Rest
from filters.multiposition.triad import Triad
from filters.types import Array

BIAS: tuple[Hypothesis, ...] = tuple(deterministic.bias(c) for c in ACCELS)
SCALE: tuple[Hypothesis, ...] = tuple(deterministic.scale(c) for c in ACCELS)
MISALIGNMENT: tuple[Hypothesis, ...] = (deterministic.cross_axis(ACCELS[0]), deterministic.cross_axis(ACCELS[1], 2))
FORMS = (BIAS, SCALE, MISALIGNMENT)  # groups of effects, each taken together, in the order in which they join
FEWEST = 9  # distinct directions below which misalignment is not asked for
BEYOND: tuple[Hypothesis, ...] = (
    *(deterministic.g_squared(c, c - ACCELS[0]) for c in ACCELS),
    *(deterministic.nonlinearity_cubic(c) for c in ACCELS),
    *(deterministic.asymmetry(c) for c in ACCELS),
)
"""Effects that join only if they clearly gain."""
_STEP = 1e-3


@dataclass(frozen=True)
class Rests:
    """Rests of one unit as observations of its accelerometers."""

    mean: Array  # readings, m/s², shape (n, 3)
    noise: Array  # variance of their magnitude by noise alone, shape (n,)
    gravity: float  # m/s²
    power_on: NDArray[np.int_]  # of each, shape (n,)
    logs: int = 1  # power-ons, each with biases of its own

    @classmethod
    def of(cls, rests: Sequence[Rest], gravity: float, power_on: NDArray[np.int_] | None = None) -> "Rests":
        """Rests of all logs of a unit, all of one power-on if it is not said of which they are."""
        mean = np.array([rest.mean[list(ACCELS)] for rest in rests]).reshape(-1, 3)
        variance = np.array([rest.variance[list(ACCELS)] for rest in rests]).reshape(-1, 3)
        direction = mean / np.linalg.norm(mean, axis=1, keepdims=True)
        power_on = np.zeros(len(rests), np.int64) if power_on is None else power_on
        noise = np.asarray(np.sum(direction**2 * variance, axis=1))
        return cls(mean, noise, gravity, power_on, int(power_on.max(initial=0)) + 1)

    def without(self, which: Sequence[int]) -> "Rests":
        """All rests but some."""
        kept = np.delete(np.arange(len(self.mean)), which)
        return replace(self, mean=self.mean[kept], noise=self.noise[kept], power_on=self.power_on[kept])

    def of_power_on(self, number: int) -> "Rests":
        """Rests of one power-on."""
        apart = self.without(np.flatnonzero(self.power_on != number).tolist())
        return replace(apart, power_on=np.zeros(len(apart.mean), np.int64), logs=1)

    def true(self, triad: Triad, theta: Array) -> Array:
        """What was truly sensed, m/s², shape (n, 3)."""
        out = np.empty_like(self.mean)
        for log in range(self.logs):
            at = self.power_on == log
            out[at] = triad.true(self.mean[at], triad.of_power_on(theta, log, self.logs))
        return out

    def errors(self, triad: Triad, theta: Array) -> Array:
        """Magnitude of the corrected specific force less gravity's, m/s², shape (n,)."""
        return np.asarray(np.linalg.norm(self.true(triad, theta), axis=1) - self.gravity)

    def before(self) -> Array:
        """Errors of readings as they are, m/s², shape (n,)."""
        return self.errors(triad_of(), np.zeros(0))

    @property
    def blocks(self) -> list[NDArray[np.int_]]:
        """Residuals that are left out together: each by itself."""
        return [np.array([k]) for k in range(self.judged)]

    @property
    def judged(self) -> int:
        """How many residuals are errors, the first ones."""
        return len(self.mean)

    def residuals(self, triad: Triad, theta: Array) -> tuple[Array, Array]:
        """`errors` and their derivatives by the parameters, (n,) and (n, p)."""
        force = self.true(triad, theta)
        norm = np.linalg.norm(force, axis=1)
        x = np.hstack([np.zeros_like(force), force])
        slope = np.empty((len(x), theta.size))
        for log in range(self.logs):
            at = self.power_on == log
            moved = np.linalg.solve(
                triad.slope(x[at], triad.of_power_on(theta, log, self.logs), _STEP), triad.regressor(x[at])
            )
            own = -np.einsum("ni,nip->np", force[at] / norm[at, None], moved)
            slope[at] = triad.spread(own, log, self.logs)
        return norm - self.gravity, slope

    def fit(self, triad: Triad, start: Array | None = None, excess: Array | None = None) -> Fit:
        """Fit a triad to the rests; see `least_squares.fit`."""
        prior = triad.priors(self.logs)
        begin = np.zeros(prior.size) if start is None else start
        group = np.zeros(len(self.mean), np.int64)
        return least_squares.fit(lambda theta: self.residuals(triad, theta), begin, self.noise, group, prior, excess)


def triad_of(*groups: Sequence[Hypothesis]) -> Triad:
    """Accelerometers with some groups of effects."""
    return Triad(ACCELS, tuple(effect for group in groups for effect in group))
