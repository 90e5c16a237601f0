"""The keeper of a table: the one process that has the link, and the gate that every command goes through.

Its owner writes a line of JSON for each command to its stdin, and reads what it says from its stdout; `owner` is that
side. It polls angles as fast as the link answers, and stops the table, at once and by itself, when a command is not
followed, the controller reports a fault, the link is lost, or its owner falls silent, ends or is killed.
"""

import contextlib
import json
import math
import os
import select
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, TypedDict, cast

from filters.errors import InputError
from filters.motion.segments import AXES
from imutui.table import gate
from imutui.table.controller import AxisLimits, TableController, TableError

SILENT_S = 1.0
"""So long without a word of its owner, in real time, and the table is stopped."""
_POLL_S = 1.0 / 200.0
_AGAIN_S, _PATIENCE_S = 0.5, 60.0
_MOST = 1 << 16
# what the controller itself is asked before a mode is changed from a rate: until then it would jerk
_STANDS_DPS = 1.0
_real_s, _wait = time.monotonic, time.sleep  # its owner is waited for in real time, whatever the process's own is


class StateTold(TypedDict):
    """A `TableState`, as JSON has it."""

    stamp_ns: int
    uncertainty_ns: int
    angles_deg: Sequence[float]
    rates_dps: Sequence[float]
    mode: str
    fault: str


class Told(TypedDict, total=False):
    """A line of what a keeper tells: of the first one identity, axes and limits, of others what they are about."""

    identity: str
    axes: Sequence[str]
    limits: Mapping[str, Mapping[str, float | None]]
    state: StateTold
    did: str  # a command that was carried out
    refused: str  # why one was not: nothing was sent
    said: str
    error: str  # why it ends, if not as told
    ended: bool  # of its last words: it has done what it could for the table to stand still
    ended_in_s: float  # how long that took


class OwnerGoneError(Exception):
    """Nobody is there any more who could stop the table; says why."""


class Keeper:
    """Has the link until it ends; `connect` makes it, and once more should it be lost.

    `given`: limits that the operator gives.
    `say`: takes what the owner is to be told.
    `speed`: times that time runs faster, of a trial.
    Raises TableError if there is no controller.
    """

    def __init__(
        self,
        connect: Callable[[], TableController],
        given: Mapping[str, AxisLimits],
        say: Callable[[Told], None],
        speed: float = 1.0,
    ) -> None:
        self._connect = connect
        self._say = say
        self._controller = controller = connect()
        identity = controller.identify()
        read = controller.limits()
        known = gate.narrower(read, given)
        self.limits = {axis: known[axis] for axis in controller.axes if axis in known}
        self._follower = gate.Follower(self.limits, speed)
        self._enabled = False
        told = {axis: asdict(limits) for axis, limits in self.limits.items()}
        say({"identity": identity, "axes": controller.axes, "limits": told})

    def poll(self) -> None:
        """Ask angles and tell them; raises TableError where something is wrong."""
        state = self._controller.read()
        self._say({"state": cast("StateTold", asdict(state))})
        wrong = self._follower.wrong(state)
        if wrong and (self._enabled or self._follower.mode != "off"):
            raise TableError(f"{wrong}.")

    def carry_out(self, line: bytes) -> bool:
        """Do what a line asks; what is refused is told, and nothing sent. Returns whether to go on.

        Raises TableError where the controller does not do it.
        """
        try:
            asked = _read(line)
            do = asked["do"]
            if do == "off":
                return False
            if do not in _COMMANDS:
                raise InputError(f'`do` is "{do}", not one of: {", ".join(_COMMANDS)}, off')
            _COMMANDS[do](self, asked)
        except InputError as error:
            self._say({"refused": str(error)})
        else:
            if do != "beat":
                self._say({"did": do})
        return True

    def _do_beat(self, asked: Mapping[str, Any]) -> None:
        pass

    def _do_enable(self, _: Mapping[str, Any]) -> None:
        for axis in self._controller.axes:  # an axis without limits may not be there when others move
            gate.limits_of(axis, self.limits)
        self._controller.enable()
        self._enabled = True

    def _do_move(self, asked: Mapping[str, Any]) -> None:
        rate, accel, targets = _number(asked, "rate_dps"), _number(asked, "accel_dps2"), {}
        angles = asked.get("angles_deg")
        if not isinstance(angles, list) or len(angles) != len(AXES):
            raise InputError("`angles_deg` is not a list of three: outer, middle, inner")
        wanted = {axis: _number({axis: angle}, axis) for axis, angle in zip(AXES, angles, strict=True)}
        self._refuse_unless_enabled()
        for axis, angle in wanted.items():
            if axis not in self._controller.axes and angle == 0.0:
                continue
            limits, k = gate.limits_of(axis, self.limits), AXES.index(axis)
            targets[axis] = gate.to_angle(self._follower.angles_deg[k], angle, limits)
            limits.check(axis, angle_deg=targets[axis], rate_dps=rate, accel_dps2=accel)
            if not (rate > 0.0 and accel > 0.0):
                raise InputError(f"`rate_dps` is {rate:g} and `accel_dps2` {accel:g}; both must be positive")
            if abs(self._follower.rates_dps[k]) > _STANDS_DPS:
                raise InputError(f"{axis} turns still; have it stand first: a rate of zero")
        for axis, target in targets.items():
            # as the controller counts, which may begin anew with each turn
            begun_s = time.monotonic()
            self._controller.position(axis, target, rate, accel)
            self._follower.commanded(axis, "position", begun_s, target, rate, accel, took_s=time.monotonic() - begun_s)

    def _do_rate(self, asked: Mapping[str, Any]) -> None:
        axis, rate = str(asked.get("axis")), _number(asked, "rate_dps")
        self._refuse_unless_enabled()
        limits = gate.limits_of(axis, self.limits)
        accel = _number(asked, "accel_dps2") if "accel_dps2" in asked else limits.accel_dps2
        limits.check(axis, rate_dps=rate, accel_dps2=accel)
        if not accel > 0.0:
            raise InputError(f"`accel_dps2` is {accel:g}; it must be positive")
        begun_s = time.monotonic()
        self._controller.rate(axis, rate, accel)
        self._follower.commanded(axis, "rate", begun_s, rate, accel=accel, took_s=time.monotonic() - begun_s)

    def _do_oscillate(self, asked: Mapping[str, Any]) -> None:
        axis, amplitude, hz = str(asked.get("axis")), _number(asked, "amplitude_deg"), _number(asked, "hz")
        self._refuse_unless_enabled()
        limits = gate.limits_of(axis, self.limits)
        gate.check_swing(axis, self._follower.angles_deg[AXES.index(axis)], limits, amplitude, hz)
        begun_s = time.monotonic()
        self._controller.oscillate(axis, amplitude, hz)
        self._follower.commanded(axis, "oscillation", begun_s, amplitude, hz, took_s=time.monotonic() - begun_s)

    def _do_stop(self, _: Mapping[str, Any]) -> None:
        self._follower.stopped()
        self._controller.stop()

    def _refuse_unless_enabled(self) -> None:
        if not self._enabled:
            raise InputError("nothing moves before it is enabled: somebody must say so, and the interlock be closed")
        if not self._follower.angles_deg:
            raise InputError("no angles were read yet; ask again")

    def end(self, why: str, *, is_error: bool) -> None:
        """Stop the table, if it was enabled here, open its interlock, and say why; on a lost link by another one."""
        begun_s = _real_s()
        stopped = "the table was not moved from here"
        if self._enabled:
            stopped = "it was stopped: rate zero, mode off" if self._stop() else _NOT_STOPPED
        said = f"{why} {stopped[0].upper()}{stopped[1:]}."
        self._say({"error": said, "ended": True} if is_error else {"said": said, "ended": True})
        with contextlib.suppress(TableError):
            if self._enabled:
                self._controller.disable()
        with contextlib.suppress(TableError):
            self._controller.close()
        self._say({"ended_in_s": _real_s() - begun_s})

    def _stop(self) -> bool:
        """Stop; by another link where this one has gone, for as long as there is hope. Returns whether it was done."""
        until_s, is_open = _real_s() + _PATIENCE_S, True
        while _real_s() < until_s:
            try:
                if not is_open:
                    self._controller = self._connect()
                    is_open = True
                self._controller.stop()
            except Exception as error:  # noqa: BLE001 - whatever it fails with, another link is the next to be tried
                self._say({"said": f"connecting again, to stop the table: {error}"})
                if is_open:
                    is_open = False
                    with contextlib.suppress(TableError):
                        self._controller.close()
                _wait(_AGAIN_S)
            else:
                return True
        return False


_COMMANDS: dict[str, Callable[[Keeper, Mapping[str, Any]], None]] = {
    name.removeprefix("_do_"): function for name, function in vars(Keeper).items() if name.startswith("_do_")
}
_NOT_STOPPED = f"the table could NOT be stopped: no link came back within {_PATIENCE_S:g} s. Press its emergency stop"


def _read(line: bytes) -> dict[str, Any]:
    """A command; raises InputError if it is none."""
    try:
        asked = json.loads(line)
    except ValueError:
        asked = None
    if not isinstance(asked, dict) or not isinstance(asked.get("do"), str):
        raise InputError(f"no command of a table: {line[:200].decode(errors='replace')}")
    return asked


def _number(asked: Mapping[str, Any], name: str) -> float:
    value = asked.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"`{name}` is {value}, no number")
    return float(value)


class Lines:
    """What the owner writes, line by line; `since_s` is when it last did, in real time."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._rest = b""
        self.since_s = _real_s()

    def take(self, wait_s: float) -> list[bytes]:
        """Lines that come within a time; raises OwnerGoneError at their end, or if none came for too long."""
        if select.select((self._descriptor,), (), (), wait_s)[0]:
            data = os.read(self._descriptor, _MOST)
            if not data:
                raise OwnerGoneError("whoever commanded the table has ended.")
            self.since_s = _real_s()
            *lines, self._rest = (self._rest + data).split(b"\n")
            return [line for line in lines if line.strip()]
        if _real_s() - self.since_s > SILENT_S:
            raise OwnerGoneError(f"whoever commanded the table has said nothing for {SILENT_S:g} s.")
        return []


def writer(descriptor: int) -> Callable[[Told], None]:
    """What writes records as lines and never waits: an owner that does not read loses readings."""
    os.set_blocking(descriptor, False)

    def say(record: Told) -> None:
        # a line shorter than a pipe's unit of writing goes whole or not at all; one that has gone is told by its end
        with contextlib.suppress(BlockingIOError, BrokenPipeError):
            os.write(descriptor, json.dumps(record).encode() + b"\n")

    return say


def run(connect: Callable[[], TableController], given: Mapping[str, AxisLimits], speed: float = 1.0) -> int:
    """Keep a table until it is told to end, or must; returns the process's exit code."""
    say = writer(1)
    asked_to_end: list[str] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, _: asked_to_end.append(signal.Signals(number).name))
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        keeper = Keeper(connect, given, say, speed)
    except TableError as error:
        say({"error": str(error), "ended": True})
        return 4
    lines, goes_on = Lines(0), True
    try:
        while goes_on and not asked_to_end:
            due_s = _real_s() + _POLL_S / speed
            keeper.poll()
            for line in lines.take(max(0.0, due_s - _real_s())):
                goes_on = goes_on and keeper.carry_out(line)
    except TableError as error:
        keeper.end(str(error), is_error=True)
        return 4
    except OwnerGoneError as gone:
        keeper.end(str(gone), is_error=True)
        return 4
    except BaseException:
        # a defect of our own: whatever it is, the table must not turn on
        keeper.end("the keeper of the table met with an error of its own.", is_error=True)
        raise
    keeper.end(f"ended by {asked_to_end[0]}." if asked_to_end else "ended as told.", is_error=bool(asked_to_end))
    return 0
