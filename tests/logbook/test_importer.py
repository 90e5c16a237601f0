from pathlib import Path

import numpy as np
import pytest

from filters.imu import AxisMap, parse_mount
from imutui.logbook import SessionInfo, reader
from imutui.logbook.importing import recording as recordings
from imutui.logbook.importing.table import Asked, ImportDataError
from imutui.logbook.importing.write import write

N = 40


def arrays(**changes: np.ndarray) -> dict[str, np.ndarray]:
    """A still, level recording with the Crossbow's sign."""
    rng = np.random.default_rng(1)
    base = {
        "t": np.arange(N) / 20.0,
        "gyro": rng.normal(size=(N, 3)) * 0.1,
        "accel": rng.normal(size=(N, 3)) * 1e-3 + [0.0, 0.0, 0.998],
        "temp": np.full(N, 25.0),
    }
    return base | changes


def saved(path: Path, **changes: np.ndarray) -> Path:
    np.savez(path, **arrays(**changes))
    return path


def test_what_is_imported_is_what_the_recording_holds(tmp_path: Path) -> None:
    source = saved(tmp_path / "a.npz")
    info = SessionInfo(accel_sign=1, mount="x,-y,-z")
    write(recordings.load(source), info, tmp_path / "a.mcap", overwrite=False)
    log = reader.read(tmp_path / "a.mcap")
    held, axes = arrays(), AxisMap(parse_mount("x,-y,-z"), 1)
    assert np.allclose(log.seconds(), held["t"], atol=1e-9)
    assert np.allclose(np.rad2deg(axes.gyro_to_instrument(log.samples.gyro)), held["gyro"], atol=1e-12)
    assert np.allclose(axes.accel_to_instrument(log.samples.accel) / 9.80665, held["accel"], atol=1e-12)
    assert np.allclose(log.samples.degc, 25.0)
    assert log.info.sampling == "imported"
    assert log.info.rate_hz == pytest.approx(20.0)
    assert log.finished


def test_a_csv_says_the_same_as_an_npz(tmp_path: Path) -> None:
    a = arrays()
    table = np.column_stack([a["t"], a["gyro"], a["accel"], a["temp"]])
    names = "t,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,temp"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=names, comments="", fmt="%.17g")
    from_csv, from_npz = (recordings.load(path).whole() for path in (tmp_path / "a.csv", saved(tmp_path / "a.npz")))
    assert np.array_equal(from_csv.gyro_dps, from_npz.gyro_dps)
    assert np.array_equal(from_csv.accel_g, from_npz.accel_g)
    assert np.array_equal(from_csv.t, from_npz.t)


BAD = {
    "unequal lengths": ({"gyro": np.zeros((N - 3, 3))}, r"lengths differ.*from row 37"),
    "a stamp of its own": ({"t": np.r_[np.arange(20), 5.0, np.arange(21, N)] / 20.0}, r"row 20 .*earlier.*--drop 20"),
    "wrong shape": ({"accel": np.zeros((N, 2))}, r"`accel` has shape"),
    "text": ({"gyro": np.full((N, 3), "a")}, r"`gyro` has shape"),
    "one sample": ({k: v[:1] for k, v in arrays().items()}, r"at least two"),
}


@pytest.mark.parametrize("case", BAD)
def test_data_that_cannot_be_imported_are_named_with_their_row(tmp_path: Path, case: str) -> None:
    changes, words = BAD[case]
    with pytest.raises(ImportDataError, match=words) as caught:
        recordings.load(saved(tmp_path / "bad.npz", **changes))
    assert "bad.npz" in str(caught.value)


def test_a_misspelt_name_is_an_error_that_lists_what_is_there(tmp_path: Path) -> None:
    a = arrays()
    a["gryo"] = a.pop("gyro")
    np.savez(tmp_path / "a.npz", **a)
    with pytest.raises(ImportDataError, match=r"no `gyro`.*accel, gryo, t|gryo"):
        recordings.load(tmp_path / "a.npz")


def test_other_arrays_are_named_and_left(tmp_path: Path) -> None:
    assert recordings.load(saved(tmp_path / "a.npz", counts=np.zeros(3))).not_imported == ("counts",)


def test_a_level_unit_upside_down_is_an_error_that_names_both_cures(tmp_path: Path) -> None:
    """+1 g on Z with sign +1 would be upside down: sign or mounting, and a still log can't tell."""
    r = recordings.load(saved(tmp_path / "a.npz"))
    with pytest.raises(ImportDataError, match="its z is up") as caught:
        recordings.check_gravity(r, SessionInfo(accel_sign=1))
    flags = [flags for _, flags in caught.value.cures]
    assert flags == [("--mount", "x,-y,-z"), ("--accel-sign", "-1"), ("--reference", "gravity")]
    assert recordings.check_gravity(r, SessionInfo(accel_sign=-1)) is None
    assert recordings.check_gravity(r, SessionInfo(accel_sign=1, reference="gravity")) is None


def test_a_magnitude_that_is_off_is_a_warning_that_names_tilt_bias_and_scale(tmp_path: Path) -> None:
    """1.05 g is more than 12 mg + 1 % from gravity."""
    a = arrays()["accel"] * 1.05
    warning = recordings.check_gravity(recordings.load(saved(tmp_path / "a.npz", accel=a)), SessionInfo())
    assert warning is not None
    assert all(word in warning for word in ("tilt", "bias", "scale"))


def test_a_part_starts_and_ends_where_it_was_asked(tmp_path: Path) -> None:
    r = recordings.load(saved(tmp_path / "a.npz", t=100.0 + np.arange(N) / 20.0), Asked(start=0.5, end=1.0))
    assert (r.clock_s, r.duration_s, r.samples) == (100.5, 0.5, 11)
    with pytest.raises(ImportDataError, match="fewer than two"):
        recordings.load(saved(tmp_path / "b.npz"), Asked(start=100.0))
