"""Gyros from the turns between rests: the integrated rate turns the gravity direction of one rest into the next one's.

A turn about gravity itself shows nothing, which is why one turn never suffices and many do. The mean reading of a rest
shows the bias and what specific force adds to it. Of Earth's rate the vertical part is in the model; the level part is
in the variances, since heading is unknown. The frame is that of the accelerometers.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from filters import attitude, earth
from filters.channels import ACCELS, GYROS
from filters.effects import deterministic
from filters.effects.hypothesis import Hypothesis
from filters.multiposition import least_squares
from filters.multiposition.least_squares import Fit
from filters.multiposition.rests import Rest, gaps, power_ons, unusable
from filters.multiposition.triad import Triad
from filters.tracing.run import Run
from filters.types import Array

BIAS: tuple[Hypothesis, ...] = tuple(deterministic.bias(c) for c in GYROS)
SCALE: tuple[Hypothesis, ...] = tuple(deterministic.scale(c) for c in GYROS)
MISALIGNMENT: tuple[Hypothesis, ...] = tuple(deterministic.cross_axis(c) for c in GYROS)
G_SENSITIVITY: tuple[Hypothesis, ...] = tuple(deterministic.g_sensitivity(c) for c in GYROS)
GROUPS = (SCALE, MISALIGNMENT, G_SENSITIVITY)  # what is asked for beside the bias of each power-on
LONGEST_S = 60.0  # a turn that takes longer says more of the drift of the bias than of the turn
_STEP = 1e-4


@dataclass(frozen=True)
class Turn:
    """A turn between two rests that follow each other."""

    log: int  # number of its log
    # first, second: numbers of the two rests, over all logs
    first: int
    second: int
    samples: slice  # from the last sample of the first rest to the first of the second
    seconds: float


class Turns:
    """Turns and rests of one unit as observations of its gyros.

    `runs`: its logs. Each power-on has gyro biases of its own; parts of one share theirs.
    `rests`: of each log.
    """

    def __init__(self, runs: Sequence[Run], rests: Sequence[Sequence[Rest]]) -> None:
        self.runs, self._rests = runs, rests
        self.rests = [rest for own in rests for rest in own]
        self.log = np.repeat(np.arange(len(runs)), [len(own) for own in rests])
        self.turns, self.spoilt = _turns(runs, rests)  # `spoilt`: how many were left out for readings that are none
        self.power_ons, self.power_on = power_ons(runs)
        self._axes = runs[0].axes
        self._to_body = self._axes.mount * self._axes.gyro_sign
        self._spin = earth.EARTH_RATE * float(np.cos(runs[0].site.latitude))
        level = self._spin**2 / 3.0
        self._rest_noise = np.array([r.variance[list(GYROS)] + level for r in self.rests]).reshape(-1)
        self._turn_noise = np.array([self._noise(turn) for turn in self.turns]).reshape(-1)
        self._force: list[Array] = []
        self._up: Array = np.zeros((0, 3))

    def _noise(self, turn: Turn) -> list[float]:
        """Variance of the direction across it, rad², twice: noise of both rests and of the integrated rate."""
        force = 0.0
        density = 0.0
        for rest in (self.rests[turn.first], self.rests[turn.second]):
            force += float(np.mean(rest.variance[list(ACCELS)])) / self.runs[0].site.gravity ** 2
            density += 0.5 * float(np.mean(rest.variance[list(GYROS)])) * rest.seconds
        variance = force + density * turn.seconds + (self._spin * turn.seconds) ** 2 / 2.0
        return [variance, variance]

    def sense(self, accelerometers: Triad, theta: Sequence[Array]) -> None:
        """Take what the accelerometers truly sensed from their calibration, parameters of each power-on."""
        self._force, up = [], []
        for run, rests, number in zip(self.runs, self._rests, self.power_on.tolist(), strict=True):
            self._force.append(accelerometers.true(run.reading[:, list(ACCELS)], theta[number]))
            mean = np.array([rest.mean[list(ACCELS)] for rest in rests]).reshape(-1, 3)
            up.append(accelerometers.true(mean, theta[number]))
        self._up = self.directions(np.vstack(up))

    def of_power_on(self, number: int) -> "Turns":
        """Turns and rests of one power-on."""
        which = np.flatnonzero(self.power_on == number).tolist()
        out = Turns([self.runs[k] for k in which], [self._rests[k] for k in which])
        out._force = [self._force[k] for k in which]
        out._up = self._up[np.isin(self.log, which)]
        return out

    def directions(self, force: Array) -> Array:
        """Unit vectors of specific force in body axes, shape (n, 3)."""
        body = self._axes.accel_to_body(force)
        return np.asarray(body / np.linalg.norm(body, axis=1, keepdims=True))

    # -------------------------------------------------------------------------------------------------- parameters

    @property
    def logs(self) -> int:
        """How many power-ons there are."""
        return len(self.power_ons)

    def own(self, triad: Triad, theta: Array, log: int) -> Array:
        """Parameters of one log's power-on."""
        return triad.of_power_on(theta, int(self.power_on[log]), self.logs)

    def _spread(self, triad: Triad, columns: Array, log: int) -> Array:
        return triad.spread(columns, int(self.power_on[log]), self.logs)

    # ------------------------------------------------------------------------------------------------ observations

    def residuals(self, triad: Triad, theta: Array) -> tuple[Array, Array]:
        """Residuals and derivatives: two of each turn (rad), then three of each rest (rad/s)."""
        p = theta.size
        residual = np.empty(2 * len(self.turns) + 3 * len(self.rests))
        slope = np.empty((residual.size, p))
        for k, turn in enumerate(self.turns):
            carried, moved = self._turned(triad, self.own(triad, theta, turn.log), turn)
            predicted = carried @ self._up[turn.first]
            across = _across(self._up[turn.second])
            rows = slice(2 * k, 2 * k + 2)
            residual[rows] = across @ predicted
            slope[rows] = self._spread(triad, across @ np.cross(predicted[:, None], moved, axis=0), turn.log)
        still = self._at_rest()
        phi = triad.regressor(still)
        for k, rest in enumerate(self.rests):
            log = int(self.log[k])
            rows = slice(2 * len(self.turns) + 3 * k, 2 * len(self.turns) + 3 * k + 3)
            residual[rows] = rest.mean[list(GYROS)] - still[k, :3] - phi[k] @ self.own(triad, theta, log)
            slope[rows] = -self._spread(triad, phi[k], log)
        return residual, slope

    def _at_rest(self) -> Array:
        """What a perfect unit reads at each rest, but for the level part of Earth's rate, shape (n, 6)."""
        x = np.zeros((len(self.rests), 6))
        site = self.runs[0].site
        x[:, :3] = self._axes.gyro_to_instrument(self._up * earth.EARTH_RATE * np.sin(site.latitude))
        x[:, 3:] = self._axes.accel_to_instrument(self._up * site.gravity)
        return x

    def readings_of_rests(self, triad: Triad, theta: Array) -> Array:
        """What the gyros read at each rest by the parameters of one log, shape (n, 3)."""
        x = self._at_rest()
        return np.asarray(x[:, :3] + triad.regressor(x) @ theta)

    def _turned(self, triad: Triad, theta: Array, turn: Turn) -> tuple[Array, Array]:
        """Rotation from the axes before a turn to those after it, and the small turns that parameters add after it."""
        run, part = self.runs[turn.log], turn.samples
        force = self._force[turn.log][part]
        rate = triad.true(run.reading[part, :3], theta, force)
        x = np.hstack([rate, force])
        inverse = np.linalg.inv(triad.slope(x[:1], theta, _STEP)[0])
        dt = np.diff(run.t[part])
        body = rate @ self._to_body.T
        # rates are linear between samples; their axis turns meanwhile
        angle = 0.5 * (body[1:] + body[:-1]) * dt[:, None] + np.cross(body[:-1], body[1:]) * dt[:, None] ** 2 / 12.0
        steps = attitude.exp(angle)
        back = np.empty_like(steps)  # from the axes after each step to those at the end
        C = np.eye(3)
        for k in range(len(steps) - 1, -1, -1):
            back[k] = C
            C = steps[k] @ C
            # C takes components at the end to those before step k
        phi = triad.regressor(x)
        half = 0.5 * (phi[1:] + phi[:-1]) * dt[:, None, None]
        moved = -np.einsum("nji,njp->ip", back, (self._to_body @ inverse) @ half)
        return C.T, moved

    def before(self) -> Array:
        """Errors of readings as they are, gyros less their mean at rest, rad, shape (n,)."""
        plain = Turns(self.runs, self._rests)
        plain.sense(Triad(ACCELS, ()), [np.zeros(0)] * plain.logs)
        return plain.errors(triad_of(), plain.still_biases())

    @property
    def blocks(self) -> list[NDArray[np.int_]]:
        """Residuals that are left out together: two of each turn, three of each rest."""
        edges = [*range(0, self.judged, 2), *range(self.judged, self.judged + 3 * len(self.rests) + 1, 3)]
        return [np.arange(first, last) for first, last in itertools.pairwise(edges)]

    @property
    def judged(self) -> int:
        """How many residuals are errors, the first ones."""
        return 2 * len(self.turns)

    def errors(self, triad: Triad, theta: Array) -> Array:
        """Angle by which each turn misses the next rest's direction, rad, shape (n,)."""
        out = np.empty(len(self.turns))
        for k, turn in enumerate(self.turns):
            carried, _ = self._turned(triad, self.own(triad, theta, turn.log), turn)
            out[k] = _angle(carried @ self._up[turn.first], self._up[turn.second])
        return out

    def left_out(self, triad: Triad, made: Fit, number: int, up: Array) -> float:
        """Angle by which a turn misses with a fit to all others, rad.

        `triad`: gyros.
        `made`: to all turns and rests.
        `number`: of the turn.
        `up`: directions of its two rests, shape (2, 3): those of accelerometers that were not fitted to them.
        """
        turn = self.turns[number]
        carried, _ = self._turned(triad, self.own(triad, made.theta, turn.log), turn)
        rows = np.array([2 * number, 2 * number + 1])
        here = made.residual.copy()
        here[rows] = _across(up[1]) @ (carried @ up[0])
        return float(np.linalg.norm(replace(made, residual=here).left_out(rows)))

    @property
    def noise(self) -> Array:
        """Variance of the angle of each turn by noise alone, rad², shape (n,)."""
        return np.asarray(self._turn_noise.reshape(-1, 2).sum(axis=1))

    def fit(self, triad: Triad, start: Array | None = None, excess: Array | None = None) -> Fit:
        """Fit a triad, whose first three effects are its biases, to turns and rests; see `least_squares.fit`."""
        prior = triad.priors(self.logs)
        begin = np.zeros(prior.size) if start is None else start
        if start is None:
            begin[np.add.outer(triad.owned * np.arange(self.logs), np.arange(3)).ravel()] = self.still_biases()
        noise = np.concatenate([self._turn_noise, self._rest_noise])
        group = np.repeat([0, 1], [self._turn_noise.size, self._rest_noise.size])
        return least_squares.fit(lambda theta: self.residuals(triad, theta), begin, noise, group, prior, excess)

    def still_biases(self) -> Array:
        """Mean reading of the rests of each power-on, one after the other, rad/s, shape (3 power-ons,)."""
        out = np.zeros((self.logs, 3))
        for log in range(self.logs):
            own = [rest for rest, n in zip(self.rests, self.log, strict=True) if self.power_on[int(n)] == log]
            weight = np.array([rest.seconds for rest in own])
            if own:
                out[log] = weight @ np.array([rest.mean[list(GYROS)] for rest in own]) / weight.sum()
        return out.reshape(-1)


def triad_of(*groups: Sequence[Hypothesis]) -> Triad:
    """Gyros with biases and some groups of effects."""
    return Triad(GYROS, (*BIAS, *(effect for group in groups for effect in group)))


def _turns(runs: Sequence[Run], rests: Sequence[Sequence[Rest]]) -> tuple[list[Turn], int]:
    """Turns between rests that follow each other, and how many more have a hole in them, or samples that are none.

    One reading of an accelerometer that is off is a knock, and matters to no turn.
    """
    out: list[Turn] = []
    number = spoilt = 0
    for log, (run, own) in enumerate(zip(runs, rests, strict=True)):
        lost = unusable(run)
        bad = gaps(run) | lost[:, list(GYROS)].any(axis=1)
        bad[1:] |= (lost[1:, list(ACCELS)] & lost[:-1, list(ACCELS)]).any(axis=1)
        for k in range(len(own) - 1):
            part = slice(own[k].last - 1, own[k + 1].first + 1)
            seconds = float(run.t[part.stop - 1] - run.t[part.start])
            if bad[part].any():
                spoilt += 1
            elif seconds <= LONGEST_S:
                out.append(Turn(log, number + k, number + k + 1, part, seconds))
        number += len(own)
    return out, spoilt


def _across(direction: Array) -> Array:
    """Two unit vectors across a direction and each other, shape (2, 3)."""
    least = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(direction, least)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])


def _angle(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
