"""Rows of a campaign as a summary of the fleet: groups of one model and kind, what was left out and why."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

import imutui
from filters import specification
from filters.channels import CHANNELS, DPS, MG
from filters.fleet import components, readings
from imutui.document_shape import VERSION
from imutui.jobs.campaign import fleet_values, summary_channels
from imutui.jobs.campaign.fleet_values import BiasValue
from imutui.jobs.campaign.rows import FindingField, Row, told_apart
from imutui.jobs.campaign.summary_document import (
    EffectField,
    ErrorField,
    GroupField,
    Kind,
    Level,
    LimitField,
    LimitVerdict,
    ParameterField,
    Quantity,
    SummaryDocument,
    UnitField,
)
from imutui.jobs.quantities import that_many

_KINDS: tuple[Kind, ...] = ("measured", "simulated", "unknown")


def summary(rows: Sequence[Row], results: str) -> SummaryDocument:
    """Return the summary of a fleet; `rows` has at least one."""
    rows = told_apart(rows)
    good = [row for row in rows if row["error"] is None and row["final"] is not None]
    bad = [row for row in rows if row["error"] is not None or row["final"] is None]
    groups: dict[tuple[int, str], list[Row]] = {}
    for row in good:
        groups.setdefault((_KINDS.index(_kind(row)), row["instrument"]), []).append(row)
    return {
        "version": VERSION,
        "library": f"imutui {imutui.__version__}",
        "results": results,
        "rows": len(rows),
        "used": len(good),
        "errors": [_error(row, row["error"] or "no filter ran: its row has no result") for row in bad],
        "trace_errors": [_error(row, told) for row in good if (told := row["trace_error"])],
        "groups": [_group(groups[key]) for key in sorted(groups)],
    }


def _kind(row: Row) -> Kind:
    return next((kind for kind in _KINDS if row["kind"] == kind), "unknown")


def _error(row: Row, told: str) -> ErrorField:
    return {"log": row["log"], "error": told}


def _group(rows: Sequence[Row]) -> GroupField:
    known = [row for row in rows if row["serial_number"]]
    return {
        "kind": _kind(rows[0]),
        "instrument": rows[0]["instrument"],
        "logs": len(rows),
        "units": _units(known),
        "unknown_unit": [row["log"] for row in rows if not row["serial_number"]],
        "channels": summary_channels.channels(known) if known else [],
        "limits": _limits(rows),
        "effects": _effects(known),
        "traced_logs": len(_traced(known)),
        "notes": list(_notes(rows, known)),
    }


def _units(rows: Sequence[Row]) -> list[UnitField]:
    units: dict[str, list[Row]] = {}
    for row in rows:
        units.setdefault(row["serial_number"], []).append(row)
    made: list[UnitField] = []
    for serial in sorted(units):
        times = sorted(t for row in units[serial] if (t := row["start_utc"]))
        made.append(
            {
                "serial_number": serial,
                "logs": len(units[serial]),
                "power_ons": len({fleet_values.power_on(row) for row in units[serial]}),
                "first_utc": times[0] if times else None,
                "last_utc": times[-1] if times else None,
            }
        )
    return made


def _notes(rows: Sequence[Row], known: Sequence[Row]) -> Iterator[str]:
    """What keeps rows of a group from being alike, or out of it."""
    lost = len(rows) - len(known)
    if lost:
        yield (
            f"{that_many(lost, 'log', 'states', 'state')} no serial number. Which unit it is of is not known: no"
            " estimate has it, and it is held to the limits for itself."
        )
    alone = sum(not row["power_on"] for row in known)
    if alone:
        yield f"{that_many(alone, 'log', 'does', 'do')} not say of which power-on; each is taken for one of its own."
    if len({row["settings_sha256"] for row in rows}) > 1:
        yield "These rows were made with different settings, which may change biases: make them anew with one."
    references = sorted({told for row in known if (told := row["reference"])})
    if len(references) > 1:
        yield (
            f"References differ ({', '.join(references)}): what a bias holds beside the unit's own, such as the tilt of"
            " a table, differs with them."
        )
    if count := sum(not row["start_utc"] for row in known):
        yield f"{that_many(count, 'log', 'does', 'do')} not say when it was recorded: of such a unit no drift is told."


# ------------------------------------------------------------------------------------------------------------ effects
# Effects that traces found, over a group: in which units and power-ons, confirmed or not, and what they amount to.
#
# What was found only is averaged, so that sizes near what can be found come out too large; a log in which an effect was
# not found says nothing of its size here.


class _Found(NamedTuple):
    """An effect in a log."""

    row: Row
    finding: FindingField


_Key = tuple[str, tuple[str, ...]]
_PowerOn = tuple[str, str]


def _traced(rows: Sequence[Row]) -> list[Row]:
    """Rows of logs that were traced."""
    return [row for row in rows if row["findings"] is not None]


def _effects(rows: Sequence[Row]) -> list[EffectField]:
    """Return the effects of a group, by the number of units they were found in, then of power-ons."""
    asked = _traced(rows)
    found: dict[_Key, list[_Found]] = {}
    for row in asked:
        for finding in row["findings"] or []:
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


# ------------------------------------------------------------------------------------------------------------- limits
# Units beyond the limits of their specification: biases of each power-on, white noise over all logs.
#
# A bias is beyond a limit if it is so by three standard deviations, in any power-on: so much the paper's table allows
# on no day. Noise is the unit's, and a mean over its logs is compared.

SURE = 3.0  # standard deviations beyond a limit at which a value fails it; as many on the inner side are not told
_SQRT_HOUR = 60.0  # √s


class _Worst(NamedTuple):
    """What is compared: how far it is beyond the limit, in sd, and its value."""

    excess: float
    value: float
    sd: float
    row: Row
    converged: bool


def _limits(rows: Sequence[Row]) -> list[LimitField]:
    """Return units of a group that fail a limit or are too near to tell; a log without a serial number is a unit."""
    units: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        serial = row["serial_number"]
        units.setdefault((serial, "" if serial else row["log"]), []).append(row)
    found = [one for key in sorted(units) for one in limits_of(units[key])]
    return sorted(found, key=lambda one: one["verdict"] != "fails")


def limits_of(rows: Sequence[Row]) -> Iterator[LimitField]:
    """Yield what one unit fails, or is too near to tell; every row has a result.

    Nothing is judged of a unit whose data sheet is not known.
    """
    model = rows[0]["instrument"]
    if not specification.is_known(model):
        return
    spec = specification.of_model(model)
    limits = {"deg/s": spec.gyro_bias_limit / DPS, "mg": spec.accel_bias_limit / MG}
    for told in fleet_values.channels(rows):
        yield from _bias(told.channel, told.unit, limits[told.unit], told.values)
    noises = (spec.gyro_arw / DPS * _SQRT_HOUR, "deg/√h"), (spec.accel_vrw * _SQRT_HOUR, "m/s/√h")
    for number, channel in enumerate(CHANNELS):
        yield from _noise(channel, number, *noises[number // 3], rows)


def _bias(channel: str, unit: str, limit: float, values: Sequence[BiasValue]) -> Iterator[LimitField]:
    each = [_Worst((abs(v.value) - limit) / v.sd, v.value, v.sd, v.row, v.converged) for v in values]
    if not each:
        return
    beyond = [one for one in each if one.excess > SURE]
    # what has settled counts first: an estimate on its way may pass a limit
    worst = max(beyond or each, key=lambda one: (one.converged, one.excess))
    if not beyond:
        worst = max(each, key=lambda one: one.excess)
    if worst.excess <= -SURE:
        return
    fails = bool(beyond) and worst.converged
    above = len({fleet_values.power_on(one.row) for one in beyond})
    of = len({fleet_values.power_on(v.row) for v in values})
    yield _field(worst, channel, unit, limit, "bias", "fails" if fails else "not_told", above, of)


def _noise(channel: str, number: int, limit: float, unit: str, rows: Sequence[Row]) -> Iterator[LimitField]:
    """Mean of the noise over logs, each weighted by how well it is known as a share of itself."""
    known = [(value, sd, row) for row in rows if (told := _noise_of(row, number)) for value, sd in [told]]
    if not known:
        return
    total = sum(sd**-2 for _, sd, _ in known)
    mean = sum(value / sd**2 for value, sd, _ in known) / total
    worst = _Worst(
        (mean - limit) / (limit * total**-0.5), mean, mean * total**-0.5, max(known, key=lambda one: one[0])[2], True
    )
    if worst.excess <= -SURE:
        return
    above = len({fleet_values.power_on(row) for value, sd, row in known if value - limit > SURE * limit * sd})
    of = len({fleet_values.power_on(row) for *_, row in known})
    yield _field(worst, channel, unit, limit, "noise", "fails" if worst.excess > SURE else "not_told", above, of)


def _noise_of(row: Row, number: int) -> tuple[float, float] | None:
    """White noise of a channel, and its standard deviation as a share of it."""
    noise = row["noise"]
    if noise is None or not (relative := noise["relative_sd"]):
        return None
    value = (noise["gyro_arw_deg_sqrt_h"] if number < 3 else noise["accel_vrw_mps_sqrt_h"])[number % 3]
    return None if value is None else (value, relative)


def _field(
    worst: _Worst, channel: str, unit: str, limit: float, quantity: Quantity, verdict: LimitVerdict, above: int, of: int
) -> LimitField:
    return {
        "serial_number": worst.row["serial_number"],
        "channel": channel,
        "quantity": quantity,
        "verdict": verdict,
        "value": worst.value,
        "sd": worst.sd,
        "limit": limit,
        "unit": unit,
        "above": above,
        "of": of,
        "log": worst.row["log"],
        "start_utc": worst.row["start_utc"],
        "converged": worst.converged,
    }
