"""Devices that misbehave, each on a pseudo-terminal of its own, and commands that run apart from one another.

Bytes are written down here from the maker's command table, apart from the program's own codec.
"""

import fcntl
import os
import select
import struct
import subprocess
import termios
import threading
import time
import tty
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from helpers.places import variables_of
from helpers.processes import LIMIT_S, command_line

IMU400CD = "IMU400CD-200 VER 1.0"
PERIOD_S = 0.0075
TICKS_A_PERIOD = 9494


def framed(payload: bytes) -> bytes:
    """Header, payload, and the sum of the payload's bytes modulo 256."""
    return b"\xff" + payload + bytes([sum(payload) % 256])


def packet(number: int) -> bytes:
    """Packet of a still, level unit in scaled mode: +1 g on Z, counter running down."""
    words = struct.pack(">6hHH", 0, 0, 0, 0, 0, 5450, 1587, -number * TICKS_A_PERIOD % 65536)
    return framed(words)


def answers(version: str = IMU400CD, **changes: bytes) -> dict[bytes, bytes]:
    """What a good unit says to each letter, but for changes; an empty reply is silence."""
    replies = {"R": b"H", "c": b"C", "r": b"R", "S": framed(bytes.fromhex("00973dc6")), "v": framed(version.encode())}
    return {letter.encode(): reply for letter, reply in (replies | changes).items()}


@dataclass(frozen=True, slots=True)
class Habits:
    """How a device behaves."""

    replies: Mapping[bytes, bytes] = field(default_factory=dict)  # from letter to reply
    echo: bool = False  # whether it returns what it hears instead
    chatter: Callable[[], bytes] | None = None  # what it says by itself, asked for some thirty times a second
    streams: int | None = 0  # packets it streams on `C` before it hangs up; None streams until it is told to stop
    hangs_up_at: bytes = b""  # letter at which it goes away


class Device:
    """A device with these habits on a pseudo-terminal; use it in a `with`.

    `port`: path to connect to.
    `heard`: everything it was told.
    """

    def __init__(self, habits: Habits) -> None:
        self.heard = bytearray()
        self._habits = habits
        self._held = threading.Event()
        self._asked = threading.Event()
        self._end = threading.Event()
        self._hold_at = b""
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._held.set()
        self._thread.join(LIMIT_S)
        os.close(self._master)
        if self._slave >= 0:
            os.close(self._slave)

    def hold(self, letter: bytes) -> None:
        """Do not answer that letter before `release`."""
        self._hold_at = letter

    def wait_until_held(self, timeout: float = 60.0) -> None:
        """Wait until the letter to hold at was sent."""
        assert self._asked.wait(timeout), f"{self._hold_at!r} was not sent; heard {bytes(self.heard)!r}"

    def release(self) -> None:
        self._held.set()

    def _serve(self) -> None:
        streaming, number, due = False, 0, 0.0
        while not self._end.is_set():
            wait = 0.03 if self._habits.chatter else max(0.0, due - time.monotonic()) if streaming else 0.05
            readable, _, _ = select.select([self._master], [], [], min(wait, 0.05))
            for letter in self._read() if readable else ():
                if letter == self._habits.hangs_up_at:
                    return self._hang_up()
                streaming = (letter == b"C" and self._habits.streams != 0) or (streaming and letter not in (b"P", b"G"))
                due = max(due, time.monotonic())
                self._answer(letter)
            if self._habits.chatter:
                self._say(self._habits.chatter())
            while streaming and time.monotonic() >= due:
                self._say(packet(number))
                number, due = number + 1, due + PERIOD_S
                if number == self._habits.streams:
                    return self._hang_up()
        return None

    def _read(self) -> list[bytes]:
        try:
            data = os.read(self._master, 4096)
        except BlockingIOError:
            return []
        self.heard += data
        return [bytes([byte]) for byte in data]

    def _answer(self, letter: bytes) -> None:
        if letter == self._hold_at and not self._held.is_set():
            self._asked.set()
            self._held.wait(LIMIT_S)
        if self._habits.echo:
            self._say(letter)
        self._say(self._habits.replies.get(letter, b""))

    def _say(self, data: bytes) -> None:
        try:
            os.write(self._master, data)
        except BlockingIOError:
            return  # nobody reads: lost, as in a UART

    def _hang_up(self) -> None:
        """Leave as an unplugged adapter does: the host's end reports it at once."""
        self._wait_until_read()
        os.close(self._slave)
        self._slave = -1
        spare = os.open(os.devnull, os.O_RDWR)
        os.dup2(spare, self._master)
        os.close(spare)

    def _wait_until_read(self) -> None:
        """What a host on a busy machine has not read yet would go with the pseudo-terminal."""
        empty, deadline = 0, time.monotonic() + 10.0
        while empty < 5 and time.monotonic() < deadline:
            waiting = struct.unpack("i", fcntl.ioctl(self._slave, termios.FIONREAD, bytes(4)))[0]
            empty = 0 if waiting else empty + 1
            time.sleep(0.01)


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a command ended."""

    code: int
    stdout: str
    stderr: str
    folder: Path


def command(name: str, *arguments: str) -> list[str]:
    return command_line(name, *arguments)


def record(folder: Path, port: str, *arguments: str) -> Outcome:
    """Run `imutui record --json` there."""
    done = subprocess.run(
        command("record", "--port", port, "--json", *arguments),
        cwd=folder,
        env=os.environ | variables_of(folder),
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=LIMIT_S,
        check=False,
    )
    return Outcome(done.returncode, done.stdout, done.stderr, folder)


def error_of(outcome: Outcome) -> str:
    """The error's paragraph, after what every error has was checked."""
    assert "Traceback" not in outcome.stderr
    assert outcome.stdout == ""
    *before, last = outcome.stderr.splitlines()
    assert all(line.startswith("acquisition ") for line in before), outcome.stderr
    assert last.startswith("imutui: "), outcome.stderr
    return last
