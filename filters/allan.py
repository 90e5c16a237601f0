"""Allan deviation, of all samples at once or of a stream of any length, and the noise levels read from it.

Input are equally spaced samples of a still sensor, without gaps and without NaN: stretches between gaps are to be cut
out by the caller. Leaves out ramps (warm-up), which come out as random walk, and any name for what a bump means.

References
----------
IEEE Std 952-2020, annex C (terms of the Allan variance of a rate sensor); W. J. Riley, "Handbook of frequency stability
analysis", NIST SP 1065, 2008 (overlapping estimator, section 5.2.4; degrees of freedom, table 5).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from filters.errors import InputError
from filters.types import Array

CHI2_MEDIAN = 0.4549364
"""Median of chi-square with one degree of freedom: the median of squares over it is their variance, outliers or not."""

SETTLED = 0.03
"""s: averaging times below it are left out by `noise_of`. Table 1's gyro is band-limited at 25 Hz, and for times below
five of its time constants (6.4 ms) the Allan variance is not yet that of white noise."""

MIN_TAUS = 5
_AT_ONCE = 2**14
_ROUNDS = 10
# correlation of the variance's overlapping estimates at m and 2^j m, white noise; negligible beyond
_CORRELATION_SCALE = 32


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """Densities of one or more channels, each array of shape (k,), in the sensor's unit times the power of s named."""

    white: Array  # white noise N, unit·√s: rad/√s of a gyro in rad/s, m/s/√s of an accelerometer in m/s². N²/τ of AVAR.
    white_sd: Array  # standard deviation of `white`, from the degrees of freedom of each averaging time
    instability: Array  # B, unit: the flat part of the Allan deviation. B² of AVAR.
    drift: Array  # random walk of the rate K, unit/√s; 0 where none shows. K² τ/3 of AVAR.


@dataclass(frozen=True, slots=True)
class AllanTable:
    """Allan deviations of several channels."""

    factors: NDArray[np.int64]  # samples in each mean
    deviation: Array  # in the samples' unit
    dof: Array  # equivalent degrees of freedom of each deviation's square


def deviation(x: Array, period: float, factors: NDArray[np.int_] | None = None) -> tuple[Array, Array]:
    """Overlapping Allan deviation, σ²(mT) = ⟨(x̄_{k+m} - x̄_k)²⟩ / 2, x̄_k the mean of the m samples from k on.

    Cumulative sums make each averaging time cost one pass: O(N) whatever m is.

    `x`: equally spaced samples of a rate, shape (N,) or (N, k).
    `period`: sample period T, s.
    `factors`: samples m in each mean, from 1 to N // 2; by default the octaves 1, 2, 4, ... up to N // 4.
    Returns `tau`, averaging times m T, s, shape (M,).
    Returns `adev`, deviations, unit of x, shape (M,) or (M, k).
    Raises ValueError if x is not finite or not of one or two dimensions, `period` is not positive, or a factor does not
      fit.
    """
    if x.ndim not in (1, 2):
        raise ValueError(f"`x` has shape {x.shape}, not (N,) or (N, k)")
    if not np.all(np.isfinite(x)):
        raise ValueError(f"`x` has {np.count_nonzero(~np.isfinite(x))} values that are not finite: cut gaps out first")
    if not period > 0.0:
        raise ValueError(f"`period` is {period} s, not positive")
    count = x.shape[0]
    if factors is None:
        factors = octaves(1, count // 4)
    if factors.size and not (factors.min() >= 1 and factors.max() <= count // 2):
        raise ValueError(
            f"`factors` go from {factors.min()} to {factors.max()}: {count} samples allow 1 to {count // 2}"
        )
    # without the mean, sums stay small and so does their rounding
    total = np.concatenate([np.zeros((1, *x.shape[1:])), np.cumsum(x - x.mean(axis=0), axis=0)])
    adev = np.empty((factors.size, *x.shape[1:]))
    for i, m in enumerate(factors):
        second = total[2 * m :] - 2.0 * total[m:-m] + total[: -2 * m]
        adev[i] = np.sqrt(np.mean(second**2, axis=0) / 2.0) / m
    return np.asarray(factors * period, float), adev


def octaves(first: int, last: int) -> NDArray[np.int_]:
    """Averaging factors first, 2 first, 4 first, ... not above `last`; empty if `last` is below `first`."""
    count = int(np.floor(np.log2(last / first))) + 1 if last >= first else 0
    return np.asarray(first * 2 ** np.arange(count), int)


def degrees_of_freedom(count: int, factors: NDArray[np.int_]) -> Array:
    """Equivalent degrees of freedom of the overlapping estimate for white noise of the rate (SP 1065, table 5).

    (3(n-1)/(2m) - 2(n-2)/n) · 4m²/(4m² + 5), at least 1, n = count + 1 points of phase, of averaging factors m, (M,).
    For other noise about the same number.
    """
    m, n = factors.astype(float), count + 1.0
    edf = (3.0 * (n - 1.0) / (2.0 * m) - 2.0 * (n - 2.0) / n) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
    return np.asarray(np.maximum(edf, 1.0), float)


def noise_of(x: Array, period: float) -> NoiseLevels:
    """White noise and random walk of each channel, by a fit to its Allan variance.

    σ²(τ) = N²/τ + B² + K² τ/3 + c/τ², N², B², K² ≥ 0, from octaves of τ between `SETTLED` and a quarter of the record,
    each weighted by its degrees of freedom. c takes what is not white in the shortest times and is thrown away: it is
    positive for quantisation of increments, negative for a band limit, whatever its order. Quantisation of the rate
    itself is white and belongs to N.

    `x`: equally spaced samples of a still sensor, shape (N,) or (N, k); constant biases do not matter.
    `period`: sample period, s.
    Returns one entry a channel. A channel that is stuck at one value has zeros.
    Raises ValueError if the record is too short for five averaging times, or `deviation` refuses it.
    """
    if not period > 0.0:
        raise ValueError(f"`period` is {period} s, not positive")
    x = x[:, None] if x.ndim == 1 else x
    factors = _settled(x.shape[0], period)
    return _levels(factors, deviation(x, period, factors)[1], x.shape[0], period)


class RunningAllan:
    """Allan deviation of a stream of samples in bounded memory; no difference is taken across an interruption.

    Overlapping up to `overlap` samples in a mean, and beyond that at a stride of the mean's length over `overlap`:
    already at 8 this costs next to no degrees of freedom, and at thousands it is the same number to many digits.

    `channels`: values of a sample.
    `overlap`: a power of two.
    """

    def __init__(self, channels: int, overlap: int = 8) -> None:
        self._channels, self._overlap = channels, overlap
        self._levels: list[_Level] = []
        self._first: NDArray[Any] | None = None

    def add(self, samples: NDArray[Any]) -> None:
        """Take the next samples, (n, k): sums of whole numbers stay exact for ever."""
        if self._first is None and len(samples):
            self._first = samples[0].copy()
        for at in range(0, len(samples), _AT_ONCE):
            # differences know no constant, and without it sums and their rounding stay small
            block, number = samples[at : at + _AT_ONCE] - self._first, 0
            while len(block):
                if number == len(self._levels):
                    factors = [self._overlap] if number else octaves(1, self._overlap).tolist()
                    self._levels.append(_Level(self._channels, factors))
                block = self._levels[number].add(block)
                number += 1

    def interrupt(self) -> None:
        """Take note that the next samples do not follow those before."""
        for level in self._levels:
            level.interrupt()

    def table(self) -> AllanTable:
        """Deviations for averaging times of an octave each, up to a third of what there is."""
        factors, deviations, dof = [], [], []
        for number, level in enumerate(self._levels):
            for m, squares, count in zip(level.factors, level.squares, level.counts.tolist(), strict=True):
                factor, differences = m << number, count << number
                if differences >= factor:
                    factors.append(factor)
                    deviations.append(np.sqrt(squares / (2.0 * count)) / factor)
                    # as of one stretch that has as many differences; several stretches have a little more
                    dof.append(degrees_of_freedom(differences + 2 * factor - 1, np.array([factor]))[0])
        shape = (len(factors), self._channels)
        return AllanTable(np.array(factors, np.int64), np.reshape(np.array(deviations, float), shape), np.array(dof))

    def noise(self, period: float) -> NoiseLevels:
        """Levels of samples of a period, s, that were never interrupted, as `noise_of`, which refuses too few."""
        count = int(self._levels[0].counts[0]) + 1 if self._levels else 0
        factors, table = _settled(count, period), self.table()
        return _levels(factors, table.deviation[np.isin(table.factors, factors)], count, period)


class _Level:
    """Sums over spans of one length: squares of their second differences, and the sums of pairs for the next level."""

    def __init__(self, channels: int, factors: list[int]) -> None:
        self.factors = factors
        self.squares: Array = np.zeros((len(factors), channels))
        self.counts = np.zeros(len(factors), np.int64)
        self._nothing: NDArray[Any] = np.zeros((0, channels), np.int64)
        self._before = self._odd = self._nothing

    def interrupt(self) -> None:
        """Forget what the next sums would be compared with."""
        self._before = self._odd = self._nothing

    def add(self, sums: NDArray[Any]) -> NDArray[Any]:
        """Take the next sums, (n, k); returns sums of pairs."""
        old, every = len(self._before), np.concatenate([self._before, sums])
        total = np.concatenate([np.zeros_like(every[:1]), np.cumsum(every, axis=0)])
        for i, m in enumerate(self.factors):
            # only differences that end with a sum that is new
            part = total[max(old + 1 - 2 * m, 0) :]
            if len(part) > 2 * m:
                second = (part[2 * m :] - 2 * part[m:-m] + part[: -2 * m]).astype(float)
                self.squares[i] += np.einsum("ij,ij->j", second, second)
                self.counts[i] += len(second)
        self._before = every[-(2 * max(self.factors) - 1) :]
        pairs = np.concatenate([self._odd, sums])
        even = len(pairs) - len(pairs) % 2
        self._odd = pairs[even:]
        return np.asarray(pairs[:even:2] + pairs[1:even:2])


def _settled(count: int, period: float) -> NDArray[np.int_]:
    """Averaging factors that noise is read from, of so many samples."""
    first = int(2 ** np.ceil(np.log2(max(SETTLED / period, 1.0)) - 1e-9))
    factors = octaves(first, count // 4)
    if factors.size < MIN_TAUS:
        needed = 4 * first * 2 ** (MIN_TAUS - 1)
        raise InputError(f"`x` has {count} samples: noise takes {needed} ({needed * period:.3g} s) at this period")
    return factors


def _levels(factors: NDArray[np.int_], adev: Array, count: int, period: float) -> NoiseLevels:
    dof = degrees_of_freedom(count, factors)
    tau = np.asarray(factors * period, float)
    levels = np.array([_fit(tau, column**2, dof) for column in adev.T])
    return NoiseLevels(*levels.T)


def _fit(tau: Array, avar: Array, dof: Array) -> tuple[float, float, float, float]:
    """N, its standard deviation, B and K of one channel."""
    # a stuck channel leaves the rounding of its mean, if that
    if not np.all(avar > 0.0):
        return 0.0, 0.0, 0.0, 0.0
    # here, since only who asks for a log's own noise should wait for it
    from scipy import optimize

    # c/τ² with both signs, because the solver knows no negative numbers
    terms = np.stack([1.0 / tau, np.ones_like(tau), tau / 3.0, tau**-2, -(tau**-2)], axis=1)
    model = avar
    for _ in range(_ROUNDS):
        # weights from the model, not the estimate: an estimate that came out small must not count for more
        sd = model * np.sqrt(2.0 / dof)
        A = terms / sd[:, None]
        size = np.sqrt(np.sum(A**2, axis=0))
        scaled, _ = optimize.nnls(A / size, avar / sd)
        model = np.maximum(terms @ (scaled / size), 1e-3 * avar)
    N2, B2, K2 = (scaled / size)[:3]
    # variance of N² among the terms in use, c once; the estimates' own correlation included
    used = scaled > 0.0
    used[4] &= not used[3]
    solve = np.linalg.lstsq(A[:, used], np.eye(tau.size), rcond=None)[0]
    covariance = solve @ _correlation(tau.size) @ solve.T
    variance = float(covariance[0, 0]) if used[0] else 0.0
    N = float(np.sqrt(N2))
    N_sd = 0.5 * np.sqrt(variance) / N if N > 0.0 else 0.0
    return N, float(N_sd), float(np.sqrt(B2)), float(np.sqrt(K2))


def _correlation(size: int) -> Array:
    """Correlation of overlapping Allan variances an octave apart, white noise; shape (size, size).

    Estimates are mean squares of moving differences: their covariance is twice the sum of squared cross-covariances.
    """
    m = _CORRELATION_SCALE
    fine = np.repeat([-1.0, 1.0], m)
    out = []
    for j in range(6):
        coarse = np.repeat([-1.0, 1.0], m * 2**j)
        own = [np.sum(np.correlate(f, f, "full") ** 2) for f in (fine, coarse)]
        out.append(np.sum(np.correlate(coarse, fine, "full") ** 2) / np.sqrt(own[0] * own[1]))
    by_lag = np.zeros(max(size, len(out)))
    by_lag[: len(out)] = out
    lag = np.abs(np.subtract.outer(np.arange(size), np.arange(size)))
    return np.asarray(by_lag[lag])
