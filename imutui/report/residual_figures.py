"""Residual and Allan deviation of one log that was filtered, by channel."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from filters.channels import CHANNELS
from filters.tracing.trace_document import ChannelCurvesEntry, CurveEntry
from imutui.report import allan_axes, axes
from imutui.report.axes import AFTER
from imutui.report.blocks import Figure, Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

UNITS = {"g": "deg/s", "a": "mg"}
SIDE_BY_SIDE = tuple(CHANNELS[k // 2 + 3 * (k % 2)] for k in range(6))
"""Gyros on the left, accelerometers on the right."""


def figures(curves: Mapping[str, ChannelCurvesEntry]) -> list[Figure]:
    """Residual over time and Allan deviation; none without curves.

    `curves`: by channel.
    """
    if not curves:
        return []
    return [
        Figure(
            "residual",
            "Residual",
            "Reading minus what a perfect unit would read, without its mean (the bias), as means over cells. A flat"
            " line is white noise; `imutui trace` looks for the cause of any other.",
            _panels(curves, _residual),
        ),
        Figure(
            "allan",
            "Allan deviation of the residual",
            "A straight line that halves when the averaging time quadruples is white noise; where it bends up,"
            " something else moves the channel. " + allan_axes.CAPTION,
            _panels(curves, _allan),
        ),
    ]


def _panels(curves: Mapping[str, ChannelCurvesEntry], draw: Callable[..., None]) -> tuple[Panel, ...]:
    return tuple(
        Panel(name, partial(draw, curves=curves[name], unit=UNITS[name[0]]))
        for name in SIDE_BY_SIDE
        if name in curves and curves[name]["residual"]["x"]
    )


def _residual(ax: "Axes", curves: ChannelCurvesEntry, unit: str) -> None:
    _draw(ax, curves["residual"])
    axes.name(ax, "s since the first sample", unit)


def _allan(ax: "Axes", curves: ChannelCurvesEntry, unit: str) -> None:
    curve = curves["allan"]
    _draw(ax, curve, "this log")
    allan_axes.finish(ax, np.asarray(curve["x"], float), unit, axes.column(curve["before"]))


def _draw(ax: "Axes", curve: CurveEntry, label: str | None = None) -> None:
    ax.plot(curve["x"], axes.column(curve["before"]), color=AFTER, lw=1.0, label=label)
