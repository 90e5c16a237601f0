"""Shown instead of a page when the terminal is too small for it."""

from textual.content import Content
from textual.widget import Widget

NEEDED = (80, 24)


class TooSmall(Widget):
    """Says which size is needed, and which it is."""

    DEFAULT_CSS = "TooSmall { width: 1fr; height: 1fr; content-align: center middle; text-align: center; }"

    def render(self) -> Content:
        """The size needed, the size there is, and what to do."""
        size, (width, height) = self.app.size, NEEDED
        return Content(
            f"imutui needs {width}x{height} characters;\nthis terminal has {size.width}x{size.height}.\n\n"
            "Make it larger, or the font smaller.\nThe acquisition goes on. q quits."
        )
