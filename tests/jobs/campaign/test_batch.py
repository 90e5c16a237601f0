"""What units of a batch come to."""

from pathlib import Path

import numpy as np
import pytest
from helpers import batches, many_logs
from helpers.batches import Error, along

from filters.types import Array
from imutui.jobs.campaign import batch, stored_rows, summary
from imutui.jobs.campaign.batch import BatchDocument
from imutui.jobs.campaign.log_list import find
from imutui.jobs.campaign.one_log import Settings
from imutui.jobs.campaign.run import Campaign, run
from imutui.logbook.reader import UnreadableLogError
from imutui.report import batch_report


def result(folder: Path) -> BatchDocument:
    """Result of the batch whose logs are in a folder."""
    found = batch.logs_of("B7", find([str(folder)]), print)
    run(Campaign(found, Settings(), folder / "results"), many_logs.here)
    rows = stored_rows.read(folder / "results").rows
    return batch.result("B7", [rows[log] for log in found.logs], found.root, str(folder / "results"))


def outcomes(document: BatchDocument) -> dict[str, str]:
    return {unit["name"]: unit["outcome"] for unit in document["units"]}


def constant(axis: int, size: float) -> Error:
    return lambda t: along(axis, np.full(t.size, size))


def test_units_without_fault_pass(tmp_path: Path) -> None:
    batches.batch(tmp_path)
    document = result(tmp_path)
    assert outcomes(document) == dict.fromkeys(("U1", "U2", "U3", "U4"), "pass")
    assert document["common"] == []
    assert batch.is_fine(document)
    assert "Nothing: no step, drift, tilt or tone" in batch_report.text(document, 80)


def test_units_of_one_serial_number_that_ran_at_one_time_are_several_units(tmp_path: Path) -> None:
    """Names tell them apart; where the names are equal as well, time does. A copy of a log is no further unit."""
    logs = batches.batch(tmp_path, count=3, seconds=40.0, names=("left", "right", "right"))
    (tmp_path / "copy.mcap").write_bytes(logs[0].read_bytes())
    document = result(tmp_path)
    units = {unit["name"]: (unit["unit"], unit["serial_number"], unit["logs"]) for unit in document["units"]}
    assert units == {
        "left 9911750": ("left", "9911750", ["copy.mcap", "u1.mcap"]),
        "right 9911750": ("right", "9911750", ["u2.mcap"]),
        "right 9911750 (2)": ("right", "9911750", ["u3.mcap"]),
    }
    assert len({batch.folder_of(unit["name"]) for unit in document["units"]}) == 3
    words = " ".join(batch_report.text(document, 80).split())
    assert "3 units have the same serial number, 9911750: " in words
    (group,) = summary.summary(stored_rows.rows_of(tmp_path / "results"), "results")["groups"]
    assert [unit["serial_number"] for unit in group["units"]] == ["9911750 B7:left", "9911750 B7:right"]


def test_a_tilt_of_the_table_is_taken_off_before_units_are_judged(tmp_path: Path) -> None:
    """With half of the units turned it is told apart from a bias that all have; a bad unit fails by its own."""
    lean = constant(4, 0.6)
    batches.batch(tmp_path, common=lean, own={2: constant(3, 0.4)}, mounts=("x,y,z", "-x,-y,z"))
    document = result(tmp_path)
    assert outcomes(document) == {"U3": "fail", "U1": "table", "U2": "table", "U4": "table"}
    bad, *others = document["units"]
    assert [one["channel"] for one in bad["limits"] if one["verdict"] == "fails"] == ["ax"]
    assert all([one["channel"] for one in unit["shared_limits"]] == ["ay"] for unit in others)
    words = " ".join(batch_report.text(document, 80).split())
    assert "The table leans by 3." in words
    assert "mounted alike" not in words


def test_what_shakes_all_units_fails_none(tmp_path: Path) -> None:
    def shaken(t: Array) -> Array:
        return along(5, 0.2 * np.random.default_rng(5).normal(size=t.size))

    batches.batch(tmp_path, common=shaken)
    document = result(tmp_path)
    assert [one["kind"] for one in document["common"]] == ["noise"]
    assert set(outcomes(document).values()) == {"table"}


def test_a_log_that_is_cut_or_no_log_is_not_told(tmp_path: Path) -> None:
    """Logs of another batch, and of none, are left alone."""
    logs = batches.batch(tmp_path)
    logs[0].write_bytes(logs[0].read_bytes()[:-2000])
    many_logs.still(tmp_path / "other.mcap", 1)
    (tmp_path / "bad.mcap").write_bytes(b"no log")
    document = result(tmp_path)
    assert outcomes(document) == {"U1": "not_told", "U2": "pass", "U3": "pass", "U4": "pass"}
    assert document["units"][0]["damage"]
    with pytest.raises(UnreadableLogError, match="There are logs of: B7"):
        batch.logs_of("B8", find([str(tmp_path)]), print)
