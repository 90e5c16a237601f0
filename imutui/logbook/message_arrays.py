"""Every message of a scanned log, to be judged: a bounded part of it at a time as arrays, and what all of them say.

Unlike `reader` it goes on behind damage and past messages that cannot be decoded, which it counts.
"""

from collections.abc import Callable, Iterator

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from imutui.logbook import audit as auditing
from imutui.logbook import mcap_format, message_layout, record_walk, schemas
from imutui.logbook.audit import BELONGINGS, MESSAGE, Audit, HeadRun, Part
from imutui.logbook.columns import Columns
from imutui.logbook.mcap_format import HEAD, parse
from imutui.logbook.mcap_stream import Batch
from imutui.logbook.record_walk import Walk
from imutui.logbook.scan import Piece, Scan

MESSAGES = 2**18
"""Messages in a part: a quarter of an hour at 133 Hz."""
_WANTED = np.isin(np.arange(256), [Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE])
_PLAIN = {
    schemas.RAW: message_layout.RAW,
    schemas.IMU: message_layout.IMU,
    schemas.TEMPERATURE: message_layout.TEMPERATURE,
    schemas.REFERENCE: message_layout.TABLE,
}
_SHOWN = 20


def parts(found: Scan, known: Audit, progress: Callable[[float], None] = lambda share: None) -> Iterator[Part]:
    """Every message that a scan found whole, `MESSAGES` at a time or a few more.

    `found`: of a log.
    `known`: its `audit.belongings`; what is known of the messages is put into it, and is whole after the last part.
    `progress`: told the share done, 0 to 1.
    """
    work = _Work(found, known, record_walk.for_reading(found.size))
    with found.path.open("rb") as stream:
        for number, piece in enumerate(found.pieces):
            if piece.opcode not in BELONGINGS:
                stream.seek(piece.at)
                work.take(piece, stream.read(piece.length))
            if work.messages >= MESSAGES:
                yield work.part()
            progress(number / len(found.pieces))
    yield work.part()
    work.close()
    progress(1.0)


def audit(found: Scan, progress: Callable[[float], None] = lambda share: None) -> Audit:
    """What is known of a scanned log as a whole; see `parts`."""
    known = auditing.belongings(found)
    for _ in parts(found, known, progress):
        pass
    return known


class _Work:
    """Makes parts of a file's records, and notes what is known of all in an `Audit`."""

    def __init__(self, found: Scan, known: Audit, walk: Walk) -> None:
        self.audit = known
        self.messages = 0
        self._walk = walk
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}
        self._inflater = mcap_format.Inflater(found.size)
        self._columns = Columns(walk)
        self._roles = np.full(2**16, message_layout.IGNORED, np.uint8)
        self._heads: list[np.ndarray] = []
        self._runs: dict[int, HeadRun | None] = {}
        if found.index is not None:
            for schema in found.index.schemas.values():
                self._schemas[schema.id] = schema.name
            for channel in found.index.channels.values():
                self._declare(channel)

    def take(self, piece: Piece, body: bytes) -> None:
        """Take a record of the file: a chunk's messages, or what stands outside of chunks."""
        if piece.opcode == Opcode.CHUNK:
            self._records(self._inflater.content(mcap_format.chunk_of(body)))
        else:
            self._records(HEAD.pack(piece.opcode, piece.length) + body)

    def _declare(self, channel: Channel) -> None:
        self._channels[channel.id] = channel
        typename = self._schemas.get(channel.schema_id, "")
        self.audit.types[channel.topic] = typename
        self.audit.encodings[channel.topic] = channel.message_encoding
        cdr = channel.message_encoding == "cdr"
        ours = cdr and schemas.is_own(channel.topic, typename)
        imu = cdr and typename == schemas.TYPES[schemas.IMU] and channel.topic == self.audit.imu_topic
        own = _PLAIN.get(channel.topic, message_layout.OTHER) if ours else message_layout.IGNORED
        self._roles[channel.id] = message_layout.IMU if imu else own

    def _records(self, content: bytes) -> None:
        data = np.frombuffer(content, np.uint8)
        table, _, others, short = self._walk.tabulate(data, len(content), _WANTED)
        self.audit.undecodable_count += short
        messages = table[:, message_layout.OPCODE] == message_layout.MESSAGE_OPCODE
        for _, _, at, length in table[~messages].tolist() if others else ():
            self._declaration(content[at - HEAD.size], content[at : at + length])
        table = table[messages & (table[:, message_layout.CHANNEL] >= 0)]
        if len(table):
            self._batch(Batch(content, data, table))

    def _declaration(self, opcode: int, body: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema = parse(Schema, body)
            self._schemas[schema.id] = schema.name
        else:
            self._declare(parse(Channel, body))

    def _batch(self, batch: Batch) -> None:
        starts = batch.table[:, message_layout.OFFSET] - message_layout.MESSAGE_HEADER_SIZE
        heads = batch.data[starts[:, None] + np.arange(message_layout.MESSAGE_HEADER_SIZE)].copy().view(MESSAGE)[:, 0]
        for channel in np.flatnonzero(np.bincount(heads["channel"])).tolist():
            self._runs.setdefault(channel, None)
        self._heads.append(heads)
        self.messages += heads.size
        counts, others = self._walk.tally(batch.table, self._roles)
        for row in others.tolist():
            self._one(batch, row, heads)
        if not self._columns.take(batch, self._roles, counts):
            roles = self._roles[batch.table[:, message_layout.CHANNEL]]
            for row in np.flatnonzero(roles > message_layout.OTHER).tolist():
                self._one(batch, row, heads)

    def _one(self, batch: Batch, row: int, heads: np.ndarray) -> None:
        """A message that is decoded by itself."""
        channel = self._channels[int(heads["channel"][row])]
        message = batch.message(row)
        try:
            match int(self._roles[channel.id]):
                case message_layout.IMU:
                    self._columns.sample(message)
                case message_layout.TEMPERATURE:
                    self._columns.temperature(message)
                case message_layout.RAW:
                    self._columns.packet(message)
                case message_layout.TABLE:
                    self._columns.table(message)
                case _:
                    self._rare(channel.topic, message.data)
        except schemas.UndecodableError as error:
            self.audit.undecodable_count += 1
            if len(self.audit.undecodable) < _SHOWN:
                reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
                self.audit.undecodable.append((channel.topic, message.log_time, reason))

    def _rare(self, topic: str, data: bytes) -> None:
        if topic == schemas.ESTIMATE and schemas.is_plain_estimate(data):
            return
        if topic == schemas.EVENTS:
            self.audit.events.append(schemas.decode_event(data))
        elif topic == schemas.DIAGNOSTICS:
            values = schemas.decode_diagnostics(data)
            self.audit.diagnostics = self.audit.diagnostics if values is None else values
        else:
            schemas.decode(schemas.TYPES[topic], data)

    def part(self) -> Part:
        """What was collected since the last time, as arrays."""
        heads = np.concatenate(self._heads) if self._heads else np.empty(0, MESSAGE)
        for channel in np.flatnonzero(np.bincount(heads["channel"])).tolist():
            run = auditing.run_of(heads[heads["channel"] == channel])
            self._runs[channel] = auditing.joined(self._runs[channel], run)
        samples, packets = self._columns.imu(), self._columns.packets()
        _, degc = self._columns.temperatures()
        roles = self._roles[heads["channel"]]
        each = [heads[roles == role] for role in (message_layout.IMU, message_layout.RAW)]
        paired = [own if own.size == rows.size else None for own, rows in zip(each, (samples[0], packets), strict=True)]
        self._heads, self.messages, self._columns = [], 0, Columns(self._walk)
        part = Part(*samples, degc, packets, *paired)
        auditing.take_note(self.audit, part)
        return part

    def close(self) -> None:
        """Say of each topic what is known of its channels."""
        for number, run in self._runs.items():
            assert run is not None
            if number in self._channels:
                topic = self._channels[number].topic
                self.audit.messages[topic] = auditing.joined(self.audit.messages.get(topic), run)
            else:
                self.audit.homeless += run.count
