"""What figures and tables of a report show: the numbers of lines, bands, bars and cells, and not only that they exist.

Each test fails where a figure would say another thing than its caption: another number of standard deviations, limits
exchanged, before for after, one unit's for another's.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from helpers import traces
from helpers.traces import RUN, of_two_runs, replayed

from filters import specification
from filters.kalman.consistency import nis_band
from imutui.jobs import driver_curves
from imutui.jobs.driver_curves import DriverCurve
from imutui.jobs.info import Brief
from imutui.jobs.page_data import Course, LogData
from imutui.report import (
    axes,
    comparison_figures,
    filter_figures,
    fleet_figures,
    log_table,
    page,
    replay_report,
    trace_figures,
)
from imutui.report.axes import AFTER, BEFORE, FLOOR, INK
from imutui.report.blocks import Article, Facts, Figure, Section, Table

pytest.importorskip("matplotlib")

XY = tuple[list[float], list[float]]


@pytest.fixture
def ax() -> Any:
    """A pair of axes, to see what is drawn on it."""
    from matplotlib.figure import Figure as Canvas

    return Canvas().add_subplot()


def drawn(figure: Figure, panel: str, ax: Any) -> Any:
    """Axes with what a panel of a figure draws on them."""
    next(one for one in figure.panels if one.name == panel).draw(ax)
    return ax


def lines(
    ax: Any, color: str, marker: str = "None", stroke: str | None = None
) -> list[tuple[list[float], list[float]]]:
    """Points of the lines of a colour and a marker, and of a stroke where one is named."""
    return [
        (list(map(float, line.get_xdata())), list(map(float, line.get_ydata())))
        for line in ax.lines
        if line.get_color() == color and line.get_marker() == marker and stroke in (None, line.get_linestyle())
    ]


def band(of: Any) -> tuple[list[float], list[float]]:
    """Lower and upper edge of what `fill_between` drew, by x."""
    points = of.get_paths()[0].vertices
    each = [points[points[:, 0] == x, 1] for x in np.unique(points[:, 0])]
    return [float(y.min()) for y in each], [float(y.max()) for y in each]


POINTS = {
    "t": [0.0, 1.0, 2.0],
    "bias": [[0.1 * c, 0.2 * c, 0.3 * c] for c in range(3)],
    "sd": [[0.3, 0.2, 0.1]] * 3,
    "nis": [9.0, 4.5, None],
    "dof": [9, 9, 9],
}


def course(is_test: bool = True) -> Course:
    """Biases and sds of six channels, each its own: k + 1 hundredths at first, and sds of k + 1 thousandths."""
    rows = [[(k + 1) / 100.0 + t / 1000.0 for k in range(6)] for t in range(3)]
    points = {**POINTS, "bias": rows, "sd": [[(k + 1) / 1000.0 for k in range(6)]] * 3}
    return Course("", cast("Any", points), is_test)


def test_biases_over_time_have_a_band_of_three_standard_deviations(ax: Any) -> None:
    figure = filter_figures.biases(course(), 20.0, "convergence")
    assert "three standard deviations" in figure.caption
    drawn(figure, "biases of accelerometers", ax)
    assert [line.get_label() for line in ax.lines] == ["x", "y", "z"]
    for k, (line, area) in enumerate(zip(ax.lines, ax.collections, strict=True)):
        value = np.array([(k + 4) / 100.0 + t / 1000.0 for t in range(3)])
        low, high = band(area)
        np.testing.assert_allclose(line.get_ydata(), value)
        np.testing.assert_allclose(low, value - 3.0 * (k + 4) / 1000.0)
        np.testing.assert_allclose(high, value + 3.0 * (k + 4) / 1000.0)


def test_what_is_called_3_sd_is_three_standard_deviations_of_that_kind(ax: Any) -> None:
    drawn(filter_figures.biases(course(), 20.0, "convergence"), "3 sd of gyros", ax)
    for k, line in enumerate(ax.lines):
        np.testing.assert_allclose(line.get_ydata(), [3.0 * (k + 1) / 1000.0] * 2)


def test_the_band_of_nis_holds_95_percent_over_the_degrees_of_freedom(ax: Any) -> None:
    figure = filter_figures.nis([course()], "nis")
    assert figure is not None
    drawn(figure, "NIS / degrees of freedom", ax)
    low, high = nis_band(9.0, 1)
    (span,) = ax.patches
    corners = span.get_window_extent().transformed(ax.transData.inverted())
    assert (corners.y0, corners.y1) == pytest.approx((low / 9.0, high / 9.0), rel=1e-3)
    ((_, ratios),) = lines(ax, AFTER, ".")
    assert ratios == pytest.approx([1.0, 0.5])
    assert "so that this is a test" in figure.caption
    exact = filter_figures.nis([course(is_test=False)], "nis")
    assert exact is not None
    assert "this is no test" in exact.caption


def test_bars_of_a_result_reach_three_standard_deviations_from_the_bias(ax: Any) -> None:
    d = cast("Any", replayed())
    (figure,) = [one for one in replay_report.article(d).figures() if one.name == "biases"]
    drawn(figure, "accelerometer biases", ax)
    values, sds = d["final"]["accel_bias_mg"], d["sd"]["accel_bias_mg"]
    bars = [y for _, y in lines(ax, AFTER)]
    assert bars == [pytest.approx([v - 3.0 * sd, v + 3.0 * sd]) for v, sd in zip(values, sds, strict=True)]
    assert [y for _, y in lines(ax, AFTER, "o")] == [[value] for value in values]


def test_the_table_of_biases_says_before_the_bias_and_after_three_standard_deviations() -> None:
    d = cast("Any", replayed())
    table = _table(replay_report.article(d), "Error before and after")
    assert [column.heading for column in table.columns[1:4]] == [
        "Before: the bias", "After: 3 sd", "Mean ± sd after convergence",
    ]  # fmt: skip
    value, sd = d["final"]["gyro_bias_dps"][0], d["sd"]["gyro_bias_dps"][0]
    mean, spread = d["spread"]["mean"]["gyro_bias_dps"][0], d["spread"]["sd"]["gyro_bias_dps"][0]
    assert table.rows[0][1:4] == (
        f"{value:.4f} deg/s", f"{3.0 * sd:.4f} deg/s", f"{mean:.4f} ± {spread:.4f} deg/s",
    )  # fmt: skip


def _table(article: Article, section: str) -> Table:
    (found,) = (b for s in article.sections if s.title == section for b in s.blocks if isinstance(b, Table))
    return found


def _compared(letters: str = "AB", **log: Any) -> list[Any]:
    from imutui.report.comparison_figures import Compared

    return [Compared(one, "u", "d", "f", "measured", LogData(**log)) for one in letters]


def test_bars_of_compared_biases_reach_three_standard_deviations(ax: Any) -> None:
    estimates: Any = [{"gx": (1.0, 0.1)}, {"gx": (2.0, None)}]
    comparison_figures._bars(ax, "gx", estimates, _compared())
    assert lines(ax, AFTER) == [([0.0, 0.0], pytest.approx([0.7, 1.3]))], "none where no sd is known"
    assert lines(ax, AFTER, "o") == [([0.0], [1.0]), ([1.0], [2.0])]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["A", "B"]


def test_overlaid_courses_are_of_their_channel_with_three_standard_deviations(ax: Any) -> None:
    comparison_figures._courses(ax, "ay", _compared("A", courses=(course(),)))
    (line,), (area,) = ax.lines, ax.collections
    value = np.array([0.05, 0.051, 0.052])
    low, high = band(area)
    np.testing.assert_allclose(line.get_ydata(), value)
    np.testing.assert_allclose([low, high], [value - 0.015, value + 0.015])


def test_of_compared_traces_squares_are_before_and_dots_are_after(ax: Any) -> None:
    error = {"metric": "e10", "channel": "gx", "before_x_floor": 8.0, "after_x_floor": 1.5}
    documents: Any = [{"error": [error]}, {"error": [{**error, "before_x_floor": 4.0, "after_x_floor": 1.2}]}]
    comparison_figures._errors(ax, "gx", documents, _compared())
    assert [y for _, y in lines(ax, BEFORE, "s")] == [[8.0], [4.0]]
    assert [y for _, y in lines(ax, AFTER, "o")] == [[1.5], [1.2]]


def test_the_table_of_compared_errors_has_before_and_after_in_their_columns() -> None:
    one = traces.whole_document()
    other = {**one, "findings": []}
    made = page.page([page.Story(one), page.Story(other)]).articles[0]
    table = _table(made, "Errors beside each other")
    assert [column.heading for column in table.columns][3:] == ["Before", "After", "After / floor"]
    error = next(e for e in one["error"] if e["metric"] == "e10")
    row = next(r for r in table.rows if error["channel"] in r[0] and r[1].startswith("A"))
    before, after = (float(cell.split()[0]) for cell in row[3:5])
    assert before == pytest.approx(error["before"], rel=0.1)
    assert after == pytest.approx(error["after"], rel=0.1)


def test_a_difference_is_minus_the_first_and_its_sd_is_of_both() -> None:
    other = replayed(log_sha256="00" * 32)
    other["final"] = {**other["final"], "accel_bias_mg": [v + 1.0 for v in other["final"]["accel_bias_mg"]]}
    made = page.page([page.Story(replayed()), page.Story(other)]).articles[0]
    row = next(r for r in _table(made, "Biases beside each other").rows if r[0] == "ax" and r[1].startswith("B"))
    sd = np.hypot(*[replayed()["sd"]["accel_bias_mg"][0]] * 2)
    minus, half = row[3].split(" mg")[0].split(" ± ")
    assert (float(minus), float(half)) == pytest.approx((1.0, sd), abs=0.02)


def test_a_curve_before_and_one_after_have_their_colours_and_labels(ax: Any) -> None:
    axes.before_and_after(ax, [0.0, 1.0], np.array([4.0, 5.0]), np.array([1.0, 2.0]))
    told = {line.get_label(): (line.get_color(), list(line.get_ydata())) for line in ax.lines}
    assert told == {"before": (BEFORE, [4.0, 5.0]), "after": (AFTER, [1.0, 2.0])}


def test_errors_of_a_trace_are_over_their_floor_with_their_own_intervals(ax: Any) -> None:
    e = {"metric": "e10", "channel": "gx", "before": 8.0, "after": 3.0, "floor": 2.0, "before_ci95": [6.0, 10.0],
         "ci95": [2.0, 4.0], "floor_band95": [1.0, 3.0]}  # fmt: skip
    trace_figures._errors(ax, cast("Any", [e]))
    assert lines(ax, BEFORE, "s")[0][1] == [4.0]
    assert lines(ax, AFTER, "o")[0][1] == [1.5]
    assert [y for _, y in lines(ax, BEFORE)] == [[3.0, 5.0]]
    assert [y for _, y in lines(ax, AFTER)] == [[1.0, 2.0]]
    low, high = band(ax.collections[0])
    assert (set(low), set(high)) == ({0.5}, {1.5})
    assert [(line.get_label(), line.get_marker()) for line in ax.lines[-2:]] == [("before", "s"), ("after", "o")]


def test_a_driver_s_band_is_two_standard_deviations_as_its_caption_says(ax: Any) -> None:
    curve = {
        "driver": "temperature",
        "x": [0.0, 1.0],
        "y": [2.0, 3.0],
        "sd": [0.1, 0.2],
        "unit": "degC",
        "y_unit": "mg",
    }
    finding = {"channels": ["ax"], "label": "follows", "driver_curve": curve}
    (figure,) = trace_figures._drivers(cast("Any", {"findings": [finding]}))
    assert "two standard deviations wide on each side" in figure.caption
    figure.panels[0].draw(ax)
    low, high = band(ax.collections[0])
    assert (low, high) == (pytest.approx([1.8, 2.6]), pytest.approx([2.2, 3.4]))


def test_a_curve_over_its_driver_has_the_same_band_and_the_held_out_points_apart(ax: Any) -> None:
    line = driver_curves.Line(np.array([0.0, 1.0]), np.array([2.0, 3.0]), np.array([0.1, 0.2]))
    points = tuple(driver_curves.Points(f"{k}", bool(k), np.array([k]), np.array([10.0 * k])) for k in (0.0, 1.0))
    (figure,) = trace_figures.of_drivers([DriverCurve("ax", "follows", "mg", "temperature", "°C", (line,), points)])
    assert "two standard deviations wide on each side" in figure.caption
    drawn(figure, "ax", ax)
    low, high = band(ax.collections[0])
    assert (low, high) == (pytest.approx([1.8, 2.6]), pytest.approx([2.2, 3.4]))
    told = {one.get_label(): (one.get_color(), list(one.get_ydata())) for one in ax.lines}
    assert told["held out"] == (INK, [10.0])
    assert told["runs that were fitted"] == (BEFORE, [0.0])


@pytest.mark.parametrize(("unit", "scale"), [("deg/s", 4.5 / 60.0), ("mg", 1e3 / 60.0 / 9.80665)])
def test_white_noise_of_a_data_sheet_falls_with_the_root_of_time(ax: Any, unit: str, scale: float) -> None:
    axes.allan(ax, np.array([1.0, 4.0]), unit, [specification.IMU400CD_200])
    ((x, y),) = lines(ax, FLOOR)
    assert (x, y) == ([1.0, 4.0], pytest.approx([scale, scale / 2.0]))


def test_of_a_unit_without_a_data_sheet_no_white_noise_is_drawn_or_claimed(ax: Any) -> None:
    unknown = specification.of_model("MPU-6050")
    axes.allan(ax, np.array([1.0, 4.0]), "mg", [unknown], np.ones(2))
    assert not lines(ax, FLOOR)
    assert axes.white_noise_caption([unknown]) == "The white noise that this unit should have is not known."


UNIT: dict[str, Any] = {
    "serial_number": "7", "centre": 1.0, "value": {"value": 2.0, "low": 1.5, "high": 2.6},
    "points": [
        {"start_utc": f"2026-0{n}-01T00:00:00+00:00", "value": v, "sd": 0.1, "low": 0.2 * n, "high": 1.0 + n,
         "outside": n == 2} for n, v in ((1, 1.0), (2, 9.0), (3, 1.2))
    ],
}  # fmt: skip


def test_a_control_chart_has_the_limits_of_its_points_and_crosses_what_is_outside(ax: Any) -> None:
    fleet_figures._points(ax, cast("Any", UNIT), "mg")
    low, high = lines(ax, FLOOR, stroke="--")
    assert (low[1], high[1]) == (pytest.approx([0.2, 0.4, 0.6]), pytest.approx([2.0, 3.0, 4.0]))
    assert lines(ax, BEFORE, "x")[0][1] == [9.0]
    assert lines(ax, AFTER, "o")[0][1] == [1.0, 1.2]
    assert lines(ax, INK)[0][1] == [1.0, 1.0]
    ends = ax.collections[0].get_segments()
    assert [segment[:, 1].tolist() for segment in ends] == [
        pytest.approx([v - 0.196, v + 0.196]) for v in (1.0, 1.2)
    ]  # 95 %


def test_units_beside_each_other_have_their_own_intervals_and_a_band_of_one_sd(ax: Any) -> None:
    other = {**UNIT, "serial_number": "8", "value": {"value": 3.0, "low": 2.0, "high": 5.0}}
    one = {"channel": "ax", "unit": "mg", "model": {"value": 2.5}, "between_units": {"sd": 0.5}, "units": [other, UNIT]}
    group = {"units": [{"serial_number": "7"}, {"serial_number": "8"}], "channels": [one]}
    figure = fleet_figures.units(cast("Any", group))
    assert figure is not None
    assert "one standard deviation between units on each side" in figure.caption
    drawn(figure, "ax", ax)
    assert sorted(lines(ax, AFTER)) == [([1.0, 1.0], [1.5, 2.6]), ([2.0, 2.0], [2.0, 5.0])]
    assert sorted(lines(ax, AFTER, "o")) == [([1.0], [2.0]), ([2.0], [3.0])]
    (span,) = ax.patches
    corners = span.get_window_extent().transformed(ax.transData.inverted())
    assert (corners.y0, corners.y1) == pytest.approx((2.0, 3.0))
    assert lines(ax, INK)[0][1] == [2.5, 2.5]


def test_a_log_s_cells_stand_below_their_heads() -> None:
    log = Brief(Path("a.mcap"), 1, 0.0, "finished", started=1.7e9, seconds=3725.0, samples=7, rate_hz=20.0,
                measured_hz=19.0, kind="measured", instrument="IMU400CD-200", serial_number="42",
                lost_packets=3, packets=99)  # fmt: skip
    head, row = log_table.text("logs", [log], None).splitlines()[2:4]
    cells = {name: row[head.index(name) :].split("  ")[0] for name in ("name", "start, UTC", "unit", "kind", "state")}
    assert cells == {"name": "a.mcap", "start, UTC": "2023-11-14 22:13", "unit": "IMU400CD 42", "kind": "measured",
                     "state": "finished"}  # fmt: skip
    ends = {name: row[: head.index(name) + len(name)].split()[-1] for name in ("length", "Hz", "lost")}
    assert ends == {"length": "1:02:05", "Hz": "20", "lost": "3"}


def test_each_article_has_the_mounting_of_its_own_unit() -> None:
    stories = [page.Story(replayed(mount=mount, log_sha256=f"{k:064d}"))
               for k, mount in enumerate(("x,y,z", "x,-y,-z", "z,y,-x"))]  # fmt: skip
    articles = page.page(stories).articles[1:]
    assert [_fact(article, "Mounting (table x, y, z)") for article in articles] == ["x,y,z", "x,-y,-z", "z,y,-x"]
    applied = [str([s for s in article.sections if s.title == "How to apply it"]) for article in articles]
    own = [f"table's x, y, z are the unit's {mount}." for mount in ("x,y,z", "x,-y,-z", "z,y,-x")]
    assert [[text in told for text in own] for told in applied] == np.eye(3, dtype=bool).tolist()


def _fact(article: Article, label: str) -> str:
    facts = [dict(block.rows) for s in article.sections for block in s.blocks if isinstance(block, Facts)]
    (found,) = [rows[label] for rows in facts if label in rows]
    return found


def test_a_trace_s_lines_to_apply_are_of_the_mounting_of_the_run_that_they_name() -> None:
    runs = [{**RUN, "mount": "x,-y,-z", "log": "/a.mcap"}, {**RUN, "id": "b", "mount": "z,y,-x", "log": "/b.mcap"}]
    article = page.page([page.Story(of_two_runs(runs=runs))]).articles[-1]
    assert _fact(article, "Mounting (table x, y, z)") == "x,-y,-z, z,y,-x"
    told = " ".join(map(str, _section(article, "How to apply it").blocks))
    assert "table's x, y, z are the unit's z,y,-x." in told


def _section(article: Article, title: str) -> Section:
    (found,) = [section for section in article.sections if section.title == title]
    return found


def test_a_residual_s_panels_are_of_their_channels(ax: Any) -> None:
    series = traces.trace(("a",)).series
    scaled = replace(series[0], after=0.25 * series[0].before)
    from imutui.jobs import residuals

    d = of_two_runs(curves=residuals.curves((scaled,), None))
    (figure,) = [one for one in trace_figures._of_run(d["curves"][0], cast("Any", d)) if one.name == "residual-1"]
    drawn(figure, "az", ax)
    told = {line.get_label(): np.asarray(line.get_ydata(), float) for line in ax.lines}
    np.testing.assert_allclose(told["after"], 0.25 * told["before"], atol=1e-5)
    np.testing.assert_allclose(told["before"], axes.column(d["curves"][0]["channels"]["az"]["residual"]["before"]))
