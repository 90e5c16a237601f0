"""The last events, newest at the bottom; for terminals with room beside the table."""

from textual.content import Content

from imutui.tui.connection.model import View
from imutui.tui.widgets.notice import event_text
from imutui.tui.widgets.text_lines import TextLines


class EventList(TextLines):
    """The last events of the acquisition, newest at the bottom: as many as there are lines."""

    DEFAULT_CSS = "EventList { height: 100%; padding: 0 1; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """A headline, and under it as many of the last events as there is room for."""
        events = (view.now["events"] if view.now is not None else [])[-max(self.content_size.height - 1, 1) :]
        head = self.line(("events, UTC".ljust(width), "bold underline"))
        rows = [self.line(event_text(event)).truncate(width, ellipsis=True) for event in events]
        return [head, *(rows or [self.line(("none yet", "dim"))])]
