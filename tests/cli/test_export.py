"""`imutui export`: names, units, axes and sign of `import`, the same bits in every format, in pieces."""

import csv
import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers.commands import imutui, imutui_json
from helpers.logs import foreign
from helpers.paths import SAMPLE

from filters.motion.reference import Trajectory
from imutui.jobs.export import export
from imutui.logbook import pieces, reader, reference_file
from imutui.logbook.export import samples
from imutui.logbook.samples import Samples

FORMATS = ("csv", "npz", "parquet")
VECTORS = ("gyro", "accel", "ang", "rate")


def made(tmp_path: Path, *options: str, log: Path = SAMPLE) -> dict[str, dict[str, Any]]:
    """A log in each format, as csv, numpy and pyarrow read it, a column a component."""
    for kind in FORMATS:
        imutui("export", log, "-o", tmp_path / f"a.{kind}", *options)
    with (tmp_path / "a.csv").open(newline="") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    archive = np.load(tmp_path / "a.npz")
    flat: dict[str, Any] = {}
    for name in archive.files:
        if name in VECTORS:
            flat |= {f"{name}_{axis}": archive[name][:, i] for i, axis in enumerate("xyz")}
        elif name not in ("units", "about"):
            flat[name] = archive[name]
    parquet = pq.read_table(tmp_path / "a.parquet")
    return {
        "csv": {name: [row[name] for row in rows] for name in rows[0]},
        "npz": {name: column.tolist() for name, column in flat.items()},
        "parquet": {name: parquet[name].to_pylist() for name in parquet.column_names},
    }


def assert_alike(found: dict[str, dict[str, Any]]) -> None:
    """The same columns in the same order, the same numbers to the last bit."""
    assert list(found["csv"]) == list(found["npz"]) == list(found["parquet"])
    for name, column in found["npz"].items():
        if isinstance(column[0], float):
            assert np.array_equal(column, found["parquet"][name], equal_nan=True), name
        else:
            assert column == found["parquet"][name], name
        texts = found["csv"][name]
        assert texts == [str(value) for value in column] if isinstance(column[0], str | bool) else True
        if isinstance(column[0], float):
            assert np.array_equal(np.array(texts, float), column, equal_nan=True), name
        elif isinstance(column[0], int) and not isinstance(column[0], bool):
            assert list(map(int, texts)) == column


def samples_of(log: Path) -> Samples:
    return reader.read(log).samples


def test_samples_are_the_same_to_the_last_bit_in_every_format(tmp_path: Path) -> None:
    """Names, units, the instrument's axes and sign: Z reads +1 g of a level unit, though specific force is -g."""
    found = made(tmp_path)
    assert_alike(found)
    vectors = [f"{name}_{axis}" for name in ("gyro", "accel") for axis in "xyz"]
    assert list(found["csv"]) == ["t", *vectors, "temp"]
    log = samples_of(SAMPLE)
    assert len(found["npz"]["t"]) == log.stamp_ns.size
    assert np.mean(found["npz"]["accel_z"]) == pytest.approx(1.0, abs=0.03)
    assert found["npz"]["t"] == pytest.approx(reader.read(SAMPLE).seconds(), abs=1e-12)
    assert found["npz"]["temp"] == log.degc.tolist()
    assert np.allclose(found["npz"]["gyro_x"], np.rad2deg(log.gyro[:, 0]), rtol=1e-15)


def test_every_format_says_the_units(tmp_path: Path) -> None:
    made(tmp_path)
    head = (tmp_path / "a.csv").read_text().splitlines()[0]
    assert head == "# units: t s, gyro deg/s, accel g, temp degC"
    archive = np.load(tmp_path / "a.npz")
    assert json.loads(str(archive["units"])) == {"t": "s", "gyro": "deg/s", "accel": "g", "temp": "degC"}
    assert json.loads(str(archive["about"]))["kind"] == "simulated"
    schema = pq.read_schema(tmp_path / "a.parquet")
    assert schema.field("gyro_y").metadata == {b"unit": b"deg/s"}
    assert schema.metadata[b"imutui.kind"] == b"simulated"


@pytest.mark.parametrize("kind", FORMATS)
def test_import_reads_back_what_was_exported(tmp_path: Path, kind: str) -> None:
    told = imutui("export", SAMPLE, "-o", tmp_path / f"a.{kind}").stdout
    line = shlex.split(told.splitlines()[-1].removeprefix("To read it back: imutui "))
    back = tmp_path / "back.mcap"
    imutui(*(back if part == "LOG.mcap" else part for part in line))
    log = reader.read(back)
    first, again = samples_of(SAMPLE), log.samples
    assert np.array_equal(first.stamp_ns - first.stamp_ns[0], again.stamp_ns - again.stamp_ns[0])
    assert np.array_equal(first.degc, again.degc)
    assert np.array_equal(first.gyro, again.gyro)  # a unit's samples were made of deg/s and g
    assert np.array_equal(first.accel, again.accel)
    assert (log.info.reference, log.info.kind, log.info.accel_sign) == ("level", "simulated", -1)
    # an imported log comes back with the same bits, and a second time with the same file
    twice = tmp_path / f"b.{kind}"
    imutui("export", back, "-o", twice)
    line = ["import", str(twice), *line[2:]]
    imutui(*(tmp_path / "third.mcap" if part == "LOG.mcap" else part for part in line))
    third = reader.read(tmp_path / "third.mcap")
    assert np.array_equal(again.gyro, third.samples.gyro)
    assert np.array_equal(again.accel, third.samples.accel)
    assert log.info.log_id == third.info.log_id


def turned_recording(tmp_path: Path, n: int = 400) -> Path:
    """A recording of a table that turns, mounted on its side with the other sign, as a log."""
    t = 5.0 + np.arange(n) / 20.0
    angle = np.where(t < 12.0, 0.0, np.minimum((t - 12.0) * 30.0, 90.0))
    rng = np.random.default_rng(2)
    gyro, accel = rng.standard_normal((n, 3)), rng.standard_normal((n, 3)) * 0.01 + [0.0, 1.0, 0.0]
    ang = np.stack([angle, np.zeros(n), np.zeros(n)], axis=1)
    np.savez(tmp_path / "in.npz", t=t, gyro=gyro, accel=accel, temp=25.0 + t / 10.0, ang=ang)
    log = tmp_path / "turned.mcap"
    flags = ("--accel-sign", "+1", "--mount", "x,-z,y", "--gyro-sign", "1,-1,1", "--kind", "measured")
    imutui("import", tmp_path / "in.npz", "-o", log, *flags)
    return log


def test_a_table_s_motion_travels_too(tmp_path: Path) -> None:
    log = turned_recording(tmp_path)
    source = np.load(tmp_path / "in.npz")
    told = imutui("export", log, "-o", tmp_path / "a.npz").stdout
    archive = np.load(tmp_path / "a.npz")
    for name in ("t", "temp", "ang"):
        assert np.array_equal(archive[name], source[name]), name
    for name in ("gyro", "accel"):  # two readings may have been one sample in SI
        assert np.all(np.abs(archive[name] - source[name]) <= np.spacing(np.abs(source[name]))), name
    line = shlex.split(told.splitlines()[-1].removeprefix("To read it back: imutui "))
    assert Path(line[line.index("--reference") + 1]) == tmp_path / "a.npz.reference.csv"
    imutui(*(tmp_path / "back.mcap" if part == "LOG.mcap" else part for part in line))
    first, again = reader.read(log), reader.read(tmp_path / "back.mcap")
    assert np.array_equal(first.samples.gyro, again.samples.gyro)
    assert np.array_equal(first.samples.accel, again.samples.accel)
    assert first.attachments["reference.csv"] == again.attachments["reference.csv"]
    assert (again.info.mount, again.info.gyro_sign, again.info.clock_s) == ("x,-z,y", "1,-1,1", 5.0)
    # what is beside is not replaced either
    (tmp_path / "a.npz").unlink()
    done = imutui("export", log, "-o", tmp_path / "a.npz", check=2)
    assert "a.npz.reference.csv exists and is left as it is. --force" in done.stderr
    # of a part the trajectory's own time would be another
    imutui("export", log, "-o", tmp_path / "part.csv", "--start", "2", "--end", "3")
    assert not (tmp_path / "part.csv.reference.csv").exists()
    assert (tmp_path / "part.csv").read_text().splitlines()[-1].startswith("8.0,")


def test_a_part_is_cut_by_the_log_s_time(tmp_path: Path) -> None:
    found = made(tmp_path, "--start", "2", "--end", "3")
    assert_alike(found)
    t = reader.read(SAMPLE).seconds()
    assert found["npz"]["t"] == t[(t >= 2.0) & (t <= 3.0)].tolist()
    for cut in (("--start", "1e6"), ("--start", "3", "--end", "2"), ("--start", "2.00001", "--end", "2.00002")):
        done = imutui("export", SAMPLE, "-o", tmp_path / "none.csv", *cut, check=2)
        assert "--start and --end leave" in done.stderr
    assert not list(tmp_path.glob("none*"))


def test_what_a_receiver_and_a_reference_knew_is_exported(tmp_path: Path) -> None:
    n = 200
    t, rng = np.arange(n) / 20.0, np.random.default_rng(4)
    quat = np.full((n, 4), np.nan)
    quat[::10] = rng.standard_normal((n // 10, 4)) * 0.1 + [1.0, 0.0, 0.0, 0.0]
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    place, speed = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    place[5::20] = rng.standard_normal((n // 20, 3)) * 1e-4 + [-23.0, -45.0, 600.0]
    speed[5::20] = rng.standard_normal((n // 20, 3))
    known = {"ref_quat": quat, "gps_pos": place, "gps_vel_ned": speed}
    np.savez(tmp_path / "in.npz", t=t, gyro=rng.standard_normal((n, 3)), accel=rng.standard_normal((n, 3)), **known)
    flags = ("--mount", "x,-y,-z", "--accel-sign", "-1", "--kind", "measured")
    imutui("import", tmp_path / "in.npz", "-o", tmp_path / "in.mcap", *flags)
    imutui("export", tmp_path / "in.mcap", "-o", tmp_path / "a.npz")
    archive = np.load(tmp_path / "a.npz")
    for name, wanted in known.items():  # the trajectory in the log has eight to ten digits
        found = archive[name]
        if name == "ref_quat":
            found = found * np.sign(np.sum(found * wanted, axis=1, keepdims=True))
        assert found == pytest.approx(wanted, abs=1e-5, nan_ok=True), name
    units = json.loads(str(archive["units"]))
    assert (units["gps_pos"], units["gps_vel_ned"]) == ("deg, deg, m", "m/s")
    imutui("import", tmp_path / "a.npz", "-o", tmp_path / "b.mcap", *flags)
    first, again = (motion_of(tmp_path / name) for name in ("in.mcap", "b.mcap"))
    assert np.array_equal(first.t, again.t)
    assert again.values == pytest.approx(first.values, abs=1e-8, nan_ok=True)
    # a part begins with what was known then
    imutui("export", tmp_path / "in.mcap", "-o", tmp_path / "p.npz", "--start", "1.3")
    assert np.isfinite(np.load(tmp_path / "p.npz")["ref_quat"][:, 0]).nonzero()[0][0] == 4


def motion_of(log: Path) -> Trajectory:
    motion = reference_file.parse("reference.csv", reader.read(log).attachments["reference.csv"])
    assert isinstance(motion, Trajectory)
    return motion


def test_another_program_s_log_comes_back_as_a_replay_takes_it(tmp_path: Path) -> None:
    """Its samples are specific force as they stand, so the sign that is told is +1."""
    document = imutui_json("export", foreign(tmp_path / "foreign.mcap"), "-o", tmp_path / "a.csv")
    assert "--accel-sign +1" in document["about"]["import"]
    assert document["about"]["log_sha256"] == reader.sha256(tmp_path / "foreign.mcap")
    accel = np.genfromtxt(tmp_path / "a.csv", delimiter=",", skip_header=csv_head(tmp_path / "a.csv"))[:, 4:7]
    log = reader.read(tmp_path / "foreign.mcap")
    assert accel == pytest.approx(log.samples.accel / log.info.g_unit, rel=1e-15)


def csv_head(path: Path) -> int:
    """Lines before the numbers."""
    return 1 + sum(line.startswith("#") for line in path.read_text().splitlines())


@pytest.mark.parametrize("kind", FORMATS)
def test_json_says_what_was_made(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"a.{kind}"
    document = imutui_json("export", SAMPLE, "-o", path)
    assert (document["format"], document["rows"], document["output"]) == (kind, 520, str(path))
    assert document["units"]["accel"] == "g"
    assert document["reference"] is None


def test_what_cannot_be_exported_is_refused_in_words(tmp_path: Path) -> None:
    there = tmp_path / "there.csv"
    there.write_text("mine")
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "text.mcap").write_text("no log at all, by far")
    for log, options, code, words in (
        (SAMPLE, ("-o", str(there)), 2, "--force replaces it"),
        (SAMPLE, ("-o", str(tmp_path / "a.xlsx")), 2, "csv, npz, parquet"),
        (SAMPLE, ("-o", str(tmp_path / "a"), "--format", "hdf5"), 2, "csv, npz, parquet"),
        (SAMPLE, ("-o", str(tmp_path / "no" / "a.csv")), 2, "mkdir -p"),
        (tmp_path / "gone.mcap", ("-o", str(tmp_path / "a.csv")), 3, "no such file"),
        (tmp_path / "empty.mcap", ("-o", str(tmp_path / "a.csv")), 3, "empty"),
        (tmp_path / "text.mcap", ("-o", str(tmp_path / "a.csv")), 3, "not an MCAP"),
    ):
        assert words in " ".join(imutui("export", log, *options, check=code).stderr.split())
    assert there.read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty.mcap", "text.mcap", "there.csv"]


def test_parquet_without_pyarrow_says_what_to_type(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from imutui.logbook import parquet

    monkeypatch.setattr(parquet, "available", lambda: False)
    done = imutui("export", SAMPLE, "-o", tmp_path / "a.parquet", check=2)
    assert "pip install" in done.stderr
    assert "parquet" in done.stderr


def test_a_damaged_log_is_exported_up_to_its_damage(tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(SAMPLE.read_bytes()[:60_000])
    done = imutui("export", cut, "-o", tmp_path / "a.npz", check=1)
    assert "All before that is exported" in done.stderr
    assert np.load(tmp_path / "a.npz")["t"].size == len(samples_of(cut))


@pytest.mark.parametrize("rows", [1, 60, 10**6])
def test_pieces_of_any_size_are_the_whole(tmp_path: Path, rows: int) -> None:
    for log in (SAMPLE, turned_recording(tmp_path)):
        whole = reader.read(log)
        known = pieces.outline(log, rows)
        found = [piece for piece, _ in pieces.pieces(known, rows)]
        assert max(map(len, found)) <= max(rows, len(whole.samples)) + 2000
        for name in ("stamp_ns", "gyro", "accel", "degc", "valid"):
            column = np.concatenate([getattr(piece, name) for piece in found])
            assert np.array_equal(column, getattr(whole.samples, name)), name
        assert (known.samples, known.first_ns) == (len(whole.samples), whole.first_ns)
        assert known.log.events == whole.events


def test_what_is_in_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    largest: dict[int, int] = {}
    for n in (2000, 16000):
        folder = tmp_path / str(n)
        folder.mkdir()
        log = turned_recording(folder, n)
        table = samples.table(pieces.outline(log), rows=500)
        lengths = [len(block["t"]) for block in table.blocks()]
        assert sum(lengths) == n
        largest[n] = max(lengths)
    assert largest[16000] <= 1.5 * largest[2000]
    assert largest[16000] < 4000


def test_a_permission_or_a_full_disk_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from imutui.logbook.export import formats

    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(formats, "write", full)
    with pytest.raises(OSError, match="No space"):
        export(SAMPLE, tmp_path / "a.csv", "csv")
    assert not list(tmp_path.iterdir())


def test_samples_without_a_reading_are_left_out_with_a_word(tmp_path: Path) -> None:
    gyro = np.random.default_rng(1).normal(0.0, 0.05, (400, 3))
    gyro[7:10] = np.nan
    np.savez(tmp_path / "a.npz", t=np.arange(400) / 100.0, gyro=gyro, accel=np.tile([0.0, 0.0, 1.0], (400, 1)))
    imutui("import", tmp_path / "a.npz", "-o", tmp_path / "a.mcap")
    document = imutui_json("export", tmp_path / "a.mcap", "-o", tmp_path / "b.csv")
    assert (document["rows"], document["assumed"]) == (397, ["samples without a reading are left out: 3"])
