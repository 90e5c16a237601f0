"""`imutui campaign --summary`: text, document and page of rows that are there."""

import json
from pathlib import Path
from typing import Any

import pytest
from helpers import fleets
from helpers.commands import imutui


def written(rows: list[dict[str, Any]]) -> str:
    """Name of a campaign's folder with these rows, here."""
    Path("results").mkdir()
    Path("results/results.json").write_text(json.dumps(fleets.results(*rows)))
    return "results"


def test_a_summary_is_printed_with_what_to_know_first(home: Path) -> None:
    rows = fleets.fleet(("0101", "0102"), 4, seed=3, finding=("0101", "0102"))
    rows[5]["final"]["accel_bias_mg"][1] = -13.5
    results = written([*rows, *fleets.fleet(("V1",), 1, kind="simulated"), fleets.bad("bad.mcap")])
    told = imutui("campaign", "--summary", results).stdout
    assert max(map(len, told.splitlines())) <= 80
    for words in (
        "Unit 0102 FAILS: bias of ay",
        "SIMULATED",
        "1 of 10 logs has no result",
        "No result: bad.mcap",
        "the model's",
    ):
        assert words in told


def test_a_page_is_made_beside_the_document_and_not_made_twice(home: Path) -> None:
    """The document goes to stdout alone; a lone power-on has no figures, which would take long."""
    pytest.importorskip("matplotlib")
    results = written([*fleets.fleet(("0101",), 1), *fleets.fleet(("V1",), 1, kind="simulated")])
    done = imutui("campaign", "--summary", results, "--json", "--report", "page")
    assert [group["kind"] for group in json.loads(done.stdout)["groups"]] == ["measured", "simulated"]
    assert "page/index.html" in done.stderr
    assert json.loads(Path("page/summary.json").read_text()) == json.loads(done.stdout)
    assert "--force" in imutui("campaign", "--summary", results, "--report", "page", check=2).stderr


def test_logs_without_a_serial_number_have_no_empty_headings(home: Path) -> None:
    told = imutui("campaign", "--summary", written(fleets.fleet(("",), 3))).stdout
    assert "state no serial number" in told
    assert "Table 1" in told
    assert not {"Which units drift", "Which days stand out"} & set(told.splitlines())


def test_rows_that_all_failed_are_a_finding(home: Path) -> None:
    done = imutui("campaign", "--summary", written([fleets.bad("a.mcap"), fleets.bad("b.mcap")]), check=1)
    assert "No result: b.mcap: it is no log" in done.stdout
    assert "none of 2 logs has a result" in done.stderr


def test_what_is_no_result_of_a_campaign_cannot_be_read(home: Path) -> None:
    assert "No such file" in imutui("campaign", "--summary", "absent", check=3).stderr
    assert "has no row in it" in imutui("campaign", "--summary", written([]), check=3).stderr
    Path("results/results.json").write_text("{")
    assert "is no JSON of a campaign" in imutui("campaign", "--summary", "results", check=3).stderr
    assert "--summary" in imutui("campaign", "logs", "--summary", "results", check=2).stderr
    assert "--summary" in imutui("campaign", "logs", "-o", "results", "--report", "page", check=2).stderr
