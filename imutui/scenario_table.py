"""The table under command of a scenario, and its faults; what their keys mean is in `imutui.scenario`."""

import math
from collections.abc import Mapping
from typing import Any

from filters.errors import InputError
from filters.simulation import TABLE_FAULT_KINDS, TableFault, TableModel
from imutui.toml_text import Document, Table, is_number, tables_of

_DPS = math.pi / 180.0
_ARC_MINUTE = _DPS / 60.0
_TABLE = {
    "rate_dps": ("rate", _DPS),
    "accel_dps2": ("accel", _DPS),
    "jerk_dps3": ("jerk", _DPS),
    "lag_s": ("lag", 1.0),
    "encoder_noise_deg": ("encoder_noise", _DPS),
    "rate_noise_dps": ("rate_noise", _DPS),
    "encoder_offset_sd_deg": ("encoder_offset_sd", _DPS),
    "orthogonality_sd_arcmin": ("orthogonality_sd", _ARC_MINUTE),
    "wobble_sd_arcmin": ("wobble_sd", _ARC_MINUTE),
}


def model_of(document: Document) -> TableModel:
    """The table of a scenario's [table]; the usual one where there is none. Raises InputError."""
    table = Table.inside(document, "table", ("axes", "seed", "stops_deg", *_TABLE))
    values = document.get("table", {})
    fields: dict[str, Any] = {
        field: table.number(key, least=0.0) * unit for key, (field, unit) in _TABLE.items() if key in table
    }
    if "seed" in table:
        fields["seed"] = table.whole("seed", 0)
    if "axes" in table:
        axes = values["axes"]
        if not isinstance(axes, list) or not all(isinstance(axis, str) for axis in axes):
            raise table.wrong("axes", 'not names such as ["middle", "inner"]')
        fields["axes"] = tuple(axes)
    if "stops_deg" in table:
        stops = values["stops_deg"]
        if not isinstance(stops, list) or len(stops) != 2 or not all(is_number(stop) for stop in stops):
            raise table.wrong("stops_deg", "not two angles, such as [-110.0, 110.0]")
        fields["low"], fields["high"] = (stop * _DPS for stop in stops)
    try:
        return TableModel(**fields)
    except InputError as error:
        raise InputError(f"[table]: {error}") from error


def faults_of(document: Document) -> tuple[TableFault, ...]:
    """What goes wrong with it, as [[table_fault]] has it. Raises InputError."""
    tables = enumerate(tables_of(document, "table_fault"), 1)
    return tuple(_fault(values, f"table_fault {n}") for n, values in tables)


def _fault(values: Mapping[str, Any], which: str) -> TableFault:
    kind = values.get("kind")
    if not isinstance(kind, str) or kind not in TABLE_FAULT_KINDS:
        raise InputError(f"{which}: `kind` is {kind!r}, not one of: {', '.join(TABLE_FAULT_KINDS)}")
    keys = {"axis": "axis", "seconds": "seconds", "delay": "delay_s", "count": "count"}
    of_kind = [keys[each] for each in TABLE_FAULT_KINDS[kind]]
    table = Table(values, ("at_s", "kind", *of_kind), f"{which}: {kind}", where=f"{which}: ")
    fields: dict[str, Any] = {"at": table.number("at_s", least=0.0), "kind": kind}
    if "axis" in table:
        fields["axis"] = table.text("axis", None)
    if "count" in table:
        fields["count"] = table.whole("count", 1)
    fields |= {
        field: table.number(key, least=0.0)
        for field, key in keys.items()
        if field in ("seconds", "delay") and key in table
    }
    try:
        return TableFault(**fields)
    except InputError as error:
        raise InputError(f"{which}: {error}") from error
