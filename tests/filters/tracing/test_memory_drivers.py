"""Chains of operators with a memory: they are found, named by their composition, and join the filter."""

import itertools
from dataclasses import fields, replace

import numpy as np
import pytest
from helpers.runs import TUMBLE, power_ons

from filters.channels import DPS, G
from filters.effects import drivers
from filters.effects.drivers import Driver
from filters.effects.inputs import FOLLOWED, Inputs
from filters.effects.operators import OPERATORS, Values, nested
from filters.effects.records import Included, State
from filters.effects.runtime import CausalEffects
from filters.errors import InputError
from filters.imu import AxisMap
from filters.motion.reference import COLUMNS
from filters.simulation import Effect
from filters.tracing import trace
from filters.tracing.blocks import average
from filters.tracing.design_matrix import Design
from filters.tracing.run import Run
from filters.tracing.selection import Selection, select
from filters.tracing.stack import Stack

UP, DOWN = 29.0, 26.0


def flipped(run: Run, size: float) -> Run:
    """With a state on gx that goes up above 29 degC and back below 26; the temperature is the logged one."""
    assert run.temperature is not None
    state, reading = run.temperature[0] > 0.5 * (UP + DOWN), run.reading.copy()
    for k, T in enumerate(run.temperature.tolist()):
        state = True if T > UP else False if T < DOWN else state
        reading[k, 0] += size * state
    return replace(run, reading=reading)


def selected(runs: list[Run], channel: int) -> Selection:
    return select(Design(Stack.of([average(run) for run in runs])), [channel])


def test_a_state_that_flips_between_two_temperatures_is_found_with_both() -> None:
    """Neither a threshold nor play: up at one temperature, back at another one."""
    chosen = selected([flipped(run, 0.1 * DPS) for run in power_ons()], 0)
    h = chosen.terms[0].hypothesis
    assert isinstance(h, Driver)
    assert (h.effect, h.kind) == ("cause:relay(temperature)", "relay")
    assert h.shape["up_degc"] == pytest.approx(UP, abs=0.6)
    assert h.shape["down_degc"] == pytest.approx(DOWN, abs=0.6)
    assert chosen.fit().theta[0][0] == pytest.approx(0.1 * DPS, rel=0.15)


def test_a_state_keeps_what_it_was_between_its_temperatures() -> None:
    made = drivers.chain("temperature", ["relay"], [(20.0, 30.0)])
    T = np.array([24.0, 29.0, 31.0, 25.0, 21.0, 19.0, 24.0, 26.0])
    inputs = average(power_ons(count=1, seconds=60.0)[0]).slow()
    columns = made.columns(replace(inputs, temperature=T), 0)[:, 0]
    assert columns.tolist() == [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]


def test_beside_drift_its_temperatures_are_found_between_those_of_the_grid() -> None:
    """Some seconds late, at the nearest temperatures that are tried, free steps would do as well.

    What is smoothed over 5 s crosses them a little later than the thermometer does.
    """
    walk = Effect("random_walk", ("gx",), {"dps_per_sqrt_s": 0.001})
    chosen = selected([flipped(run, 0.06 * DPS) for run in power_ons(walk)], 0)
    (found,) = chosen.terms
    assert found.hypothesis.effect == "cause:relay(temperature)"
    assert found.hypothesis.shape["up_degc"] == pytest.approx(UP, abs=0.15)
    assert found.hypothesis.shape["down_degc"] == pytest.approx(DOWN, abs=0.15)
    assert chosen.odds_of(found) > 9.0


def lagging(run: Run, seconds: float) -> Run:
    """With 3 mg on ax per g along y that it follows from behind."""
    period = 1.0 / run.rate_hz
    reading, level = run.reading.copy(), run.reading[0, 4]
    for k in range(len(reading)):
        level += period / seconds * (run.reading[k, 4] - level)
        reading[k, 3] += 0.003 * level
    return replace(run, reading=reading)


def test_what_follows_the_force_of_another_axis_from_behind_is_named_by_it() -> None:
    runs = power_ons(count=2, profile=TUMBLE, seconds=TUMBLE.duration)
    chosen = selected([lagging(run, 40.0) for run in runs], 3)
    h = chosen.terms[0].hypothesis
    assert isinstance(h, Driver)
    assert (h.effect, h.shape["tau_s"]) == ("cause:lag(fy)", 40.0)
    assert chosen.fit().theta[0][0] / G == pytest.approx(0.003, rel=0.3)


def test_every_chain_goes_on_from_part_to_part_as_if_it_were_one() -> None:
    """To the last bit, wherever it is cut, and one by one too."""
    whole = average(power_ons(count=1, profile=TUMBLE, seconds=TUMBLE.duration)[0]).slow()
    whole = replace(whole, x=whole.followed[:, :6])  # what does not remember takes them where it is sensed
    slow = {"temperature": whole.temperature, "temperature_rate": whole.temperature_rate, "time": whole.t}
    ranges = {name: (float(x.min()), float(x.max())) for name, x in slow.items()} | {"since_motion": (0.0, 9.0)}
    ranges |= {name: (-90.0, 90.0) if name[0] == "w" else (-1.0, 1.0) for name in FOLLOWED[:6]}
    chains = [b for b in drivers.bases(ranges | {"rate_norm": (0.0, 90.0)}) if b.chain]
    assert {b.effect for b in chains} == {f"cause:{nested(rest, of)}" for of, *rest in drivers.CHAINS}
    varying = [b for b in chains if np.ptp(b.columns(whole, 0), axis=0).max() > 0.0]
    assert {b.effect for b in varying} == {b.effect for b in chains}
    for b in {b.effect: b for b in varying}.values():
        together = b.going_on(whole, 0, b.blank())
        for cuts in ([137], [1, 2, 3, 200]):
            memory = b.blank()
            made = [b.going_on(part, 0, memory) for part in parts(whole, cuts)]
            assert np.concatenate(made).tobytes() == together.tobytes(), b.effect


def parts(inputs: Inputs, cuts: list[int]) -> list[Inputs]:
    ends = [0, *cuts, inputs.t.size]
    return [
        replace(inputs, **{f.name: getattr(inputs, f.name)[a:b] for f in fields(Inputs)})
        for a, b in itertools.pairwise(ends)
    ]


@pytest.mark.parametrize(
    ("operator", "numbers", "u", "expected"),
    [
        ("play", (2.0,), [0.0, 0.5, 1.5, 3.0, 2.5, 0.5], [0.0, 0.0, 0.5, 2.0, 2.0, 1.5]),
        ("hold", (2.0,), [1.0, 2.0, 4.0, 7.0, 11.0, 16.0], [0.0, -1.0, 0.0, -3.0, 0.0, -5.0]),
        ("kink", (2.0,), [1.0, 2.0, 4.0], [0.0, 0.0, 2.0]),
        ("dead_zone", (2.0,), [-3.0, -1.0, 1.0, 4.0], [-1.0, 0.0, 0.0, 2.0]),
        ("relay", (1.0, 3.0), [2.5, 3.5, 2.0, 0.5, 2.0], [1.0, 1.0, 1.0, 0.0, 0.0]),
    ],
)
def test_what_an_operator_makes(operator: str, numbers: Values, u: list[float], expected: list[float]) -> None:
    t = np.arange(len(u), dtype=float)
    made = OPERATORS[operator].course(np.array(u), t, numbers, np.full(2, np.nan))
    assert made.tolist() == expected


def test_a_relay_is_in_the_effects_file_and_the_filter_follows_it() -> None:
    runs = [flipped(run, 0.1 * DPS) for run in power_ons(count=3)]
    found = trace.trace(runs[:2], runs[2])
    (entry,) = [f for f in found.document["findings"] if f["effect"] == "cause:relay(temperature)"]
    assert "relay of temperature, up at 2" in entry["label"]
    assert entry["odds"] > 1.0
    (own,) = [effect for effect in found.included if effect.effect == "cause:relay(temperature)"]
    effects = CausalEffects([own], np.eye(1), AxisMap(), runs[2].site, 1.0 / runs[2].rate_hz)
    T, zero = runs[2].temperature, np.zeros((runs[2].t.size, 3))
    assert T is not None
    phi, _, _ = effects.rows(runs[2].t, zero, zero, T, np.full((T.size, COLUMNS), np.nan))
    truth = flipped(replace(runs[2], reading=np.zeros((T.size, 6))), 1.0).reading[:, 0]
    followed = AxisMap().gyro_to_instrument(np.moveaxis(phi[:, 3:], 1, 2))[:, 0, 0] / DPS
    # but for what smoothing and the nearest levels that are tried make late
    assert np.mean(np.abs(followed - truth)) < 0.12


def test_an_effects_file_with_the_tables_past_motion_is_refused() -> None:
    (run,) = power_ons(count=1, seconds=60.0)
    state, shape = State("k", "deg/s", 0.1, 0.01), {"basis": "settling", "tau_s": 10.0}
    effect = Included("driver:settling_inner", ("gx",), "A", shape, (state,))
    with pytest.raises(InputError, match="take it out of the file"):
        CausalEffects([effect], np.eye(1), AxisMap(), run.site, 0.05)
