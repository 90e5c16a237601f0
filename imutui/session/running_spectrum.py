"""Power spectral density of a stream of samples of any length, by Welch's method in bounded memory; pure arithmetic.

Segments of several lengths at once, each with a Hann window and half overlapped: the spectrum is there after seconds
and becomes finer as the stream grows.

References
----------
P. D. Welch, "The use of fast Fourier transform for the estimation of power spectra", IEEE Trans. Audio Electroacoust.
15 (1967) 70-73; variance of the average for half overlap, ibid.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

# at the beginning: what is loaded while packets come makes stamps of polled ones late
from numpy import fft

Integers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

LENGTHS = (64, 256, 1024, 4096, 16384)  # samples of a segment
BANDS = 200
_ENOUGH = 8
_FIRST_BIN = 2  # below it the mean that was taken away is missing
# correlation of the power of bins beside each other, white noise through a Hann window
_NEIGHBOUR, _NEXT = 4.0 / 9.0, 1.0 / 36.0


@dataclass(frozen=True, slots=True)
class Spectrum:
    """One-sided power spectral density of several channels in bands of equal ratio; frequencies in cycles a sample."""

    frequency: Floats  # middle of each band
    power: Floats  # mean density of each band, unit² a cycle a sample
    peak: Floats  # greatest density in each band
    peak_at: Floats  # its frequency
    averages: Floats  # independent estimates in each mean: its relative standard deviation is one over their root
    segments: int  # how many were averaged
    resolution: float  # distance of two bins


class RunningSpectrum:
    """Takes samples block by block; no segment reaches across an interruption.

    `channels`: values of a sample.
    """

    def __init__(self, channels: int) -> None:
        self._sets = [_Segments(length, channels) for length in LENGTHS]

    def add(self, samples: Integers) -> None:
        """Take the next samples, (n, k)."""
        for segments in self._sets:
            segments.add(samples)

    def interrupt(self) -> None:
        """Take note that the next samples do not follow those before."""
        for segments in self._sets:
            segments.interrupt()

    def spectrum(self) -> Spectrum | None:
        """By the longest segments of which there are enough, else by the shortest; None before there is one."""
        enough = [segments for segments in self._sets if segments.count >= _ENOUGH]
        if enough:
            return enough[-1].spectrum()
        return self._sets[0].spectrum() if self._sets[0].count else None


class _Segments:
    """Summed power of segments of one length."""

    def __init__(self, length: int, channels: int) -> None:
        self.count = 0
        self._length = length
        self._power: Floats = np.zeros((length // 2 + 1, channels))
        self._nothing: Integers = np.zeros((0, channels), np.int64)
        self._kept = self._nothing
        self._window = np.hanning(length + 1)[:-1, None]

    def interrupt(self) -> None:
        """Forget what a segment had of it."""
        self._kept = self._nothing

    def add(self, samples: Integers) -> None:
        """Take the next samples."""
        every, begin = np.concatenate([self._kept, samples]), 0
        while len(every) - begin >= self._length:
            segment = every[begin : begin + self._length]
            found = fft.rfft((segment - segment.mean(axis=0)) * self._window, axis=0)
            self._power += found.real**2 + found.imag**2
            self.count += 1
            begin += self._length // 2
        self._kept = every[begin:]

    def spectrum(self) -> Spectrum:
        """Mean power of each band."""
        power = self._power * (2.0 / (self.count * float(np.sum(self._window**2))))
        edges = np.unique(np.geomspace(_FIRST_BIN, self._length // 2, BANDS + 1).round().astype(int))
        first, bins = edges[:-1], np.diff(edges)
        inside = power[_FIRST_BIN : edges[-1]]
        mean = np.add.reduceat(inside, first - _FIRST_BIN, axis=0) / bins[:, None]
        at = np.array([begin + power[begin:end].argmax(axis=0) for begin, end in zip(first, edges[1:], strict=True)])
        return Spectrum(
            frequency=(first + edges[1:] - 1) / (2.0 * self._length),
            power=mean,
            peak=np.take_along_axis(power, at, axis=0),
            peak_at=at / self._length,
            averages=_independent(self.count, bins.astype(float)),
            segments=self.count,
            resolution=1.0 / self._length,
        )


def _independent(segments: int, bins: Floats) -> Floats:
    """Independent estimates in the mean over half-overlapped segments and neighbouring bins."""
    of_segments = 18.0 * segments**2 / (19.0 * segments - 1.0)
    shared = 2.0 * (_NEIGHBOUR * (bins - 1.0) + _NEXT * np.maximum(bins - 2.0, 0.0)) / bins
    return np.asarray(of_segments * bins / (1.0 + shared))
