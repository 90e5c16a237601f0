"""An average of thermal forms as one effect: beyond the range of training, and as a file keeps it."""

from typing import Any

import numpy as np
import pytest

from filters.effects import catalogue
from filters.effects.inputs import BANKS, LAGS
from filters.effects.thermal_average import ORDERS, ThermalAverage, columns

CURVE = np.zeros(ORDERS + len(LAGS) + len(BANKS))
CURVE[[0, 1, 2, ORDERS + 8, ORDERS + len(LAGS) + 7]] = 0.4, -0.2, 0.1, 0.3, -0.05
SPREAD = np.zeros_like(CURVE)
SPREAD[[1, ORDERS]] = 0.02, 0.01
MADE = ThermalAverage.of(2, "thermal_lag", -20.0, 60.0, (tuple(CURVE.tolist()), tuple(SPREAD.tolist())))


def test_a_file_keeps_all_of_it() -> None:
    kept = {**MADE.shape, **MADE.coefficients()}
    again = catalogue.hypothesis("thermal_lag", ("gz",), kept)
    assert isinstance(again, ThermalAverage)
    assert (again, again.low, again.high, again.curves) == (MADE, MADE.low, MADE.high, MADE.curves)
    assert [p.name for p in again.parameters] == ["amplitude", "spread1"]
    mean_only = ThermalAverage.of(2, "thermal_lag", -20.0, 60.0, MADE.curves[:1])
    alone = catalogue.hypothesis("thermal_lag", ("gz",), {**mean_only.shape, **mean_only.coefficients()})
    assert isinstance(alone, ThermalAverage)
    assert (alone.curves, len(alone.parameters)) == (mean_only.curves, 1)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("tau_s", [41.0], "tau_s"),
        ("lag", [0.1, 0.2, 0.3], "tau_s"),
        ("start", [0.0, 1.0, -1.0], "start"),
        ("curve_1", [1.0], "curve_1"),
        ("high_degc", -30.0, "high_degc"),
        ("spreads", 0.5, "spreads"),
        ("curve", None, "curve"),
    ],
)
def test_what_is_not_one_is_said(key: str, value: Any, says: str) -> None:
    kept = {**MADE.shape, **MADE.coefficients(), key: value}
    with pytest.raises(ValueError, match=says):
        catalogue.hypothesis("thermal_lag", ("gz",), kept)


def test_only_thermal_effects_are_averages() -> None:
    with pytest.raises(ValueError, match="can't be an average"):
        catalogue.hypothesis("scale", ("gz",), {**MADE.shape, **MADE.coefficients()})


def test_beyond_the_range_a_curve_goes_on_straight() -> None:
    T = np.linspace(-60.0, 100.0, 1601)
    nothing = np.zeros((T.size, len(LAGS))), np.zeros((T.size, len(BANKS)))
    made = np.column_stack(columns(T, *nothing, -20.0, 60.0)[:ORDERS])
    u = (T - 20.0) / 40.0
    inner = np.abs(u) <= 1.0
    assert np.allclose(made[inner], u[inner, None] ** [1, 2, 3])
    slopes = np.gradient(made, u, axis=0)
    for outside, at in ((u > 1.01, 1.0), (u < -1.01, -1.0)):
        assert np.allclose(slopes[outside], [1.0, 2.0 * at, 3.0])
    assert np.abs(np.diff(made, axis=0)).max() < 3.1 * (u[1] - u[0])
