"""Logs of a unit turned by hand: imported, traced, replayed; what is found serves the filter on another log."""

from pathlib import Path

import numpy as np
import pytest
from helpers.commands import imutui, imutui_json
from helpers.runs import run_of
from helpers.traces import imported
from helpers.turned import ACCEL_BIAS, ACCELEROMETERS, GYRO_BIAS, GYROS, SPEC, turned_run

from filters.imu import STANDARD_GRAVITY, AxisMap
from filters.motion.profile import Profile
from filters.motion.segments import Dwell
from filters.simulation import Effect, PowerOn, Scenario
from filters.tracing.run import Run


def log(path: Path, run: Run, reference: str = "turned", **info: object) -> Path:
    """A run as an imported log, of which nothing but the readings is known."""
    given = {
        "t": run.t,
        "gyro": np.rad2deg(run.reading[:, :3]),
        "accel": run.reading[:, 3:] / STANDARD_GRAVITY,
    }
    fields = {"accel_sign": run.axes.accel_sign, "reference": reference, "kind": "simulated"}
    return imported(path, given, **fields, **info)


def level_run(*effects: Effect, seed: int) -> Run:
    """The same unit still and level, at another power-on."""
    own = PowerOn(seed, None, ACCEL_BIAS, GYRO_BIAS)
    profile = Profile((Dwell((0.0, 0.0, 0.0), 90.0),))
    axes = AxisMap(accel_sign=1)
    return run_of(
        Scenario(seed=seed, spec=SPEC, effects=effects, profile=profile, power_ons=(own,), axes=axes), 0, 50.0, 61.0
    )


def test_what_a_turned_log_shows_serves_the_filter_on_another_log(tmp_path: Path) -> None:
    effects = (*ACCELEROMETERS, *GYROS)
    turned = log(tmp_path / "turned.mcap", turned_run(*effects, seed=61))
    level = log(tmp_path / "level.mcap", level_run(*effects, seed=62), "level")
    document = imutui_json("trace", turned, "-o", tmp_path / "effects.toml", "--report", tmp_path / "page")
    assert document["runs"][0]["reference"] == "turned"
    assert "the site is not stated" in " ".join(document["notes"])
    assert {e["metric"]: e["channel"] for e in document["error"]} == {"gravity_norm": None, "gravity_direction": None}
    assert set(document["status"].values()) <= {"explained", "partial"}
    assert "Turned by hand" in (tmp_path / "page" / "index.html").read_text()

    plain = imutui_json("replay", level, check=None)
    mended = imutui_json("replay", level, "--effects", tmp_path / "effects.toml", check=None)
    biases = [np.array(r["final"]["accel_bias_mg"]) for r in (plain, mended)]
    assert np.abs(biases[0]).max() > 10.0
    assert np.abs(biases[1]).max() < 1.0
    rates = [np.array(r["final"]["gyro_bias_dps"]) for r in (plain, mended)]
    assert np.abs(rates[0]).max() > 0.3
    assert np.abs(rates[1]).max() < 0.03


def test_a_replay_runs_on_the_first_rest(tmp_path: Path) -> None:
    run = turned_run(seed=63, rests=6, seconds=20.0)
    turned = log(tmp_path / "turned.mcap", run)
    result = imutui_json("replay", turned, check=None)
    assert result["reference"] == "turned"
    assert 1900 <= result["samples"] <= 2100
    assert result["rate_hz"] == pytest.approx(100.0, rel=1e-3)
    assert result["duration_s"] == pytest.approx(run.seconds, abs=0.01)
    assert np.allclose(result["final"]["gyro_bias_dps"], np.rad2deg(GYRO_BIAS), atol=0.02)
    assert None in result["final"]["accel_bias_mg"]

    reading = run.reading.copy()
    reading[:, :3] += 0.5 * np.sin(3.0 * run.t)[:, None]
    restless = log(tmp_path / "restless.mcap", Run(**{**vars(run), "reading": reading}))
    done = imutui("replay", restless, check=2)
    assert "no rest was found" in done.stderr


def test_turned_logs_are_not_traced_beside_others(tmp_path: Path) -> None:
    run = turned_run(seed=64, rests=12)
    turned = log(tmp_path / "turned.mcap", run)
    level = log(tmp_path / "level.mcap", level_run(seed=65), "level")
    done = imutui("trace", turned, level, check=2)
    assert "Trace them apart" in done.stderr
    other = log(tmp_path / "other.mcap", turned_run(seed=66, rests=12), serial_number="2")
    turned = log(tmp_path / "turned.mcap", run, serial_number="1")
    assert "different units" in imutui("trace", turned, other, check=2).stderr


def test_import_takes_a_recording_that_was_turned(tmp_path: Path) -> None:
    run = turned_run(seed=67, rests=12)
    np.savez(tmp_path / "a.npz", t=run.t, gyro=np.rad2deg(run.reading[:, :3]), accel=run.reading[:, 3:] / 9.80665)
    flags = ("--accel-sign", "+1", "--reference", "turned")
    done = imutui("import", tmp_path / "a.npz", "-o", tmp_path / "a.mcap", *flags)
    assert "moves" not in done.stderr
    assert "turned" in done.stdout + done.stderr
    assert imutui_json("info", tmp_path / "a.mcap")["reference"] == "turned"
    # nobody knows when a recording was made whose stamps begin at its import
    assert "start         not stated" in imutui("info", tmp_path / "a.mcap").stdout


def test_a_recording_of_accelerometers_alone_is_calibrated(tmp_path: Path) -> None:
    run = turned_run(*ACCELEROMETERS, seed=68)
    given = {"t": run.t, "gyro": np.full((run.t.size, 3), np.nan), "accel": run.reading[:, 3:] / STANDARD_GRAVITY}
    turned = imported(tmp_path / "a.mcap", given, accel_sign=1, reference="turned")
    document = imutui_json("trace", turned)
    assert set(document["status"]) == {"ax", "ay", "az"}
    assert [e["metric"] for e in document["error"]] == ["gravity_norm"]
    assert document["error"][0]["after"] < 0.1
    assert any("only of the accelerometers" in note for note in document["notes"])
