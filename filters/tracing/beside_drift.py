"""Terms of a channel judged beside drift: how likely the data are under each drift of a grid, without and with a term.

Drift and a slow effect are made of the same frequencies. A drift that was fitted before the effect was thought of has
already taken its part, so the two are compared with drift fitted anew on both sides:

    gain = min over drifts of -2 log L without the term - min over drifts of -2 log L with it

All terms are whitened at once for each drift, on rows that are as coarse as slow effects allow. What it leaves out:
sums of two drifts (`drift_guard`), effects of motion, which such rows would lose.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.tracing.columns import Term
from filters.tracing.design_matrix import VISIBLE, Design, inverse_of
from filters.tracing.drift_guard import by_seconds, drift_price
from filters.tracing.whitening import NONE, Drift, drift_grid, whiten
from filters.types import Array

_ROWS = 2000
"""Rows at most of the runs together; never shorter than a second."""
_SECOND_S = 1.0


_Numbers = NDArray[np.int_]


@dataclass(frozen=True)
class BesideDrift:
    """A channel under every drift of a grid."""

    drifts: tuple[Drift, ...]  # none first
    values: Array  # -2 log likelihood under each with what is selected, shape (m,)
    gains: Array  # how much a term lowers it, shape (m, terms)
    price: Array  # what each drift costs, shape (m,)

    @property
    def gain(self) -> Array:
        """Of each term, drift fitted on both sides, shape (terms,)."""
        return np.asarray(self.values.min() - (self.values[:, None] - self.gains).min(axis=0))

    def drift_with(self, number: int) -> Drift:
        """The best drift beside a term, what it costs counted."""
        return self.drifts[int(np.argmin(self.values - self.gains[:, number] + self.price))]

    def likeliest_with(self, number: int) -> Drift:
        """The likeliest drift beside a term, whatever it costs."""
        return self.drifts[int(np.argmin(self.values - self.gains[:, number]))]


def is_judged(term: Term) -> bool:
    """Whether a term is slow enough, and on one channel."""
    return len(term.places) == 1 and term.hypothesis.is_slow


def beside_drift(
    design: Design, selection: Sequence[Term], channel: int, terms: Sequence[tuple[Term, ...]]
) -> BesideDrift:
    """Judge terms of a channel beside drift.

    `design`: data and columns.
    `selection`: what is selected; what several channels share stays as it is fitted.
    `terms`: of that channel alone, slow; of several the gain of all together.
    """
    places = [np.concatenate([a.places[channel] for a in group]) for group in terms]
    distinct, inverse = np.unique(np.concatenate([np.zeros(0, int), *places]), return_inverse=True)
    ends = np.cumsum([0, *(p.size for p in places)])
    groups = [inverse[a:b] for a, b in itertools.pairwise(ends.tolist())]
    return of_columns(design, selection, channel, design.columns[:, distinct], groups)


def of_columns(
    design: Design, selection: Sequence[Term], channel: int, columns: Array, groups: Sequence[_Numbers]
) -> BesideDrift:
    """As `beside_drift`, of columns that need not be in the design: a term is a group of their numbers."""
    rows = rows_of(design, selection, channel, columns)
    scale = np.sqrt(np.mean(rows.values**2, axis=0))
    scaled = rows.values / np.where(scale > 0.0, scale, 1.0)
    scaled[:, 0] *= scale[0]
    finite = rows.variance[np.isfinite(rows.variance)]
    drifts = (NONE, *drift_grid(float(np.sqrt(np.median(finite) * rows.seconds))))
    values, gains = np.empty(len(drifts)), np.empty((len(drifts), len(groups)))
    solver = _Solver(groups)
    seen = np.zeros(0)
    for k, drift in enumerate(drifts):
        W, log_det = whiten(scaled, rows.t, rows.starts, rows.variance, drift)
        if k == 0:
            seen = np.sum(W[:, 1 + rows.selected :] ** 2, axis=0)
        left, gains[k] = solver(W, rows.selected, seen, float(finite.min()))
        values[k] = left + log_det
    cost = drift_price(design, channel)
    less = float(np.log(design.stack.seconds(channel)))
    price = np.array([0.0 if d.level == 0.0 else cost - less * d.is_walk for d in drifts])
    return BesideDrift(drifts, values, gains, price)


def gain_beside(design: Design, selection: Sequence[Term], channel: int, columns: Array) -> float:
    """Gain of columns together, drift fitted with and without them."""
    judged = of_columns(design, selection, channel, columns, [np.arange(columns.shape[1])])
    return float(judged.gain[0])


def fitted_beside(
    design: Design, selection: Sequence[Term], channel: int, columns: Array, drift: Drift
) -> tuple[Array, Array]:
    """Parameters of columns on a channel under a drift, and their covariance; shapes (k,), (k, k)."""
    rows = rows_of(design, selection, channel, columns)
    selected = rows.selected
    W, _ = whiten(rows.values, rows.t, rows.starts, rows.variance, drift)
    inverse = inverse_of(W[:, 1:].T @ W[:, 1:])
    return (inverse @ (W[:, 1:].T @ W[:, 0]))[selected:], inverse[selected:, selected:]


@dataclass(frozen=True)
class Rows:
    """A channel averaged over a second or more."""

    values: Array  # residual, columns of what is selected, other columns, SI, shape (m, 1 + selected + k)
    t: Array  # s since power-on, shape (m,)
    starts: _Numbers  # first row of each power-on
    variance: Array  # of the white noise of each row, infinite where there is no data, shape (m,)
    selected: int  # how many columns of what is selected there are
    seconds: float  # length of a row


def rows_of(design: Design, selection: Sequence[Term], channel: int, columns: Array) -> Rows:
    """Rows of a channel's residual, of the columns of what is selected there, and of others.

    What several channels share is taken off as the selection's joint fit has it.
    """
    stack = design.stack
    y = stack.y[:, channel].copy()
    fit = design.fit(selection)
    for term, theta in zip(fit.terms, fit.theta, strict=True):
        if channel in term.places and len(term.places) > 1:
            y -= design.columns[:, term.places[channel]] @ theta
    own = [design.columns[:, a.places[channel]] for a in selection if list(a.places) == [channel]]
    raw = np.column_stack([y, *own, columns])
    seconds = max(_SECOND_S, stack.seconds(channel) / _ROWS, stack.period)
    return Rows(*by_seconds(design, channel, raw, seconds), sum(x.shape[1] for x in own), seconds)


class _Solver:
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

    def __call__(self, W: Array, selected: int, seen: Array, least: float) -> tuple[float, Array]:
        """Squared norm left by what is selected, and what each group takes of it."""
        y, S, X = W[:, 0], W[:, 1 : 1 + selected], W[:, 1 + selected :]
        SX, inverse = S.T @ X, inverse_of(S.T @ S)
        fitted = inverse @ (S.T @ y)
        left = float(y @ y - (S.T @ y) @ fitted)
        own = np.einsum("ij,ij->j", X, X) - np.einsum("ij,ij->j", SX, inverse @ SX)
        d = X.T @ y - SX.T @ fitted
        # what varies by rounding only beside the bias and what is selected says nothing
        visible = own > np.maximum(VISIBLE * VISIBLE * seen, 1e-9 * len(W) / least)
        alone = np.where(visible, d**2 / np.maximum(own, 1e-300), 0.0)
        gains = np.empty(self._single.size + self._double.size + self._wide.size)
        gains[self._single] = alone[self._one]
        j = self._joint
        Xj, Sj = X[:, j], SX[:, j]
        G = Xj.T @ Xj - Sj.T @ inverse @ Sj
        gains[self._double] = _of_two(G, d[j], own[j], alone[j], visible[j], *self._pair)
        gains[self._wide] = [_gain(G[np.ix_(g, g)], d[j[g]], visible[j[g]]) for g in self._many]
        return left, gains


def _of_two(
    G: Array, d: Array, own: Array, alone: Array, visible: NDArray[np.bool_], i: _Numbers, j: _Numbers
) -> Array:
    """Gains of pairs of columns; the better one's where they are one and the same."""
    cross = G[i, j]
    det = own[i] * own[j] - cross**2
    apart = visible[i] & visible[j] & (det > VISIBLE * own[i] * own[j])
    both = d[i] ** 2 * own[j] - 2.0 * d[i] * d[j] * cross + d[j] ** 2 * own[i]
    return np.asarray(np.where(apart, both / np.where(apart, det, 1.0), np.maximum(alone[i], alone[j])))


def _gain(G: Array, d: Array, visible: NDArray[np.bool_]) -> float:
    if not visible.any():
        return 0.0
    G, d = G[np.ix_(visible, visible)], d[visible]
    root = np.sqrt(np.diag(G))
    values, vectors = np.linalg.eigh(G / np.outer(root, root))
    keep = values > VISIBLE * values[-1]
    return float(np.sum((vectors[:, keep].T @ (d / root)) ** 2 / values[keep]))
