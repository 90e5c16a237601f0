"""Bytes received from a Crossbow unit and not yet handed out, for whoever looks for packets and replies in them."""

from imutui.instrument.discarded import Discarded
from imutui.instrument.imu400.messages import Event


class Inbox:
    """Bytes received and not yet handed out, each known by its position in everything ever received.

    `start` is the first byte held, `scan` the first one not yet judged, `end` the one that comes next.
    """

    def __init__(self) -> None:
        self._held = bytearray()
        self._damaged: list[int] = []
        self.start = 0
        self.scan = 0
        self.bad_checksums = 0
        self.discarded_bytes = 0

    @property
    def end(self) -> int:
        """Position of the byte that comes next."""
        return self.start + len(self._held)

    @property
    def unjudged(self) -> int:
        """How many bytes have not been judged yet."""
        return self.end - self.scan

    def append(self, data: bytes) -> None:
        """Take bytes from the line."""
        self._held += data

    def peek(self, position: int, length: int) -> bytes:
        """Bytes from a position on, fewer where not so many have come; they stay."""
        first = position - self.start
        return bytes(self._held[first : first + length])

    def find(self, data: bytes) -> int:
        """Where these bytes begin, from `scan` on; -1 if they are not there."""
        found = self._held.find(data, self.scan - self.start)
        return found if found < 0 else self.start + found

    def seek(self, byte: int, within: int | None = None) -> bool:
        """Move `scan` to the next `byte`; without one (`within` so many bytes) leave it and say so."""
        first = self.scan - self.start
        found = self._held.find(byte, first, len(self._held) if within is None else first + within)
        if found >= 0:
            self.scan = self.start + found
        return found >= 0

    def mark_damaged(self) -> None:
        """Count the frame at `scan` as one that was due and came with a wrong sum."""
        self.bad_checksums += 1
        self._damaged.append(self.scan)

    def take(self, length: int) -> bytes:
        """Hand out `length` bytes from `start`."""
        taken = bytes(self._held[:length])
        del self._held[:length]
        self.start += length
        self.scan = self.start
        return taken

    def drop(self, upto: int) -> list[Event]:
        """Discard what lies before position `upto`."""
        if upto <= self.start:
            return []
        damaged = bool(self._damaged) and self._damaged[0] < upto
        self._damaged = [position for position in self._damaged if position >= upto]
        scan = max(self.scan, upto)
        data = self.take(upto - self.start)
        self.scan = scan
        self.discarded_bytes += len(data)
        return [Discarded(data, damaged)]
