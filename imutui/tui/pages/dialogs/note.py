"""Asks for a note, and for the operator's name where that can be changed too."""

from collections.abc import Iterable
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.content import Content
from textual.widget import Widget
from textual.widgets import Input, Label, Static

from imutui.tui.pages.dialogs.base import Dialog, dismiss_after_typing
from imutui.tui.widgets.wrapped_text import WrappedText


class NoteDialog(Dialog[tuple[str, str] | None]):
    """Returns note and operator as they were left at Enter, each may be empty; None for Esc.

    `title`, `hint`: what it is for, and where it goes.
    `note`: to begin with.
    `operator`: to begin with; None where only the note is asked for.
    """

    DEFAULT_CSS = """
    NoteDialog .row { height: 1; margin-bottom: 1; }
    NoteDialog .row Label { width: 10; }
    NoteDialog .row Input { width: 1fr; margin-bottom: 0; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "submit", "take it", key_display="enter", priority=True),
        Binding("tab", "app.focus_next", "next field"),
    ]

    def __init__(self, title: str, hint: str, note: str = "", operator: str | None = None) -> None:
        super().__init__()
        self._title, self._hint = title, hint
        self._fields = [Input(note, id="note", compact=True, placeholder="what this recording is of")]
        if operator is not None:
            self._fields.append(Input(operator, id="operator", compact=True))

    @property
    def first_field(self) -> Input:
        """The note's."""
        return self._fields[0]

    def body(self) -> Iterable[Widget]:
        """Title, a field or two, and where it goes."""
        yield Static(Content.styled(self._title, "bold"), classes="title")
        for field in self._fields:
            with Horizontal(classes="row"):
                yield Label(str(field.id))
                yield field
        yield WrappedText(self._hint, classes="text")

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer the way to the next field where there is one."""
        return action != "app.focus_next" or len(self._fields) > 1

    def action_submit(self) -> None:
        """Return what stands in the fields."""
        last = self.focused if isinstance(self.focused, Input) else self._fields[0]
        dismiss_after_typing(self, last, self._answer)

    def _answer(self) -> tuple[str, str]:
        note, operator = [*(field.value.strip() for field in self._fields), ""][:2]
        return note, operator
