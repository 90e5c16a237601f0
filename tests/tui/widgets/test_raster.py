"""Series to character cells."""

import numpy as np
import pytest

from imutui.tui.terminal.glyphs import GLYPHS, Glyphs
from imutui.tui.widgets import raster
from imutui.tui.widgets.raster import Envelope


def _band(low: list[float], high: list[float]) -> Envelope:
    return Envelope(np.array(low), np.array(high))


def _envelope(t: np.ndarray, values: np.ndarray, end: float, span: float, columns: int) -> Envelope:
    """Of a window whose columns stand at whole multiples of their width in absolute time."""
    width = span / columns
    first = int(np.floor(end / width)) - columns + 1
    most = raster.gap_columns(t, width)
    low, high = raster.column_extremes(t, values[:, None], width, first, columns, most)
    return Envelope(low[0], high[0])


def test_a_single_spike_survives_any_reduction() -> None:
    t = np.arange(10_000) / 133.0
    values = np.zeros(10_000)
    values[4321] = 7.0
    band = _envelope(t, values, float(t[-1]), float(t[-1]), 40)
    assert np.nanmax(band.high) == 7.0
    assert np.count_nonzero(band.high == 7.0) == 1


def test_a_moving_window_shifts_its_columns_and_changes_none() -> None:
    """Columns stand still in absolute time, so the picture does not shimmer."""
    rng = np.random.default_rng(3)
    t = np.arange(4000) / 133.0
    values = rng.standard_normal(4000)
    one = _envelope(t, values, 20.05, 10.0, 50)
    later = _envelope(t, values, 20.25, 10.0, 50)
    np.testing.assert_array_equal(one.high[2:-1], later.high[1:-2])


def test_slow_samples_are_joined_and_gaps_are_not() -> None:
    t = np.concatenate([np.arange(20.0), np.arange(80.0, 100.0)])
    band = _envelope(t, t, 99.0, 100.0, 400)
    centre = np.arange(400) * 0.25
    assert not np.isnan(band.low[(centre > 1) & (centre < 18)]).any()
    assert np.isnan(band.low[(centre > 25) & (centre < 75)]).all()


def test_neighbouring_columns_touch() -> None:
    bits = raster.dots(_band([0.0, 1.0], [0.0, 1.0]), (0.0, 1.0), 8)
    assert bits.sum(axis=0).tolist() == [7, 1]


def test_braille_dots_have_their_unicode_places() -> None:
    codes = []
    for y in range(4):
        for x in range(2):
            bits = np.zeros((4, 2), bool)
            bits[y, x] = True
            codes.append(ord(raster.cells(bits, GLYPHS["braille"])[0]) - 0x2800)
    assert codes == [0x01, 0x08, 0x02, 0x10, 0x04, 0x20, 0x40, 0x80]


@pytest.mark.parametrize(("name", "expected"), [("block", ["▀ █", "▄▀ "]), ("ascii", ["' :", ".' "])])
def test_fonts_without_braille_get_half_cells(name: str, expected: list[str]) -> None:
    bits = np.array([[1, 0, 1], [0, 0, 1], [0, 1, 0], [1, 0, 0]], bool)
    assert raster.cells(bits, GLYPHS[name]) == expected


@pytest.mark.parametrize(("low", "high"), [(-0.12, 0.88), (994.0, 1008.0), (5.0, 5.0), (-1e-6, 1e-6)])
def test_nice_ranges_contain_their_data(low: float, high: float) -> None:
    bottom, top = raster.nice_range(low, high)
    assert bottom <= low <= high <= top
    assert top - bottom <= max(2.0 * (high - low), 0.02)


def test_scales_do_not_dance() -> None:
    first = raster.keep_range(None, -0.5, 0.5)
    assert raster.keep_range(first, -0.4, 0.45) is first
    assert raster.keep_range(first, -0.4, 3.0)[1] >= 3.0
    assert raster.keep_range((-10.0, 10.0), -0.4, 0.4) != (-10.0, 10.0)


def test_axis_labels_tell_their_ends_apart() -> None:
    assert [raster.label_decimals(r) for r in ((0.0, 1000.0), (-0.2, 1.0), (0.0, 0.002))] == [0, 1, 4]


def test_a_running_mean_is_the_mean_of_the_samples_of_its_columns() -> None:
    t, values = (np.arange(1000) + 0.5) / 100.0, np.random.default_rng(2).normal(size=(1000, 2))
    mean = raster.trailing_mean(t, values, 0.1, 20, 30, 5, 8)
    for column in (0, 17, 29):
        inside = (t >= (20 + column - 4) * 0.1 - 1e-9) & (t < (21 + column) * 0.1 - 1e-9)
        np.testing.assert_allclose(mean[:, column], values[inside].mean(axis=0))
    assert np.isnan(raster.trailing_mean(t[:3], values[:3], 0.1, 0, 5, 2, 8)).all()


@pytest.mark.parametrize("glyphs", list(GLYPHS.values()))
def test_a_mean_is_seen_in_its_band_and_hides_no_spike(glyphs: Glyphs) -> None:
    """Without a colour: it changes what is drawn where the band is thick, and every outermost dot stays."""
    rng = np.random.default_rng(3)
    low, high = _band((-2.0 - rng.random(40)).tolist(), (2.0 + rng.random(40)).tolist()), np.zeros(40)
    band, line = raster.dots(low, (-3.0, 3.0), 28), raster.dots(raster.Envelope(high, high), (-3.0, 3.0), 28)
    drawn, bare = raster.codes_with_line(band, line, glyphs), raster.codes(band, glyphs)
    assert (drawn != bare).any(axis=0).all()
    ends = raster.cells_of(band & ~(np.roll(band, 1, axis=0) & np.roll(band, -1, axis=0)), glyphs)
    assert (drawn[ends] == bare[ends]).all()
