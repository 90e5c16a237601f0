"""Samples of bags, of ROS 1 and 2, and of MCAP files in any encoding, as columns for `importer`: rosbags reads them."""

import atexit
import contextlib
import json
import shutil
import struct
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import zstandard

from filters.errors import InputError
from imutui.logbook import atomic_file, layout
from imutui.logbook.foreign_log import RefusedLogError
from imutui.logbook.text_table import ROWS, Progress

if TYPE_CHECKING:
    from imutui.logbook.importer import Source

_NAMES = ("t", *(f"{vector}_{axis}" for vector in ("gyro", "accel") for axis in "xyz"))
_UNITS = {"t": "ns"} | {name: "rad/s" if name.startswith("gyro") else "m/s2" for name in _NAMES[1:]}
_IMU = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
_MCAP, _ZSTD = b"\x89MCAP0\r\n", b"\x28\xb5\x2f\xfd"


def opened(path: Path, topic: str | None) -> "Source":
    """Return the samples of a topic as columns: stamps in ns, rad/s, m/s².

    `topic`: None takes the only one; two with a comma between are the rates' and the forces'.
    Raises InputError if the bag cannot be read.
    Raises RefusedLogError if a topic has to be chosen.
    """
    bag = _bag_of(path)
    topics = bag.topics()
    if not topics:
        raise InputError("it has no topic with messages of sensor_msgs/Imu")
    wanted = [name.strip() for name in topic.split(",")] if topic else list(topics)
    unknown = [name for name in wanted if name not in topics]
    if unknown or (topic is None and len(topics) > 1):
        what = f"it has no samples on topic {unknown[0]}" if unknown else "it has several topics of samples"
        listed = ", ".join(f"{name} ({count:,})" for name, count in topics.items())
        raise RefusedLogError(f"{what}; choose one: {listed}", [("", ("--topic", name)) for name in _choices(topics)])
    return BagTable(bag, wanted, topics[wanted[0]])


def _choices(topics: Iterable[str]) -> list[str]:
    """Return what --topic may name: first a pair of rates and forces, as cameras have them."""
    gyros, accels = ([name for name in topics if word in name.lower()] for word in ("gyro", "acc"))
    return [*(f"{a},{b}" for a in gyros for b in accels), *topics]


class BagTable:
    """Messages of one topic, or of two that are joined at the instants of the rates."""

    states_units = False  # messages have the units of ROS, if their driver keeps to them

    def __init__(self, bag: "_Bag", topics: list[str], count: int) -> None:
        self.names: Sequence[str] = _NAMES
        self.units = dict(_UNITS)
        joined = f" with the forces of {topics[1]}" if len(topics) > 1 else ""
        self.notes = [f"samples of {topics[0]}{joined}, rad/s and m/s^2 as ROS has them"]
        self._bag, self._topics, self._count = bag, topics, count

    def pieces(self, wanted: list[int], progress: Progress = lambda share: None) -> Iterator[list[np.ndarray]]:
        """Yield rows of some columns, by their places, a bounded number at a time."""
        stamps, rows, done = list[int](), list[list[float]](), 0
        forces = _Forces(self._bag.messages(self._topics[1])) if len(self._topics) > 1 else None
        for stamp, row in self._bag.messages(self._topics[0]):
            stamps.append(stamp)
            rows.append(row)
            if len(rows) == ROWS:
                yield _columns(stamps, rows, forces, wanted)
                done += len(rows)
                progress(min(1.0, done / max(self._count, 1)))
                stamps, rows = [], []
        if rows:
            yield _columns(stamps, rows, forces, wanted)


class _Forces:
    """Forces of another topic, interpolated by straight lines."""

    def __init__(self, messages: Iterator[tuple[int, list[float]]]) -> None:
        found = [(stamp, row[3:]) for stamp, row in messages]
        self._stamps = np.array([stamp for stamp, _ in found], np.int64)
        self._rows = np.array([row for _, row in found], float).reshape(-1, 3)

    def at(self, stamps: np.ndarray) -> np.ndarray:
        """Return forces at stamps, NaN outside of them."""
        nan = float("nan")
        return np.column_stack([np.interp(stamps, self._stamps, self._rows[:, k], nan, nan) for k in range(3)])


def _columns(stamps: list[int], rows: list[list[float]], forces: _Forces | None, wanted: list[int]) -> list[np.ndarray]:
    t, values = np.array(stamps, np.int64), np.array(rows, float)
    if forces is not None:
        values[:, 3:] = forces.at(t)
    return [t if k == 0 else values[:, k - 1] for k in wanted]


def _row(message: Any) -> list[float]:
    w, f = message.angular_velocity, message.linear_acceleration
    return [w.x, w.y, w.z, f.x, f.y, f.z]


# ---------------------------------------------------------------------------------------------------------------- bags


class _Bag(Protocol):
    """A file or folder of messages."""

    def topics(self) -> dict[str, int]:
        """Return the topics of samples, with their number."""

    def messages(self, topic: str) -> Iterator[tuple[int, list[float]]]:
        """Yield stamp (ns) and six numbers of each sample."""


def _bag_of(path: Path) -> _Bag:
    if path.is_dir() and not (path / "metadata.yaml").exists() and not list(path.glob("*.mcap")):
        raise InputError("the folder holds no bag")
    if path.is_dir() and (files := sorted(path.glob("*.mcap"))):
        return _Mcap([_unpacked(file) for file in files])
    file = _unpacked(path)
    with contextlib.suppress(OSError):
        if file.is_file() and file.open("rb").read(len(_MCAP)) == _MCAP:
            return _Mcap([file])
    return _RosBag(file)


def _unpacked(path: Path) -> Path:
    """Return a file; one that was compressed as a whole is unpacked first, until the process ends."""
    if not path.is_file() or path.open("rb").read(4) != _ZSTD:
        return path
    folder = _UNPACKED.enter_context(tempfile.TemporaryDirectory(prefix="imutui-"))
    made = Path(folder) / path.stem
    with path.open("rb") as packed, atomic_file.part_of(made, overwrite=False) as part, part.open("r+b") as stream:
        shutil.copyfileobj(zstandard.ZstdDecompressor().stream_reader(packed), stream)
    return made


_UNPACKED = contextlib.ExitStack()
atexit.register(_UNPACKED.close)


class _RosBag:
    """A bag of ROS 1, or the folder of one of ROS 2."""

    def __init__(self, path: Path) -> None:
        self._path = path.parent if path.suffix == ".db3" else path  # a database is described in its folder

    @contextlib.contextmanager
    def _opened(self) -> Iterator[Any]:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        try:
            with AnyReader([self._path], default_typestore=get_typestore(Stores.LATEST)) as bag:
                yield bag
        except (InputError, OSError):
            raise
        except Exception as error:  # whichever of its readers meets foreign bytes first
            why = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"rosbags cannot read it: {why}") from error

    def topics(self) -> dict[str, int]:
        """Return the topics of samples, with their number."""
        found: dict[str, int] = {}
        with self._opened() as bag:
            for connection in bag.connections:
                if connection.msgtype in _IMU and connection.msgcount:
                    found[connection.topic] = found.get(connection.topic, 0) + connection.msgcount
        return found

    def messages(self, topic: str) -> Iterator[tuple[int, list[float]]]:
        """Yield stamp (ns) and six numbers of each sample."""
        with self._opened() as bag:
            connections = [connection for connection in bag.connections if connection.topic == topic]
            for connection, log_ns, data in bag.messages(connections):
                message = bag.deserialize(data, connection.msgtype)
                yield _ns(message.header.stamp.sec, message.header.stamp.nanosec) or log_ns, _row(message)


def _ns(seconds: int, rest: int) -> int:
    return int(seconds) * 1_000_000_000 + int(rest)


class _Mcap:
    """MCAP files of one recording, one after the other, in CDR, ROS 1 or JSON."""

    def __init__(self, paths: list[Path]) -> None:
        self._paths = paths

    def _records(self, topic: str | None) -> Iterator[tuple[Any, Any, Any]]:
        from mcap.exceptions import McapError
        from mcap.reader import make_reader

        try:
            for path in self._paths:
                with path.open("rb") as stream:
                    yield from make_reader(stream).iter_messages(topics=topic, log_time_order=False)
        except (McapError, ValueError, struct.error) as error:
            raise InputError(f"the file is damaged: {error}") from error

    def topics(self) -> dict[str, int]:
        """Return the topics of samples, with their number."""
        found: dict[str, int] = {}
        for schema, channel, message in self._records(None):
            if _decoder(schema, channel, message.data) is not None:
                found[channel.topic] = found.get(channel.topic, 0) + 1
        return found

    def messages(self, topic: str) -> Iterator[tuple[int, list[float]]]:
        """Yield stamp (ns) and six numbers of each sample."""
        for schema, channel, message in self._records(topic):
            if (decode := _decoder(schema, channel, message.data)) is not None:
                stamp, row = decode(message.data)
                yield stamp or message.log_time, row


_Decode = Callable[[bytes], tuple[int, list[float]]]


def _decoder(schema: Any, channel: Any, data: bytes) -> _Decode | None:
    """Return what makes a stamp and six numbers of a message, None if it is none of an IMU."""
    encoding = channel.message_encoding
    if encoding == "json":
        return _of_json if b"angular_velocity" in data and b"linear_acceleration" in data else None
    if schema is None or schema.name not in _IMU:
        return None
    return {"ros1": _of_ros1, "cdr": _of_cdr}.get(encoding)


def _of_json(data: bytes) -> tuple[int, list[float]]:
    found = json.loads(data)
    stamp = found.get("timestamp") or found.get("header", {}).get("stamp") or {}
    parts: dict[str, Any] = stamp if isinstance(stamp, dict) else {}
    values = [float(found[name][axis]) for name in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    return _ns(parts.get("sec", 0), parts.get("nsec", parts.get("nanosec", 0))), values


def _of_cdr(data: bytes) -> tuple[int, list[float]]:
    found = layout.decode(_IMU[0], data)
    stamp = _ns(found["header.stamp.sec"], found["header.stamp.nanosec"])
    return stamp, [*found["angular_velocity"].tolist(), *found["linear_acceleration"].tolist()]


def _of_ros1(data: bytes) -> tuple[int, list[float]]:
    message = _ros1_types().deserialize_ros1(data, _IMU[0])
    return _ns(message.header.stamp.sec, message.header.stamp.nanosec), _row(message)


@cache
def _ros1_types() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS1_NOETIC)
