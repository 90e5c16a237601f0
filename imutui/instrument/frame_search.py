"""Decode the bytes of a line: one loop for every protocol, with a rule for each that finds its messages.

No input or output, no clock. Noise raises no exception: its bytes become `Discarded` events and are counted.
"""

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

EventT = TypeVar("EventT")
EventT_co = TypeVar("EventT_co", covariant=True)

# A damaged frame is counted up to so many frames behind the last good one: beyond that, the bytes are noise.
_MOST_DAMAGED = 8


@dataclass(frozen=True, slots=True)
class Discarded:
    """Bytes dropped while looking for the next packet or reply."""

    data: bytes  # the bytes, so that a log can hold everything that was on the line
    bad_checksum: bool  # True if a packet or reply was due among them, began rightly and had a wrong sum


class Rest(enum.IntEnum):
    """How long the line has brought nothing."""

    NONE = 0
    MOMENT = 1  # the stream may go on where it stopped
    LONG = 2  # what has begun will not end


class Judged(NamedTuple):
    """What the next bytes of a line are: a frame, or noise."""

    length: int  # bytes of it
    is_frame: bool = False
    event: Any = None  # content of the frame; `Discarded` if the caller has no use for it, None if it is not reported
    spoiled: int = 0  # of noise: length of the frame that begins with it and has a wrong sum, 0 if none does


class Rule(Protocol[EventT_co]):
    """Finds the messages of one protocol."""

    answers: int
    """Answers amid a stream since its last packet."""

    def judge(self, held: bytearray, at: int, rest: Rest) -> Judged | None:
        """Return what the bytes held from position `at` on begin with; None if more must come to decide that."""

    def missing(self, held: bytearray) -> int:
        """Return the number of bytes, at least one, that complete the message that the bytes held begin."""


def noise(held: bytearray, at: int, header: bytes, *, skip: int = 0, spoiled: int = 0) -> Judged | None:
    """Return the noise from `at` up to the next header, or up to the bytes that may begin one.

    `skip`: bytes that are noise in any case; 1 slides past a header that begins no frame, since the true one may be
      among the bytes of the false frame.
    """
    end = held.find(header, at + skip)
    if end < 0:
        end = len(held) - (len(header) > 1 and held[-1:] == header[:1])
    return Judged(end - at, spoiled=spoiled) if end > at else None


class SumFrames(Generic[EventT_co]):
    """A rule for frames whose sum makes them sure: a frame counts if its sum is right.

    The bytes of a frame that has begun are held until its end, or until the line rests.

    `header`: first bytes of each frame.
    `length`: returns the length of the frame that begins at a position; None if more bytes must come to know it, 0 if
      no frame begins so.
    `is_whole`: returns True if the sum of a frame is right.
    `read`: makes the event of a frame; see `Judged.event`.
    `least_bytes`: length of the shortest frame.
    `answer`: first bytes of the frame that answers a question amid a stream.
    """

    def __init__(
        self,
        header: bytes,
        length: Callable[[bytearray, int, Rest], int | None],
        is_whole: Callable[[bytes], bool],
        read: Callable[[bytes], EventT_co | Discarded | None],
        *,
        least_bytes: int,
        answer: bytes = b"\0",
    ) -> None:
        self.answers = 0
        self._header, self._answer, self._least_bytes = header, answer, least_bytes
        self._length, self._is_whole, self._read = length, is_whole, read
        self._usual_bytes = least_bytes  # length of the last frame

    def judge(self, held: bytearray, at: int, rest: Rest) -> Judged | None:
        """Judge as `Rule.judge` does."""
        if not held.startswith(self._header, at):
            return noise(held, at, self._header)
        length = self._length(held, at, rest)
        if length is None or at + length > len(held):
            return self._covered(held, at, rest) if rest else None
        frame = bytes(held[at : at + length])
        if not length or not self._is_whole(frame):
            return noise(held, at, self._header, skip=1, spoiled=length)
        event = self._read(frame)
        is_event = event is not None and not isinstance(event, Discarded)
        self.answers = 0 if is_event else self.answers + frame.startswith(self._answer)
        self._usual_bytes = max(length, self._least_bytes)
        return Judged(length, True, event)

    def missing(self, held: bytearray) -> int:
        """Return the bytes up to the frame's end; a frame of unknown length is taken to be as long as the last one."""
        length = self._length(held, 0, Rest.NONE) if held else None
        return max((length or self._usual_bytes) - len(held), 1)

    def _covered(self, held: bytearray, at: int, rest: Rest) -> Judged | None:
        """Return the noise up to a whole frame within one that has only begun; None if there is none."""
        inner = at
        while (inner := held.find(self._header, inner + 1)) >= 0:
            length = self._length(held, inner, rest)
            if length and inner + length <= len(held) and self._is_whole(bytes(held[inner : inner + length])):
                return Judged(inner - at)
        return None


class FrameDecoder(Generic[EventT_co]):
    """Bytes in, events out. The events do not depend on how the bytes are cut into feeds; only their time does.

    `rule`: finds the messages.
    `due`: True if a message is to come with the first byte, so that a damaged one is counted.
    """

    def __init__(self, rule: Rule[EventT_co], *, due: bool = False) -> None:
        self._rule = rule
        self._held = bytearray()
        self._behind: int | None = 0 if due else None  # bytes since the last frame
        self.bad_checksums = 0
        """Packets and replies that were due, began rightly and had a wrong sum."""
        self.discarded_bytes = 0
        """Bytes that belonged to no packet and no reply."""

    def feed(self, data: bytes) -> list[EventT_co | Discarded]:
        """Take bytes from the line.

        `data`: any number of bytes, cut anywhere.
        Returns packets, replies and discarded bytes, in the order of the line.
        """
        self._held += data
        return self._decode(Rest.NONE)

    def pause(self) -> list[EventT_co | Discarded]:
        """Take note that the line is quiet for the moment, while a stream is expected to go on.

        The beginning of a packet is kept: a line that was held up brings the rest later. If it brings something else,
        the sum shows that.
        """
        return self._decode(Rest.MOMENT)

    def quiet(self) -> list[EventT_co | Discarded]:
        """Take note that the line has been quiet for some 30 ms: the beginning of a message is discarded."""
        events = self._decode(Rest.LONG)
        self._behind = 0
        return events

    @property
    def holds(self) -> bool:
        """True if bytes are held that may begin a message."""
        return bool(self._held)

    @property
    def missing(self) -> int:
        """Bytes still needed to complete the next packet or reply.

        A reader that asks the port for so many wakes at a packet's end, neither before nor a packet late.
        """
        return self._rule.missing(self._held)

    @property
    def answers(self) -> int:
        """Answers amid a stream since its last packet."""
        return self._rule.answers

    def _decode(self, rest: Rest) -> list[EventT_co | Discarded]:
        events: list[EventT_co | Discarded] = []
        held, begin, at, damaged = self._held, 0, 0, False  # noise is from `begin` to `at`
        while at < len(held):
            judged = self._rule.judge(held, at, rest)
            if judged is None:
                if rest is not Rest.LONG:
                    break
                judged = Judged(1)
            at += judged.length
            if not judged.is_frame:
                damaged |= self._is_due(judged.spoiled)
                if self._behind is not None:
                    self._behind += judged.length
                continue
            events += self._discard(bytes(held[begin : at - judged.length]), damaged)
            begin, damaged, self._behind = at, False, 0
            if isinstance(judged.event, Discarded):
                self.discarded_bytes += len(judged.event.data)
            if judged.event is not None:
                events.append(judged.event)
        events += self._discard(bytes(held[begin:at]), damaged)
        del held[:at]
        return events

    def _is_due(self, spoiled: int) -> bool:
        """Count a damaged frame of so many bytes if it stands where the next frame, or one after it, was due."""
        behind = self._behind
        if not spoiled or behind is None or behind % spoiled or behind > _MOST_DAMAGED * spoiled:
            return False
        self.bad_checksums += 1
        return True

    def _discard(self, data: bytes, damaged: bool) -> list[Discarded]:
        self.discarded_bytes += len(data)
        return [Discarded(data, damaged)] if data else []
