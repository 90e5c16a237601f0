"""Scroll bars in whole cells where the terminal has no eighths of a block."""

from textual.scrollbar import ScrollBar, ScrollBarRender

from imutui.tui.terminal.glyphs import Glyphs


class WholeCells(ScrollBarRender):
    """A bar whose ends are at whole cells: drawn by background colours alone."""

    VERTICAL_BARS = [" "] * len(ScrollBarRender.VERTICAL_BARS)
    HORIZONTAL_BARS = [" "] * len(ScrollBarRender.HORIZONTAL_BARS)


def draw_with(glyphs: Glyphs) -> None:
    """Have all scroll bars drawn with a set of signs, of this process."""
    ScrollBar.renderer = ScrollBarRender if glyphs.name == "braille" else WholeCells
