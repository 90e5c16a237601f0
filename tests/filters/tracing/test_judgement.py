"""The held-out run's judgement: what is true is confirmed, what is false is refuted, what says nothing is neither."""

from dataclasses import replace

import numpy as np
from helpers.runs import power_ons

from filters.effects.run_specific import Step
from filters.simulation import Effect
from filters.tracing.blocks import average
from filters.tracing.design_matrix import Design
from filters.tracing.findings import Finding
from filters.tracing.held_out_run import HeldOutRun
from filters.tracing.judgement import judge
from filters.tracing.stack import Stack

SLOPE = np.deg2rad(0.01)


def judged(seed: int, truth: float, told: float) -> tuple[list[Finding], int]:
    """A thermal slope of gy that is so many times SLOPE and is told to be so many times: what stays, how many go."""
    effects = [Effect("thermal_lin", ("gy",), {"dps_per_k": 0.01 * truth})] if truth else []
    runs = power_ons(*effects, seed=seed, count=1, hz=4.0)
    stack = Stack.of([average(runs[0])])
    design = Design(stack)
    (term,) = [a for a in design.terms if a.hypothesis.effect == "thermal_lin" and list(a.places) == [1]]
    finding = Finding(
        term=term,
        theta=np.array([told * SLOPE]),
        covariance=np.zeros((1, 1)),
        score=50.0,
        gain=60.0,
        odds=1e6,
        rivals=(),
        channels=(1,),
    )
    run = HeldOutRun.of(stack, design, [finding])
    held, refuted = judge(run, [finding], design, range(6), seed)
    return held, len(refuted)


def test_what_is_true_is_confirmed_and_removes_its_share() -> None:
    for seed in range(12):
        ((finding,), refuted) = judged(seed, 1.0, 1.0)
        assert refuted == 0
        assert finding.confirmed is True
        assert finding.share is not None
        assert finding.share > 0.85


def test_what_is_false_is_refuted() -> None:
    assert all(judged(seed, 0.0, 1.0)[1] for seed in range(6))
    assert all(judged(seed, 1.0, -1.0)[1] for seed in range(6))


def test_what_says_next_to_nothing_is_neither() -> None:
    outcomes = [judged(seed, 0.0, 0.02) for seed in range(40)]
    assert sum(refuted for _, refuted in outcomes) <= 4
    assert sum(bool(f.confirmed) for held, _ in outcomes for f in held) <= 6
    assert all(f.confirmed is False for held, _ in outcomes for f in held if not f.confirmed)


def test_a_slope_that_is_half_true_is_not_refuted() -> None:
    for told in (0.5, 1.5):
        ((finding,), refuted) = judged(3, 1.0, told)
        assert refuted == 0
        assert finding.confirmed is True


def test_what_belongs_to_one_run_is_not_judged() -> None:
    runs = power_ons(Effect("step", ("gz",), {"dps": 0.3, "at_s": 350.0}), count=1, hz=4.0)
    stack = Stack.of([average(runs[0])])
    design = Design(stack)
    late = np.where(stack.t > 350.0, 1.0, 0.0)[:, None]
    term = design.add(Step.of(2, 350.0, 0, late), late)
    finding = replace(judged(1, 1.0, 1.0)[0][0], term=term, theta=np.array([0.005]), channels=(2,), confirmed=None)
    held, refuted = judge(HeldOutRun.of(stack, design, [finding]), [finding], design, range(6), 0)
    assert refuted == []
    assert held[0].confirmed is None
