"""Read and write the file of a batch (TOML): the units that are recorded at once. docs/formats.md has the format.

The batch has the name of its file without the suffix. `imutui.session.batch` starts the acquisitions.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypedDict

from filters.errors import InputError
from filters.imu import parse_mount
from imutui import declared, outside_file, toml_text
from imutui.declared import Meta
from imutui.instrument.names import NAMES, VIRTUAL_PORT
from imutui.settings import FilterName, Name, Note

COMMON = ("rate", "filter", "note", "operator", "table", "place", "profile")
"""Keys at the top of the file; they apply to all units."""
_OF_UNIT = ("port", "serial", "name", "instrument", "mount", "effects")
_WORD = re.compile(r"[\w-][\w.-]*")
_FIND = "`imutui devices --probe` lists the units that answer, with port and serial number"


class BatchError(InputError):
    """A batch file is wrong; the message names file, table, key, and what to do."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of a batch. An empty field takes the configured value, or that of the unit."""

    name: str  # one word, of one unit of the batch
    port: str = ""  # port, serial: one of them
    serial: str = ""
    instrument: str = ""
    mount: str = ""
    effects: str = ""  # path of the effects file


@dataclass(frozen=True, slots=True)
class Batch:
    """Units that are recorded at once, and their common values. None takes the configured value."""

    path: Path  # of its file
    units: tuple[Unit, ...]
    rate: float | None = None  # Hz
    filter: str | None = None
    note: str | None = None
    operator: str | None = None
    table: str | None = None
    place: str | None = None
    profile: str | None = None  # path of a profile's file, or the name of a ready-made one

    def wrong(self, what: str) -> BatchError:
        """Return the error for something in its file."""
        return BatchError(
            f"{self.path}: {what.rstrip('.')}. Nothing was started; correct the file, then the same again."
        )

    @property
    def name(self) -> str:
        """Name of its file, as one word."""
        return re.sub(r"[^\w.-]+", "-", self.path.stem).strip("-.") or "batch"


def read(path: Path) -> Batch:
    """Return the batch of a file; raises BatchError if the file cannot be read, or holds no batch."""
    try:
        document = toml_text.parse(outside_file.read(path, toml_text.LIMIT))
        return declared.make(document, _Batch, partial(_batch, path))
    except OSError as error:
        words = (
            f"{path}: {error.strerror or error}. --batch names a TOML file; `imutui devices --probe -o FILE` writes it."
        )
        raise BatchError(words) from error
    except InputError as error:
        raise Batch(path, ()).wrong(str(error)) from error


def to_toml(batch: Batch, about: tuple[str, ...] = ()) -> str:
    """Return the text of a batch's file, with a comment for each unit."""
    head = [(key, getattr(batch, key)) for key in COMMON]
    lines = [f"{key} = {toml_text.value(value)}" for key, value in head if value is not None]
    for unit, said in zip(batch.units, about or ("",) * len(batch.units), strict=True):
        lines += ["", *([f"# {said}"] if said else []), "[[unit]]"]
        own = {key: getattr(unit, key) for key in _OF_UNIT if key != "name" or unit.name != unit.serial}
        lines += [f"{key} = {toml_text.value(value)}" for key, value in own.items() if value]
    return "\n".join(lines).lstrip("\n") + "\n"


def _serial(value: object) -> str:
    # a number without quotes is what people write
    if isinstance(value, bool) or not isinstance(value, str | int):
        raise InputError(f"`serial` is {value!r}, not a serial number")
    return str(value)


def _mount(text: str) -> str:
    parse_mount(text)
    return text


class _Unit(TypedDict, total=False):
    port: str
    serial: Annotated[Any, Meta(make=_serial)]
    name: str
    instrument: Annotated[str, Meta(make=str.lower)]
    mount: Annotated[str, Meta(make=_mount)]
    effects: str


class _Batch(TypedDict, total=False):
    rate: float
    filter: FilterName
    note: Note
    operator: Name
    table: Name
    place: Name
    profile: str
    unit: list[_Unit]


def _batch(path: Path, unit: Sequence[dict[str, Any]] = (), profile: str | None = None, **common: Any) -> Batch:
    if not unit:
        raise InputError(f"it has no [[unit]]. {_FIND}")
    units = tuple(_unit(path.parent, number, **fields) for number, fields in enumerate(unit, 1))
    for key in ("name", "port", "serial"):
        seen: dict[str, int] = {}
        for number, each in enumerate(units, 1):
            value = getattr(each, key)
            if value and value in seen and value != VIRTUAL_PORT:
                raise InputError(f'[[unit]] {number}: `{key}` is "{value}", as that of [[unit]] {seen[value]}')
            seen[value] = number
    return Batch(path, units, profile=_beside(profile, path.parent) if profile else profile, **common)


def _unit(folder: Path, number: int, name: str = "", instrument: str = "", effects: str = "", **fields: str) -> Unit:
    port, serial = fields.get("port", ""), fields.get("serial", "")
    if bool(port) == bool(serial):
        has = "both `port` and `serial`; keep the one that is to count" if port else "no `port` or `serial`"
        raise InputError(f"[[unit]] {number} has {has}. {_FIND}")
    name = name or re.sub(r"[^\w.-]+", "-", serial) or str(number)
    if not _WORD.fullmatch(name):
        raise InputError(f"[[unit]] {number}: `name` is {name!r}, not one word of letters, digits, . _ and -")
    if instrument and instrument not in NAMES:
        raise InputError(f"[[unit]] {number}: `instrument` is {instrument!r}, not one of: {', '.join(NAMES)}")
    return Unit(name, instrument=instrument, effects=str(folder / effects) if effects else "", **fields)


def _beside(name: str, folder: Path) -> str:
    """A profile's file beside that of the batch; the name of a ready-made one as it is."""
    return str(folder / name) if Path(name).suffix.lower() in (".csv", ".toml") else name
