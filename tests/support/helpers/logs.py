"""Logs with known content, written as the recorder does, and in every layout that others use."""

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from filters.imu import Samples
from helpers import ros_messages
from imutui.logbook import SessionInfo, schemas
from imutui.logbook.mcap_format import HEAD, MAGIC, records
from imutui.logbook.reference_file import ReferenceFile
from imutui.logbook.session_info import METADATA
from imutui.logbook.writer import LogWriter

START = 1_795_257_000_000_000_000


def of_samples(
    path: Path,
    samples: Samples,
    info: SessionInfo,
    reference: ReferenceFile | None = None,
    marks: Iterable[tuple[float, str]] = (),
    invalid: Collection[int] = (),
    states: Iterable[tuple[float, np.ndarray, np.ndarray]] = (),
) -> Path:
    """A finished log of samples (body axes, SI): with the file of its motion, marks (s, text), and some no readings.

    `states`: what a table's controller said: when (s), angles (deg) and rates (deg/s).
    """
    log = LogWriter(path, info, "x = 1\n", START, overwrite=True)
    if reference is not None:
        log.attach(reference.name, reference.media_type, reference.content, START)
    still = np.zeros(3)
    log.encoded(
        schemas.REFERENCE, schemas.encode_table_references(START, info.reference, still, still)[0], START, START
    )
    rows = zip(samples.t.tolist(), samples.gyro, samples.accel, strict=True)
    for k, (t, gyro, accel) in enumerate(rows):
        stamp = START + round(t * 1e9)
        log.imu(stamp, stamp, gyro, accel, valid=k not in invalid)
    for t, text in marks:
        stamp = START + round(t * 1e9)
        log.encoded(schemas.EVENTS, schemas.encode_event(stamp, "mark", text), stamp, stamp)
    for t, angles, rates in states:
        stamp = START + round(t * 1e9)
        told = schemas.encode_table_state(stamp, 2_000_000, angles, rates, "position", "")
        log.encoded(schemas.STATE, told, stamp, stamp)
    log.finish({}, START)
    return path


LAYOUTS: dict[str, dict[str, Any]] = {
    "zstd": {"compression": CompressionType.ZSTD},
    "lz4": {"compression": CompressionType.LZ4},
    "uncompressed": {"compression": CompressionType.NONE},
    "small chunks": {"chunk_size": 700},
    "no chunks": {"use_chunking": False},
    "no checksums": {"enable_crcs": False},
    "no index": {"index_types": 0, "use_statistics": False, "use_summary_offsets": False},
    "schemas in the chunks only": {"repeat_channels": False, "repeat_schemas": False},
    "short frame_id": {"frame": "a"},
    "long frame_id": {"frame": "a frame with quite a long name"},
    "no frame_id": {"frame": ""},
    "frame_id that is no ASCII": {"frame": "Gehäuse"},
}


def recorded(path: Path, seconds: int = 3, rate: int = 20) -> Path:
    """A log as the recorder writes it, with an estimate, an event and an invalid sample in each second."""
    log = LogWriter(path, SessionInfo(rate_hz=rate, kind="simulated"), "", START)
    rng = np.random.default_rng(2)
    for k in range(seconds * rate):
        stamp = START + k * 1_000_000_000 // rate
        counts = tuple(rng.integers(-32768, 32768, 6).tolist())
        log.encoded(
            schemas.RAW,
            ros_messages.packet(k, k * 7, counts, int(rng.integers(65536)), 65535 - k, k % 2, k % 8),
            stamp + 9,
            stamp,
        )
        log.imu(stamp + 9, stamp, rng.normal(size=3), rng.normal(size=3), valid=k % rate != 5)
        log.encoded(schemas.TEMPERATURE, schemas.encode_temperatures(stamp, rng.normal())[0], stamp, stamp)
        if k % rate == rate - 1:
            angles, rates = np.array([k, k + 0.5, -k]), np.full(3, k)
            log.encoded(
                schemas.REFERENCE, schemas.encode_table_references(stamp, f"kind {k}", angles, rates)[0], stamp, stamp
            )
            log.encoded(
                schemas.DIAGNOSTICS, schemas.encode_diagnostics(stamp, 0, "", {"packets": str(k)}), stamp, stamp
            )
            log.encoded(schemas.EVENTS, schemas.encode_event(stamp, "mark", f"mark {k}"), stamp, stamp)
            log.flush()
    log.finish({}, START)
    return path


def with_frame(data: bytes, typename: str, frame: str) -> bytes:
    """The same stamped message with another frame_id."""
    m = ros_messages.decode(typename, data)
    m.header.frame_id = frame
    return bytes(ros_messages.typestore().serialize_cdr(m, typename))


def rewritten(source: Path, path: Path, frame: str | None = None, **options: Any) -> Path:
    """The same records written anew: other chunks, another compression, another frame_id."""
    with source.open("rb") as old, path.open("wb") as new:
        writer = Writer(new, enable_data_crcs=True, **options)
        writer.start(profile="ros2", library="test")
        writer.add_metadata(METADATA, SessionInfo(rate_hz=20, kind="simulated").strings())
        channels: dict[int, int] = {}
        topics: dict[int, str] = {}
        for record in StreamReader(old).records:
            if isinstance(record, Channel) and record.id not in channels:
                typename = schemas.TYPES[record.topic]
                schema = writer.register_schema(typename, "ros2msg", schemas.definition(typename).encode())
                channels[record.id] = writer.register_channel(record.topic, "cdr", schema)
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                data = record.data
                if frame is not None and topics[record.channel_id] in (schemas.IMU, schemas.TEMPERATURE):
                    data = with_frame(data, schemas.TYPES[topics[record.channel_id]], frame)
                writer.add_message(channels[record.channel_id], record.log_time, data, record.publish_time)
            elif isinstance(record, Attachment):
                writer.add_attachment(0, 0, record.name, record.media_type, record.data)
        writer.finish()
    return path


def foreign(
    path: Path,
    typename: str = "sensor_msgs/msg/Imu",
    *,
    encoding: str = "cdr",
    cut: int = 0,
    spoil: float = 0.3,
    step_ns: int = 50_000_000,
) -> Path:
    """Another program's MCAP: sixty Imu messages of a level unit, the thirtieth spoilt or cut as asked."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="another program")
        schema = writer.register_schema(typename, "ros2msg", schemas.definition("sensor_msgs/msg/Imu").encode())
        channel = writer.register_channel("/sensor/imu", encoding, schema)
        for k in range(60):
            stamp = START + k * step_ns
            gyro = np.full(3, spoil if k == 30 else 0.01 * k)
            data = schemas.encode_imus(stamp, gyro, np.array([0.0, 0.1, -9.78]))[0]
            writer.add_message(channel, stamp, data[: len(data) - cut] if k == 30 else data, stamp)
        writer.finish()
    return path


def chunks(content: bytes) -> list[tuple[int, int]]:
    """Where the chunk records of a whole file lie: offset, and length with the record's head."""
    found = records(content[len(MAGIC) :])
    return [(at + len(MAGIC) - HEAD.size, HEAD.size + length) for opcode, at, length in found if opcode == Opcode.CHUNK]
