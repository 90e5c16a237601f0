"""Widgets that are lines of text: made from a view, or wrapped by words that do not end on a line of their own."""

from textual.content import Content
from textual.geometry import Region, Size
from textual.widget import Widget

from imutui.report import wrapping
from imutui.tui import formatting
from imutui.tui.connection.model import View
from imutui.tui.terminal.glyphs import Glyphs, choose

Part = str | Content | tuple[str, str]
LEVEL_STYLES = {"good": "bold $text-success", "wait": "bold $text-warning", "bad": "bold $text-error", "none": "bold"}


class TextLines(Widget):
    """Shows a view as lines of text that fill the width; subclasses say which, in `lines`."""

    DEFAULT_CSS = "TextLines { width: 1fr; height: auto; }"

    def __init__(self, glyphs: Glyphs | None = None, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self.glyphs = glyphs or choose()
        self.view: View | None = None
        self._made: Content | None = None
        self._made_for = -1
        self._fresh = False

    def show(self, view: View) -> None:
        """Take a view; only lines that read differently are drawn, as no state is said by colour alone."""
        self.view = view
        before, width = self._made, self._made_for
        self._made, self._fresh = self._make(), True
        if before is None or width != self._made_for:
            self.refresh()
        elif before.plain != self._made.plain:
            self._refresh_lines(before.plain.split("\n"), self._made.plain.split("\n"))

    def _refresh_lines(self, before: list[str], after: list[str]) -> None:
        width = self._made_for
        if (
            len(before) != len(after)
            or max(map(len, [*before, *after])) > width
            or len(after) > self.content_size.height
        ):
            self.refresh()  # wrapped: a line is not a row
        else:
            changed = (y for y, (a, b) in enumerate(zip(before, after, strict=True)) if a != b)
            self.refresh(*(Region(0, y, width, 1) for y in changed))

    def lines(self, view: View, width: int) -> list[Content]:
        """The lines, at most `width` wide."""
        raise NotImplementedError

    def render(self) -> Content:
        """The lines as they were made for the newest view, or anew for another width or cursor."""
        if self._made is None or not self._fresh or self._made_for != self._width():
            self._made = self._make()
        self._fresh = False  # whatever asks again has another reason than a new view: a cursor that moved
        return self._made

    def _width(self) -> int:
        return self.content_size.width or self.app.size.width

    def _make(self) -> Content:
        self._made_for = self._width()
        if self.view is None:
            return Content("")
        return Content("\n").join(self.lines(self.view, self._made_for))

    def line(self, *parts: Part) -> Content:
        """Text and styled parts, in signs that the terminal has."""
        text = self.glyphs.text
        return Content.assemble(
            *(p if isinstance(p, Content) else text(p) if isinstance(p, str) else (text(p[0]), p[1]) for p in parts)
        )

    def spread(self, left: Content, right: Content, width: int) -> Content:
        """One part at each end of a line; the left one gives way."""
        room = max(width - right.cell_length, 0)
        return Content.assemble(left.truncate(room, ellipsis=False, pad=True), right)

    def rule(self, title: str, width: int, right: str = "") -> Content:
        """A line with a title in it."""
        start, end = self.glyphs.text(f"── {title} "), self.glyphs.text(f" {right} ──" if right else "")
        middle = self.glyphs.text("─") * max(width - len(start) - len(end), 0)
        return Content.assemble((start, ""), (middle, "dim"), (end, ""))


class WrappedText(Widget):
    """A text of several paragraphs, a line each."""

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
