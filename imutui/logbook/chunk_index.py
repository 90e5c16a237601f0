"""The index of a log that is being written, as the bytes that it will be.

mcap's writer keeps an object of dictionaries for each chunk until the end: with a chunk a second that is 3 MB an hour,
and half a gigabyte a week. The bytes are a sixth of it, and written at once.
"""

from collections.abc import Iterator
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import Writer

_LIST = "_Writer__chunk_indices"


class PackedIndex:
    """Stands for the writer's list: takes an entry a chunk, and is, at the end, its only item."""

    def __init__(self) -> None:
        self._records = bytearray()

    def append(self, entry: ChunkIndex) -> None:
        """Take the entry of a chunk that has been written."""
        builder = RecordBuilder()
        entry.write(builder)
        self._records += builder.end()  # type: ignore[no-untyped-call]

    def __iter__(self) -> Iterator["PackedIndex"]:
        yield self

    def write(self, builder: RecordBuilder) -> None:
        """Write all entries."""
        builder.write(self._records)


def keep_packed(writer: Writer) -> bool:
    """Have a writer, before its first chunk, keep its index so; whether it does.

    The list has no public name. A version of mcap that calls it otherwise writes the same file and takes more memory.
    """
    kept: Any = getattr(writer, _LIST, None)
    if kept != []:
        return False
    setattr(writer, _LIST, PackedIndex())
    return True
