"""Files that are there whole or not at all."""

import contextlib
import errno
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


def write(path: Path, text: str, *, overwrite: bool) -> None:
    """Write a text so that the file is there whole or not at all.

    Raises
    ------
    FileExistsError
        If it exists and may not be replaced.
    """
    if not overwrite:
        # an empty file of our own marks the name as taken
        path.open("x").close()
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        if not overwrite:
            path.unlink(missing_ok=True)
        raise


@contextlib.contextmanager
def part_of(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """A file beside `path` to write to; it takes the name when the block ends, and is removed if that fails.

    Raises
    ------
    FileExistsError
        If `path` exists, at the beginning or at the end, and may not be replaced.
    """
    if path.exists() and not overwrite:
        raise FileExistsError(errno.EEXIST, "exists, and was not to be replaced", str(path))
    descriptor, name = tempfile.mkstemp(prefix=f"{path.name}.", suffix=".part", dir=path.parent)
    os.fchmod(descriptor, 0o666 & ~_umask())
    os.close(descriptor)
    part = Path(name)
    try:
        yield part
        _settle(part, path, overwrite=overwrite)
    finally:
        part.unlink(missing_ok=True)


def _settle(part: Path, path: Path, *, overwrite: bool) -> None:
    with part.open("rb") as stream:
        os.fsync(stream.fileno())
    if not overwrite:
        try:
            os.link(part, path)  # refuses a name that somebody took meanwhile
            return
        except FileExistsError as error:
            raise FileExistsError(errno.EEXIST, "exists, and was not to be replaced", str(path)) from error
        except OSError:  # a file system without links
            path.open("x").close()
    part.replace(path)


def _umask() -> int:
    """Of this process; there is no way to ask but to set it."""
    before = os.umask(0o077)
    os.umask(before)
    return before
