"""TOML documents for tests that need one and are not about its text."""

import json
from typing import Any

from imutui.logbook.reference_file import ReferenceFile

Entry = dict[str, Any]


def toml(**keys: Any) -> str:
    """A document, such as a scenario; a list of tables is [[table]]s at its end."""
    tables = {key: of for key, of in keys.items() if isinstance(of, list | tuple) and isinstance(of[0], dict)}
    head = _lines({key: of for key, of in keys.items() if key not in tables})
    return head + "".join(f"[[{key}]]\n{_lines(entry)}" for key, entries in tables.items() for entry in entries)


def _lines(table: Entry) -> str:
    return "".join(f"{key} = {_value(of)}\n" for key, of in table.items())


def _value(of: Any) -> str:
    if isinstance(of, dict):
        return f"{{ {', '.join(f'{key} = {_value(inside)}' for key, inside in of.items())} }}"
    if isinstance(of, list | tuple):
        return f"[{', '.join(map(_value, of))}]"
    return repr(of) if isinstance(of, float) else json.dumps(of)


def profile_toml(*segments: Entry, **head: Any) -> str:
    return toml(**head, segment=segments)


def profile_file(*segments: Entry, **head: Any) -> ReferenceFile:
    """A profile as it travels in a log."""
    return ReferenceFile("profile", "reference.toml", "application/toml", profile_toml(*segments, **head).encode())


def dwell(seconds: float, outer: float = 0.0, middle: float = 0.0, inner: float = 0.0) -> Entry:
    return {"kind": "dwell", "angles_deg": [outer, middle, inner], "seconds": seconds}


def rate(axis: str, dps: float, seconds: float) -> Entry:
    return {"kind": "rate", "axis": axis, "rate_dps": dps, "seconds": seconds}


def sine(axis: str, amplitude_deg: float, hz: float, seconds: float) -> Entry:
    return {"kind": "sine", "axis": axis, "amplitude_deg": amplitude_deg, "hz": hz, "seconds": seconds}


def effects_toml(*effects: Entry, **head: Any) -> str:
    return toml(version=1, **head, effect=effects)


def effect(name: str, channel: str, *states: Entry, include_as: str = "A", **parameters: Any) -> Entry:
    entry = {"effect": name, "channels": [channel], "include_as": include_as}
    return {**entry, "parameters": parameters, "state": states}


def state(name: str, unit: str, mean: float, sd: float, **more: float) -> Entry:
    return {"name": name, "unit": unit, "mean": mean, "sd": sd, **more}
