"""Evidence of slow effects and of drift on a channel: every rival has its own spectrum of drift and its own steps.

    y = X θ + steps + e,   e ~ N(0, σ² C),   θ ~ N(0, σ² s² I) for orthonormal X,   p(σ²) = 1 / σ²

over all power-ons together, each with a bias of its own. θ and σ are integrated in closed form; spectra C (`spectrum`;
half of what is plausible is white noise alone), sizes s and shapes within a family are summed. Steps at unknown times
belong to drift, for real drift has turns that no Gaussian process has: each rival takes those it needs, one after the
other, and pays for their places. What repeats with its input from power-on to power-on is told from drift by what drift
would have to do by chance.
"""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from filters.tracing.spectrum import Whitening
from filters.tracing.trace_document import PRIOR
from filters.types import Array

_FREE, _FREE_NAME = 0.3, ("driver:", "cause:")
"""Share of a free curve in that, over that of an effect of the catalogue, and how names of free curves begin."""
_SIZES: Array = np.array([15.0, 50.0, 150.0, 500.0, 1500.0, 5000.0])  # norms over the white noise, of all rows
_JUDGED = _SIZES[:4]  # those that are judged with steps: what is larger is told by any
_STEP = 4.0**2  # prior variance of a step, over that of the white noise of a row
_MOST_STEPS = 14
_WAITED = 3  # steps that may be taken in vain before the next one that is worth its place
_SPECTRA = 4  # those that most speak for are judged with steps
_NEGLIGIBLE = 8.0  # in ln evidence: spectra so far from the best for every hypothesis do not count for refined ones
PICKS = 3  # hypotheses of a family that are judged with steps
_NEAR = 10.0  # in ln evidence, from the best family or from none: what is farther is not judged with steps
_APART = 0.03  # columns of a hypothesis that are nearer to each other are one
VARIES = 1e-6


@dataclass(frozen=True)
class Rival:
    """A family of hypotheses on a channel."""

    name: str
    probability: float  # of the family
    best: int  # number of its most likely hypothesis
    gain: float  # twice the logarithm of its evidence over that of drift alone


class Candidates:
    """Hypotheses over some rows: families of groups of columns.

    `columns`: of the used rows of a whitening, shape (n, K); `groups`: numbers of each hypothesis' columns;
    `families`: its family's name.
    """

    def __init__(
        self, whitening: Whitening, columns: Array, groups: Sequence[NDArray[np.int_]], families: Sequence[str]
    ) -> None:
        self.whitening = whitening
        own = columns.copy()
        for part in whitening.parts:
            own[part] -= own[part].mean(axis=0)
        size, whole = np.linalg.norm(own, axis=0), np.linalg.norm(columns, axis=0)
        seen = size > VARIES * whole
        self.columns = own / np.where(seen, size, 1.0)
        self.total = len(groups)
        kept, bases = [], []
        for number, group in enumerate(groups):
            if seen[group].all():
                R = np.linalg.qr(self.columns[:, group], mode="r")
                if np.all(np.abs(np.diag(R)) > _APART):
                    kept.append(number)
                    bases.append(np.linalg.inv(R))
        self.numbers = np.array(kept, int)
        self.groups = [groups[k] for k in kept]
        self.bases = bases
        self.families = np.array([families[k] for k in kept])
        # logarithm of how much of the prior of a hypothesis of the family it has
        self.shares: Array = np.zeros(len(kept))
        self.count = {name: int(np.sum(self.families == name)) for name in dict.fromkeys(self.families.tolist())}
        sizes = np.array([g.size for g in self.groups], int)
        self._by_size = [
            (own, np.array([self.groups[h] for h in own]), np.array([bases[h] for h in own]))
            for own in (np.flatnonzero(sizes == k) for k in np.unique(sizes))
        ]
        self._gram: dict[int, Array] = {}

    def gram(self, k: int) -> Array:
        """Products of the columns, whitened by a spectrum, shape (K, K)."""
        if k not in self._gram:
            W = self.whitening.white(k, self.columns)
            self._gram[k] = W.T @ W
        return self._gram[k]

    def joined_by(self, others: "Candidates") -> "Candidates":
        """These and others over the same rows, whose numbers go on from the last."""
        out = copy.copy(self)
        first = self.columns.shape[1]
        out.columns = np.column_stack([self.columns, others.columns])
        out.numbers = np.append(self.numbers, others.numbers + self.total)
        out.groups = [*self.groups, *(g + first for g in others.groups)]
        out.bases = [*self.bases, *others.bases]
        out.families = np.append(self.families, others.families)
        out.shares = np.append(self.shares, others.shares)
        out.count = {name: int(np.sum(out.families == name)) for name in dict.fromkeys(out.families.tolist())}
        return out

    def of(self, number: int) -> Array:
        """Orthonormal columns of a kept hypothesis, shape (n, k)."""
        return np.asarray(self.columns[:, self.groups[number]] @ self.bases[number])

    def log_evidence(self, y: Array, beside: Array, spectra: Sequence[int] | None = None) -> Array:
        """Of drift alone, then of each kept hypothesis, under every spectrum: shape (spectra, 1 + h, m).

        `y`: m residuals, shape (n, m). `beside`: columns of what is selected, of which nothing is known, shape (n, q).
        `spectra`: numbers of those that count, where not all do.
        """
        count = len(self.whitening.spectra)
        out = np.full((count, 1 + len(self.groups), y.shape[1]), -np.inf)
        for k in range(count) if spectra is None else spectra:
            out[k] = self._of_spectrum(k, y, beside)
        return out

    def _of_spectrum(self, k: int, y: Array, beside: Array) -> Array:
        q, whitening = beside.shape[1], self.whitening
        half = 0.5 * (len(y) - len(whitening.parts) - q)
        W = whitening.white(k, np.column_stack([beside, y]))
        Q, R = np.linalg.qr(W[:, :q])
        log_det = whitening.log_det(k) + 2.0 * float(np.sum(np.log(np.abs(np.diag(R)) + 1e-300)))
        Y = W[:, q:] - Q @ (Q.T @ W[:, q:])
        both = self.columns.T @ whitening.unwhitened(k, np.hstack([Q, Y]))
        A, b = both[:, :q], both[:, q:]
        G = self.gram(k) - A @ A.T
        yy = np.sum(Y**2, axis=0)
        base = whitening.log_prior[k] - 0.5 * log_det - half * np.log(yy)
        out = np.empty((1 + len(self.groups), y.shape[1]))
        out[0] = base
        for own, at, M in self._by_size:
            Mt = M.transpose(0, 2, 1)
            values, vectors = np.linalg.eigh(Mt @ G[at[:, :, None], at[:, None, :]] @ M)
            z = vectors.transpose(0, 2, 1) @ (Mt @ b[at])
            out[1 + own] = base + _over_sizes(np.maximum(values, 0.0), z, yy, half)
        return out


def _over_sizes(values: Array, z: Array, yy: Array, half: float) -> Array:
    """ln evidence over that of nothing, sizes summed: eigenvalues (h, k), projections (h, k, m), squares (m,)."""
    total = []
    for a in _SIZES**2:
        gain = np.sum(z**2 * (a / (1.0 + a * values))[:, :, None], axis=1)
        left = np.maximum(1.0 - gain / yy, 1e-12)
        total.append(-0.5 * np.sum(np.log1p(a * values), axis=1)[:, None] - half * np.log(left))
    return np.asarray(logsumexp(np.array(total), axis=0) - np.log(_SIZES.size))


@dataclass(frozen=True)
class _Greedy:
    """Evidence of a hypothesis with as many steps as it needs."""

    log_evidence: float
    steps: list[tuple[int, float]]  # row before each, of the used rows, and its size


class Judge:
    """Rivals of a channel: its residual, and columns of what is selected there already; of the used rows.

    `refined`: what makes more hypotheses of those that do best, given this.
    """

    def __init__(
        self,
        candidates: Candidates,
        y: Array,
        beside: Array,
        refined: Callable[["Judge"], Candidates | None] = lambda judge: None,
    ) -> None:
        self._all, self._beside, self._refined = candidates, beside, refined
        self._y = y
        w = candidates.whitening
        self._nothing = Candidates(w, np.zeros((y.size, 0)), [], [])
        self._places = np.concatenate([np.arange(p.start, p.stop - 1) for p in w.parts])
        self._known: dict[int, tuple[Array, Array, Array, Array, float]] = {}
        self._of: dict[tuple[int, int], tuple[Array, Array, Array]] = {}
        self._known_evidence: dict[Candidates, tuple[Array, Array]] = {}
        self._spectra: list[int] | None = None

    def rivals(self) -> list[Rival]:
        """Families with their probabilities, the most probable first; drift alone is the rest of 1."""
        if not self._all.count:
            return []
        raw, tidy = self._evidence(self._all)
        self._spectra = np.flatnonzero((raw > raw.max(axis=0) - _NEGLIGIBLE).any(axis=1)).tolist()
        more = self._refined(self)
        if more is not None:
            shared = (x[:, 1:] + more.shares for x in self._evidence(more))
            raw, tidy = (np.hstack([x, y]) for x, y in zip((raw, tidy), shared, strict=True))
            self._all = self._all.joined_by(more)
        of_all = np.logaddexp(raw, tidy - (tidy[:, 0].max() - raw[:, 0].max()))
        prior = np.log(np.append(1.0, [1.0 / self._all.count[f] for f in self._all.families.tolist()]))
        spectra = np.argsort(-logsumexp(of_all + prior, axis=1))[:_SPECTRA].tolist()
        names = list(self._all.count)
        each = [logsumexp(x, axis=0) for x in (raw, tidy)]
        each = [x[1:] - x[0] for x in each]
        own = {f: np.flatnonzero(self._all.families == f) for f in names}
        tops = {f: max(float(logsumexp(x[own[f]])) for x in each) - np.log(self._all.count[f]) for f in names}
        least = max(0.0, *tops.values()) - _NEAR
        none = float(logsumexp([self._greedy(k, None, 0.0).log_evidence for k in spectra]))
        found = []
        for f in names:
            if tops[f] > least:
                picks = {int(own[f][h]) for x in each for h in np.argsort(-x[own[f]])[:PICKS]}
                found.append((f, *self._family(f, sorted(picks), own[f], each, spectra)))
        if not found:
            return []
        logs = np.array([value for _, value, _ in found]) - none
        plain = np.array([_FREE if name.startswith(_FREE_NAME) else 1.0 for name in names])
        share = dict(zip(names, plain / plain.sum(), strict=True))
        odds = np.exp(np.minimum(logs, 700.0)) * (PRIOR / (1.0 - PRIOR)) * np.array([share[f] for f, *_ in found])
        total = 1.0 + float(np.sum(odds))
        made = [
            Rival(f, float(o / total), int(self._all.numbers[best]), 2.0 * float(g))
            for (f, _, best), o, g in zip(found, odds, logs, strict=True)
        ]
        return sorted(made, key=lambda rival: -rival.probability)

    def values(self, candidates: Candidates) -> Array:
        """ln evidence of each hypothesis without steps, spectra summed."""
        return np.asarray(logsumexp(self._evidence(candidates)[0], axis=0)[1:])

    def best(self, candidates: Candidates | None = None, most: int = 1) -> dict[str, list[int]]:
        """The most likely hypotheses of each family without steps, the best first, by the numbers of their groups."""
        own = self._all if candidates is None else candidates
        order = np.argsort(-self.values(own))
        return {f: own.numbers[order[own.families[order] == f][:most]].tolist() for f in own.count}

    def _evidence(self, candidates: Candidates) -> tuple[Array, Array]:
        """ln evidence without steps, (spectra, 1 + h): of the residual, and of it less the steps that drift has."""
        if candidates not in self._known_evidence:
            both = candidates.log_evidence(self._residuals, self._beside, self._spectra)
            self._known_evidence[candidates] = both[:, :, 0], both[:, :, -1]
        return self._known_evidence[candidates]

    @cached_property
    def _residuals(self) -> Array:
        """The residual, and it less the steps that drift has where it has any; shape (n, 1) or (n, 2)."""
        y = self._y[:, None]
        alone = self._nothing.log_evidence(y, self._beside)[:, 0, 0]
        at = np.argsort(-alone)[:: max(1, len(alone) // 6)].tolist()[:_SPECTRA]
        found = max((self._greedy(k, None, 0.0) for k in at), key=lambda g: g.log_evidence)
        if not found.steps:
            return y
        tidy = y.copy()
        for row, size in found.steps:
            part = next(p for p in self._all.whitening.parts if p.start <= row < p.stop)
            tidy[row + 1 : part.stop] -= size
        return np.hstack([y, tidy])

    def _family(
        self, name: str, picks: list[int], own: NDArray[np.int_], each: Sequence[Array], spectra: Sequence[int]
    ) -> tuple[float, int]:
        """ln evidence of a family with steps, from those of its hypotheses that do best, and the best of them."""
        terms = []
        for h in picks:
            x = max(each, key=lambda values: float(values[h]))
            # what the picks leave of the family's own evidence is counted with them
            left = float(logsumexp(x[own]) - logsumexp(x[picks])) - np.log(self._all.count[name]) + self._all.shares[h]
            for k in spectra:
                terms += [(left + self._greedy(k, h, s * s).log_evidence - np.log(_SIZES.size), h) for s in _JUDGED]
        values = np.array([v for v, _ in terms])
        best = {h: float(logsumexp(values[[i for i, (_, g) in enumerate(terms) if g == h]])) for h in picks}
        return float(logsumexp(values)), max(best, key=lambda h: best[h])

    def _base(self, k: int) -> tuple[Array, Array, Array, Array, float]:
        """Residual whitened beside what is selected; a basis of that; its part in steps; steps with it; base."""
        if k not in self._known:
            w, q = self._all.whitening, self._beside.shape[1]
            W = w.white(k, np.column_stack([self._beside, self._y]))
            Q, R = np.linalg.qr(W[:, :q])
            y = W[:, q] - Q @ (Q.T @ W[:, q])
            log_det = w.log_det(k) + 2.0 * float(np.sum(np.log(np.abs(np.diag(R)) + 1e-300)))
            U = self._in_steps(k, Q)
            self._known[k] = y, Q, U, self._in_steps(k, y[:, None])[:, 0], w.log_prior[k] - 0.5 * log_det
        return self._known[k]

    def _in_steps(self, k: int, W: Array) -> Array:
        """Products of all steps with whitened columns, (steps, m)."""
        steps, _ = self._all.whitening.steps(k)
        return np.concatenate([s.T @ W[p] for s, p in zip(steps, self._all.whitening.parts, strict=True)])

    def _columns(self, k: int, hypothesis: int) -> tuple[Array, Array, Array]:
        """Products of a hypothesis' whitened columns with each other, with the residual, and with all steps."""
        if (k, hypothesis) not in self._of:
            y, Q, *_ = self._base(k)
            H = self._all.whitening.white(k, self._all.of(hypothesis))
            H = H - Q @ (Q.T @ H)
            self._of[k, hypothesis] = H.T @ H, H.T @ y, self._in_steps(k, H)
        return self._of[k, hypothesis]

    def _greedy(self, k: int, hypothesis: int | None, size: float) -> _Greedy:
        """Take steps beside a hypothesis as long as they are worth their places.

        `size`: prior variance of its orthonormal columns, over that of the white noise.
        """
        y, Q, U0, b0, base = self._base(k)
        _, products = self._all.whitening.steps(k)
        M = b0.size
        b, yy = b0.copy(), float(y @ y)
        half = 0.5 * (y.size - len(self._all.whitening.parts) - Q.shape[1])
        lam = np.concatenate([np.diag(B) for B in products]) - np.sum(U0**2, axis=1)
        U, logs = [U0], 0.0
        if hypothesis is not None:
            D, right, cross = self._columns(k, hypothesis)
            inverse = np.linalg.inv(D + np.eye(len(D)) / size)
            logs += float(np.linalg.slogdet(np.eye(len(D)) + size * D)[1])
            root = np.linalg.cholesky(inverse)
            V = cross @ root
            yy -= float(right @ inverse @ right)
            b -= cross @ (inverse @ right)
            lam = lam - np.sum(V**2, axis=1)
            U.append(V)
        U_all = np.hstack(U)
        lam = np.maximum(lam, 1e-12)
        starts = np.cumsum([0, *(len(B) for B in products)])
        path, chosen, taken, prior = [base - 0.5 * logs - half * np.log(yy)], [], np.zeros(M, bool), 0.0
        best = 0
        for number in range(_MOST_STEPS):
            value = -half * np.log(np.maximum(yy - b**2 * _STEP / (1.0 + _STEP * lam), 1e-12 * yy)) - 0.5 * np.log1p(
                _STEP * lam
            )
            value[taken] = -np.inf
            i = int(np.argmax(value))
            taken[i] = True
            row = -(U_all @ U_all[i])
            r = int(np.searchsorted(starts, i, side="right")) - 1
            row[starts[r] : starts[r + 1]] += products[r][i - starts[r]]
            den = 1.0 + _STEP * lam[i]
            yy -= b[i] ** 2 * _STEP / den
            logs += float(np.log(den))
            b = b - row * (b[i] * _STEP / den)
            v = row * np.sqrt(_STEP / den)
            U_all = np.column_stack([U_all, v])
            lam = np.maximum(lam - v**2, 1e-12)
            chosen.append(i)
            prior += float(np.log(number + 1.0) - np.log(2.0 * M))
            path.append(base - 0.5 * logs - half * np.log(yy) + prior)
            if path[-1] > path[best]:
                best = len(path) - 1
            if len(path) - 1 - best >= _WAITED:
                break
        found = self._sizes(k, chosen[:best]) if hypothesis is None and best else []
        return _Greedy(float(logsumexp(path)), found)

    def _sizes(self, k: int, chosen: Sequence[int]) -> list[tuple[int, float]]:
        """Steps that were chosen with their sizes, fitted together."""
        y, Q, _, _, _ = self._base(k)
        w = self._all.whitening
        steps, products = w.steps(k)
        starts = np.cumsum([0, *(len(B) for B in products)])
        X = np.zeros((y.size, len(chosen)))
        for j, i in enumerate(chosen):
            r = int(np.searchsorted(starts, i, side="right")) - 1
            X[w.parts[r], j] = steps[r][:, i - starts[r]]
        X -= Q @ (Q.T @ X)
        theta = np.linalg.solve(X.T @ X + np.eye(len(chosen)) / _STEP, X.T @ y)
        return [(int(self._places[i]), float(x)) for i, x in zip(chosen, theta.tolist(), strict=True)]
