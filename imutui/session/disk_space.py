"""How much a disk has left, how fast a recording fills it, and what to say when it takes no more."""

import shutil
from collections import deque
from pathlib import Path

from imutui.logbook.writer import LogWriter

_REFRESH_NS = 1_000_000_000
_MIN_SPAN_S = 10.0
_MAX_SIZES = 61


class FreeSpace:
    """Free space where recordings go; looked up once a second at most, however many ask."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._refreshed_ns = 0
        self._free: int | None = None

    def free_bytes(self, folder: Path, now_ns: int) -> int | None:
        """Bytes that this user may still write to the disk of a folder, which need not exist yet.

        Parameters
        ----------
        folder : Path
            Where recordings go.
        now_ns : int
            Monotonic clock.

        Returns
        -------
        int or None
            None if the disk does not say.
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


def disk_message(writer: LogWriter | None, error: OSError) -> str:
    """Words for a disk that does not take what is written."""
    if writer is None:
        return f"{error.filename or 'disk'}: {error.strerror or error}. Choose another folder or free some space."
    return (
        f"{writer.path}: {error.strerror or error}. The file holds everything up to its last flush"
        f" ({writer.size} bytes) and `imutui replay` reads it. Free some space, then record again."
    )
