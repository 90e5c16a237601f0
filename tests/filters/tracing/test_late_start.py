"""Laws in time that were fitted to a later part of a power-on say little of its beginning."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from helpers.runs import parts_of, power_ons

from filters.effects import catalogue, deterministic
from filters.effects.inputs import Inputs
from filters.simulation import Effect
from filters.tracing import experiment
from filters.tracing.blocks import average, average_all
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design
from filters.tracing.held_out_run import _hold
from filters.tracing.run import Run
from filters.tracing.slow_effects import is_collinear
from filters.tracing.stack import Stack
from filters.tracing.trace import trace
from filters.types import Array

FROM_S = 1360.0
CUT_S = 500.0


def at(t: Any) -> Inputs:
    return cast("Inputs", SimpleNamespace(t=np.asarray(t, np.float64)))


@pytest.mark.parametrize("tau", deterministic.WARMUP_TAUS)
def test_warmup_is_anchored_where_the_data_begin_and_constant_before(tau: float) -> None:
    h = deterministic.warmup(1, tau, FROM_S)
    t = np.array([0.0, FROM_S - tau, FROM_S, FROM_S + tau])
    values = h.columns(at(t), 1)[:, 0]
    assert values[:3].tolist() == [1.0, 1.0, 1.0]
    assert values[3] == pytest.approx(np.exp(-1.0))
    again = catalogue.hypothesis("warmup", ("gy",), dict(h.shape))
    assert again == h
    assert np.array_equal(again.columns(at(t), 1), h.columns(at(t), 1))


def test_a_whole_power_on_has_the_law_as_it_was() -> None:
    t = np.linspace(0.0, 5000.0, 50)
    assert np.array_equal(deterministic.warmup(0, 40.0).columns(at(t), 0)[:, 0], np.exp(-t / 40.0))
    assert dict(deterministic.warmup(0, 40.0).shape) == {"tau_s": 40.0}


@pytest.mark.parametrize(("sd", "held"), [(1e-6, False), (1.0, True)])
def test_a_law_in_time_is_held_where_its_covariance_lets_it_be_anything(sd: float, held: bool) -> None:
    seen = np.arange(1360.0, 3000.0)
    t = np.arange(0.0, 1360.0)
    design: Any = SimpleNamespace(stack=SimpleNamespace(t=seen), columns=seen[:, None])
    term = SimpleNamespace(places={1: np.array([0])})
    found: Any = SimpleNamespace(term=term, theta=np.array([1.0]), covariance=np.array([[sd**2]]))
    columns = t[:, None].copy()
    _hold(columns, t, design, found, 1)
    assert bool(np.ptp(columns) < np.ptp(t)) is held
    assert np.array_equal(columns[-100:, 0], t[-100:])


def named(design: Design, effect: str, channel: int, **shape: float) -> Term:
    return next(
        a
        for a in design.terms
        if a.hypothesis.effect == effect and channel in a.places and shape.items() <= dict(a.hypothesis.shape).items()
    )


def still(*effects: Effect, seed: int = 1) -> Run:
    (run,) = power_ons(*effects, seed=seed, count=1, seconds=1800.0, hz=2.0, histories=(None,))
    return replace(run, temperature=None)


def test_a_term_that_others_of_its_family_span_is_collinear() -> None:
    design = Design(Stack.of([average(still())]))
    slow, fast = (named(design, "warmup", 1, tau_s=tau) for tau in (400.0, 40.0))
    near = named(design, "warmup", 1, tau_s=300.0)
    assert is_collinear(design, [slow], near)
    assert not is_collinear(design, [slow], fast)
    # a term is not collinear with itself, with another channel's, or with another effect's
    assert not is_collinear(design, [near], near)
    assert not is_collinear(design, [named(design, "warmup", 0, tau_s=400.0)], near)
    assert not is_collinear(design, [named(design, "ramp", 1)], near)


def test_no_experiment_is_asked_for_where_there_is_no_candidate() -> None:
    """Warm-up and ramp differ in time alone: without a thermometer no run at rest separates them."""
    late = parts_of(still(), (CUT_S, CUT_S))[1]
    design = Design(Stack.of(average_all([late])))
    warmup, ramp = named(design, "warmup", 1, tau_s=400.0), named(design, "ramp", 1)
    assert experiment.separating(design, warmup, np.array([0.01]), [ramp], late) is None


@pytest.mark.parametrize(
    "law",
    [
        lambda t: np.exp(-t / 200.0) + 0.5 * np.exp(-t / 60.0),
        lambda t: 1.0 / (1.0 + t / 200.0),
        lambda t: np.exp(-(((t - CUT_S) / 300.0) ** 2)),
    ],
    ids=["two exponentials", "a power of time", "largest where the first part ends"],
)
def test_an_early_part_is_not_made_worse_by_what_later_ones_show(law: Callable[[Array], Array]) -> None:
    """Each channel's error rises by no more than its interval, or a finding of that channel is refuted."""
    run = still(seed=3)
    size = np.array([4e-3, -2e-3, 1e-3, 0.06, -0.03, 0.1])
    early, *late = parts_of(
        replace(run, reading=run.reading + law(run.t)[:, None] * size), (CUT_S, CUT_S), (900.0, 900.0)
    )
    document: Any = trace(late, early).document
    errors = [e for e in document["error"] if e["metric"] == "e10" and e["heldout"] == "part"]
    refuted = {c for r in document["refuted"] for c in r["channels"]}
    assert len(errors) == 6
    assert "warmup" in {f["effect"] for f in (*document["findings"], *document["refuted"])}
    for e in errors:
        assert e["after"] <= 1.02 * e["before"] or e["channel"] in refuted, e
        assert e["after"] < 3.0 * e["before"], e
