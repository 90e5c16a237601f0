"""Record: what is being written, how fast, and what goes into it."""

from collections.abc import Iterable

from textual.widget import Widget

from imutui.tui.screens.page import Page


class RecordPage(Page):
    """Not built yet."""

    TITLE = "Record"

    def body(self) -> Iterable[Widget]:
        """Nothing yet."""
        return ()
