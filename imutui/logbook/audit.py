"""What is known of a scanned log as a whole, and the parts of it that tell; see `message_arrays`."""

from dataclasses import dataclass, field, replace

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Metadata

from filters.errors import InputError
from imutui.logbook import quality_summary, summary, unread_channels
from imutui.logbook.mcap_format import parse
from imutui.logbook.scan import Scan
from imutui.logbook.schemas import LogEvent
from imutui.logbook.session_info import METADATA, SessionInfo

# ------------------------------------------------------------------------------------------------------- message runs
# What the heads of a channel's messages say of their numbers and times, without keeping the messages.

MESSAGE = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log_ns", "<i8"), ("publish_ns", "<i8")])
"""What the format has of each message besides its data."""


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

    `heads`: records of `MESSAGE`, shape (N,), N > 0.
    """
    times, numbers = heads["log_ns"], heads["sequence"].astype(np.int64)
    back, steps = np.flatnonzero(np.diff(times) < 0), np.diff(numbers)
    again, left_out = steps < 1, steps > 1
    return HeadRun(
        int(times.size),
        int(times[0]),
        int(times[-1]),
        int(numbers[0]),
        int(numbers[-1]),
        int(back.size),
        int(times[back[0]]) if back.size else None,
        int(times[int(np.argmax(again)) + 1]) if again.any() else None,
        int(np.sum(steps[left_out] - 1)),
        int(times[int(np.argmax(left_out)) + 1]) if left_out.any() else None,
    )


def joined(a: HeadRun | None, b: HeadRun) -> HeadRun:
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

BELONGINGS = (Opcode.METADATA, Opcode.ATTACHMENT)
"""Records of what a log has besides messages."""


@dataclass(frozen=True, slots=True)
class Part:
    """Messages in a row, in file order."""

    # stamp_ns, gyro, accel, valid: samples as in `reader.Log`: stamps, rad/s, m/s², validity
    stamp_ns: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    valid: np.ndarray
    temperature_degc: np.ndarray  # temperatures, shape (M,)
    packets: np.ndarray  # records of `schemas.RAW_DTYPE`, shape (K,)
    # sample_heads, packet_heads: records of `MESSAGE`, one a sample, one a packet; None where some of
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

    @property
    def imu_topic(self) -> str | None:
        """Topic of the samples, if there is one."""
        return summary.imu_topic(self.types)


def belongings(found: Scan) -> Audit:
    """What a scanned log has besides messages: its session and other metadata, attachments, the quality summary."""
    known = Audit()
    with found.path.open("rb") as stream:
        for piece in found.pieces:
            if piece.opcode in BELONGINGS:
                stream.seek(piece.at)
                _take_belonging(known, piece.opcode, stream.read(piece.length))
    if summary.SUMMARY in known.attachments:
        known.result = quality_summary.parse(known.attachments[summary.SUMMARY])
    return known


def _take_belonging(known: Audit, opcode: int, body: bytes) -> None:
    if opcode == Opcode.ATTACHMENT:
        attachment = parse(Attachment, body)
        known.attachments[attachment.name] = attachment.data
        return
    record = parse(Metadata, body)
    known.metadata[record.name] = {str(k): str(v) for k, v in record.metadata.items()}
    if record.name == METADATA:
        known.session = known.metadata[record.name]
        try:
            info = SessionInfo.from_strings(known.session)
            info.axes(), info.settings()
            known.info = info
        except InputError as error:
            known.session_trouble = str(error)


def take_note(known: Audit, part: Part) -> None:
    """Add what a part tells of the whole."""
    if part.stamp_ns.size:
        first, last, latest = int(part.stamp_ns[0]), int(part.stamp_ns[-1]), int(part.stamp_ns.max())
        known.first_ns = known.first_ns if known.samples else first
        known.latest_ns = max(known.latest_ns, latest) if known.samples else latest
        known.last_ns = last
        known.samples += part.stamp_ns.size
        known.lacks &= unread_channels.unread(part.gyro, part.accel)
        known.unread_samples += int(np.count_nonzero(~part.valid))
    known.packets += part.packets.size
    for word, count in zip(*np.unique(part.packets["status"], return_counts=True), strict=True):
        known.statuses[int(word)] = known.statuses.get(int(word), 0) + int(count)
    degc = part.temperature_degc[np.isfinite(part.temperature_degc)]
    if degc.size:
        before = known.temperatures or Temperatures(float(degc[0]), 0.0, np.inf, -np.inf)
        least, greatest = min(before.least, float(degc.min())), max(before.greatest, float(degc.max()))
        known.temperatures = Temperatures(before.first, float(degc[-1]), least, greatest)
