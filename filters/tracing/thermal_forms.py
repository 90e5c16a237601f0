"""Curve in temperature, memory of it and drift of a channel: forms by exact likelihood, and what all say together.

Forms: a curve of order 0 to 3, one lag or none, one bank of play operators or none, always with a random walk beside
them. All are linear in the same columns, so that the whitening filter runs once for each level of the walk and every
form is a small solve from one Gram matrix. A form's evidence is its -2 log likelihood and the price of its parameters
and of its choice; prior standard deviations of three times the channel's spread keep what data hardly see in bounds.
Forms name what was found, and say what else it may be.

What is foretold takes all columns at once, factors of mean zero: those of lags and of plays have standard deviations of
their own, in the catalogue's plausible hysteresis, and all of these that a grid has are averaged by their marginal
likelihood, with the levels of the walk. Where data do not separate columns, as curve and play after one way only, the
prior does, and the covariance says by how much they may differ elsewhere. Neither columns nor walk are quite right, so
that evidence counts a third, in the fit and in the average: a power likelihood (Grünwald & van Ommen, Bayesian Analysis
12, 2017). Errors are then half their standard deviation on a third leg of simulated cycles (`benchmarks/thermal.py`).

It leaves out: how much of it is carried over to other runs, what becomes of the effects that were selected before (both
`thermal_memory`).
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from filters.channels import error_unit
from filters.effects.deterministic import hysteresis
from filters.effects.inputs import BANKS, LAGS, REFERENCE_DEGC
from filters.effects.thermal_average import ORDERS, columns
from filters.tracing.beside_drift import by_seconds
from filters.tracing.columns import WIDE_K
from filters.tracing.design_matrix import Design
from filters.tracing.stack import Stack
from filters.tracing.whitening import LEVELS, Drift, profile, whiten
from filters.types import Array

_TEMPER = 3.0
_PRIOR = 3.0  # of a curve's factor, and of all of a form, in standard deviations of the channel
_MEMORIES = tuple(itertools.product((0.03, 0.1, 0.3, 1.0, 3.0), repeat=2))
"""Prior standard deviations of the factors of lags and of plays, in the catalogue's plausible hysteresis."""
_LIKELY, _DECADE = 0.3, 3.0  # which of these is the likeliest, and the factor from it that is one standard deviation
_ROW_S = 2.0
_ROWS = 4000
_WALK_LEVELS = (*LEVELS, 10.0, 20.0)
_WALK_S = 100.0
_LEAST_WEIGHT = 1e-4
_SAME = 0.02  # share of evidence below which a form is not told of


@dataclass(frozen=True)
class Form:
    """One form: its columns, and how it fits."""

    order: int  # of the curve, 0 to 3
    # lag, bank: number in `LAGS` and in `BANKS`
    lag: int | None
    bank: int | None
    score: float = np.inf  # -2 log likelihood and prices: the less the better
    weight: float = 0.0  # its share of the evidence
    # theta, covariance: factors of its columns in the channel's unit of error, shape (k,), and their covariance
    theta: Array = field(default_factory=lambda: np.zeros(0))
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def places(self) -> list[int]:
        """Its columns among those of `thermal_average.columns`."""
        lag = [] if self.lag is None else [ORDERS + self.lag]
        return [*range(self.order), *lag, *([] if self.bank is None else [ORDERS + len(LAGS) + self.bank])]

    @property
    def price(self) -> float:
        """What its choice costs beside its parameters."""
        chosen = (1 if self.lag is None else len(LAGS)) * (1 if self.bank is None else len(BANKS))
        return 2.0 * float(np.log(chosen))

    @property
    def effect(self) -> str:
        """Its name in the catalogue; of a lag and a play together that of the larger; "" of none at all."""
        if self.lag is not None and self.bank is not None and self.theta.size:
            return "thermal_lag" if abs(self.theta[-2]) > abs(self.theta[-1]) else "hysteresis"
        if self.bank is not None:
            return "hysteresis"
        if self.lag is not None:
            return "thermal_lag"
        return ("", "thermal_lin", "thermal_poly", "thermal_poly")[self.order]


@dataclass(frozen=True)
class Average:
    """What forms and all columns together say of a channel."""

    forms: tuple[Form, ...]  # those that carry weight, the most first
    # weights, covariance: factors of all of `thermal_average.columns` in the channel's unit of error, shape (K,), and
    # their covariance, shape (K, K)
    weights: Array
    covariance: Array
    # score, none: of the best form, and of no form at all
    score: float
    none: float
    # low, high: range of temperature, degC
    low: float
    high: float

    @property
    def families(self) -> list[tuple[Form, float]]:
        """The best form of each effect and the evidence of all its forms, the most first."""
        total: dict[str, float] = {}
        best: dict[str, Form] = {}
        for form in self.forms:
            total[form.effect] = total.get(form.effect, 0.0) + form.weight
            best.setdefault(form.effect, form)
        order = sorted((name for name in total if name), key=lambda name: -total[name])
        return [(best[name], total[name]) for name in order if total[name] > _SAME or name == order[0]]


@dataclass(frozen=True)
class JointChoice:
    """An average that was selected, and what of it is carried over."""

    average: Average  # the forms, and what they say together
    # theta, sd: amplitudes of the mean and of its spreads as they are carried over to other runs, and their standard
    # deviations, shape (k,)
    theta: Array
    sd: Array

    @property
    def covariance(self) -> Array:
        """Of the amplitudes: none is told from another, shape (k, k)."""
        return np.diag(self.sd**2)


# ------------------------------------------------------------------------------------------------------------ the rows


@dataclass(frozen=True)
class Rows:
    """Means of some seconds of a channel: what forms are fitted to."""

    y: Array  # residual in the channel's unit of error, shape (n,)
    beside: Array  # columns of what else is there, shape (n, m)
    instead: Array  # columns of what the forms are to take the place of, shape (n, k)
    columns: Array  # those of `thermal_average.columns`, shape (n, K)
    # t, variance: s; of the white noise, unit²; shape (n,)
    t: Array
    variance: Array
    begins: NDArray[np.int_]  # first row of each power-on
    # low, high: range of temperature, degC
    low: float
    high: float


def rows_of(design: Design, channel: int, y: Array, beside: Array, instead: Array) -> Rows | None:
    """Rows of a channel; None where temperature is not known or does not go far enough.

    `y`: its residual, SI, shape (n,).
    `beside`: columns to be fitted beside the forms, SI, shape (n, m).
    `instead`: columns that the forms are to take the place of, shape (n, k).
    """
    stack = design.stack
    temperature = np.concatenate([b.slow_inputs.temperature.level for b in stack.blocks])
    if not np.isfinite(temperature).all() or np.ptp(temperature) < WIDE_K:
        return None
    low, high = float(temperature.min()), float(temperature.max())
    made = _columns(stack, low, high)
    si = error_unit(channel)[1]
    seconds = max(_ROW_S, stack.period * stack.t.size / _ROWS)
    raw = np.column_stack([y / si, beside, instead, made])
    rows = by_seconds(design, channel, raw, seconds)
    parts = np.split(rows.values, np.cumsum([1, beside.shape[1], instead.shape[1]]), axis=1)
    return Rows(parts[0][:, 0], parts[1], parts[2], parts[3], rows.t, rows.variance / si**2, rows.starts, low, high)


def _columns(stack: Stack, low: float, high: float) -> Array:
    """Those of `thermal_average.columns` over all runs, shape (n, K)."""
    histories = [b.slow_inputs.temperature for b in stack.blocks]
    return np.concatenate([np.column_stack(columns(x.level, x.lagged, x.plays, low, high)) for x in histories])


# ----------------------------------------------------------------------------------------------------------- evidence


def all_forms() -> list[Form]:
    """Every form there is, no form at all first."""
    lags, banks = (None, *range(len(LAGS))), (None, *range(len(BANKS)))
    return [Form(order, lag, bank) for order in range(ORDERS + 1) for lag in lags for bank in banks]


_Gram = tuple[Array, Array, float]  # what `gram_of` returns


@dataclass(frozen=True)
class _Fitted:
    """All forms with one level of the walk: scores, shape (M,), factors (M, k) and their covariances (M, k, k)."""

    scores: Array
    theta: Array
    covariance: Array


def walks(rows: Rows) -> list[Drift]:
    """Levels of the random walk that are tried."""
    period = float(np.median(np.diff(rows.t)))
    unit = float(np.sqrt(np.median(rows.variance[np.isfinite(rows.variance)]) * period))
    return [Drift(np.inf, level * unit / float(np.sqrt(_WALK_S))) for level in _WALK_LEVELS]


def _fit_all(gram: _Gram, forms: Sequence[Form], places: NDArray[np.int_], spread: float, seconds: float) -> _Fitted:
    """Fit all forms beside one walk."""
    G, b, rest = gram
    prior = np.append(np.full(b.size, _PRIOR * spread), 1.0)
    # one column more that is nothing, for forms with fewer columns than the widest
    G, b = np.pad(G, (0, 1)), np.append(b, 0.0)
    scale = prior[places]
    A = G[places[:, :, None], places[:, None, :]] * scale[:, :, None] * scale[:, None, :] + np.eye(places.shape[1])
    inverse = np.linalg.inv(A)
    right = b[places] * scale
    theta = np.einsum("mij,mj->mi", inverse, right)
    prices = np.array([len(f.places) * np.log(seconds) + f.price for f in forms])
    scores = rest - np.sum(right * theta, axis=1) + prices
    return _Fitted(scores, theta * scale, inverse * scale[:, :, None] * scale[:, None, :])


def _spread(rows: Rows) -> float:
    used = np.isfinite(rows.variance)
    return float(np.std(rows.y[used]))


def gram_of(rows: Rows, walk: Drift) -> _Gram:
    """Gram matrix and right side of the forms' columns, what stands beside them fitted; -2 log likelihood without."""
    raw = np.column_stack([rows.y, rows.beside, rows.columns])
    W, log_det = whiten(raw, rows.t, rows.begins, rows.variance, walk)
    m = rows.beside.shape[1]
    if m:
        scale = np.maximum(np.linalg.norm(W[:, 1 : 1 + m], axis=0), 1e-300)
        basis = W[:, 1 : 1 + m] / scale
        W = np.delete(W, np.s_[1 : 1 + m], axis=1)
        W = W - basis @ np.linalg.lstsq(basis, W, rcond=1e-10)[0]
    y, X = W[:, 0], W[:, 1:]
    return X.T @ X, X.T @ y, float(y @ y) + log_det


def average(rows: Rows, channel: int) -> Average:
    """All forms, fitted, and all columns together; `channel` says how large memory of temperature plausibly is."""
    forms = all_forms()
    widest = max(len(f.places) for f in forms)
    nothing = rows.columns.shape[1]
    places = np.array([f.places + [nothing] * (widest - len(f.places)) for f in forms])
    seconds = float(rows.t.size) * float(np.median(np.diff(rows.t)))
    grams = [gram_of(rows, walk) for walk in walks(rows)]
    spread = _spread(rows)
    fitted = [_fit_all(gram, forms, places, spread, seconds) for gram in grams]
    scores = np.array([f.scores for f in fitted])
    mean, covariance = together(grams, spread, hysteresis(channel).parameters[0].prior)
    return Average(
        tuple(_weighed(fitted, forms, scores, _shares(scores))),
        mean,
        covariance,
        float(scores.min()),
        float(scores[:, 0].min()),
        rows.low,
        rows.high,
    )


def _shares(scores: Array) -> Array:
    """Shares of the evidence."""
    weights = np.exp(-0.5 * (scores - scores.min()) / _TEMPER)
    return np.asarray(weights / weights.sum())


def together(grams: Sequence[_Gram], spread: float, plausible: float) -> tuple[Array, Array]:
    """Mean and covariance of the factors of all columns, over levels of the walk and sizes of memory.

    `spread`: standard deviation of the channel; `plausible`: size of its hysteresis; in its unit of error.
    """
    size = grams[0][1].size
    of_memory = np.array(_MEMORIES)
    priors = np.full((len(_MEMORIES), size), _PRIOR * max(spread, plausible))
    priors[:, ORDERS : ORDERS + len(LAGS)] = plausible * of_memory[:, :1]
    priors[:, ORDERS + len(LAGS) :] = plausible * of_memory[:, 1:]
    unlikely = np.sum((np.log(of_memory / _LIKELY) / np.log(_DECADE)) ** 2, axis=1)
    scores = np.array([_marginal(gram, priors) + unlikely for gram in grams])
    weights = _shares(scores)
    mean, second = np.zeros(size), np.zeros((size, size))
    for d, m in np.argwhere(weights > _LEAST_WEIGHT * weights.max()).tolist():
        (G, b, _), scale = grams[d], priors[m]
        covariance = np.linalg.inv(scale[:, None] * G * scale / _TEMPER + np.eye(size)) * np.outer(scale, scale)
        theta = covariance @ b / _TEMPER
        mean += weights[d, m] * theta
        second += weights[d, m] * (np.outer(theta, theta) + covariance)
    return mean, second - np.outer(mean, mean)


def _marginal(gram: _Gram, priors: Array) -> Array:
    """-2 log marginal likelihood under each of some priors' standard deviations, shape (m, K)."""
    G, b, rest = gram
    A = priors[:, :, None] * G * priors[:, None, :] + np.eye(b.size)
    right = priors * b
    taken = np.sum(right * np.linalg.solve(A, right[:, :, None])[:, :, 0], axis=1)
    return np.asarray(rest - taken + np.linalg.slogdet(A).logabsdet)


def _weighed(fitted: Sequence[_Fitted], forms: Sequence[Form], scores: Array, weights: Array) -> list[Form]:
    """Forms that carry weight, each with its likeliest walk, the most first."""
    total, best = weights.sum(axis=0), scores.argmin(axis=0)
    out = []
    for m in np.argsort(-total).tolist():
        if total[m] < _LEAST_WEIGHT:
            break
        k, own = len(forms[m].places), fitted[int(best[m])]
        known = replace(
            forms[m],
            score=float(scores[best[m], m]),
            weight=float(total[m]),
            theta=own.theta[m, :k],
            covariance=own.covariance[m, :k, :k],
        )
        out.append(known)
    return out


def score_before(rows: Rows, price: float) -> float:
    """Score of what the forms are to take the place of, beside its best walk.

    `price`: what its parameters and its choice cost.
    """
    raw = np.column_stack([rows.y, rows.beside, rows.instead])
    made = (whiten(raw, rows.t, rows.begins, rows.variance, walk) for walk in walks(rows))
    return min(profile(W) + log_det for W, log_det in made) + price


def curve_in_kelvins(form: Form, low: float, high: float) -> tuple[Array, Array]:
    """A form's curve as factors of (T - T0), (T - T0)², …, in the channel's unit per Kⁿ, and their covariance.

    Lag and play, which stand beside T, take their share off the first.
    """
    half, shift = 0.5 * (high - low), REFERENCE_DEGC - 0.5 * (low + high)
    # u = (dT + shift) / half, and its powers, as polynomials in dT
    u = np.polynomial.Polynomial([shift / half, 1.0 / half])
    order = max(form.order, 1)
    M = np.zeros((order, form.theta.size))
    for n in range(form.order):
        M[: n + 1, n] = (u ** (n + 1)).coef[1:]
    if form.bank is not None:
        M[0, -1] = -1.0 / half
    return M @ form.theta, M @ form.covariance @ M.T
