"""What a term gains on a power-on that its fit has not seen, each of them left out in turn.

A held-out run judges at the end and decides nothing. With three power-ons or more to learn from, each can be left out
before that: what two of them say of the third. A term that gains nothing so does not carry over, whatever it explains
within each. A power-on of which the others say next to nothing is no witness for or against a term, nor are all of them
together where the term, if it is true, hardly shows on those.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from filters.effects.run_specific import RunSpecific
from filters.tracing.columns import Term
from filters.tracing.design_matrix import VISIBLE, Design, first_parameters, inverse_of, parameters_on
from filters.tracing.stack import FOLDS
from filters.tracing.whitening import Drift, whiten
from filters.types import Array

LEAST = 3  # power-ons that it takes
_UNKNOWN = 2.0
"""Variance of a parameter by the others, over that by the one left out: beyond it the others say too little."""
_TELLS = 16.0  # chi-square that a true term must have on what is left out, so that a loss there is hardly chance

_ROUNDING = 1e-9  # share of all that is said of a parameter which is left of it by rounding

_Normal = tuple[Array, Array]  # a and b of normal equations A θ = b


def transfer_gains(design: Design, terms: Sequence[Term]) -> dict[object, float]:
    """Gain of each term that carries over on power-ons that its fit has not seen, summed, by key.

    Returns without the terms of which fewer than two power-ons are witnesses, or witnesses of too little.
    """
    lasting = [a for a in terms if not isinstance(a.hypothesis, RunSpecific)]
    if design.stack.begins.size < LEAST or not lasting:
        return {}
    own = [a for a in terms if isinstance(a.hypothesis, RunSpecific)]
    # what is a power-on's own is fitted there
    shared, theirs = np.split(np.arange(sum(a.size for a in (*lasting, *own))), [sum(a.size for a in lasting)])
    parts = [_without(part, shared, theirs) for part in _by_power_on(design, [*lasting, *own])]
    whole = np.sum([A for A, _ in parts], axis=0), np.sum([b for _, b in parts], axis=0)
    rows = np.split(np.arange(len(whole[1])), first_parameters(lasting)[1:])
    everything = inverse_of(whole[0]) @ whole[1]
    gains: dict[object, list[tuple[float, float]]] = {a.key: [] for a in lasting}
    for A, b in parts:
        others = _difference(whole, (A, b))
        inverse = inverse_of(others[0])
        left = _loss((A, b), inverse @ others[1])
        for a, mine in zip(lasting, rows, strict=True):
            rest = np.setdiff1d(np.arange(len(b)), mine)
            told, theta = _without((A, b), mine, rest)[0], everything[mine]
            if np.trace(inverse[np.ix_(mine, mine)] @ told) <= _UNKNOWN * a.size:
                expected = float(theta @ told @ theta)
                theta = np.zeros(len(b))
                theta[rest] = inverse_of(others[0][np.ix_(rest, rest)]) @ others[1][rest]
                gains[a.key].append((_loss((A, b), theta) - left, expected))
    sums = {key: np.sum(each, axis=0) for key, each in gains.items() if len(each) > 1}
    return {key: float(gain) for key, (gain, expected) in sums.items() if expected >= _TELLS or gain <= -_TELLS}


def _by_power_on(design: Design, terms: Sequence[Term]) -> list[_Normal]:
    """Normal equations of terms over all channels, of each power-on."""
    firsts, size = first_parameters(terms), sum(a.size for a in terms)
    count = design.stack.begins.size
    A, b = np.zeros((count, size, size)), np.zeros((count, size))
    for c in sorted({c for a in terms for c in a.places}):
        rows, places = parameters_on(terms, firsts, c)
        for r, W in enumerate(np.split(design.whitened(c, places), design.stack.begins[1:])):
            A[r][np.ix_(rows, rows)] += W[:, 1:].T @ W[:, 1:]
            b[r][rows] += W[:, 1:].T @ W[:, 0]
    return list(zip(A, b, strict=True))


def _without(part: _Normal, kept: NDArray[np.int_], others: NDArray[np.int_]) -> _Normal:
    """Normal equations of some parameters, the others fitted there."""
    A, b = part
    cross = A[np.ix_(kept, others)] @ inverse_of(A[np.ix_(others, others)])
    return A[np.ix_(kept, kept)] - cross @ A[np.ix_(others, kept)], b[kept] - cross @ b[others]


def _difference(whole: _Normal, part: _Normal) -> _Normal:
    """Normal equations of the other power-ons; nothing of a parameter of which they say nothing but rounding."""
    A, b = whole[0] - part[0], whole[1] - part[1]
    silent = np.diag(A) <= _ROUNDING * np.diag(whole[0])
    A[silent], A[:, silent], b[silent] = 0.0, 0.0, 0.0
    return A, b


def _loss(part: _Normal, theta: Array) -> float:
    """Chi-square of a power-on at some parameters, less that at none."""
    A, b = part
    return float(theta @ A @ theta - 2.0 * (b @ theta))


# ------------------------------------------------------------------------------------------------------- unseen cells
# What a term gains on cells that its fit has not seen: five folds of 20 s cells, all fitted on the others.

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
