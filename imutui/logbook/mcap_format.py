"""Records of an MCAP file in file order, messages in batches; a file without footer needs no other path.

The format's rules are those of mcap.stream_reader, which reads a record at a time; here only rare records become
objects, and a chunk's messages stay bytes beside a table of where each begins.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import IO, Any

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, InvalidMagic, McapError, RecordLengthLimitExceeded
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream

from imutui.logbook import mcap_kernels

MAGIC = b"\x89MCAP0\r\n"
LIMIT = 256 * 2**20
"""Longest record that is read, bytes: a damaged length must not ask for the machine's whole memory."""
_BLOCK = 2**20
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQII")
_SIZE = struct.Struct("<Q")
_OBJECTS: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
    Opcode.DATA_END: DataEnd,
    Opcode.FOOTER: Footer,
}
# What is left aside at each level; the rest of the file's index says nothing that the records themselves don't.
_IN_FILE = np.isin(np.arange(256), [*_OBJECTS, Opcode.CHUNK, Opcode.MESSAGE])
_IN_CHUNK = np.isin(np.arange(256), [Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE])


@dataclass(frozen=True, slots=True)
class Batch:
    """Messages in a row.

    Attributes
    ----------
    content : bytes
        Bytes that hold them.
    data : np.ndarray
        The same as uint8.
    table : np.ndarray
        int64, shape (n, 4): opcode, channel id, offset and length of each message's data.
    """

    content: bytes
    data: np.ndarray
    table: np.ndarray

    def message(self, row: int) -> Message:
        """One of them as mcap's object."""
        _, _, at, length = self.table[row].tolist()
        channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(self.content, at - _MESSAGE.size)
        return Message(channel, log_time, self.content[at : at + length], publish_time, sequence)


def walk(stream: IO[bytes]) -> Iterator[McapRecord | Batch]:
    """Schemas, channels, metadata, attachments, batches of messages, and the footer, as they come.

    Parameters
    ----------
    stream : IO
        The file, at its beginning.

    Raises
    ------
    EndOfFile, struct.error
        If the file ends before its footer.
    CRCValidationError
        If a chunk's or the data section's checksum is wrong.
    McapError, ValueError
        If a record is not what it must be.
    """
    head = stream.read(len(MAGIC))
    if len(head) < len(MAGIC):
        raise EndOfFile
    if head != MAGIC:
        raise InvalidMagic(head)
    checksum = zlib.crc32(head)
    decompressor = zstandard.ZstdDecompressor()
    held, wanted = b"", _BLOCK
    while True:
        block = stream.read(wanted)
        held += block
        data = np.frombuffer(held, np.uint8)
        n, end = mcap_kernels.count(data, 0, LIMIT)
        checked = 0
        for item in _split(held, data, n, _IN_FILE):
            if isinstance(item, Batch):
                yield item
                continue
            opcode, at, length = item
            if opcode == Opcode.CHUNK:
                yield from _chunk(chunk_of(held[at : at + length]), decompressor)
                continue
            record = _record(held, opcode, at, length)
            if isinstance(record, DataEnd):
                checksum = zlib.crc32(memoryview(held)[checked : at - mcap_kernels.HEADER_SIZE], checksum)
                checked = at - mcap_kernels.HEADER_SIZE
                if record.data_section_crc not in (0, checksum):
                    raise CRCValidationError(record.data_section_crc, checksum, record)
                continue
            yield record
            if isinstance(record, Footer):
                _expect_magic((held[at + length : at + length + len(MAGIC)] + stream.read(len(MAGIC)))[: len(MAGIC)])
                return
        checksum = zlib.crc32(memoryview(held)[checked:end], checksum)
        wanted = _missing(held, end, block)
        held = held[end:]


def _missing(held: bytes, end: int, block: bytes) -> int:
    """How many bytes to read next, for the record that begins at `end` and is not whole."""
    wanted = _BLOCK
    if len(held) - end >= mcap_kernels.HEADER_SIZE:
        opcode, length = struct.unpack_from("<BQ", held, end)
        if length > LIMIT:
            raise RecordLengthLimitExceeded(opcode, length, LIMIT)
        wanted = max(wanted, mcap_kernels.HEADER_SIZE + length - (len(held) - end))
    if not block:
        raise EndOfFile
    return wanted


def _expect_magic(tail: bytes) -> None:
    if len(tail) < len(MAGIC):
        raise EndOfFile
    if tail != MAGIC:
        raise InvalidMagic(tail)


def _split(content: bytes, data: np.ndarray, n: int, wanted: np.ndarray) -> Iterator[Batch | tuple[int, int, int]]:
    """Batches of messages, and between them opcode, offset and length of the other records that are wanted."""
    table = np.empty((n, 4), np.int64)
    rows, others, short = mcap_kernels.tabulate(data, 0, wanted, table)
    if short:
        raise McapError("a message is shorter than its header")
    table = table[:rows]
    first = 0
    if others:
        for row in map(int, np.flatnonzero(table[:, mcap_kernels.OPCODE] != mcap_kernels.MESSAGE)):
            if row > first:
                yield Batch(content, data, table[first:row])
            opcode, _, at, length = table[row].tolist()
            yield opcode, at, length
            first = row + 1
    if first < rows:
        yield Batch(content, data, table[first:])


def chunk_of(content: bytes) -> Chunk:
    """As mcap.records.Chunk.read, from bytes."""
    try:
        start, end, size, checksum, name = _CHUNK.unpack_from(content)
        at = _CHUNK.size + name
        (length,) = _SIZE.unpack_from(content, at)
    except struct.error as error:
        raise McapError("a chunk record ends before its content") from error
    data = content[at + _SIZE.size : at + _SIZE.size + length]
    if len(data) < length:
        raise McapError("a chunk record ends before its content")
    return Chunk(content[_CHUNK.size : at].decode(), data, end, start, checksum, size)


def _record(data: bytes, opcode: int, at: int, length: int) -> McapRecord:
    content = BytesIO(data[at : at + length])
    try:
        record: McapRecord = _OBJECTS[opcode].read(ReadDataStream(content))
    except (EndOfFile, struct.error) as error:
        raise McapError(f"a {Opcode(opcode).name.lower()} record ends before its content") from error
    return record


def _chunk(chunk: Chunk, decompressor: zstandard.ZstdDecompressor) -> Iterator[McapRecord | Batch]:
    """A chunk's records: all of them are there, or none is given."""
    content = inflated(chunk, decompressor)
    data = np.frombuffer(content, np.uint8)
    n, end = mcap_kernels.count(data, 0, len(content))
    if end != len(content):
        raise McapError("a chunk's content ends in the middle of a record")
    for item in _split(content, data, n, _IN_CHUNK):
        yield item if isinstance(item, Batch) else _record(content, *item)


def inflated(chunk: Chunk, decompressor: zstandard.ZstdDecompressor) -> bytes:
    """A chunk's content, checked against its checksum.

    Raises
    ------
    CRCValidationError
        If the checksum is wrong.
    McapError, zstandard.ZstdError
        If it is not what it must be.
    """
    if chunk.compression == "zstd":
        # the library takes as much memory as the data ask for
        told = zstandard.frame_content_size(chunk.data)
        if max(told, chunk.uncompressed_size) > LIMIT:
            raise McapError("a chunk's size is out of range")
        content = decompressor.decompress(chunk.data, chunk.uncompressed_size)
        if chunk.uncompressed_crc not in (0, checksum := zlib.crc32(content)):
            raise CRCValidationError(chunk.uncompressed_crc, checksum, chunk)
        return content
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    return bytes(stream.read(size))
