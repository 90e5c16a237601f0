"""Shown instead of a page when the terminal is too small for it."""

from textual.content import Content
from textual.geometry import Size
from textual.widget import Widget

NEEDED = (80, 24)


def is_too_small(size: Size) -> bool:
    """Whether a terminal has less than any page needs."""
    return size.width < NEEDED[0] or size.height < NEEDED[1]


class TooSmall(Widget):
    """Says which size is needed, and which it is; whether a file is being written is seen here too."""

    DEFAULT_CSS = "TooSmall { width: 1fr; height: 1fr; content-align: center middle; text-align: center; }"

    recording = False

    def show(self, *, recording: bool) -> None:
        """Take whether a file is being written."""
        if recording != self.recording:
            self.recording = recording
            self.refresh()

    def render(self) -> Content:
        """The size needed, the size there is, and what to do."""
        size, (width, height) = self.app.size, NEEDED
        return Content(
            f"imutui needs {width}x{height} characters;\nthis terminal has {size.width}x{size.height}.\n\n"
            f"Make it larger, or the font smaller.\nThe {'RECORDING' if self.recording else 'acquisition'} goes on."
            " q quits, d detaches; no other key acts."
        )
