"""The folder of a campaign's results: `rows.jsonl`, which only ever grows, and what is made of it, `results.json`.

A row is appended as soon as it is there, so that neither a kill nor a power cut costs more than the logs at hand;
`results.json` is written anew, whole, now and then and at the end. A run holds the folder locked. Of a row only what
decides whether its log is to be computed again is kept in memory.
"""

import contextlib
import errno
import itertools
import json
import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import NoneType, TracebackType, UnionType
from typing import IO, Any, NamedTuple, Self, cast, get_args, get_origin, get_type_hints, is_typeddict

from filters.errors import InputError
from imutui.jobs.campaign import rows
from imutui.jobs.campaign.rows import HeadFields, Row
from imutui.jobs.campaign.stored_rows import DOCUMENT, JOURNAL, lines, of_document, own_record
from imutui.logbook import atomic_file, file_lock, parquet
from imutui.logbook.parquet import Column

TABLE = "results.parquet"
LOCK = ".lock"
_SYNC_S = 1.0
_PUBLISH_S = 30.0
_PUBLISH_SHARE = 0.02


class Known(NamedTuple):
    """What is kept of a row: where it stands, and what decides whether its log is computed again."""

    offset: int
    length: int
    bytes: int | None
    mtime_ns: int | None
    sha256: str | None
    failed: bool
    retry: bool
    fine: bool


class ResultsFolder:
    """A folder of results that a run writes.

    `folder`: made if absent.
    `head`: what the run is asked for; rows of other settings are left aside.
    `known`: what is known of each log's row, by the row's `log`.
    `broken`: how many lines could not be read; their logs are computed again.
    Raises InputError if another run holds it, or it has results of another root.
    Raises UnreadableLogError if a `results.json` is there that is none.
    Raises OSError if the disk does not take it.
    """

    def __init__(self, folder: Path, head: HeadFields, mode: int) -> None:
        self.folder = folder
        self.known: dict[str, Known] = {}
        self.broken = 0
        self._others: set[str] = set()
        self._head = head
        self._mode = mode
        self._synced = self._published = time.monotonic()
        self._publishing_s = 0.0
        folder.mkdir(exist_ok=True)
        self._lock = _locked(folder)
        try:
            begun = self._read()
            self._journal = _opened(folder / JOURNAL, mode)
            self._append(head)
            for row in begun:
                self.add(row)
        except BaseException:
            self._lock.close()
            raise

    def __enter__(self) -> Self:
        """The folder, to be closed at the block's end."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let go of the folder; what was added is on the disk."""
        with contextlib.closing(self._lock), contextlib.closing(self._journal):
            os.fsync(self._journal.fileno())

    @property
    def others(self) -> int:
        """How many logs have rows of other settings only."""
        return len(self._others - self.known.keys())

    def add(self, row: Row) -> None:
        """Append a row, in place of an older one of the same log."""
        offset, length = self._append(row)
        self.known[row["log"]] = _known(row, offset, length)
        now = time.monotonic()
        if now - self._synced >= _SYNC_S:
            os.fsync(self._journal.fileno())
            self._synced = now

    def row(self, log: str) -> Row:
        """The row of a log that is known."""
        return cast("Row", json.loads(self._line(self.known[log])))

    def rows(self) -> Iterator[Row]:
        """All rows, in the order of their logs."""
        return (self.row(log) for log in sorted(self.known))

    def publish_now_and_then(self) -> None:
        """Write `results.json` if that was long enough ago, in proportion to how long it takes."""
        since = time.monotonic() - self._published
        if since >= max(_PUBLISH_S, self._publishing_s / _PUBLISH_SHARE):
            self.publish()

    def finish(self, *, complete: bool) -> Path | None:
        """Write `results.json`, and the table of a run that is complete; where that is, None without pyarrow."""
        self._head["complete"] = complete
        self._append(self._head)
        self.publish()
        path = self.folder / TABLE
        if not complete or not parquet.available():
            path.unlink(missing_ok=True)  # of other rows than those that are there now
            return None
        notes = {"root": self._head["root"], "settings_sha256": self._head["settings_sha256"]}
        _write_table(path, self.rows(), notes, self._mode)
        return path

    def publish(self) -> None:
        """Write `results.json`, row by row, so that it is there whole or not at all."""
        started = time.monotonic()
        path = self.folder / DOCUMENT
        with atomic_file.part_of(path, overwrite=True, mode=self._mode) as part, part.open("wb") as stream:
            head = json.dumps(self._head, indent=2)
            stream.write(head.removesuffix("\n}").encode() + b',\n  "rows": [')
            for number, log in enumerate(sorted(self.known)):
                stream.write(b",\n    " if number else b"\n    ")
                stream.write(self._line(self.known[log]))
            stream.write(b"\n  ]\n}\n")
        self._published = time.monotonic()
        self._publishing_s = self._published - started

    def _read(self) -> list[Row]:
        """Fill `known` from the journal; or, where there is none, the rows of `results.json`, to begin one with."""
        journal, document = self.folder / JOURNAL, self.folder / DOCUMENT
        if not journal.exists():
            part = of_document(document) if document.exists() else None
            if part is not None:
                self._check_root(part.head)
            found = [] if part is None else list(part.rows.values())
            self._others = {row["log"] for row in found if not self._is_mine(row)}
            return [row for row in found if self._is_mine(row)]
        for offset, length, line in lines(journal, own_record):
            if line is None:
                self.broken += 1
            elif "log" not in line:
                self._check_root(cast("HeadFields", line))
            elif self._is_mine(cast("Row", line)):
                self.known[line["log"]] = _known(cast("Row", line), offset, length)
            else:
                self._others.add(line["log"])
        return []

    def _is_mine(self, row: Row) -> bool:
        return row["settings_sha256"] == self._head["settings_sha256"]

    def _check_root(self, head: HeadFields) -> None:
        if head["root"] != self._head["root"]:
            raise InputError(
                f"{self.folder} has results of the logs below {head['root']}, and these lie below {self._head['root']}:"
                " name another folder with -o"
            )

    def _append(self, record: "HeadFields | Row") -> tuple[int, int]:
        text = json.dumps(record, allow_nan=False).replace("\x7f", r"\u007f").encode()
        offset = self._journal.seek(0, os.SEEK_END)
        self._journal.write(text + b"\n")
        self._journal.flush()
        return offset, len(text)

    def _line(self, known: Known) -> bytes:
        return os.pread(self._journal.fileno(), known.length, known.offset)


def has_results(folder: Path) -> bool:
    """Whether a campaign has written to a folder."""
    return (folder / JOURNAL).exists() or (folder / DOCUMENT).exists()


def remove_results(folder: Path) -> None:
    """Remove what a campaign has written to a folder; raises InputError if one is writing to it."""
    with contextlib.closing(_locked(folder)):
        for name in (JOURNAL, DOCUMENT, TABLE):
            (folder / name).unlink(missing_ok=True)


def _known(row: Row, offset: int, length: int) -> Known:
    return Known(
        offset,
        length,
        row["log_bytes"],
        row["log_mtime_ns"],
        row["log_sha256"],
        row["error"] is not None,
        row["retry"],
        rows.is_fine(row),
    )


def _opened(journal: Path, mode: int) -> IO[bytes]:
    """The journal, to be read and appended to; what a run that was killed left of a line is ended."""
    stream = os.fdopen(os.open(journal, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, mode), "r+b")
    end = stream.seek(0, os.SEEK_END)
    if end and os.pread(stream.fileno(), 1, end - 1) != b"\n":
        stream.write(b"\n")
        stream.flush()
    return stream


def _locked(folder: Path) -> IO[bytes]:
    try:
        stream = os.fdopen(os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600), "r+b")
    except OSError as error:
        if error.errno != errno.EACCES:
            raise
        raise InputError(f"{folder} is being written by somebody else, or may not be. Name another with -o") from error
    if not file_lock.take(stream):
        stream.close()
        raise InputError(f"another campaign is writing to {folder}: wait for its end, or name another folder with -o")
    return stream


# -------------------------------------------------------------------------------------------------------------- table
# `results.parquet`: the rows of a campaign as a flat table, a column for each number.
#
# Names are those of the row, joined by "_": `final_gyro_bias_dps_x`. Lists of words are one text, separated by "; ";
# findings of a trace are JSON.

_PARTS: Mapping[str, Sequence[str]] = {
    "position_deg_m": ("lat", "lon", "h"),
    "position_m": ("n", "e", "d"),
    "velocity_mps": ("n", "e", "d"),
    "rpy_deg": ("roll", "pitch", "yaw"),
    "band95": ("low", "high"),
}
_AXES = ("x", "y", "z")
_AT_ONCE = 4096
_KINDS = {float: "double", int: "int64", bool: "bool", str: "string"}


def _write_table(path: Path, rows: Iterable[Row], notes: Mapping[str, str], mode: int) -> None:
    """Write the table, there whole or not at all, in place of an older one; memory is bounded.

    `notes`: what the table is of, as its metadata.
    Raises OSError if the disk does not take it.
    """
    columns = list(_columns(Row, ""))
    with atomic_file.part_of(path, overwrite=True, mode=mode) as part:
        parquet.write(part, columns, _batches(columns, iter(rows)), notes)


def _batches(columns: Sequence[Column], rows: Iterator[Row]) -> Iterator[dict[str, list[object]]]:
    while batch := list(itertools.islice(rows, _AT_ONCE)):
        cells = [dict(_cells(Row, row, "")) for row in batch]
        yield {column.name: [cell.get(column.name) for cell in cells] for column in columns}


def _columns(shape: Any, before: str) -> Iterator[Column]:
    """Columns of a typed dictionary, one for each number or word in it."""
    for key, hint in get_type_hints(shape).items():
        own, name = _plain(hint), before + key
        if is_typeddict(own):
            yield from _columns(own, f"{name}_")
        elif own in _KINDS:
            yield Column(name, _KINDS[own])  # type: ignore[arg-type]
        elif _plain(get_args(own)[0]) is float:
            yield from (Column(f"{name}_{part}", "double") for part in _PARTS.get(key, _AXES))
        else:
            yield Column(name, "string")


def _cells(shape: Any, values: Any, before: str) -> Iterator[tuple[str, object]]:
    """Name and content of the cells of a row, or of a part of it; what is not known is left out."""
    for key, hint in get_type_hints(shape).items():
        own, name, value = _plain(hint), before + key, values[key]
        if value is None:
            continue
        if is_typeddict(own):
            yield from _cells(own, value, f"{name}_")
        elif own is str:
            yield name, _text(value)
        elif own in _KINDS:
            yield name, value
        elif _plain(get_args(own)[0]) is float:
            yield from ((f"{name}_{part}", x) for part, x in zip(_PARTS.get(key, _AXES), value, strict=True))
        else:
            yield name, _text("; ".join(value) if all(isinstance(x, str) for x in value) else json.dumps(value))


def _plain(hint: Any) -> Any:
    """A type without "or None"."""
    if get_origin(hint) is UnionType:
        hint = next(each for each in get_args(hint) if each is not NoneType)
    return hint


def _text(text: str) -> str:
    """Text that a table can hold: bytes of a file's name that are no text stand as question marks."""
    return text.encode("utf-8", "replace").decode()
