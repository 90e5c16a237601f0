"""Plots of results, and two of them side by side: pure functions over documents."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import traces

from imutui.estimate_history import EstimateHistory
from imutui.tui.pages.logs import comparison, result_plots
from imutui.tui.pages.logs.result_text import Outcome
from imutui.tui.terminal.glyphs import GLYPHS
from imutui.tui.widgets import history_cells, text_plot
from imutui.tui.widgets.text_plot import PlotLook


def replayed() -> dict[str, Any]:
    """A result with a course over 100 s, and a pause in it."""
    history = EstimateHistory(6)
    for k in [*range(40), *range(60, 100)]:
        history.add(float(k), np.full(6, 0.5), np.full(6, 3.0 / np.sqrt(1.0 + k)), np.full(6, k > 70))
    return {"course": history.rows(None, 1000)}


def drawn(kind: str, document: Any, width: int = 76, glyphs: str = "braille") -> list[str]:
    look = PlotLook(width, GLYPHS[glyphs], shades=glyphs != "ascii")
    return ["".join(text for text, _ in line) for line in result_plots.plots(kind, document, look)]


@pytest.mark.parametrize("width", [56, 76, 116])
@pytest.mark.parametrize("glyphs", ["braille", "ascii"])
def test_a_replay_has_six_plots_with_the_pause_in_them(width: int, glyphs: str) -> None:
    lines = drawn("replay", replayed(), width, glyphs)
    assert max(len(line) for line in lines) <= width
    said = "\n".join(lines)
    assert all(name in said for name in result_plots.NAMES)
    assert "gap" in said
    assert said.isascii() or glyphs == "braille"
    assert (len(lines) > 30) == (width < 76)
    assert drawn("replay", traces.replayed()) == []


def test_a_trace_has_curves_and_residuals() -> None:
    curve = {"x": [0.0, 1.0, 2.0, 3.0], "before": [1.0, 2.0, None, 4.0], "after": [0.1, 0.1, None, 0.1]}
    same = {**curve, "after": curve["before"]}
    channels = {"gx": {"residual": same}, "gy": {"residual": curve}}
    document = traces.of_two_runs(curves=[{"run": "a", "heldout": True, "channels": channels}])
    said = "\n".join(drawn("trace", document))
    for text in ("az: error is a function of since_motion, mg",
                 "since_motion 5 s", "gy, deg/s: before, held out", "gx, deg/s: unchanged, held"):  # fmt: skip
        assert text in said, text
    assert said.index("gy, deg/s") < said.index("gx, deg/s")


def test_two_traces_are_compared_effect_by_effect_and_their_plots_stand_side_by_side() -> None:
    document = traces.of_two_runs()
    params = [{**document["findings"][0]["params"][0], "value": 0.025}]
    other = {**document, "findings": [{**document["findings"][0], "params": params}]}
    one, two = (Outcome("trace", title, Path("a.mcap"), d, str) for title, d in (("one", document), ("two", other)))
    made = comparison.comparison(one, two)
    for text in ("A: one\nB: two\n", "gy: bias follows temperature\n", "0.02 ±0.003", "+0.005   +3.5  deg/s/K",
                 "centre (only A)"):  # fmt: skip
        assert text in made.text(76), text
    look = PlotLook(116, GLYPHS["braille"], shades=True)
    assert "".join(text for text, _ in made.plots(look)[0]).split() == ["A:", "one", "B:", "two"]
    assert len(made.plots(replace(look, width=76))) > len(made.plots(look))


def test_a_curve_goes_from_one_end_of_its_plot_to_the_other() -> None:
    look = PlotLook(60, GLYPHS["block"], shades=False)
    lines = text_plot.of_curve([5.0, 6.0, 7.0], [0.0, 1.0, 2.0], "x", None, ("a", "b"), 5, look)
    rows = ["".join(text for text, _ in line)[history_cells.GUTTER :] for line in lines[1:-1]]
    assert [rows[0][-1] == " ", rows[-1][0] == " ", rows[0][:-12].isspace()] == [False, False, True]


def test_each_bias_of_a_replay_is_drawn_below_its_own_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """Column k of the course is bias k: here its estimate is k + 1 and its band ± 0.3."""
    history = EstimateHistory(6)
    for t in range(100):
        history.add(float(t), np.arange(1.0, 7.0), np.full(6, 0.3))
    seen: dict[str, Any] = {}
    whole = text_plot.of_history

    def spy(past: EstimateHistory, column: int, title: str, rows: int, look: PlotLook) -> Any:
        seen[title] = (float(past.estimate(column)[0][0]), float(past.band(column)[1][0] - past.band(column)[0][0]))
        return whole(past, column, title, rows, look)

    monkeypatch.setattr(text_plot, "of_history", spy)
    drawn("replay", {"course": history.rows(None, 1000)})
    assert {title: value for title, (value, _) in seen.items()} == {
        name: k + 1.0 for k, name in enumerate(result_plots.NAMES)
    }
    assert [width for _, width in seen.values()] == pytest.approx([0.6] * 6, abs=1e-5)


def test_a_residual_before_stands_before_the_one_after() -> None:
    """Before is large, after small, on one scale: before fills its plot, after one row."""
    curve = {"x": [0.0, 1.0, 2.0, 3.0], "before": [-4.0, 4.0, -4.0, 4.0], "after": [0.1, 0.1, 0.1, 0.1]}
    document = {**traces.nothing().document, "curves": [{"run": "a", "heldout": False, "channels": {
        "gy": {"residual": curve}}}]}  # fmt: skip
    lines = drawn("trace", document, width=60)
    at = [next(k for k, line in enumerate(lines) if f"gy, deg/s: {name}" in line) for name in ("before", "after")]
    blocks = lines[at[0] + 1 : at[1]], lines[at[1] + 1 :]
    rows = [sum(bool(line[history_cells.GUTTER :].strip("⠀ ")) for line in block[:-1]) for block in blocks]
    assert at[0] < at[1]
    assert rows[0] > rows[1]


def test_a_driver_s_band_in_text_is_three_standard_deviations_as_its_heading_says() -> None:
    look = PlotLook(60, GLYPHS["braille"], shades=True)
    curve = {
        "driver": "temperature",
        "x": [0.0, 10.0],
        "y": [1.0, 1.0],
        "sd": [0.1, 0.1],
        "unit": "degC",
        "y_unit": "mg",
    }
    finding = {"channels": ["ax"], "label": "follows", "driver_curve": curve}
    document: Any = traces.of_two_runs(findings=[finding])
    lines = ["".join(text for text, _ in line) for line in result_plots.of_trace(document, look)]
    assert lines[0].startswith("Error over what drives it, ± 3 sd")
    high, low = (float(line[: history_cells.GUTTER - 1].strip(" ┤│")) for line in (lines[2], lines[6]))
    assert high >= 1.3 > high - 0.15
    assert low <= 0.7 < low + 0.15
