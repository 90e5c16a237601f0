"""Finding frames in a stream of bytes: whole, in order, none between noise lost.

After a frame with a wrong CRC the search goes on from the byte after its first one. A frame may end in 0x55, so that
three of them follow each other, and the true preamble begins with the second.
"""

from imutui.instrument.discarded import Discarded
from imutui.instrument.uut.frames import HEADER_BYTES, OVERHEAD_BYTES, PREAMBLE, TYPE_BYTES, Frame, is_whole

# "The ping may be sent without length and CRC": the text UUPK.
_PING = b"PK"
_BARE_PING = PREAMBLE + _PING
_REST_OF_PING = bytes.fromhex("00 9E F4")

FIXED_LENGTHS = {
    b"S0": 30,
    b"S1": 24,
    b"S2": 28,
    b"A0": 30,
    b"A1": 32,
    b"A2": 30,
    b"N0": 32,
    b"N1": 42,
    b"B1": 18,
    b"B2": 10,
    b"T0": 28,
    b"VR": 5,
    b"GP": 2,
    b"SR": 0,
    b"AR": 0,
    b"\x15\x15": 2,
}
"""Payload bytes of the types that have always as many."""

_ANY_LENGTH = frozenset((b"ID", b"CH", b"GF", b"RF", b"SF", b"WF", b"RE", b"WE", b"UE", b"LE"))


class FrameSearch:
    """Bytes in, frames and discarded bytes out.

    What comes out does not depend on how the bytes are cut into feeds, only when. Less than a longest frame, 262
    bytes, is held between feeds. A frame of a known type is waited for until its end. What begins like a frame of an
    unknown type, or has a length that its type never has, is likelier noise: a whole frame within it comes first.

    `ping_at_once`: whether the four bytes of a bare ping are a ping as soon as they are there, as for a unit, which
      can't wait for more. Else they are one when something other than the rest of a whole ping follows, or nothing.
    `bad_checksums`: frames that were due, right behind another one, and had a wrong CRC.
    `discarded_bytes`: bytes that belonged to no frame.
    """

    def __init__(self, *, ping_at_once: bool = False) -> None:
        self.bad_checksums = 0
        self.discarded_bytes = 0
        self._ping_at_once = ping_at_once
        self._held = bytearray()
        self._position = 0  # of the first byte held, in all that was ever received
        self._due: int | None = None
        self._damaged: list[int] = []
        self._last_bytes = OVERHEAD_BYTES

    def feed(self, data: bytes) -> list[Frame | Discarded]:
        """Take bytes from the line, any number, cut anywhere."""
        self._held += data
        return self._scan(paused=False)

    def pause(self) -> list[Frame | Discarded]:
        """Take note that the line is quiet for the moment; the beginning of a frame is kept."""
        return self._scan(paused=True)

    def quiet(self) -> list[Frame | Discarded]:
        """Take note that the line has fallen quiet: the beginning of a frame is discarded, whole ones in it are not."""
        found: list[Frame | Discarded] = self._scan(paused=True)
        while self._held:
            found += self._discard(1)
            found += self._scan(paused=True)
        self._due = self._position
        return _joined(found)

    @property
    def holds(self) -> bool:
        """Whether bytes are held that may begin a frame."""
        return bool(self._held)

    @property
    def missing(self) -> int:
        """Bytes still needed to complete the next frame, at least one.

        While none has begun it is taken to be as long as the last one.
        """
        if len(self._held) < HEADER_BYTES:
            return max(self._last_bytes - len(self._held), 1)
        return max(self._end(0) - len(self._held), 1)

    def _scan(self, *, paused: bool) -> list[Frame | Discarded]:
        events: list[Frame | Discarded] = []
        at = 0
        while (at := self._held.find(PREAMBLE, at)) >= 0:
            found = self._frame_from(at, paused=paused)
            if found is None:
                return events + self._discard(at)
            start, end = found
            if start == end:
                at += 1
                continue
            events += [*self._discard(start), self._take(end - start)]
            at = 0
        begun = self._held.endswith(PREAMBLE[:1])
        return events + self._discard(len(self._held) - begun)

    def _frame_from(self, at: int, *, paused: bool) -> tuple[int, int] | None:
        """Start and end of the frame that the preamble at `at` leads to; equal if to none, None if more must come."""
        kind = bytes(self._held[at + len(PREAMBLE) : at + len(PREAMBLE) + TYPE_BYTES])
        if kind == _PING:
            return self._ping_from(at, paused=paused)
        if len(self._held) < at + HEADER_BYTES:
            return None
        end, length = self._end(at), self._held[at + HEADER_BYTES - 1]
        is_likely = FIXED_LENGTHS.get(kind, length if kind in _ANY_LENGTH else None) == length
        if (not is_likely or (paused and end > len(self._held))) and (inner := self._frame_within(at + 1, end)):
            return inner
        if end > len(self._held):
            return None
        if is_whole(self._held, at, end):
            return at, end
        self._note_damage(at, end if is_likely else None)
        return at, at

    def _ping_from(self, at: int, *, paused: bool) -> tuple[int, int] | None:
        """Start and end of a ping, with length and CRC or without."""
        bare = at + len(_BARE_PING)
        rest = bytes(self._held[bare : bare + len(_REST_OF_PING)])
        if rest == _REST_OF_PING:
            return at, bare + len(rest)
        if self._ping_at_once or paused or not _REST_OF_PING.startswith(rest):
            return at, bare
        return None

    def _frame_within(self, begin: int, end: int) -> tuple[int, int] | None:
        """The whole frame between two places that is the first to end."""
        found: list[tuple[int, int]] = []
        at = begin
        while (at := self._held.find(PREAMBLE, at, end)) >= 0:
            if at + OVERHEAD_BYTES <= min(end, len(self._held)):
                its_end = self._end(at)
                if its_end <= min(end, len(self._held)) and is_whole(self._held, at, its_end):
                    found.append((its_end, at))
            at += 1
        return min(found)[::-1] if found else None

    def _end(self, at: int) -> int:
        return at + OVERHEAD_BYTES + self._held[at + HEADER_BYTES - 1]

    def _note_damage(self, at: int, end: int | None) -> None:
        """Count a frame with a wrong CRC if it was due; behind it the next one is."""
        if self._due == self._position + at:
            self.bad_checksums += 1
            self._damaged.append(self._due)
            self._due = None if end is None else self._position + end

    def _take(self, length: int) -> Frame:
        taken = self._drop(length)
        self._due, self._last_bytes = self._position, max(length, OVERHEAD_BYTES)
        return Frame(taken[2:4], taken[HEADER_BYTES:-2])

    def _discard(self, length: int) -> list[Frame | Discarded]:
        if length <= 0:
            return []
        data = self._drop(length)
        self.discarded_bytes += length
        damaged = [position for position in self._damaged if position < self._position]
        self._damaged = self._damaged[len(damaged) :]
        return [Discarded(data, bool(damaged))]

    def _drop(self, length: int) -> bytes:
        taken = bytes(self._held[:length])
        del self._held[:length]
        self._position += length
        return taken


def _joined(events: list[Frame | Discarded]) -> list[Frame | Discarded]:
    """Discarded bytes that follow each other as one event."""
    joined: list[Frame | Discarded] = []
    for event in events:
        before = joined[-1] if joined else None
        if isinstance(event, Discarded) and isinstance(before, Discarded):
            joined[-1] = Discarded(before.data + event.data, before.bad_checksum or event.bad_checksum)
        else:
            joined.append(event)
    return joined
