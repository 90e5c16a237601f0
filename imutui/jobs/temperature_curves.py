"""What temperature does to a channel: the curve that a trace fitted, with its band, and the residual that it is of."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from filters.channels import CHANNELS, error_unit
from filters.effects import plain_names
from filters.effects.inputs import REFERENCE_DEGC
from filters.tracing.trace_document import TraceDocument
from filters.types import Array
from imutui.logbook import effects_file

_POWERS = {"k": 1, "k1": 1, "k2": 2, "k3": 3}
_POINTS, _FEWEST = 60, 3
_LEAST_SPAN_K = 0.5

Course: TypeAlias = tuple[Array, Array]
"""Times, s since power-on, and temperatures then, degC; shape (N,) each."""


@dataclass(frozen=True, slots=True)
class TemperatureCurve:
    """Error of a channel over temperature, relative to that at the mean temperature.

    Attributes
    ----------
    channel, label, unit : str
        Of the error: its channel, the effect in words, deg/s or mg.
    x, y, sd : Array
        The fitted curve and its standard deviation, shape (K,); x in degC.
    points : dict
        Of each run the residual before correction over temperature: x and y, shape (N,) each.
    """

    channel: str
    label: str
    unit: str
    x: Array
    y: Array
    sd: Array
    points: dict[str, tuple[Array, Array]]


def of_trace(d: TraceDocument, courses: Mapping[str, Course]) -> tuple[TemperatureCurve, ...]:
    """Curves of the effects of temperature that joined the filter.

    Parameters
    ----------
    d : TraceDocument
        With its curves and its effects file.
    courses : mapping of Course
        Temperature of the runs whose logs are at hand, by their names.
    """
    document = effects_file.parse(d["effects_file"].encode()) if d.get("effects_file") else None
    if document is None:
        return ()
    covariance, at, made = document.covariance(), 0, []
    for effect in document.effects:
        rows = slice(at, at + len(effect.states))
        at = rows.stop
        powers = [_POWERS.get(state.name, 0) for state in effect.states]
        if effect.effect not in ("thermal_lin", "thermal_poly") or not all(powers):
            continue
        theta = np.array([state.mean for state in effect.states])
        for channel in effect.channels:
            found = _residuals(d, channel, courses)
            if curve := _curve(channel, effect.effect, np.array(powers), theta, covariance[rows, rows], found):
                made.append(curve)
    return tuple(made)


def _residuals(d: TraceDocument, channel: str, courses: Mapping[str, Course]) -> dict[str, tuple[Array, Array]]:
    """Temperature and residual of the cells of each run."""
    found = {}
    for run in d.get("curves", []):
        if run["run"] not in courses or channel not in run["channels"]:
            continue
        t, degc = courses[run["run"]]
        curve = run["channels"][channel]["residual"]
        at, y = np.array(curve["x"], float), np.array(curve["before"], float)
        x = np.interp(at, t, degc, left=np.nan, right=np.nan)
        use = np.isfinite(x) & np.isfinite(y)
        if np.count_nonzero(use) >= _FEWEST:
            found[run["run"]] = x[use], y[use]
    return found


def _curve(
    channel: str, effect: str, powers: Array, theta: Array, covariance: Array, found: dict[str, tuple[Array, Array]]
) -> TemperatureCurve | None:
    if not found:
        return None
    every = np.concatenate([x for x, _ in found.values()])
    if np.ptp(every) < _LEAST_SPAN_K:
        return None
    middle = (np.array([every.mean()]) - REFERENCE_DEGC)[:, None] ** powers

    def columns(x: Array) -> Array:
        return np.asarray((x[:, None] - REFERENCE_DEGC) ** powers - middle)

    x = np.linspace(every.min(), every.max(), _POINTS)
    basis = columns(x)
    sd = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", basis, covariance, basis), 0.0))
    # a run's residual has no mean of its own: that is its bias
    points = {run: (at, y - y.mean() + (columns(at) @ theta).mean()) for run, (at, y) in found.items()}
    unit, _ = error_unit(CHANNELS.index(channel))
    return TemperatureCurve(channel, plain_names.effect(effect), unit, x, basis @ theta, sd, points)
