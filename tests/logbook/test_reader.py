"""The fast walk over a log against mcap's own message loop, which knows nothing of it."""

import contextlib
import io
import random
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import ros_messages
from helpers.logs import LAYOUTS, START, chunks, recorded, rewritten, with_frame
from hypothesis import given
from hypothesis import strategies as st
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from zstandard import ZstdError

from imutui.logbook import SessionInfo, message_definitions, reader, schemas
from imutui.logbook.layout import UndecodableError
from imutui.logbook.reader import Log, UnreadableLogError
from imutui.logbook.samples import Waiting
from imutui.logbook.session_info import METADATA
from imutui.logbook.writer import LogWriter

numbers = st.floats(width=64, allow_nan=False)
vectors = st.tuples(numbers, numbers, numbers)
plain_texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)  # NUL ends a text


def messages(content: bytes) -> Iterator[tuple[str, Message]]:
    """Topic and message by mcap's own loop, up to where it stops."""
    topics: dict[int, str] = {}
    try:
        for record in StreamReader(io.BytesIO(content), emit_chunks=True, validate_crcs=True).records:
            for part in breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]:
                if isinstance(part, Channel):
                    topics[part.id] = part.topic
                elif isinstance(part, Message):
                    yield topics[part.channel_id], part
    except (McapError, ValueError, struct.error, ZstdError):
        return


def assert_same(log: Log, content: bytes) -> None:
    """Every field of every message is what rosbags makes of it, to the last bit."""
    imu, temperature, packets, events, tables = [], [], [], [], []
    for topic, message in messages(content):
        m = ros_messages.decode(schemas.TYPES[topic], message.data)
        if topic == schemas.IMU:
            w, f = m.angular_velocity, m.linear_acceleration
            valid = m.angular_velocity_covariance[0] != -1.0 and m.linear_acceleration_covariance[0] != -1.0
            imu.append((ros_messages.stamp_ns(m.header) or message.publish_time, w.x, w.y, w.z, f.x, f.y, f.z, valid))
        elif topic == schemas.TEMPERATURE:
            temperature.append((ros_messages.stamp_ns(m.header), m.temperature))
        elif topic == schemas.RAW:
            packets.append(
                (m.sequence, m.host_monotonic_ns, m.counts.tolist(), m.temperature, m.ticks, m.mode, m.flags)
            )
        elif topic == schemas.EVENTS:
            events.append(m.msg)
        elif topic == schemas.REFERENCE:
            tables.append((ros_messages.stamp_ns(m.header), *m.angles_deg, *m.rates_dps))
    assert log.table.stamp_ns.tolist() == [row[0] for row in tables]
    assert np.hstack([log.table.angles_deg, log.table.rates_dps]).tolist() == [list(row[1:]) for row in tables]
    assert log.samples.stamp_ns.tolist() == [row[0] for row in imu]
    columns = np.array([row[1:7] for row in imu])
    assert np.hstack([log.samples.gyro, log.samples.accel]).tobytes() == columns.tobytes()
    assert log.samples.valid.tolist() == [row[7] for row in imu]
    stamps, degc = (np.array(column) for column in zip(*temperature, strict=True))
    held = np.maximum(np.searchsorted(stamps, log.samples.stamp_ns, side="right") - 1, 0)
    assert log.samples.degc.tobytes() == degc[held].tobytes()
    assert [(n, host, counts.tolist(), *rest[:4]) for n, host, counts, *rest in log.packets.tolist()] == packets
    assert [event.text for event in log.events] == events


@pytest.mark.parametrize("case", LAYOUTS)
def test_every_field_is_what_the_message_loop_reads(tmp_path: Path, case: str) -> None:
    from mcap.writer import IndexType

    options = dict(LAYOUTS[case])
    if "index_types" in options:
        options["index_types"] = IndexType.NONE
    path = rewritten(recorded(tmp_path / "a.mcap"), tmp_path / "b.mcap", **options)
    log = reader.read(path, raw=True)
    assert (log.finished, log.damage, log.samples.stamp_ns.size) == (True, "", 60)
    assert log.reference == "kind 59"
    assert log.diagnostics == {"packets": "59"}
    assert_same(log, path.read_bytes())


@pytest.mark.parametrize("chunked", [True, False])
def test_a_cut_file_gives_what_the_message_loop_gives(tmp_path: Path, chunked: bool) -> None:
    path = rewritten(recorded(tmp_path / "a.mcap"), tmp_path / "b.mcap", chunk_size=3000, use_chunking=chunked)
    content = path.read_bytes()
    cut = tmp_path / "cut.mcap"
    sizes = set()
    for length in sorted(random.Random(1).sample(range(len(content)), 200)):
        cut.write_bytes(content[:length])
        try:
            log = reader.read(cut, raw=True)
        except UnreadableLogError:
            assert not any(topic == schemas.IMU for topic, _ in messages(content[:length]))
            continue
        assert not log.finished
        assert "ends in the middle" in log.damage
        assert_same(log, content[:length])
        sizes.add(log.samples.stamp_ns.size)
    assert len(sizes) >= 10


def test_a_changed_byte_costs_no_more_than_the_message_loop_loses(tmp_path: Path) -> None:
    """The same samples are given up as with mcap's own reader, since each chunk has its checksum."""
    path = rewritten(recorded(tmp_path / "a.mcap"), tmp_path / "b.mcap", chunk_size=3000)
    content = path.read_bytes()
    rng = random.Random(2)
    for at, length in chunks(content)[1:]:
        spoilt = bytearray(content)
        spoilt[rng.randrange(at + 60, at + length)] ^= 1 << rng.randrange(8)
        (tmp_path / "c.mcap").write_bytes(spoilt)
        try:
            log = reader.read(tmp_path / "c.mcap", raw=True)
        except UnreadableLogError:
            assert not any(topic == schemas.IMU for topic, _ in messages(bytes(spoilt)))
            continue
        assert log.damage
        assert_same(log, bytes(spoilt))


def test_a_record_longer_than_the_limit_ends_the_reading(tmp_path: Path) -> None:
    content = bytearray(recorded(tmp_path / "a.mcap").read_bytes())
    struct.pack_into("<Q", content, chunks(bytes(content))[1][0] + 1, 2**40)
    (tmp_path / "b.mcap").write_bytes(content)
    log = reader.read(tmp_path / "b.mcap")
    assert log.samples.stamp_ns.size == 20
    assert "a length is out of range" in log.damage


def test_a_message_that_cannot_be_decoded_ends_the_reading_at_its_place(tmp_path: Path) -> None:
    spoils = {schemas.IMU: 30, schemas.TEMPERATURE: 12, schemas.RAW: 5, schemas.EVENTS: 0}
    for topic, number in spoils.items():
        path = tmp_path / "bad.mcap"
        with path.open("wb") as stream:
            writer = Writer(stream)
            writer.start(profile="ros2", library="test")
            writer.add_metadata(METADATA, SessionInfo().strings())
            ids = {
                t: writer.register_channel(t, "cdr", writer.register_schema(n, "ros2msg", b""))
                for t, n in schemas.TYPES.items()
            }
            seen = dict.fromkeys(schemas.TYPES, 0)
            samples = None
            for t, message in messages(recorded(tmp_path / f"{number}.mcap").read_bytes()):
                bad = t == topic and seen[t] == number
                samples = seen[schemas.IMU] if bad else samples
                seen[t] += 1
                writer.add_message(ids[t], 1, message.data[:-9] if bad else message.data, message.publish_time)
            writer.finish()
        log = reader.read(path, raw=True)
        assert "cannot be decoded" in log.damage
        assert not log.finished
        assert log.samples.stamp_ns.size == samples, topic


def test_only_the_latest_diagnostics_must_be_decodable(tmp_path: Path) -> None:
    log = LogWriter(tmp_path / "a.mcap", SessionInfo(), "", START)
    log.imu(START, START, np.zeros(3), np.zeros(3))
    log.encoded(schemas.DIAGNOSTICS, b"\0\1\0\0", START, START)
    log.finish({}, START)
    read = reader.read(tmp_path / "a.mcap")
    assert read.samples.stamp_ns.size == 1
    assert "cannot be decoded" in read.damage
    assert not read.finished


@given(
    st.integers(0, 2**31 * 10**9 - 1), numbers, vectors, vectors, st.sampled_from(["", "level", "gravity", "profile"])
)
def test_what_is_packed_by_hand_is_what_rosbags_writes(
    stamp: int, degc: float, gyro: Any, accel: Any, kind: str
) -> None:
    packed = {
        schemas.IMU: schemas.encode_imus(stamp, np.array(gyro), np.array(accel), valid=bool(kind))[0],
        schemas.TEMPERATURE: schemas.encode_temperatures(stamp, degc)[0],
        schemas.REFERENCE: schemas.encode_table_references(stamp, kind, gyro, accel)[0],
    }
    m = {topic: ros_messages.decode(schemas.TYPES[topic], data) for topic, data in packed.items()}
    assert all(ros_messages.encode(schemas.TYPES[topic], m[topic]) == data for topic, data in packed.items())
    assert {ros_messages.stamp_ns(each.header) for each in m.values()} == {stamp}
    w, f, flag = m[schemas.IMU].angular_velocity, m[schemas.IMU].linear_acceleration, 0.0 if kind else -1.0
    assert ((w.x, w.y, w.z), (f.x, f.y, f.z)) == (gyro, accel)
    first = [m[schemas.IMU].angular_velocity_covariance[0], m[schemas.IMU].linear_acceleration_covariance[0]]
    assert first == [flag, flag]
    assert m[schemas.IMU].orientation_covariance[0] == -1.0
    assert m[schemas.TEMPERATURE].temperature == degc
    table = m[schemas.REFERENCE]
    assert (table.kind, tuple(table.angles_deg), tuple(table.rates_dps)) == (kind, gyro, accel)


def test_a_flagged_sample_says_no_estimate_in_both_covariances(tmp_path: Path) -> None:
    log = reader.read(recorded(tmp_path / "a.mcap"))
    assert np.flatnonzero(~log.samples.valid).tolist() == [5, 25, 45]
    m = ros_messages.decode(
        schemas.TYPES[schemas.IMU], schemas.encode_imus(START, np.ones(3), np.ones(3), valid=False)[0]
    )
    assert m.angular_velocity_covariance.tolist() == [-1.0, *[0.0] * 8]
    assert m.linear_acceleration_covariance.tolist() == [-1.0, *[0.0] * 8]
    assert m.angular_velocity.x == 1.0


def test_a_sample_without_stamp_has_its_publish_time(tmp_path: Path) -> None:
    for frame in ("imu", ""):
        with (tmp_path / "a.mcap").open("wb") as stream:
            writer = Writer(stream)
            writer.start(profile="ros2", library="another program")
            channel = writer.register_channel(
                "/x", "cdr", writer.register_schema("sensor_msgs/msg/Imu", "ros2msg", b"")
            )
            data = with_frame(schemas.encode_imus(0, np.zeros(3), np.ones(3))[0], schemas.TYPES[schemas.IMU], frame)
            for k in range(3):
                writer.add_message(channel, 7, data, START + 1000 * k)
            writer.finish()
        log = reader.read(tmp_path / "a.mcap")
        assert log.samples.stamp_ns.tolist() == [START, START + 1000, START + 2000]
        assert log.samples.valid.all()


def test_packets_are_read_on_request_only(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap")
    assert reader.read(path, raw=True).packets["sequence"].tolist() == list(range(60))
    assert reader.read(path).packets.size == 0


def test_a_sample_has_the_last_temperature_by_then() -> None:
    """Temperatures may stand out of order, or ten seconds later in the file than the samples that they are of."""

    def take(seconds: list[int], degc: dict[int, float]) -> None:
        n = len(seconds)
        rows = {"stamp_ns": 10**9 * np.array(seconds, np.int64), "gyro": np.zeros((n, 3)), "accel": np.zeros((n, 3))}
        stamps, values = 10**9 * np.array([*degc], np.int64), np.array([*degc.values()])
        waiting.take({**rows, "valid": np.ones(n, bool)}, stamps, values)

    waiting = Waiting()
    take([0, 10], {25: 2.0, 10: 1.0})
    take([20, 30], {35: np.nan})
    assert waiting.ready().degc.tolist() == [1.0, 1.0, 1.0]
    take([40], {28: 4.0})
    take([], {40: 3.0})
    assert waiting.rest().degc.tolist() == [4.0, 3.0]
    waiting = Waiting()
    take([0], {})
    assert np.isnan(waiting.rest().degc).all()


@given(
    st.integers(0, 2**31 * 10**9 - 1),
    plain_texts,
    st.dictionaries(plain_texts, plain_texts, max_size=4),
    st.integers(0, 2**32),
    st.integers(1, 3),
)
def test_events_and_diagnostics_are_what_rosbags_reads(
    stamp: int, text: str, values: dict[str, str], seed: int, changes: int
) -> None:
    event = schemas.encode_event(stamp, text, text[::-1])
    m = ros_messages.decode(schemas.TYPES[schemas.EVENTS], event)
    found = schemas.decode_event(event)
    assert (found.stamp_ns, found.name, found.text) == (m.stamp.sec * 10**9 + m.stamp.nanosec, m.name, m.msg)
    assert ros_messages.encode(schemas.TYPES[schemas.EVENTS], m) == event
    diagnostics = schemas.encode_diagnostics(stamp, 1, text, values)
    m = ros_messages.decode(schemas.TYPES[schemas.DIAGNOSTICS], diagnostics)
    assert schemas.decode_diagnostics(diagnostics) == {pair.key: pair.value for pair in m.status[0].values}
    assert ros_messages.encode(schemas.TYPES[schemas.DIAGNOSTICS], m) == diagnostics
    rng = random.Random(seed)
    for decode, data in ((schemas.decode_event, event), (schemas.decode_diagnostics, diagnostics)):
        damaged = bytearray(data)
        for _ in range(changes):
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        with contextlib.suppress(UndecodableError):  # the one error of bytes that are no such message
            decode(bytes(damaged[: rng.randrange(len(damaged) + 1)] if changes == 3 else damaged))


def test_our_texts_of_ros_types_are_those_of_ros() -> None:
    humble = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in message_definitions.OWN.items():
        humble.register(get_types_from_msg(text, name))
    for name in message_definitions.ROS | message_definitions.OWN:
        assert schemas.definition(name) == humble.generate_msgdef(name, ros_version=2)[0]
