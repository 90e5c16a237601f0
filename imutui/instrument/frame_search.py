"""Bytes from a line in, what stands in them out: the same for every protocol whose messages are frames.

A frame is described by a `FrameForm`: how it begins, how long it is, and when it is whole. No input or output, no
clock, and nothing raises for noise: bytes that mean nothing become a `Discarded` event and a counter.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

EventT = TypeVar("EventT")
EventT_co = TypeVar("EventT_co", covariant=True)


@dataclass(frozen=True, slots=True)
class Discarded:
    """Bytes dropped while looking for the next packet or reply."""

    data: bytes  # the bytes, so that a log can hold everything that was on the line
    bad_checksum: bool  # whether a packet or reply was due among them, began rightly and had a wrong sum


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

    def find(self, header: bytes, position: int, upto: int | None = None) -> int:
        """Position of the next header that ends before another one; -1 if there is none."""
        found = self._held.find(header, position - self.start, self.end if upto is None else upto - self.start)
        return found if found < 0 else self.start + found

    def seek(self, header: bytes, within: int | None = None) -> bool:
        """Move `scan` to the next header; without one (`within` so many bytes) leave it and say so."""
        found = self.find(header, self.scan, None if within is None else self.scan + within)
        self.scan = max(self.scan, found)
        return found >= 0

    def mark_damaged(self, position: int) -> None:
        """Count the frame at a position as one that was due and came with a wrong sum."""
        self.bad_checksums += 1
        self._damaged.append(position)

    def take(self, length: int) -> bytes:
        """Hand out `length` bytes from `start`."""
        taken = bytes(self._held[:length])
        del self._held[:length]
        self.start += length
        self.scan = self.start
        return taken

    def drop(self, upto: int) -> list[Discarded]:
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


class Search(Generic[EventT_co]):
    """What is looked for in an inbox. This one looks for nothing: whatever comes is discarded."""

    done = False
    """Whether nothing more is expected."""
    answers = 0
    """Answers amid a stream, since its last packet."""

    def scan(self, inbox: Inbox) -> list[EventT_co | Discarded]:
        """Return what can be told from the bytes so far, and leave the rest."""
        return [*inbox.drop(inbox.end)]

    def release(self, inbox: Inbox) -> list[EventT_co | Discarded]:
        """Return what can be told knowing that nothing comes at the moment, and leave what has begun."""
        return []

    def close(self, inbox: Inbox) -> list[EventT_co | Discarded]:
        """Return what can be told knowing that the line is quiet: what has begun will not end."""
        return []

    def missing(self, inbox: Inbox) -> int:
        """Bytes needed before `scan` can tell more, at least one."""
        return 1


@dataclass(frozen=True, slots=True)
class FrameForm:
    """What frames look like."""

    header: bytes  # how each begins
    least_bytes: int  # of the shortest
    head_bytes: int  # by so many bytes from its first one its length is known
    length: Callable[[bytes], int]  # bytes of a whole frame, by its head
    is_whole: Callable[[bytes], bool]  # whether the sum of a frame is right
    # whether a head may be one: what seems to be a frame and is not likely to gives way to a whole frame within it
    is_likely: Callable[[bytes], bool] = lambda head: True


class FrameSearch(Search[EventT_co]):
    """Frames whose sum makes them sure.

    After a bad frame the search slides by one byte, since the true header may be among the bytes of a false one. What
    begins like a frame is waited for until its end.

    `read`: what a whole frame says; None if that is not to be told. A frame that says `Discarded` is counted as such.
    `due`: position where a frame is due; None if nowhere.
    `once`: whether one frame is expected, and none behind it.
    """

    def __init__(
        self,
        form: FrameForm,
        read: Callable[[bytes], EventT_co | Discarded | None],
        *,
        due: int | None = None,
        once: bool = False,
    ) -> None:
        self._form = form
        self._read = read
        self._once = once
        self._due = due  # where the last good frame ended, hence the next one is due
        self._last_bytes = form.least_bytes  # of the last good frame

    def scan(self, inbox: Inbox) -> list[EventT_co | Discarded]:
        """Frames that are whole, with the noise before them; the beginning of one is left."""
        return self._scan(inbox, paused=False)

    def release(self, inbox: Inbox) -> list[EventT_co | Discarded]:
        """Whole frames that seemed to be within another one; the beginning of a frame stays."""
        return self._scan(inbox, paused=True)

    def close(self, inbox: Inbox) -> list[EventT_co | Discarded]:
        """Discard the beginning of a frame, and not the whole ones in it; the next byte is a frame's first."""
        found = self._scan(inbox, paused=True)
        while inbox.start < inbox.end:
            found += [*inbox.drop(inbox.start + 1), *self._scan(inbox, paused=True)]
        self._due = inbox.end
        return _joined(found)

    def missing(self, inbox: Inbox) -> int:
        """Bytes up to the end of the frame that has begun; if none has, it is taken to be as long as the last one."""
        head = inbox.peek(inbox.start, self._form.head_bytes)
        length = self._last_bytes if len(head) < self._form.head_bytes else self._form.length(head)
        return max(length - (inbox.end - inbox.start), 1)

    def _scan(self, inbox: Inbox, *, paused: bool) -> list[EventT_co | Discarded]:
        events: list[EventT_co | Discarded] = []
        while not self.done and inbox.seek(self._form.header):
            frames = self._frames_from(inbox, inbox.scan, paused=paused)
            if frames is None:
                break
            for start, end in frames:
                events += self._accept(inbox, start, end)
            inbox.scan += not frames
        else:
            begun = self._form.header[:1]
            inbox.scan = inbox.end - (len(self._form.header) > 1 and inbox.peek(inbox.end - 1, 1) == begun)
        return events + inbox.drop(self._kept_from(inbox))

    def _kept_from(self, inbox: Inbox) -> int:
        """What lies before is noise."""
        return inbox.scan

    def _accept(self, inbox: Inbox, start: int, end: int) -> list[EventT_co | Discarded]:
        noise = inbox.drop(start)
        event = self._read(inbox.take(end - start))
        self._due, self._last_bytes = inbox.start, max(end - start, self._form.least_bytes)
        self.done = self._once
        if isinstance(event, Discarded):
            inbox.discarded_bytes += len(event.data)
        elif event is not None:
            self.answers = 0
        return [*noise] if event is None else [*noise, event]

    def _frames_from(self, inbox: Inbox, at: int, *, paused: bool) -> list[tuple[int, int]] | None:
        """Starts and ends of the frames that the header at a position leads to; None if more must come."""
        head = inbox.peek(at, self._form.head_bytes)
        if len(head) < self._form.head_bytes:
            return None
        end, is_likely = at + self._form.length(head), self._form.is_likely(head)
        if (not is_likely or (paused and end > inbox.end)) and (inner := self._frames_within(inbox, at + 1, end)):
            return inner
        if end > inbox.end:
            return None
        if self._form.is_whole(inbox.peek(at, end - at)):
            return [(at, end)]
        if self._is_due(at):
            inbox.mark_damaged(at)
            self._due = end if is_likely and not self._once else None
        return []

    def _is_due(self, position: int) -> bool:
        return position == self._due

    def _frames_within(self, inbox: Inbox, begin: int, end: int) -> list[tuple[int, int]]:
        """The whole frame between two positions that is the first to end."""
        end, found, at = min(end, inbox.end), list[tuple[int, int]](), begin
        while (at := inbox.find(self._form.header, at, end)) >= 0:
            head = inbox.peek(at, self._form.head_bytes)
            its_end = at + self._form.length(head) if len(head) == self._form.head_bytes else end + 1
            if its_end <= end and self._form.is_whole(inbox.peek(at, its_end - at)):
                found.append((at, its_end))
            at += 1
        return sorted(found, key=lambda frame: frame[1])[:1]


class FrameDecoder(Generic[EventT_co]):
    """Bytes in, events out.

    What comes out does not depend on how the bytes are cut into feeds, only when.
    """

    def __init__(self, search: Search[EventT_co]) -> None:
        self._inbox = Inbox()
        self._search = search

    def feed(self, data: bytes) -> list[EventT_co | Discarded]:
        """Take bytes from the line.

        `data`: any number of bytes, cut anywhere.
        Returns packets, replies and discarded bytes, in the order of the line.
        """
        self._inbox.append(data)
        return self._and_then_nothing(self._search.scan(self._inbox))

    def quiet(self) -> list[EventT_co | Discarded]:
        """Take note that the line has been quiet for some 30 ms: what has begun and was not finished is discarded."""
        events = self._search.close(self._inbox)
        return self._and_then_nothing([*events, *self._inbox.drop(self._inbox.end)])

    def pause(self) -> list[EventT_co | Discarded]:
        """Take note that the line is quiet for the moment, while a stream is expected to go on.

        The beginning of a packet is kept: a line that was held up brings the rest later, and if it brings something
        else, the sum tells.
        """
        return self._search.release(self._inbox)

    def _and_then_nothing(self, events: list[EventT_co | Discarded]) -> list[EventT_co | Discarded]:
        if not self._search.done:
            return events
        self._search = Search()
        return events + self._search.scan(self._inbox)

    @property
    def holds(self) -> bool:
        """Whether bytes are held that may begin something."""
        return self._inbox.start < self._inbox.end

    @property
    def missing(self) -> int:
        """Bytes still needed to complete the next packet or reply.

        A reader that asks the port for so many wakes at a packet's end, neither before nor a packet late.
        """
        return self._search.missing(self._inbox)

    @property
    def answers(self) -> int:
        """Answers to what a unit was asked amid a stream, since its last packet."""
        return self._search.answers

    @property
    def bad_checksums(self) -> int:
        """Packets and replies that were due, began rightly and had a wrong sum."""
        return self._inbox.bad_checksums

    @property
    def discarded_bytes(self) -> int:
        """Bytes that belonged to no packet and no reply."""
        return self._inbox.discarded_bytes


def _joined(events: list[EventT | Discarded]) -> list[EventT | Discarded]:
    """Discarded bytes that follow each other as one event."""
    joined: list[EventT | Discarded] = []
    for event in events:
        before = joined[-1] if joined else None
        if isinstance(event, Discarded) and isinstance(before, Discarded):
            joined[-1] = Discarded(before.data + event.data, before.bad_checksum or event.bad_checksum)
        else:
            joined.append(event)
    return joined
