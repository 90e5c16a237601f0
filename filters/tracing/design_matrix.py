"""What a hypothesis gains: columns of all hypotheses over all runs, their Gram matrices, and fits on them.

Whitened by each channel's bias filter (`whitening`), least squares is exact. A Gram matrix a channel, computed once,
makes every hypothesis a small solve: with G = WᵀW and B = Wᵀy,

    gain of a given S = dᵀ C⁻¹ d,   C = G_aa - G_aS G_SS⁻¹ G_Sa,   d = B_a - G_aS G_SS⁻¹ B_S

Effects that several channels share sum their blocks over those channels.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.effects import additive, drivers, reference_errors
from filters.effects.hypothesis import Hypothesis
from filters.effects.inputs import SENSED, Inputs
from filters.motion.segments import AXES
from filters.tracing.residual import Blocks
from filters.tracing.whitening import NONE, Drift, unbiased, whiten
from filters.types import Array

CELL_S = 20.0
FOLDS = 5
_CHI2_MEDIAN = 0.4549364
_VARIES = 1e-9
_SEEN = 1e-4


@dataclass(frozen=True)
class Stack:
    """Blocks of all runs, one after the other.

    Attributes
    ----------
    blocks : tuple of Blocks
    t : Array
        s since its run's start, shape (n,).
    run : integer array
        Number of the run, shape (n,).
    starts : integer array
        First row of each run.
    y, weight : Array
        Residual and weight, shape (n, 6).
    cell : integer array
        Number of the 20 s cell, shape (n,).
    period : float
        Of a block, s.
    """

    blocks: tuple[Blocks, ...]
    t: Array
    run: NDArray[np.int_]
    starts: NDArray[np.int_]
    y: Array
    weight: Array
    cell: NDArray[np.int_]
    period: float

    @classmethod
    def of(cls, blocks: Sequence[Blocks]) -> "Stack":
        """Stack blocks."""
        sizes = [b.t.size for b in blocks]
        run = np.repeat(np.arange(len(blocks)), sizes)
        t = np.concatenate([b.t for b in blocks])
        cell, offset = np.empty(t.size, np.int64), 0
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        for start, size in zip(starts.tolist(), sizes, strict=True):
            own = (t[start : start + size] // CELL_S).astype(np.int64)
            cell[start : start + size] = own + offset
            offset += int(own[-1]) + 1
        y = np.concatenate([b.y for b in blocks])
        weight = np.concatenate([b.weight for b in blocks])
        return cls(tuple(blocks), t, run, starts, y, weight, cell, float(np.mean([b.period for b in blocks])))

    def seconds(self, channel: int) -> float:
        """Length of good data."""
        return float(np.count_nonzero(self.weight[:, channel])) * self.period

    def white_sd(self) -> Array:
        """Standard deviation of a full block's white noise, from the median squared difference; shape (6,)."""
        out = np.empty(6)
        inner = np.diff(self.run) == 0
        for c in range(6):
            w = self.weight[:, c]
            good = inner & (w[1:] > 0.0) & (w[:-1] > 0.0)
            scaled = np.diff(self.y[:, c])[good] ** 2 / (1.0 / w[1:][good] + 1.0 / w[:-1][good])
            out[c] = np.sqrt(np.median(scaled) / _CHI2_MEDIAN) if scaled.size else np.nan
        return out


@dataclass(frozen=True)
class Term:
    """A hypothesis with its columns in the design: for each of its channels, their numbers."""

    hypothesis: Hypothesis
    places: dict[int, NDArray[np.int_]]

    @property
    def size(self) -> int:
        """Number of parameters."""
        return next(iter(self.places.values())).size

    @property
    def key(self) -> tuple[str, tuple[int, ...], str]:
        """What it is."""
        h = self.hypothesis
        return h.effect, h.channels, str(sorted(h.shape().items()))


@dataclass(frozen=True)
class Fit:
    """Parameters of a selection."""

    terms: tuple[Term, ...]
    theta: tuple[Array, ...]
    covariance: Array
    offsets: tuple[int, ...]

    def of(self, number: int) -> tuple[Array, Array]:
        """Parameters of a term and their covariance."""
        at, k = self.offsets[number], self.terms[number].size
        return self.theta[number], self.covariance[at : at + k, at : at + k]


class Design:
    """Columns of all hypotheses, and the evidence for each.

    Parameters
    ----------
    stack : Stack
        Data.
    """

    def __init__(self, stack: Stack) -> None:
        self.stack = stack
        self.drift: list[Drift] = [NONE] * 6
        self.sd = stack.white_sd()
        self.multiplier = np.ones_like(stack.y)
        self.columns, self.terms = _columns(stack)
        self.raw = np.sqrt(np.mean(self.columns**2, axis=0)) if self.columns.size else np.zeros(0)
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
            return unbiased(raw, self.stack.run, variance)
        return whiten(raw, self.stack.t, self.stack.starts, variance, drift)[0]

    def gram(self, channel: int) -> tuple[Array, Array, float]:
        """G, B and the squared norm of the whitened residual of a channel."""
        if channel not in self._gram:
            W = self.whitened(channel, np.arange(self.columns.shape[1]))
            y, X = W[:, 0], W[:, 1:]
            self._gram[channel] = X.T @ X, X.T @ y, float(y @ y)
        return self._gram[channel]

    def forget(self, channel: int) -> None:
        """Compute a channel's Gram matrix anew: its noise has changed."""
        self._gram.pop(channel, None)

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
        W = self.whitened(c, np.arange(self.columns.shape[1]))
        new = W[:, 1 + first :]
        cross = W[:, 1:].T @ new
        G = np.block([[G, cross[:first]], [cross[:first].T, cross[first:]]])
        self._gram[c] = G, np.append(B, new.T @ W[:, 0]), yy

    # ------------------------------------------------------------------------------------------------------- fits

    def fit(self, terms: Sequence[Term]) -> Fit:
        """Least squares of a selection over all channels."""
        A, b, offsets = self._normal(terms)
        if not terms:
            return Fit((), (), np.zeros((0, 0)), ())
        inverse = _inverse(A)
        theta = inverse @ b
        parts = tuple(theta[o : o + a.size] for o, a in zip(offsets, terms, strict=True))
        return Fit(tuple(terms), parts, inverse, tuple(offsets))

    def _normal(self, terms: Sequence[Term]) -> tuple[Array, Array, list[int]]:
        offsets = np.concatenate([[0], np.cumsum([a.size for a in terms])]).astype(int).tolist()
        A, b = np.zeros((offsets[-1], offsets[-1])), np.zeros(offsets[-1])
        for c in range(6):
            rows, places = self._present(terms, offsets, c)
            if rows.size:
                G, B, _ = self.gram(c)
                A[np.ix_(rows, rows)] += G[np.ix_(places, places)]
                b[rows] += B[places]
        return A, b, offsets[:-1]

    @staticmethod
    def _present(
        terms: Sequence[Term], offsets: Sequence[int], channel: int
    ) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Parameters of a selection that act on a channel, and their columns there."""
        rows, places = [], []
        for offset, term in zip(offsets, terms, strict=False):
            if channel in term.places:
                rows.append(np.arange(offset, offset + term.size))
                places.append(term.places[channel])
        if not rows:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        return np.concatenate(rows), np.concatenate(places)

    def gains(self, selection: Sequence[Term], candidates: Sequence[Term]) -> Array:
        """Drop of chi-square when a candidate joins a selection; 0 where the data can't see it; shape (candidates,)."""
        A, b, offsets = self._normal(selection)
        inverse = _inverse(A) if selection else np.zeros((0, 0))
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
        rows, places = self._present(selection, offsets, c)
        if not rows.size:
            return G, B, self._visible(scale)
        M = np.zeros((G.shape[0], theta.size))
        M[:, rows] = G[:, places]
        return G - M @ inverse @ M.T, B - M @ theta, self._visible(scale)

    def _visible(self, scale: Array) -> Array:
        """Diagonal of G where a column varies by more than rounding does, else infinity."""
        return np.where(scale > _VARIES * np.maximum(self.raw**2, 1e-300), scale, np.inf)

    def _cross(
        self, selection: Sequence[Term], offsets: Sequence[int], candidates: Sequence[Term], inverse: Array
    ) -> dict[int, Array]:
        out = {}
        for number, term in enumerate(candidates):
            if len(term.places) > 1:
                M = np.zeros((term.size, inverse.shape[0]))
                for c, own in term.places.items():
                    rows, places = self._present(selection, offsets, c)
                    if rows.size:
                        M[:, rows] += self.gram(c)[0][np.ix_(own, places)]
                out[number] = M
        return out

    def _shared_gain(self, term: Term, cross: Array | None, theta: Array, inverse: Array) -> float:
        C = sum(self.gram(c)[0][np.ix_(p, p)] for c, p in term.places.items())
        d = sum(self.gram(c)[1][p] for c, p in term.places.items())
        # one channel that sees a column is enough
        some = np.min([self._visible(np.diag(self.gram(c)[0]))[p] for c, p in term.places.items()], axis=0)
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

    def unexplained(self, selection: Sequence[Term], channel: int) -> Array:
        """Residual of a channel less what a selection's joint fit says, SI, shape (n,)."""
        fit = self.fit(selection)
        r = self.stack.y[:, channel].copy()
        for term, theta in zip(fit.terms, fit.theta, strict=True):
            if channel in term.places:
                r -= self.columns[:, term.places[channel]] @ theta
        return r

    def heldout(self, selection: Sequence[Term], term: Term, made: Array | None = None) -> tuple[float, float]:
        """Gain of a term on cells that its fit has not seen, over five folds, and the same without its best cell.

        Both fits, without and with it, are joint over all channels that shared effects tie to the term's.

        Parameters
        ----------
        selection : sequence of Term
            What is there already.
        term : Term
            The new one.
        made : Array or None
            Columns of its own, shape (n, k), of one that is not in the design.
        """
        tied = self._tied(selection, term)
        terms = [*(a for a in selection if set(a.places) & tied), term]
        offsets = np.concatenate([[0], np.cumsum([a.size for a in terms])]).astype(int).tolist()
        parts = []
        for c in sorted(tied):
            rows, _ = self._present(terms, offsets, c)
            _, places = self._present(terms[:-1], offsets, c)
            own = [] if c not in term.places else [self.columns[:, term.places[c]] if made is None else made]
            parts.append((c, np.column_stack([self.stack.y[:, c], self.columns[:, places], *own]), rows))
        cells = np.zeros(int(self.stack.cell[-1]) + 1)
        for f in range(FOLDS):
            cells += self._fold(parts, offsets, self.stack.cell % FOLDS != f, cells.size)
        return float(cells.sum()), float(cells.sum() - cells.max())

    def _fold(
        self,
        parts: Sequence[tuple[int, Array, NDArray[np.int_]]],
        offsets: Sequence[int],
        train: NDArray[np.bool_],
        count: int,
    ) -> Array:
        """Gain of the last term in each cell that a fold's fit has not seen, shape (count,).

        `parts` are channels with their residual and columns, and which parameters those are.
        """
        n, test = offsets[-1], ~train
        A, b, seen = np.zeros((n, n)), np.zeros(n), []
        for c, raw, rows in parts:
            fitted, judged = self._blind(raw, c, train)
            X = fitted[train, 1:]
            A[np.ix_(rows, rows)] += X.T @ X
            b[rows] += X.T @ fitted[train, 0]
            seen.append((judged, rows))
        old, new = np.zeros(n), _inverse(A) @ b
        old[: offsets[-2]] = _inverse(A[: offsets[-2], : offsets[-2]]) @ b[: offsets[-2]]
        cells = np.zeros(count)
        for W, rows in seen:
            before, after = (W[test, 0] - W[test, 1:] @ theta[rows] for theta in (old, new))
            cells += np.bincount(self.stack.cell[test], before**2 - after**2, count)
        return cells

    def _blind(self, raw: Array, channel: int, train: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Columns whitened for the fit as if the other cells were missing, and for judging those cells.

        Without drift each run's bias is that of the fitted cells: one of all cells tells them of the others. With
        drift the filter goes by the past; its memory of a cell that was left out is no part of the fit.
        """
        variance, drift = self.variance(channel), self.drift[channel]
        if drift.level > 0.0:
            missing = np.where(train, variance, np.inf)
            fitted = whiten(raw, self.stack.t, self.stack.starts, missing, drift)[0]
            return fitted, self.white(raw, channel)
        root = 1.0 / np.sqrt(variance)
        fitted = np.where(train, root, 0.0)
        total = np.maximum(np.bincount(self.stack.run, fitted**2), 1e-300)
        out = np.empty_like(raw)
        for j in range(raw.shape[1]):
            mean = np.bincount(self.stack.run, fitted**2 * raw[:, j]) / total
            out[:, j] = root * (raw[:, j] - mean[self.stack.run])
            # columns that the fitted cells don't see say nothing of the others
            if j and np.sum(out[train, j] ** 2) <= _SEEN * np.sum(out[:, j] ** 2):
                out[:, j] = 0.0
        return out, out

    @staticmethod
    def _tied(selection: Sequence[Term], term: Term) -> set[int]:
        """Channels of a term, and all that shared effects of a selection tie to them."""
        tied, more = set(term.places), True
        while more:
            wider = tied.union(*(a.places for a in selection if tied & set(a.places)))
            more, tied = wider > tied, wider
        return tied


def _inverse(A: Array) -> Array:
    """Inverse of a Gram matrix, of its visible part where columns are all but dependent."""
    if not A.size:
        return A
    scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
    values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
    keep = values > 1e-11 * values[-1]
    inner = (vectors[:, keep] / values[keep]) @ vectors[:, keep].T
    return np.asarray(inner / np.outer(scale, scale))


def _gain(C: Array, d: Array, scale: Array) -> float:
    """dᵀ C⁻¹ d over the directions that the data see."""
    use = np.isfinite(scale) & (np.diag(C) > _SEEN * scale)
    if not use.any():
        return 0.0
    C, d = C[np.ix_(use, use)], d[use]
    root = np.sqrt(np.diag(C))
    values, vectors = np.linalg.eigh(C / np.outer(root, root))
    keep = values > _SEEN * values[-1]
    projected = vectors[:, keep].T @ (d / root)
    return float(np.sum(projected**2 / values[keep]))


# ------------------------------------------------------------------------------------------------------------ columns


def _columns(stack: Stack) -> tuple[Array, list[Term]]:
    """Columns of all hypotheses that vary, over all runs, and where they are."""
    ranges = _ranges(stack)
    makers: list[tuple[bool, Callable[[Inputs], Array], int]] = []
    terms: list[Term] = []
    width = 0

    def put(slow: bool, columns: Callable[[Inputs], Array], count: int) -> NDArray[np.int_]:
        nonlocal width
        makers.append((slow, columns, count))
        width += count
        return np.arange(width - count, width)

    # what is a function of time or temperature is the same on every channel
    kept: dict[object, NDArray[np.int_]] = {}
    for c in range(6):
        for h in (*additive.hypotheses(c), *reference_errors.harmonics(c)):
            if not _has(h, ranges):
                continue
            alike = h.source != "motion" or h.effect in ("harmonic", "g_squared", "g_sensitivity")
            key = (h.effect, str(h.shape())) if alike else (h.effect, c, str(h.shape()))
            if key not in kept:
                kept[key] = put(is_slow(h), _bound(h, c), len(h.parameters()))
            terms.append(Term(h, {c: kept[key]}))
    for basis in drivers.bases(ranges):
        places = put(is_slow(basis.on(0)), basis.columns_of, basis.count)
        terms += [Term(basis.on(c), {c: places}) for c in range(6) if not _twin(basis.name, c)]
    if any(not b.run.still for b in stack.blocks) or len(stack.blocks) > 1:
        for s in reference_errors.shared():
            terms.append(Term(s, {c: put(False, _bound(s, c), len(s.parameters())) for c in s.channels}))
    return _filled(stack, makers, width), terms


def columns_on(stack: Stack, terms: Sequence[Term]) -> dict[tuple[object, int], Array]:
    """Columns of hypotheses on another stack, by term's key and channel, shape (n, k)."""
    wanted = [(a, c) for a in terms for c in a.places]
    out: dict[tuple[object, int], Array] = {}
    places = np.concatenate([[0], np.cumsum([a.size for a, _ in wanted])]).astype(int)
    fast = [
        (_bound(a.hypothesis, c), slice(places[k], places[k + 1]))
        for k, (a, c) in enumerate(wanted)
        if not is_slow(a.hypothesis)
    ]
    values = np.empty((stack.t.size, int(places[-1])))
    for start, blocks in zip(stack.starts.tolist(), stack.blocks, strict=True):
        rows = slice(start, start + blocks.t.size)
        if fast:
            blocks.mean(fast, values[rows])
        for k, (a, c) in enumerate(wanted):
            if is_slow(a.hypothesis):
                values[rows, places[k] : places[k + 1]] = a.hypothesis.columns(blocks.slow(), c)
    for k, (a, c) in enumerate(wanted):
        out[a.key, c] = np.nan_to_num(values[:, places[k] : places[k + 1]])
    return out


def is_slow(h: Hypothesis) -> bool:
    """Whether a hypothesis is a function of what `Blocks.slow` has: time, temperature, what follows motion."""
    return h.source != "motion" or h.effect.startswith(("driver:since", "driver:settling", "driver:direction"))


def _bound(h: Hypothesis, channel: int) -> Callable[[Inputs], Array]:
    return lambda inputs: h.columns(inputs, channel)


def _filled(stack: Stack, makers: list[tuple[bool, Callable[[Inputs], Array], int]], width: int) -> Array:
    out = np.zeros((stack.t.size, width))
    places = np.concatenate([[0], np.cumsum([count for *_, count in makers])]).astype(int)
    fast = [(f, slice(places[i], places[i + 1])) for i, (slow, f, _) in enumerate(makers) if not slow]
    for start, blocks in zip(stack.starts.tolist(), stack.blocks, strict=True):
        rows = slice(start, start + blocks.t.size)
        at_rest = blocks.slow()
        for i, (slow, f, _) in enumerate(makers):
            if slow:
                out[rows, places[i] : places[i + 1]] = f(at_rest)
        blocks.mean(fast, out[rows])
    return np.nan_to_num(out, copy=False)


def _has(h: Hypothesis, ranges: dict[str, tuple[float, float]]) -> bool:
    """Whether what an effect is a function of is there and varies."""
    if h.effect == "thermal_scale":
        # of an input that never varies it is a bias that follows temperature
        return "temperature" in ranges and SENSED[h.channels[0]] in ranges
    if h.source == "temperature":
        return "temperature" in ranges
    if h.effect == "harmonic":
        return str(h.shape()["axis"]) in ranges
    return h.source == "time" or any(name in ranges for name in SENSED)


def _twin(name: str, channel: int) -> bool:
    """Whether a product is in the catalogue under another name: x (T - T0)."""
    return name == f"temperature*{SENSED[channel]}"


def _ranges(stack: Stack) -> dict[str, tuple[float, float]]:
    """Least and greatest value of the scalar drivers and of the table's angles, where they vary."""
    names = [*drivers.SCALARS, *AXES]

    def scalars(inputs: Inputs) -> Array:
        return np.column_stack([*(value(inputs) for _, value, _ in drivers.SCALARS.values()), inputs.angles])

    values = np.empty((stack.t.size, len(names)))
    for start, blocks in zip(stack.starts.tolist(), stack.blocks, strict=True):
        blocks.mean([(scalars, slice(None))], values[start : start + blocks.t.size])
    out = {}
    for k, name in enumerate(names):
        own = values[:, k]
        if not np.isfinite(own).all():
            continue
        # what differs from run to run only is the runs' biases
        within = max(float(np.ptp(part)) for part in np.split(own, stack.starts[1:]))
        low, high = float(own.min()), float(own.max())
        if within > 1e-6 * max(1.0, abs(high), abs(low)):
            out[name] = (low, high)
    if all(b.run.still for b in stack.blocks):
        out.pop("since_motion", None)  # it is time then
    # a unit at rest senses Earth rate only
    return {n: r for n, r in out.items() if n[0] != "w" or r[1] - r[0] > 0.02}
