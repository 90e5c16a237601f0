"""Rests of a unit that is turned by hand: stretches where every channel is about as quiet as it ever is.

A window of one second counts as rest where every channel is within a few times as quiet as in its quietest windows.
What is left out: what the rests mean (`accelerometer`, `turns`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.channels import ACCELS
from filters.tracing.run import Run
from filters.types import Array

WINDOW_S = 1.0  # length of a window, s; no rest is shorter
_HOP_S = 0.1
_WITHIN = 4.0  # standard deviation of a window at rest, in those of the quietest: a hand, a table that is walked past
_QUIETEST = 0.05  # share of the windows that are surely at rest where a unit rests at all
_BLOCK_S = 0.5
_GAP_PERIODS, _GAP_S = 2.5, 0.05
_DISTINCT = np.deg2rad(10.0)


@dataclass(frozen=True, slots=True)
class Rest:
    """One rest."""

    # first, last: its samples, `last` not among them
    first: int
    last: int
    # start_s, seconds: since the run's first sample, and how long
    start_s: float
    seconds: float
    mean: Array  # of the six readings, instrument axes and sign, SI, shape (6,); NaN of a channel without data
    variance: Array  # of that mean by the noise of the readings, shape (6,)


def recorded(run: Run) -> NDArray[np.bool_]:
    """Channels that the recording has, shape (6,): one that reads the same throughout is dead."""
    have = np.array([(there != there[:1]).any() for there in (x[np.isfinite(x)] for x in run.reading.T)])
    have[list(run.unread)] = False
    return have


def unusable(run: Run) -> NDArray[np.bool_]:
    """Samples of recorded channels that are no reading, or are flagged, such as at a limit, shape (N, 6)."""
    bad: NDArray[np.bool_] = ~np.isfinite(run.reading)
    return np.asarray((bad if run.flagged is None else bad | run.flagged) & recorded(run))


def gaps(run: Run) -> NDArray[np.bool_]:
    """Samples that come after a hole in time, shape (N,)."""
    gap = np.diff(run.t, prepend=run.t[0]) > max(_GAP_PERIODS / run.rate_hz, _GAP_S)
    if gap.mean() > 1e-3:  # a host's stamps come in bursts: those are no gaps in the samples
        gap[:] = False
    return np.asarray(gap)


def find_rests(run: Run) -> tuple[Rest, ...]:
    """Rests of a run, in order.

    `run`: readings; what it says of angles is not looked at.
    """
    have = np.flatnonzero(recorded(run))
    width = max(8, round(WINDOW_S * run.rate_hz))
    if not have.size or run.t.size < 2 * width:
        return ()
    hop = max(1, round(_HOP_S * run.rate_hz))
    starts = np.arange(0, run.t.size - width + 1, hop)
    broken = _broken(run, starts, width)
    if broken.all():
        return ()
    variance = _variances(run.reading[:, have], starts, width)
    quietest = np.quantile(variance[~broken], _QUIETEST, axis=0)
    quietest = np.maximum(quietest, [_least_step(run.reading[:, c]) ** 2 / 12.0 for c in have])
    calm = ~broken & (variance <= _WITHIN**2 * quietest).all(axis=1)
    stretches = _stretches(starts, calm, width)
    spread = _spread_of_blocks(run, stretches)
    return tuple(_rest(run, first, last, spread) for first, last in stretches)


def _broken(run: Run, starts: NDArray[np.int_], width: int) -> NDArray[np.bool_]:
    """Windows with a gap or a sample that is no reading."""
    total = np.concatenate([[0], np.cumsum(gaps(run) | unusable(run).any(axis=1))])
    return np.asarray(total[starts + width] - total[starts] > 0)


def _variances(reading: Array, starts: NDArray[np.int_], width: int) -> Array:
    """Variance of each window and channel, shape (windows, channels)."""
    centred = np.nan_to_num(reading - np.nanmedian(reading, axis=0))
    zero = np.zeros((1, reading.shape[1]))
    total = np.concatenate([zero, np.cumsum(centred, axis=0)])
    squares = np.concatenate([zero, np.cumsum(centred**2, axis=0)])
    mean = (total[starts + width] - total[starts]) / width
    return np.asarray(np.maximum((squares[starts + width] - squares[starts]) / width - mean**2, 0.0))


def _least_step(column: Array) -> float:
    """The smallest change between successive readings that is one: about a count."""
    steps = np.abs(np.diff(column[np.isfinite(column)]))
    steps = steps[steps > 0.0]
    return float(steps.min()) if steps.size else 0.0


def _stretches(starts: NDArray[np.int_], calm: NDArray[np.bool_], width: int) -> list[tuple[int, int]]:
    """Samples of windows in a row that are calm, first and last (not among them)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], calm, [False]]).astype(np.int8)))
    out: list[tuple[int, int]] = []
    for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        first, last = int(starts[a]), int(starts[b - 1]) + width
        if out and first < out[-1][1]:  # two rows of windows over one sample: a jolt within a rest
            first = out[-1][1]
        if last - first >= width:
            out.append((first, last))
    return out


def _spread_of_blocks(run: Run, stretches: Sequence[tuple[int, int]]) -> Array:
    """Variance of the means of half-second blocks within rests, all rests together, shape (6,)."""
    size = max(4, round(_BLOCK_S * run.rate_hz))
    total, freedom = np.zeros(6), 0
    for first, last in stretches:
        count = (last - first) // size
        blocks = run.reading[first : first + count * size].reshape(count, size, 6).mean(axis=1)
        total += ((blocks - blocks.mean(axis=0)) ** 2).sum(axis=0)
        freedom += count - 1
    return np.asarray(total / max(1, freedom))


def _rest(run: Run, first: int, last: int, spread: Array) -> Rest:
    size = max(4, round(_BLOCK_S * run.rate_hz))
    mean = np.where(recorded(run), run.reading[first:last].mean(axis=0), np.nan)
    seconds = float(run.t[last - 1] - run.t[first]) + 1.0 / run.rate_hz
    return Rest(first, last, float(run.t[first]), seconds, mean, spread * size / (last - first))


def distinct_directions(rests: Sequence[Rest]) -> int:
    """How many directions of specific force differ from each other by 10° or more."""
    kept: list[Array] = []
    for rest in rests:
        force = rest.mean[list(ACCELS)]
        direction = force / np.linalg.norm(force)
        if all(np.arccos(np.clip(direction @ other, -1.0, 1.0)) >= _DISTINCT for other in kept):
            kept.append(direction)
    return len(kept)


def power_ons(runs: Sequence[Run]) -> tuple[tuple[str, ...], NDArray[np.int_]]:
    """Name of the first run of each power-on, and the number of each run's."""
    keys = [run.power_on or f"run {number}" for number, run in enumerate(runs)]
    first = list(dict.fromkeys(keys))
    return tuple(runs[keys.index(key)].name for key in first), np.array([first.index(key) for key in keys])


def has(run: Run, channels: Sequence[int]) -> bool:
    """Whether all of some channels were recorded."""
    return bool(recorded(run)[list(channels)].all())
