"""The lock of a log that a process writes. The kernel releases it however that process ends.

The lock belongs to the open file, not to the process, so a query neither takes nor disturbs it. A file system without
such locks does without.
"""

import contextlib
import errno
import fcntl
import os
import struct
from pathlib import Path
from typing import IO, Any, TypeAlias

from filters.errors import InputError

File: TypeAlias = "IO[Any] | int"
"""An open file, or its descriptor."""

# struct flock: l_type, l_whence, l_start, l_len, l_pid; a length of 0 is the whole file
_FLOCK = "hhqqi0q"
_BEGINNING = 0


def claim(file: File) -> None:
    """Mark an open file as being written until it is closed."""
    with contextlib.suppress(OSError):
        fcntl.fcntl(file, fcntl.F_OFD_SETLK, struct.pack(_FLOCK, fcntl.F_WRLCK, _BEGINNING, 0, 0, 0))


def take(file: File) -> bool:
    """Mark a file as `claim` does; return False only if another open file claims it."""
    try:
        fcntl.fcntl(file, fcntl.F_OFD_SETLK, struct.pack(_FLOCK, fcntl.F_WRLCK, _BEGINNING, 0, 0, 0))
    except OSError as error:
        return error.errno not in (errno.EACCES, errno.EAGAIN)
    return True


def is_held(file: File) -> bool:
    """Return whether another open file claims this one."""
    wanted = struct.pack(_FLOCK, fcntl.F_RDLCK, _BEGINNING, 0, 0, 0)
    try:
        found = fcntl.fcntl(file, fcntl.F_OFD_GETLK, wanted)
    except OSError:
        return False
    return bool(struct.unpack(_FLOCK, found)[0] != fcntl.F_UNLCK)


def refuse_held(path: Path) -> None:
    """Raise InputError if a process writes a log at `path`: nothing may take its name."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:  # no file, or a link: a rename replaces the link and not the file behind it
        return
    try:
        if is_held(descriptor):
            raise InputError(
                f"{path} is being written and stays as it is, with --force too: `imutui stop` finishes a recording."
                " Or name another file."
            )
    finally:
        os.close(descriptor)
