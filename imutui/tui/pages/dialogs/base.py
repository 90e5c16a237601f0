"""What all dialogs share: a frame, a line with the keys that work in it, and where typed letters go."""

from collections.abc import Callable, Iterable
from typing import ClassVar, Literal

from textual.app import ComposeResult
from textual.await_complete import AwaitComplete
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen, ScreenResultType
from textual.widget import Widget
from textual.widgets import Input, Static

from imutui.tui.widgets.page_frame import KeysLine
from imutui.tui.widgets.text_lines import WrappedText


class Dialog(ModalScreen[ScreenResultType]):
    """Base of dialogs; subclasses give `body`. Its footer lies over that of the page, whose keys do nothing now."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "cancel", "back", key_display="esc", priority=True),
        Binding("ctrl+c", "cancel", show=False, priority=True),
        Binding("ctrl+z", "app.suspend_process", show=False),
    ]

    _answered = False

    def dismiss(self, result: ScreenResultType | None = None) -> AwaitComplete:
        """Close with an answer, the first one: further keys may be on their way while it goes."""
        if self._answered:
            return AwaitComplete()
        self._answered = True
        return super().dismiss(result)

    @property
    def first_field(self) -> Input | None:
        """Where letters go that were typed before any field had the focus; None in a dialog without one."""
        return None

    def compose(self) -> ComposeResult:
        with Vertical(classes="dialog"):
            yield from self.body()
        yield KeysLine()

    def body(self) -> Iterable[Widget]:
        """Widgets inside the frame."""
        raise NotImplementedError

    def action_cancel(self) -> None:
        self.dismiss(None)


def dismiss_after_typing(
    dialog: Dialog[ScreenResultType], field: Input, answer: Callable[[], ScreenResultType]
) -> None:
    """Close with an answer once a field has taken all letters that were typed before: Enter overtakes those."""

    def close() -> None:
        dialog.dismiss(answer())

    field.call_later(dialog.call_later, close)


class FieldDialog(Dialog[str | None]):
    """Title, a field and a hint; returns what was typed, None for Esc or nothing.

    `value`, `placeholder`: to begin with; what stands in an empty field.
    `select`: whether what is typed first replaces the value.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "submit", "take it", key_display="enter", priority=True),
    ]

    def __init__(self, title: str, hint: str, value: str = "", placeholder: str = "", *, select: bool = True) -> None:
        super().__init__()
        self._title, self._hint = title, hint
        self.field = Input(value, placeholder=placeholder, select_on_focus=select, compact=True)
        """Where the text is typed."""

    @property
    def first_field(self) -> Input:
        return self.field

    def body(self) -> Iterable[Widget]:
        yield Static(Content.styled(self._title, "bold"), classes="title")
        yield self.field
        yield WrappedText(self._hint, classes="text")

    def on_mount(self) -> None:
        """Of a long path the end is shown, which is what is changed: once the field has a width."""
        self.call_after_refresh(self._show_end)

    def _show_end(self) -> None:
        chosen = self.field.selection
        self.field.cursor_position = 0
        self.field.cursor_position = len(self.field.value)
        self.field.selection = chosen

    def answer(self) -> str | None:
        """What is returned."""
        return self.field.value.strip() or None

    def action_submit(self) -> None:
        dismiss_after_typing(self, self.field, self.answer)


class ScrollDialog(Dialog[None]):
    """A text to scroll.

    `text`: all of it; signs that the terminal lacks are replaced.
    `first`: how the paragraph begins that is on top at first; what is before it can be scrolled to.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("down", "scroll('down')", "scroll", key_display="up down", priority=True),
        Binding("j", "scroll('down')", show=False, priority=True),
        Binding("up,k", "scroll('up')", show=False, priority=True),
        Binding("pagedown", "scroll('page_down')", "page", key_display="pgup pgdn", priority=True),
        Binding("space", "scroll('page_down')", show=False, priority=True),
        Binding("pageup", "scroll('page_up')", show=False, priority=True),
        Binding("escape", "cancel", "close", key_display="esc", priority=True),
        Binding("q,enter", "cancel", show=False, priority=True),
    ]

    def __init__(self, text: str, first: str = "") -> None:
        super().__init__()
        self._parts = text.split("\n\n")
        self._first = next((part for part in self._parts if first and part.startswith(first)), "")

    def compose(self) -> ComposeResult:
        with VerticalScroll(classes="dialog help"):
            for part in self._parts:
                yield WrappedText(f"{part}\n" if part is not self._parts[-1] else part)
        yield KeysLine()

    def on_mount(self) -> None:
        if self._first:
            self.call_after_refresh(self._show_first)

    def _show_first(self) -> None:
        part = self.query(WrappedText)[self._parts.index(self._first)]
        self.query_one(VerticalScroll).scroll_to_widget(part, top=True, animate=False)

    def action_scroll(self, how: Literal["down", "up", "page_down", "page_up"]) -> None:
        getattr(self.query_one(VerticalScroll), f"scroll_{how}")(animate=False)
