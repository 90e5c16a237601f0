"""Scroll bars have signs that the terminal has."""

import pytest
from rich.console import Console
from textual.scrollbar import ScrollBar

from imutui.tui.terminal import appearance
from imutui.tui.terminal.glyphs import GLYPHS


@pytest.mark.parametrize("name", ["ascii", "block", "braille"])
def test_only_a_terminal_with_eighths_of_blocks_gets_them(name: str) -> None:
    try:
        appearance.draw_scroll_bars_with(GLYPHS[name])
        console = Console(width=3, color_system="truecolor", file=None)
        drawn = ""
        for position in range(0, 80, 3):
            made = ScrollBar.renderer.render_bar(size=10, virtual_size=100, window_size=23, position=position)
            segments = console.render(made)
            drawn += "".join(segment.text for segment in segments)
        assert (drawn.replace("\n", "").strip() == "") == (name != "braille")
    finally:
        appearance.draw_scroll_bars_with(GLYPHS["braille"])
