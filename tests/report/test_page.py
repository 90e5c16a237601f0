"""What is told of a result: sentences, numbers, figures and page, from a hand-made one."""

import itertools
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import traces
from helpers.documents import Entry, effect, effects_toml, state
from helpers.traces import COMMON, RUN, replayed
from helpers.traces import of_two_runs as document

from filters.multiposition import choice
from filters.tracing import selection
from filters.tracing.result import RunSeries
from imutui.jobs import driver_curves, residuals
from imutui.jobs.driver_curves import DriverCourse, DriverCurve
from imutui.jobs.page_data import LogData
from imutui.report import (
    axes,
    figures,
    filter_figures,
    fleet_figures,
    how_to_apply,
    html,
    identity,
    page,
    replay_report,
    trace_figures,
    trace_report,
)
from imutui.report.blocks import Paragraph, Table
from imutui.report.numbers import duration, plus_minus, share, times_floor

SOURCE = "trace of a.mcap; held out b.mcap"


def traced(**changes: Any) -> dict[str, Any]:
    """A document with curves of one run."""
    return document(curves=residuals.curves(traces.trace(("a",)).series, None)) | changes


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (0.02, 0.001, "0.0200 ± 0.0010 deg/s"),
        (-12.3456, 0.5, "-12.35 ± 0.50 deg/s"),
        (1234.5, 100.0, "1234 ± 100 deg/s"),
        (-1e-5, 0.021, "0.000 ± 0.021 deg/s"),
        (1.5e-6, 2e-7, "(1.50 ± 0.20)e-6 deg/s"),
        (1.0, None, "1 deg/s"),
        (1.0, 0.0, "1 deg/s"),
    ],
)
def test_value_and_deviation_end_at_the_same_digit(value: float, sd: float | None, text: str) -> None:
    assert plus_minus(value, sd, "deg/s") == text


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of a trace with something of everything, and what lies beside it; `result.json` is what it is of."""
    pytest.importorskip("matplotlib")
    made: Path = tmp_path_factory.mktemp("page") / "r"
    written = page.write(made, [page.Story(traced(common=[COMMON]))])
    assert sorted(written) == sorted(made.iterdir())
    return made


def test_a_report_has_the_course_of_a_common_cause(folder: Path) -> None:
    assert (folder / "common_1.csv").read_text() == "t_s,value\n699.500,0.01\n700.500,2.75\n"
    assert (folder / "common-1.png").exists()


def test_numbers_never_claim_more_than_they_are() -> None:
    assert (share(0.9712), share(0.9996), share(0.9951)) == ("97 %", "99.9 %", "99.5 %")
    assert (times_floor(1.013), times_floor(84.2), times_floor(8431.0)) == ("1.01", "84.2", "8431")
    assert (duration(90.0), duration(1800.0), duration(9000.0)) == ("90 s", "30 min", "2.5 h")


def test_a_page_has_all_rows_and_figures_in_one_file(folder: Path) -> None:
    made = traced(common=[COMMON])
    drawn = ("residual-1", "driver-1", "common-1", "spectrum", "allan", "error")
    pictures = {f"{name}.{kind}" for name in drawn for kind in ("svg", "png")}
    beside = {"index.html", "report.json", "result.json", "experiment.toml", "common_1.csv", "imu.yaml"}
    assert {path.name for path in folder.iterdir()} == pictures | beside
    text = (folder / "index.html").read_text()
    for table in [block for s in trace_report.article(made).sections for block in s.blocks if isinstance(block, Table)]:
        for cell in itertools.chain(*table.rows):
            assert html.text(cell) in text
    assert (folder / "experiment.toml").read_text() == traces.PROFILE
    assert json.loads((folder / "result.json").read_text()) == made


def test_a_page_has_the_sections_of_a_report_in_order() -> None:
    titles = [section.title for section in trace_report.article(traced()).sections]
    assert titles == [
        "Channels", "What to do", "Causes, their parameters and rivals", "Weak, and not used", "Errors",
        "These logs cannot show", "Figures", "Unit and files", "How to apply it", "Data quality",
        "Method and provenance", "Notes",
    ]  # fmt: skip


def test_what_is_unknown_of_a_unit_is_not_stated() -> None:
    bare = identity.section([identity.of_run(RUN)], "imutui 2")
    (facts, files) = bare.blocks
    assert dict(facts.rows) == {
        "Readings": "SIMULATED",
        "Computed with": "imutui 2",
        "Not stated": "unit, serial number, firmware, operator, turn table, place, recorded, temperature in the case,"
        " recorded with, notes",
    }
    assert files.rows[0][-1] == "not stated"
    known = {
        "identity": {"instrument": "IMU400CD-200", "serial_number": "17", "firmware": "2.1", "operator": "ana",
                     "table": "T3", "place": "lab", "note": "cold", "software": "imutui 1"},
        "start_utc": "2026-03-01T09:30:00.000Z", "temperature_degc": [19.2, 31.0], "log_sha256": "ab" * 32,
        "log": "/data/a.mcap", "source": "",
    }  # fmt: skip
    whole = identity.section([identity.of_run({**RUN, **known})], "imutui 2")
    said = dict(whole.blocks[0].rows)
    assert said["Serial number"] == "17"
    assert said["Operator"] == "ana"
    assert said["Recorded"] == "2026-03-01 09:30 UTC"
    assert said["Temperature in the case"] == "19.2 to 31.0 °C"
    assert said["Notes"] == "a.mcap: cold"
    assert whole.blocks[1].rows[0][-1] == "ab" * 32
    two = identity.section([identity.of_run({**RUN, **known}), identity.of_run(RUN)], "imutui 2")
    assert dict(two.blocks[0].rows)["Operator"] == "ana (not stated in some of the files)"


@pytest.mark.parametrize(
    ("kinds", "kind"), [(("measured", "measured"), "measured"), (("measured", "simulated"), "simulated"),
                        (("measured", "unknown"), "unknown")]
)  # fmt: skip
def test_a_page_is_called_measured_only_if_all_of_it_is(kinds: tuple[str, ...], kind: str) -> None:
    runs = [{**RUN, "kind": k} for k in kinds]
    assert trace_report.article(traced(runs=runs)).kind == kind


def test_an_event_of_one_run_is_nothing_to_correct_for() -> None:
    finding = traces.whole_document()["findings"][0]
    step = {**finding, "effect": "step", "label": "bias jumps at 40 s of run a", "channels": ["az"], "rivals": []}
    d = traced(findings=[finding, step], effects_file="version = 1\n")
    told = {name: (channels, how) for name, channels, how in trace_report.article(d).sections[1].blocks[0].rows}
    assert told["use effects"][0] == "gy"
    assert "`effects.toml` beside this page" in told["use effects"][1]
    assert told["see what was"][0] == "az"
    assert "no effects file" in told["see what was"][1]
    stays = [block.text for block in how_to_apply.of_trace(d, LogData()).blocks if isinstance(block, Paragraph)]
    assert any(
        text.startswith("Neither these lines") and text.endswith(": az: bias jumps at 40 s of run a.") for text in stays
    )


def _caption_of_causes(d: Any) -> str:
    section = next(s for s in trace_report.article(d).sections if s.title.startswith("Causes"))
    (table,) = (block for block in section.blocks if isinstance(block, Table))
    return table.caption


def test_a_page_of_a_unit_turned_by_hand_has_its_errors_in_their_place() -> None:
    norm = {**traces.whole_document()["error"][0], "metric": "gravity_norm", "channel": None, "unit": "mg"}
    by_hand = traced(runs=[{**RUN, "reference": "turned"}], error=[norm], curves=[])
    assert f"it fits better by less than {choice.KEEP}. " in _caption_of_causes(by_hand)
    assert f"needs more than {choice.ACCEPT:g}. " in _caption_of_causes(by_hand)
    assert f"A cause joins above {selection.ACCEPT:g}, " in _caption_of_causes(traced())
    assert f"A cause leaves below {selection.KEEP}," in _caption_of_causes(traced())
    sections = {section.title: section.blocks for section in trace_report.article(by_hand).sections}
    (table,) = [block for block in sections["Errors"] if isinstance(block, Table)]
    assert table.rows[0][0] == "size of gravity"
    said = " ".join(getattr(block, "text", "") for block in sections["Figures"])
    assert "turned by hand" in said
    assert "older" not in said


def _driven(*effects: Entry, **afters: Any) -> Any:
    """A trace's document with a file of those effects, and of each run the residual after correction over 101 cells."""
    (channel,) = effects[0]["channels"]
    t = np.arange(0.5, 101.0)
    runs = [
        {"run": name, "heldout": k > 0, "channels": {channel: {"residual": {"x": t.tolist(), "after": list(after)}}}}
        for k, (name, after) in enumerate(afters.items())
    ]
    return {"effects_file": effects_toml(*effects), "curves": runs}


T_FINE = np.arange(0.05, 101.0, 0.1)
WAVE = np.sin(np.arange(101.0))


def _course(driver: str, values: np.ndarray, **fields: Any) -> DriverCourse:
    return DriverCourse(T_FINE, {driver: values}, **fields)


def test_what_temperature_does_is_drawn_over_the_residual_that_it_is_of() -> None:
    d = _driven(effect("thermal_lin", "ax", state("k", "mg/K", 0.5, 0.005)), a=WAVE, b=3.0 + WAVE)
    courses = {"a": _course("temperature", 20.0 + 0.1 * T_FINE), "b": _course("temperature", 32.0 - 0.05 * T_FINE)}
    (curve,) = driver_curves.of_trace(d, courses)
    (line,) = curve.lines
    assert (curve.channel, curve.unit, [p.is_held_out for p in curve.points]) == ("ax", "mg", [False, True])
    for points in curve.points:
        left = points.y - np.interp(points.x, line.x, line.y)
        np.testing.assert_allclose(left, WAVE - WAVE.mean(), atol=1e-6)
    assert np.interp(np.concatenate([p.x for p in curve.points]), line.x, line.y).mean() == pytest.approx(0.0, abs=1e-6)
    assert line.sd.min() < 0.01
    assert line.sd[-1] == pytest.approx(0.01 * abs(line.y[-1]))
    assert driver_curves.of_trace(d, {}) == ()
    assert driver_curves.of_trace(d, {"a": _course("temperature", np.full(T_FINE.size, 20.0))}) == ()


def test_an_error_that_follows_a_rate_is_drawn_where_the_rate_holds() -> None:
    """A mean over a cell in which the rate changes is that of no rate."""
    rate = np.select([T_FINE < 40.0, T_FINE < 60.0], [-50.0, 5.0 * (T_FINE - 50.0)], 50.0)
    d = _driven(effect("asymmetry", "gx", state("k", "1", 0.02, 2e-4)), a=WAVE)
    (curve,) = driver_curves.of_trace(d, {"a": _course("wx", rate)})
    (line,), (points,) = curve.lines, curve.points
    assert (curve.driver, curve.driver_unit, curve.unit) == ("wx", "deg/s", "deg/s")
    assert np.ptp(line.y) == pytest.approx(1.0)
    assert line.y[line.x == 0.0] == line.y.min()
    assert points.x.size == 101
    sine = _course("wx", 50.0 * np.sin(2.0 * np.pi * T_FINE))  # a turn there and back in every cell
    assert driver_curves.of_trace(d, {"a": sine}) == ()


def test_an_error_that_follows_the_square_of_a_force_is_drawn_over_that_force() -> None:
    force = np.interp(T_FINE, [0.0, 101.0], [-1.0, 1.0])
    for axis in "xyz":
        d = _driven(effect("g_squared", "gx", state("k", "deg/s/g2", 0.5, 0.005), axis=axis), a=WAVE)
        (curve,) = driver_curves.of_trace(d, {"a": _course(f"f{axis}", force)})
        assert (curve.driver, curve.driver_unit) == (f"f{axis}", "g")
        assert np.ptp(curve.lines[0].y) == pytest.approx(0.5, rel=0.1)


def test_what_remembers_temperature_is_a_line_along_the_run() -> None:
    play = effect("hysteresis", "ax", state("k", "mg", 2.0, 0.02), width_k=10.0)
    d = _driven(play, effect("thermal_lin", "ax", state("k", "mg/K", 0.1, 1e-3)), a=WAVE)
    up_and_down = np.interp(T_FINE, [0.0, 50.0, 101.0], [20.0, 55.0, 20.0])
    (curve,) = driver_curves.of_trace(d, {"a": _course("temperature", up_and_down)})
    (line,), (points,) = curve.lines, curve.points
    np.testing.assert_allclose(points.y - line.y, WAVE - WAVE.mean(), atol=1e-9)
    before, after = np.interp(32.0, line.x[:45], line.y[:45]), np.interp(-32.0, -line.x[55:], line.y[55:])
    assert after - before == pytest.approx(2.0 * 7.0 / 6.0, abs=0.02)
    assert driver_curves.of_trace(d, {"a": _course("temperature", up_and_down, has_past=True)}) == ()
    figure = trace_figures.of_drivers([curve])[0]
    assert "along a run" in figure.caption
    assert figure.caption.startswith(f"ax: {curve.label}. A line")
    assert [panel.name for panel in figure.panels] == ["ax"]


def test_equal_results_give_equal_files() -> None:
    pytest.importorskip("matplotlib")
    figure = trace_figures.error_figure(document())
    assert figure is not None
    for kind in ("svg", "png"):
        assert figures.file(figure, kind) == figures.file(figure, kind)


@pytest.mark.parametrize(
    ("low", "high"), [(0.9, 1.1), (1.0, 1.0), (2.1, 2.2), (3e-4, 4e-2), (0.25, 225.0), (1e-8, 1e8), (1e-5, 1e-4)]
)
def test_an_axis_has_numbers_however_short_it_is(low: float, high: float) -> None:
    ticks = axes.log_ticks(low, high)
    assert 2 <= len(ticks) <= 7
    assert ticks == sorted(set(ticks))
    assert ticks[0] >= low / 2.6
    assert ticks[-1] <= high * 2.6


def test_an_edge_of_a_dwell_is_drawn_from_whole_cells() -> None:
    """A cell that a motion cuts is not a mean of the few readings left of it, and the curve is interrupted there."""
    rng = np.random.default_rng(1)
    n = 12_000
    before = rng.normal(size=(n, 6))
    gaps = np.zeros(n, bool)
    for first in range(0, n, 1207):
        gaps[first : first + 80] = True
    before[gaps] = np.nan
    (run,) = residuals.curves([RunSeries("a", 0.25, np.arange(n) * 0.25, before, before)], None)
    curve = run["channels"]["gx"]["residual"]
    values = np.array(curve["before"], float)
    assert np.isnan(values).sum() == gaps.sum() // 80 - 1
    assert np.nanmax(np.abs(values)) < 5.0 * np.rad2deg(1.0) / np.sqrt(30.0)
    assert run["channels"]["gx"]["bridged"]


def test_a_channel_without_any_reading_stops_no_figure() -> None:
    (series,) = traces.trace(("a",)).series
    before = series.before.copy()
    before[:, 3] = np.nan
    made = traced(curves=residuals.curves([replace(series, before=before)], None))
    assert all(len(figure.panels) == 5 for figure in trace_figures.figures(made) if figure.name == "allan")


def test_a_text_cannot_become_markup() -> None:
    made = document(notes=["<b>x"], source="trace of <b>.mcap", findings=[], error=[])
    text = html.document(page.page([page.Story(made)]))
    assert "<b>" not in text
    assert "&lt;b&gt;x" in text


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are empty: what is around them is looked at."""
    monkeypatch.setattr(figures, "file", lambda figure, kind: b"")
    monkeypatch.setattr(figures, "picture", lambda panel, label, prefix: "")


def test_the_json_says_what_the_page_says(tmp_path: Path, undrawn: None) -> None:
    folder = tmp_path / "r"
    page.write(folder, [page.Story(traced(common=[COMMON]))])
    told = json.loads((folder / "report.json").read_text())
    assert set(told["files"]) == {path.name for path in folder.iterdir()}
    (article,) = told["articles"]
    text = (folder / "index.html").read_text()
    for section in article["sections"]:
        assert f"<h2>{html.text(section['title'])}</h2>" in text
    figures_told = [b for s in article["sections"] for b in s["blocks"] if b["block"] == "figure"]
    assert len(figures_told) == 6
    for figure in figures_told:
        assert html.text(figure["caption"]) in text
        assert set(figure["files"]) <= set(told["files"])


def test_a_page_takes_away_the_figures_of_the_page_before_it(tmp_path: Path, undrawn: None) -> None:
    (tmp_path / "own.txt").write_text("mine")
    (tmp_path / "outside.png").write_text("mine")
    made = tmp_path / "r"
    made.mkdir()
    (made / "report.json").write_text(
        json.dumps({"files": ["driver-9.svg", "photo.png", "../outside.png", "own.txt", 3]})
    )
    for name in ("driver-9.svg", "photo.png", "own.txt"):
        (made / name).write_text("")
    page.write(made, [page.Story(document())], overwrite=True)
    assert not (made / "driver-9.svg").exists()
    assert (made / "photo.png").exists()
    assert (made / "own.txt").exists()
    assert (tmp_path / "outside.png").exists()


def test_a_page_replaces_nothing_unasked(tmp_path: Path, undrawn: None) -> None:
    stories = [page.Story(traced(common=[COMMON]))]
    for name in ("common_1.csv", "allan.png", "result.json"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / name).write_text("mine")
        with pytest.raises(FileExistsError) as raised:
            page.write(folder, stories)
        assert raised.value.filename == str(folder / name)
        assert [path.name for path in folder.iterdir()] == [name]
        page.write(folder, stories, own=[name])
        assert (folder / name).read_text() != "mine"
    assert not any(map(page.may_write, ("photo.png", "notes.csv", "experiment.txt", "allan.svg.bak", "a.toml")))


@pytest.mark.parametrize("results", [[traced(common=[COMMON])], [replayed()], [replayed(), traced(common=[COMMON])]])
def test_every_name_that_a_page_writes_is_known_before_its_results(
    results: list[Any], tmp_path: Path, undrawn: None
) -> None:
    written = page.write(tmp_path, [page.Story(result) for result in results])
    assert [path.name for path in written if not page.may_write(path.name)] == []


def test_an_alarm_is_never_above_converged() -> None:
    d = {**replayed(), "alarms": ["x gyro (body axes) is off"]}
    assert d["converged"]
    article = replay_report.article(d)
    verdict = [block for block in article.sections[1].blocks if isinstance(block, Paragraph)]
    assert verdict[0].text.startswith("RED: ")
    assert not any("converged" in block.text for block in verdict)
    assert replay_report.after_replay(d)[0].startswith("Do not use these biases")
    apply = next(s for s in article.sections if s.title == "How to apply it")
    assert isinstance(apply.blocks[0], Paragraph)
    assert "RED" in apply.blocks[0].text


def test_results_beside_each_other_are_named_and_their_differences_have_an_sd() -> None:
    other = replayed(log="/data/b/sample.mcap", log_sha256="00" * 32, kind="measured", start_utc="2026-03-01T09:30:00Z")
    other["final"] = {**other["final"], "gyro_bias_dps": [-0.9, 0.7, None]}
    other["identity"] = {**other["identity"], "serial_number": "17"}
    made = page.page([page.Story(replayed()), page.Story(other), page.Story(document())])
    assert [a.title[:2] for a in made.articles] == ["Co", "A:", "B:", "C:"]
    first = made.articles[0]
    assert first.kind == "simulated"
    who, biases = (next(b for b in first.sections[k].blocks if isinstance(b, Table)) for k in (0, 1))
    assert who.rows[1][:5] == ("B", "IMU400CD-200 17", "2026-03-01 09:30", "sample.mcap", "measured")
    rows = {row[:2]: row[2:] for row in biases.rows}
    sd = np.hypot(*[replayed()["sd"]["gyro_bias_dps"][0]] * 2)
    assert rows["gx", "A (SIMULATED)"][1:] == ("–", "–")
    assert rows["gx", "B"] == ("-0.900 ± 0.015 deg/s", f"0.077 ± {sd:.3f} deg/s", f"{(-0.9 + 0.9767409) / sd:+.1f}")
    assert rows["gz", "B"] == ("not observable", "–", "–")
    drawn = {figure.name: [panel.name for panel in figure.panels] for figure in first.figures()}
    assert drawn["compared-differences"] == ["gx", "ax", "gy", "ay", "az"]
    assert all("SIMULATED" in figure.title for figure in first.figures())
    same = page.page([page.Story(replayed()), page.Story(replayed())]).articles[0]
    said = " ".join(getattr(block, "text", "") for block in same.sections[0].blocks)
    assert "B is the same result as A, given twice" in said
    corrected = LogData(corrected_from=str(replayed()["log_sha256"]))
    fixed = page.Story(replayed(log="/data/c.mcap", log_sha256="11" * 32), corrected)
    related = page.page([page.Story(replayed()), fixed]).articles[0]
    who, told, *_ = related.sections[0].blocks
    assert isinstance(who, Table)
    assert who.rows[1][7] == "0; taken out of the log"
    assert told == Paragraph("B is of the log of A from which effects were taken out.")
    table = next(b for b in related.sections[1].blocks if isinstance(b, Table))
    assert {row[4] for row in table.rows} == {"–"}  # no sd of a difference of the same readings
    captions = {figure.name: figure.caption for figure in related.figures()}
    assert "without a bar" in captions["compared-differences"]


def test_noise_beside_each_other_is_compared_with_each_result_s_own_specification() -> None:
    def said(*documents: dict[str, Any]) -> str:
        sections = page.page([page.Story(d) for d in documents]).articles[0].sections
        (table,) = (b for s in sections if s.title == "Noise beside each other" for b in s.blocks)
        assert isinstance(table, Table)
        return table.caption

    other = replayed(log_sha256="00" * 32)
    limits = {"gyro_arw_deg_sqrt_h": [2.5] * 3, "accel_vrw_mps_sqrt_h": [0.2] * 3}
    other["noise"] = {**other["noise"], "specification": {**other["noise"]["specification"], **limits}}
    assert said(replayed(), replayed()).endswith("The specification has 4.5 deg/√h and 1 m/s/√h.")
    assert said(other, other).endswith("The specification has 2.5 deg/√h and 0.2 m/s/√h.")
    assert "have 4.5 deg/√h and 1 m/s/√h (A); 2.5 deg/√h and 0.2 m/s/√h (B)." in said(replayed(), other)


def test_runs_beside_each_other_have_what_disturbed_each() -> None:
    gap = {"after_s": 3.0, "seconds": 0.5}
    other = replayed(samples=7, duration_s=2.5, lost_packets=4, gaps=[gap], rejected=3, alarms=["one", "two"])
    other["converged_s"] = {channel: [None] * 3 for channel in other["converged_s"]}
    section = page.page([page.Story(replayed()), page.Story(other)]).articles[0].sections[-1]
    (table,) = section.blocks
    assert isinstance(table, Table)
    assert table.rows[1][1:] == ("7", "2.5", "4", "1", "3", "2", "–")
    last = max(t for times in replayed()["converged_s"].values() for t in times if t is not None)
    assert (table.rows[0][1], table.rows[0][-1]) == (str(replayed()["samples"]), f"{last:.1f}")


def test_traces_beside_each_other_show_errors_and_what_each_found() -> None:
    one, two = traces.whole_document(), {**traces.whole_document(), "findings": []}
    made = page.page([page.Story(one), page.Story(two)]).articles[0]
    assert [section.title for section in made.sections] == [
        "Traces that are compared", "Errors beside each other", "Effects beside each other",
    ]  # fmt: skip
    table = made.sections[2].blocks[0]
    assert isinstance(table, Table)
    assert {row[2] for row in table.rows if row[1].startswith("B")} == {"not found"}


@pytest.fixture
def ax() -> Any:
    """A pair of axes, to see what is drawn on it."""
    return pytest.importorskip("matplotlib.figure").Figure().add_subplot()


def test_a_band_is_cut_where_its_line_turns_back(ax: Any) -> None:
    """It would lie over itself there."""
    line = driver_curves.Line(np.array([0.0, 1.0, 2.0, 1.0, 0.0]), np.arange(5.0), np.full(5, 0.1))
    trace_figures._curve(ax, DriverCurve("ax", "lags", "mg", "temperature", "°C", (line,), ()))
    bands = [band.get_paths()[0].vertices[:, 0] for band in ax.collections]
    assert [(band.min(), band.max()) for band in bands] == [(0.0, 2.0)] * 2
    assert {len(band) for band in bands} == {9}, "three points there and back"


@pytest.mark.parametrize(("days", "sign"), [(2.5, ":"), (3.5, "2026-")])
def test_a_control_chart_has_times_of_a_day_where_dates_would_be_few(ax: Any, days: float, sign: str) -> None:
    fleet_figures._dates(ax, 20500.0 + np.array([0.0, days]))
    assert all(sign in label.get_text() for label in ax.get_xticklabels())


def test_limits_show_estimates_and_the_bands_that_are_not_of_the_beginning() -> None:
    value, half = np.linspace(0.0, 1.0, 20)[:, None], np.full((20, 1), 2.0)
    half[0] = 100.0
    low, high = filter_figures._room(value, half) or (0.0, 0.0)
    assert (low, high) == pytest.approx(
        (-2.0 + 2.0 / 19.0 - 0.05 * (5.0 - 2.0 / 19.0), 3.0 + 0.05 * (5.0 - 2.0 / 19.0))
    )
