"""Limits of detection: what is five times above the noise, for every effect of the catalogue."""

import json

import numpy as np
import pytest
from helpers import runs

from filters.channels import DPS
from filters.effects import catalogue
from filters.imu import IMU400CD_200
from filters.tracing.blocks import average
from filters.tracing.design_matrix import Design
from filters.tracing.detectability import limits
from filters.tracing.stack import Stack

DETECTABLE = [
    name for name, entry in catalogue.EFFECTS.items() if entry.kind in ("additive", "motion", "run_specific", "drift")
]


@pytest.fixture(scope="module")
def design() -> Design:
    """A still unit, twice for ten minutes, warming up."""
    return Design(Stack.of([average(run) for run in runs.power_ons(count=2, seconds=600.0)]))


@pytest.mark.parametrize("effect", DETECTABLE)
def test_every_effect_has_a_limit_or_is_said_to_be_hidden(design: Design, effect: str) -> None:
    made = limits(design, list(range(6)), effect, ())
    assert made
    for entry in made:
        assert entry["text"].startswith(("below what this log can show", "this log can't show it"))
        assert entry["limit"] is None or entry["limit"] > 0.0
    json.dumps(made)


def test_a_limit_is_five_standard_deviations_of_the_parameter(design: Design) -> None:
    term = next(a for a in design.terms if a.hypothesis.effect == "thermal_lin" and 1 in a.places)
    (entry,) = [x for x in limits(design, [1], "thermal_lin", ()) if x["channels"] == ["gy"]]
    sd = float(np.sqrt(design.fit([term]).covariance[0, 0])) / DPS
    assert entry["limit"] == pytest.approx(5.0 * sd, rel=1e-6)
    assert entry["unit"] == "deg/s/K"


def test_a_tone_s_limit_is_that_of_its_amplitude(design: Design) -> None:
    """d² = a² T / (2 σ²) over all runs."""
    (entry,) = limits(design, [0], "tone", ())
    expected = 5.0 * IMU400CD_200.gyro_arw / DPS * np.sqrt(2.0 / 1200.0)
    assert entry["limit"] == pytest.approx(expected, rel=0.1)


def test_what_was_found_needs_no_limit(design: Design) -> None:
    term = next(a for a in design.terms if a.hypothesis.effect == "ramp" and 2 in a.places)
    assert limits(design, [2], "ramp", {term.key}) == []
