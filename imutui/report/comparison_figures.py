"""Figures of results beside each other: biases with bands, differences, courses and Allan deviations overlaid."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from filters.channels import CHANNELS
from filters.tracing.trace_document import TraceDocument
from imutui.jobs.page_data import LogData
from imutui.report import allan_axes, axes
from imutui.report.axes import AFTER, BEFORE, INK, STYLES
from imutui.report.blocks import Figure, Panel
from imutui.report.residual_figures import SIDE_BY_SIDE, UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from imutui.jobs.documents import ResultDocument

_KEYS: dict[str, Literal["gyro_bias_dps", "accel_bias_mg"]] = {"g": "gyro_bias_dps", "a": "accel_bias_mg"}
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
        """Said beside each number of readings that are no unit's."""
        return "" if self.origin == "measured" else f"({self.origin})"


def of_replays(
    documents: "Sequence[ResultDocument]", names: Sequence[Compared], related: Sequence[bool]
) -> list[Figure]:
    """Biases, their differences to the first, and where logs are at hand their courses and Allan deviations.

    `documents`: two at least, in each of which a filter ran.
    `names`: one each.
    `related`: whether each is of the readings of the first: their difference has no standard deviation then.
    """
    who = _origins(names)
    seen = [[c for c in CHANNELS if None not in _bias(d, c)] for d in documents]
    differing = [c for c in seen[0] if any(c in own for own in seen[1:])]
    made = [
        _six(
            "compared-biases",
            f"Biases with three standard deviations ({who})",
            "Bars that do not overlap are of biases that differ.",
            partial(_values, documents=documents, names=names),
            [c for own in seen for c in own],
        ),
        _six(
            "compared-differences",
            f"Differences to {names[0].letter} with three standard deviations ({who})",
            "A bar that crosses zero is of a difference that may be chance." + (_NO_BAR if any(related[1:]) else ""),
            partial(_differences, documents=documents, names=names, related=related),
            differing,
        ),
    ]
    made = [figure for figure in made if figure.panels]
    drawn = [c for c in names if c.log.courses][:_MOST]
    if len(drawn) > 1:
        made.append(
            _six(
                "compared-convergence",
                f"Biases over time, overlaid ({who})",
                _OVERLAID,
                partial(_courses, names=drawn),
                [channel for own in seen for channel in own],
            )
        )
    drawn = [c for c in names if c.log.curves][:_MOST]
    if len(drawn) > 1:
        made.append(
            _six(
                "compared-allan",
                f"Allan deviation of the residuals, overlaid ({who})",
                _OVERLAID + " " + allan_axes.CAPTION,
                partial(_allans, names=drawn),
            )
        )
    return made


_NO_BAR = " One without a bar is of the same readings, so that no standard deviation is known."
_OVERLAID = f"Of results whose logs are at hand, {_MOST} at most."


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


def _values(ax: "Axes", channel: str, documents: "Sequence[ResultDocument]", names: Sequence[Compared]) -> None:
    for k, d in enumerate(documents):
        value, sd = _bias(d, channel)
        if value is not None and sd is not None:
            axes.whiskers(ax, float(k), value, [value - 3.0 * sd, value + 3.0 * sd], AFTER, "o")
    _results(ax, channel, names)


def _differences(
    ax: "Axes",
    channel: str,
    documents: "Sequence[ResultDocument]",
    names: Sequence[Compared],
    related: Sequence[bool],
) -> None:
    first, first_sd = _bias(documents[0], channel)
    for k, d in enumerate(documents[1:], 1):
        value, sd = _bias(d, channel)
        if None not in (first, first_sd, value, sd):
            made, half = float(np.subtract(value, first)), 3.0 * float(np.hypot(first_sd, sd))  # type: ignore[arg-type]
            bar = [None, None] if related[k] else [made - half, made + half]
            axes.whiskers(ax, float(k), made, bar, AFTER, "o")
    ax.axhline(0.0, color=INK, lw=0.6)
    _results(ax, channel, names)


def _bias(d: "ResultDocument", channel: str) -> tuple[float | None, float | None]:
    key, i = _KEYS[channel[0]], CHANNELS.index(channel) % 3
    return d["final"][key][i], d["sd"][key][i]


def _results(ax: "Axes", channel: str, names: Sequence[Compared]) -> None:
    axes.name(ax, "result", UNITS[channel[0]])
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


def _allans(ax: "Axes", channel: str, names: Sequence[Compared]) -> None:
    drawn, times = [], []
    for (color, stroke), name in zip(STYLES, names, strict=False):
        if channel not in name.log.curves:
            continue
        curve = name.log.curves[channel]["allan"]
        x, y = np.asarray(curve["x"], float), axes.column(curve["before"])
        ax.plot(x, y, color=color, ls=stroke, lw=1.1, label=name.letter)
        drawn.append(y)
        times.append(x)
    allan_axes.finish(ax, np.concatenate([*times, np.empty(0)]), UNITS[channel[0]], *drawn)


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
    axes.name(ax, "result", "error / floor")
    ax.set_xticks(range(len(names)), [c.letter for c in names])
    ax.set_xlim(-0.5, len(names) - 0.5)
