"""What a series of means shows beside its own noise: closed-form evidence of each kind of effect, against all others.

A series is y = c + H b + n, n of covariance C = σ² (I + ρ D), D that of flicker noise or of a random walk, c and σ not
known at all, ρ one of a grid, b with Zellner's prior N(0, g σ² (HᵀPH)⁻¹), P the inverse of C less what c takes of it, g
one of a grid. Then, for k columns H,

    p(y | kind, ρ, g) ∝ |I + ρD|^-½ (1ᵀC⁻¹1)^-½ (yᵀPy)^-(n-1)/2 (1 + g)^-k/2 (1 - g/(1+g) R²)^-(n-1)/2,

R² the share of yᵀPy that H explains. It is summed over ρ, g and what else is not known of the kind (when, how fast).
Smooth drift and single outliers are rivals that nobody is told of. All that does not depend on y is worked out once for
each n.

References
----------
A. Zellner, "On assessing prior distributions and Bayesian regression analysis with g-prior distributions", 1986.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from filters.types import Array

SIZES = (32, 40, 48, 56, 64, 128)  # lengths of series
PRIOR: dict[str, float] = {
    "nothing": 1.0, "drift 1": 0.01, "drift 2": 0.005, "drift 3": 0.005, "outlier": 0.02,
    "tone": 5e-3, "step": 2e-6, "telegraph": 3e-9, "thermal_lin": 0.1, "thermal_rate": 0.01,
}  # fmt: skip
"""Weights before the data; a driver's are for a temperature that moves.

Steps and levels are rare, and drift of measured units is not Gaussian: their weights are such that none is told of an
ADIS16405 at rest, 2.8 h, of which a trace of the whole recording knows nothing but drift.
"""
FASTEST = 0.27  # cycles from one mean to the next: what is faster folds over what is slower
MOST_ODDS = 1e6
_OUTLIERS = (1, 2, 4)  # means in which a reading is off
CYCLES = 3.0  # of an oscillation in a series, at least
_G = np.array([10.0, 1e2, 1e3, 1e4])
_RATIOS = (0.0, *np.geomspace(1e-3, 10.0, 5))  # variance of drift within a series over that of white noise / n


@dataclass(frozen=True, slots=True)
class Found:
    """The logarithm of the weight of a kind, and its likeliest case."""

    weight: float
    size: float = 0.0
    sd: float = 0.0
    extent: float = 0.0
    at: float = 0.0  # begin, as a share of what was looked at
    cycles: float = 0.0  # from one mean to the next


class _Design:
    """All that depends on the number of blocks alone: noise models, and kinds of effects in their metric."""

    def __init__(self, n: int) -> None:
        self.n = n
        C = np.eye(n) + _covariances(n)
        Ci = np.linalg.inv(C)
        ones = Ci.sum(axis=2)
        total = ones.sum(axis=1)
        self.P = Ci - ones[:, :, None] * ones[:, None, :] / total[:, None, None]
        self.base = -0.5 * (np.linalg.slogdet(C)[1] + np.log(total)) - np.log(len(C))
        i = np.arange(n)
        steps = (i[:, None] >= i[2:-2]).astype(float)
        self.steps = 2 + np.arange(steps.shape[1])
        bumps = np.hstack([np.tri(n) - np.tri(n, k=-width) for width in _OUTLIERS])
        powers = np.asarray(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n), 3)[:, 1:], np.float64)
        self.cycles = np.arange(2.0 * CYCLES, 2.0 * FASTEST * n) / (2 * n)
        phase = 2.0 * np.pi * self.cycles * i[:, None]
        waves = np.stack([np.cos(phase), np.sin(phase)], axis=2)
        self.step, self.step_norm = _metric(self.P, steps[:, :, None])
        self.bump, _ = _metric(self.P, bumps[:, :, None])
        self.wave, self.wave_norm = _metric(self.P, np.asarray(waves, float))
        self.drift = [_metric(self.P, powers[:, None, :k])[0] for k in (1, 2, 3)]
        self.stride = max(1, n // 32)
        edges = np.arange(0, steps.shape[1], self.stride)
        first, last = np.triu_indices(edges.size, 1)
        self.first, self.last = edges[first], edges[last]
        PH = self.P @ steps
        G = steps.T @ PH
        diagonal = np.diagonal(G, axis1=1, axis2=2)
        self.box_norm = np.sqrt(np.maximum(diagonal[:, :, None] + diagonal[:, None] - 2.0 * G, 1e-300))


@cache
def _design(n: int) -> _Design:
    return _Design(n)


def prepare() -> None:
    """Work out, before anything has to be told in time, what depends on the number of blocks alone."""
    for n in SIZES:
        _design(n)


def _covariances(n: int) -> Array:
    """Covariances of drift over that of white noise, one a model, (M, n, n): of flicker noise and of a random walk."""
    i = np.arange(n)
    lag = np.abs(i[:, None] - i)
    flicker = np.mean([np.exp(-lag / 2.0**k) for k in range(1, 10)], axis=0)
    walk = np.minimum(i[:, None], i) / n
    flickers = [ratio * 30.0 * flicker for ratio in _RATIOS]
    return np.array([*flickers, *(ratio * n * walk for ratio in _RATIOS[1:])])


def _metric(P: Array, H: Array) -> tuple[Array, Array]:
    """Rows that make scores of a series, and what makes amplitudes of scores, in every noise model.

    `H`: candidates of k columns, (n, R, k). Returns (M, R, k, n), orthonormal in the metric P, and (M, R), the root of
    the mean of hᵀPh.
    """
    PH = np.einsum("mij,jrk->mirk", P, H, optimize=True)
    G = np.einsum("irk,mirl->mrkl", H, PH, optimize=True)
    least = 1e-12 * np.trace(G, axis1=2, axis2=3)[..., None, None] * np.eye(H.shape[2])
    Li = np.linalg.inv(np.linalg.cholesky(G + least))
    rows = np.ascontiguousarray(np.einsum("mrkl,mirl->mrki", Li, PH, optimize=True))
    return rows, np.sqrt(np.trace(G, axis1=2, axis2=3) / H.shape[2])


def log_factor(share: Array, columns: int, n: int) -> Array:
    """Logarithm of the Bayes factor of candidates that explain a share of yᵀPy, mean over g; n < 150."""
    share = np.minimum(share, 1.0 - 1e-12)
    total = np.zeros(share.shape)
    for g in _G.tolist():
        # at most (1 + g)^(n/2), which does not overflow
        one = np.log(1.0 - g / (1.0 + g) * share)
        one *= -0.5 * (n - 1)
        one -= 0.5 * columns * np.log1p(g)
        total += np.exp(one, out=one)
    return np.asarray(np.log(total / _G.size))


class Look:
    """One series against those kinds that its methods weigh.

    `y`: shape (n,), n of `SIZES`; not constant.
    `drift`: weight of each model of drift over that of white noise.
    """

    def __init__(self, y: Array, drift: float = 1.0) -> None:
        self.design = _design(y.size)
        self.y = y - y.mean()
        self.q = np.maximum((self.design.P @ self.y) @ self.y, 1e-300)
        self.null = self.design.base - 0.5 * (y.size - 1) * np.log(self.q)
        self.null[1:] += np.log(drift)
        self._weights: dict[str, Array] = {}  # of each case of a kind, not yet with its prior
        self._fits: dict[str, tuple[int, Array]] = {}  # noise model and columns of the likeliest case
        self.found: dict[str, Found] = {"nothing": Found(float(np.logaddexp.reduce(self.null)))}

    def _columns(self, kind: str, rows: Array) -> tuple[int, int, Array]:
        """Weigh a kind of candidates; returns model and candidate of the likeliest, and the scores."""
        scores = rows @ self.y
        return (*self._weigh(kind, np.sum(scores**2, axis=2), rows.shape[2]), scores)

    def _weigh(self, kind: str, squares: Array, columns: int = 1, prior: Array | None = None) -> tuple[int, int]:
        """Weigh a kind by what its candidates explain, (M, R); returns model and candidate of the likeliest.

        `prior`: logarithm of each candidate's, (R,); all the same without it.
        """
        each = self.null[:, None] + log_factor(squares / self.q[:, None], columns, self.y.size)
        each += -np.log(each.shape[1]) if prior is None else prior
        m, r = np.unravel_index(int(np.argmax(each)), each.shape)
        self._weights[kind] = np.logaddexp.reduce(each, axis=0)
        self.found[kind] = Found(float(np.logaddexp.reduce(self._weights[kind])) + np.log(PRIOR[kind]))
        return int(m), int(r)

    def _sigma(self, m: int, explained: float) -> float:
        return float(np.sqrt(max(self.q[m] - explained, 1e-12 * self.q[m]) / max(self.y.size - 2, 1)))

    def rivals(self) -> None:
        """Weigh what is not told."""
        self._columns("outlier", self.design.bump)
        for k, rows in enumerate(self.design.drift):
            self._columns(f"drift {k + 1}", rows)

    def steps(self) -> Array:
        """Weigh a step; returns scores of steps, not yet divided by their norms, (M, R)."""
        d = self.design
        m, r, scores = self._columns("step", d.step)
        s, norm = scores[m, r, 0], d.step_norm[m, r]
        self._put("step", m, self._from(r), s**2, s / norm, 1.0 / norm, at=d.steps[r] / d.n)
        return np.asarray(scores[:, :, 0] * d.step_norm)

    def telegraph(self, scores: Array) -> None:
        """Weigh a level that is left again."""
        d = self.design
        first, last = d.first, d.last
        share = ((scores[:, first] - scores[:, last]) / d.box_norm[:, first, last]) ** 2 / self.q[:, None]
        likely = self.null[:, None] - 0.5 * (d.n - 1) * np.log(1.0 - np.minimum(share, 1.0 - 1e-12))
        best = int(np.argmax(likely.max(axis=0)))
        # all about the likeliest of a coarse grid: a level whose ends lie between its lines looks like drift
        near = np.arange(1 - d.stride, d.stride)
        begin, end = (x.ravel() for x in np.meshgrid(first[best] + near, last[best] + near))
        inside = (begin >= 0) & (begin < end) & (end < d.steps.size)
        first, last = np.append(first, begin[inside]), np.append(last, end[inside])
        prior = np.repeat(-np.log(d.first.size * np.array([1.0, d.stride**2])), [d.first.size, np.sum(inside)])
        s = (scores[:, first] - scores[:, last]) / d.box_norm[:, first, last]
        m, r = self._weigh("telegraph", s**2, prior=prior)
        norm = d.box_norm[m, first[r], last[r]]
        box = self._from(first[r]) - self._from(last[r])
        self._put("telegraph", m, box, s[m, r] ** 2, s[m, r] / norm, 1.0 / norm, at=d.steps[first[r]] / d.n)

    def tone(self) -> None:
        """Weigh an oscillation."""
        d = self.design
        m, r, scores = self._columns("tone", d.wave)
        square, norm = float(np.sum(scores[m, r] ** 2)), d.wave_norm[m, r]
        # a mean over a block is smaller than what is in it
        smaller = norm * np.sinc(d.cycles[r])
        phase = 2.0 * np.pi * d.cycles[r] * np.arange(d.n)
        waves = np.column_stack([np.cos(phase), np.sin(phase)])
        self._put("tone", m, waves, square, np.sqrt(square) / smaller, 1.0 / smaller, cycles=float(d.cycles[r]))

    def driver(self, kind: str, x: Array) -> None:
        """Weigh a linear dependence on a series x, (n,)."""
        column = (x - x.mean())[:, None]
        rows, norm = _metric(self.design.P, column[:, None])
        m, _, scores = self._columns(kind, rows)
        s = float(scores[m, 0, 0])
        self._put(kind, m, column, s**2, s / norm[m, 0], 1.0 / norm[m, 0], extent=float(np.ptp(x)))

    def _from(self, step: int) -> Array:
        return np.asarray(np.arange(self.design.n) >= self.design.steps[step], float)[:, None]

    def _put(
        self, kind: str, m: int, columns: Array, square: float, size: float, sd: float, *, extent: float = 1.0,
        at: float = 0.0, cycles: float = 0.0,
    ) -> None:  # fmt: skip
        self._fits[kind] = m, columns
        sd *= self._sigma(m, square)
        weight = self.found[kind].weight
        self.found[kind] = Found(weight, float(size), float(sd), float(abs(size) * extent), float(at), cycles)

    def without(self, kind: str) -> Array:
        """The series without the likeliest case of a kind, (n,)."""
        m, H = self._fits[kind]
        PH = self.design.P[m] @ H
        return np.asarray(self.y - H @ np.linalg.solve(H.T @ PH, PH.T @ self.y), float)

    def log_factor(self, kind: str, cycles: float = 0.0) -> float:
        """Logarithm of the Bayes factor of a kind, a tone of `cycles` from one mean to the next, against all others."""
        each = self._weights[kind]
        if kind == "tone":
            each = each[np.abs(self.design.cycles - cycles) <= 0.75 / self.y.size]
        others = np.logaddexp.reduce([f.weight for k, f in self.found.items() if k != kind])
        # each has its share of one
        return float(np.logaddexp.reduce(each) + np.log(self._weights[kind].size / each.size) - others)

    def odds(self, *kinds: str) -> float:
        """Of one or the other kind against all others."""
        these = np.logaddexp.reduce([f.weight for k, f in self.found.items() if k in kinds])
        others = np.logaddexp.reduce([f.weight for k, f in self.found.items() if k not in kinds])
        return float(np.exp(min(these - others, np.log(MOST_ODDS))))
