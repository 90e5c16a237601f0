"""Lines: narrow peaks above 1.6 Hz in the spectra of the residuals, such as a motor's or a fan's, over several runs.

Slower tones are found among the motions and drifts. `find` says what lines there are, `removed` takes them out of one
run before it is averaged to blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, special

from filters.channels import CHANNELS
from filters.effects import spectra, wandering
from filters.effects.spectra import Samples, Spectrum
from filters.types import Array

PROBABILITY = 1e-3  # of one line or more that is not there, in all runs and channels together

MOST = 6  # lines of a channel

NARROW = 0.01  # of the frequency: what is nearer together is one band

_FALSE_LEVEL = 1.06  # the level's own error: 6 % from 512 bins
_LOBE = 2.5  # bins from a peak to where its main lobe under Hann's window ends
_WIDTHS = (1, 9, 65)  # bins
_LEAST_BUMP = 1.5  # times the level: a spectrum that is not flat is no line
_SIDE_LEVEL = 0.1  # of the level: side lobes below do not count
_SIDE = 4.0  # times the side lobes of a lone line
_MOST_HARMONIC = 20
_LONG = spectra.SEGMENT


@dataclass(frozen=True, slots=True)
class SpectralLine:
    """A line, or several that belong together."""

    channels: tuple[str, ...]  # of gx, gy, gz, ax, ay, az: where it was found
    hz: float  # its frequency, the centre of a narrow band, or the lowest of a periodic waveform
    # of a narrow band, or what a line that wanders goes through; 0 of one that is no wider than its runs are short
    width_hz: float
    rms: Array  # in each channel, of all harmonics, rad/s and m/s², shape (6,); 0 where it was not found
    harmonics: tuple[int, ...] = (1,)  # multiples of `hz` that were found, 1 first
    wanders: bool = False  # whether it is one line whose frequency moves through the band, to be followed in each run


@dataclass(frozen=True, slots=True)
class _Peak:
    """A peak of one channel's summed spectrum."""

    channel: int
    hz: float
    excess: float  # over the level
    low: float
    high: float  # of the bins above the threshold that belong to it


def find(series: Sequence[tuple[float, Samples]], barred: NDArray[np.bool_] | None = None) -> list[SpectralLine]:
    """Lines above 1.6 Hz.

    Σ over runs of 2 K P / level, P the mean of K Hann periodograms, is χ² of 2 Σ K degrees of freedom where there is
    only noise; the threshold has probability 1e-3 over all bins and channels.

    `series`: of each run: samples a second, (N - 1) / (t_end - t_0); residual, rad/s and m/s², shape (N, 6), NaN where
      flagged.
    `barred`: where no line is sought, shape (6, M): bin k at k times `spectra.spacing` of the runs.
    Returns strongest first, at most `MOST` a channel before harmonics are put together.
    """
    runs = spectra.usable(series)
    if not runs:
        return []
    hz = spectra.spacing(runs)
    wanderers = _wanderers(runs, barred, hz)
    if wanderers:
        short = wandering.MOST_SAMPLES
        runs = [(fs, removed(wanderers, fs, _whole(x)) if x.shape[0] <= short else x) for fs, x in runs]
    by_channel = [
        [s for fs, x in runs if (s := spectra.spectrum(np.ascontiguousarray(x[:, c]), fs, hz)) is not None]
        for c in range(len(CHANNELS))
    ]
    shortest = min(min(x.shape[0] / fs for fs, x in runs), 1.0 / hz)
    shut = np.zeros((len(CHANNELS), 0), bool) if barred is None else barred
    peaks = [p for c, s in enumerate(by_channel) if s for p in _peaks(c, s, hz, shortest, shut[c])]
    found = [_line(group, by_channel, hz, shortest) for group in _grouped(peaks, hz)]
    return _waveforms([*wanderers, *found], hz)


def removed(line_list: Sequence[SpectralLine], fs: float, residual: Array) -> Array:
    """A run's residual without lines: minus what is fitted at their frequencies in this run.

    A sine of any amplitude and phase for each 2^17 samples; of a narrow band one whose amplitude and phase follow
    within the band's width; of a line that wanders one along its way through this run, which is sought anew.

    `line_list`: from `find`.
    `residual`: shape (N, 6); NaN stays NaN.
    Returns shape (N, 6).
    """
    out = residual.copy()
    for line in (line for line in line_list if line.wanders):
        _follow(out, line, fs)
    for line in (line for line in line_list if not line.wanders):
        for harmonic in line.harmonics:
            hz, width = harmonic * line.hz, harmonic * line.width_hz
            if not 0.0 < hz < 0.5 * fs:
                continue
            for c in [CHANNELS.index(name) for name in line.channels]:
                for first in range(0, out.shape[0], _LONG):
                    part = out[first : first + _LONG, c]
                    part -= _fitted(part, hz / fs, width / fs)
    return out


# -------------------------------------------------------------------------------------------------------- wanderers


def _wanderers(
    runs: Sequence[tuple[float, Samples]], barred: NDArray[np.bool_] | None, hz: float
) -> list[SpectralLine]:
    """Lines whose frequency wanders, of all runs together."""
    out: list[SpectralLine] = []
    for fs, lazy in runs:
        if lazy.shape[0] > wandering.MOST_SAMPLES:
            continue
        x = _whole(lazy)
        for track in wandering.find(fs, x, barred, hz):
            rms = np.zeros(len(CHANNELS))
            for c in track.channels:
                rms[c] = float(np.std(wandering.wave(fs, x[:, c], track)))
            names = tuple(CHANNELS[c] for c in track.channels)
            line = SpectralLine(names, 0.5 * (track.low + track.high), track.high - track.low, rms, wanders=True)
            same = next((k for k, other in enumerate(out) if _overlap(line, other)), None)
            if same is None:
                out.append(line)
            else:
                out[same] = _both(out[same], line)
    return out


def _whole(x: Samples) -> Array:
    """All samples of all channels, shape (N, 6)."""
    return np.column_stack([x[:, c] for c in range(len(CHANNELS))])


def _overlap(a: SpectralLine, b: SpectralLine) -> bool:
    return abs(a.hz - b.hz) < 0.5 * (a.width_hz + b.width_hz) + NARROW * a.hz


def _both(a: SpectralLine, b: SpectralLine) -> SpectralLine:
    """A line that wanders in two runs, or in two octaves of one."""
    low, high = (pick(line.hz + sign * 0.5 * line.width_hz for line in (a, b)) for pick, sign in ((min, -1), (max, 1)))
    channels = tuple(name for name in CHANNELS if name in a.channels or name in b.channels)
    return SpectralLine(channels, 0.5 * (low + high), high - low, np.maximum(a.rms, b.rms), wanders=True)


def _follow(out: Array, line: SpectralLine, fs: float) -> None:
    """Take a line that wanders out of a run, in place."""
    if out.shape[0] > wandering.MOST_SAMPLES:
        return
    columns = [CHANNELS.index(name) for name in line.channels]
    reach = 0.5 * line.width_hz + NARROW * line.hz
    track = wandering.follow(fs, out[:, columns], line.hz - reach, line.hz + reach)
    if track is not None:
        for harmonic in line.harmonics:
            for c in columns:
                out[:, c] -= wandering.wave(fs, out[:, c], track, harmonic)


# ------------------------------------------------------------------------------------------------------------ peaks


def _peaks(
    channel: int, spectra_of: list[Spectrum], hz: float, shortest: float, barred: NDArray[np.bool_]
) -> list[_Peak]:
    """Lines of one channel, strongest first."""
    ratio, freedom = _summed(spectra_of)
    first = int(np.ceil(spectra.LOWEST / hz))
    if ratio.size <= first + 1:
        return []
    ratio[:first] = 1.0
    ratio[: barred.size][barred[: ratio.size]] = 1.0
    limits = _limits(freedom, ratio.size - first, hz * shortest)
    peaks: list[_Peak] = []
    while len(peaks) < MOST:
        over = [(width, _mean_of(ratio, width) - limit) for width, limit in limits]
        highest = next(((width, o) for width, o in over if np.max(o) > 0.0), None)
        if highest is None:
            break
        width, above = highest
        if width == 1:
            at = int(np.argmax(np.where(above > 0.0, ratio, 0.0)))
            peaks.append(_taken(channel, ratio, at, limits, _LOBE / (hz * shortest), hz))
        else:
            peaks.append(_bump(channel, ratio, above, width, hz))
    return peaks


def _limits(freedom: Array, bins: int, resolved: float) -> list[tuple[int, Array]]:
    """Widths over which the ratio is averaged, and the threshold of each bin's average.

    A lone line stands out of single bins; a band of many bins, none of which is above chance, out of their mean.
    Neighbouring bins under Hann's window have correlations 4/9 and 1/36: m of them are worth m / 1.94.
    """
    kinds, kind = np.unique(freedom, return_inverse=True)
    limits = []
    for width in (w for w in _WIDTHS if w == 1 or 4 * w <= spectra.stretch(bins)):
        nu = kinds * (1.0 if width == 1 else max(1.0, width * resolved / 1.94))
        limit = special.chdtri(nu, PROBABILITY / (len(_WIDTHS) * len(CHANNELS) * bins)) * _FALSE_LEVEL / nu
        limits.append((width, np.maximum(limit, 1.0 if width == 1 else _LEAST_BUMP)[kind]))
    return limits


def _mean_of(ratio: Array, width: int) -> Array:
    return ratio if width == 1 else np.asarray(ndimage.uniform_filter1d(ratio, width))


def _summed(spectra_of: list[Spectrum]) -> tuple[Array, Array]:
    """Density over level, mean over runs weighted with their segments; its degrees of freedom. Shape (M,) each."""
    size = max(s.density.size for s in spectra_of) - 1
    total, freedom = np.zeros(size), np.zeros(size)
    for s in spectra_of:
        inner = min(size, s.density.size - 1)
        if np.all(s.level[:inner] > 0.0):
            total[:inner] += 2.0 * s.averaged * s.density[:inner] / s.level[:inner]
            freedom[:inner] += 2.0 * s.averaged
    freedom = np.maximum(freedom, 1e-9)
    return total / freedom, freedom


def _taken(channel: int, ratio: Array, at: int, limits: list[tuple[int, Array]], lobe: float, hz: float) -> _Peak:
    """The peak around a bin; what belongs to it, side lobes and the band around, becomes level in `ratio`."""
    excess, top = float(ratio[at]), (at + _offset(ratio, at)) * hz
    k = np.arange(ratio.size)
    # the line may be half a bin nearer
    away = np.maximum((np.abs(k - at) - 0.5) / (lobe / _LOBE), 1.0 + 1e-9)
    side = _SIDE * excess / (np.pi * away * (away**2 - 1.0)) ** 2
    # a side lobe and noise of its own size add up, or do not
    own = (side > _SIDE_LEVEL) & (np.sqrt(ratio) < np.sqrt(side) + np.sqrt(limits[0][1]))
    ratio[own | (np.abs(k - at) <= lobe)] = 1.0
    band = np.abs(k - at) <= NARROW * at
    members = np.flatnonzero(band & np.any([_mean_of(ratio, width) > limit for width, limit in limits], axis=0))
    ratio[band] = 1.0
    low, high = (min(members[0], at), max(members[-1], at)) if members.size else (at, at)
    return _Peak(channel, top, excess, float(low * hz), float(high * hz))


def _bump(channel: int, ratio: Array, above: Array, width: int, hz: float) -> _Peak:
    """The band around the highest mean of `width` bins; it becomes level in `ratio`."""
    at = int(np.argmax(above))
    under = np.flatnonzero(above <= 0.0)
    low = int(np.max(under[under < at], initial=0))
    high = int(np.min(under[under > at], initial=ratio.size - 1))
    inside = np.arange(low, high + 1)
    centre = float(np.average(inside, weights=np.maximum(ratio[inside] - 1.0, 1e-9)))
    excess = float(np.max(ratio[inside]))
    ratio[max(0, low - width) : high + width] = 1.0
    return _Peak(channel, centre * hz, excess, float(low * hz), float(high * hz))


def _offset(ratio: Array, at: int) -> float:
    """Bins from a bin to the top of the parabola through its logarithm and its neighbours'."""
    if not 0 < at < ratio.size - 1:
        return 0.0
    left, middle, right = np.log(np.maximum(ratio[at - 1 : at + 2], 1e-300))
    bend = left - 2.0 * middle + right
    return float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0


# ------------------------------------------------------------------------------------------------------------ lines


def _grouped(peaks: list[_Peak], hz: float) -> list[list[_Peak]]:
    """Peaks of all channels within 1 %, or two bins, of the strongest, group after group."""
    remaining = sorted(peaks, key=lambda peak: -peak.excess)
    groups = []
    while remaining:
        top = remaining[0]
        near = [p for p in remaining if abs(p.hz - top.hz) <= max(NARROW * top.hz, 2.0 * hz)]
        groups.append(near)
        remaining = [p for p in remaining if p not in near]
    return groups


def _line(group: list[_Peak], by_channel: list[list[Spectrum]], hz: float, shortest: float) -> SpectralLine:
    weights = np.array([peak.excess for peak in group])
    low, high = min(p.low for p in group), max(p.high for p in group)
    if high - low <= 2.0 * _LOBE / shortest:
        centre, width = float(weights @ [p.hz for p in group] / weights.sum()), 0.0
    else:
        centre, width = 0.5 * (low + high), high - low
    channels = sorted({p.channel for p in group})
    rms = np.zeros(len(CHANNELS))
    half = 0.5 * width + 1.5 * _LOBE / shortest
    for c in channels:
        rms[c] = np.sqrt(np.mean([_power(s, centre, half, hz) for s in by_channel[c]]))
    return SpectralLine(tuple(CHANNELS[c] for c in channels), centre, width, rms)


def _power(spectrum: Spectrum, centre: float, half: float, hz: float) -> float:
    """Power above the level within `half` of a frequency, unit²."""
    first, last = max(0, round((centre - half) / hz)), round((centre + half) / hz) + 1
    excess = spectrum.density[first:last] - spectrum.level[first:last]
    return max(0.0, float(np.sum(excess) * hz))


def _waveforms(lines: list[SpectralLine], hz: float) -> list[SpectralLine]:
    """Lines of which one's frequency is a whole multiple of another's are put together."""
    out: list[SpectralLine] = []
    remaining = sorted(lines, key=lambda line: line.hz)
    while remaining:
        base, remaining = remaining[0], remaining[1:]
        multiples = [line for line in remaining if _multiple(line, base, hz) > 1]
        remaining = [line for line in remaining if line not in multiples]
        out.append(_joined(base, multiples, hz))
    return sorted(out, key=lambda line: -float(np.max(line.rms[:3]) + np.max(line.rms[3:])))


def _multiple(line: SpectralLine, base: SpectralLine, hz: float) -> int:
    """How many times the frequency of another a line has; 0 if that is no whole number within what is resolved."""
    times = round(line.hz / base.hz)
    if line.wanders or base.wanders:
        # of the same frequency both ends are
        alike = line.wanders and base.wanders and times > 1
        off = [abs(end(line) - times * end(base)) for end in (_low, _high)]
        return times if alike and times <= _MOST_HARMONIC and max(off) <= 2.0 * NARROW * line.hz else 0
    within = 0.5 * hz * (times + 1) + 0.25 * (times * base.width_hz + line.width_hz)
    return times if times <= _MOST_HARMONIC and abs(line.hz - times * base.hz) <= within else 0


def _low(line: SpectralLine) -> float:
    return line.hz - 0.5 * line.width_hz


def _high(line: SpectralLine) -> float:
    return line.hz + 0.5 * line.width_hz


def _joined(base: SpectralLine, multiples: list[SpectralLine], hz: float) -> SpectralLine:
    if not multiples:
        return base
    together = [base, *multiples]
    channels = tuple(name for name in CHANNELS if any(name in line.channels for line in together))
    orders = [_multiple(line, base, hz) or 1 for line in together]
    # the highest multiple knows the frequency best
    centre = base.hz if base.width_hz else together[-1].hz / orders[-1]
    rms = np.sqrt(np.sum([line.rms**2 for line in together], axis=0))
    width = max(line.width_hz / n for line, n in zip(together, orders, strict=True))
    wanders = any(line.wanders for line in together)
    return SpectralLine(channels, centre, width, rms, tuple(sorted(set(orders))), wanders)


# ---------------------------------------------------------------------------------------------------------- removal


def _fitted(x: Array, cycles: float, width: float) -> Array:
    """Sine of a frequency (cycles a sample) in one stretch, shape (n,); within a band of a width, a changing one."""
    good = ~np.isnan(x)
    if np.count_nonzero(good) < spectra.LEAST:
        return np.zeros(x.size)
    values = np.where(good, x - np.mean(x[good]), 0.0)
    if width * x.size > 2.0:
        return _followed(values, good, cycles, width)
    cycles += _correction(values, cycles)
    phase = 2.0 * np.pi * cycles * np.arange(x.size)
    A = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    B = A * good[:, None]
    return np.asarray(A @ np.linalg.lstsq(B.T @ A, B.T @ values, rcond=None)[0])


def _correction(values: Array, cycles: float) -> float:
    """What a frequency is off in this stretch, cycles a sample: from how the phase moves from one half to the other."""
    half = values.size // 2
    turned = values[: 2 * half] * np.exp(-2j * np.pi * cycles * np.arange(2 * half))
    first, second = np.sum(turned[:half]), np.sum(turned[half:])
    return float(np.angle(second * np.conj(first)) / (2.0 * np.pi * half))


def _followed(values: Array, good: Array, cycles: float, width: float) -> Array:
    """The part of a residual within a band: turned to frequency 0, averaged, turned back."""
    turn = np.exp(2j * np.pi * cycles * np.arange(values.size))
    # the band found is what stands out: its shoulders reach farther
    size = max(1, round(0.25 / width))
    weight = _smooth(good.astype(float), size)
    slow = values * np.conj(turn)
    mean = (_smooth(slow.real, size) + 1j * _smooth(slow.imag, size)) / np.maximum(weight, 1e-3)
    return np.asarray(2.0 * (mean * turn).real)


def _smooth(x: Array, size: int) -> Array:
    """Two running means, one after the other."""
    once = ndimage.uniform_filter1d(x, size, mode="nearest")
    return np.asarray(ndimage.uniform_filter1d(once, size, mode="nearest"))
