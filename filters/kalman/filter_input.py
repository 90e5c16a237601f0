"""From readings to what an engine takes: what the reference knows at each, what effects say of it, drawn noise.

Before that, `SampleTimes` looks whether the readings follow each other in a way that a filter can use.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from filters.errors import InputError
from filters.kalman import augmentation
from filters.kalman.alarms import Turns
from filters.kalman.augmentation import Effects
from filters.kalman.settings import GAP_PERIODS, MAX_TURN, Settings
from filters.motion import reference
from filters.motion.reference import Reference, TableMotion
from filters.types import Array

# ------------------------------------------------------------------------------------------------------- sample times
# Whether samples follow each other in a way that a filter can use: increasing time, gaps, turns between samples.


class SampleTimes:
    """Looks at samples of a period, s, as they come, refuses those that no filter can use, and notes the gaps."""

    def __init__(self, period: float) -> None:
        self.gaps: list[tuple[float, float]] = []  # time of the sample before each, and its length, s
        self._period = period
        self._last_t = -np.inf

    def check(self, t: Array, gyro: Array, seen: int) -> None:
        """Take the next samples, s and rad/s, shapes (N,) and (N, 3), after `seen` others.

        Raises InputError if time does not increase, or the unit turns too far between two samples.
        """
        before = np.concatenate([[self._last_t], t[:-1]])
        steps = t - before
        if not np.all(steps > 0.0):
            k = int(np.argmax(~(steps > 0.0)))
            raise InputError(f"`t` goes from {before[k]} s to {t[k]} s at sample {seen + k}: time must increase")
        gaps = self.are_gaps(before, t)
        self.gaps += [(float(before[k]), float(steps[k])) for k in np.flatnonzero(gaps)]
        turned = np.sqrt(np.sum(gyro**2, axis=1)) * np.where(gaps | ~np.isfinite(steps), 0.0, steps)
        if np.any(turned > MAX_TURN):
            k = int(np.argmax(turned > MAX_TURN))
            raise InputError(
                f"the unit turns {np.rad2deg(turned[k]):.0f} deg between two samples at {t[k]:.3f} s (rate"
                f" {1.0 / self._period:g} Hz): nothing is known of the rate in between."
                " Record rotation at 10 Hz or more"
            )
        if t.size:
            self._last_t = float(t[-1])

    def are_gaps(self, before: Array, t: Array) -> NDArray[np.bool_]:
        """Which of the steps from `before` to `t` are longer than a sample can stand for."""
        steps = t - before
        return (steps > GAP_PERIODS * self._period) & np.isfinite(steps)

    def note_left_out(self, arrived: Array, used: Array, t: Array) -> None:
        """Note the gaps that come of samples not being used.

        `arrived`, `used`: time of the sample before each one, of all that came and of those that are used; s, shape
          (N,).
        `t`: the samples, s, shape (N,).
        """
        left_out = self.are_gaps(used, t) & ~self.are_gaps(arrived, t)
        new = [(float(used[k]), float(t[k] - used[k])) for k in np.flatnonzero(left_out)]
        self.gaps = sorted(self.gaps + new)


# ------------------------------------------------------------------------------------------------------- filter input

_WORDS = 12


@dataclass(frozen=True, slots=True)
class Readings:
    """What a unit read, on its way to the filter."""

    t: Array  # s since the first sample, shape (N,), increasing
    # gyro, accel: rad/s and m/s², body axes, shape (N, 3)
    gyro: Array
    accel: Array
    temperature: Array  # degC, shape (N,); NaN where it is not known

    def part(self, which: slice | NDArray[np.bool_]) -> "Readings":
        """The samples of a stretch, as a record of the same kind."""
        return Readings(self.t[which], self.gyro[which], self.accel[which], self.temperature[which])

    @staticmethod
    def joined(parts: "list[Readings]") -> "Readings":
        """All of several, in order."""
        return Readings(
            np.concatenate([part.t for part in parts]),
            np.concatenate([part.gyro for part in parts]),
            np.concatenate([part.accel for part in parts]),
            np.concatenate([part.temperature for part in parts]),
        )


class FilterInput(NamedTuple):
    """Samples with what is known at each, as an engine takes them; arrays are C-contiguous float64."""

    # t, gyro, accel: s, rad/s, m/s², body axes; shapes (N,), (N, 3), (N, 3)
    t: Array
    gyro: Array
    accel: Array
    known: Array  # what the reference says, columns of `filters.motion.reference`, shape (N, 25), or (1, 25) for all
    draws: Array  # standard normal draws of the pseudo-measurements, (N, 9), or empty, (0, 9), for exact ones
    # regressor of the p extra states, (N, 6, p), accelerometer then gyro; empty without effects
    phi: Array = np.empty((0, 6, 0))
    # factor on the white noise of each channel, (N, 6), same order; empty without effects
    noise_scale: Array = np.empty((0, 6))


def draws(seed: int, first: int, count: int) -> Array:
    """Standard normal draws that depend on seed and sample number alone.

    Philox counts: a sample has twelve words of its own, nine are used, by the inverse of the normal distribution.

    `seed`: key of the generator.
    `first`, `count`: samples.
    Returns shape (count, 9).
    """
    # here, since a run on the exact reference draws nothing and should not wait for it
    from scipy.special import ndtri

    generator = np.random.Philox(key=seed, counter=[first * _WORDS // 4, 0, 0, 0])
    words = generator.random_raw(count * _WORDS).reshape(count, _WORDS)[:, :9]
    return np.asarray(ndtri(((words >> np.uint64(11)) + 0.5) * 2.0**-53))


@dataclass
class InputBuilder:
    """Makes the input of the next readings; effects and marks have a memory, so readings come in order, once each."""

    settings: Settings  # of the run
    reference: Reference
    effects: Effects | None  # that join the filter
    times: SampleTimes  # where gaps are noted that come of readings being left out
    marks: list[tuple[float, str]]  # of the operator, still to be taken; those that are, are removed
    turns: Turns = field(default_factory=Turns)  # what the motion so far tells
    _shown_t: float = -np.inf

    def input(self, readings: Readings, index: int, before: float) -> FilterInput:
        """Input of those of the next readings, at least one, that are used.

        Those that effects flag are predicted through, as samples that are flagged in the log are: the engine, which has
        used `index` samples, the last at `before` s (-inf: none), never sees them.
        """
        known = self._known(readings, before if self.effects is None else self._shown_t)
        included: list[Array] = []
        if self.effects is not None:
            readings, known, *included = self._include(self.effects, readings, known, before)
        if self.reference.moving:
            self.turns.add(known[:, reference.RATE])
        n, settings = readings.t.size, self.settings
        drawn = draws(settings.seed, index, n) if settings.measurements == "drawn" else np.empty((0, 9))
        arrays = readings.t, readings.gyro, readings.accel, known, drawn, *included
        return FilterInput(*(np.require(a, np.float64, ("C", "W")) for a in arrays))

    def _include(
        self, effects: Effects, readings: Readings, known: Array, before: float
    ) -> tuple[Readings, Array, Array, Array]:
        """Readings that the effects let pass, what is known at them, their regressors and their noise."""
        t = readings.t
        phi, scale, use = effects.rows(
            t, readings.gyro, readings.accel, readings.temperature, np.broadcast_to(known, (t.size, known.shape[1]))
        )
        augmentation.check_rows(effects.names, t, phi, scale, use)
        if not use.all() or before != self._shown_t:
            readings = readings.part(use)
            # what a trajectory says at a sample that is not used goes to the next one that is
            known = self.reference.known(readings.t, before, readings.gyro)
            used = np.concatenate([[before], readings.t])[:-1]
            arrived = np.concatenate([[self._shown_t], t[:-1]])[use]
            self.times.note_left_out(arrived, used, readings.t)
        self._shown_t = float(t[-1])
        return readings, known, phi[use], scale[use]

    def _known(self, readings: Readings, before: float) -> Array:
        """What the reference says at each reading, with marks among them, or one row for all."""
        found, t = self.reference, readings.t
        if not isinstance(found, TableMotion) or not self.marks:
            return found.known(t, before, readings.gyro)
        parts, first = [], 0
        while first < t.size:
            while self.marks and self.marks[0][0] <= t[first]:
                found.mark(*self.marks.pop(0))
            until = self.marks[0][0] if self.marks else np.inf
            last = first + int(np.searchsorted(t[first:], until, side="left"))
            parts.append(found.known(t[first:last], before, readings.gyro[first:last]))
            before, first = float(t[last - 1]), last
        return np.concatenate(parts)
