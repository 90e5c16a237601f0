"""Whether drift would do as well: terms judged with drift fitted anew, without and with them.

Drift and a slow effect are made of the same frequencies. A drift that was fitted before the effect was thought of has
already taken its part, so the two are compared with drift fitted on both sides:

    gain = min over drifts of -2 log L without the term - min over drifts of -2 log L with it

`guarded_score` does so for one term that has scored. `of_columns` does it for many at once, under each drift of a grid,
on rows that are as coarse as slow effects allow: effects of motion would be lost in them. Whether a slow effect acts is
told by `evidence`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from filters.effects.run_specific import Tone
from filters.tracing.columns import Term
from filters.tracing.design_matrix import VISIBLE, Design, Fit, gain_of, inverse_of
from filters.tracing.whitening import NONE, Drift, Rows, best_drift, drift_grid, refined
from filters.types import Array

_DRIFT_GRID = 20.0
_SECOND_S = 1.0  # rows are never shorter
_ROWS = 2000.0  # at most of a channel, for what is slow
_FAST_HZ = 0.2  # faster tones are lost in means of 1 s

_Numbers = NDArray[np.int_]


# --------------------------------------------------------------------------------------------------------------- rows


def rows_of(
    design: Design,
    terms: Sequence[Term],
    channel: int,
    more: Array | None = None,
    seconds: float | None = None,
    fit: Fit | None = None,
) -> Rows:
    """Rows of a channel's residual, of the columns of terms that are its own, and of more, shape (n, k).

    What several channels share is taken off as a joint fit has it: `fit`, by default that of the terms. Rows last so
    many seconds, by default as many as slow effects allow.
    """
    stack = design.stack
    y = design.unexplained(terms, channel, fit, only_shared=True)
    own = [design.columns[:, a.places[channel]] for a in terms if list(a.places) == [channel]]
    raw = np.column_stack([y, *own, *([] if more is None else [more])])
    seconds = max(_SECOND_S, stack.seconds(channel) / _ROWS) if seconds is None else seconds
    return by_seconds(design, channel, raw, max(seconds, stack.period), sum(x.shape[1] for x in own))


def by_seconds(design: Design, channel: int, raw: Array, seconds: float, selected: int = 0) -> Rows:
    """Columns, shape (n, k), averaged over so many seconds."""
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
    return Rows(np.nan_to_num(rows), t, starts, variance, seconds, selected)


# --------------------------------------------------------------------------------------------------------- one term


def drift_price(design: Design, channel: int) -> float:
    """What two parameters of a drift and its choice cost on a channel, in chi-square."""
    return 2.0 * float(np.log(design.stack.seconds(channel))) + 2.0 * float(np.log(_DRIFT_GRID))


def likeliest_drift(design: Design, terms: Sequence[Term], channel: int) -> tuple[float, Drift]:
    """Gain of the best drift process of a channel beside what is selected, and the process."""
    rows = rows_of(design, terms, channel, seconds=_SECOND_S)
    best, drift, none = best_drift(rows)
    walk = best_drift(rows, taus=(np.inf,))
    # a walk has one parameter less
    if walk[0] - best < np.log(design.stack.seconds(channel)):
        best, drift = walk[0], walk[1]
    return none - best, refined(rows, drift, best)


def guarded_score(design: Design, terms: Sequence[Term], term: Term, made: Array | None, price: float) -> float:
    """Score of a term of one channel when both models have their own best drift.

    `made`: columns of its own, shape (n, k), of one that is not in the design.
    """
    (c,) = term.places
    own = made if made is not None else design.columns[:, term.places[c]]
    fast = isinstance(term.hypothesis, Tone) and term.hypothesis.hz > _FAST_HZ
    seconds = design.stack.period if fast else None
    # columns of its own are not in the design: what is shared stays as it was then
    fits = design.fit(terms), design.fit(terms if made is not None else [*terms, term])
    rows = [rows_of(design, terms, c, more, seconds, fit) for more, fit in zip((None, own), fits, strict=True)]
    found = [best_drift(each) for each in rows]
    return min(found[0][0], found[0][2]) - min(found[1][0], found[1][2]) - price


def guarded_shared(design: Design, terms: Sequence[Term], term: Term, price: float) -> float:
    """As `guarded_score` of a term that several channels share: each has its own best drift on both sides."""
    fits = design.fit(terms), design.fit([*terms, term])
    # what depends on the attitude is as slow as drift; what depends on rates would be lost in means of a second
    seconds = design.stack.period if term.hypothesis.follows_rates else _SECOND_S
    gain = 0.0
    for c in (c for c in term.places if design.sd[c] > 0.0):  # one that lacks data gains nothing
        without, with_it = (best_drift(rows_of(design, terms, c, None, seconds, fit)) for fit in fits)
        gain += min(without[0], without[2]) - min(with_it[0], with_it[2])
    return gain - price


# ------------------------------------------------------------------------------------------------------ many at once


@dataclass(frozen=True)
class BesideDrift:
    """A channel under every drift of a grid."""

    drifts: tuple[Drift, ...]  # none first
    values: Array  # -2 log likelihood under each with what is selected, shape (m,)
    gains: Array  # how much a term lowers it, shape (m, terms)

    @property
    def gain(self) -> Array:
        """Of each term, drift fitted on both sides, shape (terms,)."""
        return np.asarray(self.values.min() - (self.values[:, None] - self.gains).min(axis=0))

    def likeliest_with(self, number: int) -> Drift:
        """The likeliest drift beside a term, whatever it costs."""
        return self.drifts[int(np.argmin(self.values - self.gains[:, number]))]


def is_judged(term: Term) -> bool:
    """Whether a term is slow enough, and on one channel."""
    return len(term.places) == 1 and term.hypothesis.is_slow


def of_columns(
    design: Design, selection: Sequence[Term], channel: int, columns: Array, groups: Sequence[_Numbers] | None = None
) -> BesideDrift:
    """Judge columns of a channel beside drift and what is selected: a term is a group of their numbers, or all."""
    rows = rows_of(design, selection, channel, columns)
    scale = np.sqrt(np.mean(rows.values**2, axis=0))
    scaled = rows.values / np.where(scale > 0.0, scale, 1.0)
    scaled[:, 0] *= scale[0]
    rows = replace(rows, values=scaled)
    least = float(rows.variance.min())
    drifts = (NONE, *drift_grid(rows.unit))
    groups = [np.arange(columns.shape[1])] if groups is None else groups
    values, gains = np.empty(len(drifts)), np.empty((len(drifts), len(groups)))
    solver = Solver(groups)
    seen = np.zeros(0)
    for k, drift in enumerate(drifts):
        W, log_det = rows.whitened(drift)
        if k == 0:
            seen = np.sum(W[:, 1 + rows.selected :] ** 2, axis=0)
        left, gains[k] = solver(W, rows.selected, least, seen)
        values[k] = left + log_det
    return BesideDrift(drifts, values, gains)


def gain_beside(design: Design, selection: Sequence[Term], channel: int, columns: Array) -> float:
    """Gain of columns together, drift fitted with and without them."""
    return float(of_columns(design, selection, channel, columns).gain[0])


def fitted_beside(
    design: Design, selection: Sequence[Term], channel: int, columns: Array, drift: Drift
) -> tuple[Array, Array]:
    """Parameters of columns on a channel under a drift, and their covariance; shapes (k,), (k, k)."""
    rows = rows_of(design, selection, channel, columns)
    W, _ = rows.whitened(drift)
    inverse = inverse_of(W[:, 1:].T @ W[:, 1:])
    return (inverse @ (W[:, 1:].T @ W[:, 0]))[rows.selected :], inverse[rows.selected :, rows.selected :]


class Solver:
    """Gains of groups of columns beside those that are selected, from whitened rows."""

    def __init__(self, groups: Sequence[_Numbers]) -> None:
        sizes = np.array([g.size for g in groups], int)
        self._single, self._double, self._wide = (np.flatnonzero(x) for x in (sizes == 1, sizes == 2, sizes > 2))
        self._one = np.array([groups[k][0] for k in self._single.tolist()], int)
        self._two = np.array([groups[k] for k in self._double.tolist()], int).reshape(-1, 2).T
        many = [groups[k] for k in self._wide.tolist()]
        # products of columns are formed of those that come together only: hundreds come alone
        self._joint = np.unique(np.concatenate([self._two.ravel(), *many]).astype(int))
        self._pair = np.searchsorted(self._joint, self._two)
        self._many = [np.searchsorted(self._joint, g) for g in many]

    def __call__(self, W: Array, selected: int, least: float, seen: Array | None = None) -> tuple[float, Array]:
        """Squared norm left by what is selected, and what each group takes of it.

        `W`: whitened residual, columns of what is selected, so many, and others, shape (n, 1 + selected + k).
        `least`: variance of the white noise; `seen`: squares of the other columns without drift, by default as here.
        """
        y, S, X = W[:, 0], W[:, 1 : 1 + selected], W[:, 1 + selected :]
        SX, inverse = S.T @ X, inverse_of(S.T @ S)
        fitted = inverse @ (S.T @ y)
        left = float(y @ y - (S.T @ y) @ fitted)
        own = np.einsum("ij,ij->j", X, X) - np.einsum("ij,ij->j", SX, inverse @ SX)
        d = X.T @ y - SX.T @ fitted
        seen = np.sum(X**2, axis=0) if seen is None else seen
        # what varies by rounding only beside the bias and what is selected says nothing
        visible = own > np.maximum(VISIBLE * VISIBLE * seen, 1e-9 * len(W) / least)
        alone = np.where(visible, d**2 / np.maximum(own, 1e-300), 0.0)
        gains = np.empty(self._single.size + self._double.size + self._wide.size)
        gains[self._single] = alone[self._one]
        j = self._joint
        Xj, Sj = X[:, j], SX[:, j]
        G = Xj.T @ Xj - Sj.T @ inverse @ Sj
        gains[self._double] = _of_two(G, d[j], own[j], alone[j], visible[j], *self._pair)
        gains[self._wide] = [gain_of(G[np.ix_(g, g)], d[j[g]], visible[j[g]]) for g in self._many]
        return left, gains


def alone(W: Array, selected: int, least: float) -> tuple[float, Array]:
    """Squared norm left by what is selected, and what each other column takes of it; as of `Solver`."""
    return Solver([np.array([k]) for k in range(W.shape[1] - 1 - selected)])(W, selected, least)


def _of_two(
    G: Array, d: Array, own: Array, alone: Array, visible: NDArray[np.bool_], i: _Numbers, j: _Numbers
) -> Array:
    """Gains of pairs of columns; the better one's where they are one and the same."""
    cross = G[i, j]
    det = own[i] * own[j] - cross**2
    apart = visible[i] & visible[j] & (det > VISIBLE * own[i] * own[j])
    both = d[i] ** 2 * own[j] - 2.0 * d[i] * d[j] * cross + d[j] ** 2 * own[i]
    return np.asarray(np.where(apart, both / np.where(apart, det, 1.0), np.maximum(alone[i], alone[j])))
