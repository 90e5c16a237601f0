"""CSV, NPZ and Parquet of a table, written block by block: memory does not grow with the log."""

import csv
import json
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TypeAlias

import numpy as np

from imutui.logbook import parquet
from imutui.plain_text import in_line

# ------------------------------------------------------------------------------------------------------------ columns
# Columns with their units, in blocks of rows, the same for every format.

Block: TypeAlias = dict[str, np.ndarray]  # rows of each column, shape (n,) or (n, width)

_PARTS = {3: "xyz", 4: "wxyz"}


@dataclass(frozen=True, slots=True)
class Column:
    """A quantity."""

    name: str  # as in docs/formats.md
    unit: str
    width: int = 1  # its components; 1 for a number

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
    blocks: Callable[[], Iterator[Block]]  # returns an iterator over the rows, a bounded number at a time
    about: dict[str, str] = field(default_factory=dict)  # statements about them: names and texts
    damage: Callable[[], str] = lambda: ""  # returns what is wrong with the log, "" for nothing, after the last block

    def units(self) -> dict[str, str]:
        """Return the unit of each column."""
        return {column.name: column.unit for column in self.columns}


def components(column: Column, rows: np.ndarray) -> list[np.ndarray]:
    """Return a column's rows as one array a component."""
    return [rows] if column.width == 1 else list(rows.T)


# ------------------------------------------------------------------------------------------------------------ formats

FORMATS = ("csv", "npz", "parquet")
Progress = Callable[[int], None]  # called with the number of rows written

_COPIED = 2**20


def write(kind: str, table: Table, path: Path, progress: Progress = lambda rows: None) -> int:
    """Write a table to a file, which is replaced; returns the number of rows.

    `kind`: one of `FORMATS`.
    `table`: what to write.
    `path`: where to.
    `progress`: called with the number of rows written, now and then.
    """
    return {"csv": _csv, "npz": _npz, "parquet": _parquet}[kind](table, path, progress)


def _csv(table: Table, path: Path, progress: Progress) -> int:
    rows, units = 0, ", ".join(f"{name} {unit}" for name, unit in table.units().items())
    with path.open("w", newline="", encoding="utf-8") as stream:
        for line in (f"units: {units}", *(f"{name}: {value}" for name, value in table.about.items())):
            stream.write(f"# {in_line(line)}\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([part for column in table.columns for part in column.parts])
        for block in table.blocks():
            columns = [part for column in table.columns for part in components(column, block[column.name])]
            # Python's numbers write themselves with as few digits as lead back to the same bits
            writer.writerows(zip(*(part.tolist() for part in columns), strict=True))
            rows += len(columns[0])
            progress(rows)
    return rows


def _npz(table: Table, path: Path, progress: Progress) -> int:
    """Each array in a file of its own until its length is known, which its head begins with."""
    rows = 0
    with ExitStack() as stack:
        spools: dict[str, IO[bytes]] = {
            column.name: stack.enter_context(tempfile.TemporaryFile(dir=path.parent)) for column in table.columns
        }
        for block in table.blocks():
            for name, spool in spools.items():
                spool.write(np.ascontiguousarray(block[name]).tobytes())
            rows += len(block[table.columns[0].name])
            progress(rows)
        archive = stack.enter_context(zipfile.ZipFile(path, "w", zipfile.ZIP_STORED, allowZip64=True))
        for column in table.columns:
            _spooled(archive, column, rows, spools[column.name])
        for name, text in (("units", json.dumps(table.units())), ("about", json.dumps(table.about))):
            _array(archive, name, np.array(text))
    return rows


def _spooled(archive: zipfile.ZipFile, column: Column, rows: int, spool: IO[bytes]) -> None:
    shape = (rows,) if column.width == 1 else (rows, column.width)
    head = {"descr": "<f8", "fortran_order": False, "shape": shape}
    spool.seek(0)
    with archive.open(f"{column.name}.npy", "w", force_zip64=True) as member:
        np.lib.format.write_array_header_1_0(member, head)
        shutil.copyfileobj(spool, member, _COPIED)


def _array(archive: zipfile.ZipFile, name: str, array: np.ndarray) -> None:
    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
        np.lib.format.write_array(member, array, allow_pickle=False)


def _parquet(table: Table, path: Path, progress: Progress) -> int:
    """A row group a block, each component a column."""
    columns = [parquet.Column(part, "double", column.unit) for column in table.columns for part in column.parts]
    rows = 0

    def batches() -> Iterator[dict[str, np.ndarray]]:
        nonlocal rows
        for block in table.blocks():
            parts = [part for column in table.columns for part in components(column, block[column.name])]
            yield {column.name: np.ascontiguousarray(part) for column, part in zip(columns, parts, strict=True)}
            rows += len(parts[0])
            progress(rows)

    parquet.write(path, columns, batches(), {f"imutui.{name}": value for name, value in table.about.items()})
    return rows
