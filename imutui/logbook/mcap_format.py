"""The MCAP format, once: magic, opcodes, layout of records, and the decompression of chunks within bounds.

Knows bytes, no files: `walk` reads a file in order, `summary` looks at its ends.
"""

import mmap
import struct
import zlib
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import IO, TypeVar, cast

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

Record = TypeVar("Record", bound=McapRecord)
MAGIC = b"\x89MCAP0\r\n"
LIMIT = 2**30  # longest record that is read, bytes: a damaged length must not ask for the machine's whole memory
CHUNK_LIMIT = 2**30  # longest content of a chunk, bytes
BASE_LIMIT, EXPANSION = 16 * 2**20, 250
"""Content of all chunks of a file: so many bytes, and so many times the file's size."""
HEAD = struct.Struct("<BQ")  # before each record's content: opcode, length
MESSAGE = struct.Struct("<HIQQ")  # before each message's data: channel id, sequence, log time, publish time
FOOTER = struct.Struct("<BQQQI")
"""A whole footer record: opcode, length, where the summary begins, where its offsets begin, checksum."""
FOOTER_SIZE = FOOTER.size - HEAD.size  # length of a footer's content, bytes
OPCODES = frozenset(range(1, 0x10))  # kinds of records that the format defines
PRIVATE = 0x80  # kinds of records from here on are left to others
COMPRESSIONS = ("zstd", "lz4")
COMPRESSION_OFFSET = HEAD.size + 28
"""Bytes from the beginning of a chunk record to the name of its compression with its length."""
ATTACHMENT_NAME_OFFSET = HEAD.size + 16  # bytes from the beginning of an attachment record to its name with its length
PARSED: dict[int, type[McapRecord]] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
    Opcode.DATA_END: DataEnd,
    Opcode.FOOTER: Footer,
}
"""Kinds of records that become objects; messages and chunks stay bytes."""
_UINT32 = struct.Struct("<I")


class ChecksumError(McapError):
    """Bytes are not those that were written."""


MALFORMED = (McapError, struct.error)  # what the reading of damaged bytes raises


def parse(kind: type[Record], content: bytes) -> Record:
    """Record of a kind from its content.

    Raises McapError if the content ends too early, a text is none, or a number is one that cannot be.
    """
    try:
        return cast("Record", kind.read(ReadDataStream(BytesIO(content))))  # type: ignore[attr-defined]
    except (EndOfFile, struct.error) as error:
        raise McapError(f"a {kind.__name__.lower()} record ends before its content") from error
    except (ValueError, IndexError, OverflowError) as error:
        raise McapError(str(error)) from error


def prefixed(text: str) -> bytes:
    """A text as it stands in a record: its length before it."""
    return _UINT32.pack(len(text)) + text.encode()


def records(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, offset and length of the records in bytes that hold whole ones; offset and length are the content's.

    Raises McapError if the last one is not whole.
    """
    at = 0
    while at + HEAD.size <= len(content):
        opcode, length = HEAD.unpack_from(content, at)
        at += HEAD.size
        if at + length > len(content):
            raise McapError("a record ends before its content")
        yield opcode, at, length
        at += length


def packed(content: bytes, first_ns: int, last_ns: int) -> Chunk:
    """Chunk of a content whose messages have log times between two, UTC, ns."""
    return Chunk("zstd", zstandard.compress(content), last_ns, first_ns, zlib.crc32(content), len(content))


class Inflater:
    """Contents of chunks, checked and within bounds: the one decompressor of all that read a log.

    A chunk says itself how long it becomes, and a few bytes can say much. One chunk gives `CHUNK_LIMIT` at most, and
    all chunks that one of these unpacks give no more than the file's size lets expect; samples that never change, the
    best case of all, become a twenty-seventh.

    `size`: of the file, bytes.
    `most`: most that all chunks give, bytes, for whoever wants a few of them only.
    """

    def __init__(self, size: int, most: int | None = None) -> None:
        self._left = BASE_LIMIT + EXPANSION * size
        self._left = self._left if most is None else min(self._left, most)
        self._zstd = zstandard.ZstdDecompressor()

    def content(self, chunk: Chunk) -> bytes:
        """A chunk's content, checked against its checksum.

        Raises ChecksumError if the checksum is wrong.
        Raises McapError if it is not what it must be, or is too long.
        """
        size = len(chunk.data) if chunk.compression == "" else chunk.uncompressed_size
        if size > CHUNK_LIMIT:
            raise McapError("a chunk's size is out of range")
        if size > self._left:
            raise McapError("the chunks unpack to far more than a file of this size holds")
        self._left -= size
        content = self._unpacked(chunk)
        if len(content) != chunk.uncompressed_size:
            raise McapError("a chunk's content is not as long as it says")
        if chunk.uncompressed_crc not in (0, zlib.crc32(content)):
            raise ChecksumError("a chunk's checksum is wrong")
        return content

    def _unpacked(self, chunk: Chunk) -> bytes:
        if chunk.compression == "zstd":
            return self._from_zstd(chunk)
        if chunk.compression == "lz4":
            return from_lz4(chunk.data, chunk.uncompressed_size + 1)
        if chunk.compression == "":
            return chunk.data
        raise McapError(f'a chunk\'s compression is "{chunk.compression[:20]}", which is not known')

    def _from_zstd(self, chunk: Chunk) -> bytes:
        try:
            # the library takes as much memory as the data ask for
            told = zstandard.frame_content_size(chunk.data)
            if told not in (-1, chunk.uncompressed_size):
                raise McapError("a chunk's content is not as long as it says")
            return self._zstd.decompress(chunk.data, chunk.uncompressed_size)
        except (zstandard.ZstdError, MemoryError) as error:
            raise McapError("a chunk cannot be decompressed") from error


def from_lz4(data: bytes, most: int) -> bytes:
    """Return at most so many bytes of a frame; raises McapError if it is none."""
    # imutui writes zstd; others' files may have it
    import lz4.frame

    inflater = lz4.frame.LZ4FrameDecompressor()
    try:
        return bytes(inflater.decompress(data, max_length=most))
    # the library's own raises these for bytes that are no frame, or one that is cut or asks for what it must not
    except (RuntimeError, EOFError, ValueError, MemoryError, OverflowError) as error:
        raise McapError("a chunk cannot be decompressed") from error


# --------------------------------------------------------------------------------------------------------- file index
# The index at a finished file's end: what its summary section says of schemas, channels, counts, and places.

TAIL = FOOTER.size + len(MAGIC)  # bytes from the footer to the end of a finished file


@dataclass(slots=True)
class Index:
    """What a finished file's summary says."""

    # schemas, channels: by their numbers
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    # where chunks begin in the file, in the section's order: of a week there are half a million
    chunk_starts: "array[int]" = field(default_factory=lambda: array("Q"))
    # attachments, metadata: index records, in the section's order
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    statistics: Statistics | None = None  # counts of everything

    @property
    def starts(self) -> list[int]:
        """Where chunks, attachments and metadata begin in the file, in order."""
        attachments, metadata = ([record.offset for record in found] for found in (self.attachments, self.metadata))
        return sorted([*self.chunk_starts, *attachments, *metadata])

    @property
    def types(self) -> dict[str, str]:
        """Type of each topic."""
        names = {schema.id: schema.name for schema in self.schemas.values()}
        return {channel.topic: names.get(channel.schema_id, "") for channel in self.channels.values()}


def read_index(data: IO[bytes] | mmap.mmap, size: int, *, chunks: bool = True) -> Index | None:
    """Index of a file that ends as it must.

    `size`: of the file, bytes.
    `chunks`: whether to read where chunks are; of a week there are half a million.
    Returns none if the file does not end with the magic, or has no summary.
    Raises McapError if there is no footer before the magic, the checksum is wrong, or a record cannot be read.
    """
    if size < len(MAGIC) + TAIL:
        return None
    data.seek(size - TAIL)
    end = data.read(TAIL)
    if not end.endswith(MAGIC):
        return None
    opcode, length, start, _, checksum = FOOTER.unpack_from(end)
    if opcode != Opcode.FOOTER or length != FOOTER_SIZE:
        raise McapError("no footer")
    if start == 0:
        return None
    if start > size - TAIL:
        raise McapError("the summary lies outside of the file")
    data.seek(start)
    content = data.read(size - TAIL - start)
    # the checksum is over the section and the footer up to itself
    if checksum not in (0, zlib.crc32(end[: FOOTER.size - 4], zlib.crc32(content))):
        raise McapError("summary checksum")
    return _parsed_index(content, chunks=chunks)


def _parsed_index(section: bytes, *, chunks: bool) -> Index:
    found = Index()
    for opcode, at, length in records(section):
        content = section[at : at + length]
        match opcode:
            case Opcode.SCHEMA:
                schema = parse(Schema, content)
                found.schemas[schema.id] = schema
            case Opcode.CHANNEL:
                channel = parse(Channel, content)
                found.channels[channel.id] = channel
            case Opcode.STATISTICS:
                found.statistics = parse(Statistics, content)
            case Opcode.CHUNK_INDEX if chunks:
                found.chunk_starts.append(parse(ChunkIndex, content).chunk_start_offset)
            case Opcode.ATTACHMENT_INDEX:
                found.attachments.append(parse(AttachmentIndex, content))
            case Opcode.METADATA_INDEX:
                found.metadata.append(parse(MetadataIndex, content))
    return found
