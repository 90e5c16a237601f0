"""Figures of a filter over a log: biases as they converge (the paper's Figures 3 and 4), their sd, NIS."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from filters.channels import CHANNELS
from filters.kalman.consistency import nis_band
from filters.types import Array
from imutui.jobs.page_data import Course
from imutui.report import axes
from imutui.report.axes import AFTER, FLOOR, INK, STYLES
from imutui.report.blocks import Figure, Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_KINDS = (("accelerometers", "mg", slice(3, 6)), ("gyros", "deg/s", slice(0, 3)))
_QUICK_HZ = 50.0


def biases(course: Course, rate_hz: float | None, name: str) -> Figure:
    """Biases of accelerometers and gyros over time, and their standard deviations."""
    which = "Figure 4 (133 Hz)" if rate_hz is not None and rate_hz > _QUICK_HZ else "Figure 3 (20 Hz)"
    at = "" if rate_hz is None else f" at {rate_hz:.4g} Hz"
    seen = np.asarray(np.isfinite(_table(course, "bias")).any(axis=0))
    kinds = [kind for kind in _KINDS if seen[kind[2]].any()]
    panels = [
        Panel(f"{what} of {kind}", partial(draw, course=course, part=part, unit=unit))
        for what, draw in (("biases", _biases), ("3 sd", _deviations))
        for kind, unit, part in kinds
    ]
    said = f", {course.name}" if course.name else ""
    return Figure(
        name,
        f"Biases of accelerometers and gyros{at}{said}: the paper's {which} for this log",
        "Estimates with a band of three standard deviations, and below them the three standard deviations alone: how"
        " fast the biases converge, and how far. An estimate that goes on moving outside its band follows something"
        " that is not in the model.",
        tuple(panels),
    )


def _table(course: Course, key: str) -> Array:
    rows = course.points["bias"] if key == "bias" else course.points["sd"]
    return np.array([[np.nan if v is None else v for v in row] for row in rows], float).reshape(-1, len(CHANNELS))


def _biases(ax: "Axes", course: Course, part: slice, unit: str) -> None:
    t, value, half = (
        np.asarray(course.points["t"]),
        _table(course, "bias")[:, part],
        3.0 * _table(course, "sd")[:, part],
    )
    for k, axis in enumerate("xyz"):
        if np.isfinite(value[:, k]).any():
            axes.banded(ax, t, value[:, k], half[:, k], STYLES[k], axis)
    limit = _room(value, half)
    if limit is not None:
        ax.set_ylim(*limit)
    axes.name(ax, "s since the first sample", unit, legend=True)


def _room(value: Array, half: Array) -> tuple[float, float] | None:
    """Limits that show all estimates, and the bands from where they are no longer those of the beginning."""
    known = np.isfinite(value) & np.isfinite(half)
    if not known.any():
        return None
    late = known.copy()
    late[: len(value) // 10] = False
    band = late if late.any() else known
    low = min(float(value[known].min()), float((value - half)[band].min()))
    high = max(float(value[known].max()), float((value + half)[band].max()))
    room = 0.05 * (high - low) or 1.0
    return low - room, high + room


def _deviations(ax: "Axes", course: Course, part: slice, unit: str) -> None:
    t, half = np.asarray(course.points["t"]), 3.0 * _table(course, "sd")[:, part]
    use = t > 0.0
    for k, axis in enumerate("xyz"):
        if np.isfinite(half[:, k]).any():
            color, stroke = STYLES[k]
            ax.plot(t[use], half[use, k], color=color, ls=stroke, lw=1.1, label=axis)
    axes.logarithmic(ax, "x", t[use])
    axes.logarithmic(ax, "y", half[use])
    axes.name(ax, "s since the first sample", unit, legend=True)


def nis(courses: Sequence[Course], name: str) -> Figure | None:
    """NIS over its degrees of freedom over time; None where there was no update."""
    known = [course for course in courses if any(v is not None for v in course.points["nis"])]
    if not known:
        return None
    why = (
        "Measurements were drawn with their covariance, so that this is a test: one dot in twenty lies outside the"
        " band."
        if known[0].is_test
        else "The reference is fed exact, so that this is no test: a good filter stays far below 1. Dots that climb"
        " towards the band or above it say that the readings do more than the model allows for."
    )
    panels = tuple(Panel(course.name or "NIS / degrees of freedom", partial(_nis, course=course)) for course in known)
    return Figure(
        name,
        "Normalised innovation squared of single updates",
        "Over its degrees of freedom; the grey band holds 95 % of the updates of a filter whose measurements have the"
        " noise that it believes. " + why,
        panels,
    )


def _nis(ax: "Axes", course: Course) -> None:
    t, dof = np.asarray(course.points["t"]), np.asarray(course.points["dof"], float)
    value = axes.column(course.points["nis"])
    use = np.isfinite(value) & (dof > 0.0) & (value > 0.0)
    t, ratio = t[use], value[use] / dof[use]
    middle = float(np.median(dof[use]))
    low, high = (end / middle for end in nis_band(middle, 1))
    ax.axhspan(low, high, color=FLOOR, alpha=0.3, lw=0)
    ax.axhline(1.0, color=INK, lw=0.6)
    ax.plot(t, ratio, color=AFTER, ls="none", marker=".", ms=2.5)
    axes.logarithmic(ax, "y", ratio, np.array([low, high]))
    axes.name(ax, "s since the first sample", "NIS / degrees of freedom")
