"""Numbers of every channel for viewers: of the last packets, and Allan deviation, spectrum, histogram over all of them.

Memory is bounded and a packet costs a few microseconds: packets are worked out by the block. Counts and instrument axes
as they came, without the filter.

The spectrum is Welch's, in bounded memory: segments of several lengths at once, each with a Hann window and half
overlapped, so that it is there after seconds and becomes finer as the stream grows.

References
----------
P. D. Welch, "The use of fast Fourier transform for the estimation of power spectra", IEEE Trans. Audio Electroacoust.
15 (1967) 70-73; variance of the average for half overlap, ibid.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

# at the beginning: what is loaded while packets come makes stamps of polled ones late
from numpy import fft

from filters.allan import RunningAllan
from filters.errors import InputError
from filters.imu import CHANNELS, STANDARD_GRAVITY
from filters.specification import IMU400CD_200, ImuSpec
from imutui.instrument.counts import Scaling
from imutui.session.reconnection import LineReturned
from imutui.session.snapshot import (
    AllanSnapshot,
    ChannelSnapshot,
    HistogramSnapshot,
    SeriesSnapshot,
    SpectrumSnapshot,
    StatisticsSnapshot,
)
from imutui.session.stream import Block, Broke, Event, Said, Why

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
    """Takes samples block by block; no segment reaches across an interruption."""

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


NAMES = (*CHANNELS, "T")
UNITS = ("deg/s", "deg/s", "deg/s", "mg", "mg", "mg", "degC")
STATISTICS_S = 10.0
_SERIES_S = 30.0
_CAPACITY = 8192
_MAX_ROWS = 4000


class RecentPackets:
    """Keeps the last minute of packets, with the time of each since `started_ns`, monotonic.

    Statistics over a gap or an unanswered poll are those of one unit. They begin anew once it was zeroed or away.
    """

    def __init__(self, scaling: Scaling, started_ns: int = 0) -> None:
        self._scaling = scaling
        self._started_ns = started_ns
        self._t = np.zeros(_CAPACITY)
        self._counts = np.zeros((_CAPACITY, 7), int)
        self.count = 0
        self._interrupted_at = 0
        self._interrupted = False

    def take(self, event: Event, /) -> Iterable[Said]:
        """Take an event of the stream."""
        match event:
            case Block():
                self.add((event.rows["stamp_ns"] - self._started_ns) / 1e9, event.rows["counts"])
            case Broke(Why.ZEROED) | LineReturned():
                self._interrupted = True
        return ()

    def _recent(self) -> np.ndarray:
        """Return the places of the last 10 s of packets, as far as they belong together."""
        slots = self._last(self.count - self._interrupted_at)
        return slots[self._t[slots] >= self._t[slots[-1]] - STATISTICS_S] if slots.size else slots

    def add(self, t: np.ndarray, counts: np.ndarray) -> None:
        """Add packets: seconds since the start at which each was sampled, (N,), and its readings, (N, 7)."""
        if self._interrupted:
            self._interrupted_at, self._interrupted = self.count, False
        slots = np.arange(self.count, self.count + t.size)[-_CAPACITY:] % _CAPACITY
        self._t[slots], self._counts[slots] = t[-_CAPACITY:], counts[-_CAPACITY:]
        self.count += t.size

    def _last(self, n: int) -> np.ndarray:
        return np.arange(self.count - min(n, self.count, _CAPACITY), self.count) % _CAPACITY

    def _values(self, slots: np.ndarray) -> np.ndarray:
        counts, values = self._counts[slots], np.empty((slots.size, 7))
        values[:, :3] = self._scaling.rates_dps(counts[:, :3])
        values[:, 3:6] = self._scaling.accels_g(counts[:, 3:6]) * 1e3
        values[:, 6] = self._scaling.temperature_degc(counts[:, 6])
        return values

    def channels(self) -> list[ChannelSnapshot]:
        """Return newest counts and value of each channel, and mean, sd, least and largest over the last 10 s."""
        recent = self._values(self._recent())
        if not len(recent):
            return []
        mean = recent.mean(axis=0)
        sd = recent.std(axis=0, ddof=1) if len(recent) > 1 else np.full(7, np.nan)
        low, high, newest = recent.min(axis=0), recent.max(axis=0), self._counts[(self.count - 1) % _CAPACITY]
        return [
            {
                "name": name,
                "counts": int(newest[i]),
                "value": float(recent[-1, i]),
                "unit": unit,
                "mean": float(mean[i]),
                "sd": float(sd[i]) if np.isfinite(sd[i]) else None,
                "min": float(low[i]),
                "max": float(high[i]),
            }
            for i, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True))
        ]

    def mean(self) -> np.ndarray | None:
        """Return the mean of each channel over the last 10 s, in `UNITS`, shape (7,); None without packets."""
        recent = self._values(self._recent())
        return np.asarray(recent.mean(axis=0)) if len(recent) else None

    def rate_hz(self) -> float | None:
        """Return packets a second over the last 10 s."""
        t = self._t[self._recent()]
        return float((t.size - 1) / (t[-1] - t[0])) if t.size > 2 else None

    def series(self, since: int) -> SeriesSnapshot:
        """Return packets from number `since` on, at most the last 30 s."""
        slots = self._last(min(self.count - max(since, 0), _MAX_ROWS))
        if slots.size:
            slots = slots[self._t[slots] >= self._t[slots[-1]] - _SERIES_S]
        rows = np.round(self._values(slots), 5)
        return {"next": self.count, "t": np.round(self._t[slots], 4).tolist(), "values": rows.tolist()}


MOST_BINS = 64
_BLOCK = 256
_WORDS, _ZERO = 1 << 16, 1 << 15
_WIDEST_SD = 5.0
_DIGITS = 6


class ChannelStatistics:
    """Statistics of seven channels since they were begun; their noise is compared with `spec`.

    `started_ns`: when the acquisition started, monotonic, from which times are counted.
    """

    def __init__(self, scaling: Scaling, spec: ImuSpec = IMU400CD_200, started_ns: int = 0) -> None:
        self._spec = spec
        self._started_ns = started_ns
        rate, accel = float(scaling.rates_dps(1)), float(scaling.accels_g(1)) * 1e3
        zero = float(scaling.temperature_degc(0))
        self._scale = (*(rate,) * 3, *(accel,) * 3, float(scaling.temperature_degc(1)) - zero)
        self._offset = (*(0.0,) * 6, zero)
        self.begin(0.0)

    def begin(self, t: float) -> None:
        """Begin anew with the next packet, `t` s since the start: what came before counts no more."""
        self._began = t
        self._allan, self._spectrum = RunningAllan(len(NAMES)), RunningSpectrum(len(NAMES))
        self._histogram = np.zeros((len(NAMES), _WORDS), np.uint32)
        self._block: Integers = np.zeros((_BLOCK, len(NAMES)), np.int64)
        self._filled = self._packets = self._steps = self._stretches = 0
        self._seconds = 0.0
        self._last: float | None = None

    def take(self, event: Event, /) -> Iterable[Said]:
        """Take an event of the stream: no statistics reach over a break of any kind."""
        match event:
            case Block():
                if event.gap is not None:
                    self.interrupt()
                self.add((event.rows["stamp_ns"] - self._started_ns) / 1e9, event.rows["counts"])
            case Broke() | LineReturned():
                self.interrupt()
        return ()

    def interrupt(self) -> None:
        """Take the next packet as one that does not follow the one before."""
        self._work_out()
        self._allan.interrupt()
        self._spectrum.interrupt()
        self._last = None

    def add(self, t: Floats, counts: Integers) -> None:
        """Add packets: seconds since the start at which each was sampled, (N,), and its readings, (N, 7)."""
        if self._last is None:
            self._stretches += 1
            self._last = float(t[0])
            self._steps -= 1
        self._seconds += float(t[-1]) - self._last
        self._steps += t.size
        self._last = float(t[-1])
        self._packets += t.size
        while len(counts):
            room = _BLOCK - self._filled
            taken, counts = counts[:room], counts[room:]
            self._block[self._filled : self._filled + len(taken)] = taken
            self._filled += len(taken)
            if self._filled == _BLOCK:
                self._work_out()

    def _work_out(self) -> None:
        samples = self._block[: self._filled].copy()
        self._filled = 0
        if not len(samples):
            return
        self._allan.add(samples)
        self._spectrum.add(samples)
        words = np.clip(samples + _ZERO, 0, _WORDS - 1)
        np.add.at(self._histogram, (np.arange(len(NAMES))[None, :], words), 1)

    def snapshot(self, channel: int, t: float) -> StatisticsSnapshot:
        """All that is known of a channel, by its place in `NAMES`; `t` is now, s since the start.

        Raises InputError if there is no such channel.
        """
        if not 0 <= channel < len(NAMES):
            raise InputError(f"`channel` is {channel}; they are numbered from 0 to {len(NAMES) - 1}")
        self._work_out()
        period = self._seconds / self._steps if self._steps and self._seconds > 0.0 else None
        white, bandwidth = _promised(self._spec, channel)
        return {
            "channel": channel,
            "unit": UNITS[channel],
            "seconds": max(t - self._began, 0.0),
            "packets": self._packets,
            "stretches": self._stretches,
            "period_s": period,
            "white": white,
            "white_of": self._spec.source,
            "bandwidth_hz": bandwidth,
            "allan": None if period is None else self._allan_of(channel, period),
            "spectrum": None if period is None else self._spectrum_of(channel, period),
            "histogram": self._histogram_of(channel) if self._packets else None,
        }

    def _allan_of(self, channel: int, period: float) -> AllanSnapshot | None:
        table = self._allan.table()
        if not table.factors.size:
            return None
        return {
            "tau": _rounded(table.factors * period),
            "deviation": _rounded(table.deviation[:, channel] * self._scale[channel]),
            "dof": _rounded(table.dof),
        }

    def _spectrum_of(self, channel: int, period: float) -> SpectrumSnapshot | None:
        found = self._spectrum.spectrum()
        if found is None:
            return None
        scale = self._scale[channel] * math.sqrt(period)
        return {
            "hz": _rounded(found.frequency / period),
            "density": _rounded(scale * np.sqrt(found.power[:, channel])),
            "peak": _rounded(scale * np.sqrt(found.peak[:, channel])),
            "peak_hz": _rounded(found.peak_at[:, channel] / period),
            "averages": _rounded(found.averages),
            "segments": found.segments,
            "resolution_hz": found.resolution / period,
        }

    def _histogram_of(self, channel: int) -> HistogramSnapshot:
        """Bins of whole counts, so that none has more of them than the others."""
        counts, scale, offset = self._histogram[channel].astype(np.int64), self._scale[channel], self._offset[channel]
        filled = np.flatnonzero(counts)
        number = int(counts.sum())
        mean = float(filled @ counts[filled]) / number
        sd = math.sqrt(float((filled - mean) ** 2 @ counts[filled]) / max(number - 1, 1))
        first = max(int(filled[0]), math.floor(mean - _WIDEST_SD * sd))
        last = min(int(filled[-1]), math.ceil(mean + _WIDEST_SD * sd))
        width = -(-(last - first + 1) // MOST_BINS)
        starts = np.arange(first, last + 1, width)
        end = int(starts[-1]) + width
        bins = np.add.reduceat(counts[first:end], starts - first)
        return {
            "counts": bins.tolist(),
            "edge": (first - 0.5 - _ZERO) * scale + offset,
            "width": width * scale,
            "width_counts": width,
            "below": int(counts[:first].sum()),
            "above": int(counts[end:].sum()),
            "mean": (mean - _ZERO) * scale + offset,
            "sd": sd * scale,
        }


def _promised(spec: ImuSpec, channel: int) -> tuple[float | None, float | None]:
    """White noise of the data sheet, unit·√s, and bandwidth, Hz."""
    if channel < 3:
        return math.degrees(spec.gyro_arw), spec.gyro_bandwidth
    if channel < 6:
        return spec.accel_vrw / STANDARD_GRAVITY * 1e3, spec.accel_bandwidth
    return None, None


def _rounded(values: npt.NDArray[np.floating]) -> list[float]:
    """Numbers as short as a reader needs them: a long reply holds up the reader of the port."""
    return [float(f"{value:.{_DIGITS}g}") for value in values.tolist()]
