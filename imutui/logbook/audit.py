"""Every message of a scanned log, to be judged: a bounded part of it at a time as arrays, and what all of them say.

Unlike `reader` it goes on behind damage and past messages that cannot be decoded, which it counts.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema

from filters.errors import InputError
from imutui.logbook import layout, reader, sample_check, schemas, summary
from imutui.logbook.columns import IGNORED, IMU, OTHER, RAW, ROLES, TEMPERATURE, Channels, Columns
from imutui.logbook.layout import UndecodableError
from imutui.logbook.mcap_stream import JOINED, MESSAGE_HEAD, Batch, joined
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.reading import AS_STATED, Reading
from imutui.logbook.samples import Held, Samples
from imutui.logbook.scan import Content, Scan
from imutui.logbook.schemas import LogEvent
from imutui.logbook.session_info import METADATA, SessionInfo
from imutui.logbook.walk import ChunkHead, reason

MESSAGES = 2**18  # messages in a part: a quarter of an hour at 133 Hz
_SHOWN = 20

# ------------------------------------------------------------------------------------------------------- message runs
# What the heads of a channel's messages say of their numbers and times, without keeping the messages.


@dataclass(frozen=True, slots=True)
class HeadRun:
    """Messages in file order; times are log times, UTC, ns."""

    count: int  # how many there are
    # first_ns, last_ns: time of the first and the last
    first_ns: int
    last_ns: int
    # first_number, last_number: their numbers
    first_number: int
    last_number: int
    back: int = 0  # messages before which time goes back
    back_ns: int | None = None  # time before it first does
    again_ns: int | None = None  # time of the first message whose number is not above the one before
    missing: int = 0  # numbers that were left out
    missing_ns: int | None = None  # time of the first message before which some were

    @property
    def since_zero(self) -> "HeadRun":
        """The same, with the numbers missing that lie between 0 and its first."""
        if not self.first_number:
            return self
        return replace(self, missing=self.missing + self.first_number, missing_ns=self.first_ns)


def run_of(heads: np.ndarray) -> HeadRun:
    """Numbers and times of messages.

    `heads`: records of `MESSAGE_HEAD`, shape (N,), N > 0.
    """
    times, numbers = heads["log_ns"], heads["sequence"].astype(np.int64)
    back, steps = np.flatnonzero(times[1:] < times[:-1]), numbers[1:] - numbers[:-1]
    again, left_out = np.flatnonzero(steps < 1), np.flatnonzero(steps > 1)
    return HeadRun(
        int(times.size),
        int(times[0]),
        int(times[-1]),
        int(numbers[0]),
        int(numbers[-1]),
        int(back.size),
        int(times[back[0]]) if back.size else None,
        int(times[again[0] + 1]) if again.size else None,
        int((steps[left_out] - 1).sum()),
        int(times[left_out[0] + 1]) if left_out.size else None,
    )


def joined_runs(a: HeadRun | None, b: HeadRun) -> HeadRun:
    """Messages, and those that follow them."""
    if a is None:
        return b
    back, step = b.first_ns < a.last_ns, b.first_number - a.last_number
    return HeadRun(
        a.count + b.count,
        a.first_ns,
        b.last_ns,
        a.first_number,
        b.last_number,
        a.back + back + b.back,
        _first(a.back_ns, a.last_ns if back else None, b.back_ns),
        _first(a.again_ns, b.first_ns if step < 1 else None, b.again_ns),
        a.missing + max(step - 1, 0) + b.missing,
        _first(a.missing_ns, b.first_ns if step > 1 else None, b.missing_ns),
    )


def _first(*found: int | None) -> int | None:
    return next((ns for ns in found if ns is not None), None)


# -------------------------------------------------------------------------------------------------------------- audit


@dataclass(frozen=True, slots=True)
class Part:
    """Messages in a row, in file order."""

    samples: Samples
    temperature_degc: np.ndarray  # temperatures, shape (M,)
    packets: np.ndarray  # records of `schemas.RAW_DTYPE`, shape (K,)
    # sample_heads, packet_heads: records of `MESSAGE_HEAD`, one a sample, one a packet; None where some of
    # these cannot be decoded
    sample_heads: np.ndarray | None
    packet_heads: np.ndarray | None


@dataclass(frozen=True, slots=True)
class Temperatures:
    """First, last, least and greatest of some, degC."""

    first: float
    last: float
    least: float
    greatest: float


@dataclass(slots=True)
class Audit:
    """Content of a scanned log, without its samples and packets."""

    info: SessionInfo | None = None  # its session; None in another program's file
    # the same as strings, with fields that this version does not know
    session: dict[str, str] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()  # of another program's log, in words
    session_trouble: str = ""  # why the session cannot be used, if so
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)  # records by name
    attachments: dict[str, bytes] = field(default_factory=dict)  # name to bytes
    # types, encodings: of each topic
    types: dict[str, str] = field(default_factory=dict)
    encodings: dict[str, str] = field(default_factory=dict)
    # of each topic that has some, their numbers and times; a topic's channels one after the other
    messages: dict[str, HeadRun] = field(default_factory=dict)
    # samples, packets: how many there are
    samples: int = 0
    packets: int = 0
    unread_samples: int = 0  # samples that are flagged as no reading
    # first_ns, last_ns, latest_ns: stamps of the samples, UTC, ns: the first and the last in the file, and the latest;
    # 0 if there is none
    first_ns: int = 0
    last_ns: int = 0
    latest_ns: int = 0
    # channels that are NaN in every sample, gyros first, body axes, bool, shape (6,)
    lacks: np.ndarray = field(default_factory=lambda: np.ones(6, bool))
    temperatures: Temperatures | None = None  # of all of them; None if there is none
    # how many packets have each status word; zero where packets have none
    statuses: dict[int, int] = field(default_factory=dict)
    events: list[LogEvent] = field(default_factory=list)  # marks and events
    diagnostics: dict[str, str] = field(default_factory=dict)  # values of the last /diagnostics
    # topic, log time (ns) and reason of messages that cannot be decoded; the first of them
    undecodable: list[tuple[str, int, str]] = field(default_factory=list)
    undecodable_count: int = 0  # all of them
    homeless: int = 0  # messages of channels that nothing declares
    result: dict[str, object] = field(default_factory=dict)  # the quality summary that was attached on closing


def _take_note(known: Audit, part: Part) -> None:
    """Add what a part tells of the whole."""
    if len(samples := part.samples):
        first, last, latest = (int(ns) for ns in (samples.stamp_ns[0], samples.stamp_ns[-1], samples.stamp_ns.max()))
        known.first_ns = known.first_ns if known.samples else first
        known.latest_ns = max(known.latest_ns, latest) if known.samples else latest
        known.last_ns = last
        known.samples += len(samples)
        known.lacks &= sample_check.unread(samples.gyro, samples.accel)
        known.unread_samples += int(np.count_nonzero(~samples.valid))
    known.packets += part.packets.size
    for word, count in zip(*np.unique(part.packets["status"], return_counts=True), strict=True):
        known.statuses[int(word)] = known.statuses.get(int(word), 0) + int(count)
    degc = part.temperature_degc[np.isfinite(part.temperature_degc)]
    if degc.size:
        before = known.temperatures or Temperatures(float(degc[0]), 0.0, np.inf, -np.inf)
        least, greatest = min(before.least, float(degc.min())), max(before.greatest, float(degc.max()))
        known.temperatures = Temperatures(before.first, float(degc[-1]), least, greatest)


# -------------------------------------------------------------------------------------------------------------- parts


def audit(found: Scan, reading: Reading = AS_STATED, progress: Callable[[float], None] = lambda share: None) -> Audit:
    """Return what is known of a log as a whole; see `parts`."""
    known = Audit()
    for _ in parts(found, known, reading, progress):
        pass
    return known


def parts(
    found: Scan,
    known: Audit,
    reading: Reading = AS_STATED,
    progress: Callable[[float], None] = lambda share: None,
    *,
    indexes: bool = False,
) -> Iterator[Part]:
    """Yield every message of a file that can be read, `MESSAGES` at a time or a few more.

    `found`: of the file, filled while it is walked.
    `known`: filled likewise; its session is there before the first part, since a log begins with it.
    `progress`, `indexes`: as of `Scan.items`.
    Raises UnreadableLogError as `Scan.items`.
    """
    work = _Work(known)
    for item in joined(work.met(found, found.items(progress, indexes=indexes)), min(JOINED, MESSAGES)):
        if isinstance(item, Schema | Channel):
            work.declare(item)
        elif isinstance(item, Metadata | Attachment):
            work.belonging(item)
        elif isinstance(item, Batch) and work.take(item) >= MESSAGES:
            yield work.part()
    yield work.part()
    work.close()
    if summary.SUMMARY in known.attachments:
        known.result = summary.quality(known.attachments[summary.SUMMARY])
    if known.session or known.session_trouble:
        reader.refuse_stated(found.path, reading)
    else:
        yield from _foreign_parts(found, known, reading)
    progress(1.0)


def _foreign_parts(found: Scan, known: Audit, reading: Reading) -> Iterator[Part]:
    """Yield the samples of another program's log as a replay takes them, up to the first damage."""
    try:
        for log in reader.parts(found.path, MESSAGES, reading=reading):
            known.assumed = log.assumed
            part = Part(log.samples, log.samples.degc, log.packets, None, None)
            _take_note(known, part)
            yield part
    except UnreadableLogError:
        if not found.damages:
            raise


class _Work(Channels):
    """Makes parts of a file's messages, and notes what is known of all in an `Audit`."""

    def __init__(self, known: Audit) -> None:
        super().__init__()
        self.audit = known
        self._heads: list[tuple[np.ndarray, np.ndarray]] = []
        self._runs: dict[int, HeadRun] = {}
        self._degc = Held(1, from_start=True)

    def belonging(self, record: Metadata | Attachment) -> None:
        """Take metadata or an attachment, of several of one name the last; a session makes the channels imutui's."""
        known = self.audit
        if isinstance(record, Attachment):
            known.attachments[record.name] = record.data
            return
        known.metadata[record.name] = record.metadata
        if record.name != METADATA:
            return
        known.session = known.metadata[METADATA]
        try:
            known.info = SessionInfo.from_strings(known.session)
        except InputError as error:
            known.session_trouble = str(error)
        for channel in self.channels.values():
            self._assign(channel, self.types.get(channel.schema_id, ""))

    def met(self, found: Scan, items: Iterator[Content]) -> Iterator[McapRecord | Batch]:
        """Yield the items without the heads of chunks."""
        declared = False
        for item in items:
            if found.index is not None and not declared:
                # the index comes before all records; it has the declarations that the file may have lost
                declared = True
                yield from [*found.index.schemas.values(), *found.index.channels.values()]
            if isinstance(item, ChunkHead):
                self.audit.undecodable_count += item.short
            else:
                yield item

    def take(self, batch: Batch) -> int:
        """Take messages; returns how many wait to be a part."""
        self._heads.append((batch.heads, self.messages(batch)))
        return sum(len(roles) for _, roles in self._heads)

    def _assign(self, channel: Channel, typename: str) -> None:
        self.audit.types[channel.topic] = typename
        self.audit.encodings[channel.topic] = channel.message_encoding
        ours = channel.message_encoding == "cdr" and schemas.is_own(channel.topic, typename)
        # samples of another program are read as a replay takes them
        own = ours and bool(self.audit.session or self.audit.session_trouble)
        self._roles[channel.id] = ROLES.get(channel.topic, OTHER) if own else IGNORED

    def _other(self, topic: str, message: Message) -> None:
        data = message.data
        if topic == schemas.EVENTS:
            self.audit.events.append(schemas.decode_event(data))
        elif topic == schemas.DIAGNOSTICS:
            values = schemas.decode_diagnostics(data)
            self.audit.diagnostics = self.audit.diagnostics if values is None else values
        else:
            layout.layout_in(schemas.TYPES[topic], data)

    def _passes_over(self, topic: str, message: Message, error: UndecodableError) -> bool:
        self.audit.undecodable_count += 1
        if len(self.audit.undecodable) < _SHOWN:
            self.audit.undecodable.append((topic, message.log_time, reason(error)))
        return True

    def part(self) -> Part:
        """What was collected since the last time, as arrays."""
        heads = np.concatenate([np.empty(0, MESSAGE_HEAD), *(heads for heads, _ in self._heads)])
        roles = np.concatenate([np.empty(0, np.uint8), *(roles for _, roles in self._heads)])
        for channel in np.flatnonzero(np.bincount(heads["channel"])).tolist():
            self._runs[channel] = joined_runs(self._runs.get(channel), run_of(heads[heads["channel"] == channel]))
        rows, packets, temperatures = (self.columns.all(role) for role in (IMU, RAW, TEMPERATURE))
        self._degc.take(temperatures["stamp_ns"], temperatures["degc"][:, None])
        samples = Samples(**rows, degc=self._degc.at(rows["stamp_ns"])[:, 0])
        each = [heads[roles == role] for role in (IMU, RAW)]
        counts = (len(samples), packets["packets"].size)
        sample_heads, packet_heads = (own if own.size == n else None for own, n in zip(each, counts, strict=True))
        self._heads, self.columns = [], Columns()
        part = Part(samples, temperatures["degc"], packets["packets"], sample_heads, packet_heads)
        _take_note(self.audit, part)
        return part

    def close(self) -> None:
        """Say of each topic what is known of its channels."""
        for number, run in sorted(self._runs.items()):
            if number in self.channels:
                topic = self.channels[number].topic
                self.audit.messages[topic] = joined_runs(self.audit.messages.get(topic), run)
            else:
                self.audit.homeless += run.count
