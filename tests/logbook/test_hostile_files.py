"""Files that are made to harm: words and bounds, never a traceback and never the machine's memory."""

import io
import json
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from helpers.commands import imutui, imutui_json
from helpers.fuzzing import memory_of
from helpers.logs import LAYOUTS, START, recorded, rewritten
from mcap.opcode import Opcode

from imutui import outside_file
from imutui.jobs.info import brief
from imutui.jobs.recover import recover
from imutui.logbook import SessionInfo, effects_file, mcap_format, schemas, summary
from imutui.logbook.importing import arrays as array_files
from imutui.logbook.importing.recording import load
from imutui.logbook.importing.table import ImportDataError
from imutui.logbook.mcap_format import HEAD, MAGIC, records
from imutui.logbook.writer import LogWriter
from imutui.toml_text import DEPTH, LIMIT, parse

MIB = 2**20
SESSION = SessionInfo(rate_hz=20, kind="simulated").strings()


def record(opcode: int, content: bytes) -> bytes:
    return HEAD.pack(opcode, len(content)) + content


def prefixed(text: str) -> bytes:
    return mcap_format.prefixed(text)


def chunk(inside: bytes, compression: str, size: int | None = None) -> bytes:
    """A chunk record, packed as it says, with the right checksum."""
    packed = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}[compression](inside)
    head = struct.pack("<QQQI", START, START, len(inside) if size is None else size, zlib.crc32(inside))
    return record(Opcode.CHUNK, head + prefixed(compression) + struct.pack("<Q", len(packed)) + packed)


def bomb(compression: str, count: int) -> bytes:
    """A log of a few kilobytes whose chunks unpack to gigabytes of records as short as can be."""
    inside = bytes(9 * 2**17)
    header = record(Opcode.HEADER, prefixed("ros2") + prefixed("x"))
    return MAGIC + header + chunk(inside, compression) * count


@pytest.mark.parametrize("name", ["brief", "info", "check", "recover", "replay"])
def test_a_small_log_takes_no_gigabytes(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """98 kB took 3.2 GB in the list of logs: what chunks unpack to is bounded by the file's size.

    With bounds of a thirty-second, which are sooner reached: memory goes with them.
    """
    monkeypatch.setattr(mcap_format, "BASE_LIMIT", mcap_format.BASE_LIMIT // 32)
    monkeypatch.setattr(mcap_format, "EXPANSION", mcap_format.EXPANSION // 32)
    data = bomb("zstd", 800)
    assert 20_000 < len(data) < 100_000
    assert memory_of(name, data, tmp_path) < 12 * MIB


@pytest.mark.parametrize("compression", ["zstd", "lz4", "uncompressed"])
def test_a_damaged_chunk_is_passed_over_whatever_packed_it(compression: str, tmp_path: Path) -> None:
    source = rewritten(recorded(tmp_path / "a.mcap", 4), tmp_path / "b.mcap", chunk_size=9000, **LAYOUTS[compression])
    data = bytearray(source.read_bytes())
    first = len(MAGIC)
    chunks = [(first + at, n) for opcode, at, n in records(bytes(data[first:-first])) if opcode == Opcode.CHUNK]
    assert len(chunks) > 3
    middle, length = chunks[len(chunks) // 2]
    for at in range(middle + length // 2, middle + length // 2 + 40):
        data[at] ^= 0x55
    source.write_bytes(data)
    kept = recover(source, tmp_path / "c.mcap")
    assert (kept["chunks"], len(kept["damages"])) == (len(chunks) - 1, 1)
    assert kept["readable"]


@pytest.mark.parametrize("stamp", [2**63, 2**64 - 1, 16_725_225_600_000_000_000])
def test_a_stamp_that_is_no_time_is_told(stamp: int, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    log = LogWriter(path, SessionInfo(rate_hz=20, kind="simulated"), "", START)
    for ns in (START, START + 50_000_000, stamp):
        data = schemas.encode_imus(0, np.zeros(3), np.ones(3))[0]
        log.encoded(schemas.IMU, data, ns, ns)
    log.finish({}, START)
    assert brief(path).state == "finished"
    imutui("info", path)
    imutui("check", path, check=1)
    assert "no times" in imutui("replay", path, check=3).stderr
    imutui("recover", path, "-o", tmp_path / "b.mcap", check=1)


@pytest.mark.parametrize(
    ("field", "value"),
    [("rate_hz", "nan"), ("rate_hz", "0"), ("g_unit", "1e999"), ("latitude_deg", "-inf"), ("seed", "9" * 50),
     ("kappa", "-1e9"), ("baud", "1e400"), ("accel_range_g", "-1.0")],
)  # fmt: skip
def test_a_number_that_is_none_in_the_metadata_is_named(field: str, value: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=f"`{field}`"):
        SessionInfo.from_strings(SESSION | {field: value})


def test_info_prints_json_whatever_the_metadata_hold(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    log = LogWriter(path, SessionInfo(rate_hz=20, latitude_deg=float("nan"), height_m=float("inf")), "", START)
    log.imu(START, START, np.zeros(3), np.ones(3))
    log.finish({}, START)
    assert imutui_json("info", path)["latitude_deg"] is None
    assert "site          not stated\n" in imutui("info", path).stdout


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, '{"duration_s": 1e400, "gaps": 3, "alarms": {"a": 1}, "converged": "yes"}', "[]", "1" * 9999],
)
def test_a_quality_summary_is_what_it_must_be_or_nothing(text: str) -> None:
    assert summary.quality(text.encode()) == {}


def test_a_quality_summary_keeps_what_fits() -> None:
    told = {"samples": 3, "converged": True, "final": {"rpy_deg": [1.0, None, 2.0]}, "gaps": [{"t": 1.0}], "x": 1}
    assert summary.quality(json.dumps(told).encode()) == {k: v for k, v in told.items() if k != "x"}
    assert summary.quality(b'{"final": {"rpy_deg": [NaN, 1e999, -Infinity]}}') == {
        "final": {"rpy_deg": [None, None, None]}
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = " + "[" * 5000, "nested"),
        ("x = " + "[" * (DEPTH + 1) + "]" * (DEPTH + 1), "nested"),
        ("a." * 40_000 + "b = 1", "parts"),
        ('"a" . ' * 4000 + "b = 1", "parts"),
        ("#" * (LIMIT + 1), "bytes long"),
    ],
)
def test_toml_that_is_deep_or_long_is_refused_at_once(text: str, words: str) -> None:
    """Python's own parser ends in a traceback, or takes minutes over a key of many parts."""
    with pytest.raises(ValueError, match=words):
        parse(text.encode())
    with pytest.raises(ValueError, match=words):
        effects_file.parse(text.encode())


def test_effects_without_end_are_refused() -> None:
    """Before a correlation of all their states is made."""
    state = '[[effect.state]]\nname = "k"\nunit = "mg"\nmean = 0.0\nsd = 1.0\n'
    one = '[[effect]]\neffect = "step"\nchannels = ["ax"]\ninclude_as = "A"\n'
    for many in (one * 300, one + state * 300):
        with pytest.raises(ValueError, match="the most of each is 256"):
            effects_file.parse(f"version = 1\n{many}".encode())


def head_of(shape: str, kind: str = "<f8") -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def npz(**arrays: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in arrays.items():
            archive.writestr(f"{name}.npy", data)
    return stream.getvalue()


def saved(array: Any) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


T, THREE = saved(np.arange(9.0) / 10.0), saved(np.zeros((9, 3)))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (npz(t=head_of("(10000000000000,)"), gyro=THREE, accel=THREE), "more than the file holds"),
        (npz(t=head_of("(-1,)"), gyro=THREE, accel=THREE), "NPZ"),
        (npz(t=saved(np.array([print, 1], object)), gyro=THREE, accel=THREE), "objects"),
        (npz(t=T, gyro=head_of("(9, 3)", "|O") + b"cos\nsystem\n", accel=THREE), "objects"),
        (npz(t=T, gyro=head_of("(9, 3), (((((", "<f8"), accel=THREE), "NPZ"),
        (npz(t=T, gyro=THREE, accel=saved(np.full((9, 3), 1e308))), "beyond"),
    ],
)
def test_an_npz_made_to_harm_is_refused_with_exit_code_3(data: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    path.write_bytes(data)
    done = imutui("import", path, "-o", tmp_path / "b.mcap", check=3)
    assert words in done.stderr
    assert len(done.stderr) < 2000


def test_an_npz_that_unpacks_to_more_than_the_limit_is_refused_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Zeros pack to a thousandth: what it says is looked at first."""
    monkeypatch.setattr(array_files, "LIMIT", 2**20)
    n = 2**20 // 8
    path = tmp_path / "a.npz"
    path.write_bytes(npz(t=saved(np.arange(float(n))), gyro=saved(np.zeros((n, 3))), accel=saved(np.zeros((n, 3)))))
    assert path.stat().st_size < 400_000
    with pytest.raises(ImportDataError, match="split the recording"):
        load(path)


def test_a_device_is_no_file_to_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would be read for ever; whoever named it is told, and a file that is too long is not read to its end."""
    monkeypatch.chdir(tmp_path)
    for name in ("a.csv", "a.npz", "a.toml"):
        Path(name).symlink_to("/dev/zero")
    imutui("import", "a.csv", "-o", "b.mcap", check=3)
    imutui("import", "a.npz", "-o", "b.mcap", check=3)
    imutui("import", "x.npz", "--reference", "a.csv", "-o", "b.mcap", check=3)
    imutui("profile", "a.toml", check=3)
    assert "device" in imutui("virtual", "--scenario", "a.toml", check=3).stderr
    assert "device" in imutui("replay", "--effects", "a.toml", "x.mcap", check=2).stderr
    Path("long").write_bytes(bytes(100))
    with pytest.raises(ValueError, match="longer than 99 bytes"):
        outside_file.read(Path("long"), 99)
    assert outside_file.read(Path("long"), 100) == bytes(100)


@pytest.mark.parametrize("layout", ["lz4", "uncompressed", "no chunks"])
def test_what_the_end_of_an_unfinished_log_does_not_say_is_not_known(layout: str, tmp_path: Path) -> None:
    """It was listed with one sample and no duration: the last chunk is found by the name of its compression, zstd."""
    source = rewritten(recorded(tmp_path / "a.mcap", 4), tmp_path / "b.mcap", **{"chunk_size": 9000} | LAYOUTS[layout])
    source.write_bytes(source.read_bytes()[: source.stat().st_size // 2])
    found = brief(source)
    assert (found.state, found.samples, found.seconds) == ("unfinished", None, None)
    assert found.started is not None
