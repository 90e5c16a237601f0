"""How the screen looks: the configuration's section `screen`, scroll bars, and what stands for control characters."""

from dataclasses import dataclass

from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter
from textual.scrollbar import ScrollBar, ScrollBarRender
from textual.theme import BUILTIN_THEMES

from filters.errors import InputError
from imutui.plain_text import masked
from imutui.tui.terminal.glyphs import GLYPHS, Glyphs

SHORT_THEMES = {"dark": "textual-dark", "light": "textual-light"}
"""Names that a person would try, and the themes they stand for."""
_PLOTS = ("auto", "scroll", "sweep", "numbers")


@dataclass(frozen=True, slots=True)
class Appearance:
    """What the configuration says about the screen.

    Raises InputError if there is no such theme, or no such kind of signs or plots; the message lists those there are.
    """

    theme: str = ""  # name of a theme, "dark" or "light"; empty leaves it to the terminal
    glyphs: str = "auto"  # "auto", "braille", "block" or "ascii"
    fps: float = 0.0  # redraws per second; 0 for the usual
    plot: str = "auto"  # "auto", "scroll", "sweep" or "numbers"

    def __post_init__(self) -> None:
        _one_of("theme", self.theme, ("", *SHORT_THEMES, *BUILTIN_THEMES))
        _one_of("glyphs", self.glyphs, ("auto", *GLYPHS))
        _one_of("plot", self.plot, _PLOTS)
        if not 0.0 <= self.fps <= 60.0:
            raise InputError(f"`screen.fps` is {self.fps:g}; redraws per second, up to 60, or 0 for the usual 10")

    def theme_for(self, terminal: str) -> str:
        """The theme for a terminal of that TERM; empty for Textual's own."""
        if self.theme:
            return SHORT_THEMES.get(self.theme, self.theme)
        # the console has sixteen colours; approximating a theme's to them loses contrast
        return "ansi-dark" if terminal == "linux" else ""


def _one_of(key: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise InputError(f'`screen.{key}` is "{value}"; there are: {", ".join(name for name in known if name)}')


class ControlCharacterFilter(LineFilter):
    """Puts a sign of one cell in the place of every character that would act on the terminal.

    What is known to come from outside was made visible before it was laid out; this is for what nobody thought of.
    """

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        if all(segment.control or segment.text.isprintable() for segment in segments):
            return segments
        return [s if s.control else Segment(masked(s.text), s.style) for s in segments]


class WholeCells(ScrollBarRender):
    """A bar whose ends are at whole cells: drawn by background colours alone."""

    VERTICAL_BARS = [" "] * len(ScrollBarRender.VERTICAL_BARS)
    HORIZONTAL_BARS = [" "] * len(ScrollBarRender.HORIZONTAL_BARS)


def draw_scroll_bars_with(glyphs: Glyphs) -> None:
    """Have all scroll bars drawn with a set of signs, of this process."""
    ScrollBar.renderer = ScrollBarRender if glyphs.name == "braille" else WholeCells
