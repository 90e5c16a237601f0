"""Base of widgets that draw lines of characters: of what changes, only the lines that read otherwise are drawn anew."""

from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from imutui.tui.terminal.glyphs import Glyphs, choose
from imutui.tui.widgets.raster import Line


class PlotWidget(Widget):
    """Shows the lines that `drawn` makes; their styles are the component classes `PREFIX--style`."""

    PREFIX: ClassVar[str]

    def __init__(self, glyphs: Glyphs | None = None, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self.glyphs = glyphs or choose()
        self._lines: list[Line] = []
        self._strips: list[Strip] = []
        self._styles: dict[str, Style] = {}

    def drawn(self, width: int, height: int) -> list[Line]:
        """The lines; none where there is no room."""
        raise NotImplementedError

    def style_of(self, name: str) -> Style:
        """The look of a style's name."""
        return self.get_component_rich_style(f"{self.PREFIX}--{name}")

    def redraw(self) -> None:
        """Make the lines, and have the terminal draw those that changed."""
        if not self.size or not self.display:
            return
        changed = self._make()
        if len(changed) == len(self._strips):
            self.refresh()
        elif changed:
            self.refresh(*(Region(0, y, self.size.width, 1) for y in changed))

    def on_resize(self) -> None:
        self.redraw()

    def notify_style_update(self) -> None:
        super().notify_style_update()
        self._styles, self._lines, self._strips = {}, [], []

    def render_line(self, y: int) -> Strip:
        if not self._strips:
            self._make()
        return self._strips[y] if y < len(self._strips) else Strip.blank(self.size.width, self.rich_style)

    def _make(self) -> list[int]:
        """Make the strips of lines that read otherwise than before; returns which."""
        lines = self.drawn(self.size.width, self.size.height)
        if len(lines) != len(self._lines):
            self._lines, self._strips = [], [Strip([])] * len(lines)
        changed = [y for y, line in enumerate(lines) if y >= len(self._lines) or line != self._lines[y]]
        for y in changed:
            # every segment has a style: Textual's monochrome filter, under NO_COLOR, fails on one that has none
            self._strips[y] = Strip([Segment(text, self._style(name)) for text, name in lines[y] if text])
        self._lines = lines
        return changed

    def _style(self, name: str) -> Style:
        if name not in self._styles:
            self._styles[name] = self.style_of(name)
        return self._styles[name]
