"""What a scenario's file says of the wire: faults by time, and what unit and line are like all the time."""

from typing import Literal

from filters.errors import InputError
from filters.simulation import FAULT_KINDS, Fault, Personality
from imutui.toml_values import Table, choice, known, number, whole, yes

_UNIT = (
    "version",
    "version_plain_text",
    "ping",
    "power_up_mode",
    "auto_baud",
    "reply_delay_s",
    "clock_skew_ppm",
)
_LINE = ("usb_bursts_s",)
_SIMULATED = "VIRTUAL SIM"
_PINGS: tuple[Literal["keeps", "stops", "resets"], ...] = ("keeps", "stops", "resets")
_MODES: tuple[Literal["voltage", "scaled"], ...] = ("voltage", "scaled")


def personality_of(unit: Table, line: Table) -> Personality:
    """What tables [unit] and [line] say; InputError names the key that does not fit."""
    known(unit, _UNIT, "in [unit]")
    known(line, _LINE, "in [line]")
    usual = Personality()
    version = unit.get("version")
    if version is not None and not isinstance(version, str):
        raise InputError(f"[unit]: `version` is {version!r}, not a text")
    if version is not None and _SIMULATED not in version:
        raise InputError(
            f"[unit]: `version` is {version!r}; with {_SIMULATED} in it nobody takes its readings for measured"
        )
    try:
        return Personality(
            version=version,
            version_plain_text=yes(unit, "version_plain_text", "", usual.version_plain_text),
            ping=choice(unit, "ping", "", _PINGS, usual.ping),
            power_up_mode=choice(unit, "power_up_mode", "", _MODES, usual.power_up_mode),
            auto_baud=yes(unit, "auto_baud", "", usual.auto_baud),
            reply_delay=number(unit, "reply_delay_s", "", usual.reply_delay),
            clock_skew_ppm=number(unit, "clock_skew_ppm", "", usual.clock_skew_ppm),
            usb_bursts=number(line, "usb_bursts_s", "", usual.usb_bursts),
        )
    except InputError as error:
        raise InputError(f"[unit] or [line]: {error}") from error


def fault_of(table: Table, where: str) -> Fault:
    """A table [[fault]]; InputError names the key that does not fit."""
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in FAULT_KINDS:
        raise InputError(f"{where}`kind` is {kind!r}, not one of: {', '.join(FAULT_KINDS)}")
    measure = FAULT_KINDS[kind]
    more = ("power", "serial_number") if kind == "hang_up" else ()
    known(table, tuple(filter(None, ("at_s", "kind", measure, *more))), f"in {where}{kind}")
    at = number(table, "at_s", where, least=0.0)
    if not measure:
        return Fault(at, kind)
    if measure == "count":
        return Fault(at, kind, count=whole(table, "count", 1, where))
    seconds = number(table, "seconds", where, least=0.0)
    if seconds == 0.0:
        raise InputError(f"{where}`seconds` is 0, not a positive number")
    serial_number = whole(table, "serial_number", 0, where) if "serial_number" in table else None
    try:
        return Fault(at, kind, seconds=seconds, power=yes(table, "power", where), serial_number=serial_number)
    except InputError as error:
        raise InputError(f"{where}{error}") from error
