"""Fast noise: its band limit (27), its correlation between channels (28), and whether what remains is white.

Band limit and correlation are looked at above the frequencies of motions and drifts. Lines are to be removed first;
what is left of one does little harm, for levels are medians. `variance_ratio` is for the whitened blocks, after
everything known is taken out. Leaves out how large noise is, and what drives its size.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft, special
from scipy.signal import windows

from filters.channels import CHANNELS
from filters.effects import spectra
from filters.effects.spectra import Samples
from filters.types import Array

SLOWEST = 1.0 / 20.0  # of the sampling rate: what is slower may be drift (and below 1.6 Hz motion)

SIGNIFICANT = 30.0  # drop of χ² from the specification's band limit, or from white noise, to the estimate

RATIO = 1.3
"""Times by which the ratio of densities, low to high, differs from the expected one. Means of 6 or 7 readings of the
specification's gyro, 20 Hz made of 133, differ from white noise by 1.22."""

CORRELATED = 5.5  # standard deviations of a correlation

_HIGHEST = 10.0  # times the sampling rate: no limit that shows
_GRID = 1000
_UNSEEN = 4.0  # drop of χ² from white noise that is none
_CLIPPED = 12.0  # times the level: what is left of a line, chance of noise 6e-6
_TAPER = 0.1
_LEAST_SKEWNESS = 1e-3


@dataclass(frozen=True, slots=True)
class BandLimit:
    """Noise whose colour is not the expected one."""

    channel: str
    hz: float  # -3 dB frequency of the first-order limit that fits best; inf for white noise
    sd_hz: float  # its standard deviation; inf where `hz` is
    spec_hz: float  # what was expected; inf for white noise
    ratio: float  # density at low frequencies over that at half the (first run's) sampling rate, ((1 + p) / (1 - p))²
    score: float  # drop of χ² from what was expected


@dataclass(frozen=True, slots=True)
class Crosstalk:
    """Two channels whose fast noise is correlated."""

    channels: tuple[str, str]  # two
    correlation: float  # ρ of the noise, made white in each channel
    sd: float  # of ρ, were there none
    z: float  # fisher's, in standard deviations


# ------------------------------------------------------------------------------------------------------- band limit


def bandwidth(series: Sequence[tuple[float, Samples]], spec_hz: Array | None) -> list[BandLimit]:
    """Channels whose noise has another band limit than the specification's, or, without one, any.

    ln P(f) = ln A_run + ln ∣H(f)∣², ∣H∣² = (1 - p)² / (1 - 2 p cos(2π f / fs) + p²), p = exp(-2π hz / fs), is fitted to
    levels of stretches of the spectra by weighted least squares. The filter has gain 1 at zero frequency.

    `series`: of each run: samples a second; residual, rad/s and m/s², shape (N, 6), NaN where flagged.
    `spec_hz`: -3 dB frequencies expected, shape (6,); 0 or inf for white noise, NaN for a channel that is not to be
      looked at.
    Returns only where χ² drops by more than `SIGNIFICANT` and densities' ratio is `RATIO` times another.
    """
    runs = spectra.usable(series)
    expected = np.full(len(CHANNELS), np.inf) if spec_hz is None else np.where(spec_hz == 0.0, np.inf, spec_hz)
    found = []
    for c in range(len(CHANNELS) if runs else 0):
        points = _points(runs, c)
        if len(points) and not np.isnan(expected[c]):
            limit = _fitted(points, float(expected[c]), runs[0][0], CHANNELS[c])
            if limit is not None:
                found.append(limit)
    return found


@dataclass(frozen=True, slots=True)
class _Points:
    """Levels of one run's spectrum: cycles a sample, logarithm, variance of that; (B,) each."""

    fs: float
    cycles: Array
    log: Array
    variance: Array


def _points(runs: list[tuple[float, Samples]], c: int) -> list[_Points]:
    hz = spectra.spacing(runs)
    points = []
    for fs, x in runs:
        s = spectra.spectrum(np.ascontiguousarray(x[:, c]), fs, hz)
        if s is None:
            continue
        first = round(max(spectra.LOWEST, SLOWEST * fs) / hz)
        centres, levels = spectra.bands(s.density, s.averaged, first)
        if centres.size >= 4:
            # of a median of n exponential variables: 1 / (n ln² 2). Bins under Hann are worth 1 / 1.94, padded ones 0
            width = spectra.stretch(s.density[first:-1].size) * min(1.0, x.shape[0] * hz / fs)
            variance = np.full(centres.size, 1.94 / (width * s.averaged * np.log(2.0) ** 2))
            points.append(_Points(fs, centres * hz / fs, np.log(levels), variance))
    return points


def _fitted(points: list[_Points], expected: float, fs: float, name: str) -> BandLimit | None:
    grid = np.append(np.geomspace(0.02 * fs, _HIGHEST * fs, _GRID), np.inf)
    chi2 = np.sum([_misfit(p, grid) for p in points], axis=0)
    best = int(np.argmin(chi2))
    if chi2[-1] < chi2[best] + _UNSEEN:
        best = _GRID
    freedom = max(1, sum(p.log.size - 1 for p in points) - 1)
    # what no first-order limit explains makes all of it less certain
    scale = max(1.0, chi2[best] / freedom)
    score = (float(np.sum([_misfit(p, np.array([expected])) for p in points])) - chi2[best]) / scale
    hz, ratio = float(grid[best]), _ratio(float(grid[best]), fs)
    times = ratio / _ratio(expected, fs)
    if score < SIGNIFICANT or max(times, 1.0 / times) < RATIO:
        return None
    return BandLimit(
        channel=name, hz=hz, sd_hz=_sd(grid, chi2 / scale, best), spec_hz=expected, ratio=ratio, score=float(score)
    )


def _ratio(hz: float, fs: float) -> float:
    p = float(np.exp(-2.0 * np.pi * hz / fs))
    return ((1.0 + p) / (1.0 - p)) ** 2


def _misfit(points: _Points, hz: Array) -> Array:
    """χ² of one run with its own density, for each of some limits, shape (G,)."""
    p = np.exp(-2.0 * np.pi * hz[:, None] / points.fs)
    gain = (1.0 - p) ** 2 / (1.0 - 2.0 * p * np.cos(2.0 * np.pi * points.cycles) + p**2)
    rest = points.log - np.log(gain)
    weight = 1.0 / points.variance
    rest -= (rest @ weight / np.sum(weight))[:, None]
    return np.asarray(rest**2 @ weight)


def _sd(grid: Array, chi2: Array, best: int) -> float:
    """Where χ² is one above its least, half the way from side to side; inf at an end of the grid."""
    if not 0 < best < _GRID - 1:
        return float("inf")
    inside = grid[:_GRID][chi2[:_GRID] < chi2[best] + 1.0]
    step = 0.5 * (grid[best + 1] - grid[best - 1])
    return float(max(0.5 * (inside[-1] - inside[0]), 0.5 * step))


# -------------------------------------------------------------------------------------------------------- crosstalk


def crosstalk(series: Sequence[tuple[float, Samples]]) -> list[Crosstalk]:
    """Pairs of channels with correlated noise.

    ρ = Re Σ X_a X_b* / √(Σ ∣X_a∣² Σ ∣X_b∣²) over M frequencies above drifts, X the Fourier transform over the root of
    its level: the correlation of high-passed noise made white. z = artanh(ρ) √(2M).

    `series`: as for `bandwidth`.
    Returns where ∣z∣ > 5.5, largest first.
    """
    product, count = np.zeros((len(CHANNELS), len(CHANNELS))), 0.0
    for fs, x in spectra.usable(series):
        for first in range(0, x.shape[0] - spectra.LEAST + 1, spectra.SEGMENT):
            more, bins = _products(x[first : first + spectra.SEGMENT], fs)
            product, count = product + more, count + bins
    power = np.sqrt(np.diag(product))
    found = []
    for a in range(len(CHANNELS)):
        for b in range(a + 1, len(CHANNELS)):
            if count > 1.0 and power[a] > 0.0 and power[b] > 0.0:
                rho = float(np.clip(product[a, b] / (power[a] * power[b]), -1.0 + 1e-12, 1.0 - 1e-12))
                sd = float(1.0 / np.sqrt(2.0 * count))
                found.append(Crosstalk((CHANNELS[a], CHANNELS[b]), rho, sd, float(np.arctanh(rho)) / sd))
    return sorted((f for f in found if abs(f.z) > CORRELATED), key=lambda f: -abs(f.z))


def _products(part: Array, fs: float) -> tuple[Array, float]:
    """Re Σ X_a X_b* of a stretch, shape (6, 6), and how many independent frequencies are in it."""
    good = ~np.isnan(part)
    mean = np.sum(np.where(good, part, 0.0), axis=0) / np.maximum(1, good.sum(axis=0))
    size = fft.next_fast_len(part.shape[0], real=True)
    window = windows.tukey(part.shape[0], _TAPER)
    X = fft.rfft(np.where(good, part - mean, 0.0) * window[:, None], size, axis=0)
    first = round(max(spectra.LOWEST, SLOWEST * fs) * size / fs)
    white = np.stack([_whitened(X[:, c], first) for c in range(X.shape[1])], axis=1)
    # Σw² squared over N Σw⁴: what the taper costs
    worth = np.sum(window**2) ** 2 / np.sum(window**4)
    return (white.T @ white.conj()).real, max(0.0, size / 2 - first - 1) * float(worth) / size


def _whitened(X: NDArray[np.complex128], first: int) -> NDArray[np.complex128]:
    """A transform above a bin over the root of its level, lines clipped; zeros for a channel without noise."""
    density = np.abs(X) ** 2
    level = spectra.level(density, 1.0, first)[first:-1]
    if not np.all(level > 1e-200):
        return np.zeros(max(0, X.size - 1 - first), np.complex128)
    over = density[first:-1] / level
    return np.asarray(X[first:-1] * np.where(over > _CLIPPED, 0.0, 1.0 / np.sqrt(level)), np.complex128)


# -------------------------------------------------------------------------------------------------------- remainder


def variance_ratio(whitened: Array, scales: Sequence[int]) -> list[tuple[int, float, float]]:
    """Variance of sums over m values against m times that of one, for white noise 1.

    VR(m) = Σ (x_k + … + x_{k+m-1})² / (m (n - m + 1) s²), s² the mean square. For white noise it is a sum of χ² of one
    degree of freedom, VR - 1 ≈ Σ_k (λ_k - 1) χ² / n, λ_k = sin²(π m k/n) / (m sin²(π k/n)). Its variance makes the
    effective degrees of freedom of the lower tail; the upper has a shifted χ² of the same skewness too, for the few
    largest λ make it heavier.

    `whitened`: mean 0, shape (n,); NaN, where there is none, is left out.
    `scales`: m; those above a quarter of the values are left out.
    Returns m, ratio, two-sided probability.
    Raises ValueError if a scale is below 1.

    References
    ----------
    A. W. Lo, A. C. MacKinlay, "Stock market prices do not follow random walks", Review of Financial Studies 1, 1988.
    """
    if any(m < 1 for m in scales):
        raise ValueError(f"`scales` is {list(scales)}, with one below 1")
    x = whitened[~np.isnan(whitened)]
    total = np.concatenate([[0.0], np.cumsum(x)])
    square = float(np.mean(x**2)) if x.size else 0.0
    return [_ratio_at(total, square, m) for m in scales if 4 * m <= x.size and square > 0.0]


def _ratio_at(total: Array, square: float, m: int) -> tuple[int, float, float]:
    n = total.size - 1
    if m == 1:
        return 1, 1.0, 1.0
    ratio = float(np.mean((total[m:] - total[:-m]) ** 2)) / (m * square)
    sd, skewness = _of_white(n, m)
    if ratio > 1.0:
        # of two values there is none but by rounding: then as good as normal
        freedom = 8.0 / max(skewness, _LEAST_SKEWNESS) ** 2
        one_sided = special.chdtrc(freedom, freedom + (ratio - 1.0) / sd * np.sqrt(2.0 * freedom))
    else:
        freedom = 2.0 / sd**2
        one_sided = special.chdtr(freedom, freedom * ratio)
    return m, ratio, float(min(1.0, 2.0 * one_sided))


@lru_cache(maxsize=64)
def _of_white(n: int, m: int) -> tuple[float, float]:
    """Standard deviation and skewness of VR(m) for n values of white noise."""
    angle = np.pi * np.arange(1, n) / n
    gain = np.append(np.sin(m * angle) ** 2 / (m * np.sin(angle) ** 2), m) - 1.0
    # values at the ends are in fewer sums
    worth = (n - m + 1) / n
    second, third = np.sum(gain**2) / worth, np.sum(gain**3) / worth**2
    return float(np.sqrt(2.0 * second) / n), float(8.0 * third / (2.0 * second) ** 1.5)
