"""Biases without a reference: carried over a long gap, held once the reference has ended. Navigation begins anew.

A sample that is held over a gap of T seconds has a noise that adds up coherently: at 133 Hz the attitude is lost by
0.87 deg a second, the velocity by g times the half of that times T, and soon nothing is small any more that equations
of small errors need. Of what the filter held before a long gap only the biases are worth keeping, and what they are
correlated with in a unit that rests.

After the end of the reference nothing is integrated: navigation on its own would be lost within minutes, and biases
would follow it. They are held, and their walk adds to their covariance.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from filters import state
from filters.imu import Noise
from filters.kalman import augmentation, layout
from filters.kalman.augmentation import Augmented, Effects
from filters.kalman.filter_input import FilterInput
from filters.kalman.rows import nav_of, padded, row_of
from filters.kalman.settings import GAP_PERIODS
from filters.kalman.spkf import Belief
from filters.motion import reference
from filters.types import Array

LONG_GAP_S = 2.0
"""s of a gap behind which a prediction from one held sample says nothing of position, velocity and attitude."""

_WIDE = 100.0
_AT_ONCE = 1e-4
# errors of the state, and the numbers that stand for them in a row of what is known
_GROUPS = (
    (state.POSITION, reference.POSITION),
    (state.VELOCITY, reference.VELOCITY),
    (state.ATTITUDE, reference.QUATERNION),
)


class LongGaps:
    """Finds the samples at which navigation begins anew.

    Where the unit may be `moving`, all that the reference can know has to be known at such a sample.
    """

    def __init__(self, period: float, *, moving: bool) -> None:
        self._moving = moving
        self._longest = max(LONG_GAP_S, GAP_PERIODS * period)
        self._waiting = False

    def ends(self, t: Array, known: Array, before: float) -> list[int]:
        """Take the next samples; returns the first one behind each long gap at which navigation can begin anew.

        `t`: s, shape (N,).
        `known`: what the reference says, columns of `filters.motion.reference`, shape (N, 25), or (1, 25) for all.
        `before`: time of the sample before, s; -inf for none.
        """
        steps = np.diff(t, prepend=before)
        behind = (steps > self._longest) & np.isfinite(steps)
        if not self._waiting and not behind.any():
            return []
        whole = np.all(known[:, reference.VARIANCES] >= 0.0, axis=1) | (not self._moving)
        whole = np.broadcast_to(whole, t.shape)
        found = []
        for k in np.flatnonzero(behind | whole):
            self._waiting |= bool(behind[k])
            if self._waiting and whole[k]:
                found.append(int(k))
                self._waiting = False
        return found


def belief_behind(before: Belief, known: Array, noise: Noise, seconds: float) -> Belief:
    """Belief behind a long gap: navigation as the reference knows it, and the biases of before.

    P has 100 R for position, velocity or attitude where that is known, which the update by the same sample makes R of,
    P_b + Q_b T for the biases, and nothing between them. What is not known keeps its mean and its covariance with the
    biases, R added: a unit at rest may have been moved by as much.

    `before`: what the filter held before the gap.
    `known`: what the reference says behind it, shape (25,).
    `noise`: with the walk of the biases.
    `seconds`: length of the gap, s.
    """
    variances = known[reference.VARIANCES]
    row = row_of(before.nav)
    P, added = before.P.copy(), reference.PAPER_R_SD**2
    for errors, numbers in _GROUPS:
        if np.all(variances[errors] >= 0.0):
            P[errors], P[:, errors] = 0.0, 0.0
            row[numbers], added[errors] = known[numbers], _WIDE * variances[errors]
    walk = np.concatenate([noise.accel_walk, noise.gyro_walk]) ** 2 * seconds
    return Belief(nav_of(row), P + np.diag(np.concatenate([added, walk])))


def resume_extra(extra: Array, across: Array, before: Augmented, effects: Effects, phi: Array, seconds: float) -> None:
    """Take states of effects over a long gap: they drift, and have nothing to do with navigation any more.

    `extra`, `across`: as `filters.kalman.layout` says; changed in place. `phi`: regressor of the sample behind, (6, p).
    """
    after, p = augmentation.drift(before, effects.tau, effects.q, seconds), effects.mean.size
    own, cross = extra.reshape(-1, p), across.reshape(2 * p, layout.STRIDE)
    own[layout.EXTRA_MEAN] = after.x
    own[layout.EXTRA_OWN : layout.EXTRA_OWN + p] = after.P[state.SIZE :, state.SIZE :]
    own[layout.EXTRA_BEFORE : layout.EXTRA_BEFORE + 6] = phi
    cross[:p, : state.SIZE] = after.P[state.SIZE :, : state.SIZE]
    cross[:p, state.NAVIGATION] = 0.0


def set_clock(core: Array, samples: FilterInput, k: int, period: float) -> None:
    """Have sample k follow at once on a sample like it; `core` as in `filters.kalman.layout`, changed in place."""
    core[layout.CORE_T] = samples.t[k] - _AT_ONCE * period
    core[layout.CORE_GYRO : layout.CORE_GYRO + 3] = samples.gyro[k]
    core[layout.CORE_ACCEL : layout.CORE_ACCEL + 3] = samples.accel[k]
    core[layout.CORE_IN_A_ROW] = 0.0


# -------------------------------------------------------------------------------------------------------- held biases
# Biases after the reference has ended: held with their covariance, to which their walk adds; nothing is integrated.
#
# Navigation on its own would be lost within minutes, and biases would follow it. What the filter held of position,
# velocity and attitude stays that of the last sample with a reference, and rows of output have no number for it.

_SAME = 1e-9


def stretches(known: Array, count: int, begun: int, *, is_held: bool) -> list[tuple[int, int, bool]]:
    """Where biases are held: from the reference's end until all of it is known again.

    `known`: what the reference says of samples, columns of `filters.motion.reference`, shape (N, 25), or (1, 25) for
      all.
    `count`: how many samples they are.
    `begun`: samples before them; the first of all only sets the clock, and is not held.
    `is_held`: whether biases are held already.
    Returns first sample, last one exclusive, whether they are held; in order.
    """
    over = known[:, reference.VARIANCES.start] <= reference.ENDED
    if not is_held and not over.any():
        return [(0, count, False)]
    whole, held = np.all(known[:, reference.VARIANCES] >= 0.0, axis=1), np.empty(count, bool)
    for k in range(count):
        is_held = not whole[k] if is_held else bool(over[k]) and begun + k > 0
        held[k] = is_held
    edges = [0, *(np.flatnonzero(np.diff(held)) + 1).tolist(), count]
    return [(first, last, bool(held[first])) for first, last in pairwise(edges)]


@dataclass
class HeldBiases:
    """Biases over samples that no reference knows anything of any more."""

    held: Belief  # what the filter holds after the last sample with a reference
    noise: Noise  # with the walk of the biases
    since: float  # time of that sample, s
    count: int  # samples so far, those before included
    every: float  # least time between two rows of output, s
    next_out: float  # when the next row is due, s
    t: float = field(init=False)  # time of the last sample at all, s

    def __post_init__(self) -> None:
        self.t = self.since

    def belief(self) -> Belief:
        """Navigation of the last sample with a reference, biases, and their covariance of now."""
        return Belief(self.held.nav, self._covariance(self.t))

    def _covariance(self, t: float) -> Array:
        P = self.held.P.copy()
        biases = np.arange(state.NAVIGATION.stop, state.SIZE)
        walk = np.concatenate([self.noise.accel_walk, self.noise.gyro_walk]) ** 2
        P[biases, biases] += walk * (t - self.since)
        return P

    def take(self, t: Array) -> Array:
        """Take samples at `t` s, (N,), at least one; returns the rows that are due, shape (K, layout.OUT)."""
        due = []
        for k, at in enumerate(t.tolist()):
            if at >= self.next_out - _SAME:
                due.append(self._row(at, self.count + k))
                self.next_out += self.every
                self.next_out = at + self.every if self.next_out <= at else self.next_out
        self.count += t.size
        self.t = float(t[-1])
        return np.array(due).reshape(-1, layout.OUT)

    def _row(self, t: float, index: int) -> Array:
        row = np.full(layout.OUT, np.nan)
        row[layout.OUT_INDEX], row[layout.OUT_T], row[layout.OUT_DOF] = index, t, 0.0
        nav = row_of(self.held.nav)
        row[layout.OUT_NAV + layout.NAV_BA : layout.OUT_NIS] = nav[layout.NAV_BA :]
        P = self._covariance(t)
        P[state.NAVIGATION], P[:, state.NAVIGATION] = np.nan, np.nan
        row[layout.OUT_P :] = padded(P)
        return row
