"""A walk over a file's bytes that goes on behind damage: which records are whole, and which bytes are none.

`reader` stops at the first damage, since what follows it is no even sequence any more; `check` and `recover` want all.
A chunk counts as whole if its checksum is right and its content ends with a record.
"""

import bisect
import mmap
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.stream_reader import CRCValidationError

from imutui.logbook import (
    effects_file,
    file_lock,
    mcap_format,
    mcap_kernels,
    reader,
    reference_file,
    summary,
)
from imutui.logbook.mcap_format import LIMIT, MAGIC
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.session_info import METADATA

RECOVERED = "imutui.recovered"
"""Metadata record of a file that was rebuilt: from what, and what was lost."""
CONFIGURATION = "configuration.toml"
_HEAD = struct.Struct("<BQ")
_FOOTER = struct.Struct("<BQQQI")
_SPAN = struct.Struct("<QQ")
_KNOWN = frozenset(range(1, 0x10))
_PRIVATE = 0x80
_DEPTH = 3
_CHUNK_MARK = _HEAD.size + 28
_ATTACHMENT_MARK = _HEAD.size + 16
_UNREADABLE = (McapError, EndOfFile, struct.error, zstandard.ZstdError, UnicodeDecodeError, ValueError, IndexError)


def _mark(name: str) -> bytes:
    """A name as it stands in a record: its length before it."""
    return struct.pack("<I", len(name)) + name.encode()


_ATTACHED = (CONFIGURATION, effects_file.ATTACHMENT, summary.SUMMARY, *reference_file.ATTACHMENTS)
_MARKS: tuple[tuple[bytes, int, int], ...] = (
    *((_mark(name), _CHUNK_MARK, Opcode.CHUNK) for name in ("zstd", "lz4")),
    *((_mark(name), _HEAD.size, Opcode.METADATA) for name in (METADATA, RECOVERED)),
    *((_mark(name), _ATTACHMENT_MARK, Opcode.ATTACHMENT) for name in _ATTACHED),
    (_HEAD.pack(Opcode.DATA_END, 4), 0, Opcode.DATA_END),
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


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes that are no whole record.

    Attributes
    ----------
    offset, bytes : int
        Where they begin, and how many.
    why : str
        What is wrong, as the end of a sentence.
    what : str
        "chunk", "attachment", … if it still shows; "" if it does not.
    after_ns, before_ns : int or None
        Log time of the last message before and the first one after it, UTC, ns.
    """

    offset: int
    bytes: int
    why: str
    what: str = ""
    after_ns: int | None = None
    before_ns: int | None = None


@dataclass(slots=True)
class Index:
    """What a finished file's summary says.

    Attributes
    ----------
    schemas, channels : dict
        By their numbers.
    starts : list of int
        Where chunks, attachments and metadata begin.
    statistics : Statistics or None
        Counts of everything.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    starts: list[int] = field(default_factory=list)
    statistics: Statistics | None = None


@dataclass(slots=True)
class Scan:
    """A file as its bytes have it.

    Attributes
    ----------
    path, size : Path, int
        The file.
    profile : str or None
        Of its header; None if that is gone.
    pieces : list of Piece
        Whole records in file order: chunks, attachments, metadata, and what stands outside of chunks.
    damages : list of Damage
        Bytes left out between them.
    index : Index or None
        The summary, if it can be read and its checksum is right.
    finished : bool
        Whether the file has its footer.
    cut : bool
        Whether it ends before its footer.
    trailing : int
        Bytes behind its footer that do not belong there.
    checksum_wrong : bool
        Whether the checksum over all data is wrong though every record looks whole.
    repeated : int
        Chunks that stand there twice; the second is left out.
    unknown : int
        Records of kinds that the format does not define.
    held : bool
        Whether a recorder is writing to it.
    """

    path: Path
    size: int = 0
    profile: str | None = None
    pieces: list[Piece] = field(default_factory=list)
    damages: list[Damage] = field(default_factory=list)
    index: Index | None = None
    finished: bool = False
    cut: bool = False
    trailing: int = 0
    checksum_wrong: bool = False
    repeated: int = 0
    unknown: int = 0
    held: bool = False


def scan(path: Path, progress: Callable[[float], None] = lambda share: None) -> Scan:
    """Walk a file.

    Parameters
    ----------
    path : Path
        Any file.
    progress : callable
        Told the share done, 0 to 1.

    Raises
    ------
    UnreadableLogError
        If there is no such file, it is empty, or nothing in it is a record of an MCAP file.
    """
    with reader.opened(path) as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        found = Scan(path, len(data))
        found.held = file_lock.is_held(stream)
        walk = _Walk(data, found, progress)
        walk.run()
        if not found.pieces and data[: len(MAGIC)] != MAGIC:
            raise UnreadableLogError(reader.foreign(path))
        _judge(found, data)
    return found


def _judge(found: Scan, data: mmap.mmap) -> None:
    """Say of each damage between which instants it lies, as the chunks around it tell."""
    chunks = [piece for piece in found.pieces if piece.opcode == Opcode.CHUNK]
    ends = [piece.at for piece in chunks]
    for number, damage in enumerate(found.damages):
        k = bisect.bisect(ends, damage.offset)
        after = chunks[k - 1].last_ns if k else None
        before = chunks[k].first_ns if k < len(chunks) else None
        found.damages[number] = replace(damage, after_ns=after, before_ns=before)


def content(data: mmap.mmap | bytes, piece: Piece) -> bytes:
    """Bytes of a record's content."""
    return bytes(data[piece.at : piece.at + piece.length])


class _Walk:
    """One walk over a file's bytes."""

    def __init__(self, data: mmap.mmap, found: Scan, progress: Callable[[float], None]) -> None:
        self._data = data
        self._found = found
        self._progress = progress
        self._decompressor = zstandard.ZstdDecompressor()
        self._next = dict.fromkeys(range(len(_MARKS)), -1)
        self._chunks: set[tuple[int, int, int]] = set()
        self._in_summary = False

    def run(self) -> None:
        """Fill the scan."""
        found = self._found
        found.index = self._index(found.size)
        at = len(MAGIC) if self._data[: len(MAGIC)] == MAGIC else self._after_damage(0, "it does not begin as it must")
        while at < found.size and not found.finished:
            at = self._step(at)
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
        if at + _HEAD.size > self._found.size:
            return self._after_damage(at, "the file ends in the middle of a record")
        opcode, length = _HEAD.unpack_from(self._data, at)
        end = at + _HEAD.size + length
        why = self._trouble(opcode, at + _HEAD.size, length)
        if why:
            return self._after_damage(at, why, end, opcode)
        if opcode == Opcode.FOOTER:
            self._found.finished = True
        elif opcode == Opcode.DATA_END:
            self._end_of_data(at)
        elif opcode >= _PRIVATE:
            self._found.unknown += 1
        elif not self._in_summary and opcode != Opcode.MESSAGE_INDEX:
            self._keep(Piece(opcode, at + _HEAD.size, length))
        return int(end)

    def _keep(self, piece: Piece) -> None:
        if piece.opcode == Opcode.HEADER:
            self._found.profile = Header.read(_stream(content(self._data, piece))).profile
            return
        if piece.opcode == Opcode.CHUNK:
            body = content(self._data, piece)
            mark = (piece.length, zlib.crc32(body), zlib.adler32(body))
            if mark in self._chunks:
                self._found.repeated += 1
                return
            self._chunks.add(mark)
            piece = replace(
                piece, first_ns=int.from_bytes(body[:8], "little"), last_ns=int.from_bytes(body[8:16], "little")
            )
        self._found.pieces.append(piece)

    def _end_of_data(self, at: int) -> None:
        self._in_summary = True
        (told,) = struct.unpack_from("<I", self._data, at + _HEAD.size)
        if told and not self._found.damages:
            with memoryview(self._data) as view:
                self._found.checksum_wrong = zlib.crc32(view[:at]) != told

    # -- what is wrong with a record --

    def _trouble(self, opcode: int, at: int, length: int) -> str:
        """What is wrong with a record, "" if nothing is."""
        if opcode not in _KNOWN and opcode < _PRIVATE:
            return "these bytes are no record"
        if at + length > self._found.size:
            return f"the file ends in the middle of {_article(_name(opcode))}"
        if length > LIMIT:
            return "a length is out of range"
        if opcode >= _PRIVATE:
            return "" if self._follows(at + length) else "these bytes are no record"
        try:
            self._check(opcode, content(self._data, Piece(opcode, at, length)))
        except CRCValidationError:
            return "a checksum is wrong"
        except (*_UNREADABLE, MemoryError) as error:
            return f"{_article(_name(opcode))} cannot be read ({_short(error)})"
        return ""

    def _check(self, opcode: int, body: bytes) -> None:
        """Raise if a record's content is not what it must be."""
        if opcode == Opcode.CHUNK:
            inside = mcap_format.inflated(mcap_format.chunk_of(body), self._decompressor)
            _, end = mcap_kernels.count(np.frombuffer(inside, np.uint8), 0, len(inside))
            if end != len(inside):
                raise McapError("its content ends in the middle of a record")
        elif opcode == Opcode.ATTACHMENT:
            Attachment.read(_stream(body))
            (told,) = struct.unpack("<I", body[-4:])
            if told and told != zlib.crc32(body[:-4]):
                raise McapError("a checksum is wrong")
        elif opcode == Opcode.MESSAGE:
            struct.unpack_from("<HIQQ", body)
        elif opcode in _PARSED:
            _PARSED[opcode].read(_stream(body))
        elif opcode in _SIZES and len(body) != _SIZES[opcode]:
            raise McapError("its length is wrong")

    # -- where to go on --

    def _after_damage(self, at: int, why: str, end: int = 0, opcode: int = 0) -> int:
        """Note damage and return where the next whole record begins."""
        inside = end and self._trouble_is_inside(end)
        go_on = end if inside else min(self._found_again(at), self._told_by_index(at))
        what = "summary" if self._in_summary else _name(opcode) if opcode in _KNOWN else ""
        self._found.damages.append(Damage(at, go_on - at, why, what))
        return go_on

    def _trouble_is_inside(self, end: int) -> bool:
        """Whether a damaged record's length is right all the same: others follow it."""
        return end < self._found.size and self._follows(end)

    def _follows(self, at: int) -> bool:
        """Whether records begin here, as far as their heads tell."""
        for _ in range(_DEPTH):
            if at + _HEAD.size > self._found.size:
                break
            opcode, length = _HEAD.unpack_from(self._data, at)
            if opcode not in _KNOWN or length > LIMIT:
                return False
            if opcode == Opcode.FOOTER:
                return bool(length == _SIZES[Opcode.FOOTER])
            at += _HEAD.size + length
        return True

    def _told_by_index(self, at: int) -> int:
        starts = self._found.index.starts if self._found.index is not None else []
        return next((start for start in starts if start > at), self._found.size)

    def _found_again(self, at: int) -> int:
        """Where the next record begins that can be told by its marks and is whole."""
        for number, (mark, back, opcode) in enumerate(_MARKS):
            if self._next[number] <= at:
                self._next[number] = self._search(at, mark, back, opcode)
        return min(self._next.values())

    def _search(self, at: int, mark: bytes, back: int, opcode: int) -> int:
        found = at + back
        while (found := self._data.find(mark, found + 1)) >= 0:
            start = found - back
            if self._data[start] != opcode or start + _HEAD.size > self._found.size:
                continue
            _, length = _HEAD.unpack_from(self._data, start)
            if not self._trouble(opcode, start + _HEAD.size, length) and self._follows(start):
                return start
        return self._found.size

    def _index(self, size: int) -> Index | None:
        """The summary, if the file's first `size` bytes end with one that is right."""
        tail = size - _FOOTER.size - len(MAGIC)
        if tail < len(MAGIC) or self._data[size - len(MAGIC) : size] != MAGIC:
            return None
        opcode, length, start, _, checksum = _FOOTER.unpack_from(self._data, tail)
        if opcode != Opcode.FOOTER or length != _SIZES[Opcode.FOOTER] or not 0 < start <= tail:
            return None
        with memoryview(self._data) as view:
            if checksum not in (0, zlib.crc32(view[start : tail + _FOOTER.size - 4])):
                return None
        try:
            return _read_index(bytes(self._data[start:tail]))
        except _UNREADABLE:
            return None


_PARSED: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
}
_SIZES: dict[int, int] = {Opcode.FOOTER: _FOOTER.size - _HEAD.size, Opcode.DATA_END: 4}


def _read_index(section: bytes) -> Index:
    found, at = Index(), 0
    while at + _HEAD.size <= len(section):
        opcode, length = _HEAD.unpack_from(section, at)
        body = _stream(section[at + _HEAD.size : at + _HEAD.size + length])
        match opcode:
            case Opcode.SCHEMA:
                schema = Schema.read(body)
                found.schemas[schema.id] = schema
            case Opcode.CHANNEL:
                channel = Channel.read(body)
                found.channels[channel.id] = channel
            case Opcode.STATISTICS:
                found.statistics = Statistics.read(body)
            case Opcode.CHUNK_INDEX:
                found.starts.append(ChunkIndex.read(body).chunk_start_offset)
            case Opcode.ATTACHMENT_INDEX:
                found.starts.append(AttachmentIndex.read(body).offset)
            case Opcode.METADATA_INDEX:
                found.starts.append(MetadataIndex.read(body).offset)
        at += _HEAD.size + length
    found.starts.sort()
    return found


def _name(opcode: int) -> str:
    return Opcode(opcode).name.lower().replace("_", " ") if opcode in _KNOWN else "record"


def _article(name: str) -> str:
    return f"an {name}" if name[0] in "aeiou" else f"a {name}"


def _short(error: BaseException) -> str:
    return str(error).splitlines()[0][:120] if str(error) else type(error).__name__


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))
