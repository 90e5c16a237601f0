"""Two-level noise of a channel that drifts: levels and drift in turns, for the levels move with it.

The drift is taken for a moving mean of what the levels leave; several lengths of the mean are tried, and the likelihood
with drift fitted on both sides says which is best. What it leaves out: noise of more than two levels.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from filters.effects import run_specific
from filters.effects.run_specific import Telegraph
from filters.tracing.beside_drift import Rows, gain_beside, of_columns, rows_of
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design
from filters.types import Array

_MEANS_S = (60.0, 180.0, 600.0)
_TURNS = 3
_SWITCHES = 6
"""In each of two power-ons, twice as many in a single one: drift has a few sudden turns of its own."""
_SURE = 4.0


def telegraph(design: Design, selection: Sequence[Term], channel: int) -> tuple[Telegraph, float] | None:
    """The most likely two levels beside drift, and their gain.

    `design`: data, columns, and the channel's drift.
    `selection`: what is selected.
    Returns none if nothing switches often enough.
    """
    rows = rows_of(design, [], channel, design.unexplained(selection, channel)[:, None])
    found = []
    for seconds in _MEANS_S:
        effect = _levels(rows, channel, seconds)
        if effect is not None and _goes_on(effect.made[:, 0], rows.starts):
            made = _at_blocks(design, rows, effect.made)
            own = Telegraph(channel, made=made, penalty=effect.penalty, facts=effect.facts, switches=effect.switches)
            gain = gain_beside(design, selection, channel, made)
            if gain > own.penalty and _is_one_size(design, selection, channel, made[:, 0]):
                found.append((own, gain))
    return max(found, key=lambda pair: pair[1] - pair[0].penalty, default=None)


def _levels(rows: Rows, channel: int, seconds: float) -> Telegraph | None:
    """Two levels of what a moving mean leaves, the mean being of what the levels leave."""
    r, sd = rows.values[:, 1], np.sqrt(rows.variance)
    use = np.isfinite(sd)
    half = max(1, round(0.5 * seconds / rows.seconds))
    drift = _moving_mean(r, use, rows.starts, half)
    effect = None
    for _ in range(_TURNS):
        effect = run_specific.telegraph(channel, r - drift, sd, rows.starts)
        if effect is None:
            return None
        s = effect.made[:, 0]
        high = s > 0.5
        size = float(np.mean((r - drift)[high & use]) - np.mean((r - drift)[~high & use]))
        drift = _moving_mean(r - size * s, use, rows.starts, half)
    return effect


def _goes_on(s: Array, starts: NDArray[np.int_]) -> bool:
    """Whether levels switch time and again, in two power-ons if there are two: else something happened once."""
    counts = sorted(int(np.count_nonzero(np.diff(part))) for part in np.split(s, starts[1:]))
    return counts[-1] >= 2 * _SWITCHES if len(counts) == 1 else counts[-2] >= _SWITCHES


def _is_one_size(design: Design, selection: Sequence[Term], channel: int, s: Array) -> bool:
    """Whether switches that are each fitted alone are no better than one size for all, beyond chance."""
    begins = design.stack.begins
    ends = np.append(begins[1:], s.size)
    switches = np.setdiff1d(np.flatnonzero(np.diff(s)) + 1, begins)
    each = np.zeros((s.size, switches.size))
    for j, row in enumerate(switches.tolist()):
        each[row : ends[np.searchsorted(begins, row, side="right") - 1], j] = s[row] - s[row - 1]
    columns = np.column_stack([s, each])
    judged = of_columns(design, selection, channel, columns, [np.array([0]), np.arange(1, columns.shape[1])])
    k = int(np.argmin(judged.values - judged.gains[:, 0]))
    more = float(judged.gains[k, 1] - judged.gains[k, 0])
    free = max(1, switches.size - 1)
    return more < free + _SURE * float(np.sqrt(2.0 * free))


def _moving_mean(r: Array, use: NDArray[np.bool_], starts: NDArray[np.int_], half: int) -> Array:
    """Mean over `half` rows either way, within each power-on."""
    out = np.empty_like(r)
    for part in np.split(np.arange(r.size), starts[1:]):
        weight = use[part].astype(np.float64)
        sums, counts = (np.concatenate([[0.0], np.cumsum(x)]) for x in (weight * r[part], weight))
        first = np.maximum(np.arange(part.size) - half, 0)
        last = np.minimum(np.arange(part.size) + half + 1, part.size)
        out[part] = (sums[last] - sums[first]) / np.maximum(counts[last] - counts[first], 1.0)
    return out


def _at_blocks(design: Design, rows: Rows, made: Array) -> Array:
    """Levels of rows at the blocks, shape (n, 1)."""
    stack = design.stack
    number = np.searchsorted(rows.starts, np.arange(rows.t.size), side="right") - 1
    out = np.empty((stack.t.size, 1))
    for k in range(rows.starts.size):
        own, block = number == k, stack.power_on == k
        nearest = np.searchsorted(0.5 * (rows.t[own][1:] + rows.t[own][:-1]), stack.t[block])
        out[block, 0] = made[own, 0][nearest]
    return out
