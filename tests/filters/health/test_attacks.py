"""Channel health under faults and units that its thresholds were not made with."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from helpers.spoiled_channels import Made, findings, healthy

from filters.channels import DPS, MG
from filters.health.finding import HealthFinding

UNIT = healthy("imu400cd", 400.0 / 3.0, 4, 60.0)
GX, GY, GZ, AX, AY, AZ = range(6)


def with_channel(c: int, x: np.ndarray, made: Made = UNIT) -> Made:
    """The unit with other readings of a channel, in whole counts."""
    own = made.x.copy()
    own[:, c] = np.rint(x / made.lsb[c]) * made.lsb[c]
    return replace(made, x=own)


def unrounded(made: Made = UNIT) -> Made:
    """The unit with readings that come in no steps."""
    return replace(made, x=made.x + np.random.default_rng(1).uniform(-0.5, 0.5, made.x.shape) * made.lsb)


def named(found: tuple[HealthFinding, ...]) -> set[tuple[str, str]]:
    return {(one.kind, one.channel) for one in found}


@pytest.fixture(autouse=True)
def no_warning(recwarn: pytest.WarningsRecorder) -> Iterator[None]:
    """Arithmetic on faulty readings warns of nothing."""
    with np.errstate(all="raise", under="ignore"):
        yield
    assert not recwarn.list


def test_the_unit_is_healthy() -> None:
    assert findings(UNIT) == findings(UNIT, stated=False) == findings(unrounded(), stated=False) == ()


@pytest.mark.parametrize("late", [-2, 2, 5, 16])
def test_a_copy_some_readings_late_is_a_copy(late: int) -> None:
    found = findings(with_channel(GY, np.roll(UNIT.x[:, GX], late)))
    assert ("copy", "gy") in named(found)
    assert f"{abs(late)} readings apart" in found[0].said


@pytest.mark.parametrize("part", [1.0, -0.5])
def test_a_channel_made_of_two_others_is_a_copy(part: float) -> None:
    found = findings(with_channel(GZ, UNIT.x[:, GX] + part * UNIT.x[:, GY]))
    assert named(found) == {("copy", "gx"), ("copy", "gy"), ("copy", "gz")}
    assert "gz is a sum of multiples of gx and gy" in " ".join(one.said for one in found)


def test_a_tone_that_channels_share_makes_no_copy() -> None:
    """A motor beside the unit, far above its noise, felt along several axes in different phases."""
    phases = np.array([0.0, 1.0, 2.0, 0.5, 1.5, 2.5])
    sizes = 300.0 * UNIT.x.std(axis=0)
    x = UNIT.x + sizes * np.sin(2.0 * np.pi * 31.0 * UNIT.t[:, None] + phases)
    assert not [one for one in findings(replace(UNIT, x=x), stated=False) if one.kind == "copy"]


def test_noise_thirty_times_the_data_sheets_is_no_motion() -> None:
    """Means of a span move by more than 5 deg/s then, and the unit still counts as at rest."""
    x = UNIT.x[:, GY]
    noisy = with_channel(GY, x.mean() + 60.0 * (x - x.mean()))
    assert ("noisy", "gy") in named(findings(noisy, stated=False))


@pytest.mark.parametrize(("c", "value"), [(GY, -999.0 * DPS), (AX, 9999.0e3 * MG), (AZ, -999.0e3 * MG)])
@pytest.mark.parametrize("rounded", [True, False])
def test_a_few_readings_of_any_size_are_invalid_and_nothing_else(c: int, value: float, rounded: bool) -> None:
    """They turn no unit, and hide no steps of the other readings."""
    made = UNIT if rounded else unrounded()
    x = made.x[:, c].copy()
    x[[700, 2500, 4000, 7100]] = value
    own = made.x.copy()
    own[:, c] = x
    assert named(findings(replace(made, x=own), stated=False)) == {("invalid", ("gx", "gy", "gz", "ax", "ay", "az")[c])}


def test_zeros_among_readings_without_steps_are_invalid_though_others_are_near() -> None:
    made = unrounded()
    x = made.x[:, GX] - made.x[:, GX].mean()
    x[np.random.default_rng(2).choice(x.size, 8, replace=False)] = 0.0
    own = made.x.copy()
    own[:, GX] = x
    assert named(findings(replace(made, x=own), stated=False)) == {("invalid", "gx")}


@pytest.mark.parametrize("finer", [4, 64, 4096])
def test_zeros_among_steps_of_any_size_are_chance(finer: int) -> None:
    """Logs that hold more digits than the unit has noise reach 0 as seldom as any other value."""
    rng = np.random.default_rng(3)
    sd = UNIT.x.std(axis=0)
    step = sd / finer
    x = np.rint(rng.normal(size=(24_000, 6)) * sd / step) * step
    t = np.arange(24_000) / 100.0
    made = replace(UNIT, t=t, x=x, degc=np.full(t.size, 25.0))
    assert not [one for one in findings(made, stated=False) if one.kind == "invalid"]


def test_a_channel_clipped_below_its_mean_is_clipped() -> None:
    x = UNIT.x[:, AZ]
    found = findings(with_channel(AZ, np.minimum(x, x.mean() - x.std())))
    assert ("clipped", "az") in named(found)
    assert "mg:" in found[0].said  # where readings pile up has its unit


def test_a_bias_that_comes_back_has_moved() -> None:
    there_and_back = 1.0 - np.abs(UNIT.t / 30.0 - 1.0)
    found = findings(with_channel(GZ, UNIT.x[:, GZ] + 1.5 * DPS * there_and_back))
    assert named(found) == {("moving", "gz")}
    assert "to and fro" in found[0].said


@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_an_infinite_temperature_is_absurd(value: float) -> None:
    assert named(findings(replace(UNIT, degc=np.full(UNIT.t.size, value)))) == {("temperature", "T")}


def test_a_unit_whose_noise_is_below_its_steps_is_not_frozen_between_two_changes() -> None:
    """One channel that stands still for long leaves what is known of the others as it is."""
    rng = np.random.default_rng(5)
    x = np.zeros((4000, 6))
    t = np.arange(4000) / 20.0
    for c, share in enumerate((0.5, 0.02, 0.03, 0.5, 0.5, 0.5)):
        x[:, c] = (rng.random(4000) < share) * 0.5 * DPS
    made = replace(UNIT, t=t, x=x, degc=np.full(t.size, 25.0))
    assert not [one for one in findings(made, stated=False) if one.kind in ("dead", "frozen")]


@pytest.mark.parametrize("c", [GZ, AX])
def test_a_channel_that_begins_to_read_late_was_frozen(c: int) -> None:
    x = UNIT.x[:, c].copy()
    x[UNIT.t < 10.0] = x[0]
    for stated in (True, False):
        (found,) = findings(with_channel(c, x), stated=stated)
        assert found.kind == "frozen"
        assert "from 0.0 s on" in found.said
