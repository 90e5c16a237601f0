"""Blocks as lines of a width, for terminals: tables in columns whose cells go on below, all else as paragraphs."""

import itertools
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence

from imutui.report import wrapping
from imutui.report.blocks import Block, Code, Facts, Figure, Items, Paragraph, Section, Subheading, Table

_BETWEEN = 2
_FIXED = ("code", "number", "bar")


def text(sections: Sequence[Section], width: int, signs: Callable[[str], str] = str) -> str:
    """Sections below each other, each under its title; `signs` has the terminal's signs, whatever their width is."""
    return "\n\n".join(f"{section.title}\n{lines(section.blocks, width, signs)}" for section in sections)


def lines(blocks: Iterable[Block], width: int, signs: Callable[[str], str] = str) -> str:
    """Blocks below each other; figures are left out."""

    def typed(said: str) -> str:
        return signs(said.replace("`", ""))  # on pages only, what is to be typed has a typeface of its own

    return "\n".join(line for block in blocks for line in _block(block, width, typed))


def _block(block: Block, width: int, typed: Callable[[str], str]) -> list[str]:
    match block:
        case Paragraph(said):
            return wrapping.wrap(typed(said), width)
        case Subheading(said):
            return ["", *wrapping.wrap(typed(said), width)]
        case Items(texts):
            return [line for said in texts for line in wrapping.wrap(f"- {typed(said)}", width, "", "  ")]
        case Table():
            return [*_table(block, width, typed), *wrapping.wrap(typed(block.caption), width)]
        case Facts(rows):
            return list(_facts(rows, width, typed))
        case Code(said, folded):
            return [*wrapping.wrap(typed(folded), width), *said.splitlines()]
        case Figure():
            return []


def _facts(rows: Sequence[tuple[str, str]], width: int, typed: Callable[[str], str]) -> Iterator[str]:
    """Labels in one column, and their values beside them, which go on below."""
    label_width = min(max((len(typed(label)) for label, _ in rows), default=0), width // 2)
    for label, said in rows:
        labels = textwrap.wrap(typed(label), label_width) or [""]
        values = wrapping.wrap(typed(said), width - label_width - _BETWEEN)
        for left, right in itertools.zip_longest(labels, values, fillvalue=""):
            yield f"{left:<{label_width + _BETWEEN}}{right}".rstrip()


def _table(table: Table, width: int, typed: Callable[[str], str]) -> Iterator[str]:
    rows = [tuple(map(typed, row)) for row in table.rows]
    # "Channel" over "gx" would cost what the other columns need
    codes = [max((len(row[k]) for row in rows), default=0) for k in range(len(table.columns))]
    heads = [typed(column.heading) if column.kind != "code" or len(column.heading) <= w else ""
             for column, w in zip(table.columns, codes, strict=True)]  # fmt: skip
    head = tuple(heads)
    one_line = [tuple(cell.replace("\n", " ") for cell in row) for row in rows]
    if sum(_needed([head, *one_line])) + _BETWEEN * (len(head) - 1) <= width:
        rows = one_line
    widths = _widths(table, [head, *rows], width)
    for row in (head, *rows):
        cells = [_cell(cell, w) for cell, w in zip(row, widths, strict=True)]
        for k in range(max(1, *map(len, cells))):
            parts = []
            for column, cell, w in zip(table.columns, cells, widths, strict=True):
                part = cell[k] if k < len(cell) else ""
                parts.append(part.rjust(w) if column.kind == "number" else part.ljust(w))
            yield (" " * _BETWEEN).join(parts).rstrip()


def _cell(cell: str, width: int) -> list[str]:
    parts = cell.replace(" %", "\u00a0%").split("\n")
    lines = [line for part in parts for line in textwrap.wrap(part, width, break_on_hyphens=False)]
    return [line.replace("\u00a0", " ") for line in lines]


def _needed(rows: Sequence[tuple[str, ...]]) -> list[int]:
    return [max(1, *(len(line) for cell in column for line in cell.split("\n"))) for column in zip(*rows, strict=True)]


def _widths(table: Table, rows: Sequence[tuple[str, ...]], width: int) -> list[int]:
    """What each column needs; where that is too much the widest columns of text give way, evenly."""
    need = _needed(rows)
    room = width - _BETWEEN * (len(need) - 1)
    text_columns = [k for k, column in enumerate(table.columns) if column.kind not in _FIXED] or list(range(len(need)))
    words = [
        max((len(word) for cell in column for word in cell.split()), default=1) for column in zip(*rows, strict=True)
    ]
    while sum(need) > room and max(need[k] for k in text_columns) > 1:
        # a word is broken only where nothing else gives way
        widest = max(text_columns, key=lambda k: (need[k] > words[k], need[k]))
        need[widest] -= 1
    return need
