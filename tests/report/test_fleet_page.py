"""What is told of a fleet, in sentences and on a page."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from helpers import fleets

from imutui.jobs.campaign import summary
from imutui.jobs.campaign.summary_document import SummaryDocument
from imutui.report import fleet_report, fleet_sentences, html

UNITS = ("0101", "0102", "0103")


def summed(rows: Sequence[dict[str, Any]]) -> SummaryDocument:
    return summary.summary(rows, "results/results.json")  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def document() -> SummaryDocument:
    """Of three units one drifts, one fails a limit on a day, which stands out; a virtual one; a bad log."""
    rows = fleets.fleet(UNITS, 8, seed=3, drift_mg={"0102": 0.8}, finding=UNITS[:2])
    rows[19]["final"]["accel_bias_mg"][1] = -13.5
    return summed([*rows, *fleets.fleet(("V1",), 1, kind="simulated"), fleets.bad("<b>bad.mcap")])


def test_sentences_name_unit_channel_size_and_log(document: SummaryDocument) -> None:
    group = document["groups"][0]
    (failed,) = fleet_sentences.limits(group)
    assert failed.startswith("Unit 0103 FAILS: bias of ay -13.500 ± 0.050 mg, limit 12 mg, in 1 of 8 power-ons")
    assert failed.endswith("2026-04-06, 0103/03.mcap.")
    drifting, tested = fleet_sentences.drifts(group)
    assert drifting.startswith("Unit 0102 DRIFTS: az 0.")
    assert "mg a month (beside" in drifting
    assert "over 18 pairs" in tested
    assert any(
        told.startswith("Unit 0103, ay, 2026-04-06: -13.5 mg is outside") for told in fleet_sentences.days_out(group)
    )
    assert any(told.startswith("ay: days that stand out are counted in") for told in fleet_sentences.in_control(group))
    assert fleet_sentences.left_out(document) == ("1 of 26 logs has no result and is left out; the reason is listed.")


def test_of_a_lone_power_on_it_is_said_what_is_not_told(document: SummaryDocument) -> None:
    group = document["groups"][1]
    assert [told.split(":")[0] for told in fleet_sentences.undetermined(group)] == [
        "Only unit V1",
        "This unit was switched on once only",
    ]
    (told,) = fleet_sentences.drifts(group)
    assert told.startswith("Unit V1: fewer than three power-ons")
    assert fleet_sentences.charts(group).startswith("Too few power-ons")


def test_what_temperature_may_have_done_is_no_drift() -> None:
    rows = fleets.fleet(("a",), 8, seed=3, drift_mg={"a": 0.8})
    for month, row in enumerate(rows):
        row["temperature_degc"] = {"mean": 20.0 + month, "min": 20.0, "max": 30.0}
    (told, *_) = fleet_sentences.drifts(summed(rows)["groups"][0])[1:]
    assert "drift and temperature are not told apart" in told


def test_a_page_replaces_nothing_unasked(document: SummaryDocument, tmp_path: Path) -> None:
    names = [f"{n}-{figure.name}.svg" for n, article in enumerate(fleet_report.page(document).articles, 1)
             for figure in article.figures()]  # fmt: skip
    assert all(map(fleet_report.may_write, [*names, "index.html", "summary.json"]))
    (tmp_path / "summary.json").write_text("mine")
    with pytest.raises(FileExistsError, match=r"summary\.json"):
        fleet_report.write(tmp_path, summed([fleets.bad("a.mcap")]))
    assert [path.name for path in tmp_path.iterdir()] == ["summary.json"]


def test_a_page_has_a_part_for_measured_and_one_for_simulated(document: SummaryDocument) -> None:
    made = fleet_report.page(document)
    assert [article.kind for article in made.articles] == ["measured", "simulated"]
    assert [section.title for section in made.articles[0].sections] == [
        "Fleet",
        "Which units fail Table 1",
        "Which units drift",
        "Which days stand out",
        "Model, unit and day",
        "Control charts",
        "Which effects recur",
        "Method",
    ]
    assert made.articles[1].sections[-1].title == "Logs without a result"
    names = [figure.name for figure in made.articles[0].figures()]
    assert names == ["units", "chart-1", "chart-2", "chart-3"]


def test_a_page_is_written_with_its_figures_and_numbers(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    written = fleet_report.write(tmp_path / "page", summed([*fleets.fleet(("a<b>",), 4), fleets.bad("<i>.mcap")]))
    assert sorted(written) == sorted((tmp_path / "page").iterdir())
    text = written[0].read_text()
    assert text.count("<svg") == 6
    assert "a&lt;b&gt;" in text
    assert "&lt;i&gt;.mcap" in text
    assert {path.name for path in written} >= {"index.html", "summary.json", "chart-1.svg", "chart-1.png"}


def test_a_page_without_any_result_says_so() -> None:
    text = html.document(fleet_report.page(summed([fleets.bad("a.mcap")])))
    assert "nothing to summarise" in text
    assert "first bytes are not MCAP" in text


def test_biases_that_have_not_settled_are_one_sentence_a_unit() -> None:
    row = fleets.row("a.mcap")
    row["final"]["gyro_bias_dps"] = [0.99, 0.98, 0.1]
    row["sd"]["gyro_bias_dps"] = [0.3, 0.3, 0.001]
    row["converged_s"]["gyro_bias"] = [None, None, 20.0]
    told = [s for s in fleet_sentences.limits(summed([row])["groups"][0]) if "settled" in s]
    assert len(told) == 1
    assert told[0].startswith("Unit 0001: biases of gx 0.99 ± 0.30 deg/s, gy 0.98 ± 0.30 deg/s have not settled")


def test_noise_that_cannot_be_judged_is_one_sentence_a_unit() -> None:
    """Of logs of some seconds every channel is: six sentences would hide what is to be known."""
    noise = {"gyro_arw_deg_sqrt_h": [4.0] * 3, "accel_vrw_mps_sqrt_h": [0.9] * 3, "relative_sd": 0.3}
    none, told = fleet_sentences.limits(summed([fleets.row("a.mcap", noise=noise)])["groups"][0])
    assert none.startswith("No unit fails")
    assert told.startswith("Unit 0001: noise of gx, gy, gz, ax, ay, az is too near the limit to tell")
