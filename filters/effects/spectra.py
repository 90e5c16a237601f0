"""Spectra of residuals at the full rate: periodograms of several runs on one grid, and the level they stand on.

A run longer than `SEGMENT` samples is taken in half-overlapping segments. All runs share one spacing of frequencies,
that of the longest segment; shorter runs are padded with zeros.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy import fft, special
from scipy.signal import windows

from filters.types import Array

SEGMENT = 1 << 17  # samples

LOWEST = 1.6  # Hz: what is slower is found among the motions and drifts

LEAST = 64  # samples of a run of which a spectrum says anything

# of spectra of neighbouring segments under Hann's window, half overlapping: correlation 1/36 (Welch 1967)
_OVERLAP = 1.0 / 36.0

_NARROW, _WIDE = 32, 512  # bins of which one level is the median


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Mean density of one channel in one run, and the level it stands on."""

    # one-sided, unit²/Hz, shape (M,), bin k at k times the grid's spacing; up to the run's own Nyquist frequency
    density: Array
    level: Array  # the running median's mean, unit²/Hz, shape (M,)
    averaged: float  # independent segments in the mean


class Samples(Protocol):
    """Samples of six channels, an array of shape (N, 6) or what gives parts of one."""

    @property
    def shape(self) -> tuple[int, ...]:
        """(N, 6)."""
        ...

    def __getitem__(self, key: Any, /) -> Any: ...


def usable(series: Sequence[tuple[float, Samples]]) -> list[tuple[float, Samples]]:
    """Runs long enough for a spectrum."""
    return [(fs, x) for fs, x in series if x.shape[0] >= LEAST]


def spacing(series: Sequence[tuple[float, Samples]]) -> float:
    """Hz between frequencies of the grid: of a segment at the highest rate, or of the longest run, if shorter."""
    lasting = max(x.shape[0] / fs for fs, x in series)
    fastest = max(fs for fs, _ in series)
    length = min(lasting, SEGMENT / fastest)
    return float(fastest / fft.next_fast_len(int(np.ceil(length * fastest)), real=True))


def segments(x: Array, fs: float, hz: float) -> Iterator[Array]:
    """Stretches of one channel, half overlapping, of the duration 1 / `hz`, or all of a shorter run; gaps are 0.

    `x`: residual, shape (N,), NaN where there is none.
    Yields without mean, shape (n,).
    """
    length = min(x.shape[0], round(fs / hz))
    for first in range(0, x.shape[0] - length + 1, max(1, length // 2)):
        part = x[first : first + length]
        good = ~np.isnan(part)
        if 2 * np.count_nonzero(good) > length:
            yield np.where(good, part - np.mean(part[good]), 0.0)


def spectrum(x: Array, fs: float, hz: float) -> Spectrum | None:
    """Mean of Hann periodograms, and their running median.

    P(f) = 2 ∣Σ w x exp(-2πi f t)∣² / (fs Σ w²), sums over the samples that there are.

    `x`: residual of one channel in one run, shape (N,), NaN where there is none.
    Returns none without a stretch that has more than half of its samples, or without variance.
    """
    mean, count = _mean_periodogram(x, fs, hz)
    if mean is None:
        return None
    averaged = count / (1.0 + 2.0 * _OVERLAP * (count - 1) / count)
    return Spectrum(mean, level(mean, averaged, round(LOWEST / hz)), averaged)


def density(x: Array, fs: float, hz: float) -> Array | None:
    """The same without the level, shape (M,); None without a stretch, or without variance."""
    return _mean_periodogram(x, fs, hz)[0]


def _mean_periodogram(x: Array, fs: float, hz: float) -> tuple[Array | None, int]:
    """Mean of Hann periodograms, and of how many."""
    count, total = 0, np.zeros(1)
    size = max(2, round(fs / hz))
    for part in segments(x, fs, hz):
        window = windows.hann(part.size, sym=False)
        power = 2.0 / (fs * np.sum(window[part != 0.0] ** 2)) if np.any(part) else 0.0
        total = total + power * np.abs(fft.rfft(window * part, size)) ** 2
        count += 1
    return (total / count, count) if count and np.any(total) else (None, 0)


def level(density: Array, averaged: float, first: int) -> Array:
    """What a density stands on: medians of stretches of bins, joined by straight lines of the logarithm.

    `density`: shape (M,).
    `averaged`: independent periodograms in it: median over mean is that of a gamma distribution of this shape.
    `first`: bin that counts from; below it the level is the first stretch's.
    Returns shape (M,).
    """
    centres, medians = bands(density, averaged, first)
    if not centres.size:
        return np.full(density.shape, np.nan)
    return np.asarray(np.exp(np.interp(np.arange(density.size), centres, np.log(medians))))


def bands(density: Array, averaged: float, first: int) -> tuple[Array, Array]:
    """Centres (bins) and levels of stretches of bins, from bin `first` to the last but one; shape (B,) each."""
    inner = density[first:-1]
    width = stretch(inner.size)
    count = inner.size // width
    if count < 1:
        return np.zeros(0), np.zeros(0)
    rows = inner[: count * width].reshape(count, width)
    medians = np.median(rows, axis=1) / (special.gammaincinv(averaged, 0.5) / averaged)
    centres = first + width * (np.arange(count) + 0.5)
    return np.asarray(centres, float), np.asarray(np.maximum(medians, np.finfo(float).tiny))


def stretch(bins: int) -> int:
    """Bins of a stretch that one level is the median of."""
    return int(np.clip(bins // 16, _NARROW, _WIDE))
