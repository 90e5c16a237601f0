"""Is the filter to be believed: NIS and its band, the log's own noise, and when a bias has converged.

Convergence, after 10 s during which all of this held: the standard deviation is below tolerance; the estimate is within
tolerance of its own mean over 10 s; the 10 s mean of (raw residual - estimated bias) lies inside
5 √(σ_w²/10 s + σ_b²), σ_w being the white noise measured on the log. It is lost after 10 s during which the last of
these did not hold. Raw residual: reading minus what a perfect unit would measure at the reference. The first two alone
are met by any filter left running; the third compares with data. Where the reference does not say what a perfect unit
would measure (a trajectory without attitude), the first two are all there is.

The remainder, what the model does not explain, is seen in means over longer stretches than noise: over the last windows
of 10 s that do not overlap, the rms of (10 s mean of raw residual - estimated bias) over what white noise and the
standard deviation of the estimate allow. It is about 1 where nothing else is in the readings, a little less while the
estimate still rests on the same few windows, and grows with drift. It is told, and decides nothing.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from filters.allan import CHI2_MEDIAN
from filters.imu import STANDARD_GRAVITY
from filters.types import Array

TOLERANCE = np.array([0.6e-3 * STANDARD_GRAVITY] * 3 + [0.05 * np.pi / 180.0] * 3)
"""Standard deviation below which a bias counts as known: 0.6 mg, 0.05 deg/s (Table 1's resolution)."""
HOLD = 10.0  # s that the conditions must hold, and over which means are taken
REMAINDER_WINDOWS = 6  # windows of 10 s, at most, that the remainder is told from
_BAND = 5.0
_NOISE_BLOCKS = 600
_NOISE_SD = 1.27
"""Relative standard deviation of the noise, times the root of the number of differences: from simulated white noise."""


def nis_band(dof: float, count: int, level: float = 0.95) -> tuple[float, float]:
    """Interval that the mean of `count` independent NIS values of `dof` degrees of freedom falls in.

    `dof`: rows of a measurement, their mean where they differ; positive.
    `count`: number of updates.
    `level`: probability.
    Returns lower and upper end (chi-square with dof · count degrees of freedom, divided by count).
    """
    tail = 0.5 * (1.0 - level)
    total = dof * count
    # here, since who only runs a filter should not wait for it; scipy.stats has the same quantiles and takes far longer
    from scipy.special import chdtri

    return float(chdtri(total, 1.0 - tail) / count), float(chdtri(total, tail) / count)


# upper quantiles of chi-square, 1 to 9 degrees of freedom, at the probability 1e-9 with which a good innovation is
# rejected (a hundredth of one in 24 h of 133 Hz); a test holds them against scipy
_GATES = (
    37.324893051362324,
    41.44653167389282,
    44.841275330562404,
    47.87945573114794,
    50.69219370154303,
    53.344573117300236,
    55.87478101282902,
    58.307613127485624,
    60.6603083737724,
)


def nis_gates() -> Array:
    """NIS beyond which an innovation is rejected, by number of rows 0 to 9, shape (10,)."""
    return np.array([np.inf, *_GATES])


@dataclass(frozen=True, slots=True)
class Convergence:
    """Verdict on the six biases (accelerometer x, y, z, gyro x, y, z; body axes)."""

    # time since the first sample at which each was declared converged and has stayed so, s
    since: tuple[float | None, ...]
    # mean of the raw residual over the last 10 s, shape (6,), m/s² and rad/s: what the bias looks like without a
    # filter. None before the first 10 s are over, and where the motion was not known in them.
    apparent: Array | None
    change: Array | None  # change of each estimate over the last 10 s, shape (6,)


@dataclass(frozen=True, slots=True)
class Remainder:
    """What the model does not explain of the last minute."""

    # rms of 10 s means of (raw residual - estimated bias) over what white noise and the estimate's standard deviation
    # allow, accelerometer then gyro, body axes, shape (6,). None before the first window.
    ratio: Array | None
    windows: int  # windows it is told from


class ConvergenceMonitor:
    """Keeps the last 10 s of residuals and estimates in blocks of a second, and judges the biases once a block.

    What is in a block is added up by whoever runs the filter.

    `period`: sample period, s; a block is a second or, at slower rates, one sample.
    """

    def __init__(self, period: float) -> None:
        self._block = max(1.0, period)
        self._window = max(1, round(HOLD / self._block))
        self._end = np.inf
        self._means: deque[Array] = deque(maxlen=self._window)
        self._squares = np.zeros((_NOISE_BLOCKS, 6))
        self._steps = 0
        self._ok_from: list[float | None] = [None] * 6
        self._out_from: list[float | None] = [None] * 6
        self._since: list[float | None] = [None] * 6
        self._change: Array | None = None
        self._apparent: Array | None = None
        self._judged = 0
        self._departures: deque[Array] = deque(maxlen=REMAINDER_WINDOWS)

    @property
    def end(self) -> float:
        """Time at which the present block ends, s; infinity before `begin`."""
        return self._end

    @property
    def block(self) -> float:
        """Length of a block, s."""
        return self._block

    def begin(self, t: float) -> None:
        """Start the first block at `t` s."""
        self._end = t + self._block

    def close(self, t: float, residual: Array, mean_bias: Array, bias: Array, bias_sd: Array) -> None:
        """End a block, since the sample at `t` is beyond it.

        `t`: s since the first sample.
        `residual`: mean raw residual of the block, accelerometer then gyro, shape (6,), SI; NaN where nothing was
          known.
        `mean_bias`: mean estimates over the block, same order.
        `bias`, `bias_sd`: estimates at the end of the block and their standard deviations.
        """
        mean = np.concatenate([residual, mean_bias])
        if self._means:
            step = (mean - self._means[-1])[:6]
            if np.isfinite(step).all():
                self._squares[self._steps % _NOISE_BLOCKS] = step**2
                self._steps += 1
        self._means.append(mean)
        if len(self._means) == self._window:
            self._judge(self._end, bias, bias_sd)
        # a gap may span many blocks; empty ones say nothing. Where rounding puts `t` before the end one is over all the
        # same: whoever runs the filter waits for the end to move on
        self._end += self._block * max(1, 1 + int((t - self._end + 1e-9) // self._block))

    def _judge(self, t: float, bias: Array, bias_sd: Array) -> None:
        means = np.array(self._means)
        self._change = bias - means[0, 6:]
        known = np.isfinite(means[:, 0])
        self._apparent = means[known, :6].mean(axis=0) if known.any() else None
        agrees = np.ones(6, bool)
        if self._apparent is not None:
            noise, agrees = self.noise(), np.zeros(6, bool)
            if noise is not None:
                seconds = self._block * self._window * np.count_nonzero(known) / known.size
                # standard deviation of (mean raw residual - estimate)
                allowed = np.sqrt(noise**2 / seconds + bias_sd**2)
                agrees = np.abs(self._apparent - bias) < _BAND * allowed
                # every window that shares no block with the one kept before
                if self._judged % self._window == 0:
                    self._departures.append((self._apparent - bias) / allowed)
        self._judged += 1
        steady = np.abs(bias - means[:, 6:].mean(axis=0)) < TOLERANCE
        settled = (bias_sd < TOLERANCE) & steady & agrees
        for i in range(6):
            self._ok_from[i] = (self._ok_from[i] if self._ok_from[i] is not None else t) if settled[i] else None
            self._out_from[i] = None if agrees[i] else (self._out_from[i] if self._out_from[i] is not None else t)
            ok_from, out_from = self._ok_from[i], self._out_from[i]
            if self._since[i] is None and ok_from is not None and t - ok_from >= HOLD - 1e-9:
                self._since[i] = t
            elif self._since[i] is not None and out_from is not None and t - out_from >= HOLD - 1e-9:
                self._since[i] = None

    def noise(self) -> Array | None:
        """White noise density measured on the log, from the median of squared first differences of blocks.

        Drift and single steps hardly move it.

        Returns accelerometer m/s/√s, gyro rad/√s, shape (6,); None before two differences exist.
        """
        count = min(self._steps, _NOISE_BLOCKS)
        if count < 2:
            return None
        low, high = (count - 1) // 2, count // 2
        ordered = np.partition(self._squares[:count], [low, high] if high > low else low, axis=0)
        variance = 0.5 * (ordered[low] + ordered[high]) / CHI2_MEDIAN / 2.0
        return np.asarray(np.sqrt(variance * self._block))

    def noise_relative_sd(self) -> float | None:
        """Relative standard deviation of `noise`, were it white; None where that is None."""
        count = min(self._steps, _NOISE_BLOCKS)
        return None if count < 2 else float(_NOISE_SD / np.sqrt(count))

    def remainder(self) -> Remainder:
        """What the model does not explain, over the last windows; see the module's head."""
        if not self._departures:
            return Remainder(None, 0)
        return Remainder(np.sqrt(np.mean(np.square(self._departures), axis=0)), len(self._departures))

    def convergence(self) -> Convergence:
        """Verdict as of the last full block."""
        return Convergence(tuple(self._since), self._apparent, self._change)
