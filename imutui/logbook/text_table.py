"""Tables of text as loggers leave them, read in pieces: the only user of pandas.

The dialect is found on the file's first lines: encoding, separator, decimal sign, remarks, names, a row of units.
"""

import gzip
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from filters.errors import InputError
from imutui import outside_file
from imutui.plain_text import in_line

ROWS = 2**17  # rows of a piece
_HEAD = 2**16  # bytes by which the dialect is found
_BOMS = ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig"))
_SEPARATORS = (",", ";", "\t", "|")
_REMARK = re.compile(r"\s*(#|//|%)")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?|nan|inf|[+-]inf|", re.IGNORECASE)
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d.*")
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a table is written."""

    encoding: str
    separator: str  # " " for any number of blanks
    decimal: str
    names: tuple[str, ...] | None  # None if no row names the columns
    units: tuple[str, ...]  # of a row of units, "" where there is none
    columns: int  # that have a name, or all
    cells: int  # of a row: a separator at its end makes one more
    skipped: int  # lines before the first row of numbers


class TextTable:
    """A table in a file of text, gzipped or not.

    `names`: of its columns, in order; `#1`, `#2`, … where the file names none.
    `units`: of a row of units, by name.
    `notes`: what of the file was passed over, in words; complete after a whole pass over `pieces`.
    Raises InputError if the file is no table.
    Raises OSError if it cannot be read.
    """

    states_units = True

    def __init__(self, path: Path) -> None:
        self.path = path
        with _opened(path) as stream:
            head = stream.read(_HEAD)
        self.dialect = _dialect(head, whole=len(head) < _HEAD)
        numbered = tuple(f"#{k + 1}" for k in range(self.dialect.columns))
        self.names = self.dialect.names or numbered
        self.units = dict(zip(self.names, self.dialect.units, strict=False))
        self.notes: list[str] = []

    @property
    def has_names(self) -> bool:
        """Whether a row of the file names the columns."""
        return self.dialect.names is not None

    def pieces(self, wanted: list[int], progress: Progress = lambda share: None) -> Iterator[list[np.ndarray]]:
        """Yield rows of some columns, by their places, a bounded number at a time.

        Numbers are float64, NaN for an empty cell; dates are datetime64 in ns.
        `progress`: called with the share of the file that has been read.
        Raises InputError for a cell that is neither.
        """
        import pandas as pd

        size = self.path.stat().st_size
        with _opened(self.path) as stream:
            lines = _Lines(stream, self.dialect)
            frames = pd.read_csv(
                lines,
                sep=r"\s+" if self.dialect.separator == " " else self.dialect.separator,
                header=None,
                names=range(self.dialect.cells),
                usecols=wanted,
                decimal=self.dialect.decimal,
                skipinitialspace=True,
                chunksize=ROWS,
                index_col=False,
                low_memory=False,
                float_precision="round_trip",  # exported numbers come back to the last bit
                encoding_errors="replace",
                na_values=["-", "--", "null", "None", "none"],
            )
            first = self.dialect.skipped
            try:
                for frame in frames:
                    yield [self._column(frame[k], first) for k in wanted]
                    first += len(frame)
                    progress(min(1.0, lines.taken / size))
            except pd.errors.ParserError as error:
                raise InputError(f"a row has another number of cells than the others ({error})") from error
            except pd.errors.EmptyDataError:
                raise InputError("it has no row of numbers") from None
        self.notes = lines.notes()

    def _column(self, cells: Any, first: int) -> np.ndarray:
        import pandas as pd

        if cells.dtype.kind in "fiub":
            return np.asarray(cells, float)
        numbers = pd.to_numeric(cells, errors="coerce")
        bad = np.flatnonzero(numbers.isna() & cells.notna())
        if bad.size and _DATE.fullmatch(str(cells.iloc[int(bad[0])])):
            dates = pd.to_datetime(cells, errors="coerce", utc=True, format="ISO8601")
            if not (dates.isna() & cells.notna()).any():
                return np.asarray(dates.dt.tz_localize(None), "datetime64[ns]")
        if bad.size:
            row, cell = first + int(bad[0]) + 1, in_line(str(cells.iloc[int(bad[0])]))[:40]
            raise InputError(f'line {row} or near it, column {self.names[cells.name]}: "{cell}" is not a number')
        return np.asarray(numbers, float)


def _opened(path: Path) -> IO[bytes]:
    stream = outside_file.opened(path)
    magic = stream.read(2)
    stream.seek(0)
    if magic == b"\x1f\x8b":
        return gzip.GzipFile(fileobj=stream)  # type: ignore[return-value]
    return stream


class _Lines(io.TextIOBase):
    """The rows of numbers of a file, for pandas: without remarks, NULs and a last row that was cut."""

    def __init__(self, stream: IO[bytes], dialect: Dialect) -> None:
        self._raw, self._dialect = stream, dialect
        self._text = io.TextIOWrapper(stream, encoding=dialect.encoding, errors="replace", newline=None)
        self._left = dialect.skipped
        self._held = ""
        self._remarks = self._nuls = 0
        self._cut = ""
        self.taken = 0  # bytes of the file

    def read(self, size: int | None = -1) -> str:
        """Return the next rows; "" at the end."""
        while True:
            block = self._text.read(2**20)
            file = getattr(self._raw, "fileobj", self._raw)
            self.taken = file.tell()
            if not block:
                rest, self._held = self._held, ""
                return self._last(rest)
            if "\0" in block:
                self._nuls += block.count("\0")
                block = block.replace("\0", "")
            lines = (self._held + block).split("\n")
            self._held = lines.pop()
            kept = self._kept(lines)
            if kept:
                return "\n".join(kept) + "\n"

    def _kept(self, lines: list[str]) -> list[str]:
        if self._left:
            skipped, lines = lines[: self._left], lines[self._left :]
            self._left -= len(skipped)
        remarks = [k for k, line in enumerate(lines) if line[:1] in "#/%" and _REMARK.match(line)]
        self._remarks += len(remarks)
        for k in reversed(remarks):
            del lines[k]
        return lines

    def _last(self, line: str) -> str:
        """Return the last line, which has no line break behind it, if it is whole."""
        (line,) = self._kept([line]) or [""]
        if not line.strip():
            return ""
        if len(_cells(line, self._dialect.separator)) < self._dialect.columns:
            self._cut = line
            return ""
        return line + "\n"

    def notes(self) -> list[str]:
        """Return what was passed over, in words."""
        found = []
        if self._remarks:
            found.append(
                f"{self._remarks} line{'' if self._remarks == 1 else 's'} of remarks amid the rows passed over"
            )
        if self._cut:
            found.append("the last row is cut and left out")
        if self._nuls:
            found.append(f"{self._nuls:,} NUL bytes left out")
        return found


def _dialect(head: bytes, *, whole: bool) -> Dialect:
    encoding = _encoding(head)
    text = head.decode(encoding, "replace").replace("\0", "")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if not whole:
        lines.pop()
    rows = [(k, line) for k, line in enumerate(lines) if line.strip() and not _REMARK.match(line)]
    if not rows:
        raise InputError("it has no rows")
    separator = _separator([line for _, line in rows])
    decimal = "," if separator != "," and any(re.search(r"\d,\d", line) for _, line in rows[1:4]) else "."
    at = next((k for k, line in rows if _is_numbers(_cells(line, separator), decimal)), None)
    if at is None:
        raise InputError("it has no row of numbers")
    columns = len(_cells(lines[at], separator))
    named = [_cells(line, separator) for k, line in rows if k < at]
    if not named:  # names behind a remark's sign, in the last such line
        behind = [_REMARK.sub("", line, count=1) for line in lines[:at] if _REMARK.match(line)]
        named = [cells for line in behind[-1:] if abs(len(cells := _cells(line, separator)) - columns) <= 1]
    fitting = [cells for cells in named if abs(len(cells) - columns) <= 1]
    if not fitting:
        return Dialect(encoding, separator, decimal, None, (), columns, columns, at)
    names = tuple(cell.strip().strip("\"'").strip() for cell in fitting[0])
    while names and not names[-1]:
        names = names[:-1]
    units = tuple(cell.strip() for cell in fitting[1]) if len(fitting) > 1 else ()
    return Dialect(encoding, separator, decimal, names, units, len(names), columns, at)


def _encoding(head: bytes) -> str:
    for mark, name in _BOMS:
        if head.startswith(mark):
            return name
    if len(head) > 3 and head[1::2].count(0) > len(head) // 4:
        return "utf-16-le"
    try:
        head[: head.rfind(b"\n") + 1].decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def _separator(lines: list[str]) -> str:
    """Return the separator by which the most rows have the same number of cells, at least seven."""
    best, found = (0, 0), " "
    for sign in _SEPARATORS:
        counts = [line.count(sign) for line in lines[:200]]
        most = max(set(counts), key=counts.count)
        score = (counts.count(most) if most else 0, most)
        # a decimal comma stands in cells that other signs separate
        if most and (sign != "," or not any(other in lines[-1] for other in ";\t")) and score > best:
            best, found = score, sign
    return found


def _cells(line: str, separator: str) -> list[str]:
    return line.split() if separator == " " else line.strip("\r\n").split(separator)


def _is_numbers(cells: list[str], decimal: str) -> bool:
    """Return whether cells are numbers, dates, or empty, and not all empty."""
    bare = [cell.strip().strip('"').strip() for cell in cells]
    if decimal == ".":
        bare = [cell if "," not in cell else "x" for cell in bare]
    return any(bare) and all(_NUMBER.fullmatch(cell) or _DATE.fullmatch(cell) for cell in bare)
