"""A log and the files beside it: those of its own are renamed and deleted with it; results and effects of screens.

Its own are its SHA-256, what was added to it later, and what a screen wrote of it alone: results,
effects, experiments. What was made of several logs stays, as does another log that was made of it. A log that is being
written is never touched.
"""

import hashlib
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from filters.errors import InputError
from imutui import outside_file
from imutui.logbook import added_notes, atomic_file, checksum_file, file_lock
from imutui.logbook import effects_file as effects
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
    with outside_file.opened(log) as stream:
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
        atomic_file.move(path, to, overwrite=False)
    except FileExistsError as error:
        raise InputError(f"{to.name} exists already, and nothing is replaced: take another name") from error


def _refuse_written(log: Path) -> None:
    with outside_file.opened(log) as stream:
        if file_lock.is_held(stream):
            raise InputError(f"{log.name} is being written, so it stays as it is: finish the recording first")


# ------------------------------------------------------------------------------------------------------ sidecar files
# Files that a screen writes beside a log, and the effects files that it can load.

_LONGEST_BASE = 120  # bytes of a name that is made of those of several logs


@dataclass(frozen=True, slots=True)
class EffectsFile:
    """A file that looks like found effects."""

    path: Path
    text: str = ""  # its content; empty if it cannot be used
    source: str = ""  # where they come from
    effects: tuple[str, ...] = ()  # names with channels, such as "thermal_lin (gy)"
    error: str = ""  # why it cannot be used


def base(logs: Sequence[Path]) -> Path:
    """Path whose name begins those of files made of logs: the log's own, or one that no other set of logs has.

    `logs`: at least one; files are written beside the first.
    """
    first, *others = logs
    if not others:
        return first
    unit = _beginning([log.stem for log in logs])
    name = f"{first.stem}_with_{'_'.join(log.stem.removeprefix(unit) for log in others)}"
    if len(os.fsencode(name)) > _LONGEST_BASE:
        digest = hashlib.sha256("/".join(log.stem for log in logs).encode("utf-8", "surrogateescape")).hexdigest()
        name = f"{first.stem[:_LONGEST_BASE]}_with_{len(others)}_more_{digest[:8]}"
    return first.with_name(name + first.suffix)


def _beginning(names: Sequence[str]) -> str:
    """What all names begin with, up to an underscore: what recordings of one unit have in common."""
    parts = [name.split("_")[:-1] for name in names]
    shared = ""
    for same in zip(*parts, strict=False):
        if len(set(same)) > 1:
            break
        shared += f"{same[0]}_"
    return shared


def keep(log: Path, ending: str, text: str) -> Path:
    """Write a text beside a log, under a name that is free.

    `ending`: the rest of the name, such as "_effects.toml".
    Returns the file.
    """
    for path in _names(log, ending):
        try:
            atomic_file.write(path, text, overwrite=False)
        except FileExistsError:
            continue
        return path
    raise FileExistsError(f"{log.stem}{ending} and all its numbered names exist; delete some")


def free_name(log: Path, ending: str) -> Path:
    """Path beside a log that does not exist yet: the log's name and the ending, with a number if need be."""
    return next(path for path in _names(log, ending) if not path.exists())


def _names(log: Path, ending: str) -> Iterator[Path]:
    end = Path(ending)
    return (log.with_name(f"{log.stem}{end.stem}{'' if n == 1 else f'_{n}'}{end.suffix}") for n in range(1, 10_000))


def effects_files(folders: Iterable[Path]) -> list[EffectsFile]:
    """Effects files of some folders (not of folders in them), the newest first."""
    found = [effects_file(path) for path in files_in(folders, (".toml",), _meant_as_effects)]
    return sorted(found, key=lambda file: -_modified(file.path))


def files_in(folders: Iterable[Path], suffixes: Sequence[str], is_meant: Callable[[Path], bool]) -> Iterator[Path]:
    """Yield files of some folders (not of folders in them) by suffix and content, each once, by name in a folder."""
    seen: set[Path] = set()
    for folder in folders:
        try:
            paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in suffixes and p.is_file())
        except OSError:
            continue
        for path in paths:
            if path.resolve() not in seen and is_meant(path):
                seen.add(path.resolve())
                yield path


def effects_file(path: Path) -> EffectsFile:
    """An effects file; one that cannot be used says why."""
    if path.exists() and not path.is_file():
        return EffectsFile(path, error="is no file")
    try:
        content = path.read_bytes()
        names = effect_names(content)
    except OSError as error:
        return EffectsFile(path, error=f"can't be read: {error.strerror or error}")
    except InputError as error:
        return EffectsFile(path, error=str(error))
    return EffectsFile(path, content.decode("utf-8-sig"), effects.parse(content).source, names)


def effect_names(content: bytes) -> tuple[str, ...]:
    """Return the effects of an effects file, such as "thermal_lin (gy)"; raises InputError if it is none."""
    return tuple(f"{effect.effect} ({' '.join(effect.channels)})" for effect in effects.parse(content).effects)


def _meant_as_effects(path: Path) -> bool:
    """Whether a file has what no scenario or profile has: effects that say how they are included."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return "include_as" in text or text.startswith("version = 1\nsource =")


def _modified(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
