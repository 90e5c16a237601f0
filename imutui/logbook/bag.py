"""Samples of bags, of ROS 1 and 2, and of MCAP files in any encoding, as a table.

Their messages become an MCAP file in CDR, which is read as another program's log is. rosbags reads bags of ROS 1.
"""

import atexit
import contextlib
import gzip
import json
import re
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.records import Channel, Schema

from filters.errors import InputError
from imutui.logbook import atomic_file, foreign_log, layout, reader, schemas
from imutui.logbook.importing.table import Column, Rows, Table
from imutui.logbook.mcap_stream import Batch
from imutui.logbook.reading import Reading
from imutui.logbook.session_info import FOREIGN

_NAMES = ("t", *(f"{vector}_{axis}" for vector in ("gyro", "accel") for axis in "xyz"), "temp")
_UNITS = {"t": "ns", "temp": "degC"} | {n: "rad/s" if n.startswith("gyro") else "m/s2" for n in _NAMES[1:7]}
_ROWS = 2**15
_IMU, _TEMPERATURE = schemas.TYPES[schemas.IMU], schemas.TYPES[schemas.TEMPERATURE]
_KINDS = (".mcap", ".db3", ".bag")
_GZIP, _ZSTD = b"\x1f\x8b", b"\x28\xb5\x2f\xfd"
_FOLDERS = contextlib.ExitStack()  # of what is unpacked; removed when the process ends
atexit.register(_FOLDERS.close)
_Messages = Iterator[tuple[str, str, int, bytes]]
"""Topic, type, log time (ns) and CDR bytes of messages."""


def is_bag(path: Path) -> bool:
    """Return True for a bag of ROS, an MCAP file, packed or not, or a folder of them."""
    return path.is_dir() or _bare(path).suffix in _KINDS


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
    mcap = _unpacked(path)
    is_mcap = _magic(mcap) == "mcap"
    found = foreign_log.survey(reader.records(mcap, reader.Log(mcap))) if is_mcap else foreign_log.Survey()
    if found is None:
        raise InputError("it is a log of imutui: replay and trace take it as it is")
    if not found.samples or not {*topics} <= {*found.samples}:
        mcap = _in_cdr(path)
        found = foreign_log.survey(reader.records(mcap, reader.Log(mcap))) or found
    if not found.samples:
        raise InputError("it has no topic with messages of sensor_msgs/Imu")
    plan = foreign_log.plan(found, reading, lambda: reader.records(mcap, reader.Log(mcap)), mends=True)
    names = _NAMES if plan.temperature else _NAMES[:-1]
    made = tuple(Column(name, _UNITS[name], is_sure=name == "t") for name in names)
    table = Table(path, made, lambda chosen: iter(()), [*plan.assumed, "rad/s and m/s^2 as ROS has them"])
    return Table(path, made, partial(_pieces, table, mcap, plan, reading), table.remarks)


def _pieces(
    table: Table, mcap: Path, plan: foreign_log.Plan, reading: Reading, wanted: Sequence[int]
) -> Iterator[Rows]:
    """Yield rows of some columns; see `Table`."""
    log, done = reader.Log(mcap), 0
    for whole in foreign_log.samples(lambda: reader.records(mcap, log), plan, reading, FOREIGN.axes()):
        for part in foreign_log.split(whole, _ROWS):
            if not (count := part["stamp_ns"].size):
                continue
            temperatures = np.full(count, np.nan)
            at = np.searchsorted(part["stamp_ns"], part["degc_stamp_ns"])
            temperatures[np.minimum(at, count - 1)] = part["degc"]
            six = np.hstack([part["gyro"], part["accel"]])
            six[~part["valid"]] = np.nan
            columns = [part["stamp_ns"], *six.T, temperatures]
            done += count
            yield min(1.0, done / max(plan.gyro.count, 1)), [columns[k] for k in wanted]
    if log.damage:
        table.remark(f"{log.damage}: the samples up to there were taken")


# ---------------------------------------------------------------------------------------------------------------- files


def _files(path: Path) -> list[Path]:
    """Return the files of a recording, in the order of the numbers in their names."""
    files = [file for file in path.iterdir() if _bare(file).suffix in _KINDS] if path.is_dir() else [path]
    if not files:
        raise InputError("the folder holds no bag")
    return sorted(files, key=lambda file: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", file.name)])


def _folder() -> Path:
    return Path(_FOLDERS.enter_context(tempfile.TemporaryDirectory(prefix="imutui-")))


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
        shutil.copyfileobj(packed, stream)
    return made


def _magic(path: Path) -> str:
    head = path.open("rb").read(16) if path.is_file() else b""
    kinds = {b"\x89MCAP": "mcap", b"SQLite": "sqlite", b"#ROSBAG": "bag"}
    return next((kind for magic, kind in kinds.items() if head.startswith(magic)), "")


@cache
def _in_cdr(path: Path) -> Path:
    """Return an MCAP file in CDR with the samples and temperatures of a recording."""
    from mcap.writer import Writer

    made, channels = _folder() / "samples.mcap", dict[tuple[str, str], int]()
    with made.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        for topic, kind, log_ns, data in _messages(path):
            if (topic, kind) not in channels:
                schema = writer.register_schema(kind, "ros2msg", b"")
                channels[topic, kind] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic, kind], log_ns, data, log_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return made


def _messages(path: Path) -> _Messages:
    for file in map(_unpacked, _files(path)):
        kind = _magic(file)
        try:
            yield from {"mcap": _of_mcap, "sqlite": _of_sqlite}.get(kind, _of_bag)(file)
        except (InputError, OSError):
            raise
        except Exception as error:  # whatever foreign bytes make of three libraries
            why = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"{file.name} cannot be read: {why}") from error


def _of_sqlite(path: Path) -> _Messages:
    """Messages of a database of ROS 2."""
    with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as base:
        topics = {key: (name, kind) for key, name, kind in base.execute("SELECT id, name, type FROM topics")}
        kept = [key for key, (_, kind) in topics.items() if kind in (_IMU, _TEMPERATURE)]
        marks = ",".join("?" * len(kept))
        rows = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) ORDER BY timestamp, id"
        for key, log_ns, data in base.execute(rows, kept):
            yield *topics[key], log_ns, _inflated(data)


def _inflated(data: bytes) -> bytes:
    return zstandard.ZstdDecompressor().decompressobj().decompress(data) if data.startswith(_ZSTD) else data


def _of_bag(path: Path) -> _Messages:
    """Messages of a bag of ROS 1; of one without an index, as a crash leaves it, nothing."""
    from rosbags.rosbag1 import Reader

    with Reader(path) as bag:
        connections = [c for c in bag.connections if c.msgtype in (_IMU, _TEMPERATURE)]
        for connection, log_ns, data in bag.messages(connections):
            yield connection.topic, connection.msgtype, log_ns, _ros1_in_cdr(data, connection.msgtype)


def _ros1_in_cdr(data: bytes, kind: str) -> bytes:
    return bytes(_ros_types().ros1_to_cdr(data, kind))


@cache
def _ros_types() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.LATEST)


def _of_mcap(path: Path) -> _Messages:
    """Messages of an MCAP file in CDR, packed or not, in ROS 1, or in JSON."""
    types, channels = dict[int, str](), dict[int, Channel]()
    for record in reader.records(path, reader.Log(path)):
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


def _json_in_cdr(data: bytes, kind: str) -> bytes:
    found = json.loads(data)
    stamp = found.get("timestamp") or found.get("header", {}).get("stamp") or {}
    parts: dict[str, Any] = stamp if isinstance(stamp, dict) else {}
    values: dict[str, Any] = {
        name: np.array([float(found[name][axis]) for axis in "xyz"])
        for name in ("angular_velocity", "linear_acceleration")
    }
    time = {"sec": parts.get("sec", 0), "nanosec": parts.get("nsec", parts.get("nanosec", 0))}
    return layout.encode(kind, values | {"header": {"stamp": time}})


_IN_CDR: dict[str, Callable[[bytes, str], bytes]] = {
    "cdr": lambda data, kind: _inflated(data), "ros1": _ros1_in_cdr, "json": _json_in_cdr,
}  # fmt: skip
"""Makes CDR of a message's bytes and its type, by its encoding."""
