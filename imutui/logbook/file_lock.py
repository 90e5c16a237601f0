"""Whether a log is being written by a living process: a lock that the kernel drops however that process ends.

A lock of the open file (not of the process), so that asking about it neither takes nor disturbs it.
"""

import contextlib
import errno
import fcntl
import struct
from typing import IO, Any

# struct flock: l_type, l_whence, l_start, l_len, l_pid; a length of 0 is the whole file
_FLOCK = "hhqqi0q"
_BEGINNING = 0


def claim(stream: IO[Any]) -> None:
    """Mark an open file as being written until it is closed; a file system without such locks does without."""
    with contextlib.suppress(OSError):
        fcntl.fcntl(stream, fcntl.F_OFD_SETLK, struct.pack(_FLOCK, fcntl.F_WRLCK, _BEGINNING, 0, 0, 0))


def take(stream: IO[Any]) -> bool:
    """As `claim`, but tells whether it is ours: False only if another open file claims it."""
    try:
        fcntl.fcntl(stream, fcntl.F_OFD_SETLK, struct.pack(_FLOCK, fcntl.F_WRLCK, _BEGINNING, 0, 0, 0))
    except OSError as error:
        return error.errno not in (errno.EACCES, errno.EAGAIN)
    return True


def is_held(stream: IO[Any]) -> bool:
    """Whether another open file claims this one."""
    wanted = struct.pack(_FLOCK, fcntl.F_RDLCK, _BEGINNING, 0, 0, 0)
    try:
        found = fcntl.fcntl(stream, fcntl.F_OFD_GETLK, wanted)
    except OSError:
        return False
    return bool(struct.unpack(_FLOCK, found)[0] != fcntl.F_UNLCK)
