"""Figures of results beside each other: biases with bands, differences, courses and Allan deviations overlaid."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from filters.channels import CHANNELS
from filters.specification import ImuSpec
from filters.tracing.trace_document import TraceDocument
from imutui.estimates import biases, specification_of
from imutui.jobs.page_data import LogData
from imutui.report import axes
from imutui.report.axes import AFTER, BEFORE, INK, SIDE_BY_SIDE, STYLES, UNITS
from imutui.report.blocks import Figure, Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from imutui.jobs.documents import ResultDocument

_MOST = len(STYLES)


@dataclass(frozen=True, slots=True)
class Compared:
    """A result as comparisons call it."""

    letter: str  # A, B, … in the order of the page
    # unit, date, files, origin: what it is of; `origin` is "measured", "SIMULATED" or "origin not stated"
    unit: str
    date: str
    files: str
    origin: str
    log: LogData  # what its log adds

    @property
    def mark(self) -> str:
        """Its letter, with the origin of readings that are no unit's."""
        return self.letter if self.origin == "measured" else f"{self.letter} ({self.origin})"


Estimate: TypeAlias = tuple[float | None, float | None]
"""A value and its standard deviation; None where either is not known."""


def difference(a: Estimate, b: Estimate, *, related: bool) -> Estimate:
    """B minus a, and the standard deviation of that for independent estimates: none of `related` ones."""
    if a[0] is None or b[0] is None:
        return None, None
    return b[0] - a[0], None if related or a[1] is None or b[1] is None else math.hypot(a[1], b[1])


def of_replays(
    documents: "Sequence[ResultDocument]", names: Sequence[Compared], related: Sequence[bool]
) -> list[Figure]:
    """Biases, their differences to the first, and where logs are at hand their courses and Allan deviations.

    `documents`: two at least, in each of which a filter ran.
    `related`: whether each is of the readings of the first: their difference has no standard deviation then.
    """
    who = _origins(names)
    known = [{b.channel: (b.value, b.sd) for b in biases(d)} for d in documents]
    minus: list[dict[str, Estimate]] = [
        {c: difference(known[0][c], own[c], related=same) if own is not known[0] else (None, None) for c in own}
        for own, same in zip(known, related, strict=True)
    ]
    seen, differing = ([c for own in every for c in own if own[c][0] is not None] for every in (known, minus))
    no_bar = " One without a bar is of the same readings, so that no standard deviation is known."
    overlaid = f"Of results whose logs are at hand, {_MOST} at most."
    courses = [c for c in names if c.log.courses][:_MOST]
    curves = [c for c in names if c.log.curves][:_MOST]
    specs = [specification_of(d) for d in documents]
    made = [
        _six(
            "compared-biases",
            f"Biases with three standard deviations ({who})",
            "Bars that do not overlap are of biases that differ.",
            partial(_bars, estimates=known, names=names),
            seen,
        ),
        _six(
            "compared-differences",
            f"Differences to {names[0].letter} with three standard deviations ({who})",
            "A bar that crosses zero is of a difference that may be chance." + (no_bar if any(related[1:]) else ""),
            partial(_bars, estimates=minus, names=names, zero=True),
            differing,
        ),
        _six(
            "compared-convergence",
            f"Biases over time, overlaid ({who})",
            overlaid,
            partial(_courses, names=courses),
            seen if len(courses) > 1 else (),
        ),
        _six(
            "compared-allan",
            f"Allan deviation of the residuals, overlaid ({who})",
            f"{overlaid} {axes.white_noise_caption(specs)}",
            partial(_allans, names=curves, specs=specs),
            SIDE_BY_SIDE if len(curves) > 1 else (),
        ),
    ]
    return [figure for figure in made if figure.panels]


def of_traces(documents: Sequence[TraceDocument], names: Sequence[Compared]) -> list[Figure]:
    """Errors over their floor, before and after, of each channel."""
    if not any(e["metric"] == "e10" and e["after_x_floor"] for d in documents for e in d["error"]):
        return []
    who = _origins(names)
    return [
        _six(
            "compared-errors",
            f"Error of 10 s means over its floor ({who})",
            "Squares before, dots after what was found is taken into account; 1 is what white noise alone gives.",
            partial(_errors, documents=documents, names=names),
        )
    ]


def _origins(names: Sequence[Compared]) -> str:
    """Which results are of which origin: "A B measured; C SIMULATED"."""
    by = {origin: [c.letter for c in names if c.origin == origin] for origin in dict.fromkeys(c.origin for c in names)}
    return "; ".join(f"{' '.join(letters)} {origin}" for origin, letters in by.items())


def _six(
    name: str, title: str, caption: str, draw: Callable[..., None], channels: Sequence[str] = SIDE_BY_SIDE
) -> Figure:
    panels = tuple(Panel(channel, partial(draw, channel=channel)) for channel in SIDE_BY_SIDE if channel in channels)
    return Figure(name, title, caption, panels)


def _bars(
    ax: "Axes", channel: str, estimates: Sequence[dict[str, Estimate]], names: Sequence[Compared], *, zero: bool = False
) -> None:
    for k, own in enumerate(estimates):
        value, sd = own[channel]
        if value is not None:
            ends = (None, None) if sd is None else (value - 3.0 * sd, value + 3.0 * sd)
            axes.whiskers(ax, float(k), value, ends, AFTER, "o")
    if zero:
        ax.axhline(0.0, color=INK, lw=0.6)
    _results(ax, UNITS[channel[0]], names)


def _results(ax: "Axes", unit: str, names: Sequence[Compared]) -> None:
    axes.name(ax, "result", unit)
    ax.set_xticks(range(len(names)), [c.letter for c in names])
    ax.set_xlim(-0.5, len(names) - 0.5)


def _courses(ax: "Axes", channel: str, names: Sequence[Compared]) -> None:
    c = CHANNELS.index(channel)
    for style, name in zip(STYLES, names, strict=False):
        points = name.log.courses[0].points
        value, sd = axes.column([row[c] for row in points["bias"]]), axes.column([row[c] for row in points["sd"]])
        if np.isfinite(value).any():
            # the first tenth is the filter's own beginning, whose bands hide all else
            skip = value.size // 10
            axes.banded(ax, np.asarray(points["t"])[skip:], value[skip:], 3.0 * sd[skip:], style, name.letter)
    axes.name(ax, "s since the first sample", UNITS[channel[0]], legend=True)


def _allans(ax: "Axes", channel: str, names: Sequence[Compared], specs: Sequence[ImuSpec]) -> None:
    drawn, times = [], []
    for (color, stroke), name in zip(STYLES, names, strict=False):
        if channel not in name.log.curves:
            continue
        curve = name.log.curves[channel]["allan"]
        x, y = np.asarray(curve["x"], float), axes.column(curve["before"])
        ax.plot(x, y, color=color, ls=stroke, lw=1.1, label=name.letter)
        drawn.append(y)
        times.append(x)
    axes.allan(ax, np.concatenate([*times, np.empty(0)]), UNITS[channel[0]], specs, *drawn)


def _errors(ax: "Axes", channel: str, documents: Sequence[TraceDocument], names: Sequence[Compared]) -> None:
    seen = [1.0]
    for k, d in enumerate(documents):
        error = next((e for e in d["error"] if e["metric"] == "e10" and e["channel"] == channel), None)
        for value, color, marker in (
            (error and error["before_x_floor"], BEFORE, "s"),
            (error and error["after_x_floor"], AFTER, "o"),
        ):
            if value:
                ax.plot([k], [value], color=color, marker=marker, ms=4.5, ls="none")
                seen.append(value)
    ax.axhline(1.0, color=INK, lw=0.6)
    axes.logarithmic(ax, "y", np.array(seen))
    _results(ax, "error / floor", names)
