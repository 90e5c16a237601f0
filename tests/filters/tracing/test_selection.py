"""Selection: what joins, what is struck, what rivals what, and that nothing is found in noise that looks like drift."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.runs import TUMBLE, power_ons
from helpers.turned import lacking

from filters.simulation import Effect, Temperature
from filters.tracing.beside_drift import guarded_shared
from filters.tracing.blocks import average
from filters.tracing.design_matrix import Design
from filters.tracing.findings import rivals
from filters.tracing.selection import ACCEPT, KEEP, Selection, select
from filters.tracing.stack import Stack


def design(*effects: Effect, **how: object) -> Design:
    return Design(Stack.of([average(run) for run in power_ons(*effects, **({"count": 2} | how))]))  # type: ignore[arg-type]


@cache
def tumbled() -> Design:
    return design(Effect("gravity", (), {"relative": 3e-3}), profile=TUMBLE, seconds=TUMBLE.duration)


def names(chosen: Selection) -> list[tuple[str, tuple[int, ...]]]:
    return [(a.hypothesis.effect, a.hypothesis.channels) for a in chosen.terms]


def test_each_of_what_was_accepted_still_scores_beside_the_others() -> None:
    made = design(
        Effect("thermal_lin", ("gy",), {"dps_per_k": 0.02}), Effect("warmup", ("ax",), {"mg": 4.0, "tau_s": 120.0})
    )
    chosen = select(made, [1, 3])
    assert sorted(names(chosen)) == [("thermal_lin", (1,)), ("warmup", (3,))]
    for term in chosen.terms:
        assert chosen.own_gain(term) - chosen.price(term) > ACCEPT > KEEP
        assert chosen.unseen_gain[term.key] > 0.5 * ACCEPT
    assert [made.drift[c].level for c in range(6)] == [0.0] * 6


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_two_slow_effects_of_one_channel_are_both_named(seed: int) -> None:
    made = design(
        Effect("thermal_lin", ("gy",), {"dps_per_k": 0.02}),
        Effect("warmup", ("gy",), {"dps": 0.2, "tau_s": 70.0}),
        seed=seed,
    )
    assert sorted(name for name, _ in names(select(made, [1]))) == ["thermal_lin", "warmup"]
    assert made.drift[1].level == 0.0


def test_a_curve_in_time_gives_way_to_temperature() -> None:
    """Time is nobody's cause: an odd curve of temperature is a driver of temperature, never of time."""
    made = design(Effect("thermal_poly", ("ax",), {"mg_per_k": 0.0, "mg_per_k2": 0.05, "mg_per_k3": 0.01}))
    chosen = select(made, [3])
    assert chosen.terms
    assert all(a.hypothesis.source == "temperature" for a in chosen.terms)


def test_drift_is_called_drift() -> None:
    made = design(
        Effect("random_walk", ("gx",), {"dps_per_sqrt_s": 0.004}),
        Effect("gauss_markov", ("az",), {"mg": 2.0, "tau_s": 40.0}),
    )
    chosen = select(made, range(6))
    assert chosen.terms == []
    assert [c for c in range(6) if made.drift[c].level > 0.0] == [0, 5]
    found = made.drift[5]
    assert 10.0 < found.tau < 100.0
    assert found.level / 9.80665e-3 == pytest.approx(2.0, rel=0.5)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_the_guard_keeps_flicker_from_being_an_effect(seed: int) -> None:
    flicker = [
        Effect("gauss_markov", (c,), {unit: size, "tau_s": tau})
        for c, unit, size in (("gy", "dps", 0.012), ("ax", "mg", 0.35))
        for tau in (4.0, 20.0, 100.0, 500.0)
    ]
    made = design(*flicker, seed=seed)
    chosen = select(made, [1, 3])
    assert chosen.terms == []
    for weak in chosen.weak:
        assert weak.why


def test_what_happened_once_is_no_law() -> None:
    """Temperature and error jump together for a few seconds, in one cell: no other says that they belong together."""
    once = Temperature(((0.0, 25.0), (306.0, 25.0), (308.0, 33.0), (312.0, 33.0), (314.0, 25.0)))
    made = design(Effect("thermal_lin", ("gy",), {"dps_per_k": 0.1}), count=1, histories=(once,))
    chosen = select(made, [1])
    assert [a for a in chosen.terms if a.hypothesis.source == "temperature"] == []
    assert "shows once only: an event would do as well" in {weak.why for weak in chosen.weak}


def test_gravity_and_a_common_scale_factor_are_rivals() -> None:
    made = tumbled()
    chosen = select(made, [3, 4, 5])
    assert names(chosen) == [("gravity", (3, 4, 5))]
    found = rivals(chosen, chosen.terms[0])
    assert "scale" in [r.term.hypothesis.effect for r in found]
    common = next(r for r in found if r.term.hypothesis.effect == "scale")
    assert common.score_difference == 0.0


def test_a_wider_form_of_a_finding_is_no_rival() -> None:
    made = design(Effect("thermal_lin", ("gy",), {"dps_per_k": 0.03}))
    chosen = select(made, [1])
    assert names(chosen) == [("thermal_lin", (1,))]
    assert not {"thermal_poly", "driver:temperature"} & {
        r.term.hypothesis.effect for r in rivals(chosen, chosen.terms[0])
    }


def test_a_cold_start_alone_leaves_its_causes_rivals() -> None:
    """Temperature, its rate, time since power-on: if one is accepted on one warm-up the others are named beside it."""
    for seed in range(1, 5):
        made = design(Effect("thermal_lin", ("gy",), {"dps_per_k": 0.04}), seed=seed, count=1, histories=(None,))
        chosen = select(made, [1])
        for term in chosen.terms:
            others = {r.term.hypothesis.effect for r in rivals(chosen, term)} | {term.hypothesis.effect}
            assert "thermal_lin" in others
            assert len(others) > 1


def test_events_are_found_where_they_are() -> None:
    made = design(
        Effect("step", ("gz",), {"dps": 0.15, "at_s": 350.0}),
        Effect("tone", ("ay",), {"mg": 3.0, "hz": 0.31}),
        Effect("telegraph", ("az",), {"mg": 5.0, "mean_s": 60.0}),
        Effect("tone", ("gx",), {"dps": 0.0001, "hz": 0.2}),
    )
    chosen = select(made, range(6))
    assert sorted(names(chosen)) == [("step", (2,)), ("telegraph", (5,)), ("tone", (4,))]
    fit = chosen.fit()
    for number, term in enumerate(chosen.terms):
        facts, theta = term.hypothesis.shape, fit.theta[number]
        match term.hypothesis.effect:
            case "step":
                assert float(facts["at_s"]) == pytest.approx(350.0, abs=4.0)
                assert theta[0] == pytest.approx(np.deg2rad(0.15), rel=0.1)
            case "tone":
                assert float(facts["hz"]) == pytest.approx(0.31, rel=1e-3)
                assert np.hypot(*theta[:2]) == pytest.approx(3.0 * 9.80665e-3, rel=0.1)
            case "telegraph":
                assert theta[0] == pytest.approx(5.0 * 9.80665e-3, rel=0.2)


@pytest.mark.parametrize("seed", [1, 2])
def test_what_channels_share_is_not_found_in_their_drift(seed: int) -> None:
    """Gravity that is off shows with the attitude, as drift may by chance: it takes what a step takes."""
    walks = [Effect("random_walk", (channel,), {"mg_per_sqrt_s": 0.15}) for channel in ("ax", "ay", "az")]
    made = design(*walks, seed=seed, profile=TUMBLE, seconds=TUMBLE.duration)
    shared = ("gravity", "tilt", "mounting", "lever_arm", "delay")
    assert not [name for name, _ in names(select(made, list(range(6)))) if name in shared]


def test_what_channels_share_scores_beside_drift_as_it_does_alone() -> None:
    chosen = select(tumbled(), [3, 4, 5])
    (term,) = [a for a in chosen.terms if a.hypothesis.effect == "gravity"]
    alone = chosen.own_gain(term) - chosen.price(term)
    guarded = guarded_shared(chosen.design, [a for a in chosen.terms if a is not term], term, chosen.price(term))
    assert 0.3 * alone < guarded < 1.05 * alone


def test_a_channel_that_is_not_there_says_nothing_of_what_channels_share() -> None:
    """Without the third accelerometer the score beside drift is that of the other two: a number, which can be low."""
    stack = Stack.of([average(lacking(run, "az")) for run in power_ons(profile=TUMBLE, seconds=TUMBLE.duration)])
    made = Design(stack)
    (term,) = [a for a in made.terms if a.hypothesis.effect == "gravity"]
    other = replace(term, places={c: term.places[c] for c in (3, 4)})
    assert guarded_shared(made, [], term, 10.0) == pytest.approx(guarded_shared(made, [], other, 10.0))
    assert guarded_shared(made, [], term, 10.0) < ACCEPT
