"""Whether samples follow each other in a way that a filter can use: increasing time, gaps, turns between samples."""

import numpy as np
from numpy.typing import NDArray

from filters.errors import InputError
from filters.kalman.settings import GAP_PERIODS, MAX_TURN
from filters.types import Array


class SampleTimes:
    """Looks at samples as they come, refuses those that no filter can use, and notes the gaps.

    `period`: sample period, s.
    `gaps`: time of the sample before each gap, and its length, s.
    """

    def __init__(self, period: float) -> None:
        self.gaps: list[tuple[float, float]] = []
        self._period = period
        self._last_t = -np.inf

    def check(self, t: Array, gyro: Array, seen: int) -> None:
        """Take the next samples, after `seen` others.

        `t`, `gyro`: s since the first sample, and rad/s; shapes (N,), (N, 3).
        `seen`: samples before these.
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
