"""Effects that show in the residual of a unit at rest while it is filtered: kind, size and odds, at bounded cost.

Means of the residual over blocks of a second are kept for nine minutes. Every few blocks `series_evidence` compares the
kinds of effects, per channel, over the last 128 blocks and over the last 128 means of four of them. Oscillations faster
than that are compared with the level around them in a periodogram of the last minute. A change of the noise is a step
of the logarithm of its variance in blocks.

References
----------
G. L. Bretthorst, "Bayesian spectrum analysis and parameter estimation", 1988.
"""

from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from filters.kalman.series_evidence import FASTEST, MOST_ODDS, PRIOR, SIZES, Look, log_factor
from filters.types import Array

Kind = Literal["oscillation", "step", "levels", "noise", "temperature slope", "temperature rate"]

TOLD_ODDS = 9.0
"""Odds, against all else that is considered, from which an effect is told."""
MOST_TOLD = 200
_SCALES = ((1, 8), (4, 16))  # blocks in a mean; blocks between two looks
_MOST = SIZES[-1] * _SCALES[-1][0]
_SHORTEST = 64  # means of several blocks before they are looked at
_LEAST_KELVIN, _LEAST_RATE = 0.5, 0.3  # K; K/min: less of it tells nothing
_SPECTRUM_BLOCKS, _SPECTRUM_MOST = 64, 8192
_STRETCH, _LEAST_STRETCH = 64, 32  # bins of which a level is the median, at most and at the slow end
_NOISE_DRIFTS = 1e-4  # how likely noise drifts, before the data, over that it does not
_FEWEST = 8  # samples of a block, for its noise
_SAME_HZ, _SAME_BLOCKS = 0.1, 20.0  # relative; what is nearer is the same oscillation, the same step
_LONG_AGO = 1800.0  # s after which what went away is told again


@dataclass(frozen=True, slots=True)
class Finding:
    """An effect in the residual of one channel."""

    kind: Kind
    channel: int  # accelerometer x, y, z, then gyro; body axes
    # oscillation: amplitude; step, levels: difference; noise: standard deviation after over before; temperature slope
    # and rate: per K, per K/s; m/s² and rad/s
    size: float
    sd: float  # its standard deviation
    extent: float  # how far it takes the reading from its mean in what was looked at, m/s² or rad/s
    odds: float  # against all else that is considered
    t: float  # end of what was looked at, s since the first sample
    at: float | None = None  # step, levels, noise: when it began, s
    hz: float | None = None  # oscillation


class ResidualWatch:
    """Takes the residual by the block and tells what shows in it.

    `block`: its length, s.
    """

    def __init__(self, block: float) -> None:
        self._block = block
        # a row a block: means of the residual, its variances, temperature; the last `_MOST` are kept, at the place that
        # `_kept` says
        self._rows, self._kept = np.zeros((2 * _MOST, 13)), 0
        self._samples: deque[Array] = deque(maxlen=_SPECTRUM_BLOCKS)
        self._end = -np.inf
        self._count = 0
        self._before: dict[tuple[int, str], list[Finding]] = {}
        self._now: dict[tuple[int, str], list[Finding]] = {}
        self._known: list[Finding] = []  # as they were last seen
        self._parts: list[tuple[Array, Array, Array, Array]] = []
        self.told: list[Finding] = []
        """Each effect when it was told for the first time, `MOST_TOLD` at most."""

    def findings(self) -> list[Finding]:
        """What shows now, the most certain of each channel's kinds first."""
        best: dict[tuple[object, ...], Finding] = {}
        for finding in (one for several in self._now.values() for one in several):
            same = "step" if finding.kind == "levels" else finding.kind
            key = (finding.channel, same, round(finding.hz or 0.0, 1))
            if key not in best or best[key].odds < finding.odds:
                best[key] = finding
        return sorted(best.values(), key=lambda one: -abs(one.size) / max(one.sd, 1e-300))

    def past(self) -> list[Finding]:
        """What was told and does not show any more, the newest first."""
        showing = self.findings()
        return [one for one in reversed(self.told) if not any(_is_same(one, now, self._block) for now in showing)]

    def add(self, accel: Array, gyro: Array, temperature: Array, phi: Array) -> None:
        """Take readings of the present block, (n, 3), (n, 3), (n,), and their regressors of extra states, (n, 6, p)."""
        self._parts.append((accel, gyro, temperature, phi))

    def close(self, end: float, states: Array) -> None:
        """End a block at `end` s; `states` are the extra states, (p,), whose part of the readings is known."""
        parts, self._parts = self._parts, []
        if parts:
            accel, gyro, temperature, phi = (np.concatenate(part) for part in zip(*parts, strict=True))
            residual = np.hstack([accel, gyro])
            self.take(end, residual - phi @ states if states.size else residual, temperature)

    def take(self, end: float, residual: Array, temperature: Array) -> None:
        """Take a block that ends at `end` s: residual (n, 6), n > 0, and temperature (n,), degC or NaN."""
        missing = round((end - self._end) / self._block) - 1 if self._kept else 0
        if missing > 2:
            self._kept = 0
            self._samples.clear()
            self._now.clear()
            self._before.clear()
        for _ in range(missing if 0 < missing <= 2 else 0):
            self._keep(self._rows[self._kept - 1])
        self._end = end
        variance = residual.var(axis=0) if len(residual) >= _FEWEST else np.full(6, np.nan)
        self._keep(np.concatenate([residual.mean(axis=0), variance, [temperature.mean()]]))
        self._samples.append(residual)
        self._count += 1
        for scale, every in _SCALES:
            if self._count % every == 0:
                self._look(scale)
        if self._count % 8 == 4:
            self._spectra()

    def _keep(self, row: Array) -> None:
        if self._kept == len(self._rows):
            self._rows[:_MOST], self._kept = self._rows[_MOST:].copy(), _MOST
        self._rows[self._kept] = row
        self._kept += 1

    def _look(self, scale: int) -> None:
        n = next((n for n in reversed(SIZES) if n * scale <= min(self._kept, _MOST)), 0)
        if n < (_SHORTEST if scale > 1 else SIZES[0]):
            return
        values = self._rows[self._kept - n * scale : self._kept].reshape(n, scale, -1).mean(axis=1)
        found = [one for c in range(6) for one in self._of_channel(values[:, c], values[:, 12], scale, c)]
        if scale == 1:
            noise = [self._of_noise(values[:, 6 + c], values[:, c], c) for c in range(6)]
            self._tell((scale, "noise"), [one for one in noise if one is not None])
        self._tell((scale, "mean"), found)

    def _of_channel(self, y: Array, temperature: Array, scale: int, channel: int) -> list[Finding]:
        if not np.isfinite(y).all() or np.ptp(y) == 0.0:
            return []
        look = Look(y)
        look.rivals()
        look.levels(look.steps())
        look.oscillation()
        if scale > 1 and np.isfinite(temperature).all():
            width = 7
            smooth = np.convolve(np.pad(temperature, width // 2, mode="edge"), np.ones(width) / width, "valid")
            rate = np.gradient(smooth, scale * self._block)
            if np.ptp(smooth) > _LEAST_KELVIN:
                look.driver("temperature slope", smooth)
                if np.ptp(rate) > _LEAST_RATE / 60.0:
                    look.driver("temperature rate", rate)
        return self._findings(look, channel, scale)

    def _findings(self, look: Look, channel: int, scale: int) -> list[Finding]:
        seconds = look.y.size * scale * self._block
        out = []
        kinds: tuple[Kind, ...] = ("oscillation", "step", "levels", "temperature slope", "temperature rate")
        for kind in kinds:
            if kind in look.found and (odds := look.odds(kind)) >= TOLD_ODDS:
                f = look.found[kind]
                at = None if not f.at else self._end - seconds * (1.0 - f.at)
                hz = f.cycles / (scale * self._block) if f.cycles else None
                out.append(Finding(kind, channel, f.size, f.sd, f.extent, odds, self._end, at, hz))
        return out

    def _of_noise(self, variance: Array, mean: Array, channel: int) -> Finding | None:
        if not np.isfinite(variance).all() or np.min(variance) <= 0.0 or np.ptp(mean) == 0.0:
            return None
        look = Look(np.log(variance), drift=_NOISE_DRIFTS)
        look.rivals()
        look.levels(look.steps())
        odds, f = look.odds("step"), look.found["step"]
        if odds < TOLD_ODDS:
            return None
        ratio = float(np.exp(0.5 * f.size))
        at = self._end - look.y.size * self._block * (1.0 - f.at)
        return Finding("noise", channel, ratio, 0.5 * f.sd * ratio, 0.0, odds, self._end, at)

    def _spectra(self) -> None:
        x = np.concatenate(self._samples)
        fs = len(x) / (len(self._samples) * self._block)
        size = min(len(x), _SPECTRUM_MOST) // 128 * 128  # its factors are small
        first = int(np.ceil(0.9 * FASTEST / self._block * size / fs))
        if len(self._samples) < SIZES[0] // 2 or size // 2 - first < 2 * _STRETCH:
            return
        x = x[-size:] - x[-size:].mean(axis=0)
        window = np.hanning(size + 1)[:-1, None]
        power = np.abs(np.fft.rfft(x * window, axis=0))[first : size // 2] ** 2
        edges = _edges(len(power))
        medians = np.array([np.median(power[a:b], axis=0) for a, b in pairwise(edges)]) / np.log(2.0)
        found = []
        for channel in np.flatnonzero(np.isfinite(medians).all(axis=0) & (medians.min(axis=0) > 0.0)):
            level = np.interp(np.arange(len(power)), 0.5 * (edges[1:] + edges[:-1]), np.log(medians[:, channel]))
            one = _line(power[:, channel], np.exp(level), first, edges)
            if one is not None:
                top, square, ratio, odds = one
                size_ = float(np.sqrt(4.0 * square / (size * np.sum(window**2))))
                sd, hz = size_ / float(np.sqrt(2.0 * ratio)), top * fs / size
                found.append(Finding("oscillation", int(channel), size_, sd, size_, odds, self._end, hz=hz))
        self._tell((0, "line"), found)

    def _tell(self, look: tuple[int, str], found: list[Finding]) -> None:
        """Take what a look found, and tell what is new in it: what the look before found as well."""
        before, self._before[look] = self._before.get(look, []), found
        self._now[look] = [one for one in found if any(_is_same(b, one, self._block) for b in before)]
        for one in self._now[look]:
            same = [k for k in self._known if _is_same(k, one, self._block)]
            self._known = [k for k in self._known if k not in same and one.t - k.t < _LONG_AGO] + [one]
            if not any(one.t - k.t < _LONG_AGO for k in same) and len(self.told) < MOST_TOLD:
                self.told.append(one)


def _is_same(before: Finding, now: Finding, block: float) -> bool:
    """Whether what shows now is what showed before."""
    levels = ("step", "levels")
    if before.channel != now.channel or not (before.kind == now.kind or {before.kind, now.kind} <= {*levels}):
        return False
    if now.hz is not None and before.hz is not None:
        return abs(now.hz - before.hz) <= max(_SAME_HZ * now.hz, 0.5 / (SIZES[0] * block))
    if now.at is not None and before.at is not None:
        return now.at - before.at <= _SAME_BLOCKS * block or now.at <= before.t
    return True


def _edges(bins: int) -> NDArray[np.int_]:
    """Edges of stretches of bins, shorter ones first, where a level may be steep."""
    edges = np.append(0, np.arange(_LEAST_STRETCH, bins + 1, _STRETCH))
    return np.asarray(edges)


def _line(power: Array, level: Array, first: int, edges: NDArray[np.int_]) -> tuple[float, float, float, float] | None:
    """The strongest line of a periodogram, if it is told: its bin, what is above the level, that over it, odds."""
    ratio, bins = power / level, first + np.arange(power.size)
    # the level is not known exactly: what counts is the bin's share of its own power and the stretch's
    n = np.append(np.repeat(np.diff(edges), np.diff(edges)), np.full(power.size - edges[-1], _STRETCH))
    each = -np.log(bins) - np.log(np.sum(1.0 / bins))
    for width in (_LEAST_STRETCH, _STRETCH):
        among = n == width
        each[among] += log_factor(ratio[among] / (width + ratio[among]), 2, 2 * width + 3)
    odds = float(np.exp(min(np.logaddexp.reduce(each) + np.log(PRIOR["oscillation"]), np.log(MOST_ODDS))))
    if odds < TOLD_ODDS:
        return None
    top = int(np.argmax(each))
    near = slice(max(0, top - 2), top + 3)
    excess = np.maximum(power[near] - level[near], 0.0)
    total = float(np.sum(excess))
    return float(np.sum(bins[near] * excess)) / total, total, float(ratio[top]), odds
