"""Curves of drivers that were found, and the simplest form that fits one."""

from collections.abc import Callable

import numpy as np
import pytest

from filters.channels import DPS, MG
from filters.effects import drivers
from filters.tracing.report import curve_of, proposed_form

FORMS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "line": lambda x: 0.3 * x,
    "absolute value": lambda x: np.abs(x),
    "quadratic": lambda x: x**2,
    "cubic": lambda x: x**3,
    "threshold": lambda x: (x > 0.7).astype(float),
    "Gaussian bump": lambda x: np.exp(-0.5 * ((x - 0.4) / 0.3) ** 2),
}


@pytest.mark.parametrize("form", list(FORMS))
def test_the_form_that_made_a_curve_is_proposed(form: str) -> None:
    x = np.linspace(-2.0, 2.0, 17)
    y = FORMS[form](x)
    sd = 0.02 * np.ptp(y)
    for seed in range(3):
        noise = np.random.default_rng(seed).standard_normal(x.size)
        values = {"x": x.tolist(), "y": (y + sd * noise).tolist(), "sd": [sd] * x.size}
        assert proposed_form({"driver": "d", "unit": "K", "y_unit": "mg", **values}) == form


def basis(name: str, kind: str) -> drivers.Driver:
    ranges = dict.fromkeys((*drivers.SCALARS, "outer", "middle", "inner"), (0.0, 8.0))
    return next(b for b in drivers.bases(ranges) if b.name == name and b.kind == kind)


def test_a_curve_is_its_parameters_at_the_knots() -> None:
    driver = basis("temperature", "hat").on(4)
    theta = MG * np.arange(1.0, 8.0)
    covariance = np.diag((MG * 0.1 * np.arange(1.0, 8.0)) ** 2)
    made = curve_of(driver, theta, covariance)
    assert made is not None
    assert made["y"] == pytest.approx([0.0, 1, 2, 3, 4, 5, 6, 7])
    assert made["sd"] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
    assert made["x"] == pytest.approx(np.linspace(0.0, 8.0, 8).tolist())
    assert (made["driver"], made["unit"], made["y_unit"]) == ("temperature", "degC", "mg")


def test_a_curve_over_a_turn_is_its_harmonics() -> None:
    driver = basis("angle_inner", "fourier").on(0)
    theta = np.zeros(len(driver.parameters))
    theta[0], theta[len(driver.parameters) // 2 + 1] = 2.0 * DPS, 1.0 * DPS
    made = curve_of(driver, theta, np.zeros((len(driver.parameters),) * 2))
    assert made is not None
    x = np.deg2rad(made["x"])
    assert np.allclose(made["y"], 2.0 * np.sin(x) + np.cos(2.0 * x))
    assert (made["x"][0], made["x"][-1]) == (-180.0, 180.0)


def test_a_slope_has_no_curve() -> None:
    assert curve_of(basis("direction_inner", "line").on(0), np.ones(1), np.eye(1)) is None
