"""A virtual IMU400CD on a pseudo-terminal: `unit.VirtualUnit` put on a line, with the time kept."""

import os
import select
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from filters.imu import LOOP_HZ
from imutui.instrument.crossbow import (
    AskSerialNumber,
    AskVersion,
    Command,
    GetPacket,
    MeasureBaud,
    Ping,
    RequestBaud,
    SetMode,
    StartStream,
    StopStream,
    UnknownCommand,
    ZeroRateSensors,
    encode,
)
from imutui.instrument.faults import FaultyLine, LineFault
from imutui.instrument.unit import Reading, Source, UnitOptions, VirtualUnit, same_speed, transfer_s

__all__ = [
    "LOOP_HZ",
    "FaultyLine",
    "LineFault",
    "Reading",
    "Source",
    "UnitOptions",
    "VirtualUnit",
    "in_words",
    "serve",
    "transfer_s",
]

# How late, in wall time, bytes may still leave when the process was held up; what is older is lost.
_BACKLOG_S = 1.0

# How often to look at `stop` when nothing else happens.
_LOOK_UP_S = 0.1

_BAUD_OF_TERMIOS = {
    getattr(termios, name): int(name[1:]) for name in dir(termios) if name[0] == "B" and name[1:].isdigit()
}


class _Pty:
    """The unit's end of a pseudo terminal, raw, at the power-up speed.

    Its other end is kept open here too: so the master never sees an I/O error when the host closes, and bytes that a
    host left unread wait for the next one.
    """

    def __init__(self, link: Path | None) -> None:
        self._link = link
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        attributes = termios.tcgetattr(self._slave)
        attributes[4] = attributes[5] = termios.B38400
        termios.tcsetattr(self._slave, termios.TCSANOW, attributes)
        os.set_blocking(self._master, False)
        self._device = os.ttyname(self._slave)

    def __enter__(self) -> Self:
        try:
            if self._link is not None:
                _point(self._link, self._device)
        except OSError:
            self._close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._link is not None and self._link.is_symlink() and str(self._link.readlink()) == self._device:
            self._link.unlink()
        self._close()

    def _close(self) -> None:
        os.close(self._master)
        os.close(self._slave)

    @property
    def name(self) -> str:
        return self._device

    def fileno(self) -> int:
        return self._master

    def host_baud(self) -> int:
        """Speed the host has set: both ends of a pty share it. 0 if it is none that termios names."""
        return _BAUD_OF_TERMIOS.get(termios.tcgetattr(self._master)[5], 0)

    def read(self) -> bytes:
        try:
            return os.read(self._master, 4096)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> bytes:
        """Write what fits into the host's queue, and return it; the rest is lost, as in a UART that overruns."""
        try:
            return data[: os.write(self._master, data)]
        except BlockingIOError:
            return b""


def _point(link: Path, target: str) -> None:
    """Make the symbolic link, in place of another one but of nothing else."""
    if link.is_symlink():
        link.unlink()
    elif link.exists():
        raise FileExistsError(f"{link} exists and is not a symbolic link; choose another name or remove it")
    link.symlink_to(target)


def serve(
    unit: VirtualUnit,
    *,
    link: Path | None,
    tap: BinaryIO | None,
    on_ready: Callable[[str], None],
    log: Callable[[str], None],
    speed: float = 1.0,
    while_stdin: bool = False,
    stop: threading.Event | None = None,
    line: FaultyLine | None = None,
) -> None:
    """Run a unit on a pseudo terminal until told to stop.

    Packets leave on the unit's own time grid: waking late delays bytes, never the ones after them.

    Parameters
    ----------
    unit : VirtualUnit
        The unit; its time begins now.
    link : Path or None
        Symbolic link to make to the terminal, removed at the end. Replaces a symbolic link, nothing else.
    tap : BinaryIO or None
        Where to copy exactly the bytes that reached the host's queue.
    on_ready : callable
        Called once with the port's name, when a host may open it.
    log : callable
        Called with a sentence for each command received.
    speed : float
        Unit time over wall time.
    while_stdin : bool
        Whether to end when standard input does.
    stop : threading.Event, optional
        Ends it within a tenth of a second; so does an exception, such as KeyboardInterrupt.
    line : FaultyLine, optional
        What happens to bytes between the unit and the terminal; nothing without it.

    Raises
    ------
    ValueError
        If `speed` is not positive.
    FileExistsError
        If `link` exists and is not a symbolic link.
    """
    if not speed > 0:
        raise ValueError(f"`speed` must be positive, not {speed}")
    with _Pty(link) as pty:
        on_ready(pty.name)
        began = time.monotonic()
        last = 0.0
        while stop is None or not stop.is_set():
            due = unit.next_event(last) if line is None else _sooner(unit.next_event(last), line.next_event())
            wait = _LOOK_UP_S if due is None else min(max(began + due / speed - time.monotonic(), 0.0), _LOOK_UP_S)
            readable, _, _ = select.select([pty, sys.stdin] if while_stdin else [pty], [], [], wait)
            if sys.stdin in readable and not os.read(sys.stdin.fileno(), 4096):
                return
            now = (time.monotonic() - began) * speed
            baud = pty.host_baud()
            if now - last > _BACKLOG_S * speed:
                unit.transmit(now - _BACKLOG_S * speed, baud)
            if line is not None:
                _carry(unit, line, last, now, baud)
            if pty in readable and _hear(unit, pty.read(), now, baud, log) and line is not None:
                line.started(now)
            _send(pty, unit.transmit(now, baud) if line is None else line.take(now), tap)
            last = now


def _sooner(a: float | None, b: float | None) -> float | None:
    return min((x for x in (a, b) if x is not None), default=None)


def _carry(unit: VirtualUnit, line: FaultyLine, last: float, now: float, baud: int) -> None:
    """Put what left the unit by `now` on the line, message by message: faults and losses are of whole ones."""
    while (left := unit.next_event(last)) is not None and left <= now:
        message = unit.transmit(left, baud)
        if not message:
            return  # the source has run out
        line.put(message, left - transfer_s(len(message), unit.baud), left)
        last = left


def _hear(unit: VirtualUnit, data: bytes, now: float, host_baud: int, log: Callable[[str], None]) -> bool:
    """Hand bytes to the unit and log what it understood; whether there was a request for data among it."""
    unit_baud = unit.baud
    commands = unit.receive(data, now, host_baud)
    for command in commands:
        log(in_words(command))
    if not commands and not same_speed(unit_baud, host_baud):
        log(f"line noise: {len(data)} bytes at {host_baud} baud, the unit is at {unit_baud}")
    return any(isinstance(command, GetPacket | StartStream | ZeroRateSensors) for command in commands)


def _send(pty: _Pty, data: bytes, tap: BinaryIO | None) -> None:
    sent = pty.write(data) if data else b""
    if tap is not None and sent:
        tap.write(sent)
        tap.flush()


def in_words(command: Command) -> str:
    """Say what a command asks for.

    Parameters
    ----------
    command : Command
        As received.

    Returns
    -------
    str
        Such as ``c: scaled mode``.
    """
    letter = ascii(encode(command)[:1].decode("latin-1"))[1:-1]
    match command:
        case Ping():
            meaning = "ping"
        case SetMode(mode):
            meaning = f"{mode.value} mode"
        case StopStream():
            meaning = "stop, polled mode"
        case StartStream():
            meaning = "stream, continuous mode"
        case GetPacket():
            meaning = "one packet"
        case AskSerialNumber():
            meaning = "serial number"
        case AskVersion():
            meaning = "version"
        case ZeroRateSensors(argument):
            meaning = f"zero the rate sensors, argument {argument}"
        case RequestBaud():
            meaning = "change of baud rate announced"
        case MeasureBaud():
            meaning = "measure the baud rate"
        case UnknownCommand(byte):
            meaning = f"unknown command 0x{byte:02x}, ignored"
    return f"{letter}: {meaning}"
