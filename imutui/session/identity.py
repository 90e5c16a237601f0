"""What a unit says of itself, and what to say where it does not."""

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
    """

    serial_number: str
    version: str
    source: str = ""
    slowest_reply_s: float = field(default=0.0, compare=False)


def not_said(serial_number: str, version: str) -> str | None:
    """What to say of a unit of which these are known; None if it said both."""
    missing = [name for name, said in (("serial number", serial_number), ("version", version)) if not said]
    if not missing:
        return None
    said = f"the unit did not say its {' and its '.join(missing)}: the log has none."
    return said if serial_number else f"{said} Were another unit in its place, nobody would know."


def unit_in_words(instrument: str, serial_number: str) -> str:
    """Model and serial number, as far as it is known."""
    return f"{instrument} #{serial_number}" if serial_number else f"{instrument} without a serial number"
