"""Samples of bags, of ROS 1 and 2, and of MCAP files in any encoding, as columns for `importer`: rosbags reads them."""

import json
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zstandard

from filters.errors import InputError
from imutui.logbook.foreign_log import RefusedLogError
from imutui.logbook.text_table import ROWS, Progress

if TYPE_CHECKING:
    from imutui.logbook.importer import Source

_NAMES = ("t", *(f"{vector}_{axis}" for vector in ("gyro", "accel") for axis in "xyz"))
_UNITS = {"t": "ns"} | {name: "rad/s" if name.startswith("gyro") else "m/s2" for name in _NAMES[1:]}
_IMU = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
_MCAP = b"\x89MCAP0\r\n"


def opened(path: Path, topic: str | None) -> "Source":
    """Return the samples of a topic as columns: stamps in ns, rad/s, m/s².

    `topic`: None takes the only one; two with a comma between are the rates' and the forces'.
    Raises InputError if the bag cannot be read.
    Raises RefusedLogError if a topic has to be chosen.
    """
    path = _unpacked(path)
    is_mcap = path.is_file() and path.open("rb").read(len(_MCAP)) == _MCAP
    topics = _mcap_topics(path) if is_mcap else _bag_topics(path)
    if not topics:
        raise InputError("it has no topic with messages of sensor_msgs/Imu")
    wanted = [name.strip() for name in topic.split(",")] if topic else list(topics)
    unknown = [name for name in wanted if name not in topics]
    if unknown or (topic is None and len(topics) > 1):
        what = f"it has no samples on topic {unknown[0]}" if unknown else "it has several topics of samples"
        listed = ", ".join(f"{name} ({count:,})" for name, count in topics.items())
        raise RefusedLogError(f"{what}; choose one: {listed}", [("", ("--topic", name)) for name in topics])
    return BagTable(path, wanted, topics, is_mcap=is_mcap)


class BagTable:
    """Messages of one topic, or of two that are joined at the instants of the rates."""

    def __init__(self, path: Path, topics: list[str], counts: dict[str, int], *, is_mcap: bool) -> None:
        self.names: Sequence[str] = _NAMES
        self.units = dict.fromkeys((), "") | _UNITS
        self.notes = [f"samples of {topics[0]}" + (f" with the forces of {topics[1]}" if len(topics) > 1 else "")]
        self._path, self._topics, self._is_mcap = path, topics, is_mcap
        self._count = counts[topics[0]]

    def pieces(self, wanted: list[int], progress: Progress = lambda share: None) -> Iterator[list[np.ndarray]]:
        """Yield rows of some columns, by their places, a bounded number at a time."""
        messages = _mcap_messages if self._is_mcap else _bag_messages
        stamps, rows, done = list[int](), list[list[float]](), 0
        forces = _Forces(messages(self._path, self._topics[1])) if len(self._topics) > 1 else None
        for stamp, row in messages(self._path, self._topics[0]):
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


def _unpacked(path: Path) -> Path:
    """Return a file that was compressed as a whole, unpacked into a temporary folder."""
    if not path.is_file() or path.open("rb").read(4) != b"\x28\xb5\x2f\xfd":
        return path
    folder = tempfile.TemporaryDirectory(prefix="imutui-")
    _KEPT.append(folder)
    made = Path(folder.name) / path.stem
    with path.open("rb") as packed, made.open("wb") as stream:
        shutil.copyfileobj(zstandard.ZstdDecompressor().stream_reader(packed), stream)
    return made


_KEPT: list[tempfile.TemporaryDirectory[str]] = []  # until the process ends

# ---------------------------------------------------------------------------------------------------------------- bags


def _reader(path: Path) -> Any:
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    try:
        # a database without its folder's description is read with it made up
        return AnyReader(
            [path.parent if path.suffix == ".db3" else path], default_typestore=get_typestore(Stores.LATEST)
        )
    except AnyReaderError as error:
        raise InputError(f"rosbags cannot read it: {error}") from error


def _bag_topics(path: Path) -> dict[str, int]:
    found: dict[str, int] = {}
    with _entered(path) as bag:
        for connection in bag.connections:
            if connection.msgtype in _IMU and connection.msgcount:
                found[connection.topic] = found.get(connection.topic, 0) + connection.msgcount
    return found


def _entered(path: Path) -> Any:
    import contextlib

    @contextlib.contextmanager
    def opened_bag() -> Iterator[Any]:
        try:
            with _reader(path) as bag:
                yield bag
        except InputError:
            raise
        except OSError:
            raise
        except Exception as error:  # whichever of its readers meets foreign bytes first
            why = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"rosbags cannot read it: {why}") from error

    return opened_bag()


def _bag_messages(path: Path, topic: str) -> Iterator[tuple[int, list[float]]]:
    with _entered(path) as bag:
        connections = [connection for connection in bag.connections if connection.topic == topic]
        for connection, log_ns, data in bag.messages(connections):
            message = bag.deserialize(data, connection.msgtype)
            stamp = int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
            yield stamp or log_ns, _row(message)


# ---------------------------------------------------------------------------------------------------------------- MCAP


def _mcap_topics(path: Path) -> dict[str, int]:
    from mcap.reader import make_reader

    found: dict[str, int] = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            if _decoder(schema, channel, message.data) is not None:
                found[channel.topic] = found.get(channel.topic, 0) + 1
    return found


def _mcap_messages(path: Path, topic: str) -> Iterator[tuple[int, list[float]]]:
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages(topics=[topic]):
            decode = _decoder(schema, channel, message.data)
            if decode is not None:
                stamp, row = decode(message.data)
                yield stamp or message.log_time, row


def _decoder(schema: Any, channel: Any, data: bytes) -> Any:
    """Return what makes a stamp and six numbers of a message, None if it is none of an IMU."""
    encoding = channel.message_encoding
    if encoding == "json":
        return _of_json if b"angular_velocity" in data and b"linear_acceleration" in data else None
    if schema is None or schema.name not in _IMU or encoding not in ("cdr", "ros1"):
        return None
    return _of_ros1 if encoding == "ros1" else _of_cdr


def _of_json(data: bytes) -> tuple[int, list[float]]:
    found = json.loads(data)
    stamp = found.get("timestamp") or found.get("header", {}).get("stamp") or {}
    parts: dict[str, Any] = stamp if isinstance(stamp, dict) else {}
    seconds, rest = parts.get("sec", 0), parts.get("nsec", parts.get("nanosec", 0))
    values = [float(found[name][axis]) for name in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    return int(seconds) * 1_000_000_000 + int(rest), values


def _of_cdr(data: bytes) -> tuple[int, list[float]]:
    from imutui.logbook import layout

    found = layout.decode(_IMU[0], data)
    stamp = int(found["header.stamp.sec"]) * 1_000_000_000 + int(found["header.stamp.nanosec"])
    return stamp, [*found["angular_velocity"].tolist(), *found["linear_acceleration"].tolist()]


def _of_ros1(data: bytes) -> tuple[int, list[float]]:
    message = _ros1_types().deserialize_ros1(data, _IMU[0])
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec), _row(message)


def _ros1_types() -> Any:
    if not _ROS1:
        from rosbags.typesys import Stores, get_typestore

        _ROS1.append(get_typestore(Stores.ROS1_NOETIC))
    return _ROS1[0]


_ROS1: list[Any] = []
