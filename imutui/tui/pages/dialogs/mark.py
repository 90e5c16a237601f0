"""Asks for the text of a mark."""

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Input, Static


class MarkDialog(ModalScreen[str | None]):
    """A field for a mark's text; returns it, None for Esc. The mark is set at Enter."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,ctrl+c", "cancel", "cancel", priority=True)]

    def compose(self) -> ComposeResult:
        """Title, the field for the mark's text, and what Enter and Escape do."""
        with Vertical(classes="dialog"):
            yield Static(Content.styled("Mark in the recording", "bold"), classes="title")
            yield Input(placeholder="what happens now, for example: table to 90 deg", compact=True)
            yield Static(Content("Enter sets it with the time of Enter. Esc cancels."), classes="text")

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Return the text; an empty one is "mark"."""
        self.dismiss(event.value.strip() or "mark")

    def action_cancel(self) -> None:
        """Close without a mark."""
        self.dismiss(None)
