"""How a log is to be read: what the caller states in place of what the file states."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypedDict

from imutui.logbook.reference_file import ReferenceFile

STAMPS = ("header", "log", "arrival")
"""Sources of a sample's time: the message's header, its log time, or instants fitted under its log times."""


class ReadingFields(TypedDict):
    """A reading in documents: all that repeats it but the file of a reference, which is not kept."""

    start: float | None
    end: float | None
    overrides: dict[str, str | float]
    effects: str | None  # text of the effects file; empty for none, None for the log's own
    reference: str | None  # SHA-256 of the reference's file
    topics: list[str]
    stamps: str


AXES = ("mount", "accel_sign", "gyro_sign")
"""Overrides that turn the samples of another program's log into body axes."""
_SITE = ("latitude_deg", "longitude_deg", "height_m")


@dataclass(frozen=True, slots=True)
class Reading:
    """What replaces the statements of a log while it is read. The default replaces nothing.

    A reading can be pickled, so that it reaches the workers of a campaign.
    """

    # start, end: part of the log, s since its first sample
    start: float | None = None
    end: float | None = None
    # fields of `SessionInfo` by name: reference, filter, measurements, seed, kappa, noise; of another program's log
    # also mount, accel_sign, gyro_sign, site and gravity
    overrides: Mapping[str, str | float] = field(default_factory=dict)
    reference: ReferenceFile | None = None  # a profile or trajectory instead of the log's
    effects: bytes | None = None  # content of an effects file instead of the log's; empty for no effects
    # topics: of the samples in another program's log: one, or that of the gyros and that of the accelerometers
    topics: tuple[str, ...] = ()
    stamps: str = ""  # one of `STAMPS`; "" takes the header's where they are times in order

    @property
    def of_foreign(self) -> list[str]:
        """Names of what only another program's log leaves to the caller, as far as it is stated."""
        told = {"topic": self.topics, "stamps": self.stamps}
        told |= {"mounting and signs": [name for name in AXES if name in self.overrides]}
        told |= {"site": [name for name in _SITE if name in self.overrides]}
        return [name for name, stated in told.items() if stated]

    def with_overrides(self, overrides: Mapping[str, str | float]) -> "Reading":
        """Return the reading with more overrides."""
        return replace(self, overrides={**overrides, **self.overrides})

    def document(self) -> ReadingFields:
        """Return the reading as documents have it."""
        return {
            "start": self.start,
            "end": self.end,
            "overrides": dict(sorted(self.overrides.items())),
            "effects": None if self.effects is None else self.effects.decode("utf-8", "replace"),
            "reference": None if self.reference is None else hashlib.sha256(self.reference.content).hexdigest(),
            "topics": list(self.topics),
            "stamps": self.stamps,
        }

    @classmethod
    def of(cls, document: ReadingFields) -> "Reading":
        """Return the reading of a document, without the reference's file."""
        return cls(
            document["start"],
            document["end"],
            document["overrides"],
            None,
            None if document["effects"] is None else document["effects"].encode(),
            tuple(document["topics"]),
            document["stamps"],
        )


AS_STATED = Reading()
"""A log as its file states it."""


AS_STATED = Reading()
"""A log as its file states it."""


def digest(document: Mapping[str, object]) -> str:
    """Return the SHA-256 of a document, whatever the order of its fields."""
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()
