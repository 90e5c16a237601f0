"""Table: a profile as a guided list."""

from collections.abc import Iterable

from textual.widget import Widget

from imutui.tui.screens.page import Page


class TablePage(Page):
    """Not built yet."""

    TITLE = "Table"

    def body(self) -> Iterable[Widget]:
        """Nothing yet."""
        return ()
