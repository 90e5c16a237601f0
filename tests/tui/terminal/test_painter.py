"""Only the cells that changed are sent, and the terminal shows what Textual wants shown."""

import asyncio
from typing import Any

import pyte
import pytest
from helpers.fake_client import FakeClient
from helpers.pilot import shows, text_of, until
from hypothesis import given
from hypothesis import strategies as st
from rich.color import ColorSystem
from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region
from textual.strip import Strip

from imutui.tui.app import ImutuiApp
from imutui.tui.terminal import painter
from imutui.tui.terminal.painter import Painter
from imutui.tui.terminal.textual_private import ChopsUpdate

STYLES = [Style.parse("red on black"), Style.parse("bold blue on black"), Style()]
WIDTH = 40

SIGNS = "ab ⣿"

cells = st.binary(min_size=WIDTH, max_size=WIDTH).map(lambda b: [(SIGNS[n % 4], n // 4 % 3) for n in b])


def _strip(line: list[tuple[str, int]]) -> Strip:
    return Strip([Segment(sign, STYLES[style]) for sign, style in line], WIDTH)


def _shown(screen: pyte.Screen) -> list[tuple[str, str, bool]]:
    return [(c.data, c.fg, c.bold) for c in (screen.buffer[0][x] for x in range(WIDTH))]


@given(before=cells, after=cells)
def test_a_changed_line_is_shown_as_if_sent_whole(before: list[tuple[str, int]], after: list[tuple[str, int]]) -> None:
    terminals = []
    for old in (before, None):
        screen = pyte.Screen(WIDTH, 1)
        stream = pyte.Stream(screen)
        if old is not None:
            stream.feed(painter.written(iter([(0, 0, painter.flat(_strip(old)))]), ColorSystem.STANDARD))
        runs = painter.differing(None if old is None else _strip(old), _strip(after))
        stream.feed(painter.written(((x, 0, run) for x, run in runs), ColorSystem.STANDARD))
        terminals.append(_shown(screen))
    assert terminals[0] == terminals[1]


def test_one_digit_costs_a_few_bytes() -> None:
    line = [(sign, 0) for sign in "a" * WIDTH]
    changed = [*line[:30], ("b", 0), *line[31:]]
    runs = painter.differing(_strip(line), _strip(changed))
    assert [(start, text) for start, (text, _) in runs] == [(30, "b")]
    assert painter.differing(_strip(line), _strip(line)) == []


def test_wide_signs_are_sent_whole() -> None:
    """Where a sign takes two cells, places in the text are no places on the screen."""
    wide = Strip([Segment("日本", STYLES[0]), Segment("a" * 36, STYLES[0])], WIDTH)
    assert painter.differing(wide, wide.crop(0, WIDTH)) == [(0, painter.flat(wide))]


def test_what_is_not_known_is_passed_on() -> None:
    assert Painter().exact(None) is None
    assert Painter().exact("inline") == "inline"


def test_what_is_not_drawn_anew_or_lies_beside_the_span_is_left_as_it_is() -> None:
    """Textual gives the whole line: parts that it has not drawn are none, others are the old ones."""
    parts = {0: _strip([("a", 0)] * WIDTH), 40: None, 80: _strip([("b", 0)] * WIDTH), 120: _strip([(" ", 0)] * WIDTH)}
    update = ChopsUpdate([parts], [(0, 0, 100)], [[40, 80, 120, 160]])
    assert [(x, y) for x, y, _ in Painter().changes(update)] == [(0, 0), (80, 0)]
    assert [x for x, *_ in Painter().changes(ChopsUpdate([parts], [(0, 40, 80)], [[40, 80, 120, 160]]))] == []


@pytest.mark.parametrize("size", [(80, 24), (120, 40)])
async def test_the_terminal_has_what_the_application_shows(
    size: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    screen = pyte.Screen(*size)
    stream = pyte.Stream(screen)
    app = ImutuiApp(FakeClient())  # type: ignore[arg-type]

    def send(shown_on: Any, renderable: Any) -> None:
        update = app.drawing.painter.exact(renderable)
        if update is not None and not app._batch_count:
            stream.feed(update.render_segments(app.console))

    monkeypatch.setattr(app, "_display", send)

    def same() -> bool:
        return [line.rstrip() for line in screen.display] == [line.rstrip() for line in text_of(app).splitlines()]

    async with app.run_test(size=size) as pilot:
        for key, sign in (
            ("space", "FROZEN"), ("space", "autoscale"), ("s", "sweep"), ("4", "NIS"),
            ("question_mark", "ON THE FILTER"), ("escape", "NIS"), ("2", "sweep"), ("s", "no plot"),
            ("s", "scroll"), ("down", ">gy"),
        ):  # fmt: skip
            await shows(pilot, "SIMULATED")
            await pilot.press(key)
            await shows(pilot, sign)
        await pilot.press("space")
        await shows(pilot, "FROZEN")
        await until(pilot, same)
        app.refresh()
        await asyncio.sleep(0)
        await until(pilot, same)
        assert Region(0, 0, *size) == app.screen.region
