"""A log and the files beside it that are its own: rename them together, delete them together.

Its own are its SHA-256, what was added to it later, and what a screen wrote of it alone (`sidecar_files`): results,
effects, experiments. What was made of several logs stays, as does another log that was made of it. A log that is being
written is never touched.
"""

import errno
import os
import re
from dataclasses import dataclass
from pathlib import Path

from filters.errors import InputError
from imutui.logbook import added_notes, atomic_file, checksum_file, file_lock
from imutui.plain_text import in_line

SUFFIX = ".mcap"
_ENDINGS = re.compile(
    r"_(?:info|check|recover|replay|trace|effects|experiment)(?:_[0-9]{1,4})?\.(?:json|toml|html|svg)"
)
_LONGEST = 200


@dataclass(frozen=True, slots=True)
class LogFiles:
    """A log with what belongs to it."""

    log: Path
    beside: tuple[Path, ...]  # its own files beside it, by name
    bytes: int  # of all of them


def of(log: Path) -> LogFiles:
    """A log and its own files; raises OSError if the log is not there."""
    total = log.stat().st_size
    beside = tuple(sorted(path for path in log.parent.iterdir() if _belongs(path.name, log) and path.is_file()))
    return LogFiles(log, beside, total + sum(path.stat().st_size for path in beside))


def _belongs(name: str, log: Path) -> bool:
    if name in (checksum_file.path_of(log).name, added_notes.path_of(log).name):
        return True
    return name.startswith(log.stem) and _ENDINGS.fullmatch(name[len(log.stem) :]) is not None


def annotate(log: Path, note: str | None, operator: str | None) -> Path:
    """Add a note or an operator to a log, in a file beside it; returns that file.

    Raises InputError if the log is being written, or what is beside it cannot be used.
    Raises OSError if there is no such log, or the disk does not take it.
    """
    with log.open("rb") as stream:
        if file_lock.is_held(stream):
            raise InputError(f"{log.name} is being written: its note goes into it, by `imutui note` without --log")
    return added_notes.add(log, note, operator)


def delete(log: Path) -> list[Path]:
    """Remove a log and its own files; returns what was removed, the log last.

    Raises InputError if it is being written.
    Raises OSError if the disk or its permissions do not allow it; what is beside the log goes first, so that a log that
      could not be removed is there still.
    """
    found = of(log)
    _refuse_written(log)
    removed = [*found.beside, log]
    for path in removed:
        path.unlink(missing_ok=path is not log)
    atomic_file.sync_directory(log.parent)
    return removed


def new_path(log: Path, entered: str) -> Path:
    """Where a log is after it was renamed; ".mcap" is added where it lacks.

    Raises InputError if what was entered is no name for a file; the message says what is wrong with it.
    """
    name = entered.strip()
    name = name if name.endswith(SUFFIX) else name + SUFFIX
    stem = name.removesuffix(SUFFIX)
    if not stem:
        raise InputError("a name is needed, such as cold-start.mcap")
    if "/" in name or "\0" in name or name.startswith(".") or in_line(name) != name:
        raise InputError(
            f'"{in_line(name)}" is no name of a file here: no slash, no leading dot, no control characters'
        )
    if len(os.fsencode(name)) > _LONGEST:
        raise InputError(f"the name is {len(os.fsencode(name))} bytes long; the most is {_LONGEST}")
    return log.with_name(name)


def rename(log: Path, entered: str) -> Path:
    """Give a log another name, in its folder, and its own files with it; returns where it is now.

    The file with its SHA-256 gets the new name inside too. Nothing is ever replaced.

    Raises InputError if it is being written, or the name cannot be used or is taken.
    Raises OSError if the disk or its permissions do not allow it.
    """
    target = new_path(log, entered)
    if target == log:
        return log
    found = of(log)
    _refuse_written(log)
    moves = [(log, target), *((path, _moved(path, log, target)) for path in found.beside)]
    taken = next((to for _, to in moves if to.exists() or to.is_symlink()), None)
    if taken is not None:
        raise InputError(f"{taken.name} exists already, and nothing is replaced: take another name")
    sha256 = checksum_file.read_or_none(log)
    for path, to in moves:
        _move(path, to)
    if sha256 is not None:
        checksum_file.write(target, sha256, target.stat().st_mode & 0o777)
    atomic_file.sync_directory(log.parent)
    return target


def _moved(path: Path, log: Path, target: Path) -> Path:
    begins = log.name if path.name.startswith(log.name) else log.stem
    return path.with_name((target.name if begins == log.name else target.stem) + path.name[len(begins) :])


def _move(path: Path, to: Path) -> None:
    try:
        os.link(path, to, follow_symlinks=False)  # refuses a name that somebody took meanwhile
    except FileExistsError as error:
        raise InputError(f"{to.name} exists already, and nothing is replaced: take another name") from error
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.ENOTSUP, errno.EMLINK, errno.ENOSYS):
            raise
        path.rename(to)  # a file system without links
        return
    path.unlink()


def _refuse_written(log: Path) -> None:
    with log.open("rb") as stream:
        if file_lock.is_held(stream):
            raise InputError(f"{log.name} is being written, so it stays as it is: finish the recording first")
