"""The keeper of a table, `python -m imutui.table.keeper URL [--limits TEXT]`: the one process that has the link.

Its owner (`owner`) starts it, writes commands to its stdin, and reads reports from its stdout (`messages`). The keeper
checks each command, and polls angles as fast as the link answers. It stops the table when the table does not follow a
command, the controller reports a fault, the link is lost, or its owner falls silent, ends or is killed.

A stop gets in between any two lines to the controller. The keeper sends it over its link and over new ones until the
controller confirms that the table rests; if none does, its last report asks for the emergency stop.
"""

import argparse
import contextlib
import os
import select
import signal
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from filters.errors import InputError
from imutui import defects
from imutui.table import acutrol, messages
from imutui.table.acutrol import Acutrol
from imutui.table.follower import Follower
from imutui.table.links import TableError, TableLinkError
from imutui.table.messages import Command, Report
from imutui.table.motion import OFF, Limits, Motion, Move, limits_of, narrower, parse_limits

SILENT_S = 1.0
"""The table is stopped when its owner has written nothing for so long."""
BRAKES_S = 3.0
"""Time for an axis to come to rest, where its rate is not known."""
_POLL_S = 1.0 / 200.0
_AGAIN_S, _PATIENCE_S = 0.5, 60.0
_ALIVE_S = 0.5  # between two reports while a command is carried out
_MOST = 1 << 16
_wait = time.sleep


class OwnerGoneError(Exception):
    """The owner, which could stop the table, has ended or is silent."""


class StopAskedError(Exception):
    """A stop waits to be carried out; the motion that is being sent is abandoned."""


Connect = Callable[[bool], Acutrol]
"""Connects to the controller; the argument is False if nothing may be asked before a stop."""


def stop_for_certain(
    controller: Acutrol | None,
    connect: Connect,
    tell: Callable[[str], None],
    brakes_s: float = BRAKES_S,
    *,
    is_deaf: bool = False,
) -> Acutrol | None:
    """Stop a table, over new links where the one at hand fails, for a minute.

    `controller`: the link at hand; None: there is none.
    `tell`: called with each failure, in words.
    `brakes_s`: time within which all axes come to rest.
    `is_deaf`: ask nothing over the link at hand either before the modes are off; over a new link that is always so.
    Returns the link over which the controller has confirmed that all axes rest with their modes off, or None.
    """
    until_s, said = time.monotonic() + _PATIENCE_S, ""
    while True:
        try:
            controller = controller or connect(False)
            controller.stop(brakes_s if is_deaf else None)
        except Exception as error:  # noqa: BLE001 - another link is tried next, whatever the error is
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

    `connect`: makes the link, and again if it is lost.
    `given`: limits that the operator gives.
    `say`: called with each report for the owner.
    `lines`: the owner's commands.
    Raises TableError if there is no controller.
    """

    def __init__(self, connect: Connect, given: Limits, say: Callable[[Report], None], lines: "Lines") -> None:
        self._connect, self._say, self._lines = connect, say, lines
        self._controller = controller = connect(True)
        identity = controller.identify()
        read = controller.limits()
        known = narrower(read, given)
        self.limits = {axis: known[axis] for axis in controller.axes if axis in known}
        wraps = [axis for axis, own in read.items() if not own.has_stops]
        self._follower = Follower(self.limits, wraps)
        self._legs: dict[str, deque[Motion]] = {}  # of each axis the leg that was commanded, and those still to come
        self._enabled = self._stops_now = False
        self._stops = 0  # how many the owner has asked for
        self._alive_s = time.monotonic()
        controller.meanwhile = self._heed
        say(Report(identity, controller.axes, self.limits))

    def _heed(self) -> None:
        """Look for a stop, and whether time runs out, while the controller is busy; raises what interrupts it."""
        if time.monotonic() - self._alive_s > _ALIVE_S:
            self._alive_s = time.monotonic()
            self._say(Report())
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
        outer, middle, inner = self._follower.angles_deg
        self._say(Report(state=replace(state, angles_deg=(outer, middle, inner))))
        if wrong and (self._enabled or self._follower.mode != OFF):
            raise TableError(f"{wrong}.")
        for legs in self._legs.values():
            if len(legs) > 1 and self._follower.has_passed(legs[0]):
                legs.popleft()
                self._start(legs[0])

    def carry_out(self, command: Command) -> bool:
        """Carry out a command, or report why it is refused; returns False if the keeper is to end.

        Raises TableError if the controller does not do it.
        """
        refused = ""
        try:
            match command.do:
                case "enable":
                    self._enable(command)
                case "go":
                    self._go(command)
                case "stop":
                    self._stop_now(command)
        except InputError as error:
            refused = str(error)
        except StopAskedError:
            refused = "the table is being stopped"
        if command.do not in ("beat", "off"):
            self._say(Report(to=command.number, refused=refused))
        return command.do != "off"

    def _enable(self, command: Command) -> None:
        self._refuse_before_a_stop(command)
        for axis in self._controller.axes:  # an axis without limits may not be there when others move
            limits_of(axis, self.limits)
        was, self._enabled = self._enabled, True  # from the first line on that is sent
        try:
            self._controller.enable()
        except InputError:
            self._enabled = was
            raise

    def _go(self, command: Command) -> None:
        self._refuse_before_a_stop(command)
        if not self._enabled:
            raise InputError("nothing moves before it is enabled: ask the user, then enable the table")
        if not self._follower.angles_deg:
            raise InputError("no angles were read yet; ask again")
        if len({motion.axis for motion in command.motions}) < len(command.motions):
            raise InputError("two motions are of one axis")
        for motion in command.motions:
            self._follower.check(motion)
        self._legs |= {motion.axis: deque(self._follower.legs(motion)) for motion in command.motions}
        for motion in command.motions:
            self._start(self._legs[motion.axis][0])

    def _start(self, motion: Motion) -> None:
        sent, begun_s = motion, time.monotonic()
        if isinstance(motion, Move) and not self.limits[motion.axis].has_stops:
            sent = replace(motion, angle_deg=motion.angle_deg % 360.0)
        self._controller.start(sent)
        self._follower.begin(motion, begun_s, time.monotonic() - begun_s)

    def _stop_now(self, command: Command) -> None:
        self._stops = max(self._stops, command.stops)
        self._legs.clear()
        self._stops_now = True
        self._controller.stop()
        self._stops_now = False
        self._follower.stopped()

    def _refuse_before_a_stop(self, command: Command) -> None:
        """Refuse a command that its owner decided on before a stop, and wrote after it."""
        if command.stops < self._stops:
            raise InputError("the table was stopped meanwhile")

    def end(self, why: str, *, is_error: bool, is_deaf: bool = False) -> None:
        """Stop the table, if it was enabled here, open its interlock, and report why.

        `is_deaf`: the controller's answers are lost, so that the stop asks for nothing.
        """
        stopped = "the table was not moved from here"
        if self._enabled:
            stopped = "it was stopped: rate zero, mode off" if self._stop(is_deaf) else _NOT_STOPPED
        said = f"{why} {stopped[0].upper()}{stopped[1:]}."
        self._say(Report(error=said if is_error else "", said="" if is_error else said, ended=True))
        with contextlib.suppress(TableError):
            if self._enabled and stopped != _NOT_STOPPED:
                self._controller.disable()
        with contextlib.suppress(TableError):
            self._controller.close()

    def _stop(self, is_deaf: bool) -> bool:
        self._stops_now = True
        found = stop_for_certain(
            self._controller,
            self._connected,
            lambda said: self._say(Report(said=said)),
            self._follower.braking_s(),
            is_deaf=is_deaf,
        )
        self._controller = found or self._controller
        return found is not None

    def _connected(self, asks: bool) -> Acutrol:
        controller = self._connect(asks)
        controller.meanwhile = self._heed
        return controller


_NOT_STOPPED = (
    f"rate zero and mode off were sent, and the controller has NOT confirmed within {_PATIENCE_S:g} s that the table"
    " rests. Press its emergency stop"
)


class Lines:
    """Commands from the owner, a line each, `waiting` to be carried out; `signal`: name of one that ends the keeper."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._rest = b""
        self.waiting: deque[Command] = deque()
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
            self.waiting += map(messages.command, lines)
        elif time.monotonic() - self._since_s > SILENT_S:
            raise OwnerGoneError(f"the program that commanded the table has said nothing for {SILENT_S:g} s.")

    @property
    def stop_waits(self) -> bool:
        """True if a command or a signal that waits stops the table."""
        return bool(self.signal) or any(each.do in ("stop", "off") for each in self.waiting)


def writer(descriptor: int) -> Callable[[Report], None]:
    """Return a function that writes reports as lines and never waits: an owner that does not read loses readings."""
    os.set_blocking(descriptor, False)

    def say(report: Report) -> None:
        # a line shorter than a pipe's unit of writing is written whole or not at all; stdin shows an owner's end
        with contextlib.suppress(BlockingIOError, BrokenPipeError):
            os.write(descriptor, messages.encode(report))

    return say


def main() -> int:
    """Keep the table at a URL until the owner or a signal ends it, or something is wrong; returns the exit code."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("url")
    asked.add_argument("--limits", default="")
    given = asked.parse_args()
    say, lines, keeper = writer(1), Lines(0), None

    def ask_to_end(number: int, _: object) -> None:
        lines.signal = signal.Signals(number).name

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, ask_to_end)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    is_error, is_deaf = True, False
    try:
        keeper = Keeper(lambda asks: acutrol.connect(given.url, asks=asks), parse_limits(given.limits), say, lines)
        _keep(keeper, lines)
        why, is_error = (f"ended by {lines.signal}." if lines.signal else "ended as told."), bool(lines.signal)
    except (InputError, TableError, OwnerGoneError) as error:
        why, is_deaf = str(error), isinstance(error, TableLinkError)
    except Exception as error:  # noqa: BLE001 - a defect of our own: whatever it is, the table must not turn on
        why = defects.told(error)
    if keeper is None:
        say(Report(error=why, ended=True))
    else:
        keeper.end(why, is_error=is_error, is_deaf=is_deaf)
    return 4 if is_error else 0


def _keep(keeper: Keeper, lines: Lines) -> None:
    """Poll, and carry out lines, until one or a signal ends it."""
    while not lines.signal:
        due_s = time.monotonic() + _POLL_S
        with contextlib.suppress(StopAskedError):  # it is among the lines
            keeper.poll()
        lines.look(0.0 if lines.waiting else max(0.0, due_s - time.monotonic()))
        while lines.waiting:
            if not keeper.carry_out(lines.waiting.popleft()):
                return


if __name__ == "__main__":
    sys.exit(main())
