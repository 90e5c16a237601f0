import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import ros_messages
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2.metadata import parse_qos

from filters import attitude
from imutui.logbook import SessionInfo, reader, schemas
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.writer import LogWriter

START = 1_795_257_000_000_000_000
counts = st.integers(-32768, 32767)
packets = st.fixed_dictionaries(
    {
        "sequence": st.integers(0, 2**64 - 1),
        "host_ns": st.integers(-(2**63), 2**63 - 1),
        "counts": st.tuples(*[counts] * 6),
        "temperature": st.integers(0, 65535),
        "ticks": st.integers(0, 65535),
        "mode": st.integers(0, 1),
        "flags": st.integers(0, 255),
        "details": st.none() | st.tuples(st.tuples(counts, counts, counts), counts, st.integers(0, 65535)),
    }
)


def write(path: Path, seconds: int = 3, *, finish: bool = True, rate: int = 20) -> LogWriter:
    """A log of a few seconds with one of every message, flushed each second."""
    log = LogWriter(path, SessionInfo(serial_number="42", rate_hz=rate, kind="simulated"), "x = 1\n", START)
    rng = np.random.default_rng(1)
    for k in range(seconds * rate):
        stamp = START + k * 1_000_000_000 // rate
        log.encoded(schemas.RAW, ros_messages.packet(k, k, (1, 2, 3, 4, 5, 6), 1587, 65535 - k), stamp, stamp)
        log.imu(stamp, stamp, rng.normal(size=3), rng.normal(size=3))
        if k % rate == rate - 1:
            reference = schemas.encode_table_references(stamp, "level", np.zeros(3), np.zeros(3))[0]
            log.encoded(schemas.REFERENCE, reference, stamp, stamp)
            log.encoded(schemas.TEMPERATURE, schemas.encode_temperatures(stamp, 24.5)[0], stamp, stamp)
            log.encoded(
                schemas.DIAGNOSTICS, schemas.encode_diagnostics(stamp, 0, "ok", {"lost_packets": "3"}), stamp, stamp
            )
            log.encoded(schemas.EVENTS, schemas.encode_event(stamp, "mark", "here"), stamp, stamp)
            log.flush()
    if finish:
        log.finish({"samples": seconds * rate}, START)
    return log


@given(packets)
def test_a_raw_packet_is_what_rosbags_makes_of_it(packet: dict[str, Any]) -> None:
    data = ros_messages.packet(**packet)
    typename = schemas.raw_type(details=packet["details"] is not None)
    m = ros_messages.decode(typename, data)
    assert (m.sequence, m.host_monotonic_ns, tuple(m.counts)) == (
        packet["sequence"],
        packet["host_ns"],
        packet["counts"],
    )
    assert [m.temperature, m.ticks, m.mode, m.flags] == [packet[k] for k in ("temperature", "ticks", "mode", "flags")]
    if packet["details"] is not None:
        assert (tuple(m.rate_temperatures), m.board_temperature, m.status) == packet["details"]
    assert ros_messages.encode(typename, m) == data


def test_what_is_written_is_read(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    log = reader.read(tmp_path / "a.mcap", raw=True)
    rng = np.random.default_rng(1)
    expected = rng.normal(size=(60, 6))
    assert log.finished
    assert log.damage == ""
    assert np.array_equal(np.hstack([log.samples.gyro, log.samples.accel]), expected)
    assert log.samples.stamp_ns[0] == START
    assert np.allclose(np.diff(log.seconds()), 0.05)
    assert [p.sequence for p in ros_messages.packets(log)] == list(range(60))
    assert log.info.serial_number == "42"
    assert log.reference == "level"
    assert log.diagnostics == {"lost_packets": "3"}
    assert {event.text for event in log.events} == {"here"}
    assert set(log.attachments) == {"configuration.toml", "summary.json"}


def test_metadata_survives_with_every_digit() -> None:
    info = replace(SessionInfo(), gravity_mps2=9.7863716970205, seed=7, mount="x,-y,-z", note='a "b", c')
    assert SessionInfo.from_strings(info.strings()) == info
    with pytest.raises(ValueError, match="rate_hz"):
        SessionInfo.from_strings({"rate_hz": "fast"})


def test_other_libraries_open_the_file(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    with AnyReader([tmp_path / "a.mcap"]) as bag:
        imu = [bag.deserialize(data, c.msgtype) for c, _, data in bag.messages() if c.topic == schemas.IMU]
        raw = [bag.deserialize(data, c.msgtype) for c, _, data in bag.messages() if c.topic == schemas.RAW]
    assert len(imu) == 60
    assert imu[0].orientation_covariance[0] == -1.0
    assert list(raw[5].counts) == [1, 2, 3, 4, 5, 6]
    with (tmp_path / "a.mcap").open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
        header = make_reader(stream).get_header()
    assert summary is not None
    assert summary.statistics is not None
    assert {c.topic for c in summary.channels.values()} == set(schemas.TYPES)
    assert {(c.message_encoding, summary.schemas[c.schema_id].encoding) for c in summary.channels.values()} == {
        ("cdr", "ros2msg")
    }
    assert header.profile == "ros2"
    assert header.library.startswith("imutui ")


def test_a_transform_leads_from_the_link_of_rep_145_to_the_frame_of_the_samples(tmp_path: Path) -> None:
    """Once in a file, before its first sample, latched: turned by it, gravity reads +g along z up, as ROS has it."""
    write(tmp_path / "a.mcap")
    with AnyReader([tmp_path / "a.mcap"]) as bag:
        found = [(c, t, bag.deserialize(data, c.msgtype)) for c, t, data in bag.messages() if c.topic == "/tf_static"]
        sample = next(bag.deserialize(data, c.msgtype) for c, _, data in bag.messages() if c.topic == schemas.IMU)
    [(connection, time_ns, message)] = found
    [qos] = parse_qos(schemas.CHANNEL_METADATA["/tf_static"]["offered_qos_profiles"])
    assert connection.msgtype == "tf2_msgs/msg/TFMessage"
    assert time_ns == START
    assert (qos.durability.name, qos.reliability.name) == ("TRANSIENT_LOCAL", "RELIABLE")
    [transform] = message.transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("imu_link", sample.header.frame_id)
    q = transform.transform.rotation
    level = np.array([1.0, 2.0, -9.8])
    assert np.array_equal(attitude.from_quaternion(np.array([q.w, q.x, q.y, q.z])) @ level, [1.0, -2.0, 9.8])


def test_an_unfinished_file_is_read_to_its_last_flush(tmp_path: Path) -> None:
    writer = write(tmp_path / "a.mcap", finish=False)
    log = reader.read(tmp_path / "a.mcap")
    assert log.samples.stamp_ns.size == 60
    assert not log.finished
    assert "ends in the middle" in log.damage
    writer.finish({}, START)


def test_a_full_disk_leaves_the_last_good_flush(tmp_path: Path) -> None:
    import resource

    path = tmp_path / "a.mcap"
    read_end, write_end = os.pipe()
    child = os.fork()
    if child == 0:  # a limit on file size stands in for a full disk: the kernel refuses the write either way
        try:
            import signal

            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
            log = LogWriter(path, SessionInfo(rate_hz=20), "", START)
            try:
                for k in range(100_000):
                    stamp = START + k * 50_000_000
                    log.imu(stamp, stamp, np.random.default_rng(k).normal(size=3), np.zeros(3))
                    if k % 20 == 19:
                        log.flush()
            except OSError:
                log.finish({}, START)
                os.write(write_end, str(log.size).encode())
        finally:
            os._exit(0)
    os.close(write_end)
    os.waitpid(child, 0)
    good = int(os.read(read_end, 100))
    os.close(read_end)
    assert path.stat().st_size == good
    log = reader.read(path)
    assert log.samples.stamp_ns.size % 20 == 0
    assert log.samples.stamp_ns.size >= 20


def test_an_own_log_without_samples_says_so(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", seconds=0)
    with pytest.raises(UnreadableLogError, match="no samples"):
        reader.read(tmp_path / "a.mcap")
