"""How much a disk has left, how fast a recording fills it, and what to say when it takes no more."""

import errno
import shutil
from collections import deque
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
        """Bytes that this user may still write to the disk of a folder, which need not exist yet.

        `folder`: where recordings go.
        `now_ns`: monotonic clock.
        Returns none if the disk does not say.
        """
        if folder != self._folder or now_ns - self._refreshed_ns >= _REFRESH_NS:
            self._folder, self._refreshed_ns, self._free = folder, now_ns, _free(folder)
        return self._free


def _free(folder: Path) -> int | None:
    there = next((path for path in (folder, *folder.absolute().parents) if path.is_dir()), None)
    try:
        return shutil.disk_usage(there).free if there is not None else None
    except OSError:  # a share that went away; whoever writes to it will say so
        return None


class GrowthRate:
    """Bytes a second of a recording over the last minute, through all its files."""

    def __init__(self) -> None:
        self._sizes: deque[tuple[int, int]] = deque(maxlen=_MAX_SIZES)
        self._before = 0
        self._last = 0

    def add(self, now_ns: int, size: int) -> None:
        """Take the size of the present file; a smaller one than before is that of a new file."""
        if size < self._last:
            self._before += self._last
        self._last = size
        self._sizes.append((now_ns, self._before + size))

    def bytes_per_s(self) -> float | None:
        """Rate; None before there are 10 s to tell it from."""
        if not self._sizes:
            return None
        (t0, first), (t1, last) = self._sizes[0], self._sizes[-1]
        seconds = (t1 - t0) / 1e9
        return (last - first) / seconds if seconds >= _MIN_SPAN_S else None


class DiskGuard:
    """Keeps some of a disk free: nothing begins, and nothing goes on, when less is left.

    `min_free_mb`: what is kept free, MB; 0 for nothing.
    """

    def __init__(self, min_free_mb: float) -> None:
        self.min_free_bytes = round(min_free_mb * _MB)
        self._has_warned = False

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

    def seconds_left(self, free: int | None, bytes_per_s: float | None) -> float | None:
        """How long recording can go on; None if that is not known."""
        if free is None or not bytes_per_s:
            return None
        return max(0, free - self.min_free_bytes) / bytes_per_s

    def warn(self, seconds: float | None) -> str | None:
        """Words, once, when the disk has room for half an hour more."""
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
    if not _is_there(writer):
        return f"{said} The file is not there any more. Choose another folder, then record again."
    return (
        f"{said} The file holds everything up to its last flush ({writer.size} bytes) and `imutui replay` reads it."
        " Free some space, then record again."
    )


def _is_there(writer: LogWriter) -> bool:
    try:
        return writer.path.stat().st_size == writer.size
    except OSError:
        return False
