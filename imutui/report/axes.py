"""Axes that can be read: ticks with numbers on every axis, however short its range, and a few ways to draw on them."""

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from filters.channels import CHANNELS, DPS, MG
from filters.specification import NOT_KNOWN, ImuSpec
from filters.types import Array
from imutui.plain_text import in_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BEFORE, AFTER, FLOOR, INK = "#d95f02", "#1b4f9c", "#888888", "#1c1c1c"
"""Colours of files, told apart by lightness too, for a grey print; a page has its own for light and dark."""
STYLES = (
    (AFTER, "-"), (BEFORE, "--"), (INK, ":"), (FLOOR, "-."), (BEFORE, "-"), (AFTER, "--"), (FLOOR, "-"), (INK, "-."),
)  # fmt: skip
"""Colour and stroke of several curves in one pair of axes, told apart without colours too."""
UNITS = {"g": "deg/s", "a": "mg"}  # of channels, by their first letter
SIDE_BY_SIDE = tuple(CHANNELS[k // 2 + 3 * (k % 2)] for k in range(6))  # gyros on the left, accelerometers on the right
_MOST_TICKS = 7
_ROOM = 0.05
_NEAR = 1.0 + 1e-9
_STEPS = (1.0, 2.0, 5.0)


def log_ticks(low: float, high: float) -> list[float]:
    """Where a logarithmic axis has numbers: decades, or 1-2-5 where that leaves few; two of them at least.

    They lie in the range, but for the one below or above that it takes to have two.
    """
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    decades = [10.0**k for k in range(first, last + 1) if low <= 10.0**k * _NEAR and 10.0**k <= high * _NEAR]
    fine = [float(f"{step * 10.0**k:.3g}") for k in range(first - 1, last + 2) for step in _STEPS]
    inside = [x for x in fine if low <= x * _NEAR and x <= high * _NEAR]
    if len(inside) > _MOST_TICKS:
        return decades[:: math.ceil(len(decades) / _MOST_TICKS)]
    if len(inside) < 2:
        inside = [max(x for x in fine if x * _NEAR < (inside or [low])[0]), *inside]
    if len(inside) < 2:
        inside.append(min(x for x in fine if x > high))
    return inside


def number_text(value: float) -> str:
    """A number of a tick as a document has it: 0.001, 20, 1e-05."""
    return f"{value:g}"


def logarithmic(ax: "Axes", which: str, *values: Array) -> None:
    """Make an axis logarithmic over the positive ones of some values, with numbers that can be read.

    `which`: "x" or "y".
    """
    every = np.concatenate([np.ravel(np.asarray(v, float)) for v in values])
    positive = every[np.isfinite(every) & (every > 0.0)]
    if not positive.size:
        return
    low, high = float(positive.min()), float(positive.max())
    ticks = log_ticks(low, high)
    set_scale, set_ticks, set_limits = (
        (ax.set_xscale, ax.set_xticks, ax.set_xlim) if which == "x" else (ax.set_yscale, ax.set_yticks, ax.set_ylim)
    )
    set_scale("log")
    set_ticks(ticks, [number_text(tick) for tick in ticks])
    (ax.xaxis if which == "x" else ax.yaxis).set_minor_formatter("")
    room = max(1.05, (high / low) ** _ROOM)
    set_limits(min(low / room, ticks[0]), max(high * room, ticks[-1]))


def name(ax: "Axes", x: str, y: str, *, legend: bool = False) -> None:
    """Name both axes, with a faint grid."""
    ax.set_xlabel(plain(x))
    ax.set_ylabel(plain(y))
    ax.grid(visible=True, lw=0.3, color=FLOOR, alpha=0.6)
    ax.set_axisbelow(True)
    if legend and ax.get_legend_handles_labels()[0]:
        # above the axes: inside them it would lie on a curve
        ax.legend(
            frameon=False, fontsize="small", loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=4, borderpad=0.1
        )


def before_and_after(ax: "Axes", x: Sequence[float], before: Array, after: Array | None) -> None:
    """Two curves; if they are the same, one of them, which says so; where there was no correction, the first."""
    if after is None:
        ax.plot(x, before, color=AFTER, lw=1.0, label="this log")
        return
    if np.allclose(before, after, rtol=1e-6, atol=0.0, equal_nan=True):
        ax.plot(x, before, color=AFTER, lw=1.1, label="before = after")
        return
    ax.plot(x, before, color=BEFORE, lw=1.3, label="before")
    ax.plot(x, after, color=AFTER, lw=0.9, label="after")


def white_noise_caption(specs: Iterable[ImuSpec]) -> str:
    """Return what the grey lines of `allan` are."""
    each = dict.fromkeys(
        f"{spec.gyro_arw / DPS * 60.0:g} deg/√h of a gyro and {spec.accel_vrw * 60.0:g} m/s/√h of an accelerometer"
        f" ({spec.source})"
        for spec in specs
        if spec != NOT_KNOWN
    )
    if not each:
        return "The white noise that this unit should have is not known."
    return f"The grey line is white noise of the specification, {'; '.join(each)}."


def allan(ax: "Axes", tau: Array, unit: str, specs: Iterable[ImuSpec], *curves: Array) -> None:
    """Name the axes of Allan deviations, N/√τ being the white noise of each unit's specification.

    `tau`: averaging times of all curves, s.
    `unit`: "deg/s" or "mg".
    `*curves`: all that is drawn.
    """
    if tau.size:
        ends = np.array([tau.min(), tau.max()])
        known = [spec for spec in specs if spec != NOT_KNOWN]
        levels = {spec.gyro_arw / DPS if unit == "deg/s" else spec.accel_vrw / MG for spec in known}
        lines = [level / np.sqrt(ends) for level in sorted(levels)]
        for white in lines:
            ax.plot(ends, white, color=FLOOR, lw=1.0, label="specification")
        logarithmic(ax, "x", tau)
        logarithmic(ax, "y", *lines, *curves)
    name(ax, "averaging time, s", unit, legend=True)


def whiskers(ax: "Axes", at: float, value: float, interval: Sequence[float | None], color: str, marker: str) -> None:
    """A value with its interval, across an axis of channels."""
    low, high = interval
    if low is not None and high is not None:
        ax.plot([at, at], [low, high], color=color, lw=1.4)
    ax.plot([at], [value], color=color, marker=marker, ms=4.5, ls="none")


def banded(ax: "Axes", t: Array, value: Array, half: Array, style: tuple[str, str], label: str) -> None:
    """A curve with a band of half a width on each side."""
    color, stroke = style
    ax.fill_between(t, value - half, value + half, color=color, alpha=0.18, lw=0)
    ax.plot(t, value, color=color, ls=stroke, lw=1.1, label=plain(label))


def column(values: Sequence[float | None]) -> Array:
    """Numbers of a document; NaN where there is none."""
    return np.array([np.nan if value is None else value for value in values], float)


def plain(text: str) -> str:
    """A label with text from outside: no control characters, and no formula between dollar signs."""
    return in_line(text).replace("$", r"\$")
