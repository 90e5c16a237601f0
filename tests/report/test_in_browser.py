"""A page as a browser shows it: wide, narrow, on paper; what it asks the network for."""

from pathlib import Path
from typing import Any

import pytest
from helpers import browser, traces

from imutui.jobs import residuals
from imutui.jobs.page_data import Course, LogData
from imutui.report import html, page


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """What a browser says of a page with everything on it, at each width."""
    pytest.importorskip("matplotlib")
    folder: Path = tmp_path_factory.mktemp("browser")
    run = {"id": "a_long_name_of_a_run_" * 3, "kind": "simulated", "rate_hz": 20.0, "seconds": 900.0}
    run |= {"log": "/data/" + "2026-11-23T01-14-22_IMU400CD-200_" * 2 + ".mcap", "log_sha256": "0123456789abcdef" * 4}
    curves = residuals.curves(traces.trace(("a",)).series, None)
    points: Any = {
        "t": [0.0, 1.0, 5.0],
        "bias": [[0.1] * 6] * 3,
        "sd": [[0.1] * 6] * 3,
        "nis": [None, 1.0, 8.0],
        "dof": [9.0] * 3,
    }
    log = LogData(courses=(Course("with it", points, is_test=True),), effects="# effects\n" * 60, missing=("a" * 90,))
    replayed = traces.replayed()
    stories = [page.Story({**traces.document(), "runs": [run, run], "curves": curves}, log)]
    stories += [page.Story(replayed), page.Story({**replayed, "kind": "measured"})]
    whole = html.document(page.page(stories))
    return browser.measured(whole, folder)


def test_nothing_is_wider_than_the_window(shown: list[dict[str, Any]]) -> None:
    for told in shown:
        assert told["text"] > 1000
        assert told["scroll"] <= told["wide"], told["wide"]
        assert told["out"] == [], told["wide"]


def test_every_figure_is_there_with_numbers_on_both_axes(shown: list[dict[str, Any]]) -> None:
    for told in shown:
        assert len(told["pictures"]) == 6 * 3 + 2 + 4 + 1 + 2 * 2 + 2 * 6
        for picture in told["pictures"]:
            assert picture["x"] >= 2
            assert picture["y"] >= 3
            assert picture["size"] >= 8.0, told["wide"]
            assert picture["width"] > 200.0
        assert told["twice"] == 0


def test_a_page_requests_nothing(shown: list[dict[str, Any]]) -> None:
    assert [told["requests"] for told in shown] == [[], []]
