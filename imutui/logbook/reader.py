"""Reading a log, finished or not: everything up to the last flush, into arrays.

Records are read in file order, so that a file without footer (a killed recorder, a pulled plug) needs no other path.
"""

import contextlib
import hashlib
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.records import Attachment, Channel, Chunk, Footer, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from rosbags.serde import SerdeError

from imutui.logbook import schemas
from imutui.logbook.session import METADATA, SessionInfo

_LIMIT = 256 * 2**20
_MAGIC = b"\x89MCAP0\r\n"


class UnreadableLogError(Exception):
    """The file is no log that imutui can use; the message says what, where, and what to do next."""


@dataclass(frozen=True, slots=True)
class Event:
    """A mark of the operator's or an event of the program's."""

    stamp_ns: int
    name: str
    text: str


@dataclass(slots=True)
class Log:
    """Content of a log.

    Attributes
    ----------
    path : Path
        Where it lies.
    info : SessionInfo
        Its metadata; defaults where it has none.
    own : bool
        Whether imutui wrote it.
    stamp_ns : np.ndarray
        Sampling instants of the output samples, UTC, ns, int64, shape (N,).
    gyro, accel : np.ndarray
        rad/s and m/s² (specific force), body axes, shape (N, 3).
    temperature_degc : np.ndarray
        All temperature messages, shape (M,).
    raw : list of RawPacket
        Packets as received; read on request only.
    reference : str or None
        Kind of the last /table/reference.
    events : list of Event
        Marks and events.
    diagnostics : dict
        Values of the last /diagnostics.
    attachments : dict
        Name to bytes.
    finished : bool
        Whether the file has its footer.
    damage : str
        What is wrong with the file, if anything.
    """

    path: Path
    info: SessionInfo = field(default_factory=SessionInfo)
    own: bool = False
    stamp_ns: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    gyro: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    accel: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    temperature_degc: np.ndarray = field(default_factory=lambda: np.empty(0))
    raw: list[schemas.RawPacket] = field(default_factory=list)
    reference: str | None = None
    events: list[Event] = field(default_factory=list)
    diagnostics: dict[str, str] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    finished: bool = False
    damage: str = ""

    def seconds(self) -> np.ndarray:
        """Time of the samples since the first, s, shape (N,)."""
        return seconds_since(self.stamp_ns, int(self.stamp_ns[0])) if self.stamp_ns.size else np.empty(0)


def seconds_since(stamp_ns: Any, first_ns: int) -> Any:
    """Time since the first sample, s; the one rule for live and replay."""
    return (stamp_ns - first_ns) / 1e9


def read(path: Path, *, raw: bool = False) -> Log:
    """Read a log.

    Parameters
    ----------
    path : Path
        MCAP file, finished or not.
    raw : bool
        Read /imu/raw too.

    Returns
    -------
    Log
        Up to the last record that could be read; `finished` and `damage` say whether that is all.

    Raises
    ------
    UnreadableLogError
        If there is no such file, it is no MCAP file, or it holds no IMU samples.
    """
    log = Log(path)
    content = _Content(log, raw)
    for record in _records(path, log):
        try:
            content.take(record)
        except (SerdeError, struct.error, IndexError) as error:
            log.damage = f"a message cannot be decoded ({error})"
            break
    content.close()
    log.finished = log.finished and not log.damage
    if not log.stamp_ns.size:
        raise UnreadableLogError(_nothing(path, log, content))
    _check_samples(log)
    return log


def _check_samples(log: Log) -> None:
    finite = np.isfinite(log.gyro).all(axis=1) & np.isfinite(log.accel).all(axis=1)
    if not finite.all():
        raise UnreadableLogError(
            f"{log.path}: sample {int(np.argmin(finite))} (first is 0) is not a number. Remove such samples in"
            " the program that wrote the file."
        )
    steps = np.diff(log.stamp_ns)
    if steps.size and not (steps > 0).all():
        raise UnreadableLogError(
            f"{log.path}: time does not increase at sample {int(np.argmin(steps > 0)) + 1} (first is 0). Sort the"
            " samples by time and drop those that stand twice."
        )


def sha256(path: Path) -> str:
    """Hash of a file's bytes."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


class _Content:
    """Collects records into a `Log`."""

    def __init__(self, log: Log, raw: bool) -> None:
        self.log = log
        self.raw = raw
        self.schemas: dict[int, str] = {}
        self.channels: dict[int, tuple[str, str, str]] = {}
        self.stamps: list[int] = []
        self.values: list[tuple[float, ...]] = []
        self.temperatures: list[float] = []
        self.imu_channel: int | None = None

    def take(self, record: McapRecord) -> None:
        """One record in file order."""
        match record:
            case Message():
                self._message(record)
            case Schema():
                self.schemas[record.id] = record.name
            case Channel():
                typename = self.schemas.get(record.schema_id, "")
                self.channels[record.id] = (record.topic, typename, record.message_encoding)
                # the samples are ours by topic; in somebody else's file the first Imu channel is taken
                if typename == schemas.TYPES[schemas.IMU] and record.message_encoding == "cdr":
                    mine = record.topic == schemas.IMU
                    self.imu_channel = record.id if mine or self.imu_channel is None else self.imu_channel
            case Metadata() if record.name == METADATA:
                self.log.own = True
                with_strings = {str(k): str(v) for k, v in record.metadata.items()}
                try:
                    self.log.info = SessionInfo.from_strings(with_strings)
                    self.log.info.axes(), self.log.info.settings()
                except ValueError as error:
                    raise UnreadableLogError(f"{self.log.path}: {error}. The metadata was changed by hand?") from error
            case Attachment():
                self.log.attachments[record.name] = record.data
            case Footer():
                self.log.finished = True

    def _message(self, record: Message) -> None:
        topic, typename, encoding = self.channels.get(record.channel_id, ("", "", ""))
        if record.channel_id == self.imu_channel:
            self._sample(record)
        elif encoding != "cdr" or not self.log.own:
            return
        elif topic == schemas.RAW:
            if self.raw:
                self.log.raw.append(schemas.decode_raw(record.data))
        elif topic == schemas.TEMPERATURE:
            self.temperatures.append(schemas.decode(typename, record.data).temperature)
        elif topic == schemas.REFERENCE:
            self.log.reference = schemas.decode(typename, record.data).kind
        elif topic == schemas.DIAGNOSTICS:
            status = schemas.decode(typename, record.data).status[0]
            self.log.diagnostics = {pair.key: pair.value for pair in status.values}
        elif topic == schemas.EVENTS:
            m = schemas.decode(typename, record.data)
            self.log.events.append(Event(m.stamp.sec * 1_000_000_000 + m.stamp.nanosec, m.name, m.msg))

    def _sample(self, record: Message) -> None:
        m = schemas.decode(schemas.TYPES[schemas.IMU], record.data)
        stamp = schemas.stamp_ns(m.header) or record.publish_time
        w, f = m.angular_velocity, m.linear_acceleration
        self.stamps.append(stamp)
        self.values.append((w.x, w.y, w.z, f.x, f.y, f.z))

    def close(self) -> None:
        """Make arrays of what was collected."""
        self.log.stamp_ns = np.array(self.stamps, np.int64)
        values = np.array(self.values, float).reshape(-1, 6)
        self.log.gyro, self.log.accel = values[:, :3], values[:, 3:]
        self.log.temperature_degc = np.array(self.temperatures, float)


def _records(path: Path, log: Log) -> Iterator[McapRecord]:
    """Records in file order up to the footer, or to the last one that is whole; says in `log.damage` what ended it."""
    try:
        stream = path.open("rb")
    except OSError as error:
        raise UnreadableLogError(f"{path}: {_reason(error)}. Check the name; recordings lie in ./logs.") from error
    with contextlib.closing(stream):
        if stream.seek(0, 2) == 0:
            raise UnreadableLogError(
                f"{path} is empty (0 bytes): nothing was ever written to it. Record again, or name another file."
            )
        stream.seek(0)
        if not _MAGIC.startswith(stream.read(len(_MAGIC))):
            raise UnreadableLogError(_foreign(path))
        stream.seek(0)
        try:
            for record in StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=_LIMIT).records:
                if isinstance(record, Chunk):
                    yield from breakup_chunk(record, validate_crc=True)
                else:
                    yield record
        except InvalidMagic:
            log.damage = "the file's end is damaged"
        except (EndOfFile, struct.error):
            log.damage = "the file ends in the middle: the recorder was killed, or the file was cut"
        except CRCValidationError:
            log.damage = "a checksum is wrong: bytes were changed after recording"
        except (McapError, ValueError, OSError) as error:
            log.damage = f"a record cannot be read ({error})"
        except Exception as error:  # noqa: BLE001 - decompression and parsing of foreign bytes raise many kinds
            log.damage = f"a record cannot be read ({type(error).__name__})"


def _foreign(path: Path) -> str:
    return (
        f"{path} is not an MCAP log: it starts with other bytes. imutui replays its own logs and other MCAP files with"
        " sensor_msgs/msg/Imu; `imutui import` makes a log of NPZ and CSV recordings."
    )


def _reason(error: OSError) -> str:
    return {
        "FileNotFoundError": "no such file",
        "IsADirectoryError": "is a folder",
        "PermissionError": "no permission",
    }.get(type(error).__name__, error.strerror or str(error))


def _nothing(path: Path, log: Log, content: _Content) -> str:
    if log.damage and not content.channels:
        return f"{path}: {log.damage} before any sample. Nothing can be read from it; record again."
    if log.own:
        return f"{path} holds no samples: the recording ended before the first one. Record again."
    topics = ", ".join(topic for topic, _, _ in content.channels.values()) or "none"
    return (
        f"{path} is an MCAP file without IMU samples: no channel of type sensor_msgs/msg/Imu in CDR (topics: {topics})."
        " Name a file that has one, or import the recording with `imutui import`."
    )
