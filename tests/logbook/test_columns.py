"""Records and fields of many messages at once, against each of them by itself."""

import random
from dataclasses import fields
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from helpers import ros_messages
from helpers.logs import LAYOUTS, START, recorded, rewritten, with_frame
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.exceptions import McapError
from mcap.records import Chunk, Message
from mcap.writer import IndexType

from imutui.logbook import audit, columns, mcap_format, mcap_stream, reader, scan, schemas
from imutui.logbook.columns import IMU, RAW, TABLE, TEMPERATURE, TOPICS
from imutui.logbook.mcap_format import HEAD, MESSAGE
from imutui.logbook.mcap_stream import Batch
from imutui.logbook.reader import UnreadableLogError

KINDS = [IMU, TEMPERATURE, RAW, TABLE]


def same(a: Any, b: Any) -> None:
    """Fail unless two values are equal, arrays bit by bit."""
    assert type(a) is type(b)
    if isinstance(a, np.ndarray):
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
    elif isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            same(a[key], b[key])
    elif hasattr(a, "__dataclass_fields__"):
        for f in fields(a):
            same(getattr(a, f.name), getattr(b, f.name))
    else:
        assert a == b


def all_that_is_said(path: Path) -> Any:
    """What the reader, the scan and the audit take from a file, or their words."""
    said: list[Any] = []
    for take in (lambda: reader.read(path, raw=True), lambda: scan.scan(path), lambda: audit.audit(scan.scan(path))):
        try:
            said.append(take())
        except UnreadableLogError as error:
            said.append(str(error))
    return said


@pytest.mark.parametrize("case", LAYOUTS)
def test_damaged_files_say_the_same_whatever_the_size_of_batches(
    tmp_path: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = dict(LAYOUTS[case])
    if "index_types" in options:
        options["index_types"] = IndexType.NONE
    path = rewritten(recorded(tmp_path / "a.mcap"), tmp_path / "b.mcap", **options)
    content, rng, spoilt = path.read_bytes(), random.Random(case), tmp_path / "c.mcap"
    for k in range(12):
        damaged = bytearray(content[: rng.randrange(len(content))] if 0 < k < 6 else content)
        for _ in range(rng.randrange(1, 4) if k > 3 else 0):
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        spoilt.write_bytes(damaged)
        at_once = all_that_is_said(spoilt)
        with monkeypatch.context() as patch:
            patch.setattr(mcap_stream.joined, "__defaults__", (1,))
            for a, b in zip(at_once, all_that_is_said(spoilt), strict=True):
                same(a, b)


@given(
    st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=60), st.integers(-30, 30)), max_size=12),
    st.binary(max_size=20),
)
def test_records_are_those_that_one_finds_head_by_head(parts: list[tuple[int, bytes, int]], rest: bytes) -> None:
    content = b"".join(
        HEAD.pack(opcode if opcode > 20 else 5, max(0, len(body) + (wrong if wrong > 25 else 0))) + body
        for opcode, body, wrong in parts
    )
    content += rest
    wanted, rows, starts, at = np.arange(256) % 7 != 3, [], list[int](), 0
    while at + HEAD.size <= len(content):
        opcode, length = HEAD.unpack_from(content, at)
        if at + HEAD.size + length > len(content):
            break
        message = opcode == 5 and length >= MESSAGE.size
        channel = MESSAGE.unpack_from(content, at + HEAD.size)[0] if message else -1
        before = HEAD.size + (MESSAGE.size if message else 0)
        if wanted[opcode]:
            rows.append([opcode, channel, at + before, HEAD.size + length - before])
        starts.append(at)
        at += HEAD.size + length
    found = mcap_stream.tabulate(content, wanted)
    assert (found.rows.tolist(), found.starts.tolist(), found.end) == (rows, starts, at)
    assert found.short.tolist() == [row[:2] == [5, -1] for row in rows]


def message(kind: int, stamp: int, rng: random.Random) -> bytes:
    """A message of ours, as plain as the recorder writes it or with another text before its numbers."""
    frame = rng.choice(["imu_body", "", "x", "a long name of a frame", "Gehäuse"])
    values = np.array([rng.gauss(0.0, 1.0) for _ in range(6)])
    if kind == IMU:
        return with_frame(schemas.encode_imus(stamp, values[:3], values[3:])[0], schemas.TYPES[schemas.IMU], frame)
    if kind == TEMPERATURE:
        plain = schemas.encode_temperatures(stamp, values[0])[0]
        return with_frame(plain, schemas.TYPES[schemas.TEMPERATURE], frame)
    if kind == RAW:
        details = rng.choice([None, ((-7, 8, -9), 10, 0xFFFE)])
        return ros_messages.packet(stamp, stamp, (1, 2, 3, 4, 5, 6), 7, 8, details=details)
    return schemas.encode_table_references(stamp, frame, values[:3].tolist(), values[3:].tolist())[0]


@settings(deadline=None)  # the first one loads the types
@given(st.integers(0, 2**32), st.integers(0, 6))
def test_plain_messages_are_taken_as_they_are_decoded(seed: int, changes: int) -> None:
    rng = random.Random(seed)
    content, plain = bytearray(), True
    for _ in range(rng.randrange(1, 9)):
        kind = rng.choice(KINDS)
        data = message(kind, rng.choice([0, START]), rng)
        plain &= "Gehäuse".encode() not in data or kind == TABLE
        head = MESSAGE.pack(kind, 1, 2, START)
        content += HEAD.pack(5, len(head) + len(data)) + head + data
    for _ in range(changes):
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    rows = mcap_stream.tabulate(bytes(content)).rows
    rows = rows[np.isin(rows[:, mcap_stream.CHANNEL], KINDS)]
    batch = Batch(bytes(content), rows)
    roles = rows[:, mcap_stream.CHANNEL].astype(np.uint8)
    found, bad = columns.read(batch, roles)
    assert changes or not bad
    for role in KINDS:
        rows_of = [row for row in np.flatnonzero(roles == role).tolist() if row not in bad]
        assert len(found.get(role, ())) == len(rows_of)
        for row, got in zip(rows_of, found.get(role, ()), strict=True):
            try:
                expected = by_rosbags(role, batch.message(row))
            except Exception:  # noqa: BLE001 - rosbags refuses texts that are not UTF-8, which are not read here
                assert changes
                continue
            same(np.hstack(got.tolist()).astype(float), np.hstack(expected).astype(float))


def by_rosbags(role: int, message: Message) -> tuple[Any, ...]:
    """Return the row of a message as rosbags decodes it."""
    details = len(message.data) == schemas.RAW_DTYPE.itemsize
    typename = schemas.raw_type(details=details) if role == RAW else schemas.TYPES[TOPICS[role]]
    m = ros_messages.decode(typename, message.data)
    published = int(np.uint64(message.publish_time).astype(np.int64))  # a spoiled one wraps
    if role == RAW:
        more = (m.rate_temperatures.tolist(), m.board_temperature, m.status) if details else ([0, 0, 0], 0, 0)
        packet = (m.sequence, m.host_monotonic_ns, m.counts.tolist(), m.temperature, m.ticks, m.mode, m.flags, *more)
        return (published, *packet)
    stamp = ros_messages.stamp_ns(m.header) or published
    if role == TEMPERATURE:
        return (stamp, m.temperature)
    if role == TABLE:
        return (stamp, m.angles_deg.tolist(), m.rates_dps.tolist())
    w, f = m.angular_velocity, m.linear_acceleration
    unknown = m.angular_velocity_covariance[0], m.linear_acceleration_covariance[0]
    return (stamp, [w.x, w.y, w.z], [f.x, f.y, f.z], *unknown)


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_a_chunk_takes_no_more_memory_than_it_says(compression: str) -> None:
    content = bytes(2**22)
    packed = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}[compression](content)
    inflater = mcap_format.Inflater(len(packed))

    def chunk(size: int, data: bytes = packed, name: str = compression) -> Chunk:
        return Chunk(name, data, 0, 0, 0, size)

    assert inflater.content(chunk(len(content))) == content
    wrong = [chunk(mcap_format.CHUNK_LIMIT + 1), chunk(10), chunk(len(content) + 1), chunk(len(content), name="brotli")]
    wrong += [chunk(len(content), packed[:20])] if compression else []
    for one in wrong:
        with pytest.raises(McapError):
            mcap_format.Inflater(len(content)).content(one)
    with pytest.raises(mcap_format.ChecksumError):
        inflater.content(Chunk(compression, packed, 0, 0, 1, len(content)))


def test_many_small_chunks_do_not_unpack_to_more_than_the_file_lets_expect() -> None:
    content = bytes(2**22)
    chunk = Chunk("zstd", zstandard.compress(content), 0, 0, 0, len(content))
    inflater = mcap_format.Inflater(1000)
    for _ in range(mcap_format.BASE_LIMIT // len(content)):
        inflater.content(chunk)
    with pytest.raises(McapError, match="far more"):
        inflater.content(chunk)
