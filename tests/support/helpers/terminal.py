"""A program in a terminal of its own, whose other end is a test's: read or not, typed into, hung up."""

import fcntl
import os
import pty
import select
import signal
import struct
import subprocess
import termios
import time
from functools import partial
from pathlib import Path

import pyte

from helpers.processes import LIMIT_S

PATIENCE_S = 60.0
_ASKS_FOR_SYNCHRONISED, _IT_IS_SYNCHRONISED = b"\x1b[?2026$p", b"\x1b[?2026;2$y"


class Terminal:
    """A program in a terminal that is read by whoever waits for something on it.

    `size`: columns and rows.
    `cwd`: where it runs.
    `synchronised`: whether the terminal says that it has synchronised updates.
    `controlling`: whether it is the program's controlling terminal, as a shell needs it that stops and resumes its
      jobs.
    `**environ`: variables that the program gets beside this process's.
    `raw`: all that was read so far.
    `modes`: line settings of the beginning.
    """

    def __init__(
        self,
        command: list[str],
        size: tuple[int, int] = (80, 24),
        cwd: Path | None = None,
        *,
        synchronised: bool = False,
        controlling: bool = False,
        **environ: str,
    ) -> None:
        self._screen = pyte.Screen(*size)
        self._stream = pyte.ByteStream(self._screen)
        self._synchronised = synchronised
        self.raw = b""
        self._master, self._slave = pty.openpty()
        fcntl.ioctl(self._slave, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))
        self.modes = termios.tcgetattr(self._slave)
        streams = {"stdin": self._slave, "stdout": self._slave, "stderr": self._slave}
        env = {**os.environ, "TERM": "xterm-256color", **environ}
        take = partial(fcntl.ioctl, self._slave, termios.TIOCSCTTY, 0) if controlling else None
        self.process = subprocess.Popen(command, cwd=cwd, env=env, start_new_session=True, preexec_fn=take, **streams)

    def shown(self) -> str:
        """What was on the screen when it was last read."""
        return "\n".join(self._screen.display)

    def read_until(self, *texts: str, timeout: float = PATIENCE_S) -> str:
        """Read until the screen shows all these texts at once; returns the screen."""
        deadline = time.monotonic() + timeout
        while not all(text in self.shown() for text in texts):
            assert time.monotonic() < deadline, self.shown()
            self._read(0.1)
        return self.shown()

    def read_until_sent(self, sequence: bytes) -> None:
        """Forget what was read, and read until the program sends this."""
        self.raw = b""
        deadline = time.monotonic() + PATIENCE_S
        while sequence not in self.raw:
            assert time.monotonic() < deadline, f"{sequence!r} did not come:\n{self.shown()}"
            self._read(0.1)

    def read_for(self, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            self._read(left)

    def drain(self, seconds: float) -> None:
        """Read for so long without looking, which costs less; what the screen shows is not known any more."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            self._read(left, look=False)

    def _read(self, wait: float, *, look: bool = True) -> None:
        if select.select([self._master], [], [], wait)[0]:
            data = os.read(self._master, 65536)
            if self._synchronised and _ASKS_FOR_SYNCHRONISED in data:
                os.write(self._master, _IT_IS_SYNCHRONISED)
            if look:
                self.raw += data
                self._stream.feed(data)

    def freeze(self, seconds: float) -> None:
        """Read nothing for a time that somebody has stopped the output."""
        asleep = time.monotonic()
        while time.monotonic() - asleep < seconds:
            select.select([], [], [], 0.1)

    def press(self, keys: bytes) -> None:
        os.write(self._master, keys)

    def modes_now(self) -> list[object]:
        """Line settings, to compare with those of the beginning."""
        return termios.tcgetattr(self._slave)

    def hang_up(self) -> None:
        """Let the terminal go, as a window that is closed or a link that is cut; returns once nobody holds it."""
        for descriptor in (self._slave, self._master):
            os.close(descriptor)
        self._master = self._slave = -1

    def close(self) -> None:
        """End what is left."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGKILL)
        self.process.wait(LIMIT_S)
        if self._master >= 0:
            self.hang_up()
