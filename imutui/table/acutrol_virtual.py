"""A virtual controller of Acutrol's dialect on a virtual table: lines of commands in, texts of answers out.

No input or output and no clock: it is told what came, and when. What no driver shows is made up here, see
docs/tables.md: the texts of errors, what "open" and "closed" are called, that positions of an axis that turns without
end are read within 0 to 360 deg and demanded the short way round, and that an axis whose drive goes off brakes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from filters.channels import DPS
from filters.motion.segments import AXES
from filters.simulation.scenario import TableFault
from filters.simulation.turn_table import STEP_S, TurnTable
from imutui.table import acutrol
from imutui.table.acutrol import AnyCommand, Command, full

NOT_RECOGNISED = "Command not recognized"
_BAD_ARGUMENT = "Bad argument"
_OUT_OF_RANGE = "Out of range"
_NOT_CLOSED = "Interlock not closed"

_FAULT_STATUS, _FINE_STATUS = 65, 0  # 65 was seen with a fault of the interlock
_TRIP = 1.1  # rate at which a drive trips, over the largest
_DELTA_DEG = 180.0
_MODES = {"off": "off", "position": "position", "rate": "rate", "synthesis": "oscillation"}
_LIMITED = ("position", "rate", "synthesis")
_LIMITS = ("rate", "acceleration", "jerk")


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

    `faults`: of the table and the controller; those of the link are for whoever has one.
    """

    def __init__(self, table: TurnTable, faults: Sequence[TableFault] = ()) -> None:
        self.table = table
        model = table.model
        most = {"rate": model.rate / DPS, "acceleration": model.accel / DPS, "jerk": model.jerk / DPS}
        self._most = most
        self._drives = {
            n: _Drive(axis, limits={mode: dict(most) for mode in _LIMITED}) for n, axis in enumerate(model.axes, 1)
        }
        self._faults = sorted(faults, key=lambda fault: fault.at)
        self._stuck: dict[str, float] = {}  # until when
        self._unrecognised = 0
        self._now = 0.0

    def advance(self, now: float) -> None:
        """Let time go on, and faults happen; it may be ahead of when lines come."""
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

    def carry_out(self, line: Sequence[AnyCommand], now: float) -> list[str | None]:
        """Carry out a line; returns the answer to each command: a text to a question, and None to a command done.

        A command that is not done is answered with what is wrong.
        """
        self.advance(now)
        self._now = now
        if self._unrecognised:
            self._unrecognised -= 1
            return [NOT_RECOGNISED] * len(line)
        answers: list[str | None] = []
        for command in line:
            try:
                answers.append(self._done(command))
            except _Refused as refused:
                answers.append(str(refused))
        return answers

    def _done(self, command: AnyCommand) -> str | None:
        if not isinstance(command, Command):
            raise _Refused(NOT_RECOGNISED)
        if command.asks:
            return self._said(command)
        self._obey(command)
        return None

    def _obey(self, command: Command) -> None:
        arguments = command.arguments
        match command.words:
            case ("demand", what):
                self._demand(what, arguments)
            case ("mode",) if len(arguments) == 2:
                self._into(arguments[1], arguments[0])
            case ("mode", which) if len(arguments) == 1:
                self._into(which, arguments[0])
            case ("interlock", what):
                self._interlock(arguments, what)
            case ("limit",):
                self._limit(arguments, *_LIMITS)
            case ("limit", what):
                self._limit(arguments, what)
            case ("utility", "lockout"):
                pass
            case _:
                raise _Refused(NOT_RECOGNISED)

    def _said(self, command: Command) -> str:
        match command.words:
            case ("*idn",):
                return f"IMUTUI,VIRTUAL SIM TABLE,{self.table.model.seed},{len(self._drives)} axes"
            case ("*stb",):
                at_fault = any(drive.interlock == "fault" for drive in self._drives.values())
                return str(_FAULT_STATUS if at_fault else _FINE_STATUS)
            case ("limit", ("rate" | "acceleration" | "jerk") as kind):
                return self._which_limit(command.arguments, kind)
        drive = self._one(command.arguments)
        match command.words:
            case ("read", "position"):
                angle = self.table.encoder(drive.name, self._now)[0] / DPS
                return f"{angle % 360.0 if math.isinf(self.table.axes[drive.name].low) else angle:.4f}"
            case ("read", "rate"):
                return f"{self.table.encoder(drive.name, self._now)[1] / DPS:.4f}"
            case ("read", "acceleration"):
                return f"{self._acceleration(drive):.3f}"
            case ("mode",):
                return drive.mode.capitalize()
            case ("interlock",):
                return drive.interlock.capitalize()
            case ("demand", ("position" | "rate") as what):
                return f"{getattr(drive, what):.4f}"
            case ("limit", "absolute"):
                ends = self.table.model.ends(drive.name)
                low, high = (0.0 if math.isinf(end) else end / DPS for end in ends)
                return ",".join(f"{value:g}" for value in (*self._most.values(), low, high, _TRIP * self._most["rate"]))
        raise _Refused(NOT_RECOGNISED)

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

    # ---------------------------------------------------------------------------------------------- arguments

    def _chosen(self, text: str) -> list[_Drive]:
        if text.lower() == acutrol.ALL:
            return list(self._drives.values())
        if not text.isdigit() or int(text) not in self._drives:
            raise _Refused(_BAD_ARGUMENT)
        return [self._drives[int(text)]]

    def _one(self, arguments: Sequence[str]) -> _Drive:
        if len(arguments) != 1:
            raise _Refused(_BAD_ARGUMENT)
        chosen = self._chosen(arguments[0])
        if len(chosen) != 1:
            raise _Refused(_BAD_ARGUMENT)
        return chosen[0]

    # ----------------------------------------------------------------------------------------------- commands

    def _demand(self, what: str, arguments: Sequence[str]) -> None:
        chosen, values = self._of(arguments, 3 if what == "oscillation" else 1)
        for drive in chosen:
            if what == "oscillation":
                amplitude, hz, phase = values
                omega, limits = 2.0 * math.pi * hz, drive.limits["synthesis"]
                self._refuse_beyond(0.0, omega * amplitude, limits["rate"])
                self._refuse_beyond(0.0, omega**2 * amplitude, limits["acceleration"])
                if hz < 0.0 or (amplitude > 0.0 and hz == 0.0):
                    raise _Refused(_OUT_OF_RANGE)
                drive.oscillation = amplitude, hz, phase
            elif what == "rate":
                self._refuse_beyond(-self._most["rate"], values[0], self._most["rate"])
                drive.rate = values[0]
            else:
                by = values[0] if what == "delta" else 0.0
                self._refuse_beyond(-_DELTA_DEG, by, _DELTA_DEG)
                now = drive.position if drive.mode == "position" else self.table.encoder(drive.name, self._now)[0] / DPS
                low, high = (end / DPS for end in self.table.model.ends(drive.name))
                to = now + by if what == "delta" else values[0]
                self._refuse_beyond(low, to, high)
                drive.position = to
            self._apply(drive)

    @staticmethod
    def _refuse_beyond(low: float, value: float, high: float) -> None:
        if not low <= value <= high:
            raise _Refused(_OUT_OF_RANGE)

    def _into(self, mode: str, axes: str) -> None:
        which = full(mode, acutrol.MODES)
        if which is None:
            raise _Refused(_BAD_ARGUMENT)
        for drive in self._chosen(axes):
            self._enter(drive, which)

    def _interlock(self, arguments: Sequence[str], what: str) -> None:
        for drive in self._chosen(arguments[0] if arguments else acutrol.ALL):
            if what == "reset":
                drive.interlock = "open" if drive.interlock == "fault" else drive.interlock
            elif what == "close" and drive.interlock == "fault":
                raise _Refused(_NOT_CLOSED)
            elif what == "close":
                drive.interlock = "closed"
            else:
                drive.interlock = "open" if drive.interlock == "closed" else drive.interlock
                self._enter(drive, "off")

    def _limit(self, arguments: Sequence[str], *what: str) -> None:
        """Limits of a mode: `:limit:acc pos,1,x`, or all three, axis first: `:limit 1,P,rate,acc,jerk`."""
        if len(arguments) != 2 + len(what):
            raise _Refused(_BAD_ARGUMENT)
        of, axes = (arguments[0], arguments[1]) if len(what) == 1 else (arguments[1], arguments[0])
        mode, values = full(of, _LIMITED), [_number(text) for text in arguments[2:]]
        if mode is None:
            raise _Refused(_BAD_ARGUMENT)
        if not all(0.0 < value <= self._most[kind] for kind, value in zip(what, values, strict=True)):
            raise _Refused(_OUT_OF_RANGE)
        for drive in self._chosen(axes):
            drive.limits[mode].update(zip(what, values, strict=True))
            self._apply(drive)

    def _of(self, arguments: Sequence[str], count: int) -> tuple[list[_Drive], list[float]]:
        if len(arguments) != 1 + count:
            raise _Refused(_BAD_ARGUMENT)
        return self._chosen(arguments[0]), [_number(text) for text in arguments[1:]]

    def _acceleration(self, drive: _Drive) -> float:
        before, after = self.table.rates(np.array([self._now - STEP_S, self._now]))[:, AXES.index(drive.name)]
        return float(after - before) / STEP_S / DPS

    def _which_limit(self, arguments: Sequence[str], what: str) -> str:
        mode = full(arguments[0], _LIMITED) if len(arguments) == 2 else None
        if mode is None:
            raise _Refused(_BAD_ARGUMENT)
        return f"{self._one(arguments[1:]).limits[mode][what]:g}"


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _Refused(_BAD_ARGUMENT)
    return value
