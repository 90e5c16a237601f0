"""The identity of a unit in words, and what is missing of it."""

import re


def model_of(version: str) -> str:
    """Return the model in a version text such as "IMU400CD-200 1.07"; empty if it names none."""
    named = re.match(r"[A-Z]{2,}[ -]?\d+[A-Z]*(-\d+)?", version.strip(), re.IGNORECASE)
    return named[0] if named else ""


def not_said(serial_number: str, version: str) -> str | None:
    """Return which of these a unit did not report, in words; None if it reported both."""
    missing = [name for name, said in (("serial number", serial_number), ("version", version)) if not said]
    if not missing:
        return None
    said = f"the unit did not say its {' and its '.join(missing)}: the log has none."
    return said if serial_number else f"{said} Were another unit in its place, nobody would know."


def unit_in_words(instrument: str, serial_number: str) -> str:
    """Return model and serial number, as far as they are known."""
    return f"{instrument} #{serial_number}" if serial_number else f"{instrument} without a serial number"
