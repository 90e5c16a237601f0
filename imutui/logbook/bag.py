"""Samples of bags, of ROS 1 and 2, and of MCAP files in any encoding, as a table.

Their messages become an MCAP file in CDR, which is read as another program's log is. rosbags
makes CDR of messages of ROS 1.
"""

import atexit
import bz2
import contextlib
import gzip
import io
import json
import re
import shutil
import sqlite3
import struct
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import IO, Any

import numpy as np
import zstandard
from mcap.records import Channel, Schema

from filters.errors import InputError
from imutui.logbook import atomic_file, foreign_log, layout, reader, schemas
from imutui.logbook.importing.table import Column, Rows, Table
from imutui.logbook.mcap_format import from_lz4
from imutui.logbook.mcap_stream import Batch
from imutui.logbook.reading import Reading
from imutui.logbook.samples import Samples, Waiting
from imutui.logbook.session_info import FOREIGN

_NAMES = ("t", *(f"{vector}_{axis}" for vector in ("gyro", "accel") for axis in "xyz"), "temp")
_UNITS = {"t": "ns", "temp": "degC"} | {n: "rad/s" if n.startswith("gyro") else "m/s2" for n in _NAMES[1:7]}
_ROWS = 2**15
_IMU, _TEMPERATURE = schemas.TYPES[schemas.IMU], schemas.TYPES[schemas.TEMPERATURE]
_KINDS = (".mcap", ".db3", ".bag")
_LARGEST = 2**28  # bytes of a chunk
_LARGEST_MESSAGE = 2**20
_MOST_PACKED = 100  # times that packing makes a recording smaller
_GZIP, _ZSTD = b"\x1f\x8b", b"\x28\xb5\x2f\xfd"
_FOLDERS = contextlib.ExitStack()  # of what is unpacked; removed when the process ends
atexit.register(_FOLDERS.close)
_Messages = Iterator[tuple[str, str, int, bytes]]
"""Topic, type, log time (ns) and CDR bytes of messages."""


def is_bag(path: Path) -> bool:
    """Return True for a bag of ROS, an MCAP file, packed or not, or a folder of them."""
    return path.is_dir() or _bare(path).suffix in _KINDS or bool(_magic(path))


def _bare(path: Path) -> Path:
    """Return the name that a file has when it is unpacked."""
    name = Path(path.name.lower())
    return Path(name.stem) if name.suffix in (".gz", ".zst", ".zstd") else name


def opened(path: Path, topic: str, stamps: str) -> Table:
    """Return the samples of a topic as columns: stamps in ns, rad/s, m/s², degC.

    `topic`: "" takes the only one; two with a comma between are the rates' and the forces'.
    `stamps`: "log" and "arrival" take the log times.
    Raises InputError if the bag cannot be read.
    Raises RefusedLogError if a topic, or the source of the stamps, has to be chosen.
    """
    topics = tuple(name.strip() for name in topic.split(",")) if topic else ()
    reading = Reading(topics=topics, stamps="log" if stamps in ("log", "arrival") else "")
    mcap, said = _unpacked(path), list[str]()
    is_mcap = _magic(mcap) == "mcap"
    found = foreign_log.survey(reader.records(mcap, reader.Log(mcap))) if is_mcap else foreign_log.Survey()
    if found is None:
        raise InputError("it is a log of imutui: replay and trace take it as it is")
    if not found.samples or not {*topics} <= {*found.samples}:
        mcap, said = _in_cdr(path)
        found = foreign_log.survey(reader.records(mcap, reader.Log(mcap))) or found
    if not found.samples:
        raise InputError("it has no topic with messages of sensor_msgs/Imu")
    plan = foreign_log.plan(found, reading, lambda: reader.records(mcap, reader.Log(mcap)), mends=True)
    names = _NAMES if plan.temperature else _NAMES[:-1]
    made = tuple(Column(name, _UNITS[name], is_sure=name == "t") for name in names)
    table = Table(
        path, made, lambda chosen: iter(()), [*said, *plan.assumed, "rad/s and m/s^2, specific force, as ROS has them"]
    )
    return Table(path, made, partial(_pieces, table, mcap, plan, reading), table.remarks)


def _pieces(
    table: Table, mcap: Path, plan: foreign_log.Plan, reading: Reading, wanted: Sequence[int]
) -> Iterator[Rows]:
    """Yield rows of some columns; see `Table`."""
    log, waiting, done = reader.Log(mcap), Waiting(), 0
    for columns in foreign_log.samples(lambda: reader.records(mcap, log), plan, reading, FOREIGN.axes()):
        waiting.take(columns, columns.pop("degc_stamp_ns"), columns.pop("degc"))
        if len(waiting) >= _ROWS:
            part = waiting.ready()
            done += len(part)
            yield min(1.0, done / max(plan.gyro.count, 1)), _columns(part, wanted)
    yield 1.0, _columns(waiting.rest(), wanted)
    if log.damage:
        table.remark(f"{log.damage}: the samples up to there were taken")


def _columns(part: Samples, wanted: Sequence[int]) -> list[np.ndarray]:
    six = np.where(part.valid[:, None], np.hstack([part.gyro, part.accel]), np.nan)
    columns = [part.stamp_ns, *six.T, part.degc]
    return [columns[k] for k in wanted]


# ---------------------------------------------------------------------------------------------------------------- files


def _files(path: Path) -> list[Path]:
    """Return the files of a recording, in the order of the numbers in their names."""
    files = [file for file in path.iterdir() if _bare(file).suffix in _KINDS] if path.is_dir() else [path]
    if not files:
        raise InputError("the folder holds no bag")
    return sorted(files, key=lambda file: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", file.name)])


def _folder() -> Path:
    made = Path(tempfile.mkdtemp(prefix="imutui-"))
    _FOLDERS.callback(shutil.rmtree, made, ignore_errors=True)
    return made


def _unpacked(path: Path) -> Path:
    """Return a file; one that was packed as a whole is unpacked first."""
    head = path.open("rb").read(4) if path.is_file() else b""
    if not head.startswith((_GZIP, _ZSTD)):
        return path
    made = _folder() / _bare(path).name
    with path.open("rb") as raw, atomic_file.part_of(made, overwrite=False) as part, part.open("r+b") as stream:
        packed: Any = (
            gzip.GzipFile(fileobj=raw) if head.startswith(_GZIP) else zstandard.ZstdDecompressor().stream_reader(raw)
        )
        largest = max(_LARGEST, _MOST_PACKED * path.stat().st_size)
        while block := packed.read(2**20):
            stream.write(block)
            if stream.tell() > largest:
                raise InputError(f"it unpacks to more than {largest:,} bytes, which no recording does. Unpack it first")
    return made


def _magic(path: Path) -> str:
    head = b""
    with contextlib.suppress(OSError):
        head = path.open("rb").read(16) if path.is_file() else b""
    kinds = {b"\x89MCAP": "mcap", b"SQLite": "sqlite", b"#ROSBAG": "bag"}
    return next((kind for magic, kind in kinds.items() if head.startswith(magic)), "")


@cache
def _in_cdr(path: Path) -> tuple[Path, list[str]]:
    """Return an MCAP file in CDR with the samples and temperatures of a recording, and what was left out, in words."""
    from mcap.writer import Writer

    made, channels, said = _folder() / "samples.mcap", dict[tuple[str, str], int](), list[str]()
    with made.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        for topic, kind, log_ns, data in _messages(path, said):
            if (topic, kind) not in channels:
                schema = writer.register_schema(kind, "ros2msg", b"")
                channels[topic, kind] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic, kind], log_ns, data, log_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return made, said


def _messages(path: Path, said: list[str]) -> _Messages:
    for file in map(_unpacked, _files(path)):
        kind = _magic(file)
        try:
            yield from {"mcap": _of_mcap, "sqlite": _of_sqlite}.get(kind, _of_bag)(file, said)
        except (InputError, OSError):
            raise
        except Exception as error:  # whatever foreign bytes make of three libraries
            why = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"{file.name} cannot be read: {why}") from error


def _of_sqlite(path: Path, said: list[str]) -> _Messages:
    """Messages of a database of ROS 2."""
    with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as base:
        topics = {key: (name, kind) for key, name, kind in base.execute("SELECT id, name, type FROM topics")}
        kept = [key for key, (_, kind) in topics.items() if kind in (_IMU, _TEMPERATURE)]
        marks = ",".join("?" * len(kept))
        rows = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) ORDER BY timestamp, id"
        for key, log_ns, data in base.execute(rows, kept):
            yield *topics[key], log_ns, _inflated(data)


def _inflated(data: bytes) -> bytes:
    if not data.startswith(_ZSTD):
        return data
    found: bytes = zstandard.ZstdDecompressor().stream_reader(data).read(_LARGEST_MESSAGE + 1)
    if len(found) > _LARGEST_MESSAGE:
        raise InputError(f"a message unpacks to more than {_LARGEST_MESSAGE:,} bytes")
    return found


def _of_bag(path: Path, said: list[str]) -> _Messages:
    """Messages of a bag of ROS 1 in file order, up to where it is cut: its index is not needed."""
    channels: dict[bytes, tuple[str, str]] = {}
    with path.open("rb") as stream:
        if not stream.readline().startswith(b"#ROSBAG V2"):
            raise InputError("it is no bag, or one of an older version than 2.0")
        for head, data in _bag_records(stream, said):
            chunk = io.BytesIO(_chunk(head[b"compression"], data) if head[b"op"] == _CHUNK else b"")
            for inner, content in _bag_records(chunk, said):
                if inner[b"op"] == _CONNECTION:
                    kind = _fields(content)[b"type"].decode().replace("/", "/msg/", 1)
                    channels[inner[b"conn"]] = inner[b"topic"].decode(), kind
                elif inner[b"op"] == _MESSAGE and channels[inner[b"conn"]][1] in (_IMU, _TEMPERATURE):
                    seconds, rest = struct.unpack("<II", inner[b"time"])
                    topic, kind = channels[inner[b"conn"]]
                    yield topic, kind, seconds * 1_000_000_000 + rest, _ros1_in_cdr(content, kind)


_MESSAGE, _CHUNK, _CONNECTION = b"\2", b"\5", b"\7"


def _bag_records(stream: IO[bytes], said: list[str]) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    """Yield head and data of records; of a chunk that is cut, the data that are there."""
    while head := _block(stream):
        fields, (size, data) = _fields(head[1]), _block(stream) or (1, b"")
        is_cut = len(head[1]) < head[0] or len(data) < size
        if is_cut:
            said[:] = ["the bag is cut: its messages up to there were taken"]
        if not is_cut or fields.get(b"op") == _CHUNK:
            yield fields, data


def _block(stream: IO[bytes]) -> tuple[int, bytes] | None:
    """Return the size that is stated, and the bytes that are there; None at the end."""
    size = int.from_bytes(length, "little") if len(length := stream.read(4)) == 4 else 0
    return (size, stream.read(size)) if length else None


def _fields(head: bytes) -> dict[bytes, bytes]:
    stream = io.BytesIO(head)
    found = [field.partition(b"=") for _, field in iter(lambda: _block(stream), None)]
    return {name: value for name, _, value in found}


def _chunk(compression: bytes, data: bytes) -> bytes:
    if compression == b"none":
        return data
    return bz2.BZ2Decompressor().decompress(data, _LARGEST) if compression == b"bz2" else from_lz4(data, _LARGEST)


def _ros1_in_cdr(data: bytes, kind: str) -> bytes:
    return bytes(_ros_types().ros1_to_cdr(data, kind))


@cache
def _ros_types() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.LATEST)


def _of_mcap(path: Path, said: list[str]) -> _Messages:
    """Messages of an MCAP file in CDR, packed or not, in ROS 1, or in JSON."""
    types, channels, log = dict[int, str](), dict[int, Channel](), reader.Log(path)
    for record in reader.records(path, log):
        match record:
            case Schema():
                types[record.id] = record.name if "/msg/" in record.name else record.name.replace("/", "/msg/", 1)
            case Channel():
                channels[record.id] = record
            case Batch():
                for message in map(record.message, range(len(record.table))):
                    channel = channels[message.channel_id]
                    kind = types.get(channel.schema_id, "")
                    if channel.message_encoding == "json":
                        kind = _IMU if b"angular_velocity" in message.data else ""
                    if kind in (_IMU, _TEMPERATURE) and channel.message_encoding in _IN_CDR:
                        data = _IN_CDR[channel.message_encoding](message.data, kind)
                        yield channel.topic, kind, message.log_time, data
    said += [f"{log.damage}: the messages up to there were taken"] if log.damage else []


def _json_in_cdr(data: bytes, kind: str) -> bytes:
    found = json.loads(data)
    stamp = found.get("timestamp") or found.get("header", {}).get("stamp") or {}
    parts: dict[str, Any] = stamp if isinstance(stamp, dict) else {}
    values: dict[str, Any] = {}
    for name in ("angular_velocity", "linear_acceleration"):
        vector = found[name]
        three = [vector[axis] for axis in "xyz"] if isinstance(vector, dict) else vector
        values[name] = np.array([np.nan if value is None else float(value) for value in three])
    time = {"sec": parts.get("sec", 0), "nanosec": parts.get("nsec", parts.get("nanosec", 0))}
    return layout.encode(kind, values | {"header": {"stamp": time}})


_IN_CDR: dict[str, Callable[[bytes, str], bytes]] = {
    "cdr": lambda data, kind: _inflated(data), "ros1": _ros1_in_cdr, "json": _json_in_cdr,
}  # fmt: skip
"""Makes CDR of a message's bytes and its type, by its encoding."""
