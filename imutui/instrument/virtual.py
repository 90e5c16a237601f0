"""A virtual unit on a pseudo-terminal: the unit, its line with the faults of a scenario, and the time kept."""

import math
import os
import select
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, BinaryIO, Generic, TextIO

import numpy as np

from imutui.instrument.pseudo_terminal import PseudoTerminal
from imutui.instrument.transmitter import SAME_INSTANT_S, same_speed, transfer_s
from imutui.instrument.virtual_instrument import CommandT, PacketT, VirtualInstrument

BURST_BYTES = 65536
"""Bytes of a line with faults that wait while the host's queue is full: half a minute of packets."""

# How late bytes may still leave a plain line when the process was held up; older ones are lost.
_BACKLOG_S = 1.0

# How often to look at `stop` when nothing else happens, and how often at a host's full queue.
_LOOK_UP_S = 0.1
_LOOK_AT_QUEUE_S = 0.002


class Line:
    """Carries bytes from a unit to its host, and spoils or loses some. No clock and no I/O.

    `faults`: records as `filters.simulation.Fault`, in any order.
    `fate`: returns for a packet that was measured at a time since the first request whether it is lost, and how late
      it arrives, s.
    `seed`: of garbage, and of the bits that are turned.
    """

    def __init__(
        self,
        faults: Sequence[Any] = (),
        fate: Callable[[float], tuple[bool, float]] | None = None,
        seed: int = 0,
    ) -> None:
        self._pending = deque(sorted(faults, key=lambda fault: fault.at))
        self._fate = fate
        self._rng = np.random.default_rng(seed)
        self._start = math.inf
        self._to_drop = self._to_flip = 0
        self._garbage = b""
        self._silent_until = -math.inf
        self._arriving: deque[tuple[float, bytes]] = deque()

    def start(self, now: float) -> None:
        """Begin the time of the faults, if it has not begun."""
        self._start = min(self._start, now)

    def put(self, message: bytes, sent: float, left: float, *, packet_bytes: int) -> None:
        """Take a message whose first bit left the unit at `sent`, its last at `left`; packets have `packet_bytes`."""
        lost, late = False, 0.0
        if self._fate is not None and len(message) == packet_bytes and sent >= self._start:
            lost, late = self._fate(sent - self._start)
        while self._pending and self._start + self._pending[0].at <= left:
            self._begin(self._pending.popleft())
        self._deliver(self._spoiled(b"" if lost else message, left), sent, left, max(late, 0.0))

    def take(self, now: float) -> bytes:
        """Return the bytes that have arrived by `now`, each once."""
        out = b""
        while self._arriving and self._arriving[0][0] <= now:
            out += self._arriving.popleft()[1]
        return out

    def next_event(self) -> float:
        """Return when bytes that have left the unit will next arrive; infinite if there are none."""
        return self._arriving[0][0] if self._arriving else math.inf

    def _begin(self, fault: Any) -> None:
        match fault.kind:
            case "drop_bytes":
                self._to_drop += fault.count
            case "bit_flips":
                self._to_flip += fault.count
            case "garbage":
                self._garbage += self._rng.bytes(fault.count)
            case "silence":
                self._silent_until = max(self._silent_until, self._start + fault.at + fault.seconds)

    def _spoiled(self, message: bytes, left: float) -> bytes:
        before, self._garbage = self._garbage, b""
        if left < self._silent_until:
            return b""
        dropped = min(self._to_drop, len(message))
        self._to_drop -= dropped
        message = message[dropped:]
        if self._to_flip and message:
            self._to_flip -= 1
            place, bit = int(self._rng.integers(len(message))), int(self._rng.integers(8))
            message = message[:place] + bytes([message[place] ^ (1 << bit)]) + message[place + 1 :]
        return before + message

    def _deliver(self, data: bytes, sent: float, left: float, late: float) -> None:
        self._arrive(data, left + late)

    def _arrive(self, data: bytes, at: float) -> None:
        if self._arriving:
            at = max(at, self._arriving[-1][0])  # bytes do not overtake
        if data:
            self._arriving.append((at, data))


class Wire(Generic[PacketT, CommandT]):
    """A unit and its line, on the host's monotonic time, s. No I/O.

    The unit's own time is the host's, faster by `speed` and by the skew of the unit's clock.

    `unit`: at its time 0.
    `line`: a plain one without it.
    `speed`: unit time over the host's.
    `on_packet`: called with every packet that the unit begins to send, and the host's time when it was sampled, s.
    `began`: the host's time at the unit's time 0; now without it.
    """

    def __init__(
        self,
        unit: VirtualInstrument[PacketT, CommandT],
        line: Line | None = None,
        speed: float = 1.0,
        on_packet: Callable[[PacketT, float], None] | None = None,
        began: float | None = None,
    ) -> None:
        self.unit = unit
        self._line = Line() if line is None else line
        self._rate = speed * (1.0 + unit.options.clock_skew_ppm * 1e-6)
        self._began = time.monotonic() if began is None else began
        self._now = 0.0  # the unit's
        if on_packet is not None:
            unit.on_packet = lambda packet, instant: on_packet(packet, self._began + instant / self._rate)

    def receive(self, data: bytes, now: float, host_baud: int) -> list[CommandT]:
        """Take bytes from the host, all arrived by `now`; return the commands that the unit understood."""
        self._carry(now, host_baud)
        commands = self.unit.receive(data, self._at(now), host_baud)
        if self.unit.data_asked_for:
            self._line.start(self._at(now))
        return commands

    def arrived(self, now: float, host_baud: int) -> bytes:
        """Return the bytes that have reached a host at this speed by `now`, each once."""
        self._carry(now, host_baud)
        return self._line.take(self._at(now))

    def forget(self, before: float, host_baud: int) -> None:
        """Lose the bytes that left the unit before a time, for a host that was held up too long."""
        self.unit.transmit(self._at(before), host_baud)

    def next_event(self) -> float:
        """Return when bytes will next arrive or leave; infinite if there are none until the next command."""
        return self._began + self._next_event() / self._rate

    def source_s(self, now: float) -> float | None:
        """Return the time of the unit's readings while nothing is asked of it, s; None before and meanwhile."""
        idle = self.unit.data_asked_for and self._next_event() == math.inf
        return self._at(now) - self.unit.source_begins if idle else None

    def _next_event(self) -> float:
        left = self.unit.next_event(self._now)
        return min(math.inf if left is None else left, self._line.next_event())

    def _at(self, now: float) -> float:
        """Return the unit's time; just after it, so that no rounding makes it come before what is due then."""
        return (now - self._began) * self._rate + SAME_INSTANT_S

    def _carry(self, now: float, host_baud: int) -> None:
        """Put what has left the unit on the line, message by message: faults and losses are of whole ones."""
        until = self._at(now)
        while (left := self.unit.next_event(self._now)) is not None and left <= until:
            self._put(left, host_baud)
        self._now = max(self._now, until)

    def _put(self, left: float, host_baud: int) -> None:
        message = self.unit.transmit(left, host_baud)
        sent = left - transfer_s(len(message), self.unit.baud)
        self._line.put(message, sent, left, packet_bytes=self.unit.packet_bytes)
        self._now = max(self._now, left)


def serve(
    wire: Wire[PacketT, CommandT],
    pty: PseudoTerminal,
    *,
    log: Callable[[str], None],
    tap: BinaryIO | None = None,
    stop: threading.Event | None = None,
    while_stdin: bool = False,
    burst_bytes: int = 0,
    on_idle: Callable[[float], None] | None = None,
) -> None:
    """Run a unit on a pseudo-terminal until `stop`.

    Packets leave on the unit's own time grid: waking late delays bytes, never the ones after them.

    `log`: called with a sentence for each command received.
    `tap`: receives a copy of exactly the bytes that reached the host's queue.
    `stop`: ends it within a tenth of a second; so does an exception, such as KeyboardInterrupt.
    `while_stdin`: True to end when standard input does.
    `burst_bytes`: bytes that wait while the host's queue is full, whatever their age. What is more is lost, as in a
      UART that overruns; of a plain line also what is older than a second.
    `on_idle`: called while nothing is asked of the unit, with the time of its readings, s.
    """
    last, waiting = time.monotonic(), b""
    while stop is None or not stop.is_set():
        due = min(wire.next_event(), last + _LOOK_UP_S)
        wait = min(max(due - time.monotonic(), 0.0), _LOOK_AT_QUEUE_S if waiting else _LOOK_UP_S)
        readable, _, _ = select.select([pty, sys.stdin] if while_stdin else [pty], [], [], wait)
        if sys.stdin in readable and not os.read(sys.stdin.fileno(), 4096):
            return
        now = time.monotonic()
        pty.release()
        baud = pty.host_baud()
        if not burst_bytes and now - last > _BACKLOG_S:
            wire.forget(now - _BACKLOG_S, baud)
        if pty in readable:
            _hear(wire, pty.read(), now, baud, log)
        waiting += wire.arrived(now, baud)
        sent = pty.write(waiting) if waiting else b""
        waiting = waiting[len(sent) : len(sent) + burst_bytes]
        if tap is not None and sent:
            tap.write(sent)
            tap.flush()
        if on_idle is not None and (source_s := wire.source_s(now)) is not None:
            on_idle(source_s)
        last = now


def _hear(wire: Wire[PacketT, CommandT], data: bytes, now: float, host_baud: int, log: Callable[[str], None]) -> None:
    """Hand bytes to the unit and log the commands that it understood."""
    unit_baud = wire.unit.baud
    commands = wire.receive(data, now, host_baud)
    for command in commands:
        log(wire.unit.in_words(command))
    if not commands and not same_speed(unit_baud, host_baud):
        log(f"line noise: {len(data)} bytes at {host_baud} baud, the unit is at {unit_baud}")


def sent_packets(file: TextIO, unit: VirtualInstrument[PacketT, CommandT]) -> Callable[[PacketT, float], None]:
    """Return a function that writes the truth about a unit's stream as CSV: a row for each packet.

    It takes a packet and the host's monotonic time when the unit sampled it, s. Rows are whole, and there at once.
    """

    def write(row: str) -> None:
        file.write(row + "\n")
        file.flush()

    def add(packet: PacketT, sampled_s: float) -> None:
        mode, ticks, frame = unit.in_columns(packet)
        write(f"{round(sampled_s * 1e9)},{mode},{ticks},{frame.hex()}")

    write("sampled_monotonic_ns,mode,ticks,frame")
    return add
