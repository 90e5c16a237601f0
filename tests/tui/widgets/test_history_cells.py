"""Gauge and band plot: arithmetic and signs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imutui.estimate_history import EstimateHistory
from imutui.tui.pages.filter.text import gauge
from imutui.tui.terminal.glyphs import GLYPHS, Glyphs
from imutui.tui.widgets import history_cells


def ramp(seconds: float, noise: float = 0.0) -> EstimateHistory:
    """A bias of 0.5 that was uncertain at first."""
    history = EstimateHistory(1)
    t = np.arange(0.0, seconds, 0.5)
    values = 0.5 + noise * np.sin(t) + 2.0 * np.exp(-t)
    for at, value in zip(t, values, strict=True):
        history.add(float(at), np.array([value]), np.array([3.0 / np.sqrt(1.0 + 10.0 * at)]))
    return history


def test_the_gauge_shows_side_size_and_excess() -> None:
    assert gauge(0.4, 1.0) == "▕·····│██···▏"
    assert gauge(-12.0, 12.0) == "▕█████│·····▏"
    assert gauge(13.0, 12.0) == "▕·····│████▲▏"
    assert gauge(None, 1.0) == "▕·····│·····▏"
    assert gauge(0.4, 1.0, 0.3) == "▕·····│██░░·▏"
    assert gauge(0.1, 1.0, 4.5) == "▕░░░░░│█░░░░▏"


@given(st.floats(-30, 30), st.floats(-30, 30), st.floats(0, 30))
def test_the_gauge_grows_with_the_value_and_never_with_its_width(a: float, b: float, sd3: float) -> None:
    small, large = sorted((abs(a), abs(b)))
    bars = [gauge(value, 12.0, sd3) for value in (small, large)]
    assert [len(bar) for bar in bars] == [13, 13]
    lengths = [sum(cell in "█▲" for cell in bar) for bar in bars]
    assert lengths[0] <= lengths[1]
    mirrored = gauge(-large, 12.0, sd3)
    assert mirrored[1:-1][::-1] == bars[1][1:-1]


@given(st.floats(0.0, 1e6))
def test_the_time_axis_holds_the_run_and_wastes_little(seconds: float) -> None:
    """It grows in steps of at most a third, so that what is drawn seldom moves."""
    span = history_cells.span_s(seconds)
    assert span >= seconds
    assert span == 60.0 or span <= 1.34 * seconds


@given(st.floats(60.0, 1e6), st.integers(3, 12))
def test_ticks_are_round_and_few(span: float, most: int) -> None:
    ticks = history_cells.ticks(span, most)
    assert len(ticks) <= most
    assert all(-1e-6 <= tick <= span + 1e-6 for tick in ticks)


def test_a_settled_scale_shows_what_came_later() -> None:
    history = ramp(600.0)
    curve = history_cells.envelope(history, 0, history_cells.span_s(600.0), 120)
    settled, whole = (history_cells.extent(curve, scale, 1.0) for scale in ("auto", "whole run"))
    assert settled is not None
    assert whole is not None
    assert settled[1] - settled[0] < 0.5
    assert whole[1] > 2.0
    table = history_cells.extent(curve, "limits", 12.0)
    assert table is not None
    assert table[0] < -12.0 < 12.0 < table[1]


@pytest.mark.parametrize("glyphs", GLYPHS.values(), ids=lambda glyphs: glyphs.name)
def test_estimate_and_band_are_told_apart_without_colour(glyphs: Glyphs) -> None:
    history = ramp(600.0)
    curve = history_cells.envelope(history, 0, 600.0, 60 * glyphs.columns)
    made = history_cells.cells(curve, (0.2, 0.8), [0.0, 0.5], 12, glyphs, shades=False)
    lines, shows = made.lines, made.shows
    assert {len(line) for line in lines} == {60}
    assert not made.shaded.any()
    signs = np.array([list(line) for line in lines])
    late = np.s_[:, 20:50]
    estimate = set(signs[late][shows[late] == history_cells.ESTIMATE])
    band = set(signs[late][shows[late] == history_cells.EDGE])
    assert estimate
    assert band
    assert not estimate & band
    if glyphs.name == "ascii":
        assert "".join(lines).isascii()


def test_the_band_is_behind_the_estimate_and_no_dot_of_it_is_drawn() -> None:
    curve = history_cells.envelope(ramp(600.0), 0, 600.0, 120)
    made = history_cells.cells(curve, (-0.5, 1.5), [], 20, GLYPHS["braille"], shades=True)
    assert set(np.unique(made.shows)) == {history_cells.EMPTY, history_cells.HALF, history_cells.ESTIMATE}
    assert all(made.lines[row][column] in "▀▄" for row, column in np.argwhere(made.shows == history_cells.HALF))
    assert all(made.lines[row][column] == " " for row, column in np.argwhere(made.shows == history_cells.EMPTY))
    for shows, shaded in zip(made.shows.T[5:55], made.shaded.T[5:55], strict=True):
        rows, band = np.flatnonzero(shows == history_cells.ESTIMATE), np.flatnonzero(shaded)
        assert band.min() <= rows.min() <= rows.max() <= band.max()
        assert (np.diff(band) == 1).all()
    assert made.shaded[:, 5].sum() > made.shaded[:, 50].sum() > 0


def test_convergence_is_seen_in_the_line() -> None:
    history = EstimateHistory(1)
    for k in range(600):
        history.add(float(k), np.full(1, 0.5), np.full(1, 0.1), np.array([k >= 300]))
    curve = history_cells.envelope(history, 0, 600.0, 120)
    shows = history_cells.cells(curve, (0.0, 1.0), [], 8, GLYPHS["braille"], shades=True).shows
    converged = (shows == history_cells.CONVERGED).any(axis=0)
    assert (converged[:30].any(), converged[30:].all()) == (False, True)


@pytest.mark.parametrize("glyphs", GLYPHS.values(), ids=lambda glyphs: glyphs.name)
def test_a_pause_is_marked_and_no_line_drawn_across_it(glyphs: Glyphs) -> None:
    history = EstimateHistory(1)
    for k in range(600):
        if not (200 <= k < 300 or 500 <= k < 506):
            history.add(float(k), np.full(1, 0.5), np.full(1, 0.1))
    curve = history_cells.envelope(history, 0, 600.0, 60 * glyphs.columns)
    made = history_cells.cells(curve, (0.0, 1.0), [], 8, glyphs, shades=glyphs.name != "ascii")
    drawn = (made.shows >= history_cells.ESTIMATE).any(axis=0)
    assert (drawn[:20].all(), drawn[21:30].any(), drawn[31:50].all()) == (True, False, True)
    assert not made.shaded[:, 21:30].any()
    assert "gap" in "\n".join(line[20:31] for line in made.lines)
    marks = (made.shows == history_cells.GAP).any(axis=0)
    assert marks[[20, 21]].any()
    assert marks[[29, 30]].any()
    assert marks[49:52].any()


def test_rows_of_the_plot_are_the_estimate_and_three_standard_deviations() -> None:
    """What is drawn in a cell is what the scale at its left says: estimate 0.5, band 0.5 ± 0.3, levels 0 and ± 1."""
    history = EstimateHistory(1)
    for k in range(600):
        history.add(float(k), np.full(1, 0.5), np.full(1, 0.3))
    curve = history_cells.envelope(history, 0, 600.0, 120)
    np.testing.assert_allclose([curve.band.low, curve.band.high], [[0.2] * 120, [0.8] * 120], rtol=1e-6)
    np.testing.assert_allclose([curve.estimate.low, curve.estimate.high], [[0.5] * 120] * 2)
    assert history_cells.extent(curve, "auto", 1.0) == pytest.approx((0.2, 0.8))
    limits, rows = (-1.05, 1.05), 21  # a row is a tenth
    made = history_cells.cells(curve, limits, [0.0, 1.0, -1.0], rows, GLYPHS["braille"], shades=True)
    middle = 30
    assert np.flatnonzero(made.shows[:, middle] == history_cells.ESTIMATE).tolist() == [5]
    shaded = np.flatnonzero(made.shaded[:, middle])
    assert abs(shaded.min() - 2) <= 1
    assert abs(shaded.max() - 8) <= 1
    assert np.flatnonzero((made.shows == history_cells.LINE).any(axis=1)).tolist() == [0, 10, 20]
    inner = history_cells.labels((-1.5, 1.5), 1.0, 31)
    assert [k for k, label in enumerate(inner) if label.strip(" ┤│") in ("+1", "0", "-1")] == [5, 15, 25]
    assert [inner[k].strip(" ┤") for k in (5, 15, 25)] == ["+1", "0", "-1"]


def test_a_unit_without_a_data_sheet_has_no_gauge() -> None:
    assert gauge(5.0, None, 0.1) == "▕·····│·····▏"
