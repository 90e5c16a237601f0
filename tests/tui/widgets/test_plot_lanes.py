"""A plot's lanes: what is worked out piece by piece is what a whole redraw would show."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imutui.tui.connection.packet_series import PacketSeries
from imutui.tui.terminal.glyphs import GLYPHS, Glyphs
from imutui.tui.widgets.plot_lanes import Frame, PlotLanes

RATE_HZ = 133.0
BRAILLE = GLYPHS["braille"]


def _made(seed: int, seconds: float, rate: float = RATE_HZ) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(int(seconds * rate)) / rate + 17.3
    return t, np.random.default_rng(seed).standard_normal((t.size, 3))


def _fed(
    pieces: list[int], frame: Frame, *, sweep: bool, glyphs: Glyphs = BRAILLE, rate: float = RATE_HZ
) -> tuple[PlotLanes, PacketSeries, list[list[str]]]:
    """Lanes after each piece of a series was drawn."""
    t, values = _made(1, (sum(pieces) + 1) / rate, rate)
    series, lanes = PacketSeries(3), PlotLanes(slice(0, 3), 3, glyphs)
    at, lines = 0, []
    for piece in pieces:
        series.extend(t[at : at + piece], values[at : at + piece])
        at += piece
        lines = lanes.update(series, frame, sweep=sweep, locked=False)
    return lanes, series, lines


@settings(max_examples=40, deadline=None)
@given(
    pieces=st.lists(st.integers(1, 700), min_size=1, max_size=12),
    cells=st.integers(5, 70),
    rows=st.integers(1, 6),
    sweep=st.booleans(),
    glyphs=st.sampled_from(list(GLYPHS.values())),
    rate=st.sampled_from([1.0, 20.0, RATE_HZ]),
)
def test_piece_by_piece_is_as_at_once(
    pieces: list[int], cells: int, rows: int, sweep: bool, glyphs: Glyphs, rate: float
) -> None:
    frame = Frame(10.0, cells, rows)
    lanes, series, lines = _fed(pieces, frame, sweep=sweep, glyphs=glyphs, rate=rate)
    fresh = PlotLanes(slice(0, 3), 3, glyphs)
    fresh.ranges = list(lanes.ranges)
    assert lines == fresh.update(series, frame, sweep=sweep, locked=True)


@settings(max_examples=40, deadline=None)
@given(pieces=st.lists(st.integers(1, 900), min_size=1, max_size=6), cells=st.integers(6, 90))
def test_sweep_and_scroll_show_the_same_data(pieces: list[int], cells: int) -> None:
    frame = Frame(8.0, cells, 2)
    lanes, series, swept = _fed(pieces, frame, sweep=True)
    other = PlotLanes(slice(0, 3), 3, BRAILLE)
    other.ranges = list(lanes.ranges)
    scrolled = other.update(series, frame, sweep=False, locked=True)
    newest = int(np.floor(series.last(0.0)[0][-1] / (frame.span / (2 * cells)))) // 2
    bar = lanes._bar(cells)
    for old, new in zip(scrolled, swept, strict=True):
        for scroll_line, sweep_line in zip(old, new, strict=True):
            turned = "".join(sweep_line[(newest + 1 + i) % cells] for i in range(cells))
            assert turned[:bar] == " " * bar
            assert turned[bar:] == scroll_line[bar:]


@pytest.mark.parametrize("sweep", [False, True])
@pytest.mark.parametrize("glyphs", list(GLYPHS.values()))
@settings(max_examples=25, deadline=None)
@given(spike=st.integers(0, 3989), seed=st.integers(0, 1000))
def test_no_spike_is_hidden(sweep: bool, glyphs: Glyphs, spike: int, seed: int) -> None:
    t, values = _made(seed, 30.0)
    values = 0.01 * values
    values[spike, 1] = 5.0
    series, lanes, frame = PacketSeries(3), PlotLanes(slice(0, 3), 3, glyphs), Frame(30.0, 60, 3)
    bar_s = lanes._bar(frame.cells) * frame.span / frame.cells if sweep else 0.0
    for start in range(0, t.size, 133):
        series.extend(t[start : start + 133], values[start : start + 133])
        lines = lanes.update(series, frame, sweep=sweep, locked=False)
    limits = lanes.ranges[1]
    cell_s = frame.span / frame.cells
    if t[-1] - t[spike] < frame.span - bar_s - cell_s:
        assert limits is not None
        assert limits[1] >= 5.0
        assert lines[1][0].strip()


def test_a_sweep_changes_few_cells() -> None:
    frame = Frame(30.0, 100, 3)
    _, series, before = _fed([4000], frame, sweep=True)
    lanes = PlotLanes(slice(0, 3), 3, BRAILLE)
    before = lanes.update(series, frame, sweep=True, locked=False)
    t = series.last(0.0)[0][-1] + np.arange(1, 14) / RATE_HZ
    series.extend(t, np.zeros((13, 3)))
    after = lanes.update(series, frame, sweep=True, locked=True)
    changed = sum(a != b for x, y in zip(before, after, strict=True) for p, q in zip(x, y, strict=True)
                  for a, b in zip(p, q, strict=True))  # fmt: skip
    assert 0 < changed <= 3 * 3 * (lanes._bar(100) + 2)


def test_scales_change_rarely() -> None:
    t, values = _made(5, 600.0)
    series, lanes, seen = PacketSeries(3), PlotLanes(slice(0, 3), 3, BRAILLE), []
    for start in range(0, t.size, 133):
        series.extend(t[start : start + 133], values[start : start + 133])
        lanes.update(series, Frame(30.0, 60, 2), sweep=True, locked=False)
        if not seen or seen[-1] != lanes.ranges[0]:
            seen.append(lanes.ranges[0])
    assert len(seen) <= 6


def test_a_locked_scale_says_what_it_leaves_out() -> None:
    series, lanes, frame = PacketSeries(3), PlotLanes(slice(0, 3), 3, BRAILLE), Frame(10.0, 40, 2)
    t, values = _made(2, 5.0)
    series.extend(t, values)
    lanes.update(series, frame, sweep=False, locked=False)
    limits = list(lanes.ranges)
    series.extend(t[-1:] + 1.0, np.array([[0.0, 99.0, 0.0]]))
    lanes.update(series, frame, sweep=False, locked=True)
    assert lanes.ranges == limits
    assert lanes.outside == [False, True, False]


def test_a_gap_stays_open_and_old_data_never_come_back() -> None:
    series, lanes, frame = PacketSeries(3), PlotLanes(slice(0, 3), 3, BRAILLE), Frame(60.0, 60, 1)
    t, values = _made(3, 20.0)
    series.extend(t, values)
    lanes.update(series, frame, sweep=False, locked=False)
    series.extend(t + 40.0, values)
    line = lanes.update(series, frame, sweep=False, locked=False)[0][0]
    assert line[21:39].isspace()
    assert not line[45:].isspace()
    series.extend(np.array([0.0, 0.1]), np.zeros((2, 3)))
    line = lanes.update(series, frame, sweep=False, locked=False)[0][0]
    assert line[:-1].isspace()
    assert not line[-1].isspace()


def test_without_data_there_is_an_empty_plot() -> None:
    lanes, series = PlotLanes(slice(0, 3), 3, BRAILLE), PacketSeries(3)
    assert lanes.update(series, Frame(10.0, 8, 2), sweep=True, locked=False) == [[" " * 8] * 2] * 3
    series.extend(np.array([1.0, 2.0]), np.full((2, 3), np.nan))
    assert lanes.update(series, Frame(10.0, 8, 2), sweep=True, locked=False) == [[" " * 8] * 2] * 3
    assert lanes.ranges == [None] * 3
