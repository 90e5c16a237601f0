"""Rebuilding an unfinished or damaged log: every whole record into a file with an index, nothing twice.

What it leaves out: parts of a chunk. A chunk's checksum is over all of it, and the reader takes all of it or nothing;
so a rebuilt file gives the same estimates as the unfinished one did.
"""

import contextlib
import hashlib
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Header,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

import imutui
from imutui.logbook import layout, reader, schemas
from imutui.logbook.audit import HeadRun, joined_runs, run_of
from imutui.logbook.mcap_format import FOOTER, FOOTER_SIZE, HEAD, MAGIC, MESSAGE, packed
from imutui.logbook.mcap_stream import CHANNEL, INDEX_HEAD, LENGTH, OFFSET, Batch
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.scan import RECOVERED, Content, Scan
from imutui.logbook.session_info import METADATA
from imutui.logbook.walk import ChunkHead
from imutui.plain_text import in_line

_MOST_CHANNELS = 2**16 - 1  # their numbers have 16 bits
_PROFILE = "ros2"
_CHUNK = 2**20  # bytes of messages from which on a chunk is full
_UNKNOWN, _HOMELESS = 0, -1  # in place of a channel's new number


class NotAsWrittenError(OSError):
    """The rebuilt file does not read back as it was written."""


@dataclass(slots=True)
class RebuiltContent:
    """What went into the rebuilt file."""

    topics: dict[str, int] = field(default_factory=dict)  # messages of each topic
    chunks: int = 0  # of the source
    # of each topic, numbers left out before and between messages that are there; imutui leaves none out
    missing: dict[str, int] = field(default_factory=dict)
    homeless: int = 0  # messages of channels that nothing describes any more
    # metadata, attachments: names
    metadata: list[str] = field(default_factory=list)
    attachments: list[str] = field(default_factory=list)
    assumed: bool = False  # whether the channels are those that imutui writes, since the file does not say so any more
    sha256: str = ""  # of the file

    @property
    def messages(self) -> int:
        """Messages on all topics."""
        return sum(self.topics.values())


def rebuild(
    found: Scan,
    part: Path,
    lost: Callable[[RebuiltContent], list[str]],
    source_sha256: str,
    progress: Callable[[float], None],
) -> RebuiltContent:
    """Write the whole records of a file, and read them back.

    `found`: of the source, filled while it is walked.
    `part`: file to write, replaced.
    `lost`: says what is missing in the content that was kept, a sentence each.
    `source_sha256`: hash of the source.
    `progress`: called with the share done, 0 to 1.
    Raises NotAsWrittenError if the file does not read back as it was written.
    """
    with part.open("wb") as stream:
        copy: _Copy | None = None
        for item in found.items(progress):
            copy = copy or _Copy(found, stream)
            copy.take(item)
        kept = (copy or _Copy(found, stream)).finish(lost, source_sha256)
    _read_back(part, kept)
    progress(1.0)
    return kept


class _Output:
    """The rebuilt file as it grows: records, and chunks of messages whose bytes stay what they are."""

    def __init__(self, stream: IO[bytes], profile: str) -> None:
        self._stream, self._at, self._sum, self._digest = stream, 0, 0, hashlib.sha256()
        self.schemas: list[Schema] = []
        self.channels: list[Channel] = []
        self._declarations: list[bytes] = []  # of the next chunk
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._put(MAGIC + _bytes_of(Header(profile, f"imutui {imutui.__version__}")))

    def _put(self, data: bytes) -> tuple[int, int]:
        """Write bytes; return where they begin and how many they are."""
        self._stream.write(data)
        self._sum, at = zlib.crc32(data, self._sum), self._at
        self._digest.update(data)
        self._at += len(data)
        return at, len(data)

    def declare(self, record: Schema | Channel) -> None:
        """Put a declaration in front of the next message."""
        self.schemas.append(record) if isinstance(record, Schema) else self.channels.append(record)
        self._declarations.append(_bytes_of(record))

    def attach(self, record: Attachment) -> None:
        """Write an attachment."""
        place, times = self._put(_bytes_of(record)), (record.log_time, record.create_time)
        self._attachments.append(AttachmentIndex(*place, *times, len(record.data), record.name, record.media_type))

    def describe(self, record: Metadata) -> None:
        """Write metadata."""
        self._metadata.append(MetadataIndex(*self._put(_bytes_of(record)), record.name))

    def add(self, messages: bytes | bytearray, channels: np.ndarray, times: np.ndarray, lengths: np.ndarray) -> None:
        """Write message records in a row as a chunk, and the indexes of its channels.

        `channels`, `times`, `lengths`: of each record, shape (n,), n > 0; log times in UTC, ns, lengths with the heads.
        """
        declarations = b"".join(self._declarations)
        content = declarations + messages
        starts = len(declarations) + np.cumsum(lengths) - lengths
        entries = np.column_stack([times, starts.astype(np.uint64)]).astype("<u8")
        first, last = int(entries[:, 0].min()), int(entries[:, 0].max())
        chunk = packed(content, first, last)
        at, length = self._put(_bytes_of(chunk))
        places, behind = dict[int, int](), self._at
        for channel in np.flatnonzero(np.bincount(channels)).tolist():
            own = entries[channels == channel]
            head = INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, INDEX_HEAD.size - HEAD.size + own.nbytes, channel, own.nbytes)
            places[channel], _ = self._put(head + own.tobytes())
            self._counts[channel] = self._counts.get(channel, 0) + len(own)
        index = ChunkIndex(
            chunk_length=length,
            chunk_start_offset=at,
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            message_end_time=last,
            message_index_length=self._at - behind,
            message_index_offsets=places,
            message_start_time=first,
            uncompressed_size=len(content),
        )
        self._chunks.append(index)
        self._declarations = []

    def finish(self) -> str:
        """Write the summary; return the SHA-256 of the file."""
        self._put(_bytes_of(DataEnd(self._sum)))
        start, self._sum = self._at, 0
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self.channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self.schemas),
        )
        groups = (self.schemas, self.channels, [statistics], self._chunks, self._attachments, self._metadata)
        # an empty group is an error to validators
        parts = [_bytes_of(*group) for group in groups if group]
        offsets = [SummaryOffset(data[0], *self._put(data)) for data in parts]
        offsets_at, _ = self._put(_bytes_of(*offsets))
        footer = FOOTER.pack(Opcode.FOOTER, FOOTER_SIZE, start, offsets_at, 0)[:-4]
        self._put(footer + zlib.crc32(footer, self._sum).to_bytes(4, "little") + MAGIC)
        return self._digest.hexdigest()


def _bytes_of(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


class _Copy:
    """Records of a file into another one, channels by their new numbers."""

    def __init__(self, found: Scan, stream: IO[bytes]) -> None:
        self.kept = RebuiltContent()
        self._schemas: dict[int, Schema] = dict(found.index.schemas) if found.index is not None else {}
        self._channels: dict[int, Channel] = dict(found.index.channels) if found.index is not None else {}
        self._written_schemas: dict[tuple[str, str, bytes], int] = {}
        self._numbers = np.full(2**16, _UNKNOWN)
        self._declared: dict[int, Channel] = {}
        self._runs: dict[int, HeadRun] = {}  # by the new numbers
        self._own = False
        self._found = found
        self._output = _Output(stream, _PROFILE if found.profile is None else found.profile)

    def take(self, item: Content) -> None:
        """Copy an item of the source; each of its chunks becomes one or more."""
        match item:
            case ChunkHead():
                self.kept.chunks += 1
                self.kept.homeless += item.short  # nothing tells whose they are
            case Batch():
                full = np.flatnonzero(np.diff(item.table[:, OFFSET] // _CHUNK)) + 1
                for rows in np.split(item.table, full):
                    self._messages(Batch(item.content, rows))
            case Schema():
                self._schemas[item.id] = item
            case Channel():
                self._channels[item.id] = item
                self._register(item)
            case Metadata():
                self._own = self._own or item.name == METADATA
                self._output.describe(item)
                self.kept.metadata.append(item.name)
            case Attachment():
                self._output.attach(item)
                self.kept.attachments.append(item.name)

    def _messages(self, batch: Batch) -> None:
        channels = batch.table[:, CHANNEL]
        while (unknown := np.flatnonzero(self._numbers[channels] == _UNKNOWN)).size:
            self._adopt(batch.message(int(unknown[0])))
        numbers = self._numbers[channels]
        if (homeless := numbers == _HOMELESS).any():
            self.kept.homeless += int(np.count_nonzero(homeless))
            batch, numbers = Batch(batch.content, batch.table[~homeless]), numbers[~homeless]
            if not numbers.size:
                return
        heads = batch.heads
        for number in np.flatnonzero(np.bincount(numbers)).tolist():
            self._runs[number] = joined_runs(self._runs.get(number), run_of(heads[numbers == number]))
        ends = batch.table[:, OFFSET] + batch.table[:, LENGTH]
        starts = batch.table[:, OFFSET] - MESSAGE.size - HEAD.size
        if (starts[1:] == ends[:-1]).all():
            messages = bytearray(batch.content[starts[0] : ends[-1]])
        else:
            messages = bytearray().join(batch.content[a:b] for a, b in zip(starts.tolist(), ends.tolist(), strict=True))
        lengths = ends - starts
        at, data = np.cumsum(lengths) - lengths + HEAD.size, np.frombuffer(messages, np.uint8)
        data[at], data[at + 1] = numbers & 0xFF, numbers >> 8
        self._output.add(messages, numbers, heads["log_ns"].astype(np.uint64), lengths)

    def _register(self, channel: Channel) -> None:
        """Give a channel that the file declares its number in the new one."""
        before = self._declared.get(channel.id)
        if before == channel:
            return
        self._declared[channel.id] = channel
        number = len(self._output.channels) + 1
        if number > _MOST_CHANNELS:
            raise UnreadableLogError(
                f"{self._found.path} declares more than {_MOST_CHANNELS:,} channels, the most that a file can have:"
                " imutui did not write it. `imutui export` makes a table of its samples."
            )
        schema = self._schemas.get(channel.schema_id)
        schema_id = 0 if schema is None else self._schema(schema)
        self._output.declare(replace(channel, id=number, schema_id=schema_id))
        self._numbers[channel.id] = number

    def _schema(self, schema: Schema) -> int:
        key = (schema.name, schema.encoding, schema.data)
        if key not in self._written_schemas:
            self._written_schemas[key] = len(self._written_schemas) + 1
            self._output.declare(replace(schema, id=self._written_schemas[key]))
        return self._written_schemas[key]

    def _adopt(self, message: Message) -> None:
        """Find out about a channel whose declaration is lost: from the summary, or from what imutui writes."""
        number = message.channel_id
        if number not in self._channels and self._own:
            self._assume(number, message.data)
        if number in self._channels:
            self._register(self._channels[number])
        else:
            self._numbers[number] = _HOMELESS

    def _assume(self, number: int, data: bytes) -> None:
        """Take a channel for the one that our recorder gives this number, if its first message reads as such."""
        if not 1 <= number <= len(schemas.TYPES):
            return
        topic, typename = list(schemas.TYPES.items())[number - 1]
        if topic == schemas.RAW:
            typename = schemas.raw_type(details=len(data) == schemas.RAW_DTYPE.itemsize)
        with contextlib.suppress(layout.UndecodableError):
            layout.layout_in(typename, data)
            definition = schemas.definition(typename).encode()
            self._schemas[-number] = Schema(id=-number, name=typename, encoding="ros2msg", data=definition)
            self._channels[number] = Channel(
                id=number,
                topic=topic,
                message_encoding="cdr",
                metadata=schemas.CHANNEL_METADATA.get(topic, {}),
                schema_id=-number,
            )
            self.kept.assumed = True

    def finish(self, lost: Callable[[RebuiltContent], list[str]], source_sha256: str) -> RebuiltContent:
        """Close the file with a note of its source in it."""
        # channels that nobody wrote to are part of the file too
        for channel in self._channels.values():
            if self._numbers[channel.id] == _UNKNOWN:
                self._register(channel)
        for number, run in self._runs.items():
            topic = self._output.channels[number - 1].topic
            self.kept.topics[topic] = self.kept.topics.get(topic, 0) + run.count
            if self._own and (missing := run.since_zero.missing):
                self.kept.missing[topic] = self.kept.missing.get(topic, 0) + missing
        note = {
            "source": in_line(self._found.path.name),
            "source_bytes": str(self._found.size),
            "source_sha256": source_sha256,
            "recovered": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "software": f"imutui {imutui.__version__}",
            "messages": str(self.kept.messages),
            "lost": " ".join(lost(self.kept)) or "nothing",
        }
        self._output.describe(Metadata(RECOVERED, note))
        self.kept.sha256 = self._output.finish()
        return self.kept


def _read_back(path: Path, kept: RebuiltContent) -> None:
    """Raise if a file does not hold the bytes that were written."""
    if reader.sha256(path) != kept.sha256:
        raise NotAsWrittenError(
            5, "the rebuilt file did not read back as it was written, so it was not kept; the disk may be failing",
            str(path),
        )  # fmt: skip
