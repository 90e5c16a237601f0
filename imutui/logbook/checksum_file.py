"""The SHA-256 beside a finished log, `LOG.mcap.sha256`, as `sha256sum -c` reads it."""

import re
from pathlib import Path

from filters.errors import InputError
from imutui.logbook import atomic_file

SUFFIX = ".sha256"
_MOST_BYTES = 8192
_LINE = re.compile(r"\\?([0-9a-fA-F]{64})(?:\s|\Z)")


def path_of(log: Path) -> Path:
    """Where the sum of a log is."""
    return log.with_name(log.name + SUFFIX)


def write(log: Path, sha256: str, mode: int) -> Path:
    """Write the sum of a finished log beside it, in place of an older one.

    `sha256`: hash of its bytes, hexadecimal.
    `mode`: permissions, the log's.
    Raises OSError if the disk does not take it; nothing is left then.
    """
    path = path_of(log)
    atomic_file.write(path, _line(log.name, sha256), overwrite=True, mode=mode)
    return path


def read(log: Path) -> str | None:
    """Sum that stands beside a log, whatever name is in it; None if there is none.

    Raises InputError if the file beside it is no sum.
    Raises OSError if it cannot be read.
    """
    path = path_of(log)
    if not path.is_file():
        return None
    with path.open("rb") as stream:
        text = stream.read(_MOST_BYTES).decode("utf-8", errors="replace")
    found = _LINE.match(text.lstrip())
    if found is None:
        raise InputError(f"{path} holds no SHA-256")
    return found[1].lower()


def read_or_none(log: Path) -> str | None:
    """Sum that stands beside a log; None if there is none, or none that can be read."""
    try:
        return read(log)
    except (InputError, OSError):
        return None


def remove(log: Path) -> None:
    """Remove the sum of a log that is not that any more."""
    path_of(log).unlink(missing_ok=True)


def _line(name: str, sha256: str) -> str:
    # as sha256sum has it: a line break in a name is written as \n, and the line then begins with a backslash
    escaped = name.replace("\\", "\\\\").replace("\n", "\\n").replace("\r", "\\r")
    return f"{'' if escaped == name else chr(92)}{sha256}  {escaped}\n"
