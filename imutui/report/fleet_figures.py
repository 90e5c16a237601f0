"""Figures of a fleet: units beside each other, and control charts."""

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from imutui.jobs.campaign import fleet_values
from imutui.jobs.campaign.summary_document import MONTH_DAYS, ChannelField, GroupField, PointField, UnitChannelField
from imutui.report import axes
from imutui.report.axes import AFTER, BEFORE, FLOOR, INK, SIDE_BY_SIDE
from imutui.report.blocks import Figure, Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_CHARTS = 12  # units whose charts are drawn; the others' points are in the document
_MOST_TICKS = 12
_SHORT_DAYS = 3.0


def units(group: GroupField) -> Figure | None:
    """Each unit's own value with its interval about the model's; None of one unit, or where no channel tells it."""
    panels = tuple(
        Panel(one["channel"], partial(_units, one=one, numbers=numbers(group)))
        for one in sorted(group["channels"], key=lambda one: SIDE_BY_SIDE.index(one["channel"]))
        if one["model"] and any(unit["value"] for unit in one["units"])
    )
    if not panels:
        return None
    return Figure(
        "units",
        "Units beside each other",
        "Points are the values that the unit's power-ons scatter about, bars their 95 % intervals. The line is the mean"
        " of the model, the grey band one standard deviation between units on each side. Numbers are those of the table"
        " of units.",
        panels,
    )


def charts(group: GroupField) -> list[Figure]:
    """A control chart a unit: those first of which there is something to tell, as many as fit a page."""
    names = [unit["serial_number"] for unit in group["units"] if unit["power_ons"] > 1]
    chosen = sorted(sorted(names, key=lambda serial: -_weight(group, serial))[:MOST_CHARTS])
    return [_chart(group, serial) for serial in chosen]


def numbers(group: GroupField) -> dict[str, int]:
    """Number of each unit, by its serial number."""
    return {unit["serial_number"]: n for n, unit in enumerate(group["units"], 1)}


def _weight(group: GroupField, serial: str) -> int:
    """How much there is to tell of a unit."""
    told = sum(3 for one in group["limits"] if one["serial_number"] == serial and one["verdict"] == "fails")
    for unit in _of_unit(group["channels"], serial):
        told += 2 * (unit["drift"]["verdict"] in ("drift", "drift_or_temperature", "temperature"))
        told += sum(point["outside"] for point in unit["points"])
    return told


def _of_unit(channels: Iterable[ChannelField], serial: str) -> list[UnitChannelField]:
    return [unit for one in channels for unit in one["units"] if unit["serial_number"] == serial]


def _units(ax: "Axes", one: ChannelField, numbers: dict[str, int]) -> None:
    model, between = one["model"], one["between_units"]
    if model and between:
        sd = between["sd"]
        ax.axhspan(model["value"] - sd, model["value"] + sd, color=FLOOR, alpha=0.25, lw=0)
    if model:
        ax.axhline(model["value"], color=INK, lw=0.8)
    for unit in one["units"]:
        if found := unit["value"]:
            at = numbers[unit["serial_number"]]
            axes.whiskers(ax, at, found["value"], (found["low"], found["high"]), AFTER, "o")
    axes.name(ax, "number of the unit", one["unit"])
    every = sorted(numbers.values())
    ax.set_xlim(every[0] - 0.6, every[-1] + 0.6)
    ax.set_xticks(every[:: -(-len(every) // _MOST_TICKS)])


def _chart(group: GroupField, serial: str) -> Figure:
    panels = tuple(
        Panel(one["channel"], partial(_points, unit=unit, name=one["unit"]))
        for one in sorted(group["channels"], key=lambda one: SIDE_BY_SIDE.index(one["channel"]))
        for unit in _of_unit([one], serial)
    )
    return Figure(
        f"chart-{numbers(group)[serial]}",
        f"Control chart of unit {serial}",
        "A point a power-on. The line is the mean of the unit's power-ons that are in control, dashed lines are limits"
        " at 3 σ, wider where few power-ons tell σ. Crosses are out of control.",
        panels,
    )


def _points(ax: "Axes", unit: UnitChannelField, name: str) -> None:
    points = unit["points"]
    x, label = _times(points)
    y, sd = (np.array([point[key] for point in points]) for key in ("value", "sd"))
    outside = np.array([point["outside"] for point in points])
    ax.errorbar(x[~outside], y[~outside], 1.96 * sd[~outside], color=AFTER, marker="o", ms=3.5, lw=1.0, ls="none")
    ax.plot(x[outside], y[outside], color=BEFORE, marker="x", ms=7, mew=1.8, ls="none")
    low, high = (axes.column([point[key] for point in points]) for key in ("low", "high"))
    for limit in (low, high):
        ax.plot(x, limit, color=FLOOR, lw=1.1, ls="--")
    if unit["centre"] is not None:
        ax.axhline(unit["centre"], color=INK, lw=0.7)
    room = 0.04 * float(np.ptp(x)) or 0.5
    ax.set_xlim(float(x.min()) - room, float(x.max()) + room)
    axes.name(ax, label, name)
    if label == _DATE:
        _dates(ax, x)


_DATE = "start of the power-on, UTC"


def _times(points: Sequence[PointField]) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], str]:
    """Days since 1970, or numbers where a time is not known."""
    months = [fleet_values.months(point["start_utc"]) for point in points]
    days = [month * MONTH_DAYS for month in months if month is not None]
    if len(days) < len(points):
        return np.arange(1.0, len(points) + 1.0), "number of the power-on"
    return np.array(days), _DATE


def _dates(ax: "Axes", x: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    """Three dates, or times of a day."""
    first, last = float(x.min()), float(x.max())
    span = last - first
    form = "%Y-%m-%d" if span > _SHORT_DAYS else "%m-%d %H:%M"
    # not at the ends, where a date would reach out of the picture
    ticks = first + span * np.array([0.1, 0.5, 0.9] if span else [0.0])
    ax.set_xticks(ticks, [datetime.fromtimestamp(tick * 86400.0, UTC).strftime(form) for tick in ticks])
