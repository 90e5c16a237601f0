"""Rows of a campaign from a folder of results: from its journal, `rows.jsonl`, or from `results.json`; looked at.

A journal is read a row at a time; of one that this program wrote here, a run looks only for what it lacks.
"""

import json
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, cast

from filters.errors import InputError
from imutui import declared, document_shape, outside_file
from imutui.command_line import command
from imutui.jobs.campaign import rows
from imutui.jobs.campaign.rows import HeadFields, Row
from imutui.logbook.reader import UnreadableLogError

JOURNAL, DOCUMENT = "rows.jsonl", "results.json"
LONGEST_ROW = 4 * 2**20  # longest line of a journal, bytes: a trace's findings of one log are some kilobytes
LONGEST_DOCUMENT = 2**30  # longest `results.json`, bytes: some 300 000 rows


class Part(NamedTuple):
    """A folder of results that is only read: what its last run said of itself, and its rows.

    `broken` counts lines that could not be read.
    """

    folder: Path
    head: HeadFields
    rows: Mapping[str, Row]
    broken: int


class _RowsOfJournal(Mapping[str, Row]):
    """Rows by their log, each read when it is looked at."""

    def __init__(self, journal: Path, places: dict[str, tuple[int, int]]) -> None:
        self._stream = outside_file.opened(journal)
        self._places = places

    def __getitem__(self, log: str) -> Row:
        offset, length = self._places[log]
        return cast("Row", json.loads(os.pread(self._stream.fileno(), length, offset)))

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


def head_of(folder: Path) -> HeadFields | None:
    """What the last run in a folder of results was asked for; None if there was none.

    Raises UnreadableLogError if what is there cannot be read.
    """
    journal, document = folder / JOURNAL, folder / DOCUMENT
    if not journal.exists():
        return of_document(document).head if document.exists() else None
    heads = (line for _, _, line in lines(journal, own_record) if line is not None and "log" not in line)
    return cast("HeadFields | None", next(heads, None))


def read(folder: Path) -> Part:
    """Results of a folder, from its journal, or from its `results.json` where that was not copied along.

    Raises UnreadableLogError if there are none.
    """
    journal = folder / JOURNAL
    if not journal.exists():
        return of_document(folder / DOCUMENT)
    head: HeadFields | None = None
    places: dict[str, tuple[int, int]] = {}
    broken = 0
    for offset, length, line in lines(journal, _record):
        if line is None:
            broken += 1
        elif "log" not in line:
            # rows of other settings, which an earlier run made, are not of this one
            places = {} if head is not None and head["settings_sha256"] != line["settings_sha256"] else places
            head = cast("HeadFields", line)
        elif head is not None and line["settings_sha256"] == head["settings_sha256"]:
            places[line["log"]] = offset, length
    if head is None:
        raise UnreadableLogError(f"{journal} says nowhere what it is of. {_HOW}")
    return Part(folder, head, _RowsOfJournal(journal, places), broken)


_HOW = "Name a folder that `imutui campaign ... -o RESULTS` made."


def of_document(path: Path) -> Part:
    """Results of a `results.json`, whole; raises UnreadableLogError if it is none."""
    try:
        content = outside_file.read_json(path, LONGEST_DOCUMENT)
    except OSError as error:
        raise UnreadableLogError(f"{path}: {error.strerror or error}. {_HOW}") from error
    except InputError as error:
        raise UnreadableLogError(f"{path} is no JSON of a campaign: {error}. {_HOW}") from error
    if told := document_shape.fault(content, rows.ResultsDocument, "results"):
        raise UnreadableLogError(f"{path} is no result of a campaign: {told}. {_anew(content, path.parent)}")
    return Part(path.parent, content, {row["log"]: row for row in content.pop("rows")}, 0)


def lines(
    journal: Path, look: Callable[[dict[str, Any]], dict[str, Any] | None]
) -> Iterator[tuple[int, int, dict[str, Any] | None]]:
    """Place, length and record of each line; None for one that is neither row nor head.

    Raises UnreadableLogError if a run of another version wrote it.
    """
    with outside_file.opened(journal) as stream:
        offset = 0
        while line := stream.readline(LONGEST_ROW):
            record = _object(line)
            if "root" in record and (told := document_shape.wrong_version(record)):
                raise UnreadableLogError(f"{journal}: {told}. {_anew(record, journal.parent)}")
            yield offset, len(line.rstrip(b"\n")), look(record)
            offset += len(line)


def _anew(head: object, folder: Path) -> str:
    """Return the command that makes results of another version anew, with the folder of the logs if they state it."""
    root = head.get("root") if isinstance(head, dict) else None
    if not isinstance(root, str):
        return _HOW
    return f"`{command('campaign', Path(root), '-o', folder.with_name(f'{folder.name}-anew'))}` makes them anew."


def _object(line: bytes) -> dict[str, Any]:
    """The record of a line; empty if it is cut, or no JSON of an object."""
    try:
        record = json.loads(line) if line.endswith(b"\n") else {}
    except (ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def _record(record: dict[str, Any]) -> dict[str, Any] | None:
    """A record of a journal from anywhere, looked at to its last field."""
    shape = rows.Row if "log" in record else rows.HeadFields
    return None if declared.problem(record, shape, "line") else record


def own_record(record: dict[str, Any]) -> dict[str, Any] | None:
    """Return a record of a journal that this program wrote here, None if it is not whole; quick for a million rows."""
    shape = rows.Row if "log" in record else rows.HeadFields
    return record if shape.__required_keys__ <= record.keys() and isinstance(record.get("log", ""), str) else None


# ------------------------------------------------------------------------------------------------- rows for a summary


def path_of(results: Path) -> Path:
    """Return the file of rows of a campaign's folder: its journal where a run left nothing else; a file is itself."""
    if not results.is_dir():
        return results
    only_journal = (results / JOURNAL).exists() and not (results / DOCUMENT).exists()
    return results / (JOURNAL if only_journal else DOCUMENT)


def rows_of(results: Path) -> list[Row]:
    """Rows of a campaign.

    `results`: the folder that a campaign wrote, or its `results.json` or `rows.jsonl`.
    Raises UnreadableLogError if there is none, or it has no rows, or what stands there is of another shape; the message
      says where.
    """
    path = path_of(results)
    part = read(path.parent) if path.name == JOURNAL else of_document(path)
    if not part.rows:
        raise UnreadableLogError(f"{path} has no row in it: the campaign found no log. {_HOW}")
    return list(part.rows.values())
