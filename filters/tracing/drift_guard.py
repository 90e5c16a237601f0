"""Whether drift would do as well: the likeliest process of a channel, a term's score when both models have theirs."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from filters.effects.run_specific import Tone
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design, Fit
from filters.tracing.whitening import Drift, DriftPairs, best_drift, refined
from filters.types import Array

_DRIFT_GRID = 20.0
_SECOND_S = 1.0
_ROWS = 2000.0
"""Rows at most of a channel, for what is slow."""
_FAST_HZ = 0.2
"""Faster tones are lost in means of 1 s."""

_Rows = tuple[Array, Array, NDArray[np.int_], Array, float]  # the arguments of `best_drift`
_Best = tuple[float, Drift, float]  # what it returns


def drift_price(design: Design, channel: int) -> float:
    """What two parameters of a drift and its choice cost on a channel, in chi-square."""
    return 2.0 * float(np.log(design.stack.seconds(channel))) + 2.0 * float(np.log(_DRIFT_GRID))


def likeliest_drift(design: Design, terms: Sequence[Term], channel: int) -> tuple[float, Drift]:
    """Gain of the best drift process of a channel beside what is selected, and the process."""
    rows = _rows(design, terms, channel, np.zeros((design.stack.t.size, 0)), design.fit(terms))
    best, drift, none = best_drift(*rows)
    walk = best_drift(*rows, taus=(np.inf,))
    # a walk has one parameter less
    if walk[0] - best < np.log(design.stack.seconds(channel)):
        best, drift = walk[0], walk[1]
    return none - best, refined(*rows[:4], drift, best)


def guarded_score(
    design: Design, terms: Sequence[Term], term: Term, made: Array | None, price: float, accept: float
) -> float:
    """Score of a term of one channel when both models have their own best drift.

    Of one process or, if that passes, of two, for what is like 1/f needs more than one.

    `design`: data and columns.
    `terms`: what is selected already.
    `term`: the new one.
    `made`: columns of its own, shape (n, k), of one that is not in the design.
    `price`: what its parameters cost.
    `accept`: at most this with one process, and two are not tried.
    """
    (c,) = term.places
    own = made if made is not None else design.columns[:, term.places[c]]
    fast = isinstance(term.hypothesis, Tone) and term.hypothesis.hz > _FAST_HZ
    slow = max(_SECOND_S, design.stack.seconds(c) / _ROWS)
    seconds = design.stack.period if fast else slow
    rows = _rows(design, terms, c, np.zeros((own.shape[0], 0)), design.fit(terms), seconds)
    # columns of its own are not in the design: what is shared stays as it was then
    fit = design.fit(terms if made is not None else [*terms, term])
    with_it = _rows(design, terms, c, own, fit, seconds)
    before, after = (best_drift(*each) for each in (rows, with_it))
    single = min(before[0], before[2]) - min(after[0], after[2]) - price
    if single <= accept or fast:
        return single
    return min(single, _beside_two(rows, with_it, before, after) - price)


def guarded_shared(design: Design, terms: Sequence[Term], term: Term, price: float) -> float:
    """Score of a term that several channels share, each with its own best drift on both sides.

    `design`: data and columns.
    `terms`: what is selected already.
    `term`: the new one; its parameters are those of the joint fit.
    `price`: what they cost.
    """
    fits = design.fit(terms), design.fit([*terms, term])
    # what depends on the attitude is as slow as drift; what depends on rates would be lost in means of a second
    seconds = design.stack.period if term.hypothesis.follows_rates else max(_SECOND_S, design.stack.period)
    none = np.zeros((design.stack.t.size, 0))
    gain = 0.0
    for c in (c for c in term.places if design.sd[c] > 0.0):  # one that lacks data gains nothing
        without, with_it = (best_drift(*_rows(design, terms, c, none, fit, seconds)) for fit in fits)
        gain += min(without[0], without[2]) - min(with_it[0], with_it[2])
    return gain - price


def _beside_two(rows: _Rows, with_it: _Rows, before: _Best, after: _Best) -> float:
    """Gain of a term beside sums of two drifts; each side tries what the other found, so that neither lags behind."""
    without_term, with_term = DriftPairs(*rows), DriftPairs(*with_it)
    for drift in {before[1], after[1]}:
        without_term.search(drift)
        with_term.search(drift)
    for drift in {*with_term.best[1]}:
        without_term.search(drift)
    for drift in {*without_term.best[1]}:
        with_term.search(drift)
    values = [min(one[0], one[2], pairs.best[0]) for one, pairs in ((before, without_term), (after, with_term))]
    return values[0] - values[1]


def _rows(
    design: Design, terms: Sequence[Term], channel: int, more: Array, fit: Fit, seconds: float = _SECOND_S
) -> _Rows:
    """Rows of 1 s, or so many: what is selected on a channel, and more columns; shared effects as in a fit."""
    stack = design.stack
    y = stack.y[:, channel].copy()
    for term, theta in zip(fit.terms, fit.theta, strict=True):
        if channel in term.places and len(term.places) > 1:
            y -= design.columns[:, term.places[channel]] @ theta
    own = [design.columns[:, a.places[channel]] for a in terms if list(a.places) == [channel]]
    raw = np.column_stack([y, *own, more])
    return (*by_seconds(design, channel, raw, seconds), max(seconds, stack.period))


def by_seconds(
    design: Design, channel: int, raw: Array, seconds: float = _SECOND_S
) -> tuple[Array, Array, NDArray[np.int_], Array]:
    """Rows of blocks averaged over so many seconds: columns, time, first row of each power-on, variance."""
    stack = design.stack
    per = max(1, round(seconds / stack.period))
    label = stack.run * (1 << 40) + (stack.part_t // (per * stack.period)).astype(np.int64)
    edges = np.flatnonzero(np.diff(label, prepend=-1))
    precision = 1.0 / design.variance(channel)
    total = np.add.reduceat(precision, edges)
    with np.errstate(invalid="ignore", divide="ignore"):
        rows = np.add.reduceat(raw * precision[:, None], edges, axis=0) / total[:, None]
        variance = 1.0 / total
    t = np.add.reduceat(stack.t, edges) / np.diff(np.append(edges, stack.t.size))
    starts = np.searchsorted(edges, stack.begins)
    return np.nan_to_num(rows), t, starts, variance
