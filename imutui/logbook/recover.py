"""Rebuilding an unfinished or damaged log: every whole record into a file with an index, nothing twice.

What it leaves out: parts of a chunk. A chunk's checksum is over all of it, and the reader takes all of it or nothing;
so a rebuilt file gives the same estimates as the unfinished one did.
"""

import contextlib
import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import IndexType, Writer

import imutui
from imutui.logbook import layout, schemas
from imutui.logbook.mcap_format import HEAD, MAGIC, MESSAGE, OPCODES
from imutui.logbook.mcap_stream import Batch
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.scan import RECOVERED, Content, Scan
from imutui.logbook.session_info import METADATA
from imutui.logbook.walk import ChunkHead, End, walk
from imutui.plain_text import in_line

_MOST_CHANNELS = 2**16 - 1  # their numbers have 16 bits
_PROFILE = "ros2"


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
    digest: str = ""  # of all messages in order, with their channels, numbers and times

    @property
    def messages(self) -> int:
        """Messages on all topics."""
        return sum(self.topics.values())


def rebuild(
    found: Scan,
    part: Path,
    note: Callable[[RebuiltContent], dict[str, str]],
    progress: Callable[[float], None],
) -> RebuiltContent:
    """Write the whole records of a file, and read them back.

    `found`: of the source, filled while it is walked.
    `part`: file to write, replaced.
    `note`: makes the metadata `imutui.recovered` of the content that was kept.
    `progress`: called with the share done, 0 to 1.
    Raises NotAsWrittenError if the file does not read back as it was written.
    """
    with part.open("wb") as stream:
        copy: _Copy | None = None
        for item in found.items(progress):
            copy = copy or _Copy(found, stream)
            copy.take(item)
        kept = (copy or _Copy(found, stream)).finish(note)
    _read_back(part, kept)
    progress(1.0)
    return kept


class _Copy:
    """Records of a file into a writer, channels by their new numbers."""

    def __init__(self, found: Scan, stream: IO[bytes]) -> None:
        self.kept = RebuiltContent()
        self._schemas: dict[int, Schema] = dict(found.index.schemas) if found.index is not None else {}
        self._channels: dict[int, Channel] = dict(found.index.channels) if found.index is not None else {}
        self._written_schemas: dict[tuple[str, str, bytes], int] = {}
        self._numbers: dict[int, int | None] = {}
        self._declared: dict[int, Channel] = {}
        self._sequences: dict[int, int] = {}
        self._own = False
        self._path, self._registered = found.path, 0
        self._digest = hashlib.blake2b()
        profile = _PROFILE if found.profile is None else found.profile
        # an index of no attachments is an error to validators
        index = (
            IndexType.ALL if _has_attachments(found.path) else IndexType.CHUNK | IndexType.MESSAGE | IndexType.METADATA
        )
        self._writer = Writer(stream, enable_data_crcs=True, index_types=index)
        self._writer.start(profile, f"imutui {imutui.__version__}")

    def take(self, item: Content) -> None:
        """Copy an item of the source; each of its chunks becomes one or more."""
        match item:
            case ChunkHead():
                self._writer.flush()  # type: ignore[no-untyped-call]
                self.kept.chunks += 1
                self.kept.homeless += item.short  # nothing tells whose they are
            case Batch():
                for _, channel, at, length in item.table.tolist():
                    self._message(item.content, channel, at, length)
            case Schema():
                self._schemas[item.id] = item
            case Channel():
                self._channels[item.id] = item
                self._register(item)
            case Metadata():
                self._own = self._own or item.name == METADATA
                self._writer.flush()  # type: ignore[no-untyped-call]
                self._writer.add_metadata(item.name, item.metadata)
                self.kept.metadata.append(item.name)
            case Attachment():
                self._writer.flush()  # type: ignore[no-untyped-call]
                self._writer.add_attachment(item.create_time, item.log_time, item.name, item.media_type, item.data)
                self.kept.attachments.append(item.name)

    def _message(self, content: bytes, channel: int, at: int, length: int) -> None:
        _, sequence, log_time, publish_time = MESSAGE.unpack_from(content, at - MESSAGE.size)
        data = content[at : at + length]
        if channel not in self._numbers:
            self._adopt(channel, data)
        number = self._numbers[channel]
        if number is None:
            self.kept.homeless += 1
            return
        topic = self._channels[channel].topic
        before = self._sequences.get(number, -1)
        if self._own and sequence > before + 1:
            self.kept.missing[topic] = self.kept.missing.get(topic, 0) + sequence - before - 1
        self._sequences[number] = sequence
        self.kept.topics[topic] = self.kept.topics.get(topic, 0) + 1
        self._digest.update(MESSAGE.pack(number, sequence, log_time, publish_time))
        self._digest.update(data)
        self._writer.add_message(number, log_time, data, publish_time, sequence)

    def _register(self, channel: Channel) -> None:
        """Give a channel that the file declares its number in the new one."""
        before = self._declared.get(channel.id)
        if before == channel:
            return
        self._declared[channel.id] = channel
        self._registered += 1
        if self._registered > _MOST_CHANNELS:
            raise UnreadableLogError(
                f"{self._path} declares more than {_MOST_CHANNELS:,} channels, the most that a file can have: imutui"
                " did not write it. `imutui export` makes a table of its samples."
            )
        schema = self._schemas.get(channel.schema_id)
        self._numbers[channel.id] = self._writer.register_channel(
            channel.topic, channel.message_encoding, 0 if schema is None else self._schema(schema), channel.metadata
        )

    def _schema(self, schema: Schema) -> int:
        key = (schema.name, schema.encoding, schema.data)
        if key not in self._written_schemas:
            self._written_schemas[key] = self._writer.register_schema(*key)
        return self._written_schemas[key]

    def _adopt(self, number: int, data: bytes) -> None:
        """Find out about a channel whose declaration is lost: from the summary, or from what imutui writes."""
        if number not in self._channels and self._own:
            self._assume(number, data)
        if number in self._channels:
            self._register(self._channels[number])
        else:
            self._numbers[number] = None

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

    def finish(self, note: Callable[[RebuiltContent], dict[str, str]]) -> RebuiltContent:
        """Close the file with the note in it."""
        self.kept.digest = self._digest.hexdigest()
        # channels that nobody wrote to are part of the file too
        for channel in self._channels.values():
            if channel.id not in self._numbers:
                self._register(channel)
        self._writer.add_metadata(RECOVERED, note(self.kept))
        self._writer.finish()  # type: ignore[no-untyped-call]
        return self.kept


def _has_attachments(path: Path) -> bool:
    """Return whether an attachment stands in a file, as far as the heads of its records lead."""
    with path.open("rb") as stream:
        at = len(MAGIC)
        while len(head := stream.read(HEAD.size) if stream.seek(at) >= 0 else b"") == HEAD.size:
            opcode, length = HEAD.unpack(head)
            if opcode == Opcode.ATTACHMENT:
                return True
            if opcode not in OPCODES:
                return False
            at += HEAD.size + length
    return False


def note(found: Scan, kept: RebuiltContent, lost: list[str], source_sha256: str) -> dict[str, str]:
    """Metadata record of a rebuilt file."""
    return {
        "source": in_line(found.path.name),
        "source_bytes": str(found.size),
        "source_sha256": source_sha256,
        "recovered": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "software": f"imutui {imutui.__version__}",
        "messages": str(kept.messages),
        "lost": " ".join(lost) or "nothing",
    }


def _read_back(path: Path, kept: RebuiltContent) -> None:
    """Raise if a file does not hold, record by record, what was kept."""
    digest, messages, finished = hashlib.blake2b(), 0, False
    with path.open("rb") as stream:
        for item in walk(stream):
            if isinstance(item, Batch):
                for _, _, at, length in item.table.tolist():
                    digest.update(item.content[at - MESSAGE.size : at + length])
                messages += len(item.table)
            finished = finished or (isinstance(item, End) and item.finished and not item.checksum_wrong)
    if not finished or messages != kept.messages or digest.hexdigest() != kept.digest:
        raise NotAsWrittenError(
            5,
            f"the rebuilt file did not read back as it was written ({messages} of {kept.messages} messages), so it was"
            " not kept; the disk may be failing",
            str(path),
        )
