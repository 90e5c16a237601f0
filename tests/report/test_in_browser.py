"""Pages as a browser shows them, at a desk and on a telephone; what they ask the network for."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers import browser, fleets, traces

from imutui.jobs import residuals
from imutui.jobs.campaign import summary
from imutui.jobs.page_data import Course, LogData
from imutui.report import fleet_report, html, page
from imutui.report.blocks import Page


def of_results() -> Page:
    """With everything on it."""
    run = {"id": "a_long_name_of_a_run_" * 3, "kind": "simulated", "rate_hz": 20.0, "seconds": 900.0}
    run |= {"log": "/data/" + "2026-11-23T01-14-22_IMU400CD-200_" * 2 + ".mcap", "log_sha256": "0123456789abcdef" * 4}
    curves = residuals.curves(traces.trace(("a",)).series, None)
    six = [[0.1] * 6] * 3
    points: Any = {"t": [0.0, 1.0, 5.0], "bias": six, "sd": six, "nis": [None, 1.0, 8.0], "dof": [9.0] * 3}
    log = LogData(courses=(Course("with it", points, is_test=True),), effects="# effects\n" * 60, missing=("a" * 90,))
    stories = [page.Story(traces.of_two_runs(runs=[run, run], curves=curves), log)]
    return page.page([*stories, *(page.Story(traces.replayed(kind=kind)) for kind in ("simulated", "measured"))])


def of_a_fleet() -> Page:
    """Of long names."""
    long = "2026-11-23T01-14-22_IMU400CD-200_" * 3
    rows = [
        *fleets.fleet(("2100101", "A-unit-with-a-long-serial-number-0102"), 5, seed=3, drift_mg={"2100101": 3.0}),
        *fleets.fleet(("V1",), 2, kind="simulated", finding=("V1",)),
        fleets.bad(f"{long}.mcap", f"{long} is no log"),
    ]
    rows[7]["log"] = f"{long}/{long}.mcap"
    rows[7]["final"]["accel_bias_mg"][1] = -13.5
    return fleet_report.page(summary.summary(rows, f"{long}/results.json"))  # type: ignore[arg-type]


@pytest.mark.parametrize(("made", "pictures"), [(of_results, 6 * 3 + 2 + 4 + 1 + 2 * 2 + 2 * 6), (of_a_fleet, 6 * 4)])
def test_a_page_fits_can_be_read_and_requests_nothing(made: Callable[[], Page], pictures: int, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    for told in browser.measured(html.document(made()), tmp_path):
        assert told["text"] > 1000
        assert told["scroll"] <= told["wide"], told["wide"]
        assert told["out"] == [], told["wide"]
        assert told["requests"] == []
        assert told["twice"] == 0, "no name inside a picture is used twice"
        assert len(told["pictures"]) == pictures
        for picture in told["pictures"]:  # numbers and a name on both axes, none smaller than can be read
            assert picture["x"] >= 2
            assert picture["y"] >= 3
            assert picture["size"] >= 8.0, told["wide"]
            assert picture["width"] > 200.0
