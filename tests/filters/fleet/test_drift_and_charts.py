"""What drifts is told, what follows temperature is not called drift, and a bad day stands out of a chart."""

import numpy as np
import pytest

from filters.fleet import control_chart, drift, readings
from filters.fleet.drift import Course
from filters.types import Array

MONTHS = np.arange(10.0)
WARM = 22.0 + np.array([3.0, -2.0, 1.0, -3.0, 2.0, 0.0, -1.0, 3.0, -3.0, 1.0])


def course(rng: np.random.Generator, per_month: float, per_kelvin: float, temperature: Array | None) -> Course:
    """Ten power-ons with a scatter of 0.3 beside an error of 0.1."""
    y = per_month * MONTHS + rng.normal(0.0, np.hypot(0.3, 0.1), 10)
    y += 0.0 if temperature is None else per_kelvin * (temperature - 22.0)
    return Course(y, np.full(10, 0.01), MONTHS, temperature)


@pytest.mark.parametrize(
    ("per_month", "per_kelvin", "temperature", "verdict"),
    [
        (0.0, 0.0, WARM, "none"),
        (0.5, 0.0, WARM, "drift"),
        (0.5, 0.0, None, "drift"),
        (0.5, 0.5, WARM, "drift"),
        (0.0, 0.5, WARM, "temperature"),
        (0.0, 0.5, 20.0 + MONTHS, "drift_or_temperature"),
        (0.0, 0.5, 20.0 + MONTHS + 1e-2 * WARM, "drift_or_temperature"),
        (0.0, 0.0, 20.0 + MONTHS, "none"),
    ],
)
def test_drift_is_told_from_temperature_where_it_can_be(
    per_month: float, per_kelvin: float, temperature: Array | None, verdict: str
) -> None:
    """Where both changed as one, neither is blamed."""
    rng = np.random.default_rng(1)
    quiet = [course(rng, 0.0, 0.0, WARM) for _ in range(4)]
    ((told, *others),) = drift.drifts([[course(rng, per_month, per_kelvin, temperature), *quiet]])
    assert told.verdict == verdict
    assert {other.verdict for other in others} == {"none"}
    if verdict == "drift":
        assert told.slope is not None
        assert told.slope.low < per_month < told.slope.high
    if verdict == "temperature":
        assert told.per_kelvin is not None
        assert told.per_kelvin.low < per_kelvin < told.per_kelvin.high


def test_two_power_ons_are_no_drift() -> None:
    """Any two points lie on a line."""
    two = Course(np.array([0.0, 9.0]), np.full(2, 0.01), np.array([0.0, 1.0]), None)
    assert drift.drifts([[two]]) == [[drift.Drift("too_few")]]


def test_a_unit_that_scatters_more_is_judged_by_its_own_scatter() -> None:
    """Ten times that of the others is no drift."""
    rng = np.random.default_rng(3)
    quiet = [course(rng, 0.0, 0.0, None) for _ in range(9)]
    wild = Course(3.0 * np.array([1.0, -1, 1, -1, 1, 1, -1, 1, 1, 1]), np.full(10, 0.01), MONTHS, None)
    ((told, *_),) = drift.drifts([[wild, *quiet]])
    assert told.slope is not None
    assert told.slope.sd > 0.2
    assert told.verdict == "none"


def test_holm_corrects_as_in_his_example() -> None:
    """Each times the number of those not smaller, and never falling."""
    assert drift.holm(np.array([0.01, 0.04, 0.03, 0.005])) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert drift.holm(np.array([])).size == 0


def charted(values: Array) -> control_chart.Chart | None:
    """Chart of two units with as many power-ons each."""
    names = [f"{k:02d}" for k in range(values.shape[1])] * 2
    units = np.repeat(["a", "b"], values.shape[1]).tolist()
    return control_chart.chart(readings.power_ons(values.ravel(), np.full(values.size, 0.1), units, names))


def test_bad_days_stand_out_and_do_not_hide_each_other() -> None:
    """Two of one unit, six scatters away; all others are inside."""
    values = np.random.default_rng(4).normal(0.0, 0.5, (2, 10)) + np.array([[3.0], [7.0]])
    values[1, [4, 7]] += 4.0
    found = charted(values)
    assert found is not None
    assert np.flatnonzero(found.outside).tolist() == [14, 17]
    assert 0.3 < found.power_on_sd < 0.7
    assert found.centres[10] == pytest.approx(7.0, abs=0.5)
    inside = ~found.outside
    assert np.all((found.low < values.ravel())[inside] & (values.ravel() < found.high)[inside])


def test_few_power_ons_make_no_chart() -> None:
    """Limits of two degrees of freedom would be nineteen scatters wide."""
    assert charted(np.array([[0.0, 1.0], [0.0, 1.0]])) is None


def test_equal_values_are_in_control() -> None:
    """No scatter at all."""
    found = charted(np.zeros((2, 5)))
    assert found is not None
    assert not found.outside.any()
    assert found.power_on_sd == 0.0
