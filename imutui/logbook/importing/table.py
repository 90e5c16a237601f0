"""A recording of another program as named columns, read in pieces; and what the user asked of its import."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TypeAlias

import numpy as np

from filters.imu import STANDARD_GRAVITY
from imutui import command_line
from imutui.logbook.foreign_log import RefusedLogError


class ImportDataError(RefusedLogError):
    """The recording cannot be imported as it is; the message says what, where, and what to do next.

    `cures`: commands that take it, where the message has none.
    """


@dataclass(frozen=True, slots=True)
class Column:
    """A column: its name and unit as the file states them, "" where it does not."""

    name: str
    unit: str = ""
    is_sure: bool = True  # False for the unit of a convention, which the numbers may contradict


Rows: TypeAlias = tuple[float, list[np.ndarray]]
"""The share of the file that has been read (0 to 1), and rows of the chosen columns: arrays of shape (n,)."""


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of a file.

    `columns`: in the file's order; names may be absent, or stand twice.
    `pieces`: called with the positions of columns (first is 0), yields their rows from the beginning, a bounded number
      at a time. Numbers are float64 or int64; a cell without a number is NaN.
    `remarks`: what the reader assumed or left out; complete once a pass has ended.
    `reasons`: why a row (first is 0) holds NaN where the file does not: it cannot be read.
    """

    path: Path
    columns: tuple[Column, ...]
    pieces: Callable[[Sequence[int]], Iterator[Rows]]
    remarks: list[str] = field(default_factory=list)
    reasons: dict[int, str] = field(default_factory=dict)

    def remark(self, text: str) -> None:
        """Keep a remark; a second pass makes the same ones."""
        if text not in self.remarks:
            self.remarks.append(text)


@dataclass(frozen=True, slots=True)
class Asked:
    """What the user asked of an import; texts are those of the options."""

    columns: str = ""
    units: str = ""
    drop: str = ""
    stamps: str = "sampling"
    topic: str = ""
    # start, end: part to take, s since the first sample
    start: float | None = None
    end: float | None = None
    g_unit: float = STANDARD_GRAVITY  # m/s² of one g in the log
    output: Path = Path("LOG.mcap")
    others: tuple[str, ...] = ()  # further words of the command

    def command(self, path: Path, **changes: str) -> str:
        """Return the same import with other options; entries of `columns`, `units` and `drop` are added."""
        words: list[str | Path] = ["import", path, "-o", self.output]
        for option in fields(self)[:7]:
            value = getattr(self, option.name)
            if option.name in changes:
                value = _joined(value, changes[option.name]) if option.name in _LISTS else changes[option.name]
            if value not in (None, option.default):
                words += [f"--{option.name}", str(value)]
        return command_line.command(*words, *self.others)


_LISTS = ("columns", "units", "drop")


def _joined(before: str, added: str) -> str:
    """Join two lists of entries; one that is added replaces one of the same key."""
    keys = {entry.partition("=")[0].partition(":")[0].strip() for entry in added.split(",")}
    kept = [
        e.strip() for e in before.split(",") if e.strip() and e.partition("=")[0].partition(":")[0].strip() not in keys
    ]
    return ", ".join([*kept, added])
