"""The curve of a driver that was found, and the form that it proposes."""

from collections.abc import Callable

import numpy as np
from scipy import optimize

from filters.channels import error_unit
from filters.effects.drivers import Driver
from filters.tracing.trace_document import DriverCurveEntry
from filters.types import Array


def curve(driver: Driver, theta: Array, covariance: Array) -> DriverCurveEntry | None:
    """Curve with its standard deviations at the knots, or over the turn; None for a driver with one slope only."""
    y_unit, si = error_unit(driver.channel)
    if driver.kind == "hat":
        x = np.array(driver.knots)
        B = np.vstack([np.zeros(x.size - 1), np.eye(x.size - 1)])
        unit = driver.unit
    elif driver.kind == "fourier" and driver.name.startswith("angle_"):
        x = np.linspace(-180.0, 180.0, 49)
        orders = np.arange(1, len(driver.parameters) // 2 + 1)
        phase = np.deg2rad(x)[:, None] * orders
        B = np.hstack([np.sin(phase), np.cos(phase)])
        unit = "deg"
    else:
        return None
    sd = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", B, covariance, B), 0.0))
    return {
        "driver": driver.name, "unit": unit, "x": x.tolist(), "y": (B @ theta / si).tolist(), "sd": (sd / si).tolist(),
        "y_unit": y_unit,
    }  # fmt: skip


_SHAPES: dict[str, tuple[Callable[[Array, float, float], Array], int]] = {
    "line": (lambda u, a, b: u, 1),
    "absolute value": (lambda u, a, b: np.abs(u - a), 2),
    "quadratic": (lambda u, a, b: (u - a) ** 2, 2),
    "cubic": (lambda u, a, b: (u - a) ** 3, 2),
    "tanh": (lambda u, a, b: np.tanh((u - a) / b), 3),
    "exponential": (lambda u, a, b: np.exp(-(u + 1.0) / b), 2),
    "threshold": (lambda u, a, b: (u > a).astype(np.float64), 2),
    "Gaussian bump": (lambda u, a, b: np.exp(-0.5 * ((u - a) / b) ** 2), 3),
    "sine": (lambda u, a, b: np.sin((u - a) / b), 3),
}


def proposed_form(found: DriverCurveEntry) -> str:
    """The simplest form that fits a curve, by BIC.

    Returns one of line, absolute value, quadratic, cubic, tanh, exponential, threshold, Gaussian bump, sine.
    """
    x, y = np.array(found["x"]), np.array(found["y"])
    u = 2.0 * (x - x.min()) / max(float(np.ptp(x)), 1e-12) - 1.0
    sd = np.maximum(found["sd"], 0.02 * max(float(np.ptp(y)), 1e-12))
    best, name = np.inf, "line"
    for form, (shape, parameters) in _SHAPES.items():
        chi2 = _least(shape, u, y, sd)
        bic = chi2 + (parameters + 1) * np.log(u.size)
        if bic < best - 1e-9:
            best, name = bic, form
    return name


def _least(shape: Callable[[Array, float, float], Array], u: Array, y: Array, sd: Array) -> float:
    """Least chi-square over centre and width; scale and offset are linear."""

    def chi2(p: Array) -> float:
        width = float(np.exp(np.clip(p[1], -4.0, 4.0)))
        X = np.column_stack([np.ones(u.size), shape(u, float(p[0]), width)]) / sd[:, None]
        theta = np.linalg.lstsq(X, y / sd, rcond=None)[0]
        return float(np.sum((y / sd - X @ theta) ** 2))

    grid = [(a, b) for a in np.linspace(-0.8, 0.8, 7) for b in np.log([0.15, 0.4, 1.0])]
    start = min(grid, key=lambda p: chi2(np.array(p)))
    return float(min(chi2(np.array(start)), optimize.minimize(chi2, np.array(start), method="Nelder-Mead").fun))
