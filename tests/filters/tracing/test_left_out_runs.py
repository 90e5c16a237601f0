"""Power-ons left out in turn: what carries over gains on each, what does not is dropped before any judge sees it."""

from helpers.runs import HISTORIES, power_ons

from filters.simulation import Effect, Temperature
from filters.tracing.blocks import average
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design
from filters.tracing.left_out_runs import transfer_gains
from filters.tracing.run import Run
from filters.tracing.selection import select
from filters.tracing.stack import Stack

CHANNELS = range(6)
STILL = (Temperature(((0.0, 25.0), (900.0, 25.02))),) * 2


def design_of(runs: list[Run]) -> Design:
    return Design(Stack.of([average(run) for run in runs]))


def thermal(design: Design) -> Term:
    (term,) = [a for a in design.terms if a.hypothesis.effect == "thermal_lin" and list(a.places) == [1]]
    return term


def mixed(slopes: tuple[float, ...], seed: int) -> list[Run]:
    """Power-ons of one unit whose thermal slope of gy is another in each, deg/s/K."""
    runs = []
    for k, slope in enumerate(slopes):
        effects = [Effect("thermal_lin", ("gy",), {"dps_per_k": slope})] if slope else []
        runs.append(power_ons(*effects, seed=seed, count=len(slopes), hz=4.0)[k])
    return runs


def test_what_carries_over_gains_nearly_what_it_explains() -> None:
    for seed in range(4):
        design = design_of(mixed((0.02, 0.02, 0.02), seed))
        term = thermal(design)
        gained = transfer_gains(design, [term])[term.key]
        whole = float(design.gains([], [term])[0])
        assert whole > 200.0
        assert 0.8 * whole < gained < 1.1 * whole


def test_what_turns_its_sign_loses() -> None:
    for slopes in ((0.02, 0.02, -0.015), (0.02, -0.02, 0.001)):
        for seed in range(3):
            design = design_of(mixed(slopes, seed))
            term = thermal(design)
            assert transfer_gains(design, [term])[term.key] < 0.0


def test_noise_is_no_witness() -> None:
    """A slope of nothing, over forty units: it would hardly show on what is left out, so there is no verdict."""
    verdicts = 0
    for seed in range(40):
        design = design_of(power_ons(seed=seed, hz=2.0))
        verdicts += bool(transfer_gains(design, [thermal(design)]))
    assert verdicts <= 1


def test_a_power_on_without_temperature_is_no_witness() -> None:
    """Two that say nothing of a slope leave one: there is no verdict. Two power-ons give none either."""
    runs = power_ons(Effect("thermal_lin", ("gy",), {"dps_per_k": 0.02}), hz=4.0, histories=(*HISTORIES[:1], *STILL))
    design = design_of(runs)
    term = thermal(design)
    assert transfer_gains(design, [term]) == {}
    design = design_of(runs[:2])
    assert transfer_gains(design, [thermal(design)]) == {}


def test_selection_drops_what_does_not_carry_over() -> None:
    chosen = select(design_of(mixed((0.03, -0.03, 0.01), 2)), CHANNELS)
    assert not any(a.hypothesis.effect == "thermal_lin" for a in chosen.on(1))
    chosen = select(design_of(mixed((0.03, 0.03, 0.03), 2)), CHANNELS)
    assert [a.hypothesis.effect for a in chosen.on(1)] == ["thermal_lin"]
