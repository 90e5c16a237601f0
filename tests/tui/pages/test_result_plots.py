"""Plots of results, and two of them side by side: pure functions over documents."""

from typing import Any

import numpy as np
import pytest
from helpers import traces

from imutui.estimate_history import EstimateHistory
from imutui.tui.pages.logs import comparison_text, result_plots
from imutui.tui.terminal.glyphs import GLYPHS
from imutui.tui.widgets.text_plot import PlotLook


def replayed(sha: str = "a", **biases: float) -> dict[str, Any]:
    """A result with a course over 100 s, and a pause in it."""
    history = EstimateHistory(6)
    for k in [*range(40), *range(60, 100)]:
        history.add(float(k), np.full(6, 0.5), np.full(6, 3.0 / np.sqrt(1.0 + k)), np.full(6, k > 70))
    return {
        "log_sha256": sha, "converged": True, "samples": 10, "duration_s": 100.0, "filter": "spkf",
        "reference": "level",
        "final": {"gyro_bias_dps": [biases.get("gx", 0.5), 0.1, None], "accel_bias_mg": [6.0, 0.0, 0.0]},
        "sd": {"gyro_bias_dps": [0.03, 0.01, None], "accel_bias_mg": [0.1, 0.1, 0.1]},
        "converged_s": {"gyro_bias": [9.8, None, None], "accel_bias": [70.5, None, None]},
        "nis": {"mean": 9.1, "dof": 9}, "gaps": [], "lost_packets": 1, "rejected": 0, "alarms": [],
        "course": history.rows(None, 1000),
    }  # fmt: skip


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
    assert drawn("replay", {k: v for k, v in replayed().items() if k != "course"}) == []


def test_a_trace_has_curves_and_residuals() -> None:
    curve = {"x": [0.0, 1.0, 2.0, 3.0], "before": [1.0, 2.0, None, 4.0], "after": [0.1, 0.1, None, 0.1]}
    same = {**curve, "after": curve["before"]}
    channels = {"gx": {"residual": same}, "gy": {"residual": curve}}
    document = {**traces.document(), "curves": [{"run": "a", "heldout": True, "channels": channels}]}
    said = "\n".join(drawn("trace", document))
    for text in ("az: error is a function of since_motion, mg",
                 "since_motion 5 s", "gy, deg/s: before, held out", "gx, deg/s: unchanged, held"):  # fmt: skip
        assert text in said, text
    assert said.index("gy, deg/s") < said.index("gx, deg/s")


def test_two_replays_are_compared_in_their_deviations() -> None:
    said = comparison_text.compared("replay", replayed(), replayed("b", gx=0.65), ("one", "two"))
    assert "x gyro      0.5000   ±0.0900    0.6500   ±0.0900   +0.1500    +3.5  deg/s" in said
    assert "z gyro           –                   –                   –       –  deg/s" in said
    assert "independent" not in said
    assert all(len(line) <= 76 for line in said.splitlines()[3:20])
    assert "independent" in comparison_text.compared("replay", replayed(), replayed(), ("one", "two"))


def test_two_traces_are_compared_effect_by_effect() -> None:
    other = traces.document()
    other["findings"] = [{**other["findings"][0], "params": [{**other["findings"][0]["params"][0], "value": 0.025}]}]
    said = comparison_text.compared("trace", traces.document(), other, ("one", "two"))
    assert "gy: bias follows temperature\n" in said
    assert "0.02 ±0.003" in said
    assert "+0.005   +3.5  deg/s/K" in said
    assert "centre (only A)" in said
