"""A mapped file that is walked from end to end: what has been looked at does not stay in memory."""

import mmap
import zlib

WINDOW = 8 * 2**20
"""Bytes that are looked at before those behind are let go."""


def forget(data: mmap.mmap, first: int, last: int) -> None:
    """Let go of the memory that holds a file's bytes from one offset up to another; they are read anew when asked for.

    `data`: a file, mapped for reading.
    `first`, `last`: offsets; whole pages between them are let go.
    """
    begin = -(-first // mmap.PAGESIZE) * mmap.PAGESIZE
    length = last // mmap.PAGESIZE * mmap.PAGESIZE - begin
    # not every system can be told
    if length > 0 and hasattr(mmap, "MADV_DONTNEED"):
        data.madvise(mmap.MADV_DONTNEED, begin, length)


def find(data: mmap.mmap, mark: bytes, start: int) -> int:
    """Offset of the first such bytes from `start` on; -1 if there are none."""
    size = len(data)
    for first in range(start, size, WINDOW):
        last = min(first + WINDOW, size)
        found = data.find(mark, first, min(last + len(mark) - 1, size))
        if found >= 0:
            return found
        forget(data, first, last)
    return -1


def crc32(data: mmap.mmap, end: int) -> int:
    """Checksum of a file's bytes up to an offset."""
    checksum = 0
    with memoryview(data) as view:
        for first in range(0, end, WINDOW):
            last = min(first + WINDOW, end)
            checksum = zlib.crc32(view[first:last], checksum)
            forget(data, first, last)
    return checksum
