"""The sending half of a virtual unit's UART, and the speed of a line: no clock, no I/O."""

import math
from collections import deque
from collections.abc import Iterator

# 8 data bits, 1 start bit, 1 stop bit, no parity.
BITS_PER_BYTE = 10

# A receiver samples each bit in its middle: half a bit in the ten of a byte, shared by both ends, and a margin.
_BAUD_TOLERANCE = 0.03

# Instants closer than this are one: far above the rounding of a clock that runs for weeks, far below a bit time.
SAME_INSTANT_S = 1e-9

# A receiver at a wrong speed gets garbage: here the same garbage each time, and never the right byte.
_SCRAMBLE = 0b1011_0110


def same_speed(baud: int, other_baud: int) -> bool:
    """Return True if a receiver at one speed understands a sender at the other."""
    return abs(baud - other_baud) <= _BAUD_TOLERANCE * baud


def transfer_s(length: int, baud: int) -> float:
    """Return the time that `length` bytes take on the line, s."""
    return length * BITS_PER_BYTE / baud


def as_heard(data: bytes, baud: int, host_baud: int) -> bytes:
    """Return bytes as a receiver at the host's speed gets them."""
    return data if same_speed(baud, host_baud) else bytes(byte ^ _SCRAMBLE for byte in data)


class Transmitter:
    """The sending half of the unit's UART: one byte after the other, ten bit times each."""

    def __init__(self) -> None:
        self._sendings: deque[tuple[float, int, bytes]] = deque()  # start, baud, bytes
        self._taken = 0  # bytes of the first sending that have been taken
        self.free_at = -math.inf

    def send(self, data: bytes, start: float, baud: int) -> None:
        """Send `data` at `start`, or once the bytes before it have left."""
        start = max(start, self.free_at)
        self._sendings.append((start, baud, data))
        self.free_at = start + transfer_s(len(data), baud)

    def take(self, now: float) -> Iterator[tuple[int, bytes]]:
        """Yield speed and bytes of everything that has left by `now` and was not taken before."""
        while self._sendings:
            start, baud, data = self._sendings[0]
            left = min(len(data), max(0, math.floor((now - start + SAME_INSTANT_S) / transfer_s(1, baud))))
            if left > self._taken:
                yield baud, data[self._taken : left]
                self._taken = left
            if self._taken < len(data):
                return
            self._sendings.popleft()
            self._taken = 0

    def next_end(self) -> float | None:
        """Return when the first message on the line will have left."""
        if not self._sendings:
            return None
        start, baud, data = self._sendings[0]
        return start + transfer_s(len(data), baud)
