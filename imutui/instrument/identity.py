"""What a unit says of itself."""

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Identity:
    """What the unit says of itself.

    Attributes
    ----------
    serial_number, version : str
        Empty where it did not answer.
    source : str
        Where a virtual unit's readings come from, if it says so.
    slowest_reply_s : float
        How long it took for the slowest of its answers.
    configuration : str
        How it was configured when it was found, in words; empty of units that do not say.
    own_mount : str
        How its packets' axes lie in its case as it is configured, as `filters.imu.parse_mount` reads it; empty of units
        that do not say.
    """

    serial_number: str
    version: str
    source: str = ""
    slowest_reply_s: float = field(default=0.0, compare=False)
    configuration: str = field(default="", compare=False)
    own_mount: str = field(default="", compare=False)
