"""Recordings that lack channels, NaN throughout: said, and left out of check, replay and trace."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.commands import imutui, imutui_json
from helpers.paths import DATA
from helpers.traces import arrays

from filters.imu import AxisMap, parse_mount
from imutui.jobs import replay_input
from imutui.logbook import reader

CHANNELS = ("gx", "gy", "gz", "ax", "ay", "az")


def without(path: Path, *channels: str, moving: bool = False, seconds: float = 120.0, slope: float = 0.0) -> Path:
    given = arrays(seconds, 20.0, moving=moving, seed=5)
    given["gyro"][:, 1] += slope * (given["temp"] - 25.0)
    for name in channels:
        c = CHANNELS.index(name)
        given["gyro" if c < 3 else "accel"][:, c % 3] = np.nan
    kept = given if moving else {k: given[k] for k in ("t", "gyro", "accel", "temp")}
    np.savez(path.with_suffix(".npz"), **kept)
    return path.with_suffix(".npz")


def log_of(path: Path, *channels: str, flags: tuple[str, ...] = (), **how: Any) -> tuple[Path, str]:
    source = without(path, *channels, **how)
    done = imutui("import", source, "-o", path, *flags)
    return path, done.stderr


def test_import_says_which_channels_are_missing_and_the_log_keeps_them_so(tmp_path: Path) -> None:
    flags = ("--mount", "y,-x,z", "--reference", "gravity")
    log, said = log_of(tmp_path / "a.mcap", "gy", "ax", flags=flags)
    assert "gy, ax" in said
    held = reader.read(log)
    axes = AxisMap(parse_mount("y,-x,z"))
    assert np.isnan(axes.gyro_to_instrument(held.samples.gyro)).all(axis=0).tolist() == [False, True, False]
    assert np.isnan(axes.accel_to_instrument(held.samples.accel)).all(axis=0).tolist() == [True, False, False]
    assert held.unread.sum() == 2


def test_info_and_check_say_so_and_check_finds_nothing_wrong(tmp_path: Path) -> None:
    log, _ = log_of(tmp_path / "a.mcap", "gx", "az")
    assert imutui_json("info", log)["unread_channels"] == ["gx", "az"]
    assert "gx, az" in imutui("info", log).stdout
    told = imutui_json("check", log)
    assert told["fine"]
    assert any("gx, az" in note for note in told["notes"])


@pytest.mark.parametrize("flags", [("--reference", "level"), ("--reference", "gravity")])
@pytest.mark.parametrize("lacks", [("gx",), ("az",), ("gz", "ax")])
def test_replay_gives_no_bias_of_a_missing_channel_and_the_others_as_they_were(
    tmp_path: Path, lacks: tuple[str, ...], flags: tuple[str, ...]
) -> None:
    whole = imutui_json("replay", log_of(tmp_path / "whole.mcap", flags=flags)[0], check=None)
    part = imutui_json("replay", log_of(tmp_path / "part.mcap", *lacks, flags=flags)[0], check=None)
    for c, name in enumerate(CHANNELS):
        field, k = ("gyro_bias_dps" if c < 3 else "accel_bias_mg"), c % 3
        if name in lacks:
            assert part["final"][field][k] is None
            assert part["sd"][field][k] is None
            assert f"{'gyro' if c < 3 else 'accel'}_bias_{'xyz'[k]}" in part["unobservable"]
            noise = part["noise"]["gyro_arw_deg_sqrt_h" if c < 3 else "accel_vrw_mps_sqrt_h"]
            assert noise[k] is None
        elif whole["final"][field][k] is not None:
            assert part["final"][field][k] == pytest.approx(whole["final"][field][k], abs=0.1 * whole["sd"][field][k])
    assert len(part["unobservable"]) == len(set(whole["unobservable"]) | set(part["unobservable"]))


def test_noise_measured_on_the_log_is_that_of_the_channels_there(tmp_path: Path) -> None:
    """One that is missing borrows from its kind, so that the covariance stays positive."""
    log, _ = log_of(tmp_path / "a.mcap", "gy")
    told = imutui_json("replay", log, "--set", "filter.noise=log", check=None)
    used = told["noise"]["used"]["gyro_arw_deg_sqrt_h"]
    assert used[1] == pytest.approx(max(used[0], used[2]))
    assert told["final"]["gyro_bias_dps"][1] is None


def test_what_cannot_be_filled_is_refused_with_the_way_out(tmp_path: Path) -> None:
    moving, _ = log_of(tmp_path / "m.mcap", "gx", moving=True)
    said = imutui("replay", moving, check=2).stderr
    assert "gx" in said
    assert "imutui trace" in said
    two, _ = log_of(tmp_path / "t.mcap", "ax", "az", flags=("--reference", "gravity"))
    assert "--reference level" in imutui("replay", two, check=2).stderr
    source = without(tmp_path / "n.mcap", *CHANNELS)
    assert "any channel" in imutui("import", source, "-o", tmp_path / "n.mcap", check=3).stderr


def test_an_accelerometer_is_made_up_to_gravity_only_where_that_is_one_way() -> None:
    """Down it is upright; to the side it is nothing; a tilt that may be either way is refused."""
    assert replay_input.level_force(np.array([0.1, 0.0, np.nan]), 9.8)[2] == pytest.approx(-9.8, abs=1e-3)
    assert replay_input.level_force(np.array([np.nan, 0.1, -9.8]), 9.8)[0] == 0.0
    with pytest.raises(ValueError, match="table's x"):
        replay_input.level_force(np.array([np.nan, 0.0, -7.0]), 9.8)


@pytest.mark.parametrize("row", [0, 700])
def test_a_sample_that_misses_a_channel_is_no_reading_and_so_are_few_only(tmp_path: Path, row: int) -> None:
    given = arrays(60.0, 20.0, moving=False)
    given["accel"][:, 0] = np.nan
    given["gyro"][row, 2] = np.nan
    np.savez(tmp_path / "a.npz", **given)
    imutui("import", tmp_path / "a.npz", "-o", tmp_path / "a.mcap")
    assert np.flatnonzero(~reader.read(tmp_path / "a.mcap").samples.valid).tolist() == [row]
    given["gyro"][row, 2] = 0.0
    given["accel"][7, 0] = 0.0
    np.savez(tmp_path / "b.npz", **given)
    said = imutui("import", tmp_path / "b.npz", "-o", tmp_path / "b.mcap", check=3).stderr
    assert "1200 of 1201 rows lack a reading" in said


def test_a_csv_with_an_empty_column_lacks_that_channel(tmp_path: Path) -> None:
    given = arrays(60.0, 20.0, moving=False)
    rows = ["t,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,temp"]
    for k in range(given["t"].size):
        g, a = given["gyro"][k], given["accel"][k]
        rows.append(f"{given['t'][k]},{g[0]},,{g[2]},{a[0]},{a[1]},{a[2]},")
    (tmp_path / "a.csv").write_text("\n".join(rows))
    done = imutui("import", tmp_path / "a.csv", "-o", tmp_path / "a.mcap")
    assert "no readings of gy:" in done.stderr
    assert np.isnan(reader.read(tmp_path / "a.mcap").samples.degc).all()


@pytest.mark.parametrize("moving", [False, True])
def test_trace_leaves_out_what_is_missing_and_finds_what_is_there(tmp_path: Path, moving: bool) -> None:
    log, _ = log_of(tmp_path / "a.mcap", "gx", "ay", moving=moving, seconds=600.0, slope=0.05)
    told = imutui_json("trace", log)
    assert set(told["status"]) == {"gy", "gz", "ax", "az"}
    texts = json.dumps({k: told[k] for k in ("findings", "integrity", "lines", "noise_level", "drift", "remainder")})
    assert '"gx"' not in texts
    assert '"ay"' not in texts
    assert {e["channel"] for e in told["error"]} <= {"gy", "gz", "ax", "az", "all"}
    assert any(f["channels"] == ["gy"] for f in told["findings"])
    assert any("no readings of gx, ay" in note for note in told["notes"])


def test_the_virtual_instrument_says_that_it_needs_six_channels(tmp_path: Path) -> None:
    log, _ = log_of(tmp_path / "a.mcap", "gx")
    assert "sends six" in imutui("virtual", "--from", log, check=2).stderr


@pytest.mark.parametrize(("array", "axis", "code"), [("gyro", 2, 0), ("accel", 0, 2)])
def test_a_unit_turned_by_hand_needs_its_accelerometers_only(tmp_path: Path, array: str, axis: int, code: int) -> None:
    source = DATA / "xsens_mti_multiposition.npz"
    if not source.exists():
        pytest.skip(f"{source} is not there")
    given = dict(np.load(source))
    given[array][:, axis] = np.nan
    np.savez(tmp_path / "a.npz", **{k: given[k] for k in ("t", "gyro", "accel")})
    flags = ("--accel-sign", "+1", "--gravity", "9.81744", "--reference", "turned")
    imutui("import", tmp_path / "a.npz", "-o", tmp_path / "a.mcap", *flags)
    done = imutui("trace", tmp_path / "a.mcap", "--json", check=code)
    if code:
        assert "accelerometer x was not recorded" in done.stderr
        return
    told = json.loads(done.stdout)
    (norm,) = [e for e in told["error"] if e["metric"] == "gravity_norm"]
    assert norm["before"] > 50.0
    assert norm["after"] < 0.3
    assert "gz" not in told["status"]
