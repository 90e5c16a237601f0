"""The open file of a log that is being written: made so that nothing is replaced, hashed as it is written."""

import errno
import hashlib
import io
import os
from pathlib import Path
from typing import TYPE_CHECKING

from imutui.logbook import atomic_file, checksum_file

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


MODE = 0o640
"""Permissions of a log, unless configured: for its owner and group; a note or a place is nobody else's business."""


class HashingFile(io.FileIO):
    """A file that is written from its beginning to its end, never at another place, with the SHA-256 of its bytes.

    So the hash of a file of gigabytes is there when the file is finished, and closing it takes no time.

    `descriptor`: open for writing, at the beginning of an empty file.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor, "wb")
        self._digest = hashlib.sha256()

    def write(self, data: "ReadableBuffer", /) -> int:
        """Write as many bytes as the disk takes; returns how many."""
        written = super().write(data)
        self._digest.update(memoryview(data).cast("B")[:written])
        return written

    def sha256(self) -> str:
        """Hash of what has been written so far, in hexadecimal digits."""
        return self._digest.hexdigest()


def create(path: Path, *, overwrite: bool, mode: int = MODE) -> HashingFile:
    """Make the empty, claimed file of a log that grows under its name, and its folder; both names are on the disk.

    `path`: file to make.
    `overwrite`: whether an existing one may be replaced.
    `mode`: its permissions, whatever the umask.
    Raises FileExistsError if it exists and may not be replaced.
    Raises InputError if a process writes it.
    Raises OSError if it cannot be made; nothing is left then.
    """
    made = _make_folder(path.parent)
    stream = HashingFile(atomic_file.create(path, overwrite=overwrite, mode=mode))
    try:
        # a checksum of an earlier file of this name does not belong to the new one
        checksum_file.remove(path)
        for folder in made:
            atomic_file.sync_directory(folder)
    except OSError:
        stream.close()
        path.unlink(missing_ok=True)
        raise
    return stream


def _make_folder(folder: Path) -> list[Path]:
    """Make a folder with its parents; returns the folders whose entries are new, the file's own among them."""
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise NotADirectoryError(errno.ENOTDIR, "is a file, not a folder", error.filename) from error
    return [folder, *(one.parent for one in missing)]


def is_at(descriptor: int, path: Path) -> bool:
    """Whether an open file is the one that a path leads to. Raises OSError if its disk does not say."""
    mine = os.fstat(descriptor)
    try:
        return os.path.samestat(mine, path.stat())
    except (FileNotFoundError, NotADirectoryError):
        return False
    except PermissionError:  # of a folder: it can't be looked into, and written to it is all the same
        return mine.st_nlink > 0
