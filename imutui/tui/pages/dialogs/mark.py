"""Asks for the text of a mark."""

from typing import ClassVar

from textual.binding import Binding, BindingType

from imutui.tui.pages.dialogs.base import FieldDialog
from imutui.tui.pages.dialogs.choice import ChoiceDialog


class MarkDialog(FieldDialog):
    """A field for a mark's text; returns it, "mark" for nothing, None for Esc. The mark is set at Enter."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "submit", "set it", key_display="enter", priority=True),
    ]

    def __init__(self) -> None:
        hint = "Enter sets it with the time of Enter."
        super().__init__("Mark in the recording", hint, placeholder="what happens now, for example: table to 90 deg")

    def answer(self) -> str:
        """The text; an empty one is "mark"."""
        return self.field.value.strip() or "mark"


def nothing_to_mark() -> ChoiceDialog:
    """Say why there is no mark. In front of the page, so that what is typed next is taken for no key of it."""
    said = "There is nothing to mark. Close this; then r starts a recording, and m marks it."
    return ChoiceDialog("Not recording", said, [], stay="close")
