"""Small bags and MCAP files as drivers of ROS leave them, of the unit of `recordings_of_others`, z up."""

import shutil
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import Writer
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from helpers.recordings_of_others import COUNT, HZ, STANDARD_GRAVITY, START_NS, readings

IMU, TEMPERATURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature"


class Sample(NamedTuple):
    """A message: log time and stamp (ns), topic, and rates and forces, or a temperature."""

    log_ns: int
    topic: str
    values: np.ndarray  # rad/s and m/s², shape (6,), or degC, shape (1,)
    stamp_ns: int
    covariance: float = 0.0


def samples(topic: str = "/imu/data", rate: float = HZ, shift_ns: int = 0, seed: int = 5) -> list[Sample]:
    """Return the unit's samples on a topic."""
    _, gyro, accel = readings(seed)
    six = np.hstack([np.deg2rad(gyro), accel * STANDARD_GRAVITY])
    stamps = START_NS + shift_ns + np.round(np.arange(COUNT) * 1e9 / rate).astype(np.int64)
    return [Sample(int(ns), topic, values, int(ns)) for ns, values in zip(stamps, six, strict=True)]


def changed(found: Iterable[Sample], change: Callable[[int, Sample], Sample]) -> list[Sample]:
    """Return samples after a change of each, by its number."""
    return [change(k, sample) for k, sample in enumerate(found)]


def masked(found: Iterable[Sample], mask: object, value: float) -> list[Sample]:
    """Return samples with a value in place of some of their numbers."""
    return changed(found, lambda k, s: s._replace(values=np.where(mask, value, s.values)))


def late(found: Iterable[Sample], first: int, ns: int) -> list[Sample]:
    """Return samples whose clock is moved from one of them on."""
    return changed(found, lambda k, s: s._replace(log_ns=s.log_ns + ns, stamp_ns=s.stamp_ns + ns) if k >= first else s)


def _pair(empty: float) -> list[Sample]:
    """Topics of a camera: rates at 200 Hz, forces at 62.5 Hz, each with nothing in the other's place."""
    rates = masked(samples("/camera/gyro/sample", 200.0), np.arange(6) > 2, empty)
    forces = masked(samples("/camera/accel/sample", 62.5, -7_000_000), np.arange(6) < 3, empty)
    return sorted(rates + forces, key=lambda s: s.log_ns)


def _with_temperature() -> list[Sample]:
    """Temperatures of each second, 1 K more than the one before."""
    every = enumerate(samples()[::100])
    warm = [Sample(s.log_ns, "/imu/temperature", np.array([25.0 + k]), s.stamp_ns) for k, s in every]
    return sorted(samples() + warm, key=lambda s: s.log_ns)


def _scaled(gyro: float, accel: float) -> list[Sample]:
    return changed(samples(), lambda k, s: s._replace(values=s.values * np.repeat([gyro, accel], 3)))


RECORDINGS: dict[str, tuple[Callable[[], list[Sample]], float, float]] = {
    # samples, their rate, and the least share of 3000 that is taken
    "level": (samples, 100.0, 0.999),
    "two_units": (lambda: samples("/left") + samples("/right", shift_ns=3_000), 100.0, 0.999),
    "pair_of_zeros": (lambda: _pair(0.0), 200.0, 0.99),
    "pair_of_nan": (lambda: _pair(float("nan")), 200.0, 0.99),
    "temperature": (_with_temperature, 100.0, 0.999),
    "degrees": (lambda: _scaled(57.29578, 1.0), 100.0, 0.999),
    "g": (lambda: _scaled(1.0, 1.0 / STANDARD_GRAVITY), 100.0, 0.999),
    "clock_back": (lambda: late(samples(), 1500, -700_000_000), 100.0, 0.4),
    "clock_back_twice": (lambda: late(late(samples(), 1000, -700_000_000), 2000, -700_000_000), 100.0, 0.3),
    "gaps": (lambda: late(late(samples(), 1000, 7 * 10**12), 2000, 10**10), 100.0, 0.999),
    "lost": (lambda: [s for k, s in enumerate(samples()) if k % 5], 100.0, 0.79),
    "every_message_twice": (lambda: [s for s in samples() for _ in range(2)], 100.0, 0.999),
    "no_stamps": (lambda: changed(samples(), lambda k, s: s._replace(stamp_ns=0)), 100.0, 0.999),
    "one_stamp": (lambda: changed(samples(), lambda k, s: s._replace(stamp_ns=77)), 100.0, 0.999),
    "zeros_now_and_then": (
        lambda: changed(samples(), lambda k, s: s if k % 50 else s._replace(values=np.zeros(6))), 100.0, 0.97,
    ),
    "no_estimate_now_and_then": (
        lambda: changed(
            samples(), lambda k, s: s if k % 50 else s._replace(values=s.values + 9.0, covariance=-1.0)
        ), 100.0, 0.97,
    ),
}  # fmt: skip


def write(folder: Path) -> list[Path]:
    """Write each recording as a bag of ROS 1 and as an MCAP file, some in other ways; returns the files."""
    made = []
    for name, (content, _, _) in RECORDINGS.items():
        made += [folder / f"{name}.bag", folder / f"{name}.mcap"]
        bag(made[-2], content())
        mcap(made[-1], content())
    made += [folder / "level_db3", folder / "level_cut.bag", folder / "level_lz4.bag"]
    database(made[-3], samples())
    bag(made[-1], samples(), rosbag1.Writer.CompressionFormat.LZ4)
    content_of = (folder / "level.bag").read_bytes()
    made[-2].write_bytes(content_of[: len(content_of) * 6 // 10])
    return made


@cache
def _store(version: Stores) -> Any:
    return get_typestore(version)


def _message(store: Any, kind: str, sample: Sample) -> Any:
    types = store.types
    time = types["builtin_interfaces/msg/Time"](*divmod(sample.stamp_ns, 1_000_000_000))
    number = (0,) if store is _store(Stores.ROS1_NOETIC) else ()
    header = types["std_msgs/msg/Header"](*number, time, "imu")
    if kind == TEMPERATURE:
        return types[kind](header, float(sample.values[0]), 0.0)
    vector, nine = types["geometry_msgs/msg/Vector3"], np.array([sample.covariance, *[0.0] * 8])
    still = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    w, f = (vector(*map(float, part)) for part in (sample.values[:3], sample.values[3:]))
    return types[kind](header, still, np.zeros(9), w, nine, f, nine)


def _encoded(found: list[Sample], version: Stores) -> Iterator[tuple[Sample, str, bytes]]:
    store = _store(version)
    encode = store.serialize_ros1 if version is Stores.ROS1_NOETIC else store.serialize_cdr
    for sample in found:
        kind = TEMPERATURE if sample.values.size == 1 else IMU
        yield sample, kind, bytes(encode(_message(store, kind, sample), kind))


def bag(path: Path, found: list[Sample], compression: Any = None) -> None:
    """Write a bag of ROS 1."""
    writer, topics = rosbag1.Writer(path), dict[str, Any]()
    if compression:
        writer.set_compression(compression)
    with writer:
        for sample, kind, data in _encoded(found, Stores.ROS1_NOETIC):
            if sample.topic not in topics:
                topics[sample.topic] = writer.add_connection(sample.topic, kind, typestore=_store(Stores.ROS1_NOETIC))
            writer.write(topics[sample.topic], sample.log_ns, data)


def database(path: Path, found: list[Sample]) -> None:
    """Write a folder of ROS 2 with a database, without its metadata."""
    shutil.rmtree(path, ignore_errors=True)
    with rosbag2.Writer(path, version=8) as writer:
        topic = writer.add_connection(found[0].topic, IMU, typestore=_store(Stores.ROS2_HUMBLE))
        for sample, _, data in _encoded(found, Stores.ROS2_HUMBLE):
            writer.write(topic, sample.log_ns, data)
    (path / "metadata.yaml").unlink()


def mcap(path: Path, found: list[Sample], packed: Callable[[bytes], bytes] = bytes) -> None:
    """Write an MCAP file of ROS 2; `packed` packs each message."""
    topics = dict[str, int]()
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        for sample, kind, data in _encoded(found, Stores.ROS2_HUMBLE):
            if sample.topic not in topics:
                schema = writer.register_schema(kind, "ros2msg", b"")
                topics[sample.topic] = writer.register_channel(sample.topic, "cdr", schema)
            writer.add_message(topics[sample.topic], sample.log_ns, packed(data), sample.log_ns)
        writer.finish()  # type: ignore[no-untyped-call]
