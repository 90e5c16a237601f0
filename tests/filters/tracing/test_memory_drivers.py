"""Drivers with a memory: a state that flips between two temperatures, and what follows motion from behind."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.runs import TUMBLE, power_ons

from filters.channels import DPS, G
from filters.effects import catalogue, drivers
from filters.effects.drivers import Driver
from filters.effects.inputs import TRAILED, TRAILS
from filters.effects.records import Included, State
from filters.effects.runtime import CausalEffects
from filters.imu import AxisMap
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
    assert (h.effect, h.kind) == ("driver:temperature_threshold", "relay")
    assert h.shape["up_degc"] == pytest.approx(UP, abs=0.6)
    assert h.shape["down_degc"] == pytest.approx(DOWN, abs=0.6)
    assert chosen.fit().theta[0][0] == pytest.approx(0.1 * DPS, rel=0.15)


def test_a_state_keeps_what_it_was_between_its_temperatures() -> None:
    made = drivers.relay(20.0, 30.0)
    T = np.array([24.0, 29.0, 31.0, 25.0, 21.0, 19.0, 24.0, 26.0])
    inputs = average(power_ons(count=1, seconds=60.0)[0]).slow()
    columns = made.columns(replace(inputs, temperature=T), 0)[:, 0]
    assert columns.tolist() == [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]


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
    assert (h.effect, h.kind, h.shape["tau_s"]) == ("driver:fy", "trail", 40.0)
    assert chosen.fit().theta[0][0] / G == pytest.approx(0.003, rel=0.3)


def test_a_trail_is_named_by_what_it_follows() -> None:
    inputs = average(power_ons(count=1, profile=TUMBLE, seconds=60.0)[0]).slow()
    trails = [b for b in drivers.bases(dict.fromkeys(drivers.SCALARS, (0.0, 1.0))) if b.kind == "trail"]
    assert [b.name for b in trails] == [name for name in TRAILED for _ in TRAILS]
    for number, basis in enumerate(trails):
        k, j = divmod(number, len(TRAILS))
        unit = G if basis.name[0] == "f" else DPS
        np.testing.assert_array_equal(basis.columns(inputs, 0)[:, 0], inputs.trail[:, k, j] / unit)


def test_neither_is_in_the_effects_file_and_the_filter_refuses_both() -> None:
    """It keeps neither past motion nor what temperature has crossed: a file that has them would be refused."""
    runs = [flipped(run, 0.1 * DPS) for run in power_ons(count=3)]
    found = trace.trace(runs[:2], runs[2])
    assert "driver:temperature_threshold" in {f["effect"] for f in found.document["findings"]}
    assert "driver:temperature_threshold" not in {effect.effect for effect in found.included}
    state = State("k", "deg/s", 0.1, 0.01)
    for effect, shape in (
        ("driver:temperature_threshold", {"basis": "relay", "down_degc": 26.0, "up_degc": 29.0}),
        ("driver:fy", {"basis": "trail", "tau_s": 40.0}),
    ):
        assert isinstance(catalogue.hypothesis(effect, ("gx",), shape), Driver)
        with pytest.raises(ValueError, match="take it out of the file"):
            CausalEffects([Included(effect, ("gx",), "A", shape, (state,))], np.eye(1), AxisMap(), runs[0].site, 0.05)
