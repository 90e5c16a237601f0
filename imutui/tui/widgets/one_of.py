"""One of a few values, all in sight; which one it is shows without colour."""

from typing import ClassVar

from textual import events
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.message import Message
from textual.reactive import reactive
from textual.widget import Widget


class OneOf(Widget, can_focus=True):
    """A line a value: "(x) stream", "( ) polled".

    Parameters
    ----------
    values : dict
        Value and what it means; the first one is chosen.
    """

    DEFAULT_CSS = """
    OneOf { width: 1fr; height: auto; background: $surface; }
    OneOf:focus { background: $block-cursor-blurred-background; text-style: bold; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up,left,k,h", "step(-1)", "other", show=False),
        Binding("down,right,j,l,space", "step(1)", "other", show=False),
    ]
    value: reactive[str] = reactive("")

    class Changed(Message):
        """Another value is chosen."""

    def __init__(self, values: dict[str, str], *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._values = values
        self.set_reactive(OneOf.value, next(iter(values)))

    def render(self) -> Content:
        """All values, the chosen one crossed."""
        return Content("\n").join(
            Content(f"({'x' if value == self.value else ' '}) {value}  {meaning}")
            for value, meaning in self._values.items()
        )

    def watch_value(self) -> None:
        """Tell."""
        self.post_message(self.Changed())

    def action_step(self, step: int) -> None:
        """Choose the next or previous value."""
        values = list(self._values)
        self.value = values[(values.index(self.value) + step) % len(values)]

    def on_click(self, event: events.Click) -> None:
        """Choose the value that was clicked."""
        if 0 <= event.y < len(self._values):
            self.value = list(self._values)[event.y]
