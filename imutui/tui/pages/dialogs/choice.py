"""A question with a few answers, each with a key."""

from dataclasses import dataclass
from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from imutui.tui import formatting

_ROOM = 66
"""Characters of a line in a dialog."""


@dataclass(frozen=True, slots=True)
class Answer:
    """One answer: key, what it returns, what it says."""

    key: str
    name: str
    label: str


class ChoiceDialog(ModalScreen[str | None]):
    """Asks; returns the chosen answer's name, None for Esc.

    Parameters
    ----------
    title, body : str
        What it is about.
    answers : list of Answer
        The first one is Enter's.
    careful : bool
        Whether Enter cancels instead.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,ctrl+c", "cancel", "cancel", priority=True),
    ]

    def __init__(self, title: str, body: str, answers: list[Answer], *, careful: bool = False) -> None:
        super().__init__()
        self._careful = careful
        self._title = title
        self._body = body
        self._answers = answers

    def compose(self) -> ComposeResult:
        """Title, the question, and the answers with their keys."""
        with Vertical(classes="dialog"):
            yield Static(Content.styled(self._title, "bold"), classes="title")
            yield Static(Content(formatting.folded(self._body, _ROOM)), classes="text")
            options = [Option(Content(f" {a.key}  {a.label}"), id=a.name) for a in self._answers]
            yield OptionList(*options, Option(Content(" Esc  cancel"), id="cancel"), compact=True, markup=False)

    def on_mount(self) -> None:
        """Begin on the answer that Enter takes."""
        if self._careful:
            self.query_one(OptionList).highlighted = len(self._answers)

    def on_key(self, event: events.Key) -> None:
        """A letter chooses at once, and is no key of the page below any more."""
        for answer in self._answers:
            if event.character == answer.key:
                event.stop()
                event.prevent_default()
                self.dismiss(answer.name)
                return

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Enter or a click chooses."""
        self.dismiss(None if event.option_id == "cancel" else event.option_id)

    def action_cancel(self) -> None:
        """Close without an answer."""
        self.dismiss(None)
