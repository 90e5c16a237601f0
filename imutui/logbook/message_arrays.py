"""Every message of a scanned log, as arrays to be judged: times and numbers of each topic, samples, packets, events.

Unlike `reader` it goes on behind damage and past messages that cannot be decoded, which it counts.
"""

import mmap
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema

from imutui.logbook import mcap_format, message_layout, quality_summary, record_walk, schemas, summary
from imutui.logbook import scan as scanning
from imutui.logbook.columns import Columns
from imutui.logbook.mcap_format import HEAD, parse
from imutui.logbook.mcap_stream import Batch
from imutui.logbook.reader import Table
from imutui.logbook.record_walk import Walk
from imutui.logbook.scan import Piece, Scan
from imutui.logbook.schemas import LogEvent
from imutui.logbook.session_info import METADATA, SessionInfo

MESSAGE = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log_ns", "<i8"), ("publish_ns", "<i8")])
"""What the format has of each message besides its data."""
_WANTED = np.isin(np.arange(256), [Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE])
_PLAIN = {
    schemas.RAW: message_layout.RAW,
    schemas.IMU: message_layout.IMU,
    schemas.TEMPERATURE: message_layout.TEMPERATURE,
    schemas.REFERENCE: message_layout.TABLE,
}
_SHOWN = 20


@dataclass(slots=True)
class Audit:
    """Content of a scanned log.

    Attributes
    ----------
    info : SessionInfo or None
        Its session; None in another program's file.
    session : dict
        The same as strings, with fields that this version does not know.
    session_trouble : str
        Why the session cannot be used, if so.
    metadata : dict
        Records by name.
    attachments : dict
        Name to bytes.
    types, encodings : dict
        Of each topic.
    messages : dict
        Of each topic that has some, records of `MESSAGE` in file order.
    samples, gyro, accel, valid : np.ndarray
        As in `reader.Log`: stamps, rad/s, m/s², validity.
    temperature_degc : np.ndarray
        All temperatures.
    packets : np.ndarray
        Records of `schemas.RAW_DTYPE`.
    table : Table
        All of /table/reference.
    events : list of LogEvent
        Marks and events.
    diagnostics : dict
        Values of the last /diagnostics.
    undecodable : list of tuple
        Topic, log time (ns) and reason of messages that cannot be decoded; the first of them.
    undecodable_count : int
        All of them.
    homeless : int
        Messages of channels that nothing declares.
    result : dict
        The quality summary that was attached on closing.
    """

    info: SessionInfo | None = None
    session: dict[str, str] = field(default_factory=dict)
    session_trouble: str = ""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    encodings: dict[str, str] = field(default_factory=dict)
    messages: dict[str, np.ndarray] = field(default_factory=dict)
    samples: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    gyro: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    accel: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    valid: np.ndarray = field(default_factory=lambda: np.empty(0, bool))
    temperature_degc: np.ndarray = field(default_factory=lambda: np.empty(0))
    packets: np.ndarray = field(default_factory=lambda: np.empty(0, schemas.RAW_DTYPE))
    table: Table = field(default_factory=Table)
    events: list[LogEvent] = field(default_factory=list)
    diagnostics: dict[str, str] = field(default_factory=dict)
    undecodable: list[tuple[str, int, str]] = field(default_factory=list)
    undecodable_count: int = 0
    homeless: int = 0
    result: dict[str, object] = field(default_factory=dict)

    @property
    def imu_topic(self) -> str | None:
        """Topic of the samples, if there is one."""
        return summary.imu_topic(self.types)


def audit(found: Scan, progress: Callable[[float], None] = lambda share: None) -> Audit:
    """Take every message that a scan found whole.

    Parameters
    ----------
    found : Scan
        Of a log.
    progress : callable
        Told the share done, 0 to 1.
    """
    with found.path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        work = _Work(found, record_walk.for_reading(found.size))
        for number, piece in enumerate(found.pieces):
            work.take(piece, scanning.content(data, piece))
            progress(number / len(found.pieces))
    work.close()
    progress(1.0)
    return work.audit


class _Work:
    """Collects pieces into an `Audit`."""

    def __init__(self, found: Scan, walk: Walk) -> None:
        self.audit = Audit()
        self._walk = walk
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}
        self._inflater = mcap_format.Inflater(found.size)
        self._columns = Columns(walk)
        self._roles = np.full(2**16, message_layout.IGNORED, np.uint8)
        self._parts: dict[int, list[np.ndarray]] = {}
        if found.index is not None:
            for schema in found.index.schemas.values():
                self._schemas[schema.id] = schema.name
            for channel in found.index.channels.values():
                self._declare(channel)

    def take(self, piece: Piece, body: bytes) -> None:
        """Take a record of the file: a chunk's messages, metadata, an attachment, or what stands outside of chunks."""
        if piece.opcode == Opcode.CHUNK:
            self._records(self._inflater.content(mcap_format.chunk_of(body)))
        elif piece.opcode == Opcode.METADATA:
            record = parse(Metadata, body)
            self.audit.metadata[record.name] = {str(k): str(v) for k, v in record.metadata.items()}
            if record.name == METADATA:
                self._session(self.audit.metadata[record.name])
        elif piece.opcode == Opcode.ATTACHMENT:
            attachment = parse(Attachment, body)
            self.audit.attachments[attachment.name] = attachment.data
        else:
            self._records(HEAD.pack(piece.opcode, piece.length) + body)

    def _session(self, strings: dict[str, str]) -> None:
        self.audit.session = strings
        try:
            info = SessionInfo.from_strings(strings)
            info.axes(), info.settings()
            self.audit.info = info
        except ValueError as error:
            self.audit.session_trouble = str(error)

    def _declare(self, channel: Channel) -> None:
        self._channels[channel.id] = channel
        typename = self._schemas.get(channel.schema_id, "")
        self.audit.types[channel.topic] = typename
        self.audit.encodings[channel.topic] = channel.message_encoding
        cdr = channel.message_encoding == "cdr"
        ours = cdr and schemas.TYPES.get(channel.topic) == typename
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
            self._parts.setdefault(channel, []).append(heads[heads["channel"] == channel])
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
        except schemas.UNDECODABLE as error:
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

    def close(self) -> None:
        """Make arrays of what was collected."""
        a = self.audit
        for number, parts in self._parts.items():
            heads = np.concatenate(parts)
            if number in self._channels:
                topic = self._channels[number].topic
                a.messages[topic] = np.concatenate([a.messages[topic], heads]) if topic in a.messages else heads
            else:
                a.homeless += heads.size
        a.samples, a.gyro, a.accel, a.valid = self._columns.imu()
        _, a.temperature_degc = self._columns.temperatures()
        a.packets = self._columns.packets()
        a.table = Table(*self._columns.tables())
        if summary.SUMMARY in a.attachments:
            a.result = quality_summary.parse(a.attachments[summary.SUMMARY])
