"""The disk of a recording: how much it has left, how fast it fills, whether the file is there still, and what to say.

A file that vanished was renamed or removed, or its folder, or its disk was unmounted or lost. The open file is compared
with what its path leads to. One that still has a name, on whatever disk, is whole and can be finished; one that was
removed, or whose disk refuses it, is lost, and nothing may be said to be in it.
"""

import errno
import os
import shutil
from collections import deque
from dataclasses import dataclass
from pathlib import Path

from imutui.logbook.writer import LogWriter

_REFRESH_NS = 1_000_000_000
_MIN_SPAN_S = 10.0
_MAX_SIZES = 61
_MB = 1_000_000
_WARN_S = 1800.0


class FreeSpace:
    """Free space where recordings go; looked up once a second at most, however many ask."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._refreshed_ns = 0
        self._free: int | None = None

    def free_bytes(self, folder: Path, now_ns: int) -> int | None:
        """Bytes that this user may still write to the disk of a folder, which need not exist yet; None if unknown."""
        if folder != self._folder or now_ns - self._refreshed_ns >= _REFRESH_NS:
            self._folder, self._refreshed_ns, self._free = folder, now_ns, _free(folder)
        return self._free


def _free(folder: Path) -> int | None:
    there = next((path for path in (folder, *folder.absolute().parents) if path.is_dir()), None)
    try:
        return shutil.disk_usage(there).free if there is not None else None
    except OSError:  # a share that went away; whoever writes to it will say so
        return None


class DiskGuard:
    """Keeps some of a disk free: nothing begins, and nothing goes on, when less is left; 0 keeps nothing.

    It follows how fast a recording fills it, through all its files.
    """

    def __init__(self, min_free_mb: float) -> None:
        self.min_free_bytes = round(min_free_mb * _MB)
        self._has_warned = False
        self._sizes: deque[tuple[int, int]] = deque(maxlen=_MAX_SIZES)
        self._before = self._last = 0

    def refuse(self, folder: Path) -> None:
        """Raise OSError, with what to do, if nothing can be recorded to a folder, which need not exist yet."""
        free = _free(folder)
        if free is not None and free < self.min_free_bytes:
            why = f"{_mb(free)} are free, and recording leaves {_mb(self.min_free_bytes)} (`paths.min_free_mb`)"
            raise OSError(errno.ENOSPC, why, str(folder))

    def stop(self, path: Path, free: int | None) -> str | None:
        """Words for the end of a recording whose disk has no more than `free` bytes left; None if it may go on."""
        if free is None or free >= self.min_free_bytes:
            return None
        return (
            f"{path.parent}: {_mb(free)} are free, and recording leaves {_mb(self.min_free_bytes)}"
            f" (`paths.min_free_mb`), so it has stopped; {path.name} is finished. Free some space, then record again."
        )

    def add_size(self, now_ns: int, size: int) -> None:
        """Take the size of the present file; a smaller one than before is that of a new file."""
        if size < self._last:
            self._before += self._last
        self._last = size
        self._sizes.append((now_ns, self._before + size))

    def bytes_per_s(self) -> float | None:
        """Rate over the last minute; None before there are 10 s to tell it from."""
        if not self._sizes:
            return None
        (t0, first), (t1, last) = self._sizes[0], self._sizes[-1]
        seconds = (t1 - t0) / 1e9
        return (last - first) / seconds if seconds >= _MIN_SPAN_S else None

    def seconds_left(self, free: int | None) -> float | None:
        """How long recording can go on; None if that is not known."""
        rate = self.bytes_per_s()
        return None if free is None or not rate else max(0, free - self.min_free_bytes) / rate

    def warn(self, free: int | None) -> str | None:
        """Words, once, when the disk has room for half an hour more."""
        seconds = self.seconds_left(free)
        if seconds is None or seconds > _WARN_S or self._has_warned:
            return None
        self._has_warned = True
        return f"the disk has room for {seconds / 60.0:.0f} min more; free some space"


def _mb(size: float) -> str:
    return f"{size / _MB:,.{0 if size >= 10 * _MB else 1}f} MB"


def disk_message(writer: LogWriter | None, error: OSError) -> str:
    """Words for a disk that does not take what is written."""
    if writer is None:
        return f"{error.filename or 'disk'}: {error.strerror or error}. Choose another folder or free some space."
    said = f"{writer.path}: {error.strerror or error}."
    if writer.is_empty:
        return f"{said} Nothing had been recorded yet, and no file is left. Free some space, then record again."
    try:
        is_there = writer.path.stat().st_size == writer.size
    except OSError:
        is_there = False
    if not is_there:
        return f"{said} The file is not there any more. Choose another folder, then record again."
    return (
        f"{said} The file holds everything up to its last flush ({writer.size} bytes) and `imutui replay` reads it."
        " Free some space, then record again."
    )


# of a disk or a network share that has gone, rather than of one that is full
_DISK_GONE = (
    *(errno.ESTALE, errno.EIO, errno.ENXIO, errno.ENODEV, errno.ENOTCONN, errno.ESHUTDOWN, errno.EHOSTDOWN),
    *(errno.EHOSTUNREACH, errno.ETIMEDOUT, errno.EREMOTEIO, errno.ENOMEDIUM),
)


@dataclass(frozen=True, slots=True)
class VanishedFile:
    """What became of a file."""

    now_at: Path | None  # where it is now, if that is known
    is_lost: bool  # whether it can't be finished
    words: str  # what happened, for the user


def vanished(writer: LogWriter, error: OSError | None = None) -> VanishedFile | None:
    """What became of a file that is not where it was made any more; None if it is there.

    `error` is what its disk answered: None as well if it is not that of a disk that has gone.
    """
    path = writer.path
    try:
        found = writer.find() if error is None else None
    except OSError as refusal:
        found, error = None, refusal
    if found is None:
        if error is None or error.errno not in _DISK_GONE:
            return None
        words = (
            f"{path}: {os.strerror(error.errno)}: its disk or network share has gone. Should it come back, the file"
            f" holds what was flushed, {writer.size:,} bytes; `imutui check` tells."
        )
        return VanishedFile(None, True, words)
    if found.path == path:
        return None
    if not found.has_name:
        other = " Another file of that name is not this recording's." if path.exists() else ""
        return VanishedFile(None, True, f"{path} was removed while recorded to: what it held is lost.{other}")
    if found.path is None:
        words = f"{path} is not there any more (its disk unmounted?). It is finished on the disk that it is on."
        return VanishedFile(None, False, words)
    words = f"{path} was renamed while recorded to: it is now {found.path}, finished there."
    return VanishedFile(found.path, False, words)
