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
from filters.tracing.design_matrix import Design, first_parameters, inverse_of, parameters_on
from filters.types import Array

LEAST = 3
"""Power-ons that it takes."""
_UNKNOWN = 2.0
"""Variance of a parameter by the others, over that by the one left out: beyond it the others say too little."""
_TELLS = 16.0
"""Chi-square that a true term must have on what is left out, so that a loss there is hardly chance."""

_ROUNDING = 1e-9
"""Share of all that is said of a parameter which is left of it by rounding."""

_Normal = tuple[Array, Array]  # A and b of normal equations A θ = b


def transfer_gains(design: Design, terms: Sequence[Term]) -> dict[object, float]:
    """Gain of each term that carries over on power-ons that its fit has not seen, summed, by key.

    `design`: data and columns.
    `terms`: all that is selected.
    Returns without the terms of which fewer than two power-ons are witnesses, or witnesses of too little.
    """
    lasting = [a for a in terms if not isinstance(a.hypothesis, RunSpecific)]
    if design.stack.begins.size < LEAST or not lasting:
        return {}
    own = [a for a in terms if isinstance(a.hypothesis, RunSpecific)]
    parts = [_without(part, sum(a.size for a in lasting)) for part in _by_power_on(design, [*lasting, *own])]
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
            told, theta = _own(A, mine, rest), everything[mine]
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


def _without(part: _Normal, first: int) -> _Normal:
    """Normal equations without the parameters from one on, which are a power-on's own and are fitted there."""
    A, b = part
    cross = A[:first, first:] @ inverse_of(A[first:, first:])
    return A[:first, :first] - cross @ A[first:, :first], b[:first] - cross @ b[first:]


def _difference(whole: _Normal, part: _Normal) -> _Normal:
    """Normal equations of the other power-ons; nothing of a parameter of which they say nothing but rounding."""
    A, b = whole[0] - part[0], whole[1] - part[1]
    silent = np.diag(A) <= _ROUNDING * np.diag(whole[0])
    A[silent], A[:, silent], b[silent] = 0.0, 0.0, 0.0
    return A, b


def _own(A: Array, mine: NDArray[np.int_], rest: NDArray[np.int_]) -> Array:
    """What a power-on says of some parameters beside the rest."""
    cross = A[np.ix_(mine, rest)]
    return np.asarray(A[np.ix_(mine, mine)] - cross @ inverse_of(A[np.ix_(rest, rest)]) @ cross.T)


def _loss(part: _Normal, theta: Array) -> float:
    """Chi-square of a power-on at some parameters, less that at none."""
    A, b = part
    return float(theta @ A @ theta - 2.0 * (b @ theta))
