"""The keeper of a table: the one process that has the link, and passes every command through the gate.

Its owner (`owner`) writes a line of JSON for each command to the keeper's stdin, and reads the keeper's stdout. The
keeper polls angles as fast as the link answers. It stops the table when the table does not follow a command, the
controller reports a fault, the link is lost, or its owner falls silent, ends or is killed.

A stop gets in between any two lines to the controller. The keeper sends it over its link and over new ones until the
controller confirms that the table rests; if none does, the keeper's last words ask for the emergency stop.
"""

import contextlib
import json
import math
import os
import select
import signal
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, TypedDict, cast

from filters.errors import InputError
from filters.motion.segments import AXES
from imutui import defects
from imutui.table import gate
from imutui.table.controller import OFF, AxisLimits, TableController, TableError, TableLinkError

SILENT_S = 1.0
"""So long without a word of its owner, in real time, and the table is stopped."""
BRAKES_S = 3.0
"""Time for an axis to come to rest, where its rate is not known."""
_POLL_S = 1.0 / 200.0
_AGAIN_S, _PATIENCE_S = 0.5, 60.0
_ALIVE_S = 0.5  # between two words to the owner while a command takes its time
_MOST = 1 << 16
_wait = time.sleep


class StateTold(TypedDict):
    """A `TableState`, as JSON has it."""

    stamp_ns: int
    uncertainty_ns: int
    angles_deg: Sequence[float]
    rates_dps: Sequence[float]
    mode: str
    fault: str


class Told(TypedDict, total=False):
    """A line from a keeper: the first has identity, axes and limits; an empty one says that the keeper lives."""

    identity: str
    axes: Sequence[str]
    limits: Mapping[str, Mapping[str, float | None]]
    state: StateTold
    did: str  # a command that was carried out
    refused: str  # why one was not carried out
    to: int  # the number of that command
    said: str
    error: str  # why it ends, if not as told
    ended: bool  # of its last words: it has done what it could for the table to stand still
    ended_in_s: float  # how long that took


class OwnerGoneError(Exception):
    """The owner, who could stop the table, has ended or is silent; the message says which."""


class StopAskedError(Exception):
    """A stop waits to be carried out: what is being sent is given up."""


Connect = Callable[[bool], TableController]
"""Makes a link; the argument says whether it may ask anything now."""


def stop_for_certain(
    controller: TableController | None,
    connect: Connect,
    tell: Callable[[str], None],
    brakes_s: float = BRAKES_S,
    *,
    is_deaf: bool = False,
) -> TableController | None:
    """Stop a table, over new links where the one at hand fails, for a minute.

    `controller`: the link at hand; None: there is none.
    `tell`: takes what failed, in words.
    `brakes_s`: time within which all axes come to rest.
    `is_deaf`: ask nothing over the link at hand either before the modes are off; over a new link that is always so.
    Returns the link over which the controller has confirmed that all axes rest with their modes off, or None.
    """
    until_s, said = time.monotonic() + _PATIENCE_S, ""
    while True:
        try:
            controller = controller or connect(False)
            controller.stop(brakes_s if is_deaf else None)
        except Exception as error:  # noqa: BLE001 - whatever it fails with, another link is the next to be tried
            if str(error) != said:
                said = str(error)
                tell(
                    f"the stop is not confirmed and is sent again; press the emergency stop if the table turns: {said}"
                )
        else:
            return controller
        if controller is not None:
            with contextlib.suppress(TableError):
                controller.close()
        controller, is_deaf = None, True
        if time.monotonic() > until_s:
            return None
        _wait(_AGAIN_S)


class Keeper:
    """Has the link until it ends.

    `connect`: makes the link, and once more should it be lost.
    `given`: limits that the operator gives.
    `say`: takes each record for the owner.
    `lines`: has the owner's commands.
    `speed`: times that time runs faster, of a trial.
    Raises TableError if there is no controller.
    """

    def __init__(
        self,
        connect: Connect,
        given: Mapping[str, AxisLimits],
        say: Callable[[Told], None],
        lines: "Lines",
        speed: float = 1.0,
    ) -> None:
        self._connect = connect
        self._say = say
        self._lines = lines
        self._controller = controller = connect(True)
        identity = controller.identify()
        read = controller.limits()
        known = gate.narrower(read, given)
        self.limits = {axis: known[axis] for axis in controller.axes if axis in known}
        wraps = [axis for axis, own in read.items() if not own.has_stops]
        self._follower = gate.Follower(self.limits, speed, wraps)
        self._legs: dict[str, tuple[deque[float], float, float]] = {}  # angles still to go to, rate, acceleration
        self._enabled = self._stops_now = False
        self._stops = 0  # how many the owner has asked for
        self._alive_s = time.monotonic()
        controller.meanwhile = self._heed
        told = {axis: asdict(limits) for axis, limits in self.limits.items()}
        say({"identity": identity, "axes": controller.axes, "limits": told})

    def _heed(self) -> None:
        """Look up while the controller is busy; raises what must interrupt it."""
        if time.monotonic() - self._alive_s > _ALIVE_S:
            self._alive_s = time.monotonic()
            self._say({})
        if self._stops_now:
            return
        self._lines.look(0.0)
        if self._lines.stop_waits:
            raise StopAskedError
        if self._enabled and time.monotonic() > self._follower.must_stop_s:
            raise TableError("the controller answers too late for an axis to stop before its limit.")

    def poll(self) -> None:
        """Read angles and report them; raises TableError if something is wrong."""
        state = self._controller.read()
        wrong = self._follower.wrong(state)
        told = asdict(state) | {"angles_deg": self._follower.angles_deg}
        self._say({"state": cast("StateTold", told)})
        if wrong and (self._enabled or self._follower.mode != OFF):
            raise TableError(f"{wrong}.")
        for axis, (angles, *_) in self._legs.items():
            if len(angles) > 1 and self._follower.is_there(axis, angles[0]):
                angles.popleft()
                self._send_leg(axis)

    def carry_out(self, line: bytes) -> bool:
        """Do what a line asks, or report why not. Returns whether to go on.

        Raises TableError if the controller does not do it.
        """
        asked: dict[str, Any] = {}
        try:
            asked = _read(line)
            do = asked["do"]
            if do == "off":
                return False
            if do not in _COMMANDS:
                raise InputError(f'`do` is "{do}", not one of: {", ".join(_COMMANDS)}, off')
            _COMMANDS[do](self, asked)
        except InputError as error:
            self._say({"refused": str(error), "to": asked.get("number", 0)})
        except StopAskedError:
            self._say({"refused": "the table is being stopped", "to": asked.get("number", 0)})
        else:
            if do != "beat":
                self._say({"did": do, "to": asked.get("number", 0)})
        return True

    def _do_beat(self, asked: Mapping[str, Any]) -> None:
        pass

    def _do_enable(self, asked: Mapping[str, Any]) -> None:
        self._refuse_before_a_stop(asked)
        for axis in self._controller.axes:  # an axis without limits may not be there when others move
            gate.limits_of(axis, self.limits)
        was, self._enabled = self._enabled, True  # from the first line on that is sent
        try:
            self._controller.enable()
        except InputError:
            self._enabled = was
            raise

    def _do_move(self, asked: Mapping[str, Any]) -> None:
        rate, accel = _number(asked, "rate_dps"), _number(asked, "accel_dps2")
        angles = asked.get("angles_deg")
        if not isinstance(angles, list) or len(angles) != len(AXES):
            raise InputError("`angles_deg` is not a list of three: outer, middle, inner")
        wanted = {axis: _number({axis: angle}, axis) for axis, angle in zip(AXES, angles, strict=True)}
        self._refuse_unless_enabled(asked)
        has = [axis for axis in wanted if axis in self._controller.axes or wanted[axis] != 0.0]
        paths = {axis: self._follower.path(axis, wanted[axis], rate, accel) for axis in has}
        self._legs = {axis: (deque(path), rate, accel) for axis, path in paths.items()}
        for axis in paths:
            self._send_leg(axis)

    def _send_leg(self, axis: str) -> None:
        angles, rate, accel = self._legs[axis]
        begun_s = time.monotonic()
        self._controller.position(axis, angles[0], rate, accel, as_it_is=self.limits[axis].has_stops)
        self._follower.commanded(axis, "position", begun_s, angles[0], rate, accel, took_s=time.monotonic() - begun_s)

    def _do_rate(self, asked: Mapping[str, Any]) -> None:
        axis, rate = str(asked.get("axis")), _number(asked, "rate_dps")
        self._refuse_unless_enabled(asked)
        limits = gate.limits_of(axis, self.limits)
        accel = _number(asked, "accel_dps2") if "accel_dps2" in asked else limits.accel_dps2
        self._follower.check_rate(axis, rate, accel)
        self._legs.pop(axis, None)
        begun_s = time.monotonic()
        self._controller.rate(axis, rate, accel)
        self._follower.commanded(axis, "rate", begun_s, rate, accel=accel, took_s=time.monotonic() - begun_s)

    def _do_oscillate(self, asked: Mapping[str, Any]) -> None:
        axis, amplitude, hz = str(asked.get("axis")), _number(asked, "amplitude_deg"), _number(asked, "hz")
        self._refuse_unless_enabled(asked)
        self._follower.check_swing(axis, amplitude, hz)
        self._legs.pop(axis, None)
        begun_s = time.monotonic()
        self._controller.oscillate(axis, amplitude, hz)
        self._follower.commanded(axis, "oscillation", begun_s, amplitude, hz, took_s=time.monotonic() - begun_s)

    def _do_stop(self, asked: Mapping[str, Any]) -> None:
        self._stops = max(self._stops, round(_number(asked, "stops"))) if "stops" in asked else self._stops
        self._legs.clear()
        self._stops_now = True
        self._controller.stop()
        self._stops_now = False
        self._follower.stopped()

    def _refuse_unless_enabled(self, asked: Mapping[str, Any]) -> None:
        self._refuse_before_a_stop(asked)
        if not self._enabled:
            raise InputError("nothing moves before it is enabled: somebody must say so, and the interlock be closed")
        if not self._follower.angles_deg:
            raise InputError("no angles were read yet; ask again")

    def _refuse_before_a_stop(self, asked: Mapping[str, Any]) -> None:
        """Refuse a command that its owner decided on before a stop, and wrote after it."""
        if "stops" in asked and _number(asked, "stops") < self._stops:
            raise InputError("the table was stopped meanwhile")

    def end(self, why: str, *, is_error: bool, is_deaf: bool = False) -> None:
        """Stop the table, if it was enabled here, open its interlock, and report why.

        `is_deaf`: the controller's answers are lost, so that the stop asks for nothing.
        """
        begun_s = time.monotonic()
        stopped = "the table was not moved from here"
        if self._enabled:
            stopped = "it was stopped: rate zero, mode off" if self._stop(is_deaf) else _NOT_STOPPED
        said = f"{why} {stopped[0].upper()}{stopped[1:]}."
        self._say({"error": said, "ended": True} if is_error else {"said": said, "ended": True})
        with contextlib.suppress(TableError):
            if self._enabled and stopped != _NOT_STOPPED:
                self._controller.disable()
        with contextlib.suppress(TableError):
            self._controller.close()
        self._say({"ended_in_s": time.monotonic() - begun_s})

    def _stop(self, is_deaf: bool) -> bool:
        self._stops_now = True
        found = stop_for_certain(
            self._controller,
            self._connected,
            lambda said: self._say({"said": said}),
            self._follower.braking_s(),
            is_deaf=is_deaf,
        )
        self._controller = found or self._controller
        return found is not None

    def _connected(self, asks: bool) -> TableController:
        controller = self._connect(asks)
        controller.meanwhile = self._heed
        return controller


_COMMANDS: dict[str, Callable[[Keeper, Mapping[str, Any]], None]] = {
    name.removeprefix("_do_"): function for name, function in vars(Keeper).items() if name.startswith("_do_")
}
_NOT_STOPPED = (
    f"rate zero and mode off were sent, and the controller has NOT confirmed within {_PATIENCE_S:g} s that the table"
    " rests. Press its emergency stop"
)


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
    """Lines that the owner writes, `waiting` to be carried out; `signal` is one that asks the keeper to end."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._rest = b""
        self.waiting: deque[bytes] = deque()
        self.signal = ""
        self._since_s = time.monotonic()  # when the owner wrote last

    def look(self, wait_s: float) -> None:
        """Take lines that come within a time; raises OwnerGoneError at their end, or if none came for too long."""
        if select.select((self._descriptor,), (), (), wait_s)[0]:
            data = os.read(self._descriptor, _MOST)
            if not data:
                raise OwnerGoneError("the program that commanded the table has ended.")
            self._since_s = time.monotonic()
            *lines, self._rest = (self._rest + data).split(b"\n")
            self.waiting += [line for line in lines if line.strip()]
        elif time.monotonic() - self._since_s > SILENT_S:
            raise OwnerGoneError(f"the program that commanded the table has said nothing for {SILENT_S:g} s.")

    @property
    def stop_waits(self) -> bool:
        """True if a line or a signal that waits stops the table."""
        return bool(self.signal) or any(map(_stops, self.waiting))


def _stops(line: bytes) -> bool:
    try:
        return _read(line)["do"] in ("stop", "off")
    except InputError:  # it is refused when it is carried out
        return False


def writer(descriptor: int) -> Callable[[Told], None]:
    """What writes records as lines and never waits: an owner that does not read loses readings."""
    os.set_blocking(descriptor, False)

    def say(record: Told) -> None:
        # a line shorter than a pipe's unit of writing goes whole or not at all; one that has gone is told by its end
        with contextlib.suppress(BlockingIOError, BrokenPipeError):
            os.write(descriptor, json.dumps(record).encode() + b"\n")

    return say


def run(connect: Connect, given: Mapping[str, AxisLimits], speed: float = 1.0) -> int:
    """Keep a table until the owner or a signal ends it, or something is wrong; returns the process's exit code."""
    say, lines = writer(1), Lines(0)

    def ask_to_end(number: int, _: object) -> None:
        lines.signal = signal.Signals(number).name

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, ask_to_end)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        keeper = Keeper(connect, given, say, lines, speed)
    except TableError as error:
        say({"error": str(error), "ended": True})
        return 4
    try:
        _keep(keeper, lines, _POLL_S / speed)
    except TableError as error:
        keeper.end(str(error), is_error=True, is_deaf=isinstance(error, TableLinkError))
        return 4
    except OwnerGoneError as gone:
        keeper.end(str(gone), is_error=True)
        return 4
    except Exception as error:  # noqa: BLE001 - a defect of our own: whatever it is, the table must not turn on
        keeper.end(defects.told(error), is_error=True)
        return 4
    keeper.end(f"ended by {lines.signal}." if lines.signal else "ended as told.", is_error=bool(lines.signal))
    return 0


def _keep(keeper: Keeper, lines: Lines, poll_s: float) -> None:
    """Poll, and carry out lines, until one or a signal ends it."""
    while not lines.signal:
        due_s = time.monotonic() + poll_s
        with contextlib.suppress(StopAskedError):  # it is among the lines
            keeper.poll()
        lines.look(0.0 if lines.waiting else max(0.0, due_s - time.monotonic()))
        while lines.waiting:
            if not keeper.carry_out(lines.waiting.popleft()):
                return
