"""Which units drift: slope of a value over time, beside that over temperature where temperature varies.

Tests are many, one a unit and channel: `multiple.holm` corrects them, over all that a caller asks of at once. What it
leaves out: what a slope is after a power-on; each power-on is one value here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from filters.fleet import multiple, regression
from filters.fleet.mixture import Estimate
from filters.fleet.regression import Coefficient, Line
from filters.types import Array

Verdict = Literal["drift", "temperature", "drift_or_temperature", "none", "too_few"]

LEAST = 3
"""Power-ons at different times that a slope takes."""
LEVEL = 0.05
"""Of the test, after Holm's correction."""
_LEAST_KELVIN = 1.0
_CLOSE = 1e-6


@dataclass(frozen=True, slots=True)
class Course:
    """A unit's values over time."""

    # y, variances: one value a power-on and its variance of measurement, shape (J,)
    y: Array
    variances: Array
    t: Array  # when, in any unit, shape (J,)
    temperature: Array | None  # degC, shape (J,); None where it is not known of each


@dataclass(frozen=True, slots=True)
class Drift:
    """Whether a unit drifts."""

    # "drift", "temperature" (it follows temperature, and time explains nothing beside it), "drift_or_temperature"
    # (values change, and time and temperature changed together: not told apart), "none", "too_few"
    verdict: Verdict
    slope: Estimate | None = None  # value a unit of time; beside temperature where `per_kelvin` is there
    # p, p_holm: probability of such a slope by chance, and corrected for all tests
    p: float | None = None
    p_holm: float | None = None
    # value a kelvin; None where temperature is not known, varies by less than 1 K, or power-ons are too few
    per_kelvin: Estimate | None = None
    alone: Estimate | None = None  # slope as if temperature did nothing


@dataclass(frozen=True, slots=True)
class _Fit:
    """Coefficients of a course: time and temperature beside each other, and each alone; None where there is none."""

    time: Coefficient | None = None
    kelvin: Coefficient | None = None
    time_alone: Coefficient | None = None
    kelvin_alone: Coefficient | None = None
    collinear: bool = False


def drifts(groups: Sequence[Sequence[Course]]) -> list[list[Drift]]:
    """Drift of each unit in each group, corrected over all of them.

    `groups`: units that share a scatter between power-ons: those of one model and one channel.
    """
    fits = [fit for group in groups for fit in _fits(group)]
    time = _corrected([fit.time for fit in fits])
    kelvin = _corrected([fit.kelvin for fit in fits])
    time_alone = _corrected([fit.time_alone for fit in fits])
    kelvin_alone = _corrected([fit.kelvin_alone for fit in fits])
    told = map(_told, fits, time, kelvin, time_alone, kelvin_alone)
    return [[next(told) for _ in group] for group in groups]


def _told(fit: _Fit, time: float | None, kelvin: float | None, time_alone: float | None,
          kelvin_alone: float | None) -> Drift:  # fmt: skip
    alone = fit.time_alone.estimate if fit.time_alone else None
    if fit.time is None:
        if not fit.collinear:
            return Drift("too_few")
        changes = _sure(time_alone) or _sure(kelvin_alone)
        return Drift("drift_or_temperature" if changes else "none", alone=alone)
    per_kelvin = fit.kelvin.estimate if fit.kelvin else None
    verdict = _verdict(fit, time, kelvin, time_alone, kelvin_alone)
    return Drift(verdict, fit.time.estimate, fit.time.p, time, per_kelvin, alone)


def _verdict(fit: _Fit, time: float | None, kelvin: float | None, time_alone: float | None,
             kelvin_alone: float | None) -> Verdict:  # fmt: skip
    if _sure(time):
        return "drift"
    if _sure(kelvin):
        return "temperature"
    if not (_sure(time_alone) or _sure(kelvin_alone)):
        return "none"
    # each alone explains the change, and neither adds to the other, unless time alone explains nothing
    return "drift_or_temperature" if fit.time_alone and fit.time_alone.p < LEVEL else "temperature"


def _sure(p: float | None) -> bool:
    return p is not None and p < LEVEL


def _corrected(found: Sequence[Coefficient | None]) -> list[float | None]:
    """Probabilities of those that were tested, corrected for their number."""
    tested = [k for k, one in enumerate(found) if one is not None]
    made: list[float | None] = [None] * len(found)
    p = np.array([one.p for one in found if one is not None])
    for k, value in zip(tested, multiple.holm(p), strict=True):
        made[k] = float(value)
    return made


def _fits(courses: Sequence[Course]) -> list[_Fit]:
    """All coefficients of the units of a group."""
    enough = [k for k, one in enumerate(courses) if one.y.size >= LEAST and np.ptp(one.t) > 0.0]
    varied = [k for k in enough if _temperature_varies(courses[k])]
    together = [k for k in varied if _told_apart(courses[k])]
    single = [k for k in enough if k not in varied]
    best = _coefficients({k: _line(courses[k], "tT" if k in together else "t") for k in (*together, *single)})
    time = _coefficients({k: _line(courses[k], "t") for k in varied})
    kelvin = _coefficients({k: _line(courses[k], "T") for k in varied})
    return [
        _Fit(
            _column(best.get(k), 1),
            _column(best.get(k), 2),
            _column(time.get(k), 1),
            _column(kelvin.get(k), 1),
            collinear=k in varied and k not in together,
        )
        for k in range(len(courses))
    ]


def _temperature_varies(course: Course) -> bool:
    return course.temperature is not None and float(np.ptp(course.temperature)) >= _LEAST_KELVIN


def _told_apart(course: Course) -> bool:
    """Whether time and temperature did not change as one."""
    assert course.temperature is not None
    return bool(np.corrcoef(course.t, course.temperature)[0, 1] ** 2 < 1.0 - _CLOSE)


_Scaled = tuple[Line, tuple[float, ...]]


def _line(course: Course, over: str) -> _Scaled:
    """A line whose columns are of like size, and what its coefficients are to be divided by."""
    every = [course.t if which == "t" else course.temperature for which in over]
    columns = [column - column.mean() for column in every if column is not None]
    scales = [float(np.ptp(column)) for column in columns]
    X = np.column_stack([np.ones(course.y.size), *(c / s for c, s in zip(columns, scales, strict=True))])
    return Line(course.y, course.variances, X), (1.0, *scales)


def _coefficients(lines: dict[int, _Scaled]) -> dict[int, tuple[Coefficient, ...] | None]:
    found = regression.coefficients([line for line, _ in lines.values()])
    return {
        k: None if one is None else tuple(map(_scaled, one, scales))
        for (k, (_, scales)), one in zip(lines.items(), found, strict=True)
    }


def _scaled(found: Coefficient, scale: float) -> Coefficient:
    e = found.estimate
    return Coefficient(Estimate(e.value / scale, e.sd / scale, e.low / scale, e.high / scale), found.p)


def _column(found: tuple[Coefficient, ...] | None, number: int) -> Coefficient | None:
    return found[number] if found is not None and number < len(found) else None
