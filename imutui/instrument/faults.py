"""A line that loses, adds and turns bytes, and delivers some late: between a virtual unit and its pseudo-terminal.

No clock and no I/O: it is told when bytes left the unit and when it is asked. What it does is given by time since the
first request for data, so that it meets the same readings at every run.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from imutui.instrument.crossbow import PACKET_BYTES

KINDS = ("drop_bytes", "garbage", "bit_flips", "silence")


@dataclass(frozen=True, slots=True)
class LineFault:
    """A fault at a time.

    Attributes
    ----------
    at : float
        Since the first request for data, s.
    kind : {"drop_bytes", "garbage", "bit_flips", "silence"}
        The next `count` bytes are lost; `count` random bytes come in between; a bit is turned in each of the next
        `count` messages; nothing arrives for `seconds`.
    count : int
    seconds : float
    """

    at: float
    kind: str
    count: int = 0
    seconds: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f'`kind` is "{self.kind}", not one of: {", ".join(KINDS)}')


class FaultyLine:
    """Bytes on their way from a unit to its host.

    Parameters
    ----------
    faults : sequence of LineFault
        In any order.
    fate : callable or None
        Of what was measured at a time since the first request: whether it is lost, and how late it arrives, s.
    seed : int
        Of garbage and of the bits that are turned.
    """

    def __init__(
        self, faults: Sequence[LineFault], fate: Callable[[float], tuple[bool, float]] | None = None, seed: int = 0
    ) -> None:
        self._pending = deque(sorted(faults, key=lambda fault: fault.at))
        self._fate = fate
        self._rng = np.random.default_rng(seed)
        self._start = math.inf
        self._to_drop = 0
        self._to_flip = 0
        self._silent_until = -math.inf
        self._queue: deque[tuple[float, bytes]] = deque()

    def started(self, now: float) -> None:
        """Let time since the first request begin, if it has not."""
        self._start = min(self._start, now)

    def put(self, message: bytes, sent: float, left: float) -> None:
        """Take a message whose first bit left the unit at `sent` and whose last at `left`."""
        lost, late = False, 0.0
        if self._fate is not None and len(message) == PACKET_BYTES and sent >= self._start:
            lost, late = self._fate(sent - self._start)
        arrives = left + max(late, 0.0)
        if self._queue:
            arrives = max(arrives, self._queue[-1][0])  # bytes do not overtake
        message = self._spoiled(b"" if lost else message, left)
        if message:
            self._queue.append((arrives, message))

    def take(self, now: float) -> bytes:
        """Return what has arrived by `now` and was not taken before."""
        out = b""
        while self._queue and self._queue[0][0] <= now:
            out += self._queue.popleft()[1]
        return out

    def next_event(self) -> float | None:
        """Return when something will next arrive of what has left the unit."""
        return self._queue[0][0] if self._queue else None

    def _spoiled(self, message: bytes, left: float) -> bytes:
        before = b""
        while self._pending and self._start + self._pending[0].at <= left:
            fault = self._pending.popleft()
            match fault.kind:
                case "drop_bytes":
                    self._to_drop += fault.count
                case "bit_flips":
                    self._to_flip += fault.count
                case "garbage":
                    before += self._rng.bytes(fault.count)
                case "silence":
                    self._silent_until = max(self._silent_until, self._start + fault.at + fault.seconds)
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
