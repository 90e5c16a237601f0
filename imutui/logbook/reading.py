"""How a log is to be read: what the caller states in place of what the file states."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from imutui.logbook.reference_file import ReferenceFile

STAMPS = ("header", "log", "arrival")
"""Sources of a sample's time: the message's header, its log time, or instants fitted under its log times."""


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
