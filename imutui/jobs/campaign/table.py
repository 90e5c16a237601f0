"""`results.parquet`: the rows of a campaign as a flat table, a column for each number.

Names are those of the row, joined by "_": `final_gyro_bias_dps_x`. Lists of words are one text, separated by "; ";
findings of a trace are JSON.
"""

import itertools
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, NotRequired, get_args, get_origin, get_type_hints, is_typeddict

from imutui.jobs.campaign.rows import Row
from imutui.logbook import atomic_file, parquet
from imutui.logbook.parquet import Column

_PARTS: Mapping[str, Sequence[str]] = {
    "position_deg_m": ("lat", "lon", "h"),
    "position_m": ("n", "e", "d"),
    "velocity_mps": ("n", "e", "d"),
    "rpy_deg": ("roll", "pitch", "yaw"),
    "band95": ("low", "high"),
}
_AXES = ("x", "y", "z")
_AT_ONCE = 4096
_KINDS = {float: "double", int: "int64", bool: "bool", str: "string"}


def write(path: Path, rows: Iterable[Row], notes: Mapping[str, str], mode: int) -> None:
    """Write the table, there whole or not at all, in place of an older one; memory is bounded.

    `path`: file to write.
    `rows`: in the order in which they are to stand.
    `notes`: what the table is of, as its metadata.
    `mode`: permissions.
    Raises OSError if the disk does not take it.
    """
    columns = list(_columns(Row, ""))
    with atomic_file.part_of(path, overwrite=True, mode=mode) as part:
        parquet.write(part, columns, _batches(columns, iter(rows)), notes)


def _batches(columns: Sequence[Column], rows: Iterator[Row]) -> Iterator[dict[str, list[object]]]:
    while batch := list(itertools.islice(rows, _AT_ONCE)):
        cells = [dict(_cells(Row, row, "")) for row in batch]
        yield {column.name: [cell.get(column.name) for cell in cells] for column in columns}


def _columns(shape: Any, before: str) -> Iterator[Column]:
    """Columns of a typed dictionary, one for each number or word in it."""
    for key, hint in get_type_hints(shape).items():
        own, name = _plain(hint), before + key
        if is_typeddict(own):
            yield from _columns(own, f"{name}_")
        elif own in _KINDS:
            yield Column(name, _KINDS[own])  # type: ignore[arg-type]
        elif _plain(get_args(own)[0]) is float:
            yield from (Column(f"{name}_{part}", "double") for part in _PARTS.get(key, _AXES))
        else:
            yield Column(name, "string")


def _cells(shape: Any, values: Any, before: str) -> Iterator[tuple[str, object]]:
    """Name and content of the cells of a row, or of a part of it; what it does not have is left out."""
    for key, hint in get_type_hints(shape).items():
        own, name, value = _plain(hint), before + key, values.get(key)
        if value is None:
            continue
        if is_typeddict(own):
            yield from _cells(own, value, f"{name}_")
        elif own is str:
            yield name, _text(value)
        elif own in _KINDS:
            yield name, value
        elif _plain(get_args(own)[0]) is float:
            yield from ((f"{name}_{part}", x) for part, x in zip(_PARTS.get(key, _AXES), value, strict=True))
        else:
            yield name, _text("; ".join(value) if all(isinstance(x, str) for x in value) else json.dumps(value))


def _plain(hint: Any) -> Any:
    """A type without "or None" and "not required"."""
    if get_origin(hint) is NotRequired:
        hint = get_args(hint)[0]
    if get_origin(hint) is UnionType:
        hint = next(each for each in get_args(hint) if each is not NoneType)
    return hint


def _text(text: str) -> str:
    """Text that a table can hold: bytes of a file's name that are no text stand as question marks."""
    return text.encode("utf-8", "replace").decode()
