"""Faults of a virtual unit, its line and its port: more kinds than a scenario has.

Their time is that of the scenario, since the first request for data, so that a fault meets the same readings at every
run.
"""

import itertools
import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, BinaryIO

import numpy as np

from imutui.instrument.counter_spec import SPAN
from imutui.instrument.imu400 import unit as imu400
from imutui.instrument.imu400.crossbow import TICK_S, Mode
from imutui.instrument.pseudo_terminal import PseudoTerminal
from imutui.instrument.transmitter import SAME_INSTANT_S, transfer_s
from imutui.instrument.uut import unit as uut
from imutui.instrument.uut.fields import Field
from imutui.instrument.uut.messages import Memory
from imutui.instrument.virtual import BURST_BYTES, Line, Wire, serve
from imutui.instrument.virtual_instrument import VirtualInstrument

LINE_KINDS = {
    "drop_bytes": "count",
    "garbage": "count",
    "bit_flips": "count",
    "silence": "seconds",
    "lose_packets": "count",
    "double_packets": "count",
    "stall": "seconds",
    "backlog": "count",
    "stutter": "seconds",
}
UNIT_KINDS = {"reset": "", "mode_change": "", "pause": "seconds", "hang_up": "seconds"}
KINDS = {**LINE_KINDS, **UNIT_KINDS}
"""Kinds of fault, and the measure of each."""

# What was written a moment ago is on its way through the kernel, and can be read only at its end.
_ON_ITS_WAY_S = 0.005
_LOOK_S = 0.005


@dataclass(frozen=True, slots=True)
class LineFault:
    """A fault at a time."""

    at: float  # since the first request for data, s
    # of the line, besides those of `virtual.Line`: "lose_packets": the next `count` packets vanish whole.
    # "double_packets": the next `count` come twice. "stall": what is sent within `seconds` arrives at their end, at
    # once. "backlog": the next `count` packets arrive with the last of them, or with a reply between them. "stutter": a
    # packet stops after half of its bytes; the others, and what is behind them, arrive `seconds` later. Of the unit:
    # "reset": it is as after power-up. "mode_change": it falls into the other mode, a stream goes on. "pause": it sends
    # nothing for `seconds`, and then goes on with the newest reading. Of the port: "hang_up": it is gone for `seconds`
    # and comes back under another name.
    kind: str
    count: int = 0
    seconds: float = 0.0
    power: bool = False  # with a hang-up: True if the unit loses its power too, and comes back as after power-up
    serial_number: int | None = None  # with a hang-up or reset: of the other unit that is in its place afterwards

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f'`kind` is "{self.kind}", not one of: {", ".join(KINDS)}')


class FaultyLine(Line):
    """A line with faults of all kinds; see `virtual.Line`.

    `bursts_s`: bytes that have arrived are handed on so often, all at once, as the latency timer of an adapter does; 0:
      at once.
    """

    def __init__(
        self,
        faults: Sequence[LineFault],
        fate: Callable[[float], tuple[bool, float]] | None = None,
        seed: int = 0,
        bursts_s: float = 0.0,
    ) -> None:
        ordered = sorted(faults, key=lambda fault: fault.at)
        super().__init__([fault for fault in ordered if fault.kind in LINE_KINDS], fate, seed)
        self._for_unit = deque(fault for fault in ordered if fault.kind in UNIT_KINDS)
        self._hang_ups = deque(fault for fault in ordered if fault.kind == "hang_up")
        self._bursts_s = bursts_s
        self._phase = float(np.random.default_rng([seed, 1]).uniform()) if bursts_s else 0.0
        self._to_lose = self._to_double = self._to_gather = 0
        self._gathered = b""
        self._stutter_s = 0.0
        self._held_until = -math.inf
        self._packet_bytes = 0

    def is_away(self, now: float) -> bool:
        """Return True if there is no port."""
        return any(begin <= now < end for begin, end in self._absences())

    def next_port_change(self, now: float) -> float:
        """Return when the port will next go or come; infinite if never."""
        return min((edge for absence in self._absences() for edge in absence if edge > now), default=math.inf)

    def next_for_unit(self) -> float:
        """Return when the next fault of the unit itself is due; infinite if there is none."""
        return self._start + self._for_unit[0].at if self._for_unit else math.inf

    def take_for_unit(self) -> LineFault:
        """Return the next fault of the unit itself, once."""
        return self._for_unit.popleft()

    def put(self, message: bytes, sent: float, left: float, *, packet_bytes: int) -> None:
        """Take a message, see `Line`."""
        self._packet_bytes = packet_bytes
        while self._hang_ups and self._start + self._hang_ups[0].at + self._hang_ups[0].seconds <= sent:
            self._hang_ups.popleft()
        super().put(message, sent, left, packet_bytes=packet_bytes)

    def _absences(self) -> Iterator[tuple[float, float]]:
        for fault in self._hang_ups:
            yield self._start + fault.at, self._start + fault.at + fault.seconds

    def _begin(self, fault: Any) -> None:
        match fault.kind:
            case "lose_packets":
                self._to_lose += fault.count
            case "double_packets":
                self._to_double += fault.count
            case "backlog":
                self._to_gather += fault.count
            case "stall":
                self._held_until = max(self._held_until, self._start + fault.at + fault.seconds)
            case "stutter":
                self._stutter_s = fault.seconds
            case _:
                super()._begin(fault)

    def _spoiled(self, message: bytes, left: float) -> bytes:
        if left >= self._silent_until and len(message) == self._packet_bytes:
            if self._to_lose:
                self._to_lose -= 1
                message = b""
            elif self._to_double:
                self._to_double -= 1
                message = 2 * message
        return super()._spoiled(message, left)

    def _deliver(self, data: bytes, sent: float, left: float, late: float) -> None:
        for end, piece in self._pieces(data, sent, left):
            self._deliver_piece(piece, end, late)

    def _pieces(self, message: bytes, sent: float, left: float) -> Iterator[tuple[float, bytes]]:
        """Cut a message where the port goes or comes and where a burst ends: when a piece has left, and its bytes."""
        edges = [edge for absence in self._absences() for edge in absence]
        if self._bursts_s:
            edges += np.arange(self._burst_after(sent), left, self._bursts_s).tolist()
        per_byte = (left - sent) / max(len(message), 1)
        cuts = {math.floor((edge - sent) / per_byte) for edge in edges if sent < edge < left}
        for begin, end in itertools.pairwise([0, *sorted(cuts - {0}), len(message)]):
            yield left - (len(message) - end) * per_byte, message[begin:end]

    def _deliver_piece(self, piece: bytes, left: float, late: float) -> None:
        arrives = max(left + late, self._held_until)
        if self._stutter_s and len(piece) >= self._packet_bytes:
            self._arrive(piece[: self._packet_bytes // 2], arrives)
            self._held_until, self._stutter_s = left + self._stutter_s, 0.0
            piece, arrives = piece[self._packet_bytes // 2 :], self._held_until
        if self._to_gather and piece:
            self._gathered += piece
            self._to_gather = self._to_gather - 1 if len(piece) >= self._packet_bytes else 0
            piece, self._gathered = (b"", self._gathered) if self._to_gather else (self._gathered, b"")
        arrives = self._burst_after(arrives) if self._bursts_s else arrives
        if not any(left < end and begin <= arrives for begin, end in self._absences()):
            self._arrive(piece, arrives)

    def _burst_after(self, t: float) -> float:
        return (math.ceil(t / self._bursts_s - self._phase) + self._phase) * self._bursts_s


class FaultyWire(Wire[Any, Any]):
    """A unit and its line, and the faults of both; see `virtual.Wire`."""

    def __init__(self, unit: VirtualInstrument[Any, Any], line: FaultyLine, *how: Any, **named: Any) -> None:
        super().__init__(unit, line, *how, **named)
        self._faulty = line

    def is_away(self, now: float) -> bool:
        """Return True if there is no port."""
        return self._faulty.is_away(self._at(now))

    def next_port_change(self, now: float) -> float:
        """Return when the port will next go or come; infinite if never."""
        return self._began + self._faulty.next_port_change(self._at(now)) / self._rate

    def _next_event(self) -> float:
        change = self._faulty.next_port_change(self._now)
        return min(super()._next_event(), self._faulty.next_for_unit(), change)

    def _carry(self, now: float, host_baud: int) -> None:
        until = self._at(now)
        while True:
            left, fault = self.unit.next_event(self._now), self._faulty.next_for_unit()
            if fault <= until and (left is None or fault < left):
                self._now = max(self._now, fault)
                self._suffer(self._faulty.take_for_unit())
            elif left is not None and left <= until:
                self._put(left, host_baud)
            else:
                break
        self._now = max(self._now, until)

    def _suffer(self, fault: LineFault) -> None:
        match fault.kind:
            case "reset":
                power_up(self.unit, self._now, fault.serial_number)
            case "mode_change":
                change_mode(self.unit, self._now)
            case "pause":
                pause(self.unit, self._now, fault.seconds)
            case "hang_up" if fault.power or fault.serial_number is not None:
                power_up(self.unit, self._now, fault.serial_number)


def power_up(unit: Any, now: float, serial_number: int | None = None) -> None:
    """Switch a unit off and on: bytes on the line break off; `serial_number` is that of another unit in its place."""
    unit._advance(now)
    line = unit._line
    begun = [
        (start, baud, data[: max(0, math.floor((now - start + SAME_INSTANT_S) / transfer_s(1, baud)))])
        for start, baud, data in line._sendings
    ]
    if begun and len(begun[0][2]) == line._taken:
        begun[0], line._taken = (0.0, 0, b""), 0
    line._sendings = deque(sending for sending in begun if sending[2])
    line.free_at = min(line.free_at, now)
    if serial_number is not None:
        unit.options = replace(unit.options, serial_number=serial_number)
    if isinstance(unit, imu400.VirtualUnit):
        unit._first_count = (math.floor(now / TICK_S) - 1) % SPAN
        unit._wake()
    else:
        unit._begin_anew(now)


def change_mode(unit: Any, now: float) -> None:
    """Have a unit fall into another mode of measurement, unasked; a stream goes on."""
    unit._advance(now)
    if isinstance(unit, imu400.VirtualUnit):
        unit.mode = Mode.VOLTAGE if unit.mode is Mode.SCALED else Mode.SCALED
    else:
        kinds = unit.options.packet_types
        kind = kinds[(kinds.index(unit._fields.packet_type) + 1) % len(kinds)]
        unit._fields.put(Memory.RAM, ((Field.PACKET_TYPE, int.from_bytes(kind, "big")),))


def pause(unit: Any, now: float, seconds: float) -> None:
    """Have a unit send nothing for so long after what is on the line; the loop and the counter go on."""
    unit._advance(now)
    unit._line.free_at = max(unit._line.free_at, now + seconds)
    if isinstance(unit, uut.VirtualUnit) and unit.rate_hz:
        unit._skip_to(now + seconds)


class _Until:
    """Stands for a `threading.Event` that is also set from a time on."""

    def __init__(self, stop: threading.Event, at: Callable[[], bool]) -> None:
        self._stop, self._at = stop, at

    def is_set(self) -> bool:
        return self._stop.is_set() or self._at()


def serve_faulty(
    wire: FaultyWire,
    pty: PseudoTerminal,
    *,
    log: Callable[[str], None],
    stop: threading.Event,
    tap: BinaryIO | None = None,
    **options: Any,
) -> None:
    """Run `virtual.serve`, and have the port go and come as the faults say; other bytes are not lost.

    What lies unread when the port hangs up is taken out of the tap: the host never gets it.
    """
    options["burst_bytes"] = BURST_BYTES
    until: Any = _Until(stop, lambda: wire.is_away(time.monotonic()))
    while True:
        serve(wire, pty, log=log, tap=tap, stop=until, **options)
        if stop.is_set() or not until.is_set():
            return
        name, unread = pty.name, _hang_up(pty)
        if tap is not None and unread and tap.seekable():
            tap.seek(-unread, os.SEEK_END)
            tap.truncate()
        log(f"hang-up: {name} is gone, with {unread} bytes unread")
        while until.is_set() and not stop.is_set():
            wire.arrived(time.monotonic(), pty.host_baud())
            time.sleep(_LOOK_S)
        pty._show()
        log(f"back: the port is {pty.name} now")


def _hang_up(pty: PseudoTerminal) -> int:
    """Have a terminal be gone for the host, and have another name from now on, which its link does not show yet.

    Returns how many bytes the host has not read, and never will.
    """
    pty._hide()
    time.sleep(_ON_ITS_WAY_S)
    unread = 0
    with suppress(BlockingIOError):
        while more := os.read(pty._host, 4096):
            unread += len(more)
    former, new = (
        (pty._unit, pty._host),
        PseudoTerminal(None),
    )  # opened before the other is closed: its name is not free
    pty._unit, pty._host, pty.name = new._unit, new._host, new.name
    for end in former:
        os.close(end)
    return unread
