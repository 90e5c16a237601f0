"""Sends only the cells that changed.

Textual sends a changed line from the widget's left edge on; on a poor link that is most of the screen ten times a
second. Here each line is compared with what the terminal holds, and colours are sent only where they change.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from rich.color import ColorSystem
from rich.console import Console
from rich.control import Control
from rich.style import Style
from textual.strip import Strip

from imutui.tui.terminal.textual_private import ChopsUpdate, CompositorUpdate, LayoutUpdate, color_system

Cells = tuple[str, list[Style | None]]  # characters of a strip and the style of each; all are one cell wide
_GAP = 7  # unchanged cells between two changes that cost less than another jump of the cursor


class Painter:
    """Remembers what the terminal holds."""

    def __init__(self) -> None:
        self._lines: dict[int, dict[int, Strip]] = {}

    def forget(self) -> None:
        """Something else has written on the terminal."""
        self._lines.clear()

    def exact(self, update: Any) -> Any:
        """An update that sends no cell which the terminal holds already.

        `update`: what Textual wants shown; what is not known here is passed on, and nothing is taken as remembered.
        """
        if isinstance(update, ChopsUpdate):
            return _Sent(lambda console: written(self.changes(update), color_system(console)))
        if isinstance(update, LayoutUpdate):
            return _Sent(partial(self._whole, update))
        if update is not None:
            self._lines.clear()
        return update

    def _whole(self, update: LayoutUpdate, console: Console) -> str:
        """All lines are sent as they are, and remembered."""
        update.strips = [list(strips) for strips in update.strips]
        self._lines.clear()
        for y, strips in enumerate(update.strips, update.region.y):
            x, line = update.region.x, {}
            for strip in strips:
                line[x] = strip
                x += strip.cell_length
            self._lines[y] = line
        return update.render_segments(console)

    def changes(self, update: ChopsUpdate) -> Iterator[tuple[int, int, Cells]]:
        """Place (x, y) and cells of every run that differs from what the terminal holds."""
        for y, x1, x2 in update.spans:
            held = self._held(y, update.chops[y])
            for end, (x, strip) in zip(update.chop_ends[y], update.chops[y].items(), strict=False):
                if strip is None or x >= x2 or end <= x1:
                    continue
                before, held[x] = held.get(x), strip
                if before is not strip:
                    for start, cells in differing(before, strip):
                        yield x + start, y, cells

    def _held(self, y: int, line: Mapping[int, Strip | None]) -> dict[int, Strip]:
        """What is remembered of a line; nothing if it was divided otherwise."""
        held = self._lines.get(y, {})
        if not held.keys() <= line.keys():
            held = {}
        self._lines[y] = held
        return held


class _Sent(CompositorUpdate):
    """What is made of an update when it is sent."""

    def __init__(self, render: Callable[[Console], str]) -> None:
        self._render = render

    def render_segments(self, console: Console) -> str:
        return self._render(console)


def differing(before: Strip | None, after: Strip) -> list[tuple[int, Cells]]:
    """Start and cells of the runs in which two strips of one place differ."""
    text, styles = new = flat(after)
    if before is None or len(text) != after.cell_length:  # wide signs: a character is not a cell
        return [(0, new)]
    old_text, old_styles = flat(before)
    if len(old_text) != before.cell_length or len(old_text) != len(text):
        return [(0, new)]
    if old_styles == styles:
        changed = [i for i, (a, b) in enumerate(zip(old_text, text, strict=True)) if a != b]
    else:
        both = zip(old_text, text, old_styles, styles, strict=True)
        changed = [i for i, (a, b, c, d) in enumerate(both) if a != b or c != d]
    return [(start, (text[start:end], styles[start:end])) for start, end in _runs(changed)]


def flat(strip: Strip) -> Cells:
    """Characters and styles of a strip."""
    styles: list[Style | None] = []
    for text, style, _ in strip:
        styles += [style] * len(text)
    return strip.text, styles


def _runs(changed: Sequence[int]) -> list[tuple[int, int]]:
    """Start and end of runs, short gaps closed."""
    runs: list[tuple[int, int]] = []
    for i in changed:
        if runs and i - runs[-1][1] <= _GAP:
            runs[-1] = (runs[-1][0], i + 1)
        else:
            runs.append((i, i + 1))
    return runs


def written(changes: Iterator[tuple[int, int, Cells]], colours: ColorSystem) -> str:
    """Terminal sequences of runs of cells: a style is sent where it differs from the last one sent."""
    out: list[str] = []
    current: Style | None = None
    for x, y, (text, styles) in changes:
        out.append(Control.move_to(x, y).segment.text)
        start = 0
        for end in range(1, len(text) + 1):
            if end < len(text) and (styles[end] is styles[start] or styles[end] == styles[start]):
                continue
            style, part = styles[start], text[start:end]
            start = end
            if style is not None and style.link:
                out.append("\x1b[0m" + Strip.render_style(style, part, color_system=colours))
                current = None
                continue
            if style != current:
                ansi = "" if style is None else Strip.render_ansi(style, colours)
                out.append(f"\x1b[0;{ansi}m" if ansi else "\x1b[0m")
                current = style
            out.append(part)
    if current is not None:
        out.append("\x1b[0m")
    return "".join(out)
