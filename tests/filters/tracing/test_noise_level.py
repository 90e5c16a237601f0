"""What the level of the noise follows."""

import numpy as np
import pytest
from helpers.runs import power_ons

from filters.simulation import Effect
from filters.tracing.blocks import average
from filters.tracing.design_matrix import Design
from filters.tracing.noise_level import noise_drivers
from filters.tracing.stack import Stack


def design(*effects: Effect, seed: int = 1, hz: float = 20.0) -> Design:
    return Design(Stack.of([average(run) for run in power_ons(*effects, seed=seed, count=2, seconds=900.0, hz=hz)]))


def test_noise_that_follows_temperature_is_levelled() -> None:
    made = design(Effect("noise_level", ("ay",), {"log_variance_per_unit": 0.12, "driver": "temperature"}))
    multiplier, found = noise_drivers(made, list(range(6)))
    assert [(level.channel, level.driver) for level in found] == [(4, "temperature")]
    T = np.concatenate([b.slow().temperature for b in made.stack.blocks])
    truth = np.exp(0.06 * (T - np.median(T)))
    ratio = multiplier[:, 4] / truth
    assert np.std(ratio / np.median(ratio)) < 0.1
    assert found[0].ratio == pytest.approx(np.exp(0.06 * np.ptp(T)), rel=0.2)
    assert len(found[0].knots) == len(found[0].at) > 2
    assert np.all(np.diff(found[0].at) > -0.1)
    assert np.all(np.delete(multiplier, 4, axis=1) == 1.0)


@pytest.mark.parametrize("seed", range(1, 6))
def test_even_noise_follows_nothing(seed: int) -> None:
    made = design(Effect("thermal_lin", ("gy",), {"dps_per_k": 0.05}), seed=seed)
    multiplier, found = noise_drivers(made, list(range(6)))
    assert found == []
    assert np.all(multiplier == 1.0)
