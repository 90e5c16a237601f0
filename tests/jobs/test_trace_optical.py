"""Measured recordings with an optical reference: the delay that the full rate says, and gyros at their floor."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import imutui, imutui_json
from helpers.paths import DATA

FAST, SLOW = DATA / "broad_fast_rotation.npz", DATA / "broad_slow_rotation_breaks.npz"
FLAGS = ("--accel-sign", "+1", "--mount", "x,-y,-z")
needed = pytest.mark.skipif(not (FAST.exists() and SLOW.exists()), reason=f"{FAST} or {SLOW} is not there")


def taken(source: Path, folder: Path) -> str:
    log = folder / f"{source.stem}.mcap"
    imutui("import", source, "-o", log, *FLAGS)
    return str(log)


@needed
def test_fast_turns_by_hand_give_their_delay_and_it_holds_on_other_turns(tmp_path: Path) -> None:
    told = imutui_json("trace", taken(FAST, tmp_path), taken(SLOW, tmp_path))
    (delay,) = [f for f in told["findings"] if f["effect"] == "delay"]
    assert delay["params"][0]["value"] == pytest.approx(0.0042, abs=0.0001)
    assert set(delay["channels"]) == {"gx", "gy", "gz"}
    assert not [f for f in told["findings"] if f["effect"] == "g_squared"]
    assert told["lines"] == []
    after = {e["channel"]: e["after_x_floor"] for e in told["error"] if e["metric"] == "e10"}
    assert all(after[name] < 1.2 for name in ("gx", "gy", "gz"))
    assert any("accelerometers are used at rest only" in note for note in told["notes"])


@needed
def test_replay_says_what_an_attitude_can_give(tmp_path: Path) -> None:
    done = imutui("replay", taken(SLOW, tmp_path), "--json")
    told = json.loads(done.stdout)
    for bias, at_rest in zip(told["final"]["gyro_bias_dps"], (0.20, 0.12, -0.23), strict=True):
        assert bias == pytest.approx(at_rest, abs=0.03)
    assert told["unobservable"][:2] == ["position", "velocity"]
    assert "attitude only" in done.stderr


@needed
def test_half_a_minute_with_its_attitude_tells_a_scale_factor(tmp_path: Path) -> None:
    """Measured rates of one axis made larger by 13 %; what so short a log can't tell is said."""
    with np.load(FAST) as z:
        given = dict(z)
    given["gyro"] = given["gyro"] * np.float32([1.0, 1.13, 1.0])
    np.savez(tmp_path / "arm.npz", **given)
    imutui("import", tmp_path / "arm.npz", "-o", tmp_path / "arm.mcap", *FLAGS, "--start", "40", "--end", "70")
    told = imutui_json("trace", tmp_path / "arm.mcap")
    (scale,) = [f for f in told["findings"] if f["effect"] == "scale" and f["channels"] == ["gy"]]
    assert scale["params"][0]["value"] == pytest.approx(0.13, abs=0.005)
    assert any("nothing slow can" in note for note in told["notes"])
