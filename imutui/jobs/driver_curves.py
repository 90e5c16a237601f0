"""What a channel's error follows: what a trace fitted, with its band, and the residual that it is of.

An effect of one quantity at a time (temperature, a rate, a specific force) is a curve over it. What remembers
temperature is a line along each run, as another way through the same temperatures would give another one. Effects of
the motion's past, of time, or of several quantities together are left out.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from filters.channels import CHANNELS, DPS, G, error_unit
from filters.effects import catalogue
from filters.effects.hypothesis import Hypothesis
from filters.effects.inputs import LAGS, REFERENCE_DEGC, SENSED, Inputs
from filters.errors import InputError
from filters.tracing.trace_document import TraceDocument
from filters.types import Array
from imutui.logbook import effects_file
from imutui.logbook.reader import Log

# ------------------------------------------------------------------------------------------------------ driver course
# What may drive the errors of a log: temperature, rates and specific forces over time, and their means over cells.

TEMPERATURE = "temperature"
UNITS = {TEMPERATURE: "°C", **{name: "deg/s" if name.startswith("w") else "g" for name in SENSED}}
LEAST_SPANS = {"°C": 0.5, "deg/s": 2.0, "g": 0.1}  # range of a driver, by its unit, below which it shows nothing
_MOST_BLOCKS = 20_000


@dataclass(frozen=True, slots=True)
class DriverCourse:
    """What may drive errors over a log, as means over short blocks."""

    t: Array  # times, s since power-on, shape (N,)
    # by driver, "temperature" (degC) and those of `SENSED` as the unit reads them (deg/s, g, its own axes and sign),
    # shape (N,) each; NaN where not known
    values: dict[str, Array]
    has_past: bool = False  # whether the power-on began earlier: what remembers temperature is not known then


def course_of(log: Log, begins_s: float = 0.0) -> DriverCourse:
    """Return what may drive errors over a log whose first sample was taken `begins_s` s after power-on."""
    axes = log.info.axes()
    gyro = axes.gyro_to_instrument(_blocks(log.samples.gyro)) / DPS
    accel = axes.accel_to_instrument(_blocks(log.samples.accel)) / G
    values = dict(zip(SENSED, np.hstack([gyro, accel]).T, strict=True))
    values[TEMPERATURE] = _blocks(log.samples.degc[:, None])[:, 0]
    return DriverCourse(_blocks(log.seconds()[:, None])[:, 0] + begins_s, values, begins_s > 0.0)


def _blocks(samples: Array) -> Array:
    """Means over blocks of samples, a bounded number of them; what fills no block at the end is left out."""
    size = max(1, len(samples) // _MOST_BLOCKS)
    n = len(samples) // size * size
    return np.asarray(samples[:n].reshape(-1, size, samples.shape[1]).mean(axis=1), float)


def means(t: Array, values: Array, at: Array) -> tuple[Array, Array]:
    """Means of values over the cells of a residual, and how much they change within each.

    `t`, `values`: times, s, shape (N,), and values then, shape (N, k).
    `at`: middles of the cells, s, shape (M,), increasing.
    Returns shape (M, k) each; NaN of a cell with a value that is not known, or without any.
    """
    half = 0.5 * float(np.median(np.diff(at)))
    first, last = np.searchsorted(t, at - half), np.searchsorted(t, at + half)
    mean = np.full((at.size, values.shape[1]), np.nan)
    change = mean.copy()
    for k in np.flatnonzero(last > first):
        inside = values[first[k] : last[k]]
        mean[k], change[k] = inside.mean(axis=0), np.ptp(inside, axis=0)
    return mean, change


# ------------------------------------------------------------------------------------------------------ driver curves

_POINTS, _FEWEST = 60, 3
_MOST_CHANGE = 0.1


class Line(NamedTuple):
    """What was fitted: the driver, in its unit, error and its standard deviation; shape (K,) each."""

    x: Array
    y: Array
    sd: Array


@dataclass(frozen=True, slots=True)
class Points:
    """Residual of a run with an effect in it, and without the channel's others: driver and error, shape (N,) each."""

    run: str
    is_held_out: bool
    x: Array
    y: Array


@dataclass(frozen=True, slots=True)
class DriverCurve:
    """Error of a channel over what it follows, relative to that at the driver's mean, or to its mean over a run."""

    # channel, label, unit: of the error: its channel, the effect in words, deg/s or mg
    channel: str
    label: str
    unit: str
    # driver, driver_unit: what it follows, as in `driver:NAME`
    driver: str
    driver_unit: str
    lines: tuple[Line, ...]  # one, or one a run where the past matters
    points: tuple[Points, ...]  # one a run


class _Cells(NamedTuple):
    """Residual of a run after correction, in the document's unit, at the middles of cells, s; shape (N,) each."""

    run: str
    is_held_out: bool
    t: Array
    after: Array


class _Found(NamedTuple):
    """Effects on a channel with their parameters, SI."""

    channel: int
    hypotheses: tuple[Hypothesis, ...]
    theta: Array
    covariance: Array

    @property
    def label(self) -> str:
        return "; ".join(h.label for h in self.hypotheses)

    def columns(self, inputs: Inputs) -> Array:
        """In the channel's unit per SI of the parameters, shape (n, k)."""
        _, si = error_unit(self.channel)
        return np.hstack([h.columns(inputs, self.channel) for h in self.hypotheses]) / si

    def line(self, x: Array, columns: Array) -> Line:
        variance = np.einsum("ij,jk,ik->i", columns, self.covariance, columns)
        return Line(x, columns @ self.theta, np.sqrt(np.maximum(variance, 0.0)))


def of_trace(d: TraceDocument, courses: Mapping[str, DriverCourse]) -> tuple[DriverCurve, ...]:
    """Curves of the effects that joined the filter; an effect that follows several quantities has several.

    `d`: with its curves and its effects file.
    `courses`: of the runs whose logs are at hand, by their names.
    """
    made: list[DriverCurve | None] = []
    for found in _found(d):
        cells = [c for c in _cells(d, found.channel) if c.run in courses and c.t.size >= _FEWEST]
        if not _drivers(found.hypotheses[0]) or len(found.hypotheses) > 1:
            made.append(_along(found, cells, courses))
        else:
            made += [_over(found, driver, cells, courses) for driver in _drivers(found.hypotheses[0])]
    return tuple(curve for curve in made if curve is not None)


def _found(d: TraceDocument) -> list[_Found]:
    """Those of a trace's effects file that can be drawn: together, what follows the temperature's past on a channel."""
    if not d["effects_file"]:
        return []
    document = effects_file.parse(d["effects_file"].encode())
    known, si, at = [], np.ones(len(document.covariance())), 0
    for effect in document.effects:
        rows = np.arange(at, at + len(effect.states))
        at += rows.size
        try:
            h = catalogue.hypothesis(effect.effect, effect.channels, effect.parameters)
        except InputError:  # a process in time
            continue
        if rows.size and len(h.channels) == 1 and (h.source == "temperature" or _drivers(h)):
            known.append((h, rows))
            si[rows] = [p.si for p in h.parameters]
    theta = si * [state.mean for effect in document.effects for state in effect.states]
    covariance = document.covariance() * np.outer(si, si)
    made = []
    for group in _groups(known):
        rows = np.concatenate([own for _, own in group])
        hs = tuple(h for h, _ in group)
        made.append(_Found(hs[0].channels[0], hs, theta[rows], covariance[np.ix_(rows, rows)]))
    return made


_Known: TypeAlias = tuple[Hypothesis, NDArray[np.int_]]


def _groups(known: Sequence[_Known]) -> Iterator[list[_Known]]:
    """Effects one by one; of temperature all of a channel, where one of them remembers it."""
    remembers = {h.channels[0] for h, _ in known if not _drivers(h)}
    for channel in sorted(remembers):
        yield [(h, rows) for h, rows in known if h.channels[0] == channel and h.source == "temperature"]
    for h, rows in known:
        if h.source != "temperature" or h.channels[0] not in remembers:
            yield [(h, rows)]


def _drivers(h: Hypothesis) -> tuple[str, ...]:
    """What an effect is a function of; empty where it is one of the past, of time or of several together."""
    return () if h.is_free else tuple(name for name in h.over if name == TEMPERATURE or name in SENSED)


def _cells(d: TraceDocument, channel: int) -> Iterator[_Cells]:
    for run in d["curves"]:
        if curves := run["channels"].get(CHANNELS[channel]):
            t, after = np.array(curves["residual"]["x"], float), np.array(curves["residual"]["after"], float)
            use = np.isfinite(after)
            yield _Cells(run["run"], run["heldout"], t[use], after[use])


# ------------------------------------------------------------------------------------------- of one quantity


def _over(
    found: _Found, driver: str, cells: Sequence[_Cells], courses: Mapping[str, DriverCourse]
) -> DriverCurve | None:
    """Curve over a driver; None where its range is too short to show one."""
    unit = UNITS[driver]
    at = [_steady(c, courses[c.run], driver) for c in cells]
    used = [(c, x, use) for c, (x, use) in zip(cells, at, strict=True) if np.count_nonzero(use) >= _FEWEST]
    every = np.concatenate([x[use] for _, x, use in used]) if used else np.zeros(1)
    if np.ptp(every) < LEAST_SPANS[unit]:
        return None
    middle = found.columns(_inputs(driver, np.array([every.mean()])))

    def columns(x: Array) -> Array:
        return found.columns(_inputs(driver, x)) - middle

    grid = np.union1d(np.linspace(every.min(), every.max(), _POINTS), np.clip(0.0, every.min(), every.max()))
    points = tuple(_points(c, x[use], c.after[use], columns(x[use]) @ found.theta) for c, x, use in used)
    line = found.line(grid, columns(grid))
    return DriverCurve(
        CHANNELS[found.channel], found.label, error_unit(found.channel)[0], driver, unit, (line,), points
    )


def _steady(cells: _Cells, of: DriverCourse, driver: str) -> tuple[Array, NDArray[np.bool_]]:
    """Mean of a driver over cells, and which of them to use: where it changes much, the mean is that of no value."""
    mean, change = (values[:, 0] for values in means(of.t, of.values[driver][:, None], cells.t))
    known = np.isfinite(mean)
    span = float(np.ptp(mean[known])) if known.any() else 0.0
    return mean, known & (change <= max(_MOST_CHANGE * span, LEAST_SPANS[UNITS[driver]]))


def _points(cells: _Cells, x: Array, after: Array, model: Array) -> Points:
    """A run's residual has no mean of its own, which is its bias: it is given the model's."""
    return Points(cells.run, cells.is_held_out, x, after - after.mean() + model)


def _inputs(driver: str, x: Array) -> Inputs:
    """Values of one driver, all others being zero."""
    sensed = np.zeros((x.size, 6))
    if driver != TEMPERATURE:
        sensed[:, SENSED.index(driver)] = x * (DPS if driver.startswith("w") else G)
    return _all_inputs(x=sensed, temperature=x if driver == TEMPERATURE else np.full(x.size, REFERENCE_DEGC))


def _all_inputs(temperature: Array, **known: Array) -> Inputs:
    """Drivers of which only some are known, the others being zero."""
    n = temperature.size
    shapes = {"x": (6,), "x_dot": (6,), "lagged": (0,), "plays": (0,), "spin": (3,), "horizontal": (3, 2),
              "centripetal": (3, 3), "angles": (3,), "rates": (3,), "direction": (3,), "followed": (0,)}  # fmt: skip
    zeros = {field.name: np.zeros((n, *shapes.get(field.name, ()))) for field in fields(Inputs)}
    return Inputs(**zeros | {"temperature": temperature} | known)


# ------------------------------------------------------------------------------------- of temperature's past


def _along(found: _Found, cells: Sequence[_Cells], courses: Mapping[str, DriverCourse]) -> DriverCurve | None:
    """Lines along runs whose temperature is known from power-on."""
    lines, points = [], []
    for c in cells:
        of = courses[c.run]
        if of.has_past or np.count_nonzero(np.isfinite(of.values[TEMPERATURE])) < _FEWEST:
            continue
        t, inputs = _remembered(of)
        mean, _ = means(t, np.column_stack([inputs.temperature, found.columns(inputs)]), c.t)
        use = np.isfinite(mean).all(axis=1)
        if np.count_nonzero(use) < _FEWEST or np.ptp(mean[use, 0]) < LEAST_SPANS[UNITS[TEMPERATURE]]:
            continue
        columns = mean[use, 1:] - mean[use, 1:].mean(axis=0)
        lines.append(found.line(mean[use, 0], columns))
        points.append(_points(c, mean[use, 0], c.after[use], columns @ found.theta))
    if not lines:
        return None
    unit = error_unit(found.channel)[0]
    label, driver = found.label, TEMPERATURE
    return DriverCurve(CHANNELS[found.channel], label, unit, driver, UNITS[driver], tuple(lines), tuple(points))


def _remembered(of: DriverCourse) -> tuple[Array, Inputs]:
    """Temperature at even times, as the tracer smooths it, with its rate, lags and plays."""
    from filters.effects import temperature

    known = np.isfinite(of.values[TEMPERATURE])
    t = np.linspace(of.t[0], of.t[-1], of.t.size)
    period = float(t[1] - t[0])
    level, rate = temperature.smoothed(np.interp(t, of.t[known], of.values[TEMPERATURE][known]), period)
    lagged = np.stack([temperature.lag(level, tau / period) for tau in LAGS], axis=1)
    plays, _ = temperature.plays(level - level[0])
    return t, _all_inputs(level, temperature_rate=rate, lagged=lagged, plays=plays)
