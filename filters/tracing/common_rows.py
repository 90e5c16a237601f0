"""Residuals of all channels on one grid of seconds, in stretches at rest: what causes shared by channels are sought in.

What was selected is taken off but for what happens within a run only: a step that a table's tilt makes is a cause that
channels share. Drift stays in. Rows where the table turns are left out: what follows motion is in the log.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from filters.channels import CHANNELS
from filters.effects.run_specific import Step, Telegraph
from filters.tracing.selection import Selection
from filters.types import Array

_ROW_S = 1.0
_MOST = 20_000
_BRIDGED = 5  # rows: a longer gap ends a stretch
_LEAST = 32


@dataclass(frozen=True, slots=True)
class Stretch:
    """Rows of one run in unbroken order, `first` to `end` of its grid."""

    run: int
    first: int
    end: int


@dataclass(frozen=True)
class Rows:
    """Residuals on a grid."""

    period: float  # of a row, s
    channels: tuple[int, ...]  # those with data
    # of each run, SI, shape (n, 6), NaN where there is none; row k is from k to k + 1 periods after its start
    residual: tuple[Array, ...]
    white: Array  # variance of a full row's white noise, SI, shape (6,)
    stretches: tuple[Stretch, ...]  # where the table rests and there are data

    def of(self, stretch: Stretch) -> Array:
        """Rows of a stretch, shape (n, 6)."""
        return self.residual[stretch.run][stretch.first : stretch.end]

    def without(self, run: int, first: int, end: int) -> "Rows":
        """The same with a stretch cut where rows `first` to `end` of a run lie in it."""
        left: list[Stretch] = []
        for s in self.stretches:
            if s.run != run or s.end <= first or end <= s.first:
                left.append(s)
                continue
            left += [Stretch(run, s.first, first), Stretch(run, end, s.end)]
        return replace(self, stretches=tuple(s for s in left if s.end - s.first >= _LEAST))


def rows_of(chosen: Selection, channels: Sequence[int]) -> Rows:
    """Residuals of a selection's runs on a grid of 1 s, or of so much that no more than 20 000 rows come of it."""
    stack = chosen.design.stack
    period = max(_ROW_S, stack.period, stack.t.size * stack.period / _MOST)
    values = _unexplained(chosen, channels)
    white = np.full(len(CHANNELS), np.nan)
    residual, stretches = [], []
    ends = np.append(stack.starts[1:], stack.t.size)
    for number, (a, b) in enumerate(zip(stack.starts.tolist(), ends.tolist(), strict=True)):
        place = (stack.part_t[a:b] / period).astype(np.int64)
        weight = stack.weight[a:b]
        count = int(place[-1]) + 1
        own = np.full((count, len(CHANNELS)), np.nan)
        for c in channels:
            total = np.bincount(place, weight[:, c], count)
            with np.errstate(invalid="ignore", divide="ignore"):
                mean = np.bincount(place, weight[:, c] * values[a:b, c], count) / total
            own[:, c] = np.where(total > 0.5 * period / stack.period, mean, np.nan)
        moving = np.bincount(place, _moves(chosen, number), count) > 0.0
        own[moving] = np.nan
        residual.append(own)
        stretches += _stretches(number, np.isfinite(own[:, list(channels)]).any(axis=1))
    for c in channels:
        white[c] = np.median(chosen.design.variance(c)[stack.weight[:, c] > 0.0]) * stack.period / period
    return Rows(period, tuple(channels), tuple(residual), white, tuple(stretches))


def filled(x: Array, least: float) -> Array:
    """Missing rows by straight lines; a channel with a share of at most `least` of its rows is left out, as zeros."""
    out = np.zeros_like(x)
    k = np.arange(len(x))
    for c in range(x.shape[1]):
        good = np.isfinite(x[:, c])
        if good.sum() > least * len(x):
            out[:, c] = np.interp(k, k[good], x[good, c])
    return out


def _unexplained(chosen: Selection, channels: Sequence[int]) -> Array:
    """Residuals less lasting effects and tones, SI, shape (n, 6)."""
    design = chosen.design
    out = np.zeros_like(design.stack.y)
    fit = chosen.fit()
    for c in channels:
        out[:, c] = design.stack.y[:, c]
    for term, theta in zip(fit.terms, fit.theta, strict=True):
        if not isinstance(term.hypothesis, Step | Telegraph):
            for c, places in term.places.items():
                out[:, c] -= design.columns[:, places] @ theta
    return out


def _moves(chosen: Selection, run: int) -> Array:
    """1 for every block of a run in which the table turns, else 0."""
    blocks = chosen.design.stack.blocks[run]
    if blocks.run.still:
        return np.zeros(blocks.t.size)
    return np.asarray(blocks.slow_inputs.since_motion <= 0.0, np.float64)


def _stretches(run: int, have: NDArray[np.bool_]) -> list[Stretch]:
    """Rows with data, gaps of a few rows bridged."""
    rows = np.flatnonzero(have)
    if not rows.size:
        return []
    breaks = np.flatnonzero(np.diff(rows) > _BRIDGED + 1)
    firsts = rows[np.append(0, breaks + 1)]
    ends = rows[np.append(breaks, rows.size - 1)] + 1
    return [Stretch(run, int(a), int(b)) for a, b in zip(firsts, ends, strict=True) if b - a >= _LEAST]
