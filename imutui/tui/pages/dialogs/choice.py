"""A question with a few answers, each with a key."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from textual import events
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.widget import Widget
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from imutui.tui.pages.dialogs.base import Dialog
from imutui.tui.widgets.wrapped_text import WrappedText

_STAY = "stay"


@dataclass(frozen=True, slots=True)
class Answer:
    """One answer: key, what it returns, what it says; `also` has more keys, which are not shown."""

    key: str
    name: str
    label: str
    also: str = ""


class ChoiceDialog(Dialog[str | None]):
    """Asks; returns the chosen answer's name, None for Esc.

    `title`, `body`: what it is about.
    `answers`: the first one is Enter's.
    `careful`: whether Enter is Esc instead.
    `stay`: what Esc means here.
    `letters`: whether the answers' keys choose. Without them a dialog that comes by itself can't be answered unawares
      by somebody who is typing.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "choose", "choose", key_display="enter", priority=True),
    ]

    def __init__(
        self,
        title: str,
        body: str,
        answers: list[Answer],
        *,
        careful: bool = False,
        stay: str = "cancel",
        letters: bool = True,
    ) -> None:
        super().__init__()
        self._careful = careful
        self._title = title
        self._body = body
        self._answers = answers
        self._stay = stay
        self._letters = letters

    def body(self) -> Iterable[Widget]:
        """Title, the question, and the answers with their keys."""
        yield Static(Content.styled(self._title, "bold"), classes="title")
        yield WrappedText(self._body, classes="text")
        options = [Option(Content(f" {a.key if self._letters else ' '}  {a.label}"), id=a.name) for a in self._answers]
        yield OptionList(*options, Option(Content(f" Esc  {self._stay}"), id=_STAY), compact=True, markup=False)

    def on_mount(self) -> None:
        """Begin on the answer that Enter takes."""
        self.query_one(OptionList).highlighted = len(self._answers) if self._careful else 0

    def on_key(self, event: events.Key) -> None:
        """A letter chooses at once, and is no key of the page below any more."""
        for answer in self._answers if self._letters else []:
            if event.character is not None and event.character in (answer.key, *answer.also):
                event.stop()
                event.prevent_default()
                self.dismiss(answer.name)
                return

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """A click chooses."""
        self.dismiss(None if event.option_id == _STAY else event.option_id)

    def action_choose(self) -> None:
        """Take the answer with the cursor."""
        self.query_one(OptionList).action_select()
