"""Channels that stopped changing: dead from the first reading on, or frozen later."""

import math

import numpy as np

from filters.types import Array

BLOCK = 16  # readings that are looked at together
_LEAST_S = 1.5  # a channel stands still for this long before it counts as dead or frozen
_LEAST_READINGS = 20
_LEAST_OF_TRIAD = 48  # where no other channel of the kind changes either
_LEAST_OF_UNKNOWN = 1024  # the same, of a unit whose resolution is not known
_FALSE = 1e-9  # chance of a run of equal readings that counts
_MARGIN = 2.0
_FINE = 0.7  # changes per reading of noise that exceeds its steps
_RAREST = 0.05  # changes that are expected where none was seen


class Standstill:
    """Follows runs of equal readings over blocks of readings, all channels at once.

    A run counts once it is `_MARGIN` times as long as the share of equal readings, seen so far, allows by chance.

    `resolved`: whether the unit's noise is known to exceed its counts.
    """

    def __init__(self, channels: int, *, resolved: bool) -> None:
        self._resolved = resolved
        self._last = 0.0
        self._before: Array | None = None
        self._changes = np.zeros(channels)
        self._equal = np.zeros(channels)  # readings equal to the one before, in runs that ended
        # equal pairs in the present run; the first reading follows itself
        self._run = np.full(channels, -1)
        self._since = np.zeros(channels)  # time of the first reading of the present run, s
        self._changed = np.zeros(channels, bool)
        self.frozen_s = np.zeros(channels)  # longest run that counted and ended, s
        self.frozen_since = np.full(channels, np.nan)  # when the first one began, s

    def add(self, t: Array, x: Array) -> None:
        """Take the next readings: times (n,), values (n, channels), n a multiple of `BLOCK`."""
        if self._before is None:
            self._since[:], self._last, self._before = t[0], float(t[0]), x[0]
        blocks, steps = np.arange(t.size // BLOCK)[:, None], np.concatenate([self._before[None], x])
        # NaN is no reading: it neither continues nor ends a run
        known = np.isfinite(steps)
        changed = ((steps[1:] != steps[:-1]) & known[1:] & known[:-1]).reshape(blocks.size, BLOCK, -1)
        ends, changes = changed.any(axis=1), changed.sum(axis=1)
        lead, trail = changed.argmax(axis=1), changed[:, ::-1].argmax(axis=1)
        # the block in which the run began that each block ends with; -1: before all of these
        began = np.maximum.accumulate(np.where(ends, blocks, -1))
        behind = np.take_along_axis(trail, np.maximum(began, 0), axis=0)
        run = np.where(began < 0, self._run + BLOCK * (blocks + 1), behind + BLOCK * (blocks - began))
        since = np.where(began < 0, self._since, t[(np.maximum(began, 0) + 1) * BLOCK - 1 - behind])
        closed = np.concatenate([self._run[None], run[:-1]]) + lead
        equal = np.where(ends, closed + BLOCK - lead - changes - trail, 0)
        done, times = 0, np.append(self._last, t)
        for k in np.flatnonzero((ends & (closed >= _LEAST_READINGS)).any(axis=1)).tolist():
            # how often readings are equal by chance, as the blocks before show it
            self._changes += changes[done:k].sum(axis=0)
            self._equal += equal[done:k].sum(axis=0)
            done, counted = k, ends[k] & (closed[k] >= self.least())
            equal[k] -= np.where(counted, closed[k], 0)
            for c in np.flatnonzero(counted).tolist():
                began_s = float(since[k - 1, c] if k else self._since[c])
                # the last equal reading of the run came just before the change
                self.frozen_s[c] = max(self.frozen_s[c], float(times[k * BLOCK + lead[k, c]]) - began_s)
                if np.isnan(self.frozen_since[c]):
                    self.frozen_since[c] = began_s
        self._changes += changes[done:].sum(axis=0)
        self._equal += equal[done:].sum(axis=0)
        self._run, self._since = run[-1], since[-1]
        self._changed |= ends.any(axis=0)
        self._before, self._last = x[-1], float(t[-1])

    def least(self) -> Array:
        """Equal pairs that a run needs before it counts, shape (channels,)."""
        changes = self._changes
        # where the steps may exceed the noise, a few changes are no measure of how often they come
        rare = changes + 1.0 if self._resolved else np.maximum(changes - 3.0 * np.sqrt(changes), _RAREST)
        rate = (rare / (self._equal + changes + 2.0)).reshape(-1, 3)
        # a channel beside two that change with nearly each reading should do so, too
        beside = np.minimum(np.roll(rate, 1, axis=1), np.roll(rate, 2, axis=1))
        likely = np.where(beside > _FINE, np.maximum(rate, 0.5), rate).ravel()
        share = np.clip(1.0 - likely, 1e-3, 1.0 - 1e-3)
        return np.maximum(_LEAST_READINGS, _MARGIN * math.log(_FALSE) / np.log(share))

    def still_since(self, triad: slice) -> tuple[Array, Array]:
        """When the channels of a triad stopped changing, s; NaN for one that has not, and whether each ever changed."""
        run, changed = self._run[triad], self._changed[triad]
        others = run < _LEAST_READINGS  # those that go on
        alone = others.any()
        of_dead = _LEAST_READINGS if alone else _LEAST_OF_TRIAD if self._resolved else _LEAST_OF_UNKNOWN
        least = np.where(changed, self.least()[triad], of_dead)
        long = (run >= least) & (self._last - self._since[triad] >= _LEAST_S)
        return np.where(long, self._since[triad], np.nan), changed

    @property
    def last(self) -> float:
        """Time of the newest reading, s."""
        return self._last
