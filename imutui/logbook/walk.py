"""One walk over a log's bytes: a log is a sequence of items, and damage is an item.

A reader stops at the first `Damage`. `check` and `recover` give the walk marks by which it finds the next whole record
behind damage. A chunk is whole if its checksum is right and its content ends with a record; it is unpacked once.
"""

import bisect
import mmap
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import IO, NamedTuple, TypeAlias

import numpy as np
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, Footer, McapRecord

from imutui.logbook import mcap_format
from imutui.logbook.mcap_format import (
    FOOTER_SIZE,
    HEAD,
    LIMIT,
    MAGIC,
    MALFORMED,
    ChecksumError,
    Index,
    Inflater,
)
from imutui.logbook.mcap_stream import Batch, indexed_up_to, records_of, tabulate

CUT, CHECKSUM = "the file ends in the middle of ", "a checksum is wrong"
_DEPTH = 3  # heads of records that must make sense one after the other before bytes count as records
_BLOCK = 2**20  # bytes in which messages outside of chunks are looked for at once
_TRAILING = 64 * 2**20  # bytes behind a file's end in which its index is looked for
_MESSAGES = (Opcode.CHUNK, Opcode.MESSAGE)
_ONLY_MESSAGES = np.isin(np.arange(256), [Opcode.MESSAGE])
_ITEMS = frozenset(mcap_format.PARSED.keys() - {Opcode.DATA_END, Opcode.FOOTER})


class Mark(NamedTuple):
    """Bytes by which a record is found again behind damage."""

    text: bytes
    back: int  # how far behind the record's beginning they stand
    opcode: int  # of the record


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes that are no whole record."""

    # offset, bytes: where they begin, and how many
    offset: int
    bytes: int
    why: str  # what is wrong, as the end of a sentence
    what: str = ""  # "chunk", "attachment", … if it still shows; "" if it does not
    # after_ns, before_ns: Log time of the last message before and the first one after it, UTC, ns
    after_ns: int | None = None
    before_ns: int | None = None


@dataclass(frozen=True, slots=True)
class ChunkHead:
    """A whole chunk, whose records are the items that follow."""

    # first_ns, last_ns: log times that it spans, UTC, ns
    first_ns: int
    last_ns: int
    short: int = 0  # messages shorter than their own head, which are left out


@dataclass(frozen=True, slots=True)
class End:
    """How the file ends, and what was left out before."""

    finished: bool = False  # whether the footer and the magic are there
    cut: bool = False  # whether the file ends before its footer does
    trailing: int = 0  # bytes behind the footer that do not belong there
    indexed: bool = False  # whether the footer names a summary
    checksum_wrong: bool = False  # whether the checksum over all data is wrong though every record is whole
    unknown: int = 0  # records of kinds that the format leaves to others
    repeated: int = 0  # chunks that stood there before


Item: TypeAlias = McapRecord | Batch | ChunkHead | Damage | Index | End


def walk(
    stream: IO[bytes],
    marks: Sequence[Mark] = (),
    progress: Callable[[float], None] = lambda share: None,
    *,
    indexes: bool = False,
) -> Iterator[Item]:
    """Yield a log's items in file order; `End` is the last.

    `stream`: the file, not empty.
    `marks`: how to find records behind damage. Without any, the walk ends with the first `Damage`, and passes over
      what a reader of samples does not need: message indexes and the checksums of attachments.
    `progress`: called with the share done, 0 to 1.
    `indexes`: whether the index behind each chunk is compared with it, which takes time.
    """
    with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        yield from _Walk(data, marks, progress, indexes=indexes).items()


def within(data: bytes, inflater: Inflater, start: int = 0) -> Iterator[Item]:
    """Yield the items in some bytes of a log up to the first `Damage`; the first record begins at `start`."""
    yield from _Walk(data, inflater=inflater).items(start)


def follow(stream: IO[bytes]) -> Iterator[Item]:
    """Yield the items of a log that may still grow.

    `End` follows the last whole record that the file has by then. The next item is looked for when the caller asks for
    it, so the caller waits, and stops once the file has its end or no process writes it. `Damage` may be a record that
    is being written: if it is not, it comes again.

    `stream`: the file, not empty.
    """
    at = 0
    while True:
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            found = _Walk(data)
            yield from found.items(at)
            at = found.whole


class _BrokenRecordError(Exception):
    """Bytes are no whole record: why, up to where it would go, and its opcode."""

    def __init__(self, why: str, end: int = 0, opcode: int = 0) -> None:
        super().__init__(why)
        self.end, self.opcode = end, opcode


class _Walk:
    """One walk over a file's bytes."""

    def __init__(
        self,
        data: mmap.mmap | bytes,
        marks: Sequence[Mark] = (),
        progress: Callable[[float], None] = lambda share: None,
        *,
        indexes: bool = False,
        inflater: Inflater | None = None,
    ) -> None:
        self._data, self._size = data, len(data)
        self._marks, self._progress, self._indexes = marks, progress, indexes
        self._inflater = inflater or Inflater(self._size)
        self._next = [-1] * len(marks)
        self._chunks: set[int] = set()
        self._starts: list[int] = []
        self._inside: bytes | None = None
        self._fitting = 0  # up to where message indexes are known to be what they must be
        self._found: tuple[int, list[Item], int] = (-1, [], 0)  # the record that the last search found
        self._summed, self._sum = 0, 0
        self._in_summary = self._damaged = self._wrong = False
        self._footer: Footer | None = None
        self._unknown = self._repeated = 0
        self.whole = 0  # where the last whole record before the footer ends

    def items(self, start: int = 0) -> Iterator[Item]:
        """Yield the items from the first byte, or from a record that begins at `start`, to the last."""
        if self._marks and (index := self._index()) is not None:
            self._starts = index.starts
            yield index
        self.whole, at = start, start or len(MAGIC)
        self._damaged = start > 0  # the checksum over all data is compared by a walk over all data
        if not start and self._data[:at] != MAGIC:
            cut = MAGIC.startswith(self._data[:at])
            damage = self._damage(
                0, _BrokenRecordError(f"{CUT}its first bytes" if cut else "it does not begin as it must")
            )
            yield damage
            at = damage.bytes
        held_from = 0
        while at < self._size and self._footer is None:
            try:
                items, end = self._record(at)
            except _BrokenRecordError as broken:
                damage = self._damage(at, broken)
                yield damage
                at = damage.offset + damage.bytes
                continue
            yield from items
            at = end
            if self._footer is None:
                self.whole = at
            if at - held_from > WINDOW:
                self._add_to_sum(at)
                forget(self._data, held_from, at)
                held_from = at
            self._progress(at / self._size)
        yield self._end(at)

    def _end(self, at: int) -> End:
        ended, rest = self._footer is not None, self._data[at : at + len(MAGIC)]
        finished = ended and rest == MAGIC
        cut = not ended or (not finished and MAGIC.startswith(rest))
        trailing = 0 if cut else self._size - at - (len(MAGIC) if finished else 0)
        indexed = self._footer is not None and bool(self._footer.summary_start)
        return End(finished, cut, trailing, indexed, ended and self._wrong, self._unknown, self._repeated)

    def _add_to_sum(self, end: int) -> None:
        if not self._in_summary and not self._damaged:
            with memoryview(self._data) as view:
                self._sum = zlib.crc32(view[self._summed : end], self._sum)
            self._summed = end

    # -- a record --

    def _record(self, at: int) -> tuple[list[Item], int]:
        """Return the items of the record at an offset, and where the next one begins; raise if it is not whole."""
        if self._found[0] == at:
            _, items, end = self._found
        else:
            items, end = self._whole(at)
        opcode = self._data[at]
        if opcode == Opcode.DATA_END:
            self._add_to_sum(at)
            self._in_summary, stated = True, int.from_bytes(self._data[at + HEAD.size : end], "little")
            self._wrong = stated not in (0, self._sum) and not self._damaged
        elif opcode == Opcode.FOOTER:
            self._footer = mcap_format.parse(Footer, self._data[at + HEAD.size : end])
        elif opcode == Opcode.CHUNK and self._marks and self._repeats(self._data[at + HEAD.size : end]):
            self._repeated += 1
            return [], end
        elif opcode >= mcap_format.PRIVATE:
            self._unknown += not self._in_summary
        return ([], end) if self._in_summary else (items, end)

    def _repeats(self, body: bytes) -> bool:
        """Whether the same chunk stood there before."""
        key, known = len(body) << 64 | zlib.crc32(body) << 32 | zlib.adler32(body), len(self._chunks)
        self._chunks.add(key)
        return len(self._chunks) == known

    def _whole(self, at: int) -> tuple[list[Item], int]:
        """Return the items and the end of a record that is whole; raise _BrokenRecordError otherwise."""
        if at + HEAD.size > self._size:
            raise _BrokenRecordError(f"{CUT}a record")
        opcode, length = HEAD.unpack_from(self._data, at)
        first, end = at + HEAD.size, at + HEAD.size + length
        if opcode not in mcap_format.OPCODES and opcode < mcap_format.PRIVATE:
            raise _BrokenRecordError("these bytes are no record", end, opcode)
        why = ""
        if length > LIMIT:
            why = "a length is out of range"
        elif end > self._size:
            why = f"{CUT}{_article(_name(opcode))}"
        elif self._in_summary and opcode in _MESSAGES:
            why = "messages stand behind the end of the data"
        elif opcode >= mcap_format.PRIVATE and not self._follows(end):
            why = "these bytes are no record"
        if why:
            raise _BrokenRecordError(why, end, opcode)
        try:
            if opcode == Opcode.MESSAGE:
                return self._messages(at, end)
            return self._items(opcode, first, end), end
        except ChecksumError:
            raise _BrokenRecordError(CHECKSUM, end, opcode) from None
        except (*MALFORMED, MemoryError) as error:
            raise _BrokenRecordError(
                f"{_article(_name(opcode))} cannot be read ({reason(error)})", end, opcode
            ) from error

    def _items(self, opcode: int, first: int, end: int) -> list[Item]:
        """Return the items of a record's content; raise one of MALFORMED if it is not what it must be."""
        if opcode == Opcode.CHUNK:
            return self._chunk(self._data[first:end], end)
        if opcode == Opcode.MESSAGE_INDEX:
            if self._marks and first >= self._fitting:
                whole = self._data[first - HEAD.size : end]
                if not indexed_up_to(whole, 0, self._inside if self._indexes else None):
                    raise McapError("it does not fit its chunk")
            return []
        if opcode in _SIZES and end - first != _SIZES[opcode]:
            raise McapError("its length is wrong")
        if opcode not in mcap_format.PARSED:
            return []
        body = self._data[first:end]
        record = mcap_format.parse(mcap_format.PARSED[opcode], body)
        summed = isinstance(record, Attachment) and self._marks
        if summed and int.from_bytes(body[-4:], "little") not in (0, zlib.crc32(body[:-4])):
            raise McapError("a checksum is wrong")
        return [record] if opcode in _ITEMS else []

    def _chunk(self, body: bytes, end: int) -> list[Item]:
        self._inside = None
        chunk = mcap_format.parse(Chunk, body)
        content = self._inflater.content(chunk)
        found = tabulate(content)
        if found.end != len(content):
            raise McapError("its content ends in the middle of a record")
        short = found.short
        rows = found.rows[~short] if short.any() else found.rows
        items = list(records_of(content, rows))
        self._inside = content
        # all entries at once; one by one, which takes longer, only to report which one is wrong
        if self._marks:
            self._fitting = indexed_up_to(self._data, end, content if self._indexes else None)
        return [ChunkHead(chunk.message_start_time, chunk.message_end_time, int(short.sum())), *items]

    def _messages(self, at: int, end: int) -> tuple[list[Item], int]:
        """Return the messages outside of chunks that begin at an offset, as one batch, and where they end."""
        content = self._data[at : max(end, min(at + _BLOCK, self._size))]
        found = tabulate(content, _ONLY_MESSAGES)
        opcodes = np.frombuffer(content, np.uint8)[found.starts]
        in_a_row = int(np.argmax(np.append(opcodes != Opcode.MESSAGE, True)))
        count = int(np.argmax(np.append(found.short[:in_a_row], True)))
        if not count:
            raise McapError("a message is shorter than its header")
        end = int(found.starts[count]) if count < opcodes.size else found.end
        return [Batch(content, found.rows[:count])], at + end

    # -- where to go on --

    def _damage(self, at: int, broken: _BrokenRecordError) -> Damage:
        """Return the damage from an offset to where the next whole record begins."""
        self._damaged = True
        why, end, opcode = str(broken), broken.end, broken.opcode
        if not self._marks:
            return Damage(at, self._size - at, why, _name(opcode))
        # its length may be right all the same: others follow it
        inside = 0 < end < self._size and self._follows(end)
        k = bisect.bisect(self._starts, at)
        indexed = self._starts[k] if k < len(self._starts) else self._size
        go_on = end if inside else min(self._found_again(at), indexed)
        of_index = self._in_summary and opcode not in _MESSAGES
        what = "summary" if of_index else _name(opcode) if opcode in mcap_format.OPCODES else ""
        if opcode == Opcode.MESSAGE_INDEX and not inside and go_on < self._size:
            what = ""  # what else stood there is not known
        return Damage(at, go_on - at, why, what)

    def _follows(self, at: int) -> bool:
        """Whether records begin here, as far as their heads tell."""
        for _ in range(_DEPTH):
            if at + HEAD.size > self._size:
                break
            opcode, length = HEAD.unpack_from(self._data, at)
            if opcode not in mcap_format.OPCODES or length > LIMIT:
                return False
            if opcode == Opcode.FOOTER:
                return bool(length == FOOTER_SIZE)
            at += HEAD.size + length
        return True

    def _found_again(self, at: int) -> int:
        """Return where the next record begins that a mark shows and that is whole."""
        for number, mark in enumerate(self._marks):
            if self._next[number] <= at:
                self._next[number] = self._search(at, mark)
        return min(self._next)

    def _search(self, at: int, mark: Mark) -> int:
        found = at + mark.back
        while (found := find(self._data, mark.text, found + 1)) >= 0:
            start = found - mark.back
            if self._data[start] != mark.opcode or start + HEAD.size > self._size:
                continue
            try:
                items, end = self._whole(start)
            except _BrokenRecordError:
                continue
            if self._follows(start):
                self._found = start, items, end
                return start
        return self._size

    def _index(self) -> Index | None:
        """Return the summary, if there is one that is right; bytes may follow the file's end."""
        assert isinstance(self._data, mmap.mmap)
        for size in (self._size, self._data.rfind(MAGIC, max(len(MAGIC), self._size - _TRAILING)) + len(MAGIC)):
            try:
                index = mcap_format.read_index(self._data, size)
            except MALFORMED:
                continue
            if index is not None:
                return index
        return None


_SIZES: dict[int, int] = {Opcode.FOOTER: FOOTER_SIZE, Opcode.DATA_END: 4}


def _name(opcode: int) -> str:
    return Opcode(opcode).name.lower().replace("_", " ") if opcode in mcap_format.OPCODES else "record"


def _article(name: str) -> str:
    return f"an {name}" if name[0] in "aeiou" else f"a {name}"


def reason(error: BaseException) -> str:
    """Return the first line of an error's text."""
    return str(error).splitlines()[0][:120] if str(error) else type(error).__name__


# -------------------------------------------------------------------------------------------------------- mapped file
# A mapped file that is walked from end to end does not stay in memory.

WINDOW = 8 * 2**20  # bytes that are read before those behind them are released


def forget(data: mmap.mmap | bytes, first: int, last: int) -> None:
    """Release the memory that holds a file's bytes between two offsets; the kernel reads them anew on demand."""
    begin = -(-first // mmap.PAGESIZE) * mmap.PAGESIZE
    length = last // mmap.PAGESIZE * mmap.PAGESIZE - begin
    # not every system has the call
    if isinstance(data, mmap.mmap) and length > 0 and hasattr(mmap, "MADV_DONTNEED"):
        data.madvise(mmap.MADV_DONTNEED, begin, length)


def find(data: mmap.mmap | bytes, mark: bytes, start: int) -> int:
    """Return the offset of the first such bytes from `start` on; -1 if there are none."""
    size = len(data)
    for first in range(start, size, WINDOW):
        last = min(first + WINDOW, size)
        found = data.find(mark, first, min(last + len(mark) - 1, size))
        if found >= 0:
            return found
        forget(data, first, last)
    return -1
