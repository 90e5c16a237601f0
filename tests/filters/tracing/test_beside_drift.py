"""Slow effects, steps and two levels in real drift's likeness: judged with drift fitted on both sides."""

import numpy as np
import pytest
from helpers.runs import power_ons

from filters.channels import DPS
from filters.effects.run_specific import RunSpecific
from filters.simulation import Effect
from filters.tracing import run_specific_search
from filters.tracing.beside_drift import fitted_beside, gain_beside, is_judged, likeliest_drift, of_columns, rows_of
from filters.tracing.blocks import average
from filters.tracing.design_matrix import Design
from filters.tracing.selection import ACCEPT, select
from filters.tracing.stack import Stack
from filters.tracing.whitening import NONE, Drift, drift_grid, profile, whiten

WALK = Effect("random_walk", ("gy",), {"dps_per_sqrt_s": 0.002})
SEEDS = (1, 2, 3, 4)


def design(*effects: Effect, seed: int = 1, count: int = 3) -> Design:
    return Design(Stack.of([average(run) for run in power_ons(*effects, seed=seed, count=count)]))


def drifting(*effects: Effect, seed: int = 1) -> Design:
    """With the channel's drift as it is likeliest without any effect."""
    made = design(WALK, *effects, seed=seed)
    made.set_drift(1, likeliest_drift(made, [], 1)[1])
    return made


def test_gains_are_those_of_each_term_fitted_alone_under_every_drift() -> None:
    made = drifting()
    terms = [a for a in made.terms if is_judged(a) and 1 in a.places][:12]
    columns = np.hstack([made.columns[:, a.places[1]] for a in terms])
    judged = of_columns(
        made, [], 1, columns, np.split(np.arange(columns.shape[1]), np.cumsum([a.size for a in terms])[:-1])
    )
    for k, term in enumerate(terms):
        rows = rows_of(made, [], 1, made.columns[:, term.places[1]])
        values = []
        for width in (1, rows.values.shape[1]):
            own = np.ascontiguousarray(rows.values[:, :width])
            each = [whiten(own, rows.t, rows.starts, rows.variance, d) for d in (NONE, *drift_grid(rows.unit))]
            values.append(min(profile(W) + log_det for W, log_det in each))
        assert judged.gain[k] == pytest.approx(values[0] - values[1], abs=1e-3)


def test_the_gain_of_what_is_not_there_is_a_chi_square() -> None:
    gains = []
    for seed in range(1, 9):
        made = design(WALK, seed=seed, count=2)
        (term,) = [a for a in made.terms if a.hypothesis.effect == "thermal_lin" and 1 in a.places]
        gains.append(gain_beside(made, [], 1, made.columns[:, term.places[1]]))
    assert np.mean(gains) < 2.5
    assert max(gains) < 10.0


def test_a_slope_is_named_in_the_drift_that_would_swallow_it() -> None:
    z = []
    for seed in SEEDS[:3]:
        made = design(WALK, Effect("thermal_lin", ("gy",), {"dps_per_k": 0.012}), seed=seed)
        chosen = select(made, [1])
        assert [a.hypothesis.effect for a in chosen.terms] == ["thermal_lin"]
        theta, covariance = chosen.fit().of(0)
        z.append((theta[0] / DPS - 0.012) / np.sqrt(covariance[0, 0]) * DPS)
    assert np.max(np.abs(z)) < 3.0


def test_what_is_too_small_is_listed_with_its_size_and_limit() -> None:
    listed = 0
    for seed in SEEDS[:3]:
        made = design(WALK, Effect("thermal_lin", ("gy",), {"dps_per_k": 0.006}), seed=seed)
        chosen = select(made, [1])
        own = [w for w in chosen.weak if w.term.hypothesis.effect == "thermal_lin"]
        listed += len(own) + ("thermal_lin" in [a.hypothesis.effect for a in chosen.terms])
        for weak in own:
            assert weak.why
            sd = np.sqrt(weak.covariance[0, 0])
            assert abs(weak.theta[0] / DPS - 0.006) < 3.0 * sd / DPS
            if min(weak.score, weak.guarded or weak.score) <= ACCEPT:
                assert weak.limit is not None
                assert weak.limit > abs(weak.theta[0])
    assert listed >= 2


@pytest.mark.parametrize("seed", SEEDS)
def test_a_step_in_a_walk_is_found_where_it_is(seed: int) -> None:
    """Its time to some seconds and its size within 4 sd, where the drift as it is has swallowed most of it."""
    made = drifting(Effect("step", ("gy",), {"dps": 0.12, "at_s": 431.0}), seed=seed)
    step = run_specific_search.step_on_drift(made, [], 1)
    assert step is not None
    assert step.at == pytest.approx(431.0, abs=8.0)
    theta, covariance = fitted_beside(made, [], 1, step.made, Drift(np.inf, 0.002 * DPS))
    assert abs(theta[0] / DPS - 0.12) < 4.0 * np.sqrt(covariance[0, 0]) / DPS


def test_a_walk_alone_has_no_step() -> None:
    """The best step of a walk does not score: its price is that of every instant it could have been at."""
    for seed in SEEDS[:3]:
        chosen = select(design(WALK, seed=seed), [1])
        assert [a for a in chosen.terms if isinstance(a.hypothesis, RunSpecific)] == []


@pytest.mark.parametrize("seed", SEEDS[:2])
def test_two_levels_are_told_from_the_walk_below_them(seed: int) -> None:
    made = design(WALK, Effect("telegraph", ("gy",), {"dps": 0.2, "mean_s": 50.0}), seed=seed)
    made.set_drift(1, likeliest_drift(made, [], 1)[1])
    found = run_specific_search.telegraph(made, [], 1)
    assert found is not None
    effect, gain = found
    assert gain > effect.penalty + ACCEPT
    theta, _ = fitted_beside(made, [], 1, effect.made, Drift(np.inf, 0.002 * DPS))
    assert abs(theta[0]) / DPS == pytest.approx(0.2, rel=0.1)
