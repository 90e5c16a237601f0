"""A text in lines as wide as there is room, wrapped by words that do not end on a line of their own."""

from textual.content import Content
from textual.geometry import Size
from textual.widget import Widget

from imutui.report import wrapping
from imutui.tui import formatting
from imutui.tui.terminal.glyphs import choose


class WrappedText(Widget):
    """A text of several paragraphs, a line each.

    `text`: all of it; signs that the terminal lacks are replaced.
    `classes`: as any widget has them.
    """

    DEFAULT_CSS = "WrappedText { height: auto; }"

    def __init__(self, text: str, *, id: str | None = None, classes: str = "") -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id, classes=classes)
        self._said = choose().text(text)

    def update(self, text: str) -> None:
        self._said = choose().text(text)
        self.refresh(layout=True)

    def _lines(self, width: int) -> str:
        return wrapping.reflowed(formatting.folded(self._said, width), width)

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        return self._lines(width).count("\n") + 1

    def render(self) -> Content:
        return Content(self._lines(max(self.content_size.width, 1)))
