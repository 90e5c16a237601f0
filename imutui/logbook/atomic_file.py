"""Files that are there whole or not at all."""

import contextlib
import errno
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


def write(path: Path, text: str, *, overwrite: bool, mode: int | None = None) -> None:
    """Write a text so that the file is there whole or not at all, and on the disk.

    `path`: file to write.
    `text`: what to write.
    `overwrite`: whether an existing file may be replaced.
    `mode`: permissions; None for what the umask leaves.
    Raises FileExistsError if it exists and may not be replaced.
    """
    if not overwrite:
        # an empty file of our own marks the name as taken
        path.open("x").close()
    part = path.with_name(path.name + ".part")
    try:
        with part.open("w", encoding="utf-8", errors="surrogateescape") as stream:
            if mode is not None:
                os.fchmod(stream.fileno(), mode)
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        if not overwrite:
            path.unlink(missing_ok=True)
        raise
    sync_directory(path.parent)


def sync_directory(folder: Path) -> None:
    """See the names in a folder onto the disk: of a file that was made, renamed or removed."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except PermissionError:  # a folder that may be written to and not listed
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _NO_DIRECTORY_SYNC:
            raise
    finally:
        os.close(descriptor)


_NO_DIRECTORY_SYNC = (errno.EINVAL, errno.ENOTSUP, errno.EBADF)
"""Of file systems that don't know it: some network shares."""


@contextlib.contextmanager
def part_of(path: Path, *, overwrite: bool, mode: int) -> Iterator[Path]:
    """A file beside `path` to write to; it takes the name when the block ends, and is removed if that fails.

    `path`: file to make.
    `overwrite`: whether an existing file may be replaced.
    `mode`: permissions, whatever the umask.
    Raises FileExistsError if `path` exists, at the beginning or at the end, and may not be replaced.
    """
    if path.exists() and not overwrite:
        raise FileExistsError(errno.EEXIST, "exists, and was not to be replaced", str(path))
    descriptor, name = tempfile.mkstemp(prefix=f"{path.name}.", suffix=".part", dir=path.parent)
    os.fchmod(descriptor, mode)
    os.close(descriptor)
    part = Path(name)
    try:
        yield part
        _settle(part, path, overwrite=overwrite)
    finally:
        part.unlink(missing_ok=True)
    sync_directory(path.parent)


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
