"""Records of an MCAP file in file order, messages in batches; a file without footer needs no other path.

The format's rules are those of mcap.stream_reader, which reads a record at a time; here only rare records become
objects, and a chunk's messages stay bytes beside a table of where each begins.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO

import numpy as np
from mcap.exceptions import EndOfFile, InvalidMagic, McapError, RecordLengthLimitExceeded
from mcap.opcode import Opcode
from mcap.records import Chunk, DataEnd, Footer, McapRecord, Message

from imutui.logbook import mcap_format, message_layout
from imutui.logbook.mcap_format import HEAD, LIMIT, MAGIC, MESSAGE, ChecksumError
from imutui.logbook.message_layout import RecordTable
from imutui.logbook.record_walk import Walk

_BLOCK = 2**20
# What is left aside at each level; the rest of the file's index says nothing that the records themselves don't.
_IN_FILE = np.isin(np.arange(256), [*(mcap_format.PARSED.keys() - {Opcode.HEADER}), Opcode.CHUNK, Opcode.MESSAGE])
_IN_CHUNK = np.isin(np.arange(256), [Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE])


@dataclass(frozen=True, slots=True)
class Batch:
    """Messages in a row."""

    content: bytes  # bytes that hold them
    data: np.ndarray  # the same as uint8
    table: np.ndarray  # int64, shape (n, 4): opcode, channel id, offset and length of each message's data

    def message(self, row: int) -> Message:
        """One of them as mcap's object."""
        _, _, at, length = self.table[row].tolist()
        channel, sequence, log_time, publish_time = MESSAGE.unpack_from(self.content, at - MESSAGE.size)
        return Message(channel, log_time, self.content[at : at + length], publish_time, sequence)


def records(stream: IO[bytes], walk: Walk) -> Iterator[McapRecord | Batch]:
    """Schemas, channels, metadata, attachments, batches of messages, and the footer, as they come.

    `stream`: the file, at its beginning.
    `walk`: how records are found in bytes.
    Raises EndOfFile, struct.error if the file ends before its footer.
    Raises ChecksumError if a chunk's or the data section's checksum is wrong.
    Raises McapError if a record is not what it must be.
    """
    head = stream.read(len(MAGIC))
    if len(head) < len(MAGIC):
        raise EndOfFile
    if head != MAGIC:
        raise InvalidMagic(head)
    checksum = zlib.crc32(head)
    inflater = mcap_format.Inflater(os.fstat(stream.fileno()).st_size)
    held, wanted, ended = b"", _BLOCK, False
    while True:
        block = stream.read(wanted)
        held += block
        data = np.frombuffer(held, np.uint8)
        table = walk.tabulate(data, LIMIT, _IN_FILE)
        end, checked = table.end, 0
        for item in _split(held, data, table):
            if ended and (isinstance(item, Batch) or item[0] == Opcode.CHUNK):
                raise McapError("messages stand behind the end of the data")
            if isinstance(item, Batch):
                yield item
                continue
            opcode, at, length = item
            if opcode == Opcode.CHUNK:
                yield from _chunk(mcap_format.chunk_of(held[at : at + length]), inflater, walk)
                continue
            record = _record(held, opcode, at, length)
            if isinstance(record, DataEnd):
                checksum = zlib.crc32(memoryview(held)[checked : at - HEAD.size], checksum)
                checked, ended = at - HEAD.size, True
                if record.data_section_crc not in (0, checksum):
                    raise ChecksumError("the data section's checksum is wrong")
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
    if len(held) - end >= HEAD.size:
        opcode, length = HEAD.unpack_from(held, end)
        if length > LIMIT:
            raise RecordLengthLimitExceeded(opcode, length, LIMIT)
        wanted = max(wanted, HEAD.size + length - (len(held) - end))
    if not block:
        raise EndOfFile
    return wanted


def _expect_magic(tail: bytes) -> None:
    if len(tail) < len(MAGIC):
        raise EndOfFile
    if tail != MAGIC:
        raise InvalidMagic(tail)


def _split(content: bytes, data: np.ndarray, found: RecordTable) -> Iterator[Batch | tuple[int, int, int]]:
    """Batches of messages, and between them opcode, offset and length of the other records."""
    if found.short:
        raise McapError("a message is shorter than its header")
    table = found.rows
    first = 0
    if found.others:
        for row in map(int, np.flatnonzero(table[:, message_layout.OPCODE] != message_layout.MESSAGE_OPCODE)):
            if row > first:
                yield Batch(content, data, table[first:row])
            opcode, _, at, length = table[row].tolist()
            yield opcode, at, length
            first = row + 1
    if first < len(table):
        yield Batch(content, data, table[first:])


def _record(data: bytes, opcode: int, at: int, length: int) -> McapRecord:
    try:
        return mcap_format.parse(mcap_format.PARSED[opcode], data[at : at + length])
    except (EndOfFile, struct.error) as error:
        raise McapError(f"a {Opcode(opcode).name.lower()} record ends before its content") from error


def _chunk(chunk: Chunk, inflater: mcap_format.Inflater, walk: Walk) -> Iterator[McapRecord | Batch]:
    """A chunk's records: all of them are there, or none is given."""
    content = inflater.content(chunk)
    data = np.frombuffer(content, np.uint8)
    table = walk.tabulate(data, len(content), _IN_CHUNK)
    if table.end != len(content):
        raise McapError("a chunk's content ends in the middle of a record")
    yield from [item if isinstance(item, Batch) else _record(content, *item) for item in _split(content, data, table)]
