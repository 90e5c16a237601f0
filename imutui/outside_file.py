"""Files that a user names, read whole and no further than a limit, whatever lies behind the name; folders."""

import errno
import json
import os
import stat
import tempfile
from io import BufferedReader
from pathlib import Path
from typing import Any

from filters.errors import InputError

TEXT_LIMIT = 256 * 2**20
"""Longest table of angles or trajectory, bytes; as long as an attachment of a log may be."""


def can_be_written(folder: str | Path) -> bool:
    """Return True if this process may make files in a folder, or may make the folder where it is absent."""
    path = Path(folder).absolute()
    while not os.path.lexists(path):
        path = path.parent
    try:
        # permissions do not say it: the kernel's own file systems let root do all, and then refuse
        with tempfile.TemporaryFile(dir=path):
            return True
    except OSError:
        return False


def opened(path: Path) -> BufferedReader:
    """Open a file, and not a pipe or a device, which may never end; opening a pipe does not wait for its writer.

    Raises OSError if it is no file, or cannot be opened.
    """
    stream = open(path, "rb", opener=_without_waiting)  # noqa: SIM115 - the caller closes it
    mode = os.fstat(stream.fileno()).st_mode
    if not stat.S_ISREG(mode):
        stream.close()
        kind = "a pipe" if stat.S_ISFIFO(mode) else "a device"
        raise OSError(errno.EINVAL, f"is {kind}, not a file", str(path))
    return stream


def _without_waiting(name: str, flags: int) -> int:
    return os.open(name, flags | os.O_NONBLOCK)


def read(path: Path, limit: int) -> bytes:
    """Read a file, or a pipe that a shell stands behind a name.

    Raises InputError if it is longer, a device, or a pipe without a writer: neither would ever end.
    Raises OSError if it cannot be read.
    """
    with open(path, "rb", opener=_without_waiting) as stream:
        mode = os.fstat(stream.fileno()).st_mode
        if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
            raise InputError("it is a device, not a file")
        content = _begun(stream.fileno(), limit + 1) if stat.S_ISFIFO(mode) else b""
        content += stream.read(limit + 1 - len(content))
    if len(content) > limit:
        raise InputError(f"it is longer than {limit:,} bytes, which is the most")
    return content


def _begun(pipe: int, most: int) -> bytes:
    """Return what a pipe holds already, and have it wait for its writer from then on; InputError if there is none."""
    try:
        content = os.read(pipe, most)
    except BlockingIOError:  # the writer has not begun
        content = b""
    else:
        if not content:
            raise InputError("it is a pipe that no process writes into")
    os.set_blocking(pipe, True)
    return content


def read_json(path: Path, limit: int) -> Any:
    """Document in a file of JSON; raises as `read`, and InputError if it is none."""
    content = read(path, limit)
    try:
        return json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InputError(str(error)) from error
