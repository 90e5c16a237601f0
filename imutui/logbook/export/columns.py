"""What is exported: columns with their units, in blocks of rows, whatever the format."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

Block: TypeAlias = dict[str, np.ndarray]
"""Rows of each column, shape (n,) or (n, width)."""

_PARTS = {3: "xyz", 4: "wxyz"}


@dataclass(frozen=True, slots=True)
class Column:
    """A quantity."""

    name: str  # as contracts and docs/formats.md have it
    unit: str = ""  # "" for a text or a number of things
    width: int = 1  # its components; 1 for a number
    dtype: str = "f8"  # "f8", "i8", "u8", "?" or "U", a text

    @property
    def parts(self) -> list[str]:
        """Names of its components where each is a column of its own, as in CSV."""
        if self.width == 1:
            return [self.name]
        return [f"{self.name}_{part}" for part in _PARTS.get(self.width, range(self.width))]


@dataclass(frozen=True, slots=True)
class Table:
    """Columns, and how to walk through their rows."""

    columns: tuple[Column, ...]  # in order
    blocks: Callable[[], Iterator[Block]]  # gives the rows anew with every call, a bounded number at a time
    about: dict[str, str] = field(default_factory=dict)  # what is to be known of them: names and texts
    damage: Callable[[], str] = lambda: ""  # what is wrong with the log, "" for nothing; known behind the last block

    def units(self) -> dict[str, str]:
        """Unit of each column that has one."""
        return {column.name: column.unit for column in self.columns if column.unit}


def components(column: Column, rows: np.ndarray) -> list[np.ndarray]:
    """A column's rows as one array a component."""
    return [rows] if column.width == 1 else list(rows.T)
