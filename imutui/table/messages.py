"""Messages between the owner and the keeper of a table: a record a line, as JSON.

Both are processes of one installation, so that neither checks what the other writes.
"""

import json
from dataclasses import asdict, dataclass, field
from typing import Literal

from filters.errors import InputError
from imutui.table.motion import OSCILLATION, POSITION, RATE, AxisLimits, Motion, Move, Swing, TableState, Turn

_MOTIONS: dict[str, type[Motion]] = {POSITION: Move, RATE: Turn, OSCILLATION: Swing}


@dataclass(frozen=True, slots=True)
class Command:
    """A command of the owner; the keeper's answer has its number."""

    do: Literal["beat", "enable", "go", "stop", "off"]
    motions: tuple[Motion, ...] = ()  # of "go": begin at once, each of another axis
    stops: int = 0  # stops that the owner had asked for when it decided on the command, this one included
    number: int = 0


@dataclass(frozen=True, slots=True)
class Report:
    """A report of the keeper; one with nothing in it shows that the keeper lives."""

    identity: str = ""  # identity, axes, limits: of the first report
    axes: tuple[str, ...] = ()
    limits: dict[str, AxisLimits] = field(default_factory=dict)
    state: TableState | None = None
    to: int = 0  # number of a command that was carried out or refused
    refused: str = ""  # why it was refused
    said: str = ""
    error: str = ""  # why the keeper ends, if its owner did not ask for it
    ended: bool = False  # the last report: the keeper has done what it could for the table to stand still


def encode(record: Command | Report) -> bytes:
    """Return a record as a line, without its empty fields."""
    said = {name: value for name in record.__slots__ if (value := getattr(record, name))}
    return json.dumps(said, default=asdict).encode() + b"\n"


def command(line: bytes) -> Command:
    """Return the command of a line of the owner."""
    said = json.loads(line)
    motions = tuple(_MOTIONS[each["mode"]](**each) for each in said.pop("motions", ()))
    return Command(**said, motions=motions)


def report(line: bytes) -> Report:
    """Return the report of a line of the keeper; raises InputError if the keeper was killed while it wrote the line."""
    try:
        said = json.loads(line)
    except ValueError as error:
        raise InputError(f"the keeper's line is not whole: {error}") from error
    if "state" in said:
        state = said["state"]
        state |= {"angles_deg": tuple(state["angles_deg"]), "rates_dps": tuple(state["rates_dps"])}
        said["state"] = TableState(**state)
    if "axes" in said:
        limits = {axis: AxisLimits(**own) for axis, own in said.pop("limits", {}).items()}
        said |= {"axes": tuple(said["axes"]), "limits": limits}
    return Report(**said)
