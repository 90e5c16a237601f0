"""One of a few values, all in sight; which one it is shows without colour."""

from typing import ClassVar

from textual import events
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.message import Message
from textual.reactive import reactive
from textual.widget import Widget


class Radio(Widget, can_focus=True):
    """One line: all values, the chosen one crossed, and what that one means: "(x) stream  ( ) polled   …".

    `values`: value and what it means; the first one is chosen.
    """

    DEFAULT_CSS = """
    Radio { width: 1fr; height: 1; background: $surface; text-wrap: nowrap; text-overflow: ellipsis; }
    Radio:focus { background: $block-cursor-blurred-background; text-style: bold; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,k", "app.focus_previous", show=False),
        Binding("down,j", "app.focus_next", show=False),
        Binding("left,h", "step(-1)", "other", show=False),
        Binding("right,l,space", "step(1)", "other", show=False),
    ]
    value: reactive[str] = reactive("")

    class Changed(Message):
        """Another value is chosen."""

    def __init__(self, values: dict[str, str], *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._values = dict(values)
        self.set_reactive(Radio.value, next(iter(values)))

    def render(self) -> Content:
        """All values, the chosen one crossed and explained."""
        return Content(f"{'  '.join(self._cells())}   {self._values[self.value]}")

    def _cells(self) -> list[str]:
        return [f"({'x' if value == self.value else ' '}) {value}" for value in self._values]

    def choose(self, value: str, meaning: str) -> None:
        """Choose a value, offering it from now on if it was not one of them."""
        self._values.setdefault(value, meaning)
        self.value = value
        self.refresh()

    def watch_value(self) -> None:
        """Tell the page that another value is chosen."""
        self.post_message(self.Changed())

    def action_step(self, step: int) -> None:
        """Choose the next or previous value."""
        values = list(self._values)
        self.value = values[(values.index(self.value) + step) % len(values)]

    def on_click(self, event: events.Click) -> None:
        """Choose the value that was clicked."""
        start = 0
        for value, cell in zip(self._values, self._cells(), strict=True):
            if start <= event.x < start + len(cell):
                self.value = value
            start += len(cell) + 2
