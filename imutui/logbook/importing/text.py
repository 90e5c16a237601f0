"""CSV of any dialect as columns in pieces: the only user of pandas, which splits rows and parses numbers.

The dialect is found in the first lines; then the file is read in blocks of whole lines, so that memory does not grow
with it. This module counts the cells of each line, since pandas fills short rows without a word.
"""

import codecs
import contextlib
import gzip
import io
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np

from imutui import outside_file
from imutui.logbook.importing import columns
from imutui.logbook.importing.table import Column, ImportDataError, Rows, Table

_BLOCK = 2**22
_STEP = 2**16  # bytes that a packed stream is read by, so that little is lost where it is cut
_HEAD = 2**18
_LONGEST_LINE = 2**20
_MOST_REASONS = 10_000
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|nan|[+-]?inf|null|none|n/?a|-*|", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?")
_DATE = re.compile(r"(\d{4}[-/.]\d\d?[-/.]\d\d?|\d\d?[-/.]\d\d?[-/.]\d{4})[T ]\d\d?:\d\d.*")
_CLOCK = re.compile(r"(\d{1,2}:\d\d:\d\d([.,:]\d+)?|\d{1,2}:\d\d[.,]\d+)(\s*[AP]M)?", re.IGNORECASE)
_DAY = re.compile(rb"(?<!\d)(\d\d?)[-/.](\d\d?)[-/.]\d{4}[T ]")
_WIDE = re.compile(r"[+-]?\d{16,19}")  # more digits than a float64 holds
_LABEL = re.compile(r"\s*\{?\s*([A-Za-z_]\w*)\s*[:=]\s*([-+.\d][^}]*)\}?")
_SENTENCES = {
    "$VNIMU": (
        ("sentence", *(f"mag_{axis}" for axis in "xyz"), *columns.ACCEL, *columns.GYRO, "temp", "pressure"),
        ("", "", "", "", *["m/s2"] * 3, *["rad/s"] * 3, "degC", ""),
    )
}
"""Names and units of the cells of sentences that have neither, by the first cell."""
_REMARK = ("#", "%", "//", "!")
_SEPARATORS = ("\t", ";", "|", " ", ",")


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text is written."""

    encoding: str  # "" for bytes that are read as they are
    separator: str  # " " for any run of blanks
    decimal: str
    names: tuple[str, ...]  # () if the file has none
    units: tuple[str, ...]  # of a row of units, or of the remark that an export begins with
    width: int  # cells of a row
    first: int  # lines before the first row
    header: bytes = b""  # the line of names, which some loggers repeat
    kinds: tuple[str, ...] = ()  # of each column: "number", "wide", "date" or "clock"
    has_labels: bool = False  # cells such as `gx:0.1`
    month_first: bool = False  # whether dates that end with the year begin with the month
    early: int = 0  # lines of numbers before the first whole row, such as one whose beginning is missing


def read(path: Path) -> Table:
    """Return the columns of a CSV file.

    Raises ImportDataError if it is no text, or has no row of numbers.
    Raises OSError if it cannot be read.
    """
    dialect = _dialect(path)
    names = dialect.names or ("",) * len(dialect.kinds)
    named = [columns.split_unit(name) for name in names]
    stated = dialect.units or ("",) * len(names)
    units = [
        "ns" if kind in ("date", "clock") else unit or row
        for (_, unit), row, kind in zip(named, stated, dialect.kinds, strict=True)
    ]
    made = tuple(Column(name, unit, name not in columns.TICKS) for (name, _), unit in zip(named, units, strict=True))
    table = Table(path, made, lambda chosen: iter(()))
    if dialect.early:
        table.remark(f"{dialect.early} line(s) of other lengths before the first row were left out")
    return Table(path, made, partial(_pieces, table, dialect), table.remarks, table.reasons)


# -------------------------------------------------------------------------------------------------------------- dialect


def _dialect(path: Path) -> Dialect:
    with _opened(path) as (stream, _):
        head = _filled(stream, _HEAD)[0]
    encoding = _encoding(head)
    text = head.decode(encoding or "utf-8-sig", "ignore") if encoding else _decoded(head)
    text = re.sub("\r+\n?", "\n", text.rstrip("\0"))
    if not text.strip():
        raise ImportDataError(f"{path} is empty. Its first row must name the columns: t, gyro_x, … accel_z.")
    if sum(ord(c) < 32 and c not in "\t\n\f" for c in text[:4096]) > 3:
        raise ImportDataError(f"{path} is not a CSV text file, nor NPZ. Save it as one of them.")
    lines = [line.strip("\ufeff") for line in text.split("\n")]
    if len(head) == _HEAD:
        lines.pop()  # it is cut
    for separator in _SEPARATORS:
        rows = {k: _cells(line, separator) for k, line in enumerate(lines) if not _is_remark(line)}
        data = [k for k, cells in rows.items() if _is_row(cells, separator)]
        usual = max((len(rows[k]) for k in data), key=[len(rows[k]) for k in data].count, default=0)
        data = [k for k in data if len(rows[k]) == usual]
        if usual >= 3 and 2 * len(data) > len(rows) - 4:
            return replace(_described(lines, rows, data, encoding, separator), month_first=_month_first(path, head))
    named = [line for line in lines if len(_cells(line.lstrip("#% "), ",")) >= 3]
    if named and len(lines) < 4:
        raise ImportDataError(f"{path} has 0 samples, only the line {named[0][:80]!r}; at least two are needed.")
    raise ImportDataError(
        f"{path} has no rows of numbers that begin like {lines[0][:60]!r}. It is read as NPZ, CSV (any separator) or"
        " Parquet: save it as one of them."
    )


def _described(lines: list[str], rows: dict[int, list[str]], data: list[int], encoding: str, separator: str) -> Dialect:
    sample = [rows[k] for k in data[:1000]]
    width, first = len(sample[0]), data[0]
    count = width - all(not cells[-1] for cells in sample)  # rows may end with a separator
    flat = [cell for cells in sample for cell in cells]
    commas = sum(bool(_DECIMAL_COMMA.fullmatch(cell)) for cell in flat)
    points = sum(cell.count(".") == 1 for cell in flat)
    labels = [_LABEL.fullmatch(cell) for cell in sample[0]]
    has_labels = sum(label is not None for label in labels) >= 3
    names: tuple[str, ...] = tuple(label[1] if label else "" for label in labels) if has_labels else ()
    units: tuple[str, ...] = ()
    header = ""
    # names stand in the line above the rows, or one above if that one has units; they may stand behind a #
    above = [line for line in lines[:first] if line.strip()]
    for line in reversed(above[-3:]):
        bare = line.lstrip("#%/! \t")
        cells = _cells(bare, separator)
        cells = cells if len(cells) >= count else re.split(r"[,;\s]+", bare.strip())
        if len(cells) == count - 1 and count == width:
            cells = ["", *cells]  # R writes no name for the numbers of rows
        if has_labels or len(cells) < count or any(cells[width:]):
            continue
        cells = cells[:count]
        if not units and sum(bool(columns.unit_of(cell)) for cell in cells) > count / 2 and line is not above[0]:
            units = tuple(columns.stated_unit(cell) for cell in cells)
            continue
        names, header = tuple(cells), line
        break
    if not units and above and (exported := re.match(r"#\s*units:\s*(.*)", above[0])):
        said: dict[str, str] = dict(entry.strip().rpartition(" ")[::2] for entry in exported[1].split(","))
        units = tuple(columns.unit_of(said.get(name) or said.get(name.rpartition("_")[0]) or "") for name in names)
    if sample[0][0] in _SENTENCES and len(_SENTENCES[sample[0][0]][0]) == count:
        names, units = _SENTENCES[sample[0][0]]
    kinds = tuple(_kind([cells[k] for cells in sample]) for k in range(count))
    return Dialect(
        encoding,
        separator,
        "," if commas > points else ".",
        names,
        units,
        width,
        first,
        header.encode(),
        kinds,
        has_labels,
        early=sum(_is_row(cells, separator) for k, cells in rows.items() if k < first),
    )


def _month_first(path: Path, head: bytes) -> bool:
    """Return whether dates such as 05/03/2024 begin with the month: the day is the number that changes more."""
    with outside_file.opened(path) as stream:
        stream.seek(max(0, path.stat().st_size - _STEP))
        found = _DAY.findall((head + b"\n" + stream.read(_STEP)).replace(b"\0", b""))
    first, second = ({int(pair[k]) for pair in found} for k in (0, 1))
    return bool(found) and max(first) <= 12 and (max(second) > 12 or len(second) > len(first))


def _kind(cells: Sequence[str]) -> str:
    told = [cell for cell in cells if cell]
    for kind, pattern in (("date", _DATE), ("clock", _CLOCK), ("wide", _WIDE)):
        if told and (len(told) == len(cells) or kind != "wide") and all(pattern.fullmatch(cell) for cell in told):
            return kind
    return "number"


def _is_remark(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith(_REMARK)


def _cells(line: str, separator: str) -> list[str]:
    """Cells of a line of the head; the file's rows are split by pandas."""
    line = line.replace(" -> ", separator).replace("\N{MINUS SIGN}", "-")
    if separator == " ":
        return re.sub(r"([:=])\s+(?=[-+.\d])", r"\1", line.replace('"', "")).split()
    if '"' in line:
        line = re.sub('"[^"]*"', lambda quoted: quoted[0].strip('"').replace(separator, "."), line)
    return [cell.strip() for cell in line.split(separator)]


def _is_row(cells: list[str], separator: str) -> bool:
    """True if at least three cells, and half of those that are not blank, are numbers."""
    told = [label[2] if (label := _LABEL.fullmatch(cell)) else cell for cell in cells if cell]
    numbers = sum(
        bool(_NUMBER.fullmatch(cell)) or (separator != "," and bool(_DECIMAL_COMMA.fullmatch(cell))) for cell in told
    )
    return numbers >= 3 and 2 * numbers >= len(told) and any(c.isdigit() for cell in told for c in cell)


def _encoding(head: bytes) -> str:
    """Return "utf-16-le" or "utf-16-be", or "" for an encoding whose digits are those of ASCII."""
    if head.startswith(codecs.BOM_UTF16_LE) or (len(head) > 3 and head[1] == head[3] == 0 != head[0]):
        return "utf-16-le"
    if head.startswith(codecs.BOM_UTF16_BE) or (len(head) > 3 and head[0] == head[2] == 0 != head[1]):
        return "utf-16-be"
    return ""


def _decoded(head: bytes) -> str:
    try:
        return codecs.getincrementaldecoder("utf-8-sig")().decode(head)  # the last character may be cut
    except UnicodeDecodeError:
        return head.decode("latin-1")


# --------------------------------------------------------------------------------------------------------------- blocks


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[tuple[IO[bytes], Callable[[], float]]]:
    """Yield the bytes of a file, unpacked if it is gzip, and a function that returns the share that was read."""
    with outside_file.opened(path) as raw:
        size = max(1, path.stat().st_size)
        packed = raw.peek(2)[:2] == b"\x1f\x8b"
        stream: Any = gzip.GzipFile(fileobj=raw) if packed else raw
        yield stream, lambda: min(1.0, raw.tell() / size)


def _filled(stream: IO[bytes], size: int) -> tuple[bytes, bool]:
    """Read up to `size` bytes; True with them if a packed stream ends in the middle or is damaged."""
    read: list[bytes] = []
    try:
        while size > 0 and (new := stream.read(min(size, _STEP))):
            read.append(new)
            size -= len(new)
    except (EOFError, zlib.error, gzip.BadGzipFile):
        return b"".join(read), True
    return b"".join(read), False


def _blocks(table: Table, dialect: Dialect) -> Iterator[tuple[float, bytes, bool]]:
    """Yield the text in blocks of whole lines, with line feeds, and True with the last one if its line has no end."""
    with _opened(table.path) as (stream, share):
        decode = codecs.getincrementaldecoder(dialect.encoding)("replace").decode if dialect.encoding else None
        rest = b""
        while True:
            new, is_cut = _filled(stream, _BLOCK)
            if is_cut:
                table.remark("the packed file is cut or damaged: its rows up to there were taken")
            if not new:
                break
            new = decode(new).encode("utf-8", "replace") if decode else new
            if b"\0" in new:
                table.remark("NUL bytes were left out")
                new = new.replace(b"\0", b"")
            block = rest + new
            cut = (block.rfind(b"\n") + 1) or (block.rfind(b"\r", 0, -1) + 1)
            rest = block[cut:]
            if len(rest) > _LONGEST_LINE:
                raise ImportDataError(f"{table.path} has a line of more than {_LONGEST_LINE:,} bytes: it is no table.")
            if cut:
                yield share(), _with_line_feeds(block[:cut]), False
        if rest.strip():
            yield 1.0, _with_line_feeds(rest), not rest.endswith(b"\r")


def _with_line_feeds(block: bytes) -> bytes:
    return re.sub(rb"\r+\n?", b"\n", block) if b"\r" in block else block


def _pieces(table: Table, dialect: Dialect, chosen: Sequence[int]) -> Iterator[Rows]:
    """Rows of some columns; see `Table`."""
    line, row = 1, 0
    skipped = dialect.first
    last_row = b""
    for share, block, is_open in _blocks(table, dialect):
        lines_of_block = block.count(b"\n")
        while skipped and block:
            block = block.partition(b"\n")[2]
            skipped -= 1
            line += 1
            lines_of_block -= 1
        body = _plain(block, dialect)
        if is_open and _is_cut(body, last_row, dialect):
            table.remark("its last line is cut and was left out")
            continue
        body = _whole_rows(body, table, dialect, line, row)
        if body.strip():
            read = _parsed(body, table, dialect, chosen, row)
            row += len(read[0])
            last_row = body[body.rfind(b"\n", 0, -1) + 1 :]
            yield share, read
        line += lines_of_block


def _plain(block: bytes, dialect: Dialect) -> bytes:
    """Text without quotes, labels, checksums of sentences, and more than one blank between cells."""
    separator = dialect.separator.encode()
    if b" -> " in block:
        block = block.replace(b" -> ", separator)
    if b"\xe2" in block:
        block = block.replace("\N{MINUS SIGN}".encode(), b"-")
    if b'"' in block:
        text = np.frombuffer(bytearray(block), np.uint8)
        quotes = text == ord('"')
        inside = np.bitwise_xor.accumulate(quotes)
        stand_in = "." if dialect.separator == "," and dialect.decimal == "." else " "
        text[inside & (text == separator[0])] = ord(stand_in)
        text[quotes] = ord(" ")
        block = text.tobytes()
    if dialect.has_labels:
        block = re.sub(rb"[A-Za-z_]\w*[ \t]*[:=][ \t]*|[{}]", b"", block)
    if block.startswith(b"$"):
        block = re.sub(rb"\*[0-9A-Fa-f]{2}(?=\n)", b"", block)
    if dialect.separator == " ":
        block = re.sub(rb"[ \t]+", b" ", block)
        block = re.sub(rb"(?m)^ | $", b"", block)
    return block


def _is_cut(last: bytes, before: bytes, dialect: Dialect) -> bool:
    """True if a last line without an end has fewer cells, or fewer digits in its last one, than the row before."""
    separator = dialect.separator.encode()
    cells, usual = last.split(separator), before.split(separator)
    if len(cells) < dialect.width:
        return True
    return bool(before) and len(cells[-1].strip()) < len(usual[-1].strip()) and b"e" not in usual[-1]


def _whole_rows(body: bytes, table: Table, dialect: Dialect, line: int, row: int) -> bytes:
    """Return the lines that are rows; one with another number of cells is blank, with a reason kept.

    `line`, `row`: numbers of the first line (first is 1) and of the first row (first is 0).
    """
    body = body if body.endswith(b"\n") else body + b"\n"
    text = np.frombuffer(body, np.uint8)
    ends = np.flatnonzero(text == ord("\n"))
    starts = np.r_[0, ends[:-1] + 1]
    at = np.flatnonzero(text == ord(dialect.separator))
    found = np.diff(np.searchsorted(at, np.r_[0, ends])) + 1
    blank = starts == ends
    remarks = np.isin(text[starts], [ord(c[0]) for c in _REMARK])
    is_odd = blank | remarks | (found != dialect.width)
    if dialect.header and dialect.header in body:
        is_odd |= np.isin(starts, [match.start() for match in re.finditer(re.escape(dialect.header), body)])
    odd = np.flatnonzero(is_odd)
    if not odd.size:
        return body
    lines = body[:-1].split(b"\n")
    keep: list[bytes] = []
    empty = dialect.separator.encode() * (dialect.width - 1)
    numbered = set(odd.tolist())
    for k, text_of_line in enumerate(lines):
        if k not in numbered:
            keep.append(text_of_line)
        elif not text_of_line.strip():
            continue
        elif text_of_line.lstrip().startswith(tuple(mark.encode() for mark in _REMARK)):
            table.remark(f"remarks between its rows were left out, the first in line {line + k}")
        elif dialect.header and text_of_line.strip() == dialect.header.strip():
            table.remark(f"the names of its columns stand again in line {line + k}")
        else:
            _refuse_row(
                table, row + len(keep), f"has {found[k]} cells where others have {dialect.width}, in line {line + k}"
            )
            keep.append(empty)
    return b"\n".join([*keep, b""])


def _refuse_row(table: Table, row: int, reason: str) -> None:
    if len(table.reasons) < _MOST_REASONS:
        table.reasons.setdefault(row, reason)


# -------------------------------------------------------------------------------------------------------------- numbers


def _parsed(body: bytes, table: Table, dialect: Dialect, chosen: Sequence[int], row: int) -> list[np.ndarray]:
    """Numbers of some columns of a text of whole rows."""
    import pandas as pd

    kinds = {k: dialect.kinds[k] for k in sorted(set(chosen))}
    split = partial(
        pd.read_csv, io.BytesIO(body), sep=dialect.separator, decimal=dialect.decimal, header=None, encoding="latin-1",
        names=range(dialect.width), usecols=list(kinds), index_col=False, skipinitialspace=True, skip_blank_lines=False,
        low_memory=False, quoting=3, na_values=["-", "--", "null"],
    )  # fmt: skip
    types: dict[str, Any] = {"number": float, "wide": "int64", "date": str, "clock": str}
    try:
        frame = split(dtype={k: types[kind] for k, kind in kinds.items()})
    except (ValueError, TypeError, OverflowError):
        split.args[0].seek(0)
        frame = split(dtype=str)
        kinds = {k: "text" if kind in ("number", "wide") else kind for k, kind in kinds.items()}
    values = {k: _numbers(frame[k], kinds[k], table, dialect, k, row) for k in kinds}
    return [values[k] for k in chosen]


def _numbers(cells: Any, kind: str, table: Table, dialect: Dialect, column: int, row: int) -> np.ndarray:
    """Numbers of a column of pandas; of a date or a time of day, ns."""
    import pandas as pd

    if kind in ("number", "wide"):
        return np.asarray(cells)
    if kind == "text":
        told = cells.notna()
        text = cells[told].str.strip().str.replace(dialect.decimal, ".", regex=False)
        good = text.map(lambda cell: bool(_NUMBER.fullmatch(cell)) and any(c.isalnum() for c in cell))
        out = np.full(len(cells), np.nan)
        out[np.flatnonzero(told)[good.to_numpy(bool)]] = [
            float(c) if c[-1].isdigit() or c[-1] == "." else np.nan for c in text[good]
        ]
        wrong, name = text[~good], table.columns[column].name or f"#{column + 1}"
        for k, cell in wrong[:_MOST_REASONS].items():
            _refuse_row(table, row + int(k), f'has "{cell[:40]}" in column `{name}`, which is not a number')
        return out
    half = cells.str.extract(r"(?i)\d\s*([AP])M\s*$")[0].str.upper()
    commas = cells.str.replace(r"(?i)\s*[AP]M\s*$", "", regex=True).str.replace(r"\b(\d)(?=[-/.:])", r"0\1", regex=True)
    commas = commas.str.replace(r"[,:](?=\d{3,}$)", ".", regex=True).str.replace(",", ".", regex=False)
    commas = commas.str.replace(r"^(\d+:\d\d\.\d+)$", r"00:\1", regex=True)
    order = r"\3-\1-\2" if dialect.month_first else r"\3-\2-\1"
    commas = commas.str.replace(r"^(\d\d)\D(\d\d)\D(\d{4})", order, regex=True)
    commas = commas.str.replace(r"^(\d{4})\D(\d\d)\D(\d\d)", r"\1-\2-\3", regex=True)
    if kind == "clock":
        found = pd.to_timedelta(commas, errors="coerce").astype("timedelta64[ns]")
    else:
        found = pd.to_datetime(commas, format="ISO8601", utc=True, errors="coerce").astype("datetime64[ns, UTC]")
    unknown = found.isna().to_numpy()
    stamps = np.asarray(found.astype("int64"))
    noon = 43_200_000_000_000
    stamps = stamps + noon * (
        (half == "P").to_numpy(int) - (half.notna() & (stamps % (2 * noon) >= noon)).to_numpy(int)
    )
    name = table.columns[column].name or f"#{column + 1}"
    for k in np.flatnonzero(unknown & cells.notna().to_numpy())[:_MOST_REASONS].tolist():
        _refuse_row(table, row + k, f'has "{cells.iloc[k][:40]}" in column `{name}`, which is no time that is read')
    return np.where(unknown, np.nan, stamps) if unknown.any() else stamps
