"""Files that a screen writes beside a log, and the effects files that it can load."""

import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from filters.errors import InputError
from imutui.logbook import atomic_file
from imutui.logbook import effects_file as effects

_LONGEST = 120  # bytes of a name that is made of those of several logs


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
    if len(os.fsencode(name)) > _LONGEST:
        digest = hashlib.sha256("/".join(log.stem for log in logs).encode("utf-8", "surrogateescape")).hexdigest()
        name = f"{first.stem[:_LONGEST]}_with_{len(others)}_more_{digest[:8]}"
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

    `log`: the log; its name without suffix begins the file's.
    `ending`: the rest of the name, such as "_effects.toml".
    `text`: what to write.
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
    found: dict[Path, EffectsFile] = {}
    for folder in folders:
        for path in _tomls(folder):
            if path.resolve() not in found and _meant_as_effects(path):
                found[path.resolve()] = effects_file(path)
    return sorted(found.values(), key=lambda file: -_modified(file.path))


def effects_file(path: Path) -> EffectsFile:
    """An effects file; one that cannot be used says why."""
    if path.exists() and not path.is_file():
        return EffectsFile(path, error="is no file")
    try:
        content = path.read_bytes()
        document = effects.parse(content)
    except OSError as error:
        return EffectsFile(path, error=f"can't be read: {error.strerror or error}")
    except InputError as error:
        return EffectsFile(path, error=str(error))
    names = tuple(f"{effect.effect} ({' '.join(effect.channels)})" for effect in document.effects)
    return EffectsFile(path, content.decode("utf-8-sig"), document.source, names)


def _tomls(folder: Path) -> list[Path]:
    try:
        return sorted(p for p in folder.iterdir() if p.suffix.lower() == ".toml" and p.is_file())
    except OSError:
        return []


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
