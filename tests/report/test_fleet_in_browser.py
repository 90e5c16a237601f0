"""A page of a fleet as a browser shows it."""

from pathlib import Path

import pytest
from helpers import browser, fleets

from imutui.jobs.campaign import summary
from imutui.report import fleet_report, html


def test_a_page_of_a_fleet_fits_and_can_be_read(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    long = "2026-11-23T01-14-22_IMU400CD-200_" * 3
    rows = [
        *fleets.fleet(("2100101", "A-unit-with-a-long-serial-number-0102"), 5, seed=3, drift_mg={"2100101": 3.0}),
        *fleets.fleet(("V1",), 2, kind="simulated", finding=("V1",)),
        fleets.bad(f"{long}.mcap", f"{long} is no log"),
    ]
    rows[7]["log"] = f"{long}/{long}.mcap"
    rows[7]["final"]["accel_bias_mg"][1] = -13.5
    document = summary.summary(rows, f"{long}/results.json")  # type: ignore[arg-type]
    for told in browser.measured(html.document(fleet_report.page(document)), tmp_path):
        assert told["text"] > 3000
        assert told["scroll"] <= told["wide"], told["wide"]
        assert told["out"] == [], told["wide"]
        assert told["requests"] == []
        assert told["twice"] == 0
        assert len(told["pictures"]) == 6 * 4
        for picture in told["pictures"]:
            assert picture["x"] >= 2
            assert picture["y"] >= 3
            assert picture["size"] >= 8.0, told["wide"]
            assert picture["width"] > 200.0
