"""A line that loses, adds and turns bytes, and delivers some late: between a virtual unit and its pseudo-terminal.

No clock and no I/O: it is told when bytes left the unit and when it is asked. What it does is given by time since the
first request for data, so that it meets the same readings at every run. Faults of the unit itself and of the port are
kept here too, on the same time, for `wire.Wire` to carry out.
"""

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

LINE_KINDS = (
    *("drop_bytes", "garbage", "bit_flips", "silence", "lose_packets", "double_packets"),
    *("stall", "backlog", "stutter"),
)
UNIT_KINDS = ("reset", "mode_change", "pause", "hang_up")
KINDS = LINE_KINDS + UNIT_KINDS


@dataclass(frozen=True, slots=True)
class LineFault:
    """A fault at a time."""

    at: float  # since the first request for data, s
    # of the line: "drop_bytes": the next `count` bytes are lost. "garbage": `count` random bytes come in between.
    # "bit_flips": a bit is turned in each of the next `count` messages. "silence": nothing arrives for `seconds`, and
    # what was sent is lost. "lose_packets": the next `count` packets vanish whole. "double_packets": the next `count`
    # come twice. "stall": what is sent within `seconds` arrives at their end, at once. "backlog": the next `count`
    # packets arrive with the last of them, or with a reply between them. "stutter": a packet stops after half of its
    # bytes; the others, and what is behind them, arrive `seconds` later. Of the unit: "reset": it is as after power-up.
    # "mode_change": it falls into the other mode, a stream goes on. "pause": it sends nothing for `seconds`, and then
    # goes on with the newest reading. Of the port: "hang_up": it is gone for `seconds` and comes back under another
    # name.
    kind: str
    count: int = 0
    seconds: float = 0.0
    power: bool = False  # whether a unit whose port hung up has lost its power too, and comes back as after power-up
    serial_number: int | None = None  # that of another unit, which comes back in its place, from power-up

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f'`kind` is "{self.kind}", not one of: {", ".join(KINDS)}')


class FaultyLine:
    """Bytes on their way from a unit to its host.

    `faults`: in any order.
    `fate`: of what was measured at a time since the first request: whether it is lost, and how late it arrives, s.
    `seed`: of garbage, of the bits that are turned, and of the phase of bursts.
    `bursts_s`: what arrives is handed on so often, all at once, as the latency timer of an adapter does; 0: at once.
    """

    def __init__(
        self,
        faults: Sequence[LineFault],
        fate: Callable[[float], tuple[bool, float]] | None = None,
        seed: int = 0,
        bursts_s: float = 0.0,
    ) -> None:
        ordered = sorted(faults, key=lambda fault: fault.at)
        self._pending = deque(fault for fault in ordered if fault.kind in LINE_KINDS)
        self._for_unit = deque(fault for fault in ordered if fault.kind in UNIT_KINDS)
        self._hang_ups = deque(fault for fault in ordered if fault.kind == "hang_up")
        self._fate = fate
        self._rng = np.random.default_rng(seed)
        self._bursts_s = bursts_s
        self._phase = float(np.random.default_rng([seed, 1]).uniform()) if bursts_s else 0.0
        self._start = math.inf
        self._to_drop = 0
        self._to_flip = 0
        self._to_lose = 0
        self._to_double = 0
        self._to_gather = 0
        self._gathered = b""
        self._garbage = b""
        self._stutter_s = 0.0
        self._held_until = -math.inf
        self._silent_until = -math.inf
        self._queue: deque[tuple[float, bytes]] = deque()
        self._packet_bytes = 0

    def started(self, now: float) -> None:
        """Let time since the first request begin, if it has not."""
        self._start = min(self._start, now)

    def is_away(self, now: float) -> bool:
        """Whether there is no port."""
        return any(begin <= now < end for begin, end in self._absences())

    def next_port_change(self, now: float) -> float:
        """When the port will next go or come; infinite if never."""
        return min((edge for absence in self._absences() for edge in absence if edge > now), default=math.inf)

    def next_for_unit(self) -> float:
        """When the next fault of the unit itself is due; infinite if there is none."""
        return self._start + self._for_unit[0].at if self._for_unit else math.inf

    def take_for_unit(self) -> LineFault:
        """Return the next fault of the unit itself, once."""
        return self._for_unit.popleft()

    def put(self, message: bytes, sent: float, left: float, *, packet_bytes: int) -> None:
        """Take a message whose first bit left the unit at `sent` and whose last at `left`.

        What the line does to packets it does to messages of `packet_bytes`.
        """
        self._packet_bytes = packet_bytes
        lost, late = False, 0.0
        if self._fate is not None and len(message) == self._packet_bytes and sent >= self._start:
            lost, late = self._fate(sent - self._start)
        self._begin_faults(left)
        while self._hang_ups and self._start + self._hang_ups[0].at + self._hang_ups[0].seconds <= sent:
            self._hang_ups.popleft()
        for end, piece in self._pieces(self._spoiled(b"" if lost else message, left), sent, left):
            self._deliver(piece, end, max(late, 0.0))

    def take(self, now: float) -> bytes:
        """Return what has arrived by `now` and was not taken before."""
        out = b""
        while self._queue and self._queue[0][0] <= now:
            out += self._queue.popleft()[1]
        return out

    def next_event(self) -> float | None:
        """Return when something will next arrive of what has left the unit."""
        return self._queue[0][0] if self._queue else None

    def _absences(self) -> Iterator[tuple[float, float]]:
        for fault in self._hang_ups:
            yield self._start + fault.at, self._start + fault.at + fault.seconds

    def _begin_faults(self, left: float) -> None:
        while self._pending and self._start + self._pending[0].at <= left:
            fault = self._pending.popleft()
            end = self._start + fault.at + fault.seconds
            match fault.kind:
                case "drop_bytes":
                    self._to_drop += fault.count
                case "bit_flips":
                    self._to_flip += fault.count
                case "garbage":
                    self._garbage += self._rng.bytes(fault.count)
                case "silence":
                    self._silent_until = max(self._silent_until, end)
                case "lose_packets":
                    self._to_lose += fault.count
                case "double_packets":
                    self._to_double += fault.count
                case "backlog":
                    self._to_gather += fault.count
                case "stall":
                    self._held_until = max(self._held_until, end)
                case "stutter":
                    self._stutter_s = fault.seconds

    def _spoiled(self, message: bytes, left: float) -> bytes:
        before, self._garbage = self._garbage, b""
        if left < self._silent_until:
            return b""
        if self._to_lose and len(message) == self._packet_bytes:
            self._to_lose -= 1
            return before
        if self._to_double and len(message) == self._packet_bytes:
            self._to_double -= 1
            message = 2 * message
        dropped = min(self._to_drop, len(message))
        self._to_drop -= dropped
        message = message[dropped:]
        if self._to_flip and message:
            self._to_flip -= 1
            place, bit = int(self._rng.integers(len(message))), int(self._rng.integers(8))
            message = message[:place] + bytes([message[place] ^ (1 << bit)]) + message[place + 1 :]
        return before + message

    def _pieces(self, message: bytes, sent: float, left: float) -> Iterator[tuple[float, bytes]]:
        """A message cut where the port goes or comes and where a burst ends: when a piece has left, and its bytes."""
        edges = [edge for absence in self._absences() for edge in absence]
        if self._bursts_s:
            edges += np.arange(self._burst_after(sent), left, self._bursts_s).tolist()
        per_byte = (left - sent) / max(len(message), 1)
        cuts = {math.floor((edge - sent) / per_byte) for edge in edges if sent < edge < left}
        for begin, end in itertools.pairwise([0, *sorted(cuts - {0}), len(message)]):
            yield left - (len(message) - end) * per_byte, message[begin:end]

    def _deliver(self, piece: bytes, left: float, late: float) -> None:
        arrives = max(left + late, self._held_until)
        if self._stutter_s and len(piece) >= self._packet_bytes:
            self._queue_at(arrives, piece[: self._packet_bytes // 2])
            self._held_until, self._stutter_s = left + self._stutter_s, 0.0
            piece, arrives = piece[self._packet_bytes // 2 :], self._held_until
        if self._to_gather and piece:
            self._gathered += piece
            self._to_gather = self._to_gather - 1 if len(piece) >= self._packet_bytes else 0
            piece, self._gathered = (b"", self._gathered) if self._to_gather else (self._gathered, b"")
        arrives = self._burst_after(arrives) if self._bursts_s else arrives
        if not any(left < end and begin <= arrives for begin, end in self._absences()):
            self._queue_at(arrives, piece)

    def _burst_after(self, t: float) -> float:
        return (math.ceil(t / self._bursts_s - self._phase) + self._phase) * self._bursts_s

    def _queue_at(self, arrives: float, data: bytes) -> None:
        if self._queue:
            arrives = max(arrives, self._queue[-1][0])  # bytes do not overtake
        if data:
            self._queue.append((arrives, data))
