"""The application in a terminal of its own, as a process."""

import contextlib
import os
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from fcntl import ioctl
from pathlib import Path

import pyte
from helpers.paths import ROOT
from helpers.processes import LIMIT_S

_PROGRAM = """
import sys
from helpers.fake_client import FakeClient
from imutui.tui.app import run
sys.exit(run(FakeClient()))
"""
_PLAIN = """
from imutui.tui.terminal import textual_private
textual_private.HIDDEN |= {*textual_private.DRAWING, *textual_private.MEASURING, "_color_system"}
"""


class Terminal:
    """A program in an 80×24 terminal."""

    def __init__(self, before: str = "", **environ: str) -> None:
        self._screen = pyte.Screen(80, 24)
        self._stream = pyte.ByteStream(self._screen)
        self.raw = b""
        self._master, slave = pty.openpty()
        ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self.modes = termios.tcgetattr(slave)
        self._slave = slave
        env = {**os.environ, "TERM": "xterm-256color", **environ}
        self.process = subprocess.Popen(
            [sys.executable, "-c", before + _PROGRAM],
            cwd=ROOT / "tests" / "support", env=env, stdin=slave, stdout=slave, stderr=slave, start_new_session=True,
        )  # fmt: skip

    def read_until(self, text: str, timeout: float = 20.0) -> str:
        """Read until the screen shows a text; returns the screen."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            shown = "\n".join(self._screen.display)
            if text in shown:
                return shown
            if select.select([self._master], [], [], 0.1)[0]:
                data = os.read(self._master, 65536)
                self.raw += data
                self._stream.feed(data)
        raise AssertionError("\n".join(self._screen.display))

    def freeze(self, seconds: float) -> None:
        """Read nothing for a time that somebody has stopped the output."""
        asleep = time.monotonic()
        while time.monotonic() - asleep < seconds:
            select.select([], [], [], 0.5)

    def press(self, keys: bytes) -> None:
        """Type."""
        os.write(self._master, keys)

    def modes_now(self) -> list[object]:
        """Line settings, to compare with those of the beginning."""
        return termios.tcgetattr(self._slave)

    def close(self) -> None:
        """End what is left."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(LIMIT_S)
        os.close(self._master)
        os.close(self._slave)


def test_the_terminal_is_as_before_after_detaching() -> None:
    """Main screen, line settings and exit code are right, and the way back is printed where it stays."""
    terminal = Terminal(NO_COLOR="1")
    try:
        terminal.read_until("asked 20 measured")
        terminal.press(b"d")
        terminal.read_until("Come back: imutui attach")
        assert terminal.process.wait(10.0) == 0
        assert terminal.raw.rindex(b"\x1b[?1049l") < terminal.raw.rindex(b"Come back")
        assert terminal.modes_now() == terminal.modes
    finally:
        terminal.close()


def test_without_textuals_private_names_the_screen_is_drawn_plainly() -> None:
    """Another page, the next data and the end of it: all as Textual itself sends it."""
    terminal = Terminal(_PLAIN)
    try:
        terminal.read_until("asked 20 measured")
        terminal.press(b"4")
        terminal.read_until("x gyro")
        terminal.press(b"2")
        terminal.read_until("gyro, deg/s")
        terminal.press(b"d")
        terminal.read_until("Come back: imutui attach")
        assert terminal.process.wait(10.0) == 0
        assert terminal.modes_now() == terminal.modes
    finally:
        terminal.close()


def test_the_linux_console_gets_blocks_and_sixteen_colours() -> None:
    """No braille and no other colours than its font and palette have."""
    terminal = Terminal(TERM="linux")
    try:
        screen = terminal.read_until("asked 20 measured")
        assert "SIMULATED" in screen
        assert "█" in screen
        assert not any("\u2800" < sign < "\u2900" for sign in screen)
        assert b"38;2;" not in terminal.raw
        assert b"38;5;" not in terminal.raw
    finally:
        terminal.close()


def _ends_within(process: "subprocess.Popen[bytes]", seconds: float) -> bool:
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        return False
    return True


def _processor_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def test_the_ui_leaves_with_its_terminal() -> None:
    """A terminal that is gone is noticed by itself, without a signal; nothing is left that reads its end for ever."""
    terminal = Terminal()
    try:
        terminal.read_until("asked 20 measured")
        before = _processor_s(terminal.process.pid)
        os.close(terminal._slave)
        os.close(terminal._master)
        while terminal.process.poll() is None and _processor_s(terminal.process.pid) - before < 3.0:
            _ends_within(terminal.process, 0.1)
        assert terminal.process.poll() is not None, "it spins"
    finally:
        terminal._master, terminal._slave = os.open(os.devnull, os.O_RDWR), os.open(os.devnull, os.O_RDWR)
        terminal.close()


def test_a_hangup_signal_ends_the_ui_in_order() -> None:
    """SIGHUP is no crash: the terminal is left as it was."""
    terminal = Terminal()
    try:
        terminal.read_until("asked 20 measured")
        terminal.process.send_signal(signal.SIGHUP)
        terminal.read_until("", 1.0)
        assert _ends_within(terminal.process, 20.0)
        assert terminal.process.returncode == 0
        assert terminal.modes_now() == terminal.modes
    finally:
        terminal.close()


def test_a_frozen_terminal_neither_stops_the_ui_nor_is_sent_old_frames() -> None:
    """While nobody reads, frames are left out; read again, the terminal gets a new one, less of it, and is told why."""
    terminal = Terminal()
    try:
        terminal.read_until("scroll, autoscale")
        terminal.press(b"\x1b[?2026;2$y")
        # how long it takes to fill what the kernel holds depends on how much is drawn
        for seconds in (4.0, 8.0, 16.0, 32.0):
            terminal.freeze(seconds)
            with contextlib.suppress(AssertionError):
                terminal.read_until("link is slow", timeout=5.0)
                break
        terminal.read_until("link is slow")
        terminal.press(b"d")
        terminal.read_until("Come back: imutui attach")
        assert terminal.process.wait(10.0) == 0
    finally:
        terminal.close()
