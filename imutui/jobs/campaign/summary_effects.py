"""Effects that traces found, over a group: in which units and power-ons, confirmed or not, and what they amount to.

What was found only is averaged, so that sizes near what can be found come out too large; a log in which an effect was
not found says nothing of its size here.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from filters.fleet import components, readings
from imutui.jobs.campaign import fleet_values
from imutui.jobs.campaign.rows import FindingField, Row
from imutui.jobs.campaign.summary_document import EffectField, Level, ParameterField


class _Found(NamedTuple):
    """An effect in a log."""

    row: Row
    finding: FindingField


_Key = tuple[str, tuple[str, ...]]
_PowerOn = tuple[str, str]


def traced(rows: Sequence[Row]) -> list[Row]:
    """Rows of logs that were traced."""
    return [row for row in rows if row.get("findings") is not None]


def effects(rows: Sequence[Row]) -> list[EffectField]:
    """Effects by the number of units they were found in, then of power-ons.

    `rows`: of one group, with a result and a serial number.
    """
    asked = traced(rows)
    found: dict[_Key, list[_Found]] = {}
    for row in asked:
        for finding in row.get("findings") or []:
            found.setdefault((finding["effect"], tuple(finding["channels"])), []).append(_Found(row, finding))
    made = [_effect(key, found[key], asked) for key in sorted(found)]
    return sorted(made, key=lambda one: (-len(one["units"]), -one["power_ons"]))


def _effect(key: _Key, found: Sequence[_Found], asked: Sequence[Row]) -> EffectField:
    where = {_power_on(one.row) for one in found}
    every = {_power_on(row) for row in asked}
    judged = [one.finding["confirmed"] for one in found]
    units = sorted({unit for unit, _ in where})
    return {
        "effect": key[0],
        "label": found[0].finding["label"],
        "channels": list(key[1]),
        "units": units,
        "units_traced": len({unit for unit, _ in every}),
        "power_ons": len(where),
        "power_ons_traced": len(every),
        "logs": len(found),
        "confirmed": sum(one is True for one in judged),
        "unconfirmed": sum(one is False for one in judged),
        "unjudged": sum(one is None for one in judged),
        "level": _level(where, every),
        "params": _parameters(found),
    }


def _power_on(row: Row) -> _PowerOn:
    return row["serial_number"], fleet_values.power_on(row)


def _level(where: set[_PowerOn], every: set[_PowerOn]) -> Level:
    """Where an effect belongs by where it was found.

    An effect of the model is in half of its units or more. One of a unit alone is the day's if it was found in less
    than half of the unit's power-ons. One unit, or one power-on of the unit in question, does not tell.
    """
    units, asked = {unit for unit, _ in where}, {unit for unit, _ in every}
    if len(units) > 1:
        return "model" if 2 * len(units) >= len(asked) else "some_units"
    days = sum(unit in units for unit, _ in every)
    if days == 1:
        return "not_told"
    if 2 * len(where) < days:
        return "day"
    return "unit" if len(asked) > 1 else "not_told"


def _parameters(found: Sequence[_Found]) -> list[ParameterField]:
    """Parameters with their parts, in the order of the effect's own; those that were not fitted are left out."""
    values: dict[tuple[str, str], list[tuple[float, float, _PowerOn]]] = {}
    for one in found:
        for parameter in one.finding["params"]:
            sd = parameter["sd"]
            if sd is not None and sd > 0.0:
                key = parameter["name"], parameter["unit"]
                values.setdefault(key, []).append((parameter["value"], sd, _power_on(one.row)))
    return [_parameter(name, unit, every) for (name, unit), every in values.items()]


def _parameter(name: str, unit: str, every: Sequence[tuple[float, float, _PowerOn]]) -> ParameterField:
    numbers = np.array([[value, sd] for value, sd, _ in every])
    keys = [key for *_, key in every]
    data = readings.power_ons(numbers[:, 0], numbers[:, 1], [key[0] for key in keys], [key[1] for key in keys])
    fleet = components.estimate(data)
    return {
        "name": name,
        "unit": unit,
        "values": len(every),
        **fleet_values.parts(fleet),
        "units": [
            {"serial_number": one.name, "value": fleet_values.field(one.value), "own": fleet_values.field(one.own)}
            for one in fleet.units
        ],
    }
