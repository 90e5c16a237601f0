"""A file that vanished while it was being written: renamed, removed, its folder gone, its disk unmounted or lost.

The open file is compared with what its path leads to. One that still has a name, on whatever disk, is whole and can be
finished; one that was removed, or whose disk refuses it, is lost, and nothing may be said to be in it.
"""

import errno
import os
from dataclasses import dataclass
from pathlib import Path

from imutui.logbook.writer import LogWriter

DISK_GONE = frozenset(
    (
        errno.ESTALE,
        errno.EIO,
        errno.ENXIO,
        errno.ENODEV,
        errno.ENOTCONN,
        errno.ESHUTDOWN,
        errno.EHOSTDOWN,
        errno.EHOSTUNREACH,
        errno.ETIMEDOUT,
        errno.EREMOTEIO,
        errno.ENOMEDIUM,
    )
)
"""Errors of a disk or a network share that has gone, rather than of one that is full."""


@dataclass(frozen=True, slots=True)
class VanishedFile:
    """What became of a file."""

    path: Path  # where it was made
    now_at: Path | None  # where it is now, if that is known
    is_lost: bool  # whether it can't be finished
    words: str  # what happened, for the user


def look(writer: LogWriter) -> VanishedFile | None:
    """Whether a file is not where it was made any more; None if it is there."""
    path = writer.path
    try:
        found = writer.find()
    except OSError as error:
        return unreachable(writer, error)
    if found.path == path:
        return None
    if not found.has_name:
        other = " Another file of that name is not this recording's." if path.exists() else ""
        return VanishedFile(path, None, True, f"{path} was removed while recorded to: what it held is lost.{other}")
    if found.path is None:
        words = f"{path} is not there any more (its disk unmounted?). It is finished on the disk that it is on."
        return VanishedFile(path, None, False, words)
    words = f"{path} was renamed while recorded to: it is now {found.path}, finished there."
    return VanishedFile(path, found.path, False, words)


def unreachable(writer: LogWriter, error: OSError) -> VanishedFile | None:
    """What is to be said of a file whose disk refuses it as one that has gone; None if the error is another."""
    if error.errno not in DISK_GONE:
        return None
    why = os.strerror(error.errno)
    words = (
        f"{writer.path}: {why}: its disk or network share has gone. Should it come back, the file holds what was"
        f" flushed, {writer.size:,} bytes; `imutui check` tells."
    )
    return VanishedFile(writer.path, None, True, words)
