"""Single values that are no readings: zeros that come too often or too regularly, and temperatures that cannot be."""

import math

import numpy as np

from filters.types import Array

_FEWEST = 3
_FINEST = 5.0  # steps in the noise: with fewer, zeros are common, or far enough from the rest to be seen as such
_EXCESS_SD = 6.0
_NEAR = 4  # steps of the lattice on each side of zero that say how many zeros chance makes
_KEPT = 512  # zeros whose places are kept
_FALSE = 1e-5  # chance of a period that counts
_LEAST_PERIODIC, _PERIODS = 5, 10  # zeros in a row; distances that are looked at

COLDEST_DEGC, HOTTEST_DEGC = -60.0, 130.0
_FARTHEST_DEGC = 1e12
_JUMP_K = 15.0  # between two readings
_FEWEST_TEMPERATURES = 20
_LEAST_S = 10.0


class Zeros:
    """Counts readings of exactly 0 on one channel, beside how many chance makes."""

    def __init__(self) -> None:
        self._count = 0
        self._zeros = 0
        self._chance = 0.0
        self._places: list[int] = []
        self._times: list[float] = []
        self._known: tuple[int, float] | None = None  # what `found` returns after so many readings
        self._known_at = 0

    def add(self, t: Array, x: Array, step: float) -> None:
        """Take readings of shape (n,) that come in steps of `step`, 0 if they show none."""
        if x.std() < _FINEST * step:
            self._count += x.size
            return
        zero = x == 0.0
        zero[1:] &= x[1:] != x[:-1]
        rows = np.flatnonzero(zero)
        self._zeros += rows.size
        room = _KEPT - len(self._places)
        self._places += (self._count + rows[:room]).tolist()
        self._times += t[rows[:room]].tolist()
        self._count += x.size
        self._chance += _zeros_by_chance(x, step)

    def found(self) -> tuple[int, float] | None:
        """How many invalid zeros there are, and when the first one came, s; None if chance explains them."""
        if self._known_at != self._count:
            self._known_at, self._known = self._count, self._found()
        return self._known

    def _found(self) -> tuple[int, float] | None:
        if self._zeros < _FEWEST:
            return None
        if self._zeros - self._chance > _EXCESS_SD * math.sqrt(self._chance) + _FEWEST - 1:
            return round(self._zeros - self._chance), self._times[0]
        return self._periodic()

    def _periodic(self) -> tuple[int, float] | None:
        """Zeros at equal distances, more of them in a row than chance allows."""
        places = np.array(self._places)
        if places.size < _LEAST_PERIODIC:
            return None
        apart = (places[None, :] - places[:, None])[np.triu_indices(places.size, 1)]
        # a period that is no whole number of readings spreads over neighbours
        around = np.convolve(np.bincount(apart), np.ones(3, np.int64), "same")
        covered = int(places[-1] - places[0]) + 1
        density = min(1.0, 3.0 * places.size / covered)
        most = min(_PERIODS, around.size)
        for lag in np.argpartition(around, -most)[-most:].tolist():
            first, length = _longest_chain(self._places, lag)
            chance = covered**2 / length * density ** (length - 1)
            if length >= _LEAST_PERIODIC and chance < _FALSE:
                return length, self._times[first]
        return None


def _zeros_by_chance(x: Array, step: float) -> float:
    """How many readings of exactly 0 to expect, from the values beside 0."""
    near = x[(x != 0.0) & (np.abs(x) < (_NEAR + 0.5) * step)]
    if not near.size:
        return 0.0
    # of values that come n times each, independently: the mean of n(n - 1) over that of n
    each = np.unique(near, return_counts=True)[1]
    alike = float(np.sum(each * (each - 1.0)) / near.size)
    per_step = near.size / (2.0 * _NEAR)
    # no reading between 0 and the next step: values come in steps, though a changing scale makes each differ a little
    return max(alike, per_step) if 2 * np.count_nonzero(np.abs(near) < 0.5 * step) <= per_step else alike


def _longest_chain(places: list[int], lag: int) -> tuple[int, int]:
    """Return the first row and the length of the longest chain of places that are `lag` apart, give or take one."""
    row, length, first = {place: k for k, place in enumerate(places)}, dict[int, int](), dict[int, int]()
    for place in places:
        near = [p for p in (place - lag - 1, place - lag, place - lag + 1) if p in length and p < place]
        before = max(near, key=length.__getitem__, default=None)
        length[place] = 1 if before is None else length[before] + 1
        first[place] = row[place] if before is None else first[before]
    last = max(places, key=length.__getitem__)
    return first[last], length[last]


class Temperatures:
    """Follows the temperature: its values, its jumps, and whether it ever changed."""

    def __init__(self) -> None:
        self._count = 0
        self._first = self._last = math.nan
        self._began = self._ended = 0.0
        self._changed = False
        self._absurd: tuple[float, float] | None = None  # time and value of the first one
        self._jump: tuple[float, float, float] | None = None  # time, before, after

    def add(self, t: Array, degc: Array) -> None:
        """Take the next readings, degC, shape (n,); NaN where there is none."""
        known = ~np.isnan(degc)
        t, degc = t[known], degc[known]
        if not degc.size:
            return
        degc = np.clip(degc, -_FARTHEST_DEGC, _FARTHEST_DEGC)  # infinite ones are absurd, too
        if not self._count:
            self._first = self._last = float(degc[0])
            self._began = float(t[0])
        steps = np.diff(degc, prepend=self._last)
        self._changed |= bool(steps.any())
        if self._absurd is None:
            out = (degc < COLDEST_DEGC) | (degc > HOTTEST_DEGC)
            if out.any():
                row = int(out.argmax())
                self._absurd = float(t[row]), float(degc[row])
        if self._jump is None and (np.abs(steps) > _JUMP_K).any():
            row = int((np.abs(steps) > _JUMP_K).argmax())
            self._jump = float(t[row]), float(degc[row] - steps[row]), float(degc[row])
        self._count += degc.size
        self._last, self._ended = float(degc[-1]), float(t[-1])

    def found(self) -> tuple[float, str] | None:
        """When the fault began, s, and what it is; None if there is none."""
        if self._absurd is not None:
            t, degc = self._absurd
            return t, f"the temperature reads {degc:.6g} degC, which is outside {COLDEST_DEGC:g} to {HOTTEST_DEGC:g}"
        if self._jump is not None:
            t, before, after = self._jump
            return t, f"the temperature jumps from {before:.1f} to {after:.1f} degC between two readings"
        dead = not self._changed and self._count >= _FEWEST_TEMPERATURES and self._ended - self._began >= _LEAST_S
        if dead and self._first == 0.0:
            return self._began, "the temperature has read 0 degC and nothing else: its sensor is dead"
        return None
