"""Import of what a recording or a file beside it says of the motion; the command itself, in this process."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import ros_messages
from scipy.spatial.transform import Rotation

from filters import attitude
from imutui import cli
from imutui.logbook import (
    import_reference,
    importer,
    reader,
    schemas,
    trajectory_file,
)
from imutui.logbook.importer import ImportDataError
from imutui.logbook.reader import Log

N = 200
Import = Callable[..., tuple[int, str]]


def arrays(**changes: Any) -> dict[str, Any]:
    """A still, level recording at 20 Hz with the Crossbow's sign."""
    level = np.tile([0.0, 0.0, 0.998], (N, 1))
    return {"t": 50.0 + np.arange(N) / 20.0, "gyro": np.zeros((N, 3)), "accel": level} | changes


@pytest.fixture
def imported(home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Import:
    """Save arrays as a.npz, import them as a.mcap; exit code and stderr."""

    def call(changes: dict[str, Any], *flags: str) -> tuple[int, str]:
        np.savez(home / "a.npz", **arrays(**changes))
        monkeypatch.setattr(sys, "argv", ["imutui", "import", "a.npz", "-o", "a.mcap", "--force", *flags])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return int(ended.value.code or 0), capsys.readouterr().err

    return call


def quaternion(C: np.ndarray) -> np.ndarray:
    """w, x, y, z of a rotation by less than half a turn."""
    w = np.sqrt(1.0 + np.trace(C)) / 2.0
    return np.array([w, *np.array([C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]]) / (4.0 * w)])


def held(log: Log) -> trajectory_file.Trajectory:
    return trajectory_file.parse(log.attachments["reference.csv"].decode(), "reference.csv")


def messages(path: Path) -> list[Any]:
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as bag:
        return [
            ros_messages.decode(schemas.TYPES[schemas.REFERENCE], bytes(data))
            for connection, _, data in bag.messages()
            if connection.topic == schemas.REFERENCE
        ]


def test_table_angles_become_roll_pitch_yaw_of_the_same_attitude(home: Path, imported: Import) -> None:
    """C_nb = Rx(outer) Ry(middle) Rz(inner), at rest where the table stands; no row where an angle is unknown."""
    rng = np.random.default_rng(1)
    ang, rate = rng.uniform(-80.0, 80.0, (N, 3)), rng.normal(size=(N, 3))
    ang[10:20] = np.nan
    assert imported({"ang": ang, "rate": rate})[0] == 0
    log = reader.read(home / "a.mcap")
    assert (log.info.reference, log.reference) == ("trajectory", "trajectory")
    kept = np.r_[0:10, 20:N]
    assert np.allclose(held(log).t, kept / 20.0, atol=1e-9)
    for row, angles in zip(held(log).values, ang[kept], strict=True):
        C_nb = Rotation.from_euler("XYZ", angles, degrees=True).as_matrix()
        assert np.allclose(attitude.from_rpy(*row[6:]), C_nb, atol=1e-9)
    site = log.info.site()
    assert np.allclose(held(log).values[:, :6], [site.latitude, site.longitude, site.height, 0.0, 0.0, 0.0], atol=1e-9)
    sent = messages(home / "a.mcap")
    assert np.array_equal([m.angles_deg for m in sent], ang[np.r_[0:11, 11:N]], equal_nan=True)
    assert np.array_equal([m.rates_dps for m in sent], rate)


@pytest.mark.parametrize("mount", ["x,y,z", "x,-y,-z", "y,-x,z"])
def test_a_quaternion_of_the_instrument_becomes_the_attitude_of_the_body(
    home: Path, imported: Import, mount: str
) -> None:
    """East-north-up to north-east-down, instrument to body axes: gravity read by the unit points down in both."""
    C_nb = attitude.from_rpy(0.2, -0.3, 1.1)
    enu = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    M = importer.SessionInfo(mount=mount).axes().mount
    quat = np.tile(quaternion(enu @ C_nb @ M), (N, 1))
    quat[:5] = np.nan
    quat[5:7] = 0.0
    assert imported({"ref_quat": quat}, "--mount", mount, "--accel-sign", "+1")[0] == 0
    log = reader.read(home / "a.mcap")
    assert np.allclose(held(log).values[:, 6:], [0.2, -0.3, 1.1], atol=1e-9)
    assert held(log).t[0] == pytest.approx(7 / 20.0)
    assert all(np.isnan(m.angles_deg).all() and m.kind == "trajectory" for m in messages(home / "a.mcap"))


def test_a_receivers_fix_is_one_row_when_it_is_new(home: Path, imported: Import) -> None:
    """Not the repeats, not the one of unknown age at the start, not zeros, not NaN; velocity alone will do."""
    position = np.repeat([[45.0, -93.0, 0.0], [45.1, -93.1, 10.0], [0.0] * 3, [45.2, -93.2, 20.0], [np.nan] * 3], 40, 0)
    velocity = np.repeat([[0.0] * 3, [1.0, 2.0, 3.0], [0.0] * 3, [1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 40, 0)
    assert imported({"gps_pos": position, "gps_vel_ned": velocity})[0] == 0
    read = held(reader.read(home / "a.mcap"))
    assert read.t.tolist() == [2.0, 6.0, 8.0]
    assert np.allclose(np.rad2deg(read.values[:2, :2]), [[45.1, -93.1], [45.2, -93.2]])
    assert read.values[:2, 2].tolist() == [10.0, 20.0]
    assert np.isnan(read.values[2, :3]).all()
    assert read.values[:, 3:6].tolist() == [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert np.isnan(read.values[:, 6:]).all()


def test_a_reference_named_on_the_command_line_wins_and_the_arrays_are_named_as_left(
    home: Path, imported: Import
) -> None:
    code, said = imported({"ang": np.zeros((N, 3)), "counts": np.zeros(3)}, "--reference", "level")
    assert code == 0
    assert "ang, counts" in said
    log = reader.read(home / "a.mcap")
    assert log.info.reference == "level"
    assert "reference.csv" not in log.attachments


def test_a_trajectorys_file_travels_in_the_log_byte_for_byte(home: Path, imported: Import) -> None:
    text = b"t,lat,lon,h,vn,ve,vd\r\n0,,,,0,0,0\r\n"
    (home / "path.csv").write_bytes(text)
    assert imported({}, "--reference", "path.csv")[0] == 0
    log = reader.read(home / "a.mcap")
    assert (log.info.reference, log.attachments["reference.csv"]) == ("trajectory", text)
    (home / "a.mcap").unlink()
    for content, words in ((b"t,lat\n0,1\n", "`lon`"), (b"\xff\xfe", "text"), (None, "No such file")):
        (home / "path.csv").unlink(missing_ok=True)
        if content is not None:
            (home / "path.csv").write_bytes(content)
        code, said = imported({}, "--reference", "path.csv")
        assert (code, words in said, "path.csv" in said) == (3, True, True), said
        assert not (home / "a.mcap").exists()


def test_a_tables_profile_travels_in_the_log(home: Path, imported: Import) -> None:
    toml = b"[[segment]]\nkind = 'dwell'\nangles_deg = [0, 0, 0]\nseconds = 5\n"
    csv = b"t,outer,middle,inner\n0,0,0,0\n1,0,0,10\n"
    for name, content in (("table.toml", toml), ("table.csv", csv)):
        (home / name).write_bytes(content)
        code, said = imported({}, "--reference", name)
        assert code == 0, said
        log = reader.read(home / "a.mcap")
        assert log.info.reference == log.reference == "profile"
        assert log.attachments["reference" + Path(name).suffix] == content
    (home / "table.toml").write_text("[[segment")
    code, said = imported({}, "--reference", "table.toml")
    assert code == 3
    assert "table.toml" in said


BAD: dict[str, tuple[dict[str, Any], tuple[str, ...], int, tuple[str, ...]]] = {
    "long quaternion": ({"ref_quat": np.full((N, 4), 2.0)}, (), 3, ("`ref_quat`", "row 0", "length 4")),
    "mirrored axes": (
        {"ref_quat": np.full((N, 4), 0.5)},
        ("--mount", "x,y,-z", "--gyro-sign", "-1", "--accel-sign", "+1"),
        3,
        ("`ref_quat`", "left-handed"),
    ),
    "latitude": ({"gps_pos": np.full((N, 3), 100.0)}, (), 3, ("`gps_pos`", "latitude 100", "row 0")),
    "shape": ({"ang": np.zeros((N, 2))}, (), 3, ("`ang`", "(N, 3)")),
    "length": ({"gps_vel_ned": np.zeros((N - 1, 3))}, (), 3, ("lengths differ", "gps_vel_ned")),
    "nothing known": (
        {"ref_quat": np.full((N, 4), np.nan)},
        ("--reference", "trajectory"),
        3,
        ("ref_quat", "FILE.csv"),
    ),
    "no profile": ({}, ("--reference", "profile"), 2, ("FILE", "table.toml")),
    "stamps": ({}, ("--stamps", "host"), 2, ("--stamps", "arrival")),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_known_is_refused_in_words(home: Path, imported: Import, case: str) -> None:
    changes, flags, wanted, words = BAD[case]
    code, said = imported(changes, *flags)
    assert code == wanted
    assert all(word in said.replace("--reference table.toml", "FILE table.toml") for word in words), said
    assert not (home / "a.mcap").exists()


def test_arrays_that_know_nothing_leave_the_reference_as_configured(home: Path, imported: Import) -> None:
    code, said = imported({"ref_quat": np.full((N, 4), np.nan)})
    assert code == 0
    assert "ref_quat" in said
    assert reader.read(home / "a.mcap").info.reference == "level"


def test_a_moving_recording_with_a_trajectory_needs_no_gravity_check(home: Path, imported: Import) -> None:
    rng = np.random.default_rng(1)
    moved = {"gyro": rng.normal(0, 50, (N, 3)), "accel": rng.normal(0, 1, (N, 3)), "ang": rng.normal(0, 9, (N, 3))}
    assert "warning" not in imported(moved)[1]
    assert "the unit moves" in imported(moved, "--reference", "level")[1]


def test_bursts_are_named_and_their_instants_rebuilt_when_asked(home: Path, imported: Import) -> None:
    t = np.arange(N) // 5 * 0.25 + np.arange(N) % 5 * 0.001
    code, said = imported({"t": t})
    assert code == 0
    assert "--stamps arrival" in said
    assert np.allclose(reader.read(home / "a.mcap").seconds(), t - t[0], atol=1e-9)
    code, said = imported({"t": t}, "--stamps", "arrival")
    assert code == 0
    assert "look like arrival" not in said
    assert "late by" in said
    log = reader.read(home / "a.mcap")
    assert np.ptp(np.diff(log.seconds())) < 1e-8
    assert "arrival" in log.info.stamps


def test_optional_vectors_are_columns_of_a_csv_too(home: Path) -> None:
    a = arrays()
    quat = np.tile([1.0, 0.0, 0.0, 0.0], (N, 1))
    table = np.column_stack([a["t"], a["gyro"], a["accel"], np.ones((N, 3)), quat])
    vectors = [f"{v}_{x}" for v in ("gyro", "accel", "ang") for x in "xyz"] + [f"ref_quat_{x}" for x in "wxyz"]
    np.savetxt(home / "a.csv", table, delimiter=",", header=",".join(["t", *vectors]), comments="")
    recording = importer.load(home / "a.csv")
    assert np.array_equal(recording.known["ang"], np.ones((N, 3)))
    assert np.array_equal(recording.known["ref_quat"], quat)
    assert recording.not_imported == ()
    with pytest.raises(ImportDataError, match="length 2"):
        import_reference.from_arrays(recording.t, {"ref_quat": 2.0 * quat}, np.eye(3))
