"""Channel health of logs: replay, check and trace report the same faults, and a channel that is dead has no bias."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import imutui, imutui_json
from helpers.spoiled_channels import KINDS, healthy

from filters.channels import DPS, G


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Imported logs of a unit at rest for two minutes: as it is, with a dead gyro, and with one in coarse steps."""
    made, folder = healthy("imu400cd", 20.0, 4, 120.0), tmp_path_factory.mktemp("logs")
    for name in ("healthy", "dead", "step of 64 counts"):
        spoiled = made if name == "healthy" else KINDS[name][1](made, 1, np.random.default_rng(1))
        columns = {"gyro": spoiled.x[:, :3] / DPS, "accel": spoiled.x[:, 3:] / G}
        np.savez(folder / "a.npz", t=made.t, temp=np.full(made.t.size, 25.0), **columns)
        assert not imutui("import", folder / "a.npz", "-o", folder / f"{name.split()[0]}.mcap").returncode
    return folder


def test_a_dead_gyro_is_red_and_has_no_bias_that_ever_converged(folder: Path) -> None:
    done = imutui("replay", folder / "dead.mcap", check=1)
    assert done.returncode == 1
    assert done.stdout.startswith("RED, gy dead: ")
    assert "never: gy is dead" in done.stdout
    document = imutui_json("replay", folder / "dead.mcap", check=1)
    (found,) = document["health"]
    assert (found["channel"], found["kind"], found["level"], found["since_s"]) == ("gy", "dead", "bad", 0.0)
    assert document["final"]["gyro_bias_dps"][1] is None
    assert document["sd"]["gyro_bias_dps"][1] is None
    assert document["converged_s"]["gyro_bias"][1] is None
    assert None not in (document["sd"]["gyro_bias_dps"][0], document["converged_s"]["gyro_bias"][0])
    assert "gyro_bias_y" in document["unobservable"]
    assert not document["converged"]


def test_amber_ends_with_exit_code_1(folder: Path) -> None:
    done = imutui("replay", folder / "step.mcap", check=1)
    assert (done.returncode, done.stdout.partition(":")[0]) == (1, "AMBER, gy coarse, converged")


def test_check_reports_the_same_faults(folder: Path) -> None:
    for name in ("dead", "step"):
        log = folder / f"{name}.mcap"
        checked, replayed = imutui_json("check", log, check=1), imutui_json("replay", log, check=1)
        assert checked["health"] == replayed["health"] != []
        assert [one["what"] for one in checked["findings"]] == [f"{one['said']}." for one in checked["health"]]
    assert imutui_json("check", folder / "healthy.mcap")["health"] == []
    assert imutui_json("replay", folder / "healthy.mcap")["health"] == []


def test_a_part_of_a_log_is_judged_by_itself(folder: Path) -> None:
    document = imutui_json("replay", folder / "dead.mcap", "--start", "30", "--end", "60", check=1)
    assert [(one["channel"], one["kind"]) for one in document["health"]] == [("gy", "dead")]


def test_a_trace_reports_them_for_its_run(folder: Path) -> None:
    document = imutui_json("trace", folder / "dead.mcap")
    assert [one["kind"] for one in document["runs"][0]["health"]] == ["dead"]
    assert any("gy is dead" in note for note in document["notes"])


def test_a_campaign_s_rows_have_them(folder: Path) -> None:
    imutui("campaign", folder / "dead.mcap", "-o", folder / "results", check=None)
    records = map(json.loads, (folder / "results" / "rows.jsonl").read_text().splitlines())
    (row,) = [record for record in records if "log" in record]
    assert [one["kind"] for one in row["health"]] == ["dead"]
    assert row["verdict"]["word"] == "RED"
