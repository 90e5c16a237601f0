"""What a term gains on cells that its fit has not seen: five folds of 20 s cells, all fitted on the others."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from filters.tracing.columns import Term
from filters.tracing.design_matrix import VISIBLE, Design, first_parameters, inverse_of, parameters_on
from filters.tracing.stack import FOLDS
from filters.tracing.whitening import Drift, whiten
from filters.types import Array

_Part = tuple[int, Array, NDArray[np.int_]]  # a channel, its residual and columns, and which parameters those are


def unseen_gain(
    design: Design,
    selection: Sequence[Term],
    term: Term,
    made: Array | None = None,
    drifts: Sequence[Drift] | None = None,
    spared: int = 1,
) -> tuple[float, float]:
    """Gain of a term on cells that its fit has not seen, over five folds, and the same without its best cells.

    Both fits, without and with it, are joint over all channels that shared effects tie to the term's.

    `design`: data and columns.
    `selection`: what is there already.
    `term`: the new one.
    `made`: columns of its own, shape (n, k), of one that is not in the design.
    `drifts`: of the six channels; by default the design's.
    `spared`: how many best cells are left out of the second figure.
    """
    drifts = design.drift if drifts is None else drifts
    stack, tied = design.stack, _tied(selection, term)
    terms = [*(a for a in selection if set(a.places) & tied), term]
    ends = [*first_parameters(terms), sum(a.size for a in terms)]
    parts: list[_Part] = []
    for c in sorted(tied):
        rows, _ = parameters_on(terms, ends, c)
        _, places = parameters_on(terms[:-1], ends, c)
        own = [] if c not in term.places else [design.columns[:, term.places[c]] if made is None else made]
        parts.append((c, np.column_stack([stack.y[:, c], design.columns[:, places], *own]), rows))
    cells = np.zeros(int(stack.cell[-1]) + 1)
    for fold in range(FOLDS):
        cells += _of_fold(design, drifts, parts, ends, stack.cell % FOLDS != fold, cells.size)
    return float(cells.sum()), float(np.sort(cells)[:-spared].sum())


def _of_fold(
    design: Design,
    drifts: Sequence[Drift],
    parts: Sequence[_Part],
    ends: Sequence[int],
    train: NDArray[np.bool_],
    count: int,
) -> Array:
    """Gain of the last term in each cell that a fold's fit has not seen, shape (count,)."""
    n, test = ends[-1], ~train
    A, b, unseen = np.zeros((n, n)), np.zeros(n), []
    for c, raw, rows in parts:
        fitted, judged = _whitened(design, drifts[c], raw, c, train)
        X = fitted[train, 1:]
        A[np.ix_(rows, rows)] += X.T @ X
        b[rows] += X.T @ fitted[train, 0]
        unseen.append((judged, rows))
    old, new = np.zeros(n), inverse_of(A) @ b
    old[: ends[-2]] = inverse_of(A[: ends[-2], : ends[-2]]) @ b[: ends[-2]]
    cells = np.zeros(count)
    for W, rows in unseen:
        before, after = (W[test, 0] - W[test, 1:] @ theta[rows] for theta in (old, new))
        cells += np.bincount(design.stack.cell[test], before**2 - after**2, count)
    return cells


def _whitened(design: Design, drift: Drift, raw: Array, channel: int, train: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Columns whitened for the fit as if the other cells were missing, and for judging those cells.

    Without drift each power-on's bias is that of the fitted cells: one of all cells tells them of the others. With
    drift the filter goes by the past; its memory of a cell that was left out is no part of the fit.
    """
    stack, variance = design.stack, design.variance(channel)
    if drift.level > 0.0:
        missing = np.where(train, variance, np.inf)
        fitted = whiten(raw, stack.t, stack.begins, missing, drift)[0]
        return fitted, design.white(raw, channel, drift)
    root = 1.0 / np.sqrt(variance)
    fitted = np.where(train, root, 0.0)
    total = np.maximum(np.bincount(stack.power_on, fitted**2), 1e-300)
    out = np.empty_like(raw)
    for j in range(raw.shape[1]):
        mean = np.bincount(stack.power_on, fitted**2 * raw[:, j]) / total
        out[:, j] = root * (raw[:, j] - mean[stack.power_on])
        # columns that the fitted cells don't see say nothing of the others
        if j and np.sum(out[train, j] ** 2) <= VISIBLE * np.sum(out[:, j] ** 2):
            out[:, j] = 0.0
    return out, out


def _tied(selection: Sequence[Term], term: Term) -> set[int]:
    """Channels of a term, and all that shared effects of a selection tie to them."""
    tied, more = set(term.places), True
    while more:
        wider = tied.union(*(a.places for a in selection if tied & set(a.places)))
        more, tied = wider > tied, wider
    return tied
