"""Asks for what goes into a recording as text: a mark, the note, the operator's name."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.content import Content
from textual.widget import Widget
from textual.widgets import Input, Label, Static

from imutui.session.client import Client
from imutui.tui.pages.base import Page
from imutui.tui.pages.dialogs.base import Dialog, FieldDialog, dismiss_after_typing
from imutui.tui.pages.dialogs.choice import ChoiceDialog
from imutui.tui.widgets.text_lines import WrappedText


class NoteDialog(Dialog[tuple[str, str] | None]):
    """Returns note and operator as they were left at Enter, each may be empty; None for Esc.

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
        return self._fields[0]

    def body(self) -> Iterable[Widget]:
        yield Static(Content.styled(self._title, "bold"), classes="title")
        for field in self._fields:
            with Horizontal(classes="row"):
                yield Label(str(field.id))
                yield field
        yield WrappedText(self._hint, classes="text")

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        return action != "app.focus_next" or len(self._fields) > 1

    def action_submit(self) -> None:
        last = self.focused if isinstance(self.focused, Input) else self._fields[0]
        dismiss_after_typing(self, last, self._answer)

    def _answer(self) -> tuple[str, str]:
        note, operator = [*(field.value.strip() for field in self._fields), ""][:2]
        return note, operator


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


_HINT = "Both go into the file that is being written; what stood there before stays in it as an event."


def ask_for_note(
    page: Page, name: str, hint: str, before: tuple[str, str], then: Callable[[str | None, str | None], None]
) -> None:
    """Ask for note and operator of a file; `then` takes what was changed, and None for what was not."""

    def entered(after: tuple[str, str] | None) -> None:
        if after is not None and after != before:
            then(*(new if new != old else None for new, old in zip(after, before, strict=True)))

    page.app.push_screen(NoteDialog(f"Note of {name}", hint, *before), entered)


def describe_recording(page: Page) -> None:
    """Have the acquisition write note and operator of the recording that runs, if one does, as they are changed."""
    now = page.now
    recording = now["recording"] if now is not None else None
    if now is None or recording is None:
        return
    name = Path(recording["path"]).name

    def changed(note: str | None, operator: str | None) -> None:
        def ask(client: Client) -> str:
            client.describe(note, operator)
            return f"written into {name}"

        page.post_message(Page.Ask(ask, ""))

    ask_for_note(page, name, _HINT, (now["note"], now["operator"]), changed)
