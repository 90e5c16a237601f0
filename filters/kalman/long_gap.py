"""Going on behind a long gap: navigation begins anew from what the reference knows, biases are carried over.

A sample that is held over a gap of T seconds has a noise that adds up coherently: at 133 Hz the attitude is lost by
0.87 deg a second, the velocity by g times the half of that times T, and soon nothing is small any more that equations
of small errors need. Of what the filter held before a long gap only the biases are worth keeping, and what they are
correlated with in a unit that rests.
"""

import numpy as np

from filters import state
from filters.imu import Noise
from filters.kalman import augmentation, layout
from filters.kalman.augmentation import Augmented, Effects
from filters.kalman.filter_input import FilterInput
from filters.kalman.rows import nav_of, row_of
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

    `period`: sample period, s.
    `moving`: whether the unit may move: then all that the reference can know has to be known at such a sample.
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

    `extra`, `across`: as `filters.kalman.layout` says; changed in place.
    `before`: what the filter held before the gap.
    `effects`: whose states they are.
    `phi`: regressor of the sample behind the gap, shape (6, p).
    `seconds`: length of the gap, s.
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
