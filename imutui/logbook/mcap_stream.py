"""Messages in batches: they stay bytes beside a table of where each begins; only rare records become objects."""

import mmap
import struct
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, McapRecord, Message, Schema

from imutui.logbook.layout import windows
from imutui.logbook.mcap_format import HEAD, MESSAGE, PARSED, parse

OPCODE, CHANNEL, OFFSET, LENGTH = range(4)
"""Columns of a table of records: of a message, offset and length are those of its data."""
MESSAGE_HEAD = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log_ns", "<i8"), ("publish_ns", "<i8")])
"""What the format has of each message before its data."""
JOINED = 2**13  # messages that are taken at once: what a batch costs beside its messages is nothing then
_MESSAGE = int(Opcode.MESSAGE)  # compared with an array, numpy takes an enum's member for an object
_LENGTH_OF_RECORD = struct.Struct("<xQ")
INDEX_HEAD = struct.Struct("<BQHI")  # of a message index, with its record's head: channel id, bytes of its entries
_ENTRY = 16  # a time and a place
_IN_CHUNK = np.isin(np.arange(256), [Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE])
_NO_ROWS = np.empty((0, 4), np.int64)


class RecordTable(NamedTuple):
    """Records found in bytes."""

    # opcode, channel, offset and length of those wanted, int64, shape (n, 4); channel is -1 for what is no message, or
    # too short to be one
    rows: np.ndarray
    end: int  # where the first record begins that is not whole
    starts: np.ndarray  # where each whole record begins, wanted or not, int64

    @property
    def short(self) -> np.ndarray:
        """Which of the rows are messages shorter than their own head, bool, shape (n,)."""
        return np.asarray((self.rows[:, CHANNEL] < 0) & (self.rows[:, OPCODE] == _MESSAGE))


def tabulate(content: bytes, wanted: np.ndarray = _IN_CHUNK) -> RecordTable:
    """The whole records in bytes.

    `wanted`: of each opcode whether it is, bool, shape (256,).
    """
    end = len(content)
    # eight bytes each, where a list takes forty: records may be as short as their heads
    found, at, head = array("q"), 0, HEAD.size
    length_at, append, last = _LENGTH_OF_RECORD.unpack_from, found.append, end - head
    while at <= last:
        (length,) = length_at(content, at)
        append(at)
        at += head + length
    if at > end:  # the last one is not whole
        at = found.pop()
    starts = np.frombuffer(found, np.int64)
    data = np.frombuffer(content, np.uint8)
    opcodes = data[starts]
    use = wanted[opcodes]
    if not use.any():
        return RecordTable(_NO_ROWS, at, starts)
    rows = np.empty((starts.size, 4), np.int64)
    rows[:, OPCODE] = opcodes
    rows[:, OFFSET] = starts + HEAD.size
    rows[:-1, LENGTH] = starts[1:]
    rows[-1:, LENGTH] = at
    rows[:, LENGTH] -= rows[:, OFFSET]
    rows = rows if use.all() else rows[use]
    messages = (rows[:, OPCODE] == _MESSAGE) & (rows[:, LENGTH] >= MESSAGE.size)
    which = slice(None) if messages.all() else messages
    rows[:, CHANNEL] = -1
    rows[which, CHANNEL] = windows(data, rows[which, OFFSET], 2).view("<u2")[:, 0]
    rows[which, OFFSET] += MESSAGE.size
    rows[which, LENGTH] -= MESSAGE.size
    return RecordTable(rows, at, starts)


def indexed_up_to(data: bytes | mmap.mmap, at: int, content: bytes | None) -> int:
    """Return where the message indexes end that begin at an offset: at the first bytes that are none.

    `content`: of their chunk. If there are no such messages in it, the function returns 0; None is not compared.
    """
    channels, counts, entries = [], [], []
    while at + INDEX_HEAD.size <= len(data):
        opcode, length, channel, size = INDEX_HEAD.unpack_from(data, at)
        first, end = at + INDEX_HEAD.size, at + HEAD.size + length
        if opcode != Opcode.MESSAGE_INDEX or size % _ENTRY or first + size != end or end > len(data):
            break
        channels.append(channel)
        counts.append(size // _ENTRY)
        entries.append(data[first:end])
        at = end
    times, places = np.frombuffer(b"".join(entries), "<u8").reshape(-1, 2).T
    if content is None or not places.size:
        return at
    if int(places.max()) > len(content) - HEAD.size - MESSAGE.size:
        return 0
    found = windows(np.frombuffer(content, np.uint8), places.astype(np.int64) + HEAD.size, MESSAGE.size)
    heads = found.view(MESSAGE_HEAD)[:, 0]
    fits = (heads["channel"] == np.repeat(channels, counts)) & (heads["log_ns"].view("<u8") == times)
    return at if fits.all() else 0


@dataclass(frozen=True, slots=True)
class Batch:
    """Messages in a row."""

    content: bytes  # bytes that hold them
    table: np.ndarray  # int64, shape (n, 4): opcode, channel id, offset and length of each message's data

    @property
    def data(self) -> np.ndarray:
        """The bytes as uint8."""
        return np.frombuffer(self.content, np.uint8)

    @property
    def heads(self) -> np.ndarray:
        """Records of `MESSAGE_HEAD`, shape (n,)."""
        return windows(self.data, self.table[:, OFFSET] - MESSAGE.size, MESSAGE.size).view(MESSAGE_HEAD)[:, 0]

    def message(self, row: int) -> Message:
        """One of them as mcap's object."""
        _, _, at, length = self.table[row].tolist()
        channel, sequence, log_time, publish_time = MESSAGE.unpack_from(self.content, at - MESSAGE.size)
        return Message(channel, log_time, self.content[at : at + length], publish_time, sequence)


class Messages:
    """The messages of a log, and its channels with their schemas; a channel without one has an empty schema."""

    def __init__(self) -> None:
        self.channels: dict[int, tuple[Channel, Schema]] = {}
        self._schemas: dict[int, Schema] = {0: Schema(id=0, name="", encoding="", data=b"")}

    def of(self, item: object, topic: str | None = None) -> Iterator[Message]:
        """Take an item of the log; yield the messages in it, of one topic or of all."""
        match item:
            case Schema():
                self._schemas[item.id] = item
            case Channel():
                self.channels[item.id] = item, self._schemas.get(item.schema_id, self._schemas[0])
            case Batch():
                wanted = [number for number, (of, _) in self.channels.items() if topic in (None, of.topic)]
                for row in np.flatnonzero(np.isin(item.table[:, CHANNEL], wanted)).tolist():
                    yield item.message(row)


def joined(items: Iterator[McapRecord | Batch], rows: int = JOINED) -> Iterator[McapRecord | Batch]:
    """The same with batches that follow each other made one, of so many messages or a few more: each batch costs."""
    held: list[Batch] = []
    count = 0
    for item in items:
        if isinstance(item, Batch):
            held.append(item)
            count += len(item.table)
            if count < rows:
                continue
        if held:
            yield _one_of(held)
            held, count = [], 0
        if not isinstance(item, Batch):
            yield item
    if held:
        yield _one_of(held)


def _one_of(batches: list[Batch]) -> Batch:
    if len(batches) == 1:
        return batches[0]
    tables, before = [], 0
    for batch in batches:
        tables.append(batch.table + np.array([0, 0, before, 0]))
        before += len(batch.content)
    return Batch(b"".join(batch.content for batch in batches), np.concatenate(tables))


def records_of(content: bytes, rows: np.ndarray) -> Iterator[McapRecord | Batch]:
    """Yield the records of a table as objects, messages in batches; raises McapError at one that cannot be read."""
    others = rows[:, OPCODE] != _MESSAGE
    first = 0
    for row in [*np.flatnonzero(others).tolist(), len(rows)]:
        if row > first:
            yield Batch(content, rows[first:row])
        if row < len(rows):
            opcode, _, at, length = rows[row].tolist()
            yield parse(PARSED[opcode], content[at : at + length])
        first = row + 1
