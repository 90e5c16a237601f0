"""Curve in temperature, memory of it and drift of a channel, chosen jointly by exact likelihood and averaged.

Forms: a curve of order 0 to 3, one lag or none, one bank of play operators or none, always with a random walk beside
them. All are linear in the same columns, so that the whitening filter runs once for each level of the walk and every
form is a small solve from one Gram matrix. A form's evidence is its -2 log likelihood and the price of its parameters
and of its choice; prior standard deviations of three times the channel's spread keep what data hardly see in bounds.

Forms that fit alike are averaged by their evidence. What is known is more than forms that are all a little wrong can
tell: evidence counts a third (a temperature of 3), which made errors on a third leg as large as their standard
deviations on simulated cycles.

It leaves out: how much of an average is carried over to other runs, what becomes of the effects that were selected
before (both `thermal_memory`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from filters.channels import error_unit
from filters.effects.inputs import BANKS, LAGS, REFERENCE_DEGC
from filters.effects.thermal_average import ORDERS, columns
from filters.tracing.beside_drift import by_seconds
from filters.tracing.columns import WIDE_K
from filters.tracing.design_matrix import Design
from filters.tracing.stack import Stack
from filters.tracing.whitening import LEVELS, Drift, profile, whiten
from filters.types import Array

_TEMPER = 3.0
_PRIOR = 3.0  # of a column's factor, in standard deviations of the channel
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
    """What forms say together of a channel."""

    forms: tuple[Form, ...]  # those that carry weight, the most first
    weights: Array  # of the columns of `thermal_average.columns`, in the channel's unit of error, shape (K,)
    covariance: Array  # within and between forms, shape (K, K)
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


def _fit_all(rows: Rows, forms: Sequence[Form], places: NDArray[np.int_], walk: Drift, seconds: float) -> _Fitted:
    """Fit all forms beside one walk."""
    G, b, rest = _gram(rows, walk)
    n = b.size
    prior = np.append(np.full(n, _PRIOR * _spread(rows)), 1.0)
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


def _gram(rows: Rows, walk: Drift) -> tuple[Array, Array, float]:
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


def average(rows: Rows) -> Average:
    """All forms, fitted and averaged."""
    forms = all_forms()
    widest = max(len(f.places) for f in forms)
    nothing = rows.columns.shape[1]
    places = np.array([f.places + [nothing] * (widest - len(f.places)) for f in forms])
    seconds = float(rows.t.size) * float(np.median(np.diff(rows.t)))
    fitted = [_fit_all(rows, forms, places, walk, seconds) for walk in walks(rows)]
    scores = np.array([f.scores for f in fitted])
    weights = np.exp(-0.5 * (scores - scores.min()) / _TEMPER)
    weights /= weights.sum()
    mean, covariance = _moments(fitted, forms, weights, nothing)
    return Average(
        tuple(_weighed(fitted, forms, scores, weights)),
        mean,
        covariance,
        float(scores.min()),
        float(scores[:, 0].min()),
        rows.low,
        rows.high,
    )


def _moments(fitted: Sequence[_Fitted], forms: Sequence[Form], weights: Array, size: int) -> tuple[Array, Array]:
    """Mean and covariance of the factors of all columns, within and between forms."""
    mean, second = np.zeros(size), np.zeros((size, size))
    for d, m in np.argwhere(weights > _LEAST_WEIGHT * weights.max()).tolist():
        at, k = forms[m].places, len(forms[m].places)
        theta = fitted[d].theta[m, :k]
        mean[at] += weights[d, m] * theta
        second[np.ix_(at, at)] += weights[d, m] * (np.outer(theta, theta) + fitted[d].covariance[m, :k, :k])
    return mean, second - np.outer(mean, mean)


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
