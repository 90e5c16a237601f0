"""Allan deviation, spectrum and histogram of every channel over all packets, for viewers that ask.

Memory is bounded and a packet costs a few microseconds: packets are worked out by the block. Counts and instrument axes
as they came, without the filter. What a bump means is left to whoever looks.
"""

import math

import numpy as np
import numpy.typing as npt

from filters.allan import RunningAllan
from filters.imu import CHANNELS, STANDARD_GRAVITY
from filters.specification import IMU400CD_200, ImuSpec
from imutui.instrument.counts import DataPacket, Scaling
from imutui.session.running_spectrum import RunningSpectrum
from imutui.session.snapshot import AllanSnapshot, HistogramSnapshot, SpectrumSnapshot, StatisticsSnapshot

NAMES = (*CHANNELS, "T")
UNITS = ("deg/s", "deg/s", "deg/s", "mg", "mg", "mg", "degC")
MOST_BINS = 64
_BLOCK = 256
_WORDS, _ZERO = 1 << 16, 1 << 15
_WIDEST_SD = 5.0
_DIGITS = 6

Integers = npt.NDArray[np.int64]


class ChannelStatistics:
    """Statistics of seven channels since they were begun.

    `scaling`: ranges of the unit.
    `spec`: what its noise is compared with.
    """

    def __init__(self, scaling: Scaling, spec: ImuSpec = IMU400CD_200) -> None:
        self._spec = spec
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

    def interrupt(self) -> None:
        """Take note of a gap: the next packet does not follow the one before."""
        self._work_out()
        self._allan.interrupt()
        self._spectrum.interrupt()
        self._last = None

    def add(self, t: float, packet: DataPacket) -> None:
        """Take a packet, and the seconds since start at which it was sampled."""
        if self._last is None:
            self._stretches += 1
        else:
            self._seconds += t - self._last
            self._steps += 1
        self._last = t
        self._block[self._filled] = *packet.rates, *packet.accels, packet.temperature
        self._filled += 1
        self._packets += 1
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
        """All that is known of a channel.

        `channel`: its place in `NAMES`.
        `t`: now, s since the start.
        Raises ValueError if there is no such channel.
        """
        if not 0 <= channel < len(NAMES):
            raise ValueError(f"`channel` is {channel}; they are numbered from 0 to {len(NAMES) - 1}")
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
