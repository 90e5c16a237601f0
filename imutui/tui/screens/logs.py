"""Logs: recordings, what is in them, and what can be made of them."""

from collections.abc import Iterable

from textual.widget import Widget

from imutui.tui.screens.page import Page


class LogsPage(Page):
    """Not built yet."""

    TITLE = "Logs"

    def body(self) -> Iterable[Widget]:
        """Nothing yet."""
        return ()
