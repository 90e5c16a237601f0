"""What a page to hand over consists of, apart from how it is written: sections of blocks.

A page holds one result or several; `html` writes it. Text in backticks is to be typed or is a name of a file. Nothing
here knows of a file, a browser or a library that draws.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class Paragraph:
    """Whole sentences."""

    text: str


@dataclass(frozen=True, slots=True)
class Subheading:
    """What the next blocks are of."""

    text: str


@dataclass(frozen=True, slots=True)
class Items:
    """Sentences that stand one below the other; `numbered` if their order says which comes first."""

    texts: tuple[str, ...]
    numbered: bool = False


@dataclass(frozen=True, slots=True)
class Facts:
    """Labels with their values."""

    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Column:
    """A column: its heading, and what cells are: "text", "number", "code" (a short name), "file", "hash", "link"."""

    heading: str
    kind: str = "text"


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under headings; each row has a cell a column."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""


@dataclass(frozen=True, slots=True)
class Code:
    """Text of a file, as it is; folded away under some words where it is long."""

    text: str
    folded: str = ""


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes: what it shows, in a few words, and what draws it."""

    name: str
    draw: "Callable[[Axes], None]"


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of one panel or several."""

    name: str  # of its files, without suffix
    # title, caption: what it shows; how to read it
    title: str
    caption: str
    panels: tuple[Panel, ...]  # side by side where there is room


Block: TypeAlias = Paragraph | Subheading | Items | Facts | Table | Code | Figure


@dataclass(frozen=True, slots=True)
class Section:
    """A heading with blocks under it."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True, slots=True)
class Article:
    """All that is said of one result."""

    title: str  # what it is of
    kind: str  # "measured", "simulated" or "unknown": who made the readings
    origin: str  # the same as a sentence
    sections: tuple[Section, ...]  # in order

    def figures(self) -> list[Figure]:
        """All figures that show something, in order; one has no panel where every channel is set aside."""
        blocks = (block for section in self.sections for block in section.blocks)
        return [block for block in blocks if isinstance(block, Figure) and block.panels]


@dataclass(frozen=True, slots=True)
class Page:
    """One result or several, to hand over."""

    title: str
    articles: tuple[Article, ...]
