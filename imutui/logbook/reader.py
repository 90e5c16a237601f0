"""Reading a log, finished or not: everything up to the last flush, into arrays.

Samples, temperatures and packets go from a chunk's bytes into columns without becoming objects; messages of another
layout than ours, and the rare kinds, are decoded one by one.
"""

import contextlib
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema

from filters.errors import InputError
from imutui import outside_file
from imutui.command_line import command
from imutui.logbook import foreign_log, layout, sample_check, schemas
from imutui.logbook.columns import IGNORED, IMU, OTHER, RAW, ROLES, STATE, TABLE, TEMPERATURE, Channels
from imutui.logbook.foreign_log import Cure, RefusedLogError, Survey
from imutui.logbook.layout import UndecodableError
from imutui.logbook.mcap_format import MAGIC, Index
from imutui.logbook.mcap_stream import JOINED, Batch, joined
from imutui.logbook.reading import AS_STATED, AXES, Reading
from imutui.logbook.sample_check import SampleCheck
from imutui.logbook.samples import Samples, Waiting
from imutui.logbook.schemas import LogEvent
from imutui.logbook.session_info import FOREIGN, METADATA, SessionInfo
from imutui.logbook.walk import CHECKSUM, CUT, ChunkHead, Damage, End, walk


class UnreadableLogError(InputError):
    """The file is no log that imutui can use; the message says what, where, and what to do next."""


@dataclass(frozen=True, slots=True)
class Table:
    """What /table/reference or /table/state says, at each stamp (UTC, ns, int64, (L,)).

    Angles are in deg, (L, 3), rates in deg/s, (L, 3).
    NaN where it is not known.
    """

    stamp_ns: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    angles_deg: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    rates_dps: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    uncertainty_ns: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))  # of the stamp; of states only


@dataclass(slots=True)
class Log:
    """Content of a log."""

    path: Path  # where it lies
    info: SessionInfo = FOREIGN  # its metadata
    own: bool = False  # whether imutui wrote it
    samples: Samples = field(default_factory=Samples)
    first_ns: int = 0  # stamp of the log's first sample, from which times are counted
    # packets as received, records of `schemas.RAW_DTYPE`, shape (K,); read on request only
    packets: np.ndarray = field(default_factory=lambda: np.empty(0, schemas.RAW_DTYPE))
    packet_stamp_ns: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))  # when sampled, UTC, ns, (K,)
    # whether packets have temperatures of each sensor and a status word; else these fields are zero
    has_details: bool = False
    reference: str | None = None  # kind of the last /table/reference
    table: Table = field(default_factory=Table)  # content of all of them
    states: Table = field(default_factory=Table)  # of /table/state: what a table's controller measured
    events: list[LogEvent] = field(default_factory=list)  # marks and events
    diagnostics: dict[str, str] = field(default_factory=dict)  # values of the last /diagnostics
    attachments: dict[str, bytes] = field(default_factory=dict)  # name to bytes
    finished: bool = False  # whether the file has its footer
    damage: str = ""  # what is wrong with the file, if anything
    # of another program's log: what was assumed of it, in words, and its mean specific force as the file has it, m/s²
    assumed: tuple[str, ...] = ()
    mean_force: np.ndarray | None = None

    @property
    def unread(self) -> np.ndarray:
        """Which channels the log lacks, gyros first, body axes, bool, shape (6,): they are NaN throughout."""
        return sample_check.unread(self.samples.gyro, self.samples.accel)

    def seconds(self) -> np.ndarray:
        """Time of the samples since the log's first, s, shape (N,)."""
        return np.asarray(seconds_since(self.samples.stamp_ns, self.first_ns))


def seconds_since(stamp_ns: Any, first_ns: int) -> Any:
    """Time since the first sample, s; the one rule for live and replay."""
    return (stamp_ns - first_ns) / 1e9


def read(path: Path, *, raw: bool = False, reading: Reading = AS_STATED) -> Log:
    """Read a log.

    `path`: MCAP file, finished or not.
    `raw`: read /imu/raw too.
    `reading`: its topics, stamps, axes and part count for another program's log.
    Returns up to the last record that could be read; `finished` and `damage` say whether that is all.
    Raises UnreadableLogError if there is no such file, it is no MCAP file, or it holds no IMU samples.
    """
    *_, log = parts(path, raw=raw, reading=reading)
    check = SampleCheck()
    check.take(log.samples)
    if trouble := check.trouble(path):
        raise UnreadableLogError(trouble)
    return log


def parts(path: Path, rows: int | None = None, *, raw: bool = False, reading: Reading = AS_STATED) -> Iterator[Log]:
    """Yield what a log holds in parts; what is known only of the whole is in the last one.

    `rows`: samples (or, with `raw`, packets) in a part, or a few more; None for all of them in one. The samples of a
      part begin and end up to ten seconds before its packets and its table: their temperatures may come later.
    `raw`: read /imu/raw too.
    Raises UnreadableLogError as `read`; samples themselves are not looked at.
    Raises RefusedLogError if another program's log can be taken in several ways.
    """
    foreign = foreign_log.survey(records(path, Log(path)))
    if foreign is not None:
        yield from _foreign_parts(path, foreign, reading, rows)
        return
    refuse_stated(path, reading)
    log = Log(path)
    content = Content(log, raw)
    for record in records(path, log, JOINED if rows is None else min(rows, JOINED)):
        try:
            content.take(record)
        except UndecodableError as error:
            log.damage = f"a message cannot be decoded ({error})"
            break
        if rows is not None and content.columns.rows >= rows:
            yield content.drain()
    content.close()
    log.finished = log.finished and not log.damage
    if not content.has_samples:
        raise UnreadableLogError(_nothing(path, log, content))
    yield log


def refuse_stated(path: Path, reading: Reading) -> None:
    """Raise InputError if a caller states of a log of imutui what the log states itself."""
    if reading.of_foreign:
        raise InputError(
            f"{path} states its own {' and '.join(reading.of_foreign)}: it is a log of imutui. Leave those options out."
        )


def _foreign_parts(path: Path, found: Survey, reading: Reading, rows: int | None) -> Iterator[Log]:
    """Yield a log of another program in parts, as `parts` does."""
    log = Log(path)
    if not found.samples:
        raise _no_samples(path, found)
    try:
        plan = foreign_log.plan(found, reading, lambda: records(path, Log(path)))
    except RefusedLogError as error:
        raise RefusedLogError(f"{path}: {error}", [_of(path, cure) for cure in error.cures]) from None
    rate = 1e9 / (plan.period_ns or 1e9)
    own = {name: value for name, value in reading.overrides.items() if name in AXES}
    log.info = replace(FOREIGN, rate_hz=rate).overridden(own)
    log.assumed, log.mean_force, log.first_ns = plan.assumed, plan.mean_force, plan.first_ns
    waiting = Waiting()
    for columns in foreign_log.samples(lambda: records(path, log), plan, reading, log.info.axes()):
        degc_stamp_ns, degc = columns.pop("degc_stamp_ns"), columns.pop("degc")
        waiting.take(columns, degc_stamp_ns, degc)
        if rows is not None and len(waiting) >= rows:
            yield replace(log, samples=waiting.ready())
    log.finished = log.finished and not log.damage
    log.samples = waiting.rest()
    yield log


def _of(path: Path, cure: Cure) -> Cure:
    """Return a cure with the names of its files, where it is an import."""
    name, flags = cure
    return cure if name != "import" else (name, (str(path), *flags, "-o", str(path.with_name(f"{path.stem}_si.mcap"))))


def _no_samples(path: Path, found: Survey) -> InputError:
    """Return why another program's file has no samples, and what to do next."""
    listed = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(found.others.items())) or "none"
    what = (
        f"{path} is an MCAP file without IMU samples: no message of type sensor_msgs/msg/Imu in CDR. Topics: {listed}"
    )
    near = [topic for topic, kind in found.others.items() if "imu" in kind.lower()]
    if near:
        return RefusedLogError(what, [_of(path, ("import", ("--topic", each, "--accel-sign", "+1"))) for each in near])
    return UnreadableLogError(f"{what}. Name a file that has some, or import the recording with `imutui import`.")


def sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, hexadecimal; raises OSError if it cannot be read."""
    with outside_file.opened(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


class Content(Channels):
    """Collects records into a `Log`.

    `log`: to be filled.
    `raw`: whether packets are collected too.
    """

    def __init__(self, log: Log, raw: bool) -> None:
        super().__init__()
        self.log = log
        ignored = [schemas.ESTIMATE] if raw else [schemas.ESTIMATE, schemas.RAW]
        self._topics = (
            ROLES | dict.fromkeys(ignored, IGNORED) | dict.fromkeys([schemas.DIAGNOSTICS, schemas.EVENTS], OTHER)
        )
        self._diagnostics: bytes | None = None
        self._waiting = Waiting()
        self.has_samples = False

    def take(self, record: McapRecord | Batch) -> None:
        """One record in file order, or messages in a row."""
        match record:
            case Schema() | Channel():
                self.declare(record)
            case Metadata():
                if record.name == METADATA:
                    self._session(record)
            case Attachment():
                self.log.attachments[record.name] = record.data
            case Batch():
                self.messages(record)

    def _session(self, record: Metadata) -> None:
        self.log.own = True
        try:
            self.log.info = SessionInfo.from_strings(record.metadata)
        except InputError as error:
            raise UnreadableLogError(f"{self.log.path}: {error}. The metadata was changed by hand?") from error

    def _assign(self, channel: Channel, typename: str) -> None:
        ours = channel.message_encoding == "cdr" and schemas.is_own(channel.topic, typename)
        if ours and channel.topic == schemas.RAW:
            self.log.has_details = typename == schemas.S1_PACKET
        self._roles[channel.id] = self._topics.get(channel.topic, IGNORED) if ours else IGNORED

    def _other(self, topic: str, message: Message) -> None:
        if topic == schemas.EVENTS:
            self.log.events.append(schemas.decode_event(message.data))
        else:
            self._diagnostics = message.data

    def _passes_over(self, topic: str, message: Message, error: UndecodableError) -> bool:
        return False

    def drain(self) -> Log:
        """Return what was collected since the last time, as a log of its own, without samples that wait."""
        part = replace(self.log)
        self._fill(part)
        self.log.first_ns = part.first_ns
        return part

    def close(self) -> None:
        """Make arrays of all that was collected."""
        log = self.log
        self._fill(log, last=True)
        try:
            if self.last_table is not None:
                log.reference = layout.text(
                    layout.decode(schemas.TYPES[schemas.REFERENCE], self.last_table.data), "kind"
                )
            if self._diagnostics is not None:
                values = schemas.decode_diagnostics(self._diagnostics)
                if values is None:
                    raise UndecodableError("its diagnostics have no status")
                log.diagnostics = values
        except UndecodableError as error:
            log.damage = log.damage or f"a message cannot be decoded ({error})"

    def _fill(self, log: Log, *, last: bool = False) -> None:
        samples, temperatures, packets = (self.columns.all(role) for role in (IMU, TEMPERATURE, RAW))
        if samples["stamp_ns"].size and not self.has_samples:
            log.first_ns, self.has_samples = int(samples["stamp_ns"][0]), True
        self._waiting.take(samples, temperatures["stamp_ns"], temperatures["degc"])
        log.samples = self._waiting.rest() if last else self._waiting.ready()
        log.packets, log.packet_stamp_ns = packets["packets"], packets["stamp_ns"]
        log.table, log.states = Table(**self.columns.all(TABLE)), Table(**self.columns.all(STATE))


def records(path: Path, log: Log, rows: int = JOINED) -> Iterator[McapRecord | Batch]:
    """Records in file order up to the footer, or to the last one that is whole; says in `log.damage` what ended it.

    `rows`: messages in a batch.
    """
    with contextlib.closing(opened(path)) as stream:
        if not MAGIC.startswith(stream.read(len(MAGIC))):
            raise UnreadableLogError(foreign(path))
        stream.seek(0)
        yield from joined(_until_damage(stream, log), rows)


def _until_damage(stream: IO[bytes], log: Log) -> Iterator[McapRecord | Batch]:
    try:
        for item in walk(stream):
            match item:
                case Damage():
                    log.damage = _damage_of(item)
                    return
                case ChunkHead(short=short) if short:
                    log.damage = "a record cannot be read (a message is shorter than its header)"
                    return
                case End():
                    log.finished = item.finished and not item.checksum_wrong
                    log.damage = log.damage or _damage_of_end(item)
                case ChunkHead() | Index():
                    pass
                case _:
                    yield item
    except OSError as error:
        log.damage = f"a record cannot be read ({error})"


_CUT = "the file ends in the middle: the recorder was killed, or the file was cut"
_CHANGED = "a checksum is wrong: bytes were changed after recording"


def _damage_of(damage: Damage) -> str:
    if damage.why.startswith(CUT):
        return _CUT
    return _CHANGED if damage.why == CHECKSUM else f"a record cannot be read ({damage.why})"


def _damage_of_end(end: End) -> str:
    if end.checksum_wrong:
        return _CHANGED
    if end.cut:
        return _CUT
    return "" if end.finished else "the file's end is damaged"


def opened(path: Path) -> IO[bytes]:
    """A file that has something in it, open at its beginning.

    Raises UnreadableLogError if there is no such file, it may not be read, it is a pipe or a device, or it is empty.
    """
    try:
        stream = outside_file.opened(path)
    except OSError as error:
        if isinstance(error, IsADirectoryError):
            made = command("import", path, "-o", path.with_name(f"{path.name}_imported.mcap"))
            raise UnreadableLogError(f"{path} is a folder. If it is a bag: `{made}`") from error
        raise UnreadableLogError(f"{path}: {_reason(error)}. Check the name; recordings lie in ./logs.") from error
    if stream.seek(0, 2) == 0:
        stream.close()
        raise UnreadableLogError(
            f"{path} is empty (0 bytes): nothing was ever written to it. Record again, or name another file."
        )
    stream.seek(0)
    return stream


def foreign(path: Path) -> str:
    """Return why a file that is no MCAP file cannot be read, and what can."""
    made = command("import", path, "-o", path.with_name(f"{path.name.partition('.')[0]}_imported.mcap"))
    return (
        f"{path} is not an MCAP log: its first bytes are not an MCAP file's. `{made}` takes tables of text, NPZ, bags,"
        " and MCAP files that are compressed as a whole."
    )


def _reason(error: OSError) -> str:
    return {
        "FileNotFoundError": "no such file",
        "IsADirectoryError": "is a folder",
        "PermissionError": "no permission",
    }.get(type(error).__name__, error.strerror or str(error))


def _nothing(path: Path, log: Log, content: Content) -> str:
    """Return why a log of imutui has no samples, and what to do next."""
    if log.damage and not content.channels:
        return f"{path}: {log.damage} before any sample. Nothing can be read from it; record again."
    return f"{path} holds no samples: the recording ended before the first one. Record again."
