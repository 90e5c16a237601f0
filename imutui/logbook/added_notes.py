"""What is added to a log after it was recorded: `LOG.mcap.notes.toml` beside it, so that no byte of the log changes.

A log's SHA-256 stays true that way, and whoever reads it sees that what is here was said later. Each addition has its
time and the user's name; the last note and the last operator count, and the earlier ones stay in the file.
"""

import getpass
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypedDict

from filters.errors import InputError
from imutui import declared, outside_file, toml_text
from imutui.declared import Meta
from imutui.logbook import atomic_file
from imutui.plain_text import NAME_LIMIT, NOTE_LIMIT, in_line, one_line, quoted

SUFFIX = ".notes.toml"
_LIMIT = 2**20
_MOST = 1000


def _line(limit: int) -> Meta:
    return Meta(make=lambda text: one_line(text, limit))


@dataclass(frozen=True, slots=True)
class AddedNote:
    """One addition."""

    utc: Annotated[str, _line(NAME_LIMIT)]  # when, as 2026-03-01T09:30:00Z
    by: Annotated[str, _line(NAME_LIMIT)]  # name of the computer's user who added it
    # note, operator: what it says; None where it leaves as it was what stood before
    note: Annotated[str, _line(NOTE_LIMIT)] | None = None
    operator: Annotated[str, _line(NAME_LIMIT)] | None = None


class _File(TypedDict):
    version: Literal[1]
    added: list[AddedNote]


def path_of(log: Path) -> Path:
    """Where the additions to a log are."""
    return log.with_name(log.name + SUFFIX)


def read(log: Path) -> tuple[AddedNote, ...]:
    """Additions to a log, oldest first; none if there is no such file.

    Raises InputError if the file beside it cannot be used; the message names it.
    Raises OSError if it cannot be read.
    """
    path = path_of(log)
    if not path.is_file():
        return ()
    try:
        document = declared.read(toml_text.parse(outside_file.read(path, _LIMIT)), _File)
        return tuple(document["added"][-_MOST:])
    except InputError as error:
        raise InputError(f"{path} cannot be used: {error}") from error


def read_or_none(log: Path) -> tuple[AddedNote, ...]:
    """Additions to a log; none where there are none that can be read."""
    try:
        return read(log)
    except (InputError, OSError):
        return ()


def add(log: Path, note: str | None = None, operator: str | None = None) -> Path:
    """Add a note, an operator's name, or both; returns the file they are in.

    `log`: the log, which is not touched.
    `note`, `operator`: what is said; None leaves what stood before.
    Raises InputError if the file beside the log is there and cannot be used.
    Raises OSError if the disk does not take it; what was there is there still.
    """
    utc = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    note = None if note is None else one_line(note, NOTE_LIMIT)
    operator = None if operator is None else one_line(operator, NAME_LIMIT)
    entries = (*read(log), AddedNote(utc, _user(), note, operator))
    path = path_of(log)
    atomic_file.write(path, _text(log, entries), overwrite=True, mode=log.stat().st_mode & 0o777)
    return path


def copy(log: Path, other: Path) -> None:
    """Give another log the additions to one, and none that it had.

    Raises OSError if the disk does not take it.
    """
    entries, path = read_or_none(log), path_of(other)
    if entries:
        atomic_file.write(path, _text(other, entries), overwrite=True, mode=other.stat().st_mode & 0o777)
    else:
        path.unlink(missing_ok=True)


def _text(log: Path, entries: tuple[AddedNote, ...]) -> str:
    lines = [f"# added to {in_line(log.name)} after it was recorded; the log itself is unchanged", "version = 1"]
    for entry in entries:
        lines += ["", "[[added]]", f"utc = {quoted(entry.utc)}", f"by = {quoted(entry.by)}"]
        said = (("note", entry.note), ("operator", entry.operator))
        lines += [f"{key} = {quoted(value)}" for key, value in said if value is not None]
    return "\n".join(lines) + "\n"


def latest(entries: tuple[AddedNote, ...]) -> tuple[str | None, str | None]:
    """The last note and the last operator of additions; None where none says anything of it."""
    note = next((entry.note for entry in reversed(entries) if entry.note is not None), None)
    operator = next((entry.operator for entry in reversed(entries) if entry.operator is not None), None)
    return note, operator


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user id without a name
        return str(os.getuid())
