"""Why the badge is what it is: every rule, every alarm, everything that has no room on the page."""

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Static

from imutui.tui.connection.model import View
from imutui.tui.pages.filter.explanation import explanation
from imutui.tui.terminal.glyphs import choose


class WhyDialog(ModalScreen[None]):
    """Every rule, alarm and number of the filter, as of the moment it was asked for, to scroll.

    Parameters
    ----------
    view : View
        What is explained.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q,w,enter", "dismiss_why", "close", priority=True),
        Binding("j", "down", show=False),
        Binding("k", "up", show=False),
    ]

    def __init__(self, view: View) -> None:
        super().__init__()
        self._view = view

    def compose(self) -> ComposeResult:
        """The explanation, and how to leave."""
        with VerticalScroll(classes="dialog help"):
            yield Static(Content(choose().text(explanation(self._view))))
            yield Static(Content.styled("arrows scroll, Esc closes", "dim"))

    def action_dismiss_why(self) -> None:
        """Back to the page."""
        self.dismiss(None)

    def action_down(self) -> None:
        """Scroll as in vi."""
        self.query_one(VerticalScroll).scroll_down()

    def action_up(self) -> None:
        """Scroll as in vi."""
        self.query_one(VerticalScroll).scroll_up()
