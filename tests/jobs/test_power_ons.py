"""Logs of one power-on in a trace: joined in order, or said to lack what came before."""

import os
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import imutui, imutui_json
from helpers.paths import DATA
from helpers.traces import arrays

from imutui.jobs import power_ons, runs
from imutui.jobs.runs import LoggedRun
from imutui.logbook.reading import Reading

SECONDS = 70.0


def part(folder: Path, name: str, begins: float, *flags: str, tilt: float = 0.0) -> Path:
    """A still, nearly level recording, its bias and temperature its own."""
    given = arrays(SECONDS, 10.0, moving=False, seed=int(begins) + 1)
    given["t"] = given["t"] + begins
    turn = np.array([[np.cos(tilt), 0.0, np.sin(tilt)], [0.0, 1.0, 0.0], [-np.sin(tilt), 0.0, np.cos(tilt)]])
    given["accel"] = given["accel"] @ turn.T
    np.savez(folder / f"{name}.npz", **{k: given[k] for k in ("t", "gyro", "accel", "temp")})
    output = folder / f"{name}.mcap"
    imutui("import", folder / f"{name}.npz", "-o", output, "--reference", "gravity", *flags)
    return output


def joined(*logs: Path) -> tuple[list[runs.LoggedRun], list[str]]:
    return power_ons.join([runs.read_run(log, log.stem, Reading()) for log in logs])


def by_name(reads: list[LoggedRun]) -> dict[str, tuple[str, float, bool]]:
    return {r.run.name: (r.run.power_on, round(r.run.begins, 3), r.run.history_known) for r in reads}


def test_parts_are_joined_whatever_their_order(tmp_path: Path) -> None:
    a = part(tmp_path, "a", 0.0)
    b = part(tmp_path, "b", 100.0, "--continues", str(a))
    other = part(tmp_path, "o", 7.0)
    made = joined(b, other, a)
    told = by_name(made[0])
    assert [r.run.name for r in made[0]] == ["b", "o", "a"]
    assert told["a"][0] == told["b"][0] != ""
    assert told["a"][1:] == (0.0, False)
    assert told["b"][1:] == (100.0, True)
    assert told["o"] == ("", 0.0, False)
    assert any(note.startswith("a, then b") for note in made[1])


def test_without_the_log_before_it_history_is_unknown_and_said(tmp_path: Path) -> None:
    a = part(tmp_path, "a", 0.0)
    b = part(tmp_path, "b", 100.0, "--continues", str(a))
    c = part(tmp_path, "c", 200.0, "--continues", str(b))
    alone = joined(b)
    assert by_name(alone[0])["b"] == ("", 0.0, False)
    assert "a.mcap" in alone[1][0]
    assert "not known" in alone[1][0]
    broken = joined(a, c)
    assert {told[0] for told in by_name(broken[0]).values()} == {""}
    assert "b.mcap" in broken[1][0]
    whole = joined(a, b, c)
    assert len({told[0] for told in by_name(whole[0]).values()}) == 1
    assert by_name(whole[0])["c"][1] == pytest.approx(200.0)


def test_a_log_that_was_made_again_is_still_the_one_and_is_said_to_be_another_file(tmp_path: Path) -> None:
    a = part(tmp_path, "a", 0.0)
    b = part(tmp_path, "b", 100.0, "--continues", str(a))
    part(tmp_path, "a", 0.0, "--force")
    os.utime(tmp_path / "a.npz", (1.6e9, 1.6e9))
    imutui("import", tmp_path / "a.npz", "-o", a, "--reference", "gravity", "--force")
    made = joined(a, b)
    assert by_name(made[0])["b"][1:] == (100.0, True)
    assert any("not the file that it was" in note for note in made[1])


def test_two_logs_that_continue_the_same_one_and_overlap_are_refused(tmp_path: Path) -> None:
    a = part(tmp_path, "a", 0.0)
    b = part(tmp_path, "b", 100.0, "--continues", str(a))
    c = part(tmp_path, "c", 140.0, "--continues", str(a))
    with pytest.raises(ValueError, match=r"b\.mcap and .*c\.mcap.*overlap"):
        joined(a, b, c)


def test_the_level_is_read_once_a_power_on(tmp_path: Path) -> None:
    """What level accelerometers drift between parts is no tilt; a unit that was turned is said to be."""
    a = part(tmp_path, "a", 0.0)
    b = part(tmp_path, "b", 100.0, "--continues", str(a), tilt=0.01)
    c = part(tmp_path, "c", 200.0, "--continues", str(b), tilt=0.2)
    made = joined(a, b, c)
    attitudes = [read.run.C_nb for read in made[0]]
    assert all(C is not None for C in attitudes)
    assert np.array_equal(attitudes[0], attitudes[1])
    assert not np.array_equal(attitudes[0], attitudes[2])
    assert "c is tilted by 11.5°" in made[1][-1]


def test_a_measured_power_on_in_two_parts_traces_as_one(tmp_path: Path) -> None:
    source = DATA / "thermal_chamber_part1.npz"
    if not source.exists():
        pytest.skip(f"{source} is not there")
    flags = ("--accel-sign", "+1", "--reference", "gravity", "--gravity", "9.806")
    cooling, heating = tmp_path / "cooling.mcap", tmp_path / "heating.mcap"
    imutui("import", source, "-o", cooling, "--end", "1360", *flags)
    imutui("import", source, "-o", heating, "--start", "1360", "--continues", cooling, *flags)
    told = imutui_json("trace", cooling, heating)
    one, two = told["runs"]
    assert one["power_on"] == two["power_on"]
    assert (one["heldout"], two["heldout"]) == (False, True)
    assert two["begins_s"] == pytest.approx(1360.0, abs=1.0)
    assert (one["history_known"], two["history_known"]) == (False, True)
    judged = [e for e in told["error"] if e["metric"] == "e10"]
    assert {e["heldout"] for e in judged} == {"part"}
    assert len(judged) == 6
    assert "explained" not in told["status"].values()
