"""What a walk that goes on behind damage reports of a file besides its records."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

from mcap.opcode import Opcode
from mcap.records import Header, McapRecord

from imutui.logbook import effects_file, file_lock, mcap_format, reader, reference_file, summary
from imutui.logbook.mcap_format import HEAD, MAGIC, Index, prefixed
from imutui.logbook.mcap_stream import Batch
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.session_info import METADATA
from imutui.logbook.walk import ChunkHead, Damage, End, Mark, walk

RECOVERED = "imutui.recovered"  # metadata record of a file that was rebuilt: from what, and what was lost
_ATTACHED = (summary.CONFIGURATION, effects_file.ATTACHMENT, summary.SUMMARY, *reference_file.ATTACHMENTS)
_MARKS = (
    *(Mark(prefixed(name), mcap_format.COMPRESSION_OFFSET, Opcode.CHUNK) for name in mcap_format.COMPRESSIONS),
    *(Mark(prefixed(name), HEAD.size, Opcode.METADATA) for name in (METADATA, RECOVERED)),
    *(Mark(prefixed(name), mcap_format.ATTACHMENT_NAME_OFFSET, Opcode.ATTACHMENT) for name in _ATTACHED),
    Mark(HEAD.pack(Opcode.DATA_END, 4), 0, Opcode.DATA_END),
)
Content: TypeAlias = McapRecord | Batch | ChunkHead


@dataclass(slots=True)
class Scan:
    """A file as its bytes have it: whole after `items` has ended."""

    # path, size: the file
    path: Path
    size: int = 0
    profile: str | None = None  # of its header; None if that is gone
    damages: list[Damage] = field(default_factory=list)  # bytes that are no whole record
    index: Index | None = None  # the summary, if it can be read and its checksum is right
    end: End = field(default_factory=End)  # how it ends
    chunks: int = 0  # chunks with messages
    first_ns: int | None = None  # log time of the first chunk's first message, UTC, ns
    repeated: int = 0  # chunks that stand there twice; the second is left out
    unknown: int = 0  # records of kinds that the format does not define
    held: bool = False  # whether a recorder is writing to it

    def items(
        self, progress: Callable[[float], None] = lambda share: None, *, indexes: bool = False
    ) -> Iterator[Content]:
        """Yield the whole records in file order, and note the rest in the scan.

        `progress`: called with the share done, 0 to 1.
        `indexes`: whether the index behind each chunk is compared with it.
        Raises UnreadableLogError if there is no such file, it is empty, or nothing in it is a record of an MCAP file.
        """
        last_ns: int | None = None
        open_from = 0  # damages from here on lack the time behind them
        any_record = False
        with reader.opened(self.path) as stream:
            self.held = file_lock.is_held(stream)
            self.size = stream.seek(0, 2)
            stream.seek(0)
            any_record = stream.read(len(MAGIC)) == MAGIC
            for item in walk(stream, _MARKS, progress, indexes=indexes):
                match item:
                    case Damage():
                        self.damages.append(replace(item, after_ns=last_ns))
                        continue
                    case End():
                        self.end, self.unknown, self.repeated = item, item.unknown, item.repeated
                        continue
                    case Index():
                        self.index = item
                        continue
                    case Header():
                        self.profile = item.profile
                    case ChunkHead():
                        for number in range(open_from, len(self.damages)):
                            self.damages[number] = replace(self.damages[number], before_ns=item.first_ns)
                        open_from, last_ns = len(self.damages), item.last_ns
                        self.chunks += item.last_ns > 0
                        self.first_ns = self.first_ns or item.first_ns or None
                any_record = True
                yield item
        if not any_record:
            raise UnreadableLogError(reader.foreign(self.path))


def scan(path: Path) -> Scan:
    """Walk a file for what is known of its bytes. Raises UnreadableLogError as `Scan.items`."""
    found = Scan(path)
    for _ in found.items():
        pass
    return found
