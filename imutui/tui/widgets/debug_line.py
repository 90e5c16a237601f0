"""What drawing costs, in one line that is shown on request."""

from textual.content import Content

from imutui.tui.connection.model import View
from imutui.tui.widgets.text_lines import TextLines


class DebugLine(TextLines):
    """Frames and bytes a second, processor, age of the newest sample, queue."""

    DEFAULT_CSS = "DebugLine { height: 1; display: none; color: $foreground 60%; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """What the frame monitor has measured, cut to the width."""
        return [self.line(f" {view.debug}"[:width])]
