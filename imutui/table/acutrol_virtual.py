"""A virtual controller of Acutrol's dialect on a virtual table: lines of text in, answers out.

No input or output and no clock: the caller passes lines with their times. It understands what `acutrol` and the public
driver over TCP send, with long or short words, large or small. What no driver shows is made up, see docs/tables.md: the
texts of errors, what "open" and "closed" are called, that an axis that turns without end is read within 0 to 360 deg
and goes the short way, and that an axis whose drive goes off brakes.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

from filters.channels import DPS
from filters.simulation.scenario import TableFault
from filters.simulation.turn_table import TurnTable
from imutui.table.acutrol import DONE

NOT_RECOGNISED = "Command not recognized"
_BAD_ARGUMENT = "Bad argument"
_OUT_OF_RANGE = "Out of range"
_NOT_CLOSED = "Interlock not closed"

_TRIP = 1.1  # rate at which a drive trips, over the largest
_MODES = {"off": "off", "position": "position", "rate": "rate", "synthesis": "oscillation"}
_LIMITED = ("position", "rate", "synthesis")
_TREE: dict[str, tuple[str, ...]] = {
    "demand": ("position", "rate", "oscillation"),
    "mode": tuple(_MODES),
    "read": ("position", "rate"),
    "interlock": ("reset", "close", "open"),
    "limit": ("absolute", "rate", "acceleration"),
    "utility": ("lockout",),
    "*idn": (),
}
_ALONE = ("mode", "interlock", "*idn")


class _Refused(Exception):  # noqa: N818 - an answer, not an error of ours
    """The answer to a command that is not carried out."""


@dataclass(slots=True)
class _Drive:
    """State of an axis in the controller, deg and seconds."""

    name: str
    interlock: str = "open"
    mode: str = "off"
    limits: dict[str, dict[str, float]] = field(default_factory=dict)  # by mode and by kind
    position: float = 0.0  # position, rate, oscillation: demands
    rate: float = 0.0
    oscillation: tuple[float, float, float] = (0.0, 1.0, 0.0)


class VirtualAcutrol:
    """A controller, just switched on, of a table; the caller has the clock.

    `faults`: of the table and the controller; `server` has those of the link.
    """

    def __init__(self, table: TurnTable, faults: Sequence[TableFault] = ()) -> None:
        self.table = table
        model = table.model
        self._most = {"rate": model.rate / DPS, "acceleration": model.accel / DPS}
        self._drives = {
            n: _Drive(axis, limits={mode: dict(self._most) for mode in _LIMITED})
            for n, axis in enumerate(model.axes, 1)
        }
        self._faults = sorted(faults, key=lambda fault: fault.at)
        self._stuck: dict[str, float] = {}  # until when
        self._unrecognised = 0
        self._now = 0.0

    def advance(self, now: float) -> None:
        """Advance time, and have faults happen; it may be ahead of when lines come."""
        while self._faults and self._faults[0].at <= now:
            fault = self._faults.pop(0)
            self.table.advance(fault.at)
            match fault.kind:
                case "interlock" | "limit":
                    for drive in self._drives.values():
                        if fault.kind == "interlock" or drive.name == fault.axis:
                            drive.interlock = "fault"
                            self._enter(drive, "off")
                case "stuck" if fault.axis in self.table.axes:
                    self._stuck[fault.axis] = fault.at + fault.seconds
                case "unrecognised":
                    self._unrecognised += fault.count
        for axis, until in self._stuck.items():
            self.table.axes[axis].is_stuck = now < until
        self.table.advance(now)

    def carry_out(self, line: str, now: float) -> list[tuple[bool, str]]:
        """Carry out a line; returns of each command whether it is a question, and its answer.

        A command that is done is answered `DONE`, one that is not with the reason.
        """
        self.advance(now)
        self._now = now
        said, branch = list[tuple[bool, str]](), tuple[str, ...]()
        is_recognised = self._unrecognised == 0
        self._unrecognised = max(0, self._unrecognised - 1)
        for piece in line.split(";"):
            words, arguments, asks = _parsed(piece.strip(), branch)
            branch = words[:-1]
            try:
                said.append((asks, self._said(words, arguments, asks) if is_recognised else NOT_RECOGNISED))
            except _Refused as refused:
                said.append((asks, str(refused)))
        return said

    def _said(self, words: tuple[str, ...], arguments: list[str], asks: bool) -> str:
        if words == ("*idn",):
            return f"IMUTUI,VIRTUAL SIM TABLE,{self.table.model.seed},{len(self._drives)} axes"
        if words == ("utility", "lockout"):
            return DONE
        if words[:1] == ("limit",) and not asks:
            return self._limit(words[1], arguments)
        if not words:
            raise _Refused(NOT_RECOGNISED)
        drive = self._drives.get(_whole(arguments[:1]))
        if drive is None or (asks and len(arguments) > 1):
            raise _Refused(_BAD_ARGUMENT)
        return self._answer(drive, words) if asks else self._obey(drive, words, arguments[1:])

    def _answer(self, drive: _Drive, words: tuple[str, ...]) -> str:
        match words:
            case ("read", "position"):
                angle = self.table.encoder(drive.name, self._now)[0] / DPS
                return f"{angle % 360.0 if math.isinf(self.table.axes[drive.name].low) else angle:.4f}"
            case ("read", "rate"):
                return f"{self.table.encoder(drive.name, self._now)[1] / DPS:.4f}"
            case ("mode",):
                return drive.mode.capitalize()
            case ("interlock",):
                return drive.interlock.capitalize()
            case ("demand", ("position" | "rate") as what):
                return f"{getattr(drive, what):.4f}"
            case ("limit", "absolute"):
                model = self.table.model
                low, high = (0.0 if math.isinf(end) else end / DPS for end in model.ends(drive.name))
                values = (*self._most.values(), model.jerk / DPS, low, high, _TRIP * self._most["rate"])
                return ",".join(f"{value:g}" for value in values)
        raise _Refused(NOT_RECOGNISED)

    def _obey(self, drive: _Drive, words: tuple[str, ...], arguments: list[str]) -> str:
        match words:
            case ("demand", what):
                self._demand(drive, what, _numbers(arguments, 3 if what == "oscillation" else 1))
            case ("mode", mode):
                self._enter(drive, mode)
            case ("interlock", "reset"):
                drive.interlock = "open" if drive.interlock == "fault" else drive.interlock
            case ("interlock", "close"):
                if drive.interlock == "fault":
                    raise _Refused(_NOT_CLOSED)
                drive.interlock = "closed"
            case ("interlock", "open"):
                drive.interlock = "open" if drive.interlock == "closed" else drive.interlock
                self._enter(drive, "off")
            case _:
                raise _Refused(NOT_RECOGNISED)
        return DONE

    def _enter(self, drive: _Drive, mode: str) -> None:
        if mode != "off" and drive.interlock != "closed":
            raise _Refused(_NOT_CLOSED)
        drive.mode = mode
        self._apply(drive)

    def _apply(self, drive: _Drive) -> None:
        """Have the axis follow its mode, limits and demands."""
        axis = self.table.axes[drive.name]
        axis.enter(_MODES[drive.mode])
        if drive.mode == "off":
            return
        axis.rate_limit = drive.limits[drive.mode]["rate"] * DPS
        axis.accel_limit = drive.limits[drive.mode]["acceleration"] * DPS
        match drive.mode:
            case "position":
                to = drive.position * DPS - self.table.encoder_offset(drive.name)
                endless = math.isinf(axis.low)
                axis.demand = axis.angle + math.remainder(to - axis.angle, 2.0 * math.pi) if endless else to
            case "rate":
                axis.demand = drive.rate * DPS
            case "synthesis":
                amplitude, hz, phase = drive.oscillation
                axis.amplitude, axis.phase = amplitude * DPS, phase * DPS
                axis.omega = 2.0 * math.pi * hz if amplitude else axis.omega

    def _demand(self, drive: _Drive, what: str, values: list[float]) -> None:
        match what, values:
            case "oscillation", [amplitude, hz, phase]:
                omega, limits = 2.0 * math.pi * hz, drive.limits["synthesis"]
                _refuse_beyond(0.0, omega * amplitude, limits["rate"])
                _refuse_beyond(0.0, omega**2 * amplitude, limits["acceleration"])
                if hz < 0.0 or (amplitude > 0.0 and hz == 0.0):
                    raise _Refused(_OUT_OF_RANGE)
                drive.oscillation = amplitude, hz, phase
            case "rate", [rate]:
                _refuse_beyond(-self._most["rate"], rate, self._most["rate"])
                drive.rate = rate
            case "position", [angle]:
                low, high = self.table.model.ends(drive.name)
                _refuse_beyond(low / DPS, angle, high / DPS)
                drive.position = angle
        self._apply(drive)

    def _limit(self, what: str, arguments: list[str]) -> str:
        """Set a limit of a mode: `:limit:acc pos,1,x`."""
        mode = _full(arguments[0], _LIMITED) if arguments else None
        drive = self._drives.get(_whole(arguments[1:2]))
        (value,) = _numbers(arguments[2:], 1)
        if mode is None or drive is None:
            raise _Refused(_BAD_ARGUMENT)
        if not 0.0 < value <= self._most[what]:
            raise _Refused(_OUT_OF_RANGE)
        drive.limits[mode][what] = value
        self._apply(drive)
        return DONE


def _parsed(piece: str, branch: tuple[str, ...]) -> tuple[tuple[str, ...], list[str], bool]:
    """Return the words of a command in full, none if they are not known, its arguments, and whether it asks."""
    head, _, tail = piece.partition(" ")
    asks, head = head.endswith("?"), head.removesuffix("?").lower()
    spelt = tuple(head.removeprefix(":").split(":"))
    words = (() if head.startswith((":", "*")) else _in_full((*branch, *spelt))) or _in_full(spelt)
    # questions may come without a question mark
    asks = asks or words[:1] == ("read",) or words == ("limit", "absolute")
    return words, [each.strip() for each in tail.split(",")] if tail.strip() else [], asks


def _in_full(spelt: tuple[str, ...]) -> tuple[str, ...]:
    first = _full(spelt[0], _TREE)
    if first is None or len(spelt) > 2:
        return ()
    if len(spelt) == 1:
        return (first,) if first in _ALONE else ()
    second = _full(spelt[1], _TREE[first])
    return () if second is None else (first, second)


def _full(word: str, words: Collection[str]) -> str | None:
    """Return the first of some words that a word, large or small, is the beginning of."""
    return next((each for each in words if word and each.startswith(word.lower())), None)


def _whole(texts: list[str]) -> int:
    return int(texts[0]) if texts and texts[0].isdecimal() else 0


def _numbers(texts: list[str], count: int) -> list[float]:
    try:
        values = [float(text) for text in texts]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise _Refused(_BAD_ARGUMENT)
    return values


def _refuse_beyond(low: float, value: float, high: float) -> None:
    if not low <= value <= high:
        raise _Refused(_OUT_OF_RANGE)
