"""The screen's last gate: text from outside shows its control characters and obeys none of them."""

from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

from imutui.plain_text import masked


class ControlCharacterFilter(LineFilter):
    """Puts a sign of one cell in the place of every character that would act on the terminal.

    What is known to come from outside was made visible before it was laid out; this is for what nobody thought of.
    """

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """The line as it may be sent."""
        if all(segment.control or segment.text.isprintable() for segment in segments):
            return segments
        return [s if s.control else Segment(masked(s.text), s.style) for s in segments]
