"""The index at a finished file's end: what its summary section says of schemas, channels, counts, and places."""

import zlib
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, ChunkIndex, MetadataIndex, Schema, Statistics

from imutui.logbook.mcap_format import FOOTER, FOOTER_SIZE, MAGIC, parse, records

TAIL = FOOTER.size + len(MAGIC)
"""Bytes from the footer to the end of a finished file."""


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


def read(end: bytes, size: int, section: Callable[[int, int], bytes], *, chunks: bool = True) -> Index | None:
    """Index of a file that ends as it must.

    `end`: the file's last `TAIL` bytes.
    `size`: of the file, bytes.
    `section`: gives the file's bytes from one offset up to another.
    `chunks`: whether to read where chunks are; of a week there are half a million.
    Returns none if the file does not end with the magic, or has no summary.
    Raises McapError if there is no footer before the magic, or the checksum is wrong.
    Raises one of mcap_format.MALFORMED if the section does not read as records.
    """
    if len(end) < TAIL or not end.endswith(MAGIC):
        return None
    opcode, length, start, _, checksum = FOOTER.unpack_from(end)
    if opcode != Opcode.FOOTER or length != FOOTER_SIZE:
        raise McapError("no footer")
    if start == 0:
        return None
    if start > size - TAIL:
        raise McapError("the summary lies outside of the file")
    content = section(start, size - TAIL)
    # the checksum is over the section and the footer up to itself
    if checksum not in (0, zlib.crc32(end[: FOOTER.size - 4], zlib.crc32(content))):
        raise McapError("summary checksum")
    return _parsed(content, chunks=chunks)


def _parsed(section: bytes, *, chunks: bool) -> Index:
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
