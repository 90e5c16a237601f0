"""The widget that shows a figure with axes; only lines that changed are drawn."""

from rich.segment import Segment
from rich.style import Style  # noqa: TC002 - an attribute's type
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from imutui.tui.terminal.glyphs import Glyphs, choose
from imutui.tui.widgets import axes
from imutui.tui.widgets.axes import Figure, Part

_STYLES = {
    axes.BLANK: "axes--blank",
    axes.DATA: "axes--data",
    axes.COMPARED: "axes--compared",
    axes.CURSOR: "axes--cursor",
}


class AxesPlot(Widget):
    """Curves over axes with numbers, or words as long as there are none."""

    COMPONENT_CLASSES = set(_STYLES.values())  # noqa: RUF012 - Textual's way
    DEFAULT_CSS = """
    AxesPlot { height: 1fr; min-height: 4; }
    AxesPlot > .axes--blank { color: $foreground 70%; }
    AxesPlot > .axes--data { color: $text-primary; }
    AxesPlot > .axes--compared { color: $text-warning; }
    AxesPlot > .axes--cursor { color: $foreground; text-style: bold; }
    """

    def __init__(self, glyphs: Glyphs | None = None) -> None:
        super().__init__()
        self._glyphs = glyphs or choose()
        self._figure: Figure | None = None
        self._words = ""
        self._lines: list[list[Part]] = []
        self._styles: dict[str, Style] = {}

    @property
    def cells(self) -> int:
        """Characters between both ends of the x axis."""
        return max(self.size.width - axes.GUTTER, 1)

    def show(self, figure: Figure | None, words: str = "") -> None:
        """Show a figure; without one, words in its place."""
        self._figure, self._words = figure, words
        self._redraw()

    def on_resize(self) -> None:
        """Draw anew for another size."""
        self._redraw()

    def notify_style_update(self) -> None:
        """Take the colours of another theme."""
        super().notify_style_update()
        self._styles = {}

    def render_line(self, y: int) -> Strip:
        """One line of the widget."""
        if not self._styles:
            self._styles = {kind: self.get_component_rich_style(name) for kind, name in _STYLES.items()}
        if y >= len(self._lines):
            return Strip.blank(self.size.width, self.rich_style)
        return Strip([Segment(text, self._styles[kind]) for text, kind in self._lines[y] if text])

    def _redraw(self) -> None:
        width, height = self.size
        if not width or not height:
            return
        before, self._lines = self._lines, self._drawn(width, height)
        changed = [y for y, line in enumerate(self._lines) if y >= len(before) or line != before[y]]
        if len(before) != len(self._lines):
            self.refresh()
        elif changed:
            self.refresh(*(Region(0, y, width, 1) for y in changed))

    def _drawn(self, width: int, height: int) -> list[list[Part]]:
        if self._figure is not None:
            return axes.draw(self._figure, width, height, self._glyphs)
        words = self._glyphs.text(self._words)
        lines = [[(" " * width, axes.BLANK)] for _ in range(height)]
        lines[height // 2] = [(words[:width].center(width), axes.BLANK)]
        return lines
