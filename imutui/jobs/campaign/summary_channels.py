"""Biases of a group, channel by channel: model, unit and day, drift, control chart."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from filters.fleet import components, control_chart, drift, readings
from filters.fleet.drift import Course, Drift
from filters.fleet.readings import PowerOns
from imutui.jobs.campaign import fleet_values
from imutui.jobs.campaign.fleet_values import BiasValue, ChannelValues
from imutui.jobs.campaign.rows import Row
from imutui.jobs.campaign.summary_document import ChannelField, DriftField, PointField, UnitChannelField
from imutui.jobs.quantities import plural


@dataclass(frozen=True, slots=True)
class _Prepared:
    """Values of a channel, one a power-on; the logs of each in order of time; None of both without any value."""

    told: ChannelValues
    data: PowerOns | None
    logs: list[list[BiasValue]]


def channels(rows: Sequence[Row]) -> list[ChannelField]:
    """Return all six channels of a group; drift is corrected for the number of units and channels."""
    prepared = [_prepared(told) for told in fleet_values.channels(rows)]
    courses = [_courses(one) for one in prepared]
    timed = [[course for course in group if course is not None] for group in courses]
    found = drift.drifts(timed)
    made = []
    for one, group, drifts in zip(prepared, courses, found, strict=True):
        rest = iter(drifts)
        made.append(_channel(one, [None if course is None else next(rest) for course in group]))
    return made


def _prepared(told: ChannelValues) -> _Prepared:
    if not told.values:
        return _Prepared(told, None, [])
    keys = [(one.row["serial_number"], fleet_values.power_on(one.row)) for one in told.values]
    values, sds = (np.array([getattr(one, name) for one in told.values]) for name in ("value", "own_sd"))
    data = readings.power_ons(values, sds, [unit for unit, _ in keys], [name for _, name in keys])
    logs: dict[tuple[str, str], list[BiasValue]] = {}
    for key, one in zip(keys, told.values, strict=True):
        logs.setdefault(key, []).append(one)
    order = zip((data.units[k] for k in data.unit_of()), data.names, strict=True)
    for own in logs.values():
        own.sort(key=lambda one: (one.row["start_utc"] or "", one.row["log"]))
    return _Prepared(told, data, [logs[key] for key in order])


def _temperature(logs: Sequence[BiasValue]) -> float | None:
    found = [one.row["temperature_degc"] for one in logs]
    known = [field["mean"] for field in found if field is not None]
    return float(np.mean(known)) if len(known) == len(logs) else None


def _courses(one: _Prepared) -> list[Course | None]:
    """Course of each unit over months; None where a power-on has no time."""
    if one.data is None:
        return []
    made: list[Course | None] = []
    for number in range(len(one.data.units)):
        part = one.data.of_unit(number)
        times = [fleet_values.months(logs[0].row["start_utc"]) for logs in one.logs[part]]
        known = [t for t in times if t is not None]
        warm = [_temperature(logs) for logs in one.logs[part]]
        told = [t for t in warm if t is not None]
        if len(known) < len(times):
            made.append(None)
            continue
        temperature = np.array(told) if len(told) == len(warm) else None
        made.append(Course(one.data.values[part], one.data.variances[part], np.array(known), temperature))
    return made


def _channel(one: _Prepared, drifts: Sequence[Drift | None]) -> ChannelField:
    told, data = one.told, one.data
    fleet = None if data is None else components.estimate(data)
    chart = None if data is None else control_chart.chart(data)
    return {
        "channel": told.channel,
        "unit": told.unit,
        "logs": len(told.values),
        "unobservable": told.unobservable,
        "unmeasured": told.unmeasured,
        "unconverged": sum(not value.converged for value in told.values),
        **fleet_values.parts(fleet),
        "undetermined": [*(_undetermined(fleet, data) if fleet and data else []), *_of_site(told)],
        "repeat": fleet_values.field(data.repeat if data else None),
        "chart_power_on_sd": chart.power_on_sd if chart else None,
        "chart_dof": chart.dof if chart else None,
        "units": _units(one, data, fleet, chart, drifts) if fleet and data else [],
    }


def _units(
    one: _Prepared,
    data: PowerOns,
    fleet: components.Fleet,
    chart: control_chart.Chart | None,
    drifts: Sequence[Drift | None],
) -> list[UnitChannelField]:
    points = [_point(one, data, fleet, chart, k) for k in range(data.values.size)]
    made: list[UnitChannelField] = []
    for number, unit in enumerate(fleet.units):
        part = data.of_unit(number)
        made.append(
            {
                "serial_number": unit.name,
                "power_ons": unit.power_ons,
                "value": fleet_values.field(unit.value),
                "own": fleet_values.field(unit.own),
                "drift": _drift(drifts[number]),
                "centre": _known(chart.centres[part.start]) if chart else None,
                "points": sorted(points[part], key=lambda p: (p["start_utc"] or "", p["log"])),
            }
        )
    return made


def _point(
    one: _Prepared, data: PowerOns, fleet: components.Fleet, chart: control_chart.Chart | None, k: int
) -> PointField:
    logs = one.logs[k]
    return {
        "power_on": data.names[k],
        "log": logs[0].row["log"],
        "logs": len(logs),
        "start_utc": logs[0].row["start_utc"],
        "temperature_degc": _temperature(logs),
        "converged": all(value.converged for value in logs),
        "value": float(data.values[k]),
        "sd": float(np.sqrt(data.variances[k])),
        "low": _known(chart.low[k]) if chart else None,
        "high": _known(chart.high[k]) if chart else None,
        "outside": bool(chart.outside[k]) if chart else False,
        "day": fleet_values.field(fleet.days[k] if fleet.days else None),
    }


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _drift(found: Drift | None) -> DriftField:
    told = found or Drift("too_few")
    return {
        "verdict": found.verdict if found else "no_times",
        "per_month": fleet_values.field(told.slope),
        "p": told.p,
        "p_holm": told.p_holm,
        "per_kelvin": fleet_values.field(told.per_kelvin),
        "per_month_alone": fleet_values.field(told.alone),
    }


def _of_site(told: ChannelValues) -> list[str]:
    """What an unstated site leaves open: statistics compare logs, and assume that they come from one place."""
    unstated = [one.site_sd for one in told.values if one.site_sd > 0.0]
    if not unstated:
        return []
    return [
        f"The site of {plural(len(unstated), 'log')} is not stated: the level of {told.channel}, of model and units,"
        f" is uncertain by another ±{3.0 * max(unstated):.2g} mg (3 sd). Differences hold for logs of one place."
        " Import or record with --site."
    ]


def _undetermined(fleet: components.Fleet, data: PowerOns) -> list[str]:
    """What these units and power-ons do not tell apart, and what would."""
    one_unit = fleet.model is None
    told = []
    if one_unit:
        told.append(
            f"Only unit {data.units[0]}: its own part is not told apart from the model's. A second unit would do it."
        )
    if fleet.between_power_ons is None:
        whose = "This unit was" if one_unit else "Each unit was"
        told.append(
            f"{whose} switched on once only: the day's part is not told apart from the unit's. A second power-on of any"
            " unit would do it."
        )
    return told
