"""What a hypothesis gains: Gram matrices of all hypotheses' columns over all runs, and fits on them.

Whitened by each channel's bias filter (`whitening`), least squares is exact. A Gram matrix a channel, computed once,
makes every hypothesis a small solve: with G = WᵀW and B = Wᵀy,

    gain of a given S = dᵀ C⁻¹ d,   C = G_aa - G_aS G_SS⁻¹ G_Sa,   d = B_a - G_aS G_SS⁻¹ B_S

Effects that several channels share sum their blocks over those channels. What it leaves out: which columns there are
(`columns`), and what a term gains on cells that its fit has not seen (`unseen_cells`).
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.channels import CHANNELS
from filters.effects.hypothesis import Hypothesis
from filters.tracing.columns import Term, columns_of_all
from filters.tracing.stack import Stack
from filters.tracing.whitening import NONE, Drift, inverse_root, unbiased, unbiased_parts, whiten, whitened_parts
from filters.types import Array

VISIBLE = 1e-4  # share of a column's square beside which what is left of it is rounding, or a bias
_VARIES = 1e-9
_AT_ONCE = 3_000_000  # numbers that are whitened together


@dataclass(frozen=True)
class Fit:
    """Least-squares parameters of a selection."""

    terms: tuple[Term, ...]  # in order
    theta: tuple[Array, ...]  # parameters of each, SI, shape (k,)
    covariance: Array  # of all parameters in order, shape (K, K)
    offsets: tuple[int, ...]  # number of each term's first parameter

    def of(self, number: int) -> tuple[Array, Array]:
        """Parameters of a term and their covariance."""
        at, k = self.offsets[number], self.terms[number].size
        return self.theta[number], self.covariance[at : at + k, at : at + k]


class Design:
    """Columns of all hypotheses, their Gram matrices, and fits of selections of them.

    `like`: one of the same blocks with other residuals, whose columns are taken.
    `left`: what selected effects left of the residual: noise is what varies in it, shape (n, 6).
    `terms`: all hypotheses that the data can carry, with their columns.
    `columns`: regressors, SI per SI of the parameters, shape (n, K); columns are added, never taken away.
    `lasting`: how many columns were there before any was added.
    `sd`: standard deviation of a full block's white noise, SI, shape (6,).
    `drift`: of the six channels; `set_drift` changes it.
    `multiplier`: of the noise of each row, shape (n, 6); `set_multiplier` changes it.
    """

    def __init__(self, stack: Stack, like: "Design | None" = None, left: Array | None = None) -> None:
        self.stack = stack
        self.drift: list[Drift] = [NONE] * 6
        self.sd = stack.white_sd(left)
        self.multiplier = np.ones_like(stack.y)
        if like is None:
            self.columns, self.terms = columns_of_all(stack)
            self.lasting = self.columns.shape[1]
        else:
            # columns are of the motion and the time, which are what they were
            self.lasting = like.lasting
            self.columns, self.terms = like.columns[:, : like.lasting], list(like.terms)
        squares = np.einsum("ij,ij->j", self.columns, self.columns)
        self.raw = np.sqrt(squares / max(1, len(self.columns)))
        self._gram: dict[int, tuple[Array, Array, float]] = {}

    def variance(self, channel: int) -> Array:
        """Variance of each row's white noise, infinite without data; shape (n,)."""
        w = self.stack.weight[:, channel]
        with np.errstate(divide="ignore"):
            own = (self.sd[channel] * self.multiplier[:, channel]) ** 2 / w
        return np.where(w > 0.0, own, np.inf)

    def whitened(self, channel: int, places: NDArray[np.int_], drift: Drift | None = None) -> Array:
        """Residual and some columns, whitened; shape (n, 1 + k)."""
        raw = np.column_stack([self.stack.y[:, channel], self.columns[:, places]])
        return self.white(raw, channel, drift)

    def white(self, raw: Array, channel: int, drift: Drift | None = None) -> Array:
        """Columns whitened as the channel is."""
        drift = self.drift[channel] if drift is None else drift
        variance = self.variance(channel)
        if drift.level == 0.0:
            return unbiased(raw, self.stack.power_on, variance)
        return whiten(raw, self.stack.t, self.stack.begins, variance, drift)[0]

    def gram(self, channel: int) -> tuple[Array, Array, float]:
        """G, B and the squared norm of the whitened residual of a channel."""
        if channel not in self._gram:
            alike = self._alike(channel)
            K, m = self.columns.shape[1], len(alike)
            G, B, yy = np.zeros((K, K)), np.zeros((K, m)), np.zeros(m)
            for W in self._whitened_parts(alike):
                Y, X = W[:, :m], W[:, m:]
                G += X.T @ X
                B += X.T @ Y
                yy += np.sum(Y**2, axis=0)
            for number, c in enumerate(alike):
                ratio = 1.0 if c == channel else float(self.sd[channel] / self.sd[c]) ** 2
                self._gram[c] = ratio * G, ratio * B[:, number], ratio * float(yy[number])
        return self._gram[channel]

    def _alike(self, channel: int) -> list[int]:
        """A channel, and those whose Gram matrices are its own but for their noise: without drift, the same weights."""
        if self.drift[channel].level != 0.0 or not self.sd[channel] > 0.0:
            return [channel]
        free = (c for c in range(6) if self.drift[c].level == 0.0 and self.sd[c] > 0.0)
        others = (c for c in free if c not in (channel, *self._gram))
        of_rows = self.multiplier, self.stack.weight
        return [channel, *(c for c in others if all(np.array_equal(x[:, c], x[:, channel]) for x in of_rows))]

    def _whitened_parts(self, channels: Sequence[int]) -> Iterator[Array]:
        """Residuals, and all columns, whitened as the first; some rows after the others: a day's are too many."""
        stack, variance, drift = self.stack, self.variance(channels[0]), self.drift[channels[0]]
        n, K = self.columns.shape
        size = max(1, _AT_ONCE // (len(channels) + K))

        def parts() -> Iterator[tuple[slice, Array]]:
            for first in range(0, n, size):
                rows = slice(first, first + size)
                yield rows, np.column_stack([stack.y[rows][:, channels], self.columns[rows]])

        if drift.level == 0.0:
            return unbiased_parts(parts, stack.power_on, variance)
        return whitened_parts((part for _, part in parts()), stack.t, stack.begins, variance, drift)

    def set_drift(self, channel: int, drift: Drift) -> None:
        """Let a channel have another drift; its Gram matrix is computed anew."""
        self.drift[channel] = drift
        self._gram.pop(channel, None)

    def set_multiplier(self, multiplier: Array) -> None:
        """Let the noise of each row be so many times its channel's standard deviation, shape (n, 6)."""
        self.multiplier = multiplier
        self._gram.clear()

    def add(self, hypothesis: Hypothesis, columns: Array) -> Term:
        """Take columns that were found on the way: a tone's, a step's."""
        first = self.columns.shape[1]
        self.columns = np.hstack([self.columns, columns])
        self.raw = np.append(self.raw, np.sqrt(np.mean(columns**2, axis=0)))
        places = np.arange(first, first + columns.shape[1])
        term = Term(hypothesis, dict.fromkeys(hypothesis.channels, places))
        for c in list(self._gram):
            if c in hypothesis.channels:
                self._widen(c, first)
            else:  # where it does not act nobody asks for it
                G, B, yy = self._gram[c]
                more = columns.shape[1]
                self._gram[c] = np.pad(G, ((0, more), (0, more))), np.append(B, np.zeros(more)), yy
        return term

    def _widen(self, c: int, first: int) -> None:
        """Add the columns from `first` on to a channel's Gram matrix."""
        G, B, yy = self._gram[c]
        more = self.columns.shape[1] - first
        cross, right = np.zeros((first + more, more)), np.zeros(more)
        for W in self._whitened_parts([c]):
            new = W[:, 1 + first :]
            cross += W[:, 1:].T @ new
            right += new.T @ W[:, 0]
        G = np.block([[G, cross[:first]], [cross[:first].T, cross[first:]]])
        self._gram[c] = G, np.append(B, right), yy

    def spanned(self, others: Sequence[Term], term: Term, channel: int) -> float:
        """Share, 0 to 1, of what a term of one column does on a channel that a sum of others does as well."""
        G = self.gram(channel)[0]
        (own,), rest = term.places[channel], np.concatenate([a.places[channel] for a in others])
        return float(G[rest, own] @ inverse_of(G[np.ix_(rest, rest)]) @ G[rest, own] / G[own, own])

    # ------------------------------------------------------------------------------------------------------- fits

    def fit(self, terms: Sequence[Term]) -> Fit:
        """Least squares of a selection over all channels."""
        A, b, offsets = self._normal(terms)
        if not terms:
            return Fit((), (), np.zeros((0, 0)), ())
        inverse = inverse_of(A)
        theta = inverse @ b
        parts = tuple(theta[o : o + a.size] for o, a in zip(offsets, terms, strict=True))
        return Fit(tuple(terms), parts, inverse, tuple(offsets))

    def _normal(self, terms: Sequence[Term]) -> tuple[Array, Array, list[int]]:
        """Normal equations A θ = b of a selection over all channels, and the first parameter of each term."""
        firsts = first_parameters(terms)
        size = sum(a.size for a in terms)
        A, b = np.zeros((size, size)), np.zeros(size)
        for c in range(len(CHANNELS)):
            rows, places = parameters_on(terms, firsts, c)
            if rows.size:
                G, B, _ = self.gram(c)
                A[np.ix_(rows, rows)] += G[np.ix_(places, places)]
                b[rows] += B[places]
        return A, b, firsts

    def gains(self, selection: Sequence[Term], candidates: Sequence[Term]) -> Array:
        """Drop of chi-square when a candidate joins a selection; 0 where the data can't see it; shape (candidates,)."""
        A, b, offsets = self._normal(selection)
        inverse = inverse_of(A) if selection else np.zeros((0, 0))
        theta = inverse @ b
        reduced = {c: self._reduced(selection, offsets, c, inverse, theta) for c in self._channels(candidates)}
        out = np.zeros(len(candidates))
        cross = self._cross(selection, offsets, candidates, inverse) if selection else {}
        for number, term in enumerate(candidates):
            if len(term.places) == 1:
                ((c, places),) = term.places.items()
                C, d, raw = reduced[c]
                out[number] = _gain(C[np.ix_(places, places)], d[places], raw[places])
            else:
                out[number] = self._shared_gain(term, cross.get(number), theta, inverse)
        return out

    @staticmethod
    def _channels(terms: Sequence[Term]) -> list[int]:
        return sorted({c for term in terms if len(term.places) == 1 for c in term.places})

    def _reduced(
        self, selection: Sequence[Term], offsets: Sequence[int], c: int, inverse: Array, theta: Array
    ) -> tuple[Array, Array, Array]:
        G, B, _ = self.gram(c)
        scale = np.diag(G)
        rows, places = parameters_on(selection, offsets, c)
        if not rows.size:
            return G, B, self._visible(scale, c)
        M = np.zeros((G.shape[0], theta.size))
        M[:, rows] = G[:, places]
        return G - M @ inverse @ M.T, B - M @ theta, self._visible(scale, c)

    def _visible(self, scale: Array, channel: int) -> Array:
        """Diagonal of a channel's G where a column varies by more than rounding does, else infinity."""
        # beside what the column would be if nothing of it were a bias
        whole = np.maximum(self.raw**2, 1e-300) * float(np.sum(1.0 / self.variance(channel)))
        return np.where(scale > _VARIES * whole, scale, np.inf)

    def _cross(
        self, selection: Sequence[Term], offsets: Sequence[int], candidates: Sequence[Term], inverse: Array
    ) -> dict[int, Array]:
        out = {}
        for number, term in enumerate(candidates):
            if len(term.places) > 1:
                M = np.zeros((term.size, inverse.shape[0]))
                for c, own in term.places.items():
                    rows, places = parameters_on(selection, offsets, c)
                    if rows.size:
                        M[:, rows] += self.gram(c)[0][np.ix_(own, places)]
                out[number] = M
        return out

    def _shared_gain(self, term: Term, cross: Array | None, theta: Array, inverse: Array) -> float:
        C = sum(self.gram(c)[0][np.ix_(p, p)] for c, p in term.places.items())
        d = sum(self.gram(c)[1][p] for c, p in term.places.items())
        # one channel that sees a column is enough
        some = np.min([self._visible(np.diag(self.gram(c)[0]), c)[p] for c, p in term.places.items()], axis=0)
        scale = np.where(np.isfinite(some), np.diag(C), np.inf)
        if cross is not None:
            C = C - cross @ inverse @ cross.T
            d = d - cross @ theta
        return _gain(np.asarray(C), np.asarray(d), scale)

    def chi2(self, selection: Sequence[Term], channel: int) -> float:
        """Squared norm of a channel's whitened residual under a selection's joint fit."""
        W = self.residual(selection, channel)
        return float(W @ W)

    def residual(self, selection: Sequence[Term], channel: int) -> Array:
        """Whitened residual of a channel under a selection's joint fit, shape (n,)."""
        return self.white(self.unexplained(selection, channel)[:, None], channel)[:, 0]

    def unexplained(
        self, selection: Sequence[Term], channel: int, fit: Fit | None = None, *, only_shared: bool = False
    ) -> Array:
        """Residual of a channel less what a joint fit, that of a selection, says; SI, shape (n,).

        `only_shared`: less what terms say that several channels share.
        """
        fit = self.fit(selection) if fit is None else fit
        r = self.stack.y[:, channel].copy()
        for term, theta in zip(fit.terms, fit.theta, strict=True):
            if channel in term.places and (len(term.places) > 1 or not only_shared):
                r -= self.columns[:, term.places[channel]] @ theta
        return r


def first_parameters(terms: Sequence[Term]) -> list[int]:
    """Number of each term's first parameter, of the parameters of all in order."""
    return [0, *itertools.accumulate(a.size for a in terms)][:-1]


def parameters_on(
    terms: Sequence[Term], firsts: Sequence[int], channel: int
) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Parameters of terms that act on a channel, and their columns there.

    `firsts`: from `first_parameters`; more may follow.
    """
    rows, places = [], []
    for first, term in zip(firsts, terms, strict=False):
        if channel in term.places:
            rows.append(np.arange(first, first + term.size))
            places.append(term.places[channel])
    if not rows:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    return np.concatenate(rows), np.concatenate(places)


def inverse_of(A: Array) -> Array:
    """Inverse of a Gram matrix, of its visible part where columns are all but dependent."""
    if not A.size:
        return A
    scale = inverse_root(np.diag(A))
    both = np.outer(scale, scale)
    values, vectors = np.linalg.eigh(A * both)
    keep = values > 1e-11 * values[-1]
    return np.asarray((vectors[:, keep] / values[keep]) @ vectors[:, keep].T * both)


def _gain(C: Array, d: Array, scale: Array) -> float:
    """dᵀ C⁻¹ d over the directions that the data see."""
    if d.size == 1:  # most candidates have one parameter: as below, without matrices
        own = float(C[0, 0])
        if not own > VISIBLE * float(scale[0]):
            return 0.0
        norm = math.sqrt(own)
        return (float(d[0]) / norm) ** 2 / (own / (norm * norm))
    return gain_of(C, d, np.isfinite(scale) & (np.diag(C) > VISIBLE * scale))


def gain_of(C: Array, d: Array, visible: NDArray[np.bool_]) -> float:
    """dᵀ C⁻¹ d over the directions that the data see, of the parameters that are visible."""
    if not visible.any():
        return 0.0
    C, d = C[np.ix_(visible, visible)], d[visible]
    root = np.sqrt(np.diag(C))
    values, vectors = np.linalg.eigh(C / np.outer(root, root))
    keep = values > VISIBLE * values[-1]
    projected = vectors[:, keep].T @ (d / root)
    return float(np.sum(projected**2 / values[keep]))
