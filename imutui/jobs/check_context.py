"""What the rules of `check` look at, and what they find."""

from dataclasses import dataclass

import numpy as np

from imutui.logbook import reader, schemas
from imutui.logbook.message_arrays import Audit
from imutui.logbook.scan import Scan

SHOWN = 10
"""How many of many alike are told."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is not as it should be.

    Attributes
    ----------
    code : str
        Short name for programs.
    what, where, next : str
        Sentences: what it is, where in the log, what to do.
    """

    code: str
    what: str
    where: str
    next: str


class CheckContext:
    """What the rules look at.

    Attributes
    ----------
    found : Scan
        The file's bytes.
    audit : Audit
        Its messages.
    sha256 : str
        Hash of the whole file.
    start_ns : int or None
        First sample, or first message where there is none.
    t : np.ndarray
        Samples' time since the first, s.
    """

    def __init__(self, found: Scan, content: Audit, sha256: str) -> None:
        self.found = found
        self.audit = content
        self.sha256 = sha256
        first = [heads["log_ns"][0] for heads in content.messages.values() if heads.size]
        stamps = content.samples
        self.start_ns: int | None = int(stamps[0]) if stamps.size else int(min(first)) if first else None
        self.t = reader.seconds_since(stamps, int(stamps[0])) if stamps.size else np.empty(0)
        raw = content.messages.get(schemas.RAW)
        self.raw = raw if raw is not None and raw.size == content.packets.size else None
        """Numbers and times of the packets; None where there are none, or not all of them can be read."""

    @property
    def name(self) -> str:
        """The file as commands name it."""
        return str(self.found.path)

    @property
    def polled(self) -> bool:
        """Whether every packet was asked for."""
        return self.audit.info is not None and self.audit.info.sampling == "polled"

    def at(self, ns: int, preposition: str = "at") -> str:
        """An instant in the log."""
        return "" if self.start_ns is None else f"{preposition} {(ns - self.start_ns) / 1e9:.3f} s"

    def recover(self) -> str:
        """What to do about a broken file."""
        return f"`imutui recover {self.name} -o FIXED.mcap` makes a whole file of what can be read."
