"""The first rest of a unit that is turned by hand, told from the readings as they come.

Readings wait for the end of their second; it is at rest where every channel is quiet and steady. Whether it is depends
on no later reading and not on how many come at once, so that live and replay use the same samples. All rests of a whole
log are found, by its own quietest windows, in `filters.multiposition.rests`.
"""

import numpy as np
from numpy.typing import NDArray

from filters.imu import STANDARD_GRAVITY, ImuSpec
from filters.kalman.filter_input import Readings
from filters.types import Array

WINDOW_S = 1.0
_LEAST = 8
_QUIET = 2.0
"""Standard deviation of a reading at rest, in the specification's: hands add to it, other instruments have more."""
_WITHIN = 4.0  # standard deviation within a rest, in that of its quietest window
_STEADY = np.repeat([np.deg2rad(0.2), 5e-3 * STANDARD_GRAVITY], 3)
_MOVED = np.repeat([np.deg2rad(1.0), 30e-3 * STANDARD_GRAVITY], 3)


class FirstRest:
    """Lets the samples of the first rest pass, and no other.

    `period`: sample period, s.
    `spec`: says how noisy a reading may be.
    `over`: whether the first rest has come and gone.
    `begun`: time of its first sample, s.
    `last_t`: time of the last sample that came, of the rest or not, s.
    """

    def __init__(self, period: float, spec: ImuSpec) -> None:
        self.over = False
        self.begun: float | None = None
        self.last_t: float | None = None
        self._size = max(_LEAST, round(WINDOW_S / period))
        sd = np.repeat([spec.gyro_arw, spec.accel_vrw], 3) / np.sqrt(period)
        self._limit = (_QUIET * sd) ** 2
        self._least = 1e-4 * self._limit
        self._quietest = np.full(6, np.inf)
        self._mean = np.zeros(6)
        self._waiting: Readings | None = None

    def take(self, readings: Readings) -> Readings:
        """The samples that are known by now to belong to the first rest."""
        if readings.t.size:
            self.last_t = float(readings.t[-1])
        if self.over:
            return readings.part(slice(0))
        whole = readings if self._waiting is None else Readings.joined([self._waiting, readings])
        first, used = None, 0
        while not self.over and used + self._size <= whole.t.size:
            window = whole.part(slice(used, used + self._size))
            at_rest = self._at_rest(np.hstack([window.gyro, window.accel]))
            if at_rest and self.begun is None:
                self.begun = float(window.t[0])
            if at_rest and first is None:
                first = used
            self.over = self.begun is not None and not at_rest
            used += 0 if self.over else self._size
        self._waiting = whole.part(slice(used, None))
        return whole.part(slice(used if first is None else first, used))

    def _at_rest(self, values: Array) -> bool:
        """Whether a window of readings (n, 6), rad/s and m/s², is quiet and steady, and like the rest so far."""
        variance, mean = values.var(axis=0), values.mean(axis=0)
        half = len(values) // 2
        drift = np.abs(values[:half].mean(axis=0) - values[half:].mean(axis=0))
        steady = drift <= _STEADY + 5.0 * np.sqrt(4.0 * variance / len(values))
        if not _all(variance <= self._limit, values) or not _all(steady, values):
            return False
        if self.begun is None:
            self._mean = mean
        elif not _all(variance <= _WITHIN**2 * self._quietest, values) or not _all(
            np.abs(mean - self._mean) <= _MOVED, values
        ):
            return False
        self._quietest = np.fmin(self._quietest, np.maximum(variance, self._least))
        return True


def _all(good: NDArray[np.bool_], values: Array) -> bool:
    """Whether all channels are good; one that is not a number says nothing."""
    return bool(np.all(good | ~np.isfinite(values).any(axis=0)))
