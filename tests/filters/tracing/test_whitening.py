"""The bias filter against dense Gaussians: innovations, likelihoods, profiles, drift."""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.linalg import slogdet

from filters.tracing.whitening import (
    LEVELS,
    NONE,
    TAUS,
    Drift,
    Rows,
    best_drift,
    profile,
    unbiased,
    unbiased_parts,
    whiten,
    whitened_parts,
)

DRIFTS = {"no drift": NONE, "random walk": Drift(np.inf, 0.3), "Gauss-Markov": Drift(3.0, 0.8)}


def rows(seed: int = 0, gaps: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Three columns of two runs, with a gap in time, uneven variances and rows without data."""
    rng = np.random.default_rng(seed)
    t = np.concatenate([0.25 * np.arange(23), 0.25 * np.arange(17)])
    starts = np.array([0, 23])
    variance = rng.uniform(0.5, 2.0, t.size)
    if gaps:
        t[9:23] += 4.0
        variance[[0, 4, 5, 23, 30, 39]] = np.inf
    return rng.standard_normal((t.size, 3)), t, starts, variance


def covariance(t: np.ndarray, variance: np.ndarray, drift: Drift) -> np.ndarray:
    """Of the rows of one run, without the bias."""
    if drift.level == 0.0:
        drifting = np.zeros((t.size, t.size))
    elif np.isinf(drift.tau):
        drifting = drift.level**2 * np.minimum(t[:, None] - t[0], t[None, :] - t[0])
    else:
        drifting = drift.level**2 * np.exp(-np.abs(t[:, None] - t[None, :]) / drift.tau)
    return np.diag(variance) + drifting


def dense(
    columns: np.ndarray, t: np.ndarray, starts: np.ndarray, variance: np.ndarray, drift: Drift
) -> tuple[np.ndarray, float]:
    """Gram matrix under a bias of each run that nothing is known of, and the log determinant that goes with it."""
    gram, log_det = np.zeros((columns.shape[1],) * 2), 0.0
    for begin, end in zip(starts, [*starts[1:], t.size], strict=True):
        use = np.arange(begin, end)[np.isfinite(variance[begin:end])]
        V = np.linalg.inv(covariance(np.append(t[begin], t[use]), np.append(1.0, variance[use]), drift)[1:, 1:])
        one = np.ones(use.size)
        P = V - np.outer(V @ one, V @ one) / (one @ V @ one)
        gram += columns[use].T @ P @ columns[use]
        log_det += -slogdet(V)[1] + np.log(one @ V @ one)
    return gram, log_det


@pytest.mark.parametrize("name", list(DRIFTS))
@pytest.mark.parametrize("gaps", [False, True])
def test_whitened_columns_have_the_gram_matrix_of_the_dense_gaussian(name: str, gaps: bool) -> None:
    columns, t, starts, variance = rows(gaps=gaps)
    out, _ = whiten(columns, t, starts, variance, DRIFTS[name])
    gram, _ = dense(columns, t, starts, variance, DRIFTS[name])
    assert np.allclose(out.T @ out, gram, rtol=1e-5, atol=1e-5)
    assert not out[~np.isfinite(variance)].any()


@pytest.mark.parametrize("gaps", [False, True])
def test_likelihoods_differ_as_those_of_dense_gaussians(gaps: bool) -> None:
    """-2 log L up to a constant that no drift changes, so that drifts are compared rightly."""
    columns, t, starts, variance = rows(1, gaps)
    ours, theirs = [], []
    for drift in (*DRIFTS.values(), Drift(0.4, 2.0), Drift(50.0, 0.1)):
        out, log_det = whiten(columns, t, starts, variance, drift)
        ours.append(profile(out) + log_det)
        gram, dense_det = dense(columns, t, starts, variance, drift)
        y, X = gram[0, 0], gram[1:, 1:]
        theirs.append(y - gram[0, 1:] @ np.linalg.solve(X, gram[1:, 0]) + dense_det)
    assert np.allclose(np.diff(ours), np.diff(theirs), atol=1e-4)


@pytest.mark.parametrize("gaps", [False, True])
def test_the_closed_form_without_drift_is_the_filter(gaps: bool) -> None:
    columns, t, starts, variance = rows(2, gaps)
    run = np.repeat([0, 1], [23, 17])
    filtered = whiten(columns, t, starts, variance)[0]
    closed = unbiased(columns, run, variance)
    assert np.allclose(closed.T @ closed, filtered.T @ filtered, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("drift", [NONE, Drift(np.inf, 0.2), Drift(4.0, 1.0)])
def test_a_bias_of_each_run_leaves_nothing(drift: Drift) -> None:
    columns, t, starts, variance = rows(3)
    run = np.repeat([0, 1], [23, 17])
    shifted = columns + np.array([1e3, -1e3])[run][:, None]
    assert np.allclose(
        whiten(shifted, t, starts, variance, drift)[0], whiten(columns, t, starts, variance, drift)[0], atol=1e-3
    )


@pytest.mark.parametrize("name", list(DRIFTS))
def test_innovations_of_what_the_model_says_are_white(name: str) -> None:
    rng = np.random.default_rng(5)
    t = 0.25 * np.arange(600)
    variance = rng.uniform(0.5, 2.0, t.size)
    S = covariance(t, variance, DRIFTS[name])
    y = 7.0 + np.linalg.cholesky(S) @ rng.standard_normal((t.size, 20))
    out = whiten(y, t, np.array([0]), variance, DRIFTS[name])[0][1:]
    assert abs(np.mean(out**2) - 1.0) < 4.0 * np.sqrt(2.0 / out.size)
    assert abs(np.mean(out[1:] * out[:-1])) < 4.0 / np.sqrt(out.size)


def test_a_profile_is_a_least_squares_fit() -> None:
    rng = np.random.default_rng(6)
    y, X = rng.standard_normal(50), rng.standard_normal((50, 2))
    theta = np.linalg.lstsq(X, y, rcond=None)[0]
    left = np.sum((y - X @ theta) ** 2)
    W = np.column_stack([y, 1e-6 * X[:, 0], 1e5 * X[:, 1], 2e5 * X[:, 1], np.zeros(50)])
    assert profile(W) == pytest.approx(left, rel=1e-6)
    assert profile(W[:, :1]) == pytest.approx(y @ y)


@pytest.mark.parametrize(("tau", "level"), [(12.0, 0.6), (80.0, 0.6), (np.inf, 0.6)])
def test_the_drift_that_was_drawn_is_found(tau: float, level: float) -> None:
    rng = np.random.default_rng(7)
    t = np.arange(3000.0)
    drift = Drift(tau, level * 1.0 / (10.0 if np.isinf(tau) else 1.0))
    if np.isinf(tau):
        g = np.cumsum(rng.standard_normal(t.size)) * drift.level
    else:
        p, g = np.exp(-1.0 / tau), np.zeros(t.size)
        g[0] = drift.level * rng.standard_normal()
        for k in range(1, t.size):
            g[k] = p * g[k - 1] + drift.level * np.sqrt(1.0 - p * p) * rng.standard_normal()
    y = (g + rng.standard_normal(t.size))[:, None]
    best, found, none = best_drift(Rows(y, t, np.array([0]), np.ones(t.size), 1.0))
    assert none - best > 50.0
    assert abs(TAUS.index(found.tau) - TAUS.index(tau)) <= 1
    if found.tau == tau:
        ratio = found.level / drift.level
        assert 0.4 < ratio < 2.5


def test_white_noise_asks_for_no_drift() -> None:
    rng = np.random.default_rng(8)
    t, gains = np.arange(900.0), []
    for _ in range(20):
        best, _, none = best_drift(Rows(rng.standard_normal((t.size, 1)), t, np.array([0]), np.ones(t.size), 1.0))
        gains.append(none - best)
    price = 2.0 * np.log(900.0) + 2.0 * np.log(20.0)
    assert max(gains) < price
    assert len(LEVELS) * len(TAUS) == 72


@pytest.mark.parametrize("drift", DRIFTS.values(), ids=list(DRIFTS))
def test_columns_in_parts_are_whitened_as_all_at_once(drift: Drift) -> None:
    columns, t, starts, variance = rows()
    run = np.searchsorted(starts, np.arange(t.size), side="right") - 1
    whole = unbiased(columns, run, variance) if drift.level == 0.0 else whiten(columns, t, starts, variance, drift)[0]
    for size in (1, 7, 23, 40):
        places = [slice(first, min(first + size, t.size)) for first in range(0, t.size, size)]

        def parts(places: list[slice] = places) -> Iterator[tuple[slice, np.ndarray]]:
            return ((place, columns[place].copy()) for place in places)

        if drift.level == 0.0:
            made = list(unbiased_parts(parts, run, variance))
        else:
            made = list(whitened_parts((part for _, part in parts()), t, starts, variance, drift))
        assert np.concatenate(made) == pytest.approx(whole, rel=1e-12, abs=1e-12)
