"""What owner and keeper of a table write to each other: a record a line, as JSON."""

import json
from dataclasses import asdict, dataclass, field, fields
from typing import Literal, TypeVar

from filters.errors import InputError
from imutui.declared import read
from imutui.table.motion import AxisLimits, Motion, TableState

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Command:
    """What the owner asks for; the keeper's answer has its number."""

    do: Literal["beat", "enable", "go", "stop", "off"]
    motions: tuple[Motion, ...] = ()  # of "go": begin at once, each of another axis
    stops: int = 0  # how many stops the owner had asked for when it decided on the command, this one included
    number: int = 0


@dataclass(frozen=True, slots=True)
class Report:
    """What the keeper reports; one without anything in it says that the keeper lives."""

    identity: str = ""  # identity, axes, limits: of the first report
    axes: tuple[str, ...] = ()
    limits: dict[str, AxisLimits] = field(default_factory=dict)
    state: TableState | None = None
    to: int = 0  # the number of a command that was carried out, or refused
    refused: str = ""  # why it was refused
    said: str = ""
    error: str = ""  # why the keeper ends, if not as told
    ended: bool = False  # these are its last words: it has done what it could for the table to stand still


_USUAL: dict[type, Command | Report] = {Command: Command("beat"), Report: Report()}


def encode(record: Command | Report) -> bytes:
    """Return a record as a line, without what it leaves as usual."""
    usual, names = _USUAL[type(record)], [each.name for each in fields(record)]
    said = {name: value for name in names if (value := getattr(record, name)) != getattr(usual, name) or name == "do"}
    return json.dumps(said, default=asdict).encode() + b"\n"


def decode(line: bytes, kind: type[T]) -> T:
    """Return the record of a line; raises InputError if it is none."""
    try:
        value = json.loads(line)
    except ValueError:
        raise InputError(f"no {kind.__name__.lower()}: {line[:200].decode(errors='replace')}") from None
    return read(value, kind)
