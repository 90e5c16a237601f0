"""A list of lines with a cursor, for arrow and vi keys. Enter is left to the page, which knows what it means."""

from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.content import Content
from textual.widgets import OptionList
from textual.widgets.option_list import Option


class OptionRows(OptionList, inherit_bindings=False):
    """A list of lines that change in place, one of them under the cursor."""

    DEFAULT_CSS = """
    OptionRows {
        height: 1fr; border: none; padding: 0; background: $background; scrollbar-size-vertical: 1;
        text-wrap: nowrap; text-overflow: ellipsis;
    }
    OptionRows:focus { border: none; background-tint: $foreground 0%; }
    Rows > .option-list--option { padding: 0; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("down,j", "cursor_down", "down", show=False),
        Binding("up,k", "cursor_up", "up", show=False),
        Binding("home,g", "first", "first", show=False),
        Binding("end,G", "last", "last", show=False),
        Binding("pagedown", "page_down", "page down", show=False),
        Binding("pageup", "page_up", "page up", show=False),
    ]

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id, compact=True, markup=False)
        self._shown: list[str] = []

    def fill(self, lines: list[Content]) -> None:
        """Show these lines; the cursor stays at its number, and what reads the same is not drawn anew."""
        plain = [line.plain for line in lines]
        if len(lines) == len(self._shown):
            for number, (line, before) in enumerate(zip(lines, self._shown, strict=True)):
                if line.plain != before:
                    self.replace_option_prompt_at_index(number, line)
        else:
            at = self.highlighted or 0
            self.clear_options()
            self.add_options([Option(line) for line in lines])
            self.highlighted = min(at, len(lines) - 1) if lines else None
        self._shown = plain

    def as_text(self) -> str:
        return "\n".join(line.rstrip() for line in self._shown)

    @property
    def cursor(self) -> int | None:
        return self.highlighted if self.highlighted is not None and self.highlighted < len(self._shown) else None
