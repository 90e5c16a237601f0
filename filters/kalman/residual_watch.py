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
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from filters.kalman.series_evidence import CYCLES, FASTEST, MOST_ODDS, PRIOR, SIZES, Look, log_factor
from filters.types import Array

Effect = Literal["tone", "step", "telegraph", "noise_level", "thermal_lin", "thermal_rate"]
"""Names of the catalogue; a telegraph is one level that was left again."""
Key: TypeAlias = tuple[int, str]  # a kind of look: blocks in a mean, 0 of a periodogram, and of what
_DATED = ("step", "telegraph", "noise_level")  # of which it is told when they began

TOLD_ODDS = 9.0
"""Odds, against all else that is considered, from which a cause is told; below 1 it is withdrawn."""
MOST_TOLD = 200
_SCALES = ((1, 8), (4, 16))  # blocks in a mean; blocks between two looks
_MOST = SIZES[-1] * _SCALES[-1][0]
_SHORTEST = 64  # means of several blocks before they are looked at
_LEAST_KELVIN, _LEAST_RATE = 0.5, 0.3  # K; K/min: less of it tells nothing
_SPECTRUM_EVERY, _SPECTRUM_BLOCKS, _SPECTRUM_MOST = 8, 64, 8192
_STRETCH, _LEAST_STRETCH = 64, 32  # bins of which a level is the median, at most and at the slow end
_NOISE_DRIFTS = 1e-4  # how likely noise drifts, before the data, over that it does not
_FEWEST = 8  # samples of a block, for its noise
_SAME_HZ, _SAME_BLOCKS = 0.1, 20.0  # relative; what is nearer is the same oscillation, the same step
_EARLY = 0.25  # of what is looked at: nothing is known any more of what began in that part of it


@dataclass(frozen=True, slots=True)
class Cause:
    """An effect in the residual of one channel."""

    effect: Effect
    channel: int  # accelerometer x, y, z, then gyro; body axes
    # tone: amplitude; step, telegraph: difference; noise_level: standard deviation after over before; thermal_lin and
    # thermal_rate: per K, per K/s; m/s² and rad/s
    size: float
    sd: float  # its standard deviation
    extent: float  # how far it takes the reading from its mean in what was looked at, m/s² or rad/s
    odds: float  # against all else that is considered
    t: float  # end of what was looked at, s since the first sample
    since: float  # when a step, a telegraph, a noise_level began; when the others were first seen, s
    hz: float | None = None  # tone


@dataclass(slots=True)
class _Told:
    """A cause that stands, and its odds in the last two looks of each kind that can tell."""

    cause: Cause
    odds: dict[Key, tuple[float, float]]

    def judge(self, key: Key, end: float, odds: float | None, same: Cause | None) -> None:
        """Take what a look up to `end` s says of it: odds, None if it can't tell, and the cause as it is there."""
        if odds is None:
            self.odds.pop(key, None)
            return
        odds = max(odds, 0.0 if same is None else same.odds)
        self.odds[key] = self.last(key), odds
        most = max(now for _, now in self.odds.values())
        if odds >= 1.0:
            old, new = self.cause, same or self.cause
            # a line of a periodogram that is too weak to be told now may wander all the same
            of = new if new.odds >= max(1.0, most) else replace(old, hz=old.hz if key[0] else new.hz)
            self.cause = replace(of, t=end, since=old.since)
        self.cause = replace(self.cause, odds=most)

    def last(self, key: Key) -> float:
        """Odds in the last look of a kind."""
        return self.odds[key][1] if key in self.odds else self.cause.odds

    def is_gone(self) -> bool:
        """Whether no two looks find it any more."""
        return bool(self.odds) and max(max(both) for both in self.odds.values()) < 1.0


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
        self._likely: dict[Key, list[Cause]] = {}  # what the last look of each kind found
        self._parts: list[tuple[Array, Array, Array, Array]] = []
        self._told: list[_Told] = []
        self.changes: list[tuple[Literal["cause", "cause_gone"], Cause]] = []
        """Each cause as it was told, `MOST_TOLD` at most, and as it was when it was withdrawn, in this order."""

    def causes(self) -> list[Cause]:
        """What was told and not withdrawn, as it was last seen: what shows now first, the most certain of it first."""
        causes = [told.cause for told in self._told]
        return sorted(causes, key=lambda one: (not self.shows(one), -abs(one.size) / max(one.sd, 1e-300)))

    def shows(self, cause: Cause) -> bool:
        """Whether it was seen in the last two looks."""
        return cause.t >= self._end - 2 * _SCALES[-1][1] * self._block

    def told(self) -> list[Cause]:
        """Each cause as it was told."""
        return [one for change, one in self.changes if change == "cause"]

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
            self._likely.clear()
            for told in self._told:
                told.odds.clear()
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
        if self._count % _SPECTRUM_EVERY == _SPECTRUM_EVERY // 2:
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
        if scale == 1:
            noise = [one for c in range(6) for one in self._of_noise(values[:, 6 + c], values[:, c], c)]
            self._tell((scale, "noise"), noise)
        found = [one for c in range(6) for one in self._of_channel(values[:, c], values[:, 12], scale, c)]
        self._tell((scale, "mean"), found)

    def _of_channel(self, y: Array, temperature: Array, scale: int, channel: int) -> list[Cause]:
        if not np.isfinite(y).all() or np.ptp(y) == 0.0:
            return []
        drivers: dict[str, Array] = {}
        if scale > 1 and np.isfinite(temperature).all():
            width = 7
            smooth = np.convolve(np.pad(temperature, width // 2, mode="edge"), np.ones(width) / width, "valid")
            rate = np.gradient(smooth, scale * self._block)
            if np.ptp(smooth) > _LEAST_KELVIN:
                drivers["thermal_lin"] = smooth
                if np.ptp(rate) > _LEAST_RATE / 60.0:
                    drivers["thermal_rate"] = rate
        key, look = (scale, "mean"), _weighed(y, drivers)
        found = self._found(look, channel, scale)
        most = max(found, key=lambda one: one.odds)
        standing = [told for told in self._told if told.cause.channel == channel and told.cause.effect != "noise_level"]
        others = [told for told in standing if most.odds >= TOLD_ODDS and not self._is_same(told.cause, most)]
        # what was told before is judged beside what shows most
        beside = _weighed(look.without(most.effect), drivers) if others else look
        for told in standing:
            self._again(told, key, beside if told in others else look)
        return found

    def _of_noise(self, variance: Array, mean: Array, channel: int) -> list[Cause]:
        if not np.isfinite(variance).all() or np.min(variance) <= 0.0 or np.ptp(mean) == 0.0:
            return []
        look = Look(np.log(variance), drift=_NOISE_DRIFTS)
        look.rivals()
        look.telegraph(look.steps())
        look.found["noise_level"] = look.found.pop("step")
        found = self._found(look, channel, 1)
        for told in self._told:
            if (told.cause.channel, told.cause.effect) == (channel, "noise_level"):
                self._again(told, (1, "noise"), look)
        return found

    def _found(self, look: Look, channel: int, scale: int) -> list[Cause]:
        seconds = look.y.size * scale * self._block
        out = []
        for effect in get_args(Effect):
            if (f := look.found.get(effect)) is not None:
                since = self._end - seconds * (1.0 - f.at) if effect in _DATED else self._end
                hz = f.cycles / (scale * self._block) if effect == "tone" else None
                size, sd, extent = f.size, f.sd, f.extent
                if effect == "noise_level":
                    size = float(np.exp(0.5 * f.size))
                    sd, extent = 0.5 * f.sd * size, 0.0
                out.append(Cause(effect, channel, size, sd, extent, look.odds(effect), self._end, since, hz))
        return out

    def _again(self, told: _Told, key: Key, look: Look) -> None:
        """Weigh in a look at means what was told before."""
        cause, block = told.cause, key[0] * self._block
        seconds, odds = look.y.size * block, None
        cycles = (cause.hz or 0.0) * block
        if cause.effect in _DATED:
            if cause.effect in look.found and cause.since >= self._end - (1.0 - _EARLY) * seconds:
                odds = look.odds(cause.effect, "step" if cause.effect == "telegraph" else cause.effect)
        elif cause.effect in look.found and (not cycles or CYCLES * block / seconds <= cycles <= FASTEST):
            odds = self._carried(told, key, look.log_factor(cause.effect, cycles), seconds)
        found = self._found(look, cause.channel, key[0])
        same = (one for one in found if one.effect == cause.effect and self._is_same(cause, one))
        told.judge(key, self._end, odds, next(same, None))

    def _carried(self, told: _Told, key: Key, log_factor: float, seconds: float) -> float:
        """Odds of what was told and goes on: what is new in a look changes them by its share of the factor."""
        share = dict(_SCALES).get(key[0], _SPECTRUM_EVERY) * self._block / seconds
        return min(told.last(key), TOLD_ODDS) * float(np.exp(min(share * log_factor, np.log(MOST_ODDS))))

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
        hz, unit, found = (first + np.arange(len(power))) * fs / size, 4.0 / (size * np.sum(window**2)), []
        for channel in np.flatnonzero(np.isfinite(medians).all(axis=0) & (medians.min(axis=0) > 0.0)).tolist():
            lines = _Lines(channel, self._end, hz, power[:, channel], medians[:, channel], edges, unit)
            known = []
            for told in [told for told in self._told if told.cause.channel == channel]:
                if (at := told.cause.hz) is not None:
                    near, odds, same = np.flatnonzero(np.abs(hz - at) <= 2.5 * fs / size), None, None
                    if near.size:
                        odds = self._carried(told, (0, "line"), lines.log_factor(near), size / fs)
                        same = lines.strongest(near)
                    told.judge((0, "line"), self._end, odds, same)
                    known.append(np.abs(hz - at) <= _SAME_HZ * hz)
            others = np.flatnonzero(~np.any(known, axis=0)) if known else np.arange(hz.size)
            if others.size:
                found.append(lines.strongest(others))
        self._tell((0, "line"), found)

    def _tell(self, key: Key, found: list[Cause]) -> None:
        """Tell what a look found and the look before found as well; withdraw what is gone."""
        before, self._likely[key] = self._likely.get(key, []), [one for one in found if one.odds >= TOLD_ODDS]
        for one in self._likely[key]:
            first = next((b for b in before if b.effect == one.effect and self._is_same(b, one)), None)
            known = any(self._is_same(told.cause, one) for told in self._told)
            if first is not None and not known and len(self.told()) < MOST_TOLD:
                self._told.append(
                    _Told(
                        one if one.effect in _DATED else replace(one, since=first.since), {key: (first.odds, one.odds)}
                    )
                )
                self.changes.append(("cause", self._told[-1].cause))
        self.changes += [("cause_gone", replace(told.cause, t=self._end)) for told in self._told if told.is_gone()]
        self._told = [told for told in self._told if not told.is_gone()]

    def _is_same(self, before: Cause, now: Cause) -> bool:
        """Whether what shows now is what showed before: from inside of a level it looks like a step."""
        of = (before.effect, "step") if before.effect == "telegraph" else (before.effect,)
        if before.channel != now.channel or now.effect not in of:
            return False
        if now.hz is not None and before.hz is not None:
            return abs(now.hz - before.hz) <= max(_SAME_HZ * now.hz, 0.5 / (SIZES[0] * self._block))
        if now.effect in _DATED:
            return now.since - before.since <= _SAME_BLOCKS * self._block or now.since <= before.t
        return True


def _weighed(y: Array, drivers: Mapping[str, Array]) -> Look:
    look = Look(y)
    look.rivals()
    look.telegraph(look.steps())
    look.tone()
    for effect, x in drivers.items():
        look.driver(effect, x)
    return look


def _edges(bins: int) -> NDArray[np.int_]:
    """Edges of stretches of bins, shorter ones first, where a level may be steep."""
    edges = np.append(0, np.arange(_LEAST_STRETCH, bins + 1, _STRETCH))
    return np.asarray(edges)


class _Lines:
    """Lines in the periodogram of a channel.

    `hz`, `power`: of its bins. `medians`: of the power in stretches of bins between `edges`, over log 2. `unit`: square
    of an amplitude of power 1.
    """

    def __init__(
        self, channel: int, end: float, hz: Array, power: Array, medians: Array, edges: NDArray[np.int_], unit: float
    ) -> None:
        self._channel, self._end, self._hz, self._power, self._unit = channel, end, hz, power, unit
        self._level = np.exp(np.interp(np.arange(hz.size), 0.5 * (edges[1:] + edges[:-1]), np.log(medians)))
        ratio = power / self._level
        # the level is not known exactly: what counts is the bin's share of its own power and the stretch's
        n = np.append(np.repeat(np.diff(edges), np.diff(edges)), np.full(hz.size - edges[-1], _STRETCH))
        self._factors = np.empty(hz.size)
        for width in (_LEAST_STRETCH, _STRETCH):
            among = n == width
            self._factors[among] = log_factor(ratio[among] / (width + ratio[among]), 2, 2 * width + 3)
        self._weights = self._factors - np.log(hz) - np.log(np.sum(1.0 / hz)) + np.log(PRIOR["tone"])

    def log_factor(self, near: NDArray[np.int_]) -> float:
        """Logarithm of the Bayes factor of a line in some bins, each as likely as the other."""
        return float(np.logaddexp.reduce(self._factors[near])) - float(np.log(near.size))

    def strongest(self, among: NDArray[np.int_]) -> Cause:
        """The likeliest line among some bins, and the odds that there is one."""
        top = int(among[np.argmax(self._weights[among])])
        odds = float(np.exp(min(np.logaddexp.reduce(self._weights[among]), np.log(MOST_ODDS))))
        near = slice(max(0, top - 2), top + 3)
        excess = np.maximum(self._power[near] - self._level[near], 1e-12 * self._level[near])
        size, hz = float(np.sqrt(self._unit * np.sum(excess))), float(np.average(self._hz[near], weights=excess))
        sd = size / float(np.sqrt(2.0 * self._power[top] / self._level[top]))
        return Cause("tone", self._channel, size, sd, size, odds, self._end, self._end, hz)
