"""Allan deviation, spectrum and histogram on the screen: what the cursor reads, and where a figure has its curves."""

import numpy as np
import pytest
from helpers.fake_client import FakeClient
from helpers.pilot import opened

from imutui.session.snapshot import StatisticsSnapshot
from imutui.tui.pages.analysis import figures, text
from imutui.tui.terminal.glyphs import GLYPHS
from imutui.tui.widgets import axes
from imutui.tui.widgets.axes import Axis, Curve, Figure

VIEWS = (figures.ALLAN, figures.SPECTRUM, figures.HISTOGRAM)


@pytest.fixture(scope="module")
def seen() -> StatisticsSnapshot:
    """Of the fake's gyro: white noise of 0.15 deg/s, a vibration of 0.2 deg/s at 16 Hz."""
    return FakeClient().statistics(0)


async def test_w_goes_through_the_views_of_the_chosen_channel() -> None:
    async with opened() as see:
        await see("→ >gx")
        await see("down down down w → >ax | Allan deviation | averaged over 0.9624 s | 4096 packets | q quit")
        await see("right → averaged over 1.925 s")
        await see("home → averaged over 0.007519 s")
        await see("w down up up → >gz | Hz: density | a line: | at 16.1")
        await see("w down down down down → >T | Gaussian | sd 0.0 | bins of 1 count")
        await see("b → Begin statistics anew?")
        await see("b → statistics of all channels begin anew")
        assert see.client.asked[-1] == "begin statistics"
        await see("escape → >ax | asked 20")


@pytest.mark.parametrize("glyphs", ["braille", "block", "ascii"])
def test_every_view_fills_its_place_with_signs_that_there_are(seen: StatisticsSnapshot, glyphs: str) -> None:
    for channel in (0, 3, 6):
        told = FakeClient().statistics(channel) if channel else seen
        for view in VIEWS:
            figure = figures.of(view, told)
            assert figure is not None
            for width, height in ((80, 15), (120, 31), (60, 8)):
                drawn = ["".join(part for part, _ in line) for line in axes.draw(figure, width, height, GLYPHS[glyphs])]
                assert [len(line) for line in drawn] == [width] * height
                assert sum(bool(line[: axes.GUTTER - 2].strip()) for line in drawn[:-1]) >= 2
                assert len(drawn[-1].split()) >= 3
                assert glyphs != "ascii" or all(line.isascii() for line in drawn[:-1])


def test_a_curve_is_where_its_values_are() -> None:
    x, y = Axis(0.1, 10.0, log=True), Axis(1.0, 100.0, log=True)
    ends = np.array([0.1, 10.0])
    level = np.array([1.0, 100.0])
    figure = Figure(x, y, "s", (Curve(ends, level, level),), cursor=1.0)
    drawn = axes.draw(figure, axes.GUTTER + 20, 11, GLYPHS["block"])
    rows = ["".join(part for part, _ in line)[axes.GUTTER :] for line in drawn[:-1]]
    at = [{k for k, sign in enumerate(row) if sign not in " │"} for row in rows]
    assert at == [{18 - 2 * k, 19 - 2 * k} for k in range(10)]
    assert [row[10] for row in rows if row[10] == "│"] == ["│"] * 9
    assert drawn[-1][0][0].split() == ["0.1", "1", "s"]
    dotted = axes.draw(
        Figure(x, y, "s", (Curve(ends, level, level, solid=False),)), axes.GUTTER + 20, 11, GLYPHS["block"]
    )
    assert sum(sign in "▀▄█" for line in dotted[:-1] for part, _ in line for sign in part) == 7


def test_what_is_read_is_what_is_known(seen: StatisticsSnapshot) -> None:
    allan, spectrum, histogram = seen["allan"], seen["spectrum"], seen["histogram"]
    assert allan is not None
    assert spectrum is not None
    assert histogram is not None
    assert figures.first_stop(figures.SPECTRUM, seen) == pytest.approx(16.0, abs=0.3)
    out = figures.stands_out(spectrum)
    assert all(abs(hz - 16.0) < 1.5 for hz in np.array(spectrum["hz"])[out])
    assert max(spectrum["peak"]) == pytest.approx(0.2 / np.sqrt(2.0 * 1.5 * spectrum["resolution_hz"]), rel=0.1)
    said, compared = text.reading(figures.ALLAN, seen, 0)
    assert said.startswith("averaged over 0.007519 s: deviation 0.")
    assert "of it" in compared
    assert float(figures.expected(histogram).sum()) == pytest.approx(4096, rel=0.01)
    number = figures.nearest(figures.HISTOGRAM, seen, histogram["mean"])
    said, compared = text.reading(figures.HISTOGRAM, seen, number)
    assert f": {histogram['counts'][number]} packets" in said
    assert "bins of 3 counts" in compared


def test_a_channel_without_noise_is_told_so(seen: StatisticsSnapshot) -> None:
    assert seen["allan"] is not None
    stuck = seen | {"allan": seen["allan"] | {"deviation": [0.0] * len(seen["allan"]["tau"])}}
    assert figures.of(figures.ALLAN, stuck) is None  # type: ignore[arg-type]
    assert "read the same" in text.nothing(figures.ALLAN, stuck)  # type: ignore[arg-type]
    young = seen | {"spectrum": None, "packets": 12}
    assert text.nothing(figures.SPECTRUM, young) == "takes 64 packets without a gap; there are 12"  # type: ignore[arg-type]
