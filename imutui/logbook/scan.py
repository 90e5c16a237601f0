"""A walk over a file's bytes that goes on behind damage: which records are whole, and which bytes are none.

`reader` stops at the first damage, since what follows it is no even sequence any more; `check` and `recover` want all.
A chunk counts as whole if its checksum is right and its content ends with a record.
"""

import bisect
import mmap
import struct
import zlib
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Header

from imutui.logbook import effects_file, file_lock, mcap_format, reader, reference_file, summary
from imutui.logbook.mcap_format import (
    FOOTER_SIZE,
    HEAD,
    LIMIT,
    MAGIC,
    MALFORMED,
    ChecksumError,
    Index,
    prefixed,
)
from imutui.logbook.mcap_stream import OPCODE, RecordTable, tabulate, told_behind
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.session_info import METADATA

RECOVERED = "imutui.recovered"  # metadata record of a file that was rebuilt: from what, and what was lost
_DEPTH = 3  # heads of records that must make sense one after the other before bytes count as records

_ATTACHED = (summary.CONFIGURATION, effects_file.ATTACHMENT, summary.SUMMARY, *reference_file.ATTACHMENTS)
_MARKS: tuple[tuple[bytes, int, int], ...] = (
    *((prefixed(name), mcap_format.COMPRESSION_OFFSET, Opcode.CHUNK) for name in mcap_format.COMPRESSIONS),
    *((prefixed(name), HEAD.size, Opcode.METADATA) for name in (METADATA, RECOVERED)),
    *((prefixed(name), mcap_format.ATTACHMENT_NAME_OFFSET, Opcode.ATTACHMENT) for name in _ATTACHED),
    (HEAD.pack(Opcode.DATA_END, 4), 0, Opcode.DATA_END),
)
"""Bytes by which a record is found again behind damage, how far behind its beginning they stand, and its opcode."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A whole record: its kind, where its content lies, and of a chunk the log times it spans, UTC, ns."""

    opcode: int
    at: int
    length: int
    first_ns: int = 0
    last_ns: int = 0


@dataclass(slots=True)
class Pieces:
    """Whole records in file order: forty bytes each, where a log of a week has half a million."""

    numbers: "array[int]" = field(default_factory=lambda: array("Q"))  # the fields of one after the other

    def append(self, piece: Piece) -> None:
        """One more."""
        self.numbers.extend((piece.opcode, piece.at, piece.length, piece.first_ns, piece.last_ns))

    def __len__(self) -> int:
        return len(self.numbers) // 5

    def __iter__(self) -> Iterator[Piece]:
        each = iter(self.numbers)
        return (Piece(*fields) for fields in zip(each, each, each, each, each, strict=True))


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


@dataclass(slots=True)
class Scan:
    """A file as its bytes have it."""

    # path, size: the file
    path: Path
    size: int = 0
    profile: str | None = None  # of its header; None if that is gone
    # whole records in file order: chunks, attachments, metadata, and what stands outside of chunks
    pieces: Pieces = field(default_factory=Pieces)
    damages: list[Damage] = field(default_factory=list)  # bytes left out between them
    has_index: bool = True  # whether the footer states that there is a summary
    index: Index | None = None  # the summary, if it can be read and its checksum is right
    finished: bool = False  # whether the file has its footer
    cut: bool = False  # whether it ends before its footer
    trailing: int = 0  # bytes behind its footer that do not belong there
    checksum_wrong: bool = False  # whether the checksum over all data is wrong though every record looks whole
    repeated: int = 0  # chunks that stand there twice; the second is left out
    unknown: int = 0  # records of kinds that the format does not define
    held: bool = False  # whether a recorder is writing to it


@dataclass(frozen=True, slots=True)
class Found:
    """A whole record of the file."""

    opcode: int
    content: bytes  # of the record; of a chunk what it holds, of a record outside of chunks all of it with its head
    table: RecordTable | None = None  # records in the content; None for metadata and attachments


def scan(path: Path, progress: Callable[[float], None] = lambda share: None, *, indexes: bool = False) -> Scan:
    """Walk a file and return what it is; see `walk`."""
    found = Scan(path)
    for _ in walk(found, progress, indexes=indexes):
        pass
    return found


def walk(
    found: Scan, progress: Callable[[float], None] = lambda share: None, *, indexes: bool = False
) -> Iterator[Found]:
    """Yield the whole records of a file in order, going on behind damage; each chunk is inflated once.

    `found`: of the file; its index is there before the first record, and all of it after the last.
    `progress`: called with the share done, 0 to 1.
    `indexes`: whether the index behind each chunk is compared with it; nothing here reads them, and it takes time.
    Raises UnreadableLogError if there is no such file, it is empty, or nothing in it is a record of an MCAP file.
    """
    with reader.opened(found.path) as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        found.size = len(data)
        found.held = file_lock.is_held(stream)
        yield from _FileWalk(data, found, progress, indexes=indexes).run()
        if not found.pieces and data[: len(MAGIC)] != MAGIC:
            raise UnreadableLogError(reader.foreign(found.path))
        _judge(found)


def _judge(found: Scan) -> None:
    """State of each damage between which instants it lies, by the chunks around it."""
    if not found.damages:
        return
    pieces = np.frombuffer(found.pieces.numbers, np.uint64).reshape(-1, 5)
    _, at, _, first_ns, last_ns = pieces[pieces[:, 0] == Opcode.CHUNK].T
    for number, damage in enumerate(found.damages):
        k = int(np.searchsorted(at, damage.offset, side="right"))
        after = int(last_ns[k - 1]) if k else None
        before = int(first_ns[k]) if k < at.size else None
        found.damages[number] = replace(damage, after_ns=after, before_ns=before)


def content(data: mmap.mmap | bytes, piece: Piece) -> bytes:
    """Content of a record, copied out of the file's bytes."""
    return bytes(data[piece.at : piece.at + piece.length])


class _FileWalk:
    """One walk over a file's bytes."""

    def __init__(self, data: mmap.mmap, found: Scan, progress: Callable[[float], None], *, indexes: bool) -> None:
        self._indexes = indexes
        self._inside: bytes | None = None
        self._table: RecordTable | None = None  # records inside of the last chunk
        self._new: Found | None = None  # what the last step found
        self._fitting = 0  # up to where message indexes are known to be what they must be
        self._data = data
        self._found = found
        self._progress = progress
        self._inflater = mcap_format.Inflater(found.size)
        self._next = dict.fromkeys(range(len(_MARKS)), -1)
        self._chunks: set[int] = set()
        self._starts: list[int] | None = None
        self._held_from = 0
        self._in_summary = False

    def run(self) -> Iterator[Found]:
        """Walk from the first byte to the last; note pieces and damages in the scan."""
        found = self._found
        found.index = self._index(found.size)
        at = len(MAGIC) if self._data[: len(MAGIC)] == MAGIC else self._after_damage(0, "it does not begin as it must")
        while at < found.size and not found.finished:
            at = self._step(at)
            if self._new is not None:
                yield self._new
                self._new = None
            if at - self._held_from > WINDOW:
                forget(self._data, self._held_from, at)
                self._held_from = at
            self._progress(at / found.size)
        if found.finished:
            self._end(at)
        else:
            found.cut = True

    def _end(self, at: int) -> None:
        """What comes behind the footer."""
        found, rest = self._found, self._data[at : at + len(MAGIC)]
        found.finished = rest == MAGIC
        found.cut = not found.finished and MAGIC.startswith(rest)
        found.trailing = 0 if found.cut else found.size - at - (len(MAGIC) if found.finished else 0)
        if found.index is None and found.finished:
            found.index = self._index(at + len(MAGIC))

    def _step(self, at: int) -> int:
        """One record, or the damage in its place; returns where to go on."""
        if at + HEAD.size > self._found.size:
            return self._after_damage(at, "the file ends in the middle of a record")
        opcode, length = HEAD.unpack_from(self._data, at)
        end = at + HEAD.size + length
        why = self._trouble(opcode, at + HEAD.size, length)
        if why:
            return self._after_damage(at, why, end, opcode)
        if opcode == Opcode.FOOTER:
            self._found.finished = True
            self._found.has_index = any(self._data[at + HEAD.size : at + HEAD.size + 8])
        elif opcode == Opcode.DATA_END:
            self._end_of_data(at)
        elif opcode >= mcap_format.PRIVATE:
            self._found.unknown += 1
        elif not self._in_summary and opcode != Opcode.MESSAGE_INDEX:
            self._keep(Piece(opcode, at + HEAD.size, length))
        return int(end)

    def _keep(self, piece: Piece) -> None:
        if piece.opcode == Opcode.HEADER:
            self._found.profile = mcap_format.parse(Header, content(self._data, piece)).profile
            return
        if piece.opcode == Opcode.CHUNK:
            body = content(self._data, piece)
            mark = piece.length << 64 | zlib.crc32(body) << 32 | zlib.adler32(body)
            if mark in self._chunks:
                self._found.repeated += 1
                return
            self._chunks.add(mark)
            first_ns, last_ns = mcap_format.chunk_times(body)
            piece = replace(piece, first_ns=first_ns, last_ns=last_ns)
            self._new = Found(piece.opcode, self._inside or b"", self._table)
        elif piece.opcode in (Opcode.METADATA, Opcode.ATTACHMENT):
            self._new = Found(piece.opcode, content(self._data, piece))
        else:
            whole = HEAD.pack(piece.opcode, piece.length) + content(self._data, piece)
            self._new = Found(piece.opcode, whole, tabulate(whole))
        self._found.pieces.append(piece)

    def _end_of_data(self, at: int) -> None:
        self._in_summary = True
        (told,) = struct.unpack_from("<I", self._data, at + HEAD.size)
        if told and not self._found.damages:
            self._found.checksum_wrong = crc32(self._data, at) != told

    # -- what is wrong with a record --

    def _trouble(self, opcode: int, at: int, length: int) -> str:
        """What is wrong with a record, "" if nothing is."""
        if opcode not in mcap_format.OPCODES and opcode < mcap_format.PRIVATE:
            return "these bytes are no record"
        if at + length > self._found.size:
            return f"the file ends in the middle of {_article(_name(opcode))}"
        if length > LIMIT:
            return "a length is out of range"
        if self._in_summary and opcode in _MESSAGES:
            return "it stands behind the end of the data"
        if opcode >= mcap_format.PRIVATE:
            return "" if self._follows(at + length) else "these bytes are no record"
        try:
            self._check(opcode, at, content(self._data, Piece(opcode, at, length)))
        except ChecksumError:
            return "a checksum is wrong"
        except (*MALFORMED, MemoryError) as error:
            return f"{_article(_name(opcode))} cannot be read ({reason(error)})"
        return ""

    def _check(self, opcode: int, at: int, body: bytes) -> None:
        """Raise if the content of a record, which begins at an offset, is not what it must be."""
        if opcode == Opcode.CHUNK:
            self._inside = None
            inside = self._inflater.content(mcap_format.chunk_of(body))
            told = told_behind(self._data, at + len(body))
            found = tabulate(inside, told=told.entries[:, 1])
            if found.end != len(inside):
                raise McapError("its content ends in the middle of a record")
            for kind, _, start, length in found.rows[found.rows[:, OPCODE] != Opcode.MESSAGE].tolist():
                mcap_format.parse(mcap_format.PARSED[kind], inside[start : start + length])
            self._inside, self._table = inside, found
            # all of them at once; one by one, which takes longer, only to say which one is wrong
            self._fitting = told.end if not self._indexes or told.fits(inside) else 0
        elif opcode == Opcode.MESSAGE_INDEX and at >= self._fitting:
            told = told_behind(HEAD.pack(opcode, len(body)) + body, 0)
            if not told.end or (self._indexes and self._inside is not None and not told.fits(self._inside)):
                raise McapError("it does not fit its chunk")
        elif opcode == Opcode.ATTACHMENT:
            mcap_format.parse(Attachment, body)
            (told,) = struct.unpack("<I", body[-4:])
            if told and told != zlib.crc32(body[:-4]):
                raise McapError("a checksum is wrong")
        elif opcode == Opcode.MESSAGE:
            mcap_format.MESSAGE.unpack_from(body)
        elif opcode in _SIZES:
            if len(body) != _SIZES[opcode]:
                raise McapError("its length is wrong")
        elif opcode in mcap_format.PARSED:
            mcap_format.parse(mcap_format.PARSED[opcode], body)

    # -- where to go on --

    def _after_damage(self, at: int, why: str, end: int = 0, opcode: int = 0) -> int:
        """Note damage and return where the next whole record begins."""
        # its length may be right all the same: others follow it
        inside = 0 < end < self._found.size and self._follows(end)
        go_on = end if inside else min(self._found_again(at), self._told_by_index(at))
        of_index = self._in_summary and opcode not in _MESSAGES
        what = "summary" if of_index else _name(opcode) if opcode in mcap_format.OPCODES else ""
        if opcode == Opcode.MESSAGE_INDEX and not inside and go_on < self._found.size:
            what = ""  # what else stood there is not known
        self._found.damages.append(Damage(at, go_on - at, why, what))
        return go_on

    def _follows(self, at: int) -> bool:
        """Whether records begin here, as far as their heads tell."""
        for _ in range(_DEPTH):
            if at + HEAD.size > self._found.size:
                break
            opcode, length = HEAD.unpack_from(self._data, at)
            if opcode not in mcap_format.OPCODES or length > LIMIT:
                return False
            if opcode == Opcode.FOOTER:
                return bool(length == FOOTER_SIZE)
            at += HEAD.size + length
        return True

    def _told_by_index(self, at: int) -> int:
        if self._starts is None:
            self._starts = self._found.index.starts if self._found.index is not None else []
        k = bisect.bisect(self._starts, at)
        return self._starts[k] if k < len(self._starts) else self._found.size

    def _found_again(self, at: int) -> int:
        """Where the next record begins that can be told by its marks and is whole."""
        for number, (mark, back, opcode) in enumerate(_MARKS):
            if self._next[number] <= at:
                self._next[number] = self._search(at, mark, back, opcode)
        return min(self._next.values())

    def _search(self, at: int, mark: bytes, back: int, opcode: int) -> int:
        found = at + back
        while (found := find(self._data, mark, found + 1)) >= 0:
            start = found - back
            if self._data[start] != opcode or start + HEAD.size > self._found.size:
                continue
            _, length = HEAD.unpack_from(self._data, start)
            if not self._trouble(opcode, start + HEAD.size, length) and self._follows(start):
                return start
        return self._found.size

    def _index(self, size: int) -> Index | None:
        """The summary, if the file's first `size` bytes end with one that is right."""
        tail = size - mcap_format.TAIL
        if tail < len(MAGIC):
            return None
        try:
            return mcap_format.read_index(self._data[tail:size], size, lambda first, last: self._data[first:last])
        except MALFORMED:
            return None


_MESSAGES = (Opcode.CHUNK, Opcode.MESSAGE)
_SIZES: dict[int, int] = {Opcode.FOOTER: FOOTER_SIZE, Opcode.DATA_END: 4}


def _name(opcode: int) -> str:
    return Opcode(opcode).name.lower().replace("_", " ") if opcode in mcap_format.OPCODES else "record"


def _article(name: str) -> str:
    return f"an {name}" if name[0] in "aeiou" else f"a {name}"


def reason(error: BaseException) -> str:
    """What an error says, briefly."""
    return str(error).splitlines()[0][:120] if str(error) else type(error).__name__


# -------------------------------------------------------------------------------------------------------- mapped file
# A mapped file that is walked from end to end: what has been looked at does not stay in memory.

WINDOW = 8 * 2**20  # bytes that are looked at before those behind are let go


def forget(data: mmap.mmap, first: int, last: int) -> None:
    """Let go of the memory that holds a file's bytes from one offset up to another; they are read anew when asked for.

    `data`: a file, mapped for reading.
    `first`, `last`: offsets; whole pages between them are let go.
    """
    begin = -(-first // mmap.PAGESIZE) * mmap.PAGESIZE
    length = last // mmap.PAGESIZE * mmap.PAGESIZE - begin
    # not every system can be told
    if length > 0 and hasattr(mmap, "MADV_DONTNEED"):
        data.madvise(mmap.MADV_DONTNEED, begin, length)


def find(data: mmap.mmap, mark: bytes, start: int) -> int:
    """Offset of the first such bytes from `start` on; -1 if there are none."""
    size = len(data)
    for first in range(start, size, WINDOW):
        last = min(first + WINDOW, size)
        found = data.find(mark, first, min(last + len(mark) - 1, size))
        if found >= 0:
            return found
        forget(data, first, last)
    return -1


def crc32(data: mmap.mmap, end: int) -> int:
    """Checksum of a file's bytes up to an offset."""
    checksum = 0
    with memoryview(data) as view:
        for first in range(0, end, WINDOW):
            last = min(first + WINDOW, end)
            checksum = zlib.crc32(view[first:last], checksum)
            forget(data, first, last)
    return checksum
