"""The best tone, step and two-level noise of a channel beside what is selected, and what each gains."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from filters.effects import run_specific
from filters.effects.run_specific import RunSpecific, Step, Telegraph, Tone
from filters.tracing.beside_drift import Solver, alone, gain_beside, of_columns, rows_of
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design
from filters.tracing.whitening import Drift, Rows, unbiased
from filters.types import Array

_BAND = 0.01  # of the frequency: tones nearer together are one narrow band
_TONES_A_BAND = 3


def search(design: Design, terms: Sequence[Term], channel: int) -> list[tuple[Term, float]]:
    """Run-specific effects of a channel that are not selected yet.

    Returns each with its gain. Its columns are its hypothesis' `made`; its places number them, none is in the design.
    """
    stack = design.stack
    on = [a for a in terms if channel in a.places]
    white, variance = design.residual(terms, channel), design.variance(channel)
    r = design.unexplained(terms, channel)
    plain = unbiased(r[:, None], stack.power_on, variance)[:, 0]
    own = np.concatenate([a.places[channel] for a in on]) if on else np.zeros(0, int)
    basis = np.zeros((stack.t.size, 0))
    if own.size:
        basis = np.linalg.qr(unbiased(design.columns[:, own], stack.power_on, variance))[0]
    made: list[RunSpecific | None] = [
        run_specific.tone(channel, white, stack.t, stack.starts, stack.period, run_specific.TONE_HZ)
    ]
    if design.drift[channel].level > 0.0:
        return _new(terms, on, [(x, _gain(design, x, own)) for x in made if x]) + _new(
            terms, on, _beside_drift(design, terms, channel)
        )
    if _uneven(plain):
        made.append(run_specific.step(channel, plain, basis, stack.t, stack.begins))
        own_bias = stack.power_on
        mean = np.bincount(own_bias, r / variance) / np.maximum(np.bincount(own_bias, 1.0 / variance), 1e-300)
        made.append(run_specific.telegraph(channel, r - mean[own_bias], np.sqrt(variance), stack.begins))
    return _new(terms, on, [(x, _gain(design, x, own)) for x in made if x])


def _beside_drift(design: Design, terms: Sequence[Term], channel: int) -> list[tuple[RunSpecific, float]]:
    """A step and two-level noise, drift fitted with and without them."""
    found: list[tuple[RunSpecific, float]] = []
    step = step_on_drift(design, terms, channel)
    if step is not None:
        found.append((step, gain_beside(design, terms, channel, step.made)))
    levels = telegraph(design, terms, channel)
    return found if levels is None else [*found, levels]


def _new(
    terms: Sequence[Term], on: Sequence[Term], found: Sequence[tuple[RunSpecific, float]]
) -> list[tuple[Term, float]]:
    """Those that are not selected yet, as terms."""
    taken = {a.key for a in terms}
    made = [
        (Term(effect, {effect.channel: np.arange(effect.made.shape[1])}), gain)
        for effect, gain in found
        if not _crowded(on, effect)
    ]
    return [(term, gain) for term, gain in made if term.key not in taken]


def _crowded(on: Sequence[Term], effect: RunSpecific) -> bool:
    """Whether so many tones are here already that one more is part of a narrow band, not a tone of its own."""
    if not isinstance(effect, Tone):
        return False
    tones = [a.hypothesis for a in on if isinstance(a.hypothesis, Tone)]
    return sum(abs(tone.hz - effect.hz) < _BAND * effect.hz for tone in tones) >= _TONES_A_BAND


def _uneven(white: Array) -> bool:
    """Whether sums over 16 rows vary more than white noise lets them: else there is no step to look for."""
    size = white.size // 16 * 16
    sums = white[:size].reshape(-1, 16).sum(axis=1)
    return bool(float(sums @ sums) / max(1, sums.size) / 16.0 > 1.0 + 2.0 * np.sqrt(2.0 / max(1, sums.size)))


def _gain(design: Design, effect: RunSpecific, own: Array) -> float:
    """Drop of chi-square when an effect joins the columns `own` on its channel."""
    c, made = effect.channel, effect.made
    W = design.white(np.column_stack([design.stack.y[:, c], design.columns[:, own.astype(int)], made]), c)
    return float(Solver([np.arange(made.shape[1])])(W, own.size, float(design.variance(c).min()))[1][0])


# -------------------------------------------------------------------------------------------------- step beside drift
# a step of a channel that drifts: sought in what is whitened, for a drift takes a clean step for its own.
#
# Steps are tried every few seconds, of one power-on and of all at the same time, on coarse rows under the drift as it
# is
# and weaker ones; the best is then placed to a block. What it leaves out: steps of a constant bias
# (`effects.run_specific`), and whether it is one (`selection`).

_WEAKER = (1.0, 0.5, 0.25, 0.1)  # of the drift as it is: a step that is taken for drift makes it stronger
_TRIED = 300
_AT_ONCE = 3_000_000  # numbers that are whitened together
_LEAST_S = 4.0
_END_S = 3.0  # nearer to an end of a power-on a step is no more than a few odd readings


def step_on_drift(design: Design, selection: Sequence[Term], channel: int) -> Step | None:
    """The most likely step beside drift.

    Returns none if no power-on is long enough.
    """
    stack = design.stack
    rows = rows_of(design, selection, channel)
    number = np.searchsorted(rows.starts, np.arange(rows.t.size), side="right") - 1
    places = _places(rows, number)
    if not places:
        return None
    columns = np.stack([_of(rows.t, number, *place) for place in places], axis=1)
    _, k, drift = min(_best(rows, columns, own) for own in _weaker(design.drift[channel]))
    at, which = places[k]
    spacing = _spacing(rows)
    near = np.arange(at - spacing, at + spacing, stack.period)
    near = near[(near > at - spacing) & _inside(rows, near, which)]
    if not near.size:
        return None
    own = [design.columns[:, a.places[channel]] for a in selection if channel in a.places]
    raw = np.column_stack([design.unexplained(selection, channel), *own])
    gains, least = [], float(design.variance(channel).min())
    # a day has a thousand places to try, and each is a column as long as the day
    for part in np.array_split(near, -(-near.size * stack.t.size // _AT_ONCE)):
        fine = [_of(stack.t, stack.power_on, x, which) for x in part.tolist()]
        W = design.white(np.column_stack([raw, *fine]), channel, drift)
        gains.append(alone(W, raw.shape[1] - 1, least)[1])
    at = float(near[int(np.argmax(np.concatenate(gains)))])
    return Step.of(channel, at, which, _of(stack.t, stack.power_on, at, which)[:, None])


def _weaker(drift: Drift) -> list[Drift]:
    return [Drift(drift.tau, share * drift.level) for share in _WEAKER]


def _spacing(rows: Rows) -> float:
    ends = np.append(rows.starts[1:], rows.t.size) - 1
    return max(_LEAST_S, float(np.sum(rows.t[ends] - rows.t[rows.starts])) / _TRIED)


def _places(rows: Rows, number: NDArray[np.int_]) -> list[tuple[float, int]]:
    """Instants and the power-on of steps to try; -1: in all."""
    spacing = _spacing(rows)
    count = rows.starts.size
    out = []
    for which in (*range(count), *([-1] if count > 1 else [])):
        last = max(float(rows.t[number == k].max()) for k in range(count) if which in (k, -1))
        tried = np.arange(spacing, last, spacing)
        out += [(x, which) for x in tried[_inside(rows, tried, which)].tolist()]
    return out


def _inside(rows: Rows, at: Array, which: int) -> NDArray[np.bool_]:
    """Whether instants are far enough from the ends of a power-on, or of one at least."""
    ends = np.append(rows.starts[1:], rows.t.size) - 1
    first, last = rows.t[rows.starts] + _END_S, rows.t[ends] - _END_S
    inside = (at[:, None] > first) & (at[:, None] < last)
    return np.asarray(inside.any(axis=1) if which < 0 else inside[:, which], np.bool_)


def _of(t: Array, number: NDArray[np.int_], at: float, which: int) -> Array:
    """A step at an instant, shape (n,)."""
    return np.asarray((t >= at) & ((number == which) | (which < 0)), np.float64)


def _best(rows: Rows, columns: Array, drift: Drift) -> tuple[float, int, Drift]:
    """-2 log likelihood with the best step under a drift, its number, the drift."""
    W, log_det = replace(rows, values=np.hstack([rows.values, columns])).whitened(drift)
    left, gains = alone(W, rows.selected, float(rows.variance.min()))
    k = int(np.argmax(gains))
    return left + log_det - float(gains[k]), k, drift


# --------------------------------------------------------------------------------------------- telegraph beside drift
# Two-level noise of a channel that drifts: levels and drift in turns, for the levels move with it.
#
# The drift is taken for a moving mean of what the levels leave; several lengths of the mean are tried, and the
# likelihood
# with drift fitted on both sides says which is best. What it leaves out: noise of more than two levels.

_MEANS_S = (60.0, 180.0, 600.0)
_TURNS = 3
_SWITCHES = 6  # in each of two power-ons, twice as many in a single one: drift has a few sudden turns of its own
_SURE = 4.0


def telegraph(design: Design, selection: Sequence[Term], channel: int) -> tuple[Telegraph, float] | None:
    """The most likely two levels beside drift, and their gain.

    Returns none if nothing switches often enough.
    """
    rows = rows_of(design, [], channel, design.unexplained(selection, channel)[:, None])
    found = []
    for seconds in _MEANS_S:
        effect = _levels(rows, channel, seconds)
        if effect is not None and _goes_on(effect.made[:, 0], rows.starts):
            made = _at_blocks(design, rows, effect.made)
            own = replace(effect, made=made)
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
