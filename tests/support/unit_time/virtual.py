"""`imutui virtual` whose time goes on as soon as the host has read what was sent, instead of with the wall's clock.

    python virtual.py FOLDER [arguments of imutui virtual]

FOLDER has the clock, which the host's process reads (`host/sitecustomize.py`), and the pipe by which it acknowledges.
As long as nothing is due on the line, and just after a command, time passes as on the wall.
"""

import mmap
import os
import select
import struct
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from imutui import cli
from imutui.instrument import virtual
from imutui.instrument.pseudo_terminal import PseudoTerminal

# nothing is due for longer than any message takes: the unit waits for a command
_IDLE_S = 0.05
# a host that does not read (it flushes its queue, or is gone) is not waited for
_PATIENCE_S = 1.0
# after a command the host has other things to do than to read, and deadlines of its own
_AFTER_COMMAND_S = 1.5
# while the host reads one packet the next may be on its way
_ON_THE_WAY = 22


class UnitTime:
    """The unit's clock: what its loop takes for `time.monotonic` and `select.select`."""

    def __init__(self, folder: Path) -> None:
        with (folder / "clock").open("r+b") as file:
            # one store of eight bytes: nobody sees half of it, or the zero that struct.pack_into writes first
            self._shared = memoryview(mmap.mmap(file.fileno(), 8)).cast("q")
        self._read = os.open(folder / "read", os.O_RDWR | os.O_NONBLOCK)
        self._unread = 0
        self._now = 0.0
        self._as_on_the_wall_until = 0.0
        self._set(time.monotonic())

    def _set(self, now: float) -> None:
        self._now = now
        self._shared[0] = round(now * 1e9)

    def monotonic(self) -> float:
        """Time of the unit, s."""
        return self._now

    def sent(self, count: int) -> None:
        self._unread += count

    def select(self, r: list[Any], w: list[Any], x: list[Any], wait: float) -> tuple[list[Any], list[Any], list[Any]]:
        """Wait for a command for so long, of the unit's time."""
        began = time.monotonic()
        if wait > _IDLE_S or began < self._as_on_the_wall_until:
            ready = select.select(r, w, x, wait)
            now = time.monotonic()
            self._set(self._now + now - began)
            if ready[0]:
                self._as_on_the_wall_until = now + _AFTER_COMMAND_S
            return ready
        give_up = began + _PATIENCE_S
        while True:
            ready = select.select([*r, self._read], w, x, 0.0 if self._unread <= _ON_THE_WAY else 0.01)
            if self._read in ready[0]:
                data = os.read(self._read, 4096)
                # never below none: what was given up is read later, and would let the unit run ahead for good
                self._unread = max(0, self._unread - sum(n for (n,) in struct.iter_unpack("i", data)))
            commands = [item for item in ready[0] if item != self._read]
            if commands:
                self._as_on_the_wall_until = time.monotonic() + _AFTER_COMMAND_S
                return commands, ready[1], ready[2]
            if time.monotonic() > give_up:
                self._unread = 0
            if self._unread <= _ON_THE_WAY:
                self._set(self._now + wait)
                return [], [], []


def keep_time(folder: Path) -> None:
    """Replace the two clocks of the unit's loop in this process."""
    clock = UnitTime(folder)
    virtual.time = SimpleNamespace(monotonic=clock.monotonic)  # type: ignore[assignment]
    virtual.select = SimpleNamespace(select=clock.select)  # type: ignore[assignment]
    write = PseudoTerminal.write

    def counted(pty: Any, data: bytes) -> bytes:
        sent = write(pty, data)
        clock.sent(len(sent))
        return sent

    PseudoTerminal.write = counted  # type: ignore[method-assign]


def main() -> None:
    keep_time(Path(sys.argv.pop(1)))
    sys.argv.insert(1, "virtual")
    cli.main()


if __name__ == "__main__":
    main()
