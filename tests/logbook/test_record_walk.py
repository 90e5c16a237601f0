"""The plain walk against the compiled one: which of them reads a log must not be seen in anything that is read."""

import ast
import random
import zlib
from dataclasses import fields
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from helpers.logs import LAYOUTS, START, recorded, rewritten, with_frame
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.exceptions import McapError
from mcap.records import Chunk

from imutui.logbook import mcap_format, mcap_kernels, message_arrays, message_layout, reader, record_walk, scan, schemas
from imutui.logbook.mcap_format import HEAD, MESSAGE
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.record_walk import PLAIN, Walk, compiled

KINDS = [message_layout.IMU, message_layout.TEMPERATURE, message_layout.RAW, message_layout.TABLE]
WIDTHS = {message_layout.IMU: 9, message_layout.TEMPERATURE: 2, message_layout.RAW: 48, message_layout.TABLE: 7}


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


def as_read(path: Path, walk: Walk) -> Any:
    """All that the reader takes from a file, or its words."""
    try:
        return reader.read(path, raw=True, walk=walk)
    except UnreadableLogError as error:
        return str(error)


def as_audited(path: Path, walk: Walk, monkeypatch: pytest.MonkeyPatch) -> Any:
    """What scan and audit say by one of the walks."""
    monkeypatch.setattr(record_walk, "for_reading", lambda size: walk)
    try:
        found = scan.scan(path)
    except UnreadableLogError as error:
        return str(error)
    return {"scan": found, "content": message_arrays.audit(found)}


@pytest.mark.parametrize("case", LAYOUTS)
def test_both_walks_read_the_same_from_damaged_files(
    tmp_path: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However a file is laid out, cut anywhere, and with bytes changed anywhere: the same arrays, the same words."""
    from mcap.writer import IndexType

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
        same(as_read(spoilt, PLAIN), as_read(spoilt, compiled()))
        plain, fast = (as_audited(spoilt, walk, monkeypatch) for walk in (PLAIN, compiled()))
        same(plain, fast)


@given(
    st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=60), st.integers(-30, 30)), max_size=12),
    st.binary(max_size=20),
    st.sampled_from([40, 2**20]),
)
def test_both_walks_find_the_same_records(parts: list[tuple[int, bytes, int]], rest: bytes, limit: int) -> None:
    """Records of any kind, lengths that are wrong by some bytes, and bytes that are none."""
    content = b"".join(
        HEAD.pack(opcode if opcode > 20 else 5, max(0, len(body) + (wrong if wrong > 25 else 0))) + body
        for opcode, body, wrong in parts
    )
    data = np.frombuffer(content + rest, np.uint8)
    wanted = np.arange(256) % 7 != 3
    assert PLAIN.end_of_whole(data, limit) == compiled().end_of_whole(data, limit)
    plain, fast = PLAIN.tabulate(data, limit, wanted), compiled().tabulate(data, limit, wanted)
    assert plain.rows.tolist() == fast.rows.tolist()
    assert plain[1:] == fast[1:]


def message(kind: int, stamp: int, rng: random.Random) -> bytes:
    """A message of ours, as plain as the recorder writes it or with another text before its numbers."""
    frame = rng.choice(["imu_body", "", "x", "a long name of a frame", "Gehäuse"])
    values = np.array([rng.gauss(0.0, 1.0) for _ in range(6)])
    if kind == message_layout.IMU:
        return with_frame(schemas.encode_imu(stamp, values[:3], values[3:]), schemas.TYPES[schemas.IMU], frame)
    if kind == message_layout.TEMPERATURE:
        plain = schemas.encode_temperature(stamp, values[0])
        return with_frame(plain, schemas.TYPES[schemas.TEMPERATURE], frame)
    if kind == message_layout.RAW:
        details = rng.choice([None, ((-7, 8, -9), 10, 0xFFFE)])
        return schemas.encode_raw(schemas.RawPacket(stamp, stamp, (1, 2, 3, 4, 5, 6), 7, 8, details=details))
    return schemas.encode_table_reference(stamp, frame, values[:3].tolist(), values[3:].tolist())


@settings(deadline=None)  # the first one compiles
@given(st.integers(0, 2**32), st.integers(0, 6))
def test_both_walks_take_the_same_fields(seed: int, changes: int) -> None:
    """Bit by bit, with and without stamp, and of spoilt messages both say that they are not plain."""
    rng = random.Random(seed)
    content, roles = bytearray(), np.arange(2**16).astype(np.uint8) % message_layout.ROLES
    kinds = [rng.choice([*KINDS, message_layout.IGNORED]) for _ in range(rng.randrange(1, 9))]
    for kind in kinds:
        data = message(kind or message_layout.RAW, rng.choice([0, START]), rng)
        head = MESSAGE.pack(kind, 1, 2, START)
        content += HEAD.pack(5, len(head) + len(data)) + head + data
    for _ in range(changes):
        at = rng.randrange(len(content))
        content[at] ^= 1 << rng.randrange(8)
    data = np.frombuffer(bytes(content), np.uint8)
    rows = PLAIN.tabulate(data, 2**20, np.arange(256) == message_layout.MESSAGE_OPCODE).rows
    rows = rows[rows[:, message_layout.CHANNEL] >= 0]
    taken = []
    for walk in (PLAIN, compiled()):
        counts, others = walk.tally(rows, roles)
        into = [np.zeros((counts[kind], WIDTHS[kind]), np.uint8 if WIDTHS[kind] == 38 else np.uint64) for kind in KINDS]
        plain = walk.gather(data, rows, roles, *into)
        taken.append((counts.tolist(), others.tolist(), plain, [a.tobytes() for a in into] if plain else None))
    assert taken[0] == taken[1]


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_a_chunk_takes_no_more_memory_than_it_says(compression: str) -> None:
    """A chunk of a few bytes that says little and holds much, or says too much, is damage in words."""
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
    """Each is within bounds, all of them are not."""
    content = bytes(2**22)
    chunk = Chunk("zstd", zstandard.compress(content), 0, 0, 0, len(content))
    inflater = mcap_format.Inflater(1000)
    for _ in range(mcap_format.BASE_LIMIT // len(content)):
        inflater.content(chunk)
    with pytest.raises(McapError, match="far more"):
        inflater.content(chunk)


def test_a_change_of_the_layout_changes_the_file_that_is_compiled() -> None:
    """Else numba would go on with what it compiled for the layout before, from its cache."""
    tree = ast.parse(Path(mcap_kernels.__file__).read_text())
    taken = [n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module == message_layout.__name__]
    names = sorted(alias.name for node in taken for alias in node.names if alias.name.isupper())
    numbers = [(name, getattr(message_layout, name)) for name in names]
    assert len(numbers) > 10
    found = zlib.crc32(repr(numbers).encode())
    assert found == mcap_kernels.LAYOUT_CRC, f"write 0x{found:08X} into mcap_kernels.LAYOUT_CRC"


def test_the_compiled_walk_is_taken_where_it_is_loaded() -> None:
    """One small log after the other is read by it, in a process that has paid for it already."""
    assert record_walk.for_reading(1) == record_walk.for_filtering(1) == compiled()
