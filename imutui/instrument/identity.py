"""What a unit says of itself."""

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Identity:
    """What the unit says of itself."""

    # serial_number, version: empty where it did not answer
    serial_number: str
    version: str
    source: str = ""  # where a virtual unit's readings come from, if it says so
    slowest_reply_s: float = field(default=0.0, compare=False)  # how long it took for the slowest of its answers
    # how it was configured when it was found, in words; empty of units that do not say
    configuration: str = field(default="", compare=False)
    # how its packets' axes lie in its case as it is configured, as `filters.imu.parse_mount` reads it; empty of units
    # that do not say
    own_mount: str = field(default="", compare=False)
