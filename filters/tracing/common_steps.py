"""Steps that several channels make at the same time: where they are, how large in each channel, how sure.

D(t; m) is the mean of m rows from t on less that of the m rows before, over the spread that D itself has in the
channel: whatever drift a channel has is in that spread. What two channels show at once at the far end of their
spreads is a common step. Two with opposite sizes are the start and end of one event.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from filters.tracing.common_rows import Rows, Stretch
from filters.types import Array

_FALSE = 1e-3  # probability of one common step or more in a trace of channels that have nothing in common
_JOINS = 1e-3  # probability below which one more channel makes the step too
_SCALES = (1, 2, 4, 8, 16, 32, 64, 128, 256)
_LEAST_MEANS = 40  # of a scale: with fewer the spread is not known
_PER_SCALE = 6.0  # independent places, over rows, of all scales together
_MOST_STEPS = 16
_MOST_TRIES = 40
_MAD = 1.482602218505602
_EDGE_S = 10.0  # of a run: what one sample does there would pass for a step of all that follows
_OPPOSITE = -0.8  # cosine of two steps that are one event's ends
_ALIKE = (0.5, 2.0)
_NEARLY, _COMPANY = 0.7, 0.4  # of a step: what is a step like it, and what is beside one
_STANDS_OUT = 3.0
_USUAL = 3.0  # times as often as noise makes such steps


@dataclass(frozen=True, slots=True)
class CommonStep:
    """A step of several channels."""

    # run, row: first row after it
    run: int
    row: int
    width: int  # rows over which the levels before and after were taken
    channels: tuple[int, ...]
    # size, sd: of each of the six channels, SI, shape (6,)
    size: Array
    sd: Array
    p: float  # probability of as much by chance, over the whole trace


@dataclass(frozen=True, slots=True)
class _Differences:
    """D of all stretches at one scale: normalised and in SI, both (n, 6); where each row is."""

    scale: int
    z: Array
    size: Array
    sd: Array
    run: NDArray[np.int_]
    row: NDArray[np.int_]


def common_steps(rows: Rows) -> tuple[list[CommonStep], Rows]:
    """Common steps, by time, and the rows cut at each of them."""
    found: list[CommonStep] = []
    total = sum(s.end - s.first for s in rows.stretches)
    scales = [m for m in _SCALES if total >= _LEAST_MEANS * m] if len(rows.channels) > 1 else []
    whole = {m: d for m in scales if (d := _differences(rows, m)) is not None}
    while len(found) < _MOST_STEPS:
        step = _strongest(rows, whole)
        if step is None:
            break
        found.append(step)
        beside = 2 + step.width // 8
        rows = rows.without(step.run, step.row - beside, step.row + beside)
    return _merged(sorted(found, key=lambda s: (s.run, s.row))), rows


def pairs(steps: list[CommonStep]) -> list[tuple[CommonStep, CommonStep | None]]:
    """Steps with those that undo them, the nearest ones together, in order of time; None of one that stays."""
    numbers = range(len(steps))
    candidates = [(i, j) for i in numbers for j in numbers[i + 1 :] if steps[i].run == steps[j].run]
    back: dict[int, int] = {}
    for i, j in sorted(candidates, key=lambda ij: steps[ij[1]].row - steps[ij[0]].row):
        if not {i, j} & {*back, *back.values()} and _undoes(steps[i], steps[j]):
            back[i] = j
    first = [i for i in numbers if i not in back.values()]
    return [(steps[i], steps[back[i]] if i in back else None) for i in first]


def _undoes(a: CommonStep, b: CommonStep) -> bool:
    both = sorted(set(a.channels) | set(b.channels))
    sd = np.sqrt(0.5 * (a.sd[both] ** 2 + b.sd[both] ** 2))
    u, v = a.size[both] / sd, b.size[both] / sd
    size = float(np.linalg.norm(u) * np.linalg.norm(v))
    ratio = float(np.linalg.norm(v) / np.linalg.norm(u))
    return float(u @ v) < _OPPOSITE * size and _ALIKE[0] < ratio < _ALIKE[1]


def _merged(steps: list[CommonStep]) -> list[CommonStep]:
    """Steps in the same sense that follow within their widths are one that takes some time."""
    out: list[CommonStep] = []
    for step in steps:
        last = out[-1] if out else None
        if last is not None and last.run == step.run and step.row - last.row <= 2 * max(last.width, step.width, 4):
            both = list({*last.channels, *step.channels})
            if float(last.size[both] / last.sd[both] @ (step.size[both] / step.sd[both])) > 0.0:
                out[-1] = _stronger(last, step)
                continue
        out.append(step)
    return out


def _stronger(a: CommonStep, b: CommonStep) -> CommonStep:
    return a if np.sum((a.size / a.sd)[list(a.channels)] ** 2) >= np.sum((b.size / b.sd)[list(b.channels)] ** 2) else b


def _strongest(rows: Rows, whole: dict[int, _Differences]) -> CommonStep | None:
    """The common step that stands out most and is not by chance, or None; `whole` is of the rows before any cut."""
    total = sum(s.end - s.first for s in rows.stretches)
    scales = [d for m, uncut in whole.items() if (d := _differences(rows, m, uncut.sd)) is not None]
    edge = _EDGE_S / rows.period
    for d, at in _by_second(scales, rows):
        if not edge <= d.row[at] <= len(rows.residual[d.run[at]]) - edge:
            continue
        p = _chance(d, at, whole[d.scale], rows.channels)
        second = float(np.sort(p)[1])
        # the second least of all channels' probabilities, at the best of all places
        chance = min(1.0, 0.5 * len(p) * (len(p) - 1) * second**2 * _PER_SCALE * total)
        if chance < _FALSE:
            members = tuple(c for c, own in zip(rows.channels, p.tolist(), strict=True) if own < _JOINS)
            best = _refined(d, at, members)
            return CommonStep(int(d.run[best]), int(d.row[best]), d.scale, members, d.size[best], d.sd, chance)
    return None


def _by_second(scales: list[_Differences], rows: Rows) -> Iterator[tuple[_Differences, int]]:
    """Places by the second largest ∣D∣ over its spread, the largest first, not near one that was given before."""
    channels = list(rows.channels)
    seconds = [np.sort(np.abs(d.z[:, channels]), axis=1)[:, -2] for d in scales]
    for _ in range(_MOST_TRIES):
        best = max(range(len(scales)), key=lambda k: float(seconds[k].max()), default=None)
        if best is None or seconds[best].max() <= 0.0:
            return
        d, at = scales[best], int(np.argmax(seconds[best]))
        yield d, at
        near = (d.run == d.run[at]) & (np.abs(d.row - d.row[at]) <= d.scale)
        seconds[best][near] = 0.0


def _chance(d: _Differences, at: int, whole: _Differences, channels: tuple[int, ...]) -> Array:
    """Probability of each channel's ∣D∣ by chance: of a normal one, and how often it is seen alone elsewhere."""
    own = list(channels)
    here = np.abs(d.z[at, own])
    usual = 2.0 * special.ndtr(-_above_slope(d, at)[own])
    # where others are large as well is another common step: the way back of this one, for instance
    z = np.abs(whole.z[:, own])
    company = z >= np.maximum(_COMPANY * here, _STANDS_OUT)
    alone = np.sum(company, axis=1)[:, None] - company == 0
    far = (whole.run != d.run[at]) | (np.abs(whole.row - d.row[at]) > 2 * d.scale)
    # more often than noise would: the channel makes steps by itself
    elsewhere = np.mean((z >= _NEARLY * here) & alone & far[:, None], axis=0)
    elsewhere = elsewhere - _USUAL * 2.0 * special.ndtr(-_NEARLY * here)
    return np.asarray(np.minimum(1.0, usual + np.maximum(elsewhere, 0.0)))


def _above_slope(d: _Differences, at: int) -> Array:
    """∣D∣ over its spread less what it is in the same sense beside the place: a slope has it there too; (6,)."""
    sense = np.sign(d.z[at])
    beside = np.zeros(6)
    for k in (at - 2 * d.scale, at + 2 * d.scale):
        if 0 <= k < len(d.z) and d.run[k] == d.run[at] and abs(d.row[k] - d.row[at]) == 2 * d.scale:
            beside = np.maximum(beside, sense * d.z[k])
    return np.asarray(np.abs(d.z[at]) - np.minimum(beside, np.abs(d.z[at])))


def _refined(d: _Differences, at: int, members: tuple[int, ...]) -> int:
    """The place near by where the members' steps together are largest, and none of them lacks its readings."""
    near = np.flatnonzero((d.run == d.run[at]) & (np.abs(d.row - d.row[at]) <= d.scale))
    z = d.z[near][:, list(members)]
    return int(near[np.argmax(np.where((z != 0.0).all(axis=1), np.sum(z**2, axis=1), 0.0))])


def _differences(rows: Rows, m: int, sd: Array | None = None) -> _Differences | None:
    """D of all stretches; its spread, where it is not known, from the same."""
    parts = [(s, _of_stretch(rows, s, m)) for s in rows.stretches if s.end - s.first >= 2 * m]
    if not parts:
        return None
    size = np.concatenate([part for _, part in parts])
    run = np.concatenate([np.full(len(part), s.run) for s, part in parts])
    row = np.concatenate([s.first + m + np.arange(len(part)) for s, part in parts])
    if sd is None:
        spread = _MAD * np.median(np.abs(size), axis=0)
        sd = np.maximum(spread, np.sqrt(2.0 * np.nan_to_num(rows.white) / m))
        sd = np.where(sd > 0.0, sd, np.inf)
    return _Differences(m, size / sd, size, sd, run, row)


def _of_stretch(rows: Rows, stretch: Stretch, m: int) -> Array:
    """D at rows m, m + 1, … of a stretch, 0 where more than half of either side's rows are missing, shape (k, 6)."""
    x = rows.of(stretch)
    good = np.isfinite(x)
    sums = np.cumsum(np.vstack([np.zeros(6), np.where(good, x, 0.0)]), axis=0)
    counts = np.cumsum(np.vstack([np.zeros(6), good]), axis=0)
    total, count = sums[m:] - sums[:-m], counts[m:] - counts[:-m]
    mean = total / np.maximum(count, 1.0)
    enough = (count[m:] > 0.5 * m) & (count[:-m] > 0.5 * m)
    return np.where(enough, mean[m:] - mean[:-m], 0.0)
