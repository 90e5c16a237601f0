"""Model, unit and day are told apart as far as the data allow, with errors that their standard deviations describe."""

import numpy as np
import pytest

from filters.fleet import components, drift, readings
from filters.fleet.readings import PowerOns
from filters.types import Array

Sds = tuple[float, float, float]


def fleet(rng: np.random.Generator, counts: tuple[int, ...], sds: Sds) -> tuple[PowerOns, Array]:
    """A fleet about 3.0, with sds of unit, day and measurement; and the true values of its units."""
    unit_sd, day_sd, error = sds
    truth = 3.0 + rng.normal(0.0, unit_sd, len(counts))
    units = np.repeat(np.arange(len(counts)), counts)
    sd = error * np.exp(rng.normal(0.0, 0.3, units.size))
    values = truth[units] + rng.normal(0.0, day_sd, units.size) + rng.normal(0.0, sd)
    days = [f"day {k}" for k in range(units.size)]
    return readings.power_ons(values, sd, [f"unit {u:02d}" for u in units], days), truth


def test_errors_are_what_their_standard_deviations_say() -> None:
    """Over fleets of five units, unbalanced: of z no bias and a scale of one, and 95 % intervals hold 95 %."""
    rng = np.random.default_rng(1)
    z, inside = [], []
    for _ in range(20):
        data, truth = fleet(rng, (2, 3, 1, 4, 2), (1.0, 0.5, 0.2))
        found = components.estimate(data)
        assert found.model is not None
        pairs = [(found.model, 3.0)]
        pairs += [(unit.value, true) for unit, true in zip(found.units, truth, strict=True) if unit.value]
        z += [(one.value - true) / one.sd for one, true in pairs]
        inside += [one.low < true < one.high for one, true in pairs]
    # some hundred values, those of a fleet not independent
    assert abs(np.mean(z)) < 0.25
    assert abs(np.mean(np.abs(z) < 1.0) - 0.683) < 0.12
    assert abs(np.mean(inside) - 0.95) < 0.05


def test_components_of_a_large_fleet_are_those_it_was_made_with() -> None:
    """Each within its interval, and the intervals are narrow."""
    found = components.estimate(fleet(np.random.default_rng(2), (4,) * 60, (1.0, 0.5, 0.2))[0])
    for component, truth in ((found.between_units, 1.0), (found.between_power_ons, 0.5)):
        assert component is not None
        assert component.low < truth < component.high
        assert component.low < component.sd < component.high
        assert component.high - component.low < 0.5 * truth
    assert found.days is not None
    assert len(found.days) == 240


def test_without_errors_of_measurement_the_model_has_students_interval() -> None:
    """Known from textbooks: mean of unit means, their standard deviation over √n, t with n - 1 degrees of freedom."""
    means = np.array([1.0, 2.0, 4.0, 4.5, 6.0])
    values = np.repeat(means, 2) + np.tile([-0.1, 0.1], 5)
    names = [f"u{k // 2}" for k in range(10)]
    found = components.estimate(readings.power_ons(values, np.full(10, 1e-6), names, list("ab" * 5)))
    assert found.model is not None
    half = 2.776445 * np.std(means, ddof=1) / np.sqrt(5.0)
    assert found.model.value == pytest.approx(3.5, abs=1e-3)
    assert found.model.high - found.model.low == pytest.approx(2.0 * half, rel=0.02)
    assert found.between_power_ons is not None
    assert found.between_power_ons.sd == pytest.approx(np.sqrt(0.02), rel=1e-3)


def test_of_one_unit_its_own_part_is_not_told_from_the_models() -> None:
    """Its value is known, and how its days scatter."""
    found = components.estimate(fleet(np.random.default_rng(3), (6,), (1.0, 0.5, 0.1))[0])
    assert (found.model, found.between_units, found.together) == (None, None, None)
    assert found.between_power_ons is not None
    assert found.units[0].value is not None
    assert found.units[0].own is None


def test_of_one_power_on_each_the_days_part_is_not_told_from_the_units() -> None:
    """Their sum is known, and the model's value."""
    found = components.estimate(fleet(np.random.default_rng(14), (1,) * 30, (1.0, 0.5, 0.1))[0])
    assert found.model is not None
    assert found.together is not None
    assert found.together.low < np.hypot(1.0, 0.5) < found.together.high
    assert (found.between_units, found.between_power_ons, found.days) == (None, None, None)
    assert all(unit.value is None and unit.own is None for unit in found.units)


def test_of_one_unit_and_one_power_on_nothing_is_told() -> None:
    """There is the reading, and nothing to part it by."""
    found = components.estimate(fleet(np.random.default_rng(5), (1,), (1.0, 0.5, 0.1))[0])
    assert found == components.Fleet(None, None, None, None, found.units, None)


def test_units_that_are_alike_are_not_told_from_none() -> None:
    """The interval of what is between units begins at zero."""
    found = components.estimate(fleet(np.random.default_rng(6), (4,) * 8, (0.0, 1.0, 0.1))[0])
    assert found.between_units is not None
    assert found.between_units.low == 0.0
    assert found.between_units.high < 1.2


@pytest.mark.parametrize("values", [np.full(6, 2.0), np.array([2.0, 2.0, 2.0, 9e6, 9e6, 9e6])])
def test_equal_values_and_far_ones_are_numbers_all_the_same(values: Array) -> None:
    """No component, or one far beyond all errors, is estimated without an overflow."""
    found = components.estimate(readings.power_ons(values, np.full(6, 1e-3), list("aaabbb"), list("123123")))
    assert found.model is not None
    assert np.isfinite([found.model.value, found.model.sd, found.model.low, found.model.high]).all()


def test_logs_of_one_power_on_are_one_value() -> None:
    """Their weighted mean; power-ons of two units may have one name."""
    data = readings.power_ons(np.array([1.0, 2.0, 5.0]), np.array([1.0, 0.5, 1.0]), list("aab"), list("xxx"))
    assert data.values.tolist() == pytest.approx([1.8, 5.0])
    assert data.variances.tolist() == pytest.approx([0.2, 1.0])
    assert data.units == ("a", "b")


def test_logs_that_disagree_within_a_power_on_raise_the_standard_deviations() -> None:
    """By the root of chi-square over degrees of freedom; not for what may be chance."""
    apart = readings.power_ons(np.array([0.0, 10.0]), np.ones(2), list("aa"), list("xx"))
    near = readings.power_ons(np.array([0.0, 1.0]), np.ones(2), list("aa"), list("xx"))
    assert apart.repeat is not None
    assert apart.repeat.scale == pytest.approx(np.sqrt(50.0))
    assert apart.variances[0] == pytest.approx(25.0)
    assert near.repeat is not None
    assert near.repeat.scale == 1.0


@pytest.mark.parametrize(
    ("values", "sds"), [(np.array([]), np.array([])), (np.array([1.0]), np.array([0.0])), (np.ones(2), np.ones(3))]
)
def test_misuse_is_named(values: Array, sds: Array) -> None:
    """No values, a standard deviation of zero, or one too many."""
    with pytest.raises(ValueError, match="`values`"):
        readings.power_ons(values, sds, ["a"] * values.size, ["x"] * values.size)


def test_errors_of_very_different_size_are_no_obstacle() -> None:
    """One value that is known a million million times better than the others leaves all estimates finite."""
    values = np.array([1.0, 2.0, 1.5, 0.5, 3.0, 2.5])
    sds = np.array([1e-12, 1.0, 0.1, 0.1, 0.1, 1.0])
    data = readings.power_ons(values, sds, list("aaabbb"), list("123123"))
    found = components.estimate(data)
    assert all(unit.value is not None and np.isfinite(unit.value.sd) for unit in found.units)
    courses = [
        drift.Course(data.values[part], data.variances[part], np.arange(3.0), np.array([20.0, 25.0, 21.0]))
        for part in (data.of_unit(0), data.of_unit(1))
    ]
    ((one, _),) = drift.drifts([courses])
    assert one.verdict in ("too_few", "none")


def test_a_component_that_adds_nothing_is_zero() -> None:
    """Not a number as small as rounding makes it."""
    values = np.array([1.0, 1.001, 0.999, 2.0, 2.001, 1.999])
    found = components.estimate(readings.power_ons(values, np.full(6, 0.1), list("aaabbb"), list("123123")))
    assert found.between_power_ons is not None
    assert (found.between_power_ons.sd, found.between_power_ons.low) == (0.0, 0.0)
