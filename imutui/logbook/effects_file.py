"""Effects that a trace found, as a file (TOML) that the filter takes in.

    version = 1
    source = "trace of a.mcap, b.mcap; held out c.mcap"
    correlation = [[1.0, 0.1], [0.1, 1.0]]     # of all states in order

    [[effect]]
    effect = "thermal_lin"
    channels = ["gy"]
    include_as = "A"                           # A constant states, S stochastic states, N noise, P pre-filter

    [effect.parameters]                        # what fixes its shape
    reference_degc = 25.0

    [[effect.state]]
    name = "k"
    unit = "deg/s/K"
    mean = 0.02
    sd = 0.001
    tau_s = inf
    q = 0.0                                    # unit/√s

Everything is in the instrument's own axes and sign: corrected reading = reading - effect.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from filters.effects.record import Included, State, Trace

VERSION = 1


def dumps(trace: Trace, source: str) -> str:
    """Text of an effects file; without effects too it is a valid one.

    Parameters
    ----------
    trace : Trace
        Its `included` and their `correlation`.
    source : str
        Where they come from, in words.
    """
    head = [f"version = {VERSION}", f"source = {_value(source)}", f"correlation = {_matrix(trace.correlation)}"]
    return "\n".join([*head, *(line for effect in trace.included for line in _effect(effect))]) + "\n"


def write(path: Path, text: str, *, overwrite: bool) -> None:
    """Write a text so that the file is there whole or not at all.

    Raises
    ------
    FileExistsError
        If it exists and may not be replaced.
    """
    if not overwrite:
        # an empty file of our own marks the name as taken
        path.open("x").close()
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        if not overwrite:
            path.unlink(missing_ok=True)
        raise


def _effect(effect: Included) -> list[str]:
    lines = ["", "[[effect]]", f"effect = {_value(effect.effect)}", f"channels = {_value(list(effect.channels))}"]
    lines.append(f"include_as = {_value(effect.include_as)}")
    given = {key: value for key, value in effect.parameters.items() if value is not None}
    if given:
        lines += ["", "[effect.parameters]"]
        lines += [f"{_key(key)} = {_value(value)}" for key, value in given.items()]
    for state in effect.states:
        lines += ["", "[[effect.state]]", *_state(state)]
    return lines


def _state(state: State) -> list[str]:
    fields = ("name", "unit", "mean", "sd", "tau_s", "q")
    return [f"{field} = {_value(getattr(state, field))}" for field in fields]


def _matrix(values: Any) -> str:
    rows = np.atleast_2d(np.asarray(values, np.float64)) if np.size(values) else np.empty((0, 0))
    if len(rows) < 2:
        return _value(rows.tolist())
    return "[\n" + "".join(f"    {_value(row)},\n" for row in rows.tolist()) + "]"


def _key(name: str) -> str:
    plain = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if plain else json.dumps(name, ensure_ascii=False)


def _value(value: Any) -> str:
    """A TOML value; None has none and is left out of lists' and tables' company by the caller."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else "nan" if math.isnan(value) else "inf" if value > 0 else "-inf"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items() if v is not None) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    raise TypeError(f"`value` is {value!r}, which TOML cannot hold")
