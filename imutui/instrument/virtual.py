"""A virtual unit on a pseudo-terminal: a unit and its line (`wire.Wire`) with the time kept."""

import os
import select
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, Generic, TextIO

from imutui.instrument.faults import FaultyLine
from imutui.instrument.pseudo_terminal import PseudoTerminal
from imutui.instrument.transmitter import same_speed
from imutui.instrument.virtual_instrument import CommandT, PacketT, VirtualInstrument
from imutui.instrument.wire import Wire

# How late, in wall time, bytes may still leave a plain line when the process was held up; what is older is lost.
_BACKLOG_S = 1.0

# How often to look at `stop` when nothing else happens, and how often at a host's full queue.
_LOOK_UP_S = 0.1
_LOOK_AT_QUEUE_S = 0.002

# What a line with faults keeps of a burst until the host has read it: half a minute of packets.
_BURST_BYTES = 65536


def serve(
    unit: VirtualInstrument[PacketT, CommandT],
    *,
    link: Path | None,
    tap: BinaryIO | None,
    on_ready: Callable[[str], None],
    log: Callable[[str], None],
    speed: float = 1.0,
    while_stdin: bool = False,
    stop: threading.Event | None = None,
    line: FaultyLine | None = None,
    on_packet: Callable[[PacketT, int], None] | None = None,
    began: float | None = None,
    on_idle: Callable[[float], None] | None = None,
) -> None:
    """Run a unit on a pseudo-terminal until told to stop.

    Packets leave on the unit's own time grid: waking late delays bytes, never the ones after them.

    `unit`: the unit; its time begins now.
    `link`: symbolic link to make to the terminal, removed at the end. Replaces a symbolic link, nothing else.
    `tap`: where to copy exactly the bytes that reached the host's queue. What of them a host had not read when the port
      hung up is taken away again.
    `on_ready`: called once with the port's name, when a host may open it.
    `log`: called with a sentence for each command received, and when the port goes and comes.
    `speed`: unit time over wall time.
    `while_stdin`: whether to end when standard input does.
    `stop`: ends it within a tenth of a second; so does an exception, such as KeyboardInterrupt.
    `line`: what happens to bytes between the unit and the terminal, and when unit and port have faults; nothing without
      it. With it nothing else is lost: what does not fit into the host's queue waits, up to 64 KiB.
    `on_packet`: called with each packet that the unit begins to send, and the host's monotonic time when it was
      sampled, ns.
    `began`: when the unit's time began, where that is not now: the host's monotonic time, s.
    `on_idle`: called while nothing is asked of the unit, with the time of its readings, s.
    Raises ValueError if `speed` is not positive.
    Raises FileExistsError if `link` exists and is not a symbolic link.
    """
    if not speed > 0:
        raise ValueError(f"`speed` must be positive, not {speed}")
    with PseudoTerminal(link) as pty:
        on_ready(pty.name)
        began = time.monotonic() if began is None else began
        told = None if on_packet is None else _on_the_hosts_clock(on_packet, began)
        wire = Wire(unit, line, speed, told)
        queue = _Queue(pty, tap, 0 if line is None else _BURST_BYTES)
        last, away = 0.0, False
        while stop is None or not stop.is_set():
            due = min(wire.next_event() or last + _LOOK_UP_S, wire.next_port_change(last))
            wait = min(max(began + due - time.monotonic(), 0.0), _LOOK_AT_QUEUE_S if queue.full else _LOOK_UP_S)
            readable, _, _ = select.select([pty, sys.stdin] if while_stdin else [pty], [], [], wait)
            if sys.stdin in readable and not os.read(sys.stdin.fileno(), 4096):
                return
            # never beyond what happens to the port, so that each byte meets the port that there was
            now = min(time.monotonic() - began, wire.next_port_change(last))
            pty.release()
            baud = pty.host_baud()
            if line is None and now - last > _BACKLOG_S:
                wire.forget(now - _BACKLOG_S, baud)
            if pty in readable:
                _hear(unit, wire, pty.read(), now, baud, log)
            queue.put(wire.arrived(now, baud))
            if on_idle is not None and unit.data_asked_for and wire.next_event() is None:
                on_idle(now * speed - unit.source_begins)
            if wire.is_away(now) is not away:
                away = not away
                log(queue.hang_up() if away else _back(pty))
            last = now


def _on_the_hosts_clock(on_packet: Callable[[PacketT, int], None], began: float) -> Callable[[PacketT, float], None]:
    return lambda packet, instant: on_packet(packet, round((began + instant) * 1e9))


class _Queue:
    """What has arrived for the host and did not fit into its queue.

    Up to `most` bytes wait; what is more is lost, as in a UART that overruns.
    """

    def __init__(self, pty: PseudoTerminal, tap: BinaryIO | None, most: int) -> None:
        self._pty = pty
        self._tap = tap
        self._most = most
        self._waiting = b""

    @property
    def full(self) -> bool:
        """Whether something waits."""
        return bool(self._waiting)

    def put(self, data: bytes) -> None:
        data = self._waiting + data
        sent = self._pty.write(data) if data else b""
        self._waiting = data[len(sent) : len(sent) + self._most]
        if self._tap is not None and sent:
            self._tap.write(sent)
            self._tap.flush()

    def hang_up(self) -> str:
        """Hang up: what waits is lost, and what the host has not read. In words."""
        name, self._waiting = self._pty.name, b""
        unread = self._pty.hang_up()
        if self._tap is not None and unread and self._tap.seekable():
            self._tap.seek(-unread, os.SEEK_END)
            self._tap.truncate()
        return f"hang-up: {name} is gone, with {unread} bytes unread"


def _back(pty: PseudoTerminal) -> str:
    pty.show()
    return f"back: the port is {pty.name} now"


def _hear(
    unit: VirtualInstrument[PacketT, CommandT],
    wire: Wire[PacketT, CommandT],
    data: bytes,
    now: float,
    host_baud: int,
    log: Callable[[str], None],
) -> None:
    """Hand bytes to the unit and log what it understood."""
    unit_baud = unit.baud
    commands = wire.receive(data, now, host_baud)
    for command in commands:
        log(unit.in_words(command))
    if not commands and not same_speed(unit_baud, host_baud):
        log(f"line noise: {len(data)} bytes at {host_baud} baud, the unit is at {unit_baud}")


class SentPackets(Generic[PacketT, CommandT]):
    """The truth about a unit's stream, as CSV: a row for each packet, in the order in which the unit began them.

    `file`: where to write. Rows are whole, and there at once.
    `unit`: knows what its packets are.
    """

    def __init__(self, file: TextIO, unit: VirtualInstrument[PacketT, CommandT]) -> None:
        self._file = file
        self._unit = unit
        self._write("sampled_monotonic_ns,mode,ticks,frame")

    def __call__(self, packet: PacketT, sampled_ns: int) -> None:
        """Add a packet and the host's monotonic time when it was sampled, ns."""
        mode, ticks, frame = self._unit.in_columns(packet)
        self._write(f"{sampled_ns},{mode},{ticks},{frame.hex()}")

    def _write(self, row: str) -> None:
        self._file.write(row + "\n")
        self._file.flush()
