"""Parts of one power-on: one bias, drift and memory of temperature that go on, and a part that is held out."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.runs import parts_of, power_ons

from filters.effects.inputs import LAGS, PLAY_WIDTHS
from filters.simulation import Effect, Temperature
from filters.tracing.blocks import average, average_all
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design
from filters.tracing.run import Run, in_order
from filters.tracing.stack import Stack
from filters.tracing.trace import trace
from filters.tracing.whitening import Drift

POINTS = ((0.0, 20.0), (300.0, 32.0), (500.0, 32.0), (900.0, 14.0))
CYCLE = (Temperature(POINTS),)
SLOPE = Effect("thermal_lin", ("gy",), {"dps_per_k": 0.02})


def cycle(*effects: Effect, seed: int = 1, exact: bool = False) -> Run:
    (run,) = power_ons(*effects, seed=seed, count=1, histories=CYCLE, hz=4.0)
    return replace(run, temperature=np.interp(run.t, *np.array(POINTS).T)) if exact else run


def term(design: Design, effect: str, channel: int) -> Term:
    return next(a for a in design.terms if a.hypothesis.effect == effect and list(a.places) == [channel])


def test_memory_of_temperature_goes_on_over_a_gap_on_a_straight_line() -> None:
    """Lags and plays of a part are those of the whole power-on, whose temperature went straight in the gap."""
    whole_run = cycle(exact=True)
    whole = average(whole_run).slow()
    parts = average_all(parts_of(whole_run, (600.0, 750.0)))
    late = parts[1].slow()
    rows = np.searchsorted(whole.t, late.t - 0.01)
    assert np.allclose(whole.t[rows], late.t)
    # smoothing is symmetric in time, and at a part's end has one side only
    inner = slice(80, -80)
    assert np.allclose(late.lagged[inner], whole.lagged[rows][inner], atol=0.02)
    assert np.allclose(late.plays[inner], whole.plays[rows][inner], atol=2e-3)
    alone = average(replace(parts[1].run, power_on="", begins=0.0)).slow()
    slowest, wide = LAGS.index(180.0), PLAY_WIDTHS.index(30.0)
    assert np.abs(alone.lagged[inner, slowest] - whole.lagged[rows][inner, slowest]).max() > 1.0
    assert np.abs(alone.plays[inner, wide] - whole.plays[rows][inner, wide]).max() > 0.03


def test_files_that_follow_at_once_have_the_memory_of_one() -> None:
    run = cycle(exact=True)
    whole = average(run).slow()
    made = average_all(parts_of(run, (200.0, 200.0), (650.0, 650.0)))
    lagged, plays = (np.concatenate([getattr(b.slow(), name) for b in made]) for name in ("lagged", "plays"))
    assert np.allclose(np.concatenate([b.t for b in made]), whole.t)
    assert np.allclose(lagged, whole.lagged, atol=0.03)
    assert np.allclose(plays, whole.plays, atol=3e-3)


def test_parts_share_one_bias() -> None:
    levels = [np.full(400, 20.0), np.full(400, 25.0)]
    own = cycle()
    parts = [
        replace(part, temperature=level, t=part.t[:400], reading=part.reading[:400])
        for part, level in zip(parts_of(own, (100.0, 700.0)), levels, strict=True)
    ]
    together = Design(Stack.of(average_all(parts)))
    assert any(a.hypothesis.effect == "thermal_lin" for a in together.terms)
    apart = Design(Stack.of(average_all([replace(p, power_on="", begins=0.0) for p in parts])))
    assert not any(a.hypothesis.effect == "thermal_lin" for a in apart.terms)


def test_white_parts_gain_what_the_whole_less_the_gap_gains() -> None:
    """A power-on in two files is, without drift and with it, one run from which the gap's rows are missing."""
    run = cycle(SLOPE)
    whole = Stack.of([average(run)])
    gap = (whole.t > 400.0) & (whole.t < 600.0)
    missing = Design(replace(whole, weight=np.where(gap[:, None], 0.0, whole.weight)))
    parts = Design(Stack.of(average_all(parts_of(run, (400.0, 600.0)))))
    for drift in (Drift(1.0, 0.0), Drift(np.inf, 1e-5), Drift(80.0, 1e-4)):
        scores = []
        for design in (missing, parts):
            design.sd = missing.sd
            design.set_drift(1, drift)
            scores.append(design.gains([], [term(design, "thermal_lin", 1)])[0])
        assert scores[1] == pytest.approx(scores[0], rel=2e-3)


def test_errors_of_what_is_told_between_parts_are_as_large_as_their_sd() -> None:
    """A slope seen only between two parts at two temperatures, with a walk through the gap: error over sd is 1."""
    n, gap, walk = 600, 900.0, Drift(np.inf, 2e-6)
    design = None
    z = []
    base = power_ons(count=1, hz=4.0, seconds=300.0)[0]
    dt, sigma = 0.25, float(np.deg2rad(0.02))
    for seed in range(60):
        rng = np.random.default_rng([3, seed])
        bias, slope = rng.normal(0.0, 1e-3), np.deg2rad(0.01)
        made, drift = [], 0.0
        for k, level in enumerate((18.0, 30.0)):
            steps = rng.normal(0.0, walk.level * np.sqrt(dt), n)
            steps[0] = rng.normal(0.0, walk.level * np.sqrt(gap)) if k else 0.0
            course = drift + np.cumsum(steps)
            drift = float(course[-1])
            reading = np.zeros((n, 6)) + rng.normal(0.0, sigma, (n, 6))
            reading[:, 1] += bias + course + slope * (level - 25.0)
            begins = k * (n * dt + gap - dt)
            made.append(
                replace(
                    base,
                    name=f"part {k}",
                    t=dt * np.arange(n),
                    reading=reading,
                    temperature=np.full(n, level),
                    power_on="a",
                    begins=begins,
                )
            )
        design = Design(Stack.of(average_all(made)))
        design.sd = np.full(6, sigma)
        design.set_drift(1, walk)
        fit = design.fit([term(design, "thermal_lin", 1)])
        z.append((fit.theta[0][0] - slope) / np.sqrt(fit.covariance[0, 0]))
    # 99.9 % of 60 chi-square degrees of freedom
    assert 0.75 < np.sqrt(np.mean(np.square(z))) < 1.3


def test_a_part_held_out_is_judged_as_one() -> None:
    run = cycle(SLOPE, seed=4)
    one, two = parts_of(run, (450.0, 450.0))
    found = trace([one], two)
    errors = [e for e in found.document["error"] if e["metric"] == "e10" and e["channel"] == "gy"]
    assert [e["heldout"] for e in errors] == ["part"]
    assert errors[0]["before_x_floor"] > 3.0
    assert errors[0]["after_x_floor"] < 1.5
    assert found.document["status"]["gy"] != "explained"
    alone = trace([one], replace(two, power_on="", begins=0.0))
    assert {e["heldout"] for e in alone.document["error"]} == {"run"}


def test_parts_stand_in_the_order_of_their_time() -> None:
    (other,) = power_ons(count=1, seed=9, hz=4.0)
    one, two = parts_of(cycle(), (400.0, 500.0))
    assert [r.name for r in in_order([other, two, one])] == [other.name, one.name, two.name]
    assert [r.name for r in in_order([two, other, one])] == [one.name, two.name, other.name]
    with pytest.raises(ValueError, match="before"):
        Stack.of(average_all([one, replace(two, begins=300.0)]))
    with pytest.raises(ValueError, match="beside"):
        Stack.of(average_all([one, other, two]))


def test_rows_count_from_power_on_and_from_the_part() -> None:
    one, two = parts_of(cycle(), (400.0, 500.0))
    stack = Stack.of(average_all([one, two]))
    late = stack.run == 1
    assert stack.t[late][0] == pytest.approx(500.0, abs=0.3)
    assert stack.part_t[late][0] < 0.3
    assert stack.begins.tolist() == [0]
    assert set(stack.power_on) == {0}
    ramp = term(Design(stack), "ramp", 0).hypothesis
    column = ramp.columns(stack.blocks[1].slow(), 0)[:, 0]
    assert column[0] == pytest.approx(500.0, abs=0.3)
