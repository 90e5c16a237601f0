"""Biases after the reference has ended: held with their covariance, to which their walk adds; nothing is integrated.

Navigation on its own would be lost within minutes, and biases would follow it. What the filter held of position,
velocity and attitude stays that of the last sample with a reference, and rows of output have no number for it.
"""

from itertools import pairwise

import numpy as np

from filters import state
from filters.imu import Noise
from filters.kalman import layout
from filters.kalman.rows import padded, row_of
from filters.kalman.spkf import Belief
from filters.motion import reference
from filters.types import Array

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


class HeldBiases:
    """Biases over samples that no reference knows anything of any more.

    `belief`: what the filter holds after the last sample with a reference.
    `noise`: with the walk of the biases.
    `since`: time of that sample, s.
    `count`: samples up to it.
    `every`: least time between two rows of output, s.
    `next_out`: when the next row is due, s.
    `since`, `t`: time of the last sample with a reference, and of the last one at all, s.
    `count`: samples so far, those before included.
    `next_out`: when the next row is due, s.
    """

    def __init__(self, belief: Belief, noise: Noise, since: float, count: int, every: float, next_out: float) -> None:
        self.since = self.t = since
        self.count = count
        self.next_out = next_out
        self._belief = belief
        self._walk = np.concatenate([noise.accel_walk, noise.gyro_walk]) ** 2
        self._every = every

    def belief(self) -> Belief:
        """Navigation of the last sample with a reference, biases, and their covariance of now."""
        return Belief(self._belief.nav, self._covariance(self.t))

    def _covariance(self, t: float) -> Array:
        P = self._belief.P.copy()
        biases = np.arange(state.NAVIGATION.stop, state.SIZE)
        P[biases, biases] += self._walk * (t - self.since)
        return P

    def take(self, t: Array) -> Array:
        """Take samples at `t` s, (N,), at least one; returns the rows that are due, shape (K, layout.OUT)."""
        due = []
        for k, at in enumerate(t.tolist()):
            if at >= self.next_out - _SAME:
                due.append(self._row(at, self.count + k))
                self.next_out += self._every
                self.next_out = at + self._every if self.next_out <= at else self.next_out
        self.count += t.size
        self.t = float(t[-1])
        return np.array(due).reshape(-1, layout.OUT)

    def _row(self, t: float, index: int) -> Array:
        row = np.full(layout.OUT, np.nan)
        row[layout.OUT_INDEX], row[layout.OUT_T], row[layout.OUT_DOF] = index, t, 0.0
        nav = row_of(self._belief.nav)
        row[layout.OUT_NAV + layout.NAV_BA : layout.OUT_NIS] = nav[layout.NAV_BA :]
        P = self._covariance(t)
        P[state.NAVIGATION], P[:, state.NAVIGATION] = np.nan, np.nan
        row[layout.OUT_P :] = padded(P)
        return row
