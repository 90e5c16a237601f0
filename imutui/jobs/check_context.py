"""What the rules of `check` look at, and what they find; what a scan found wrong with a file, in words."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from imutui.command_line import command
from imutui.logbook import reader, schemas, summary
from imutui.logbook.audit import Audit, Part
from imutui.logbook.scan import Scan
from imutui.logbook.walk import Damage

SHOWN = 10  # how many of many alike are told


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is not as it should be."""

    code: str  # short name for programs
    # what, where, next: sentences: what it is, where in the log, what to do
    what: str
    where: str
    next: str


class CheckContext:
    """What the rules look at.

    `found`: the file's bytes.
    `audit`: its messages.
    `sha256`: hash of the whole file.
    `start_ns`: first sample, or first message where there is none.
    `paired`: whether each packet's message can be read, and there are some.
    """

    def __init__(self, found: Scan, content: Audit, sha256: str) -> None:
        self.found = found
        self.audit = content
        self.sha256 = sha256
        first = [run.first_ns for run in content.messages.values()]
        self.start_ns: int | None = content.first_ns if content.samples else min(first) if first else None
        raw = content.messages.get(schemas.RAW)
        self.paired = raw is not None and raw.count == content.packets

    @property
    def polled(self) -> bool:
        """Whether every packet was asked for."""
        return is_polled(self.audit)

    def at(self, ns: int, preposition: str = "at") -> str:
        """An instant in the log."""
        return "" if self.start_ns is None else f"{preposition} {(ns - self.start_ns) / 1e9:.3f} s"

    def seconds_at(self, ns: int) -> float:
        """Time of a sample since the first, s."""
        return float(reader.seconds_since(ns, self.audit.first_ns))

    def recover(self) -> str:
        """What to do about a broken file."""
        return f"`{command('recover', self.found.path, '-o', 'FIXED.mcap')}` makes a whole file of what can be read."


class DataRule(Protocol):
    """A rule on messages, made with what is known when the first part comes; takes every part, then reports."""

    def take(self, part: Part, /) -> None:
        """Look at the next part."""

    def findings(self, log: CheckContext, /) -> Iterator[Finding]:
        """What it found, after the last part."""


def is_polled(known: Audit) -> bool:
    """Whether every packet was asked for."""
    return known.info is not None and known.info.sampling == "polled"


def integer(text: str | None) -> int:
    """A count as diagnostics say it; 0 where they don't."""
    try:
        return int(text) if text else 0
    except ValueError:
        return 0


# ------------------------------------------------------------------------------------------------------------- damage


def state_of(found: Scan) -> str:
    """Return the word for a file's state."""
    if found.held:
        return summary.WRITING
    if lossy(found) or not (found.end.finished or found.end.cut):
        return summary.DAMAGED
    return summary.FINISHED if found.end.finished else summary.UNFINISHED


def cut_end(found: Scan) -> Damage | None:
    """Return the damage that is only that the file ends before its last record does."""
    last = next(reversed(found.damages), None) if found.end.cut else None
    return last if last is not None and last.offset + last.bytes >= found.size else None


def lossy(found: Scan) -> list[Damage]:
    """Damage that cost records: not the cut end of an unfinished file, nor what can be made anew."""
    end = cut_end(found)
    return [d for d in found.damages if d is not end and d.what not in ("summary", "message index")]


def place(damage: Damage, start_ns: int | None) -> str:
    """One place in the file, in bytes and in the log's time."""
    after, before = since(damage.after_ns, start_ns), since(damage.before_ns, start_ns)
    if after is not None and before is not None:
        when = f", between {after:.1f} and {before:.1f} s of the log"
    elif after is not None:
        when = f", after {after:.1f} s of the log"
    elif before is not None:
        when = ", before all that can be read" if before <= 0.0 else f", before {before:.1f} s of the log"
    else:
        when = ""
    return f"{damage.bytes:,} bytes at byte {damage.offset:,}{when}"


def since(ns: int | None, start_ns: int | None) -> float | None:
    """An instant in the log, s; None where it is not known."""
    return None if ns is None or start_ns is None else (ns - start_ns) / 1e9
