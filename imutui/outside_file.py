"""Files that a user names, read whole and no further than a limit, whatever lies behind the name; folders."""

import json
import os
import stat
import tempfile
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


def read(path: Path, limit: int) -> bytes:
    """Content of a file, or of a pipe that a shell stands behind a name.

    Raises InputError if it is longer, or a device, which would be read for ever.
    Raises OSError if it cannot be read.
    """
    with path.open("rb") as stream:
        mode = os.fstat(stream.fileno()).st_mode
        if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
            raise InputError("it is a device, not a file")
        content = stream.read(limit + 1)
    if len(content) > limit:
        raise InputError(f"it is longer than {limit:,} bytes, which is the most")
    return content


def read_json(path: Path, limit: int) -> Any:
    """Document in a file of JSON; raises as `read`, and InputError if it is none."""
    content = read(path, limit)
    try:
        return json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InputError(str(error)) from error
