"""What the Record page says and asks. Pure functions of a snapshot."""

from pathlib import PurePath
from typing import TYPE_CHECKING

from filters.errors import InputError
from imutui.session.plan import RecordingWish, of_model
from imutui.session.snapshot import MarkLine, RecordingSnapshot, Snapshot
from imutui.settings import SETTINGS
from imutui.tui import formatting, messages

if TYPE_CHECKING:
    from imutui.jobs.documents import RunDocument

FLUSH_LIMIT_S = 3.0  # age of the last flush above which the disk does not keep up: one is due every second
HOUR_S = 3600.0
WARN_S, HURRY_S = 1800.0, 300.0
"""Time until the disk has no room for more that is worth a colour, and that is worth to be quick."""
_LABELS = {each.name: each.setting.label for each in SETTINGS.values()} | {"note": "note"}
FIELDS = {name: _LABELS[name] for name in ("operator", "place", "table", "note", "rotate_minutes", "rotate_mb")}
"""Fields of the form and what they are called; names of the snapshot and of `RecordingWish`."""
NUMBERS = ("rotate_minutes", "rotate_mb")


def state(now: Snapshot | None) -> tuple[str, str]:
    """Level and words of the one thing to know: whether it is recording."""
    if now is None:
        return "none", "NOT CONNECTED"
    if now["state"] == "ended":
        return "none", "ENDED"
    recording = now["recording"]
    if recording is None:
        return "none", "NOT RECORDING"
    return "bad", f"● RECORDING  {formatting.clock(recording['seconds'])}"


def hint(now: Snapshot | None) -> str:
    """What the next key does."""
    if now is None:
        return "1 connects to an instrument; there, v starts the demo"
    if now["state"] == "ended":
        return "nothing is recorded any more; 1 connects again"
    if now["recording"]:
        return "m marks what happens; r finishes the file"
    return "r begins a file, with what stands below"


def fill_words(recording: RecordingSnapshot, free_bytes: float | None) -> str:
    """Hours until the disk is full, at this growth."""
    free = f"{formatting.size(free_bytes)} free" if free_bytes is not None else "free space unknown"
    seconds = recording["to_full_s"]
    if seconds is None:
        return free
    return f"full in {until_full(float(seconds))}, {free}"


def room(recording: RecordingSnapshot) -> str:
    """Level of the time until the disk has no room for more."""
    seconds = recording["to_full_s"]
    if seconds is None or seconds > WARN_S:
        return "none"
    return "wait" if seconds > HURRY_S else "bad"


def until_full(seconds: float) -> str:
    """A time to go: minutes, then hours, then days."""
    if seconds < HOUR_S:
        return f"{seconds / 60.0:.0f} min"
    if seconds < 100.0 * HOUR_S:
        return f"{seconds / HOUR_S:.1f} h"
    return f"{seconds / HOUR_S / 24.0:.0f} days"


def growth(recording: RecordingSnapshot) -> str:
    """How fast the file grows, in the unit that adds up over a day's work."""
    rate = recording["bytes_per_s"]
    return "growth not known before 10 s" if rate is None else f"grows {formatting.size(rate * HOUR_S)}/h"


def part(recording: RecordingSnapshot, now: Snapshot) -> str:
    """Which file of the recording this is, and when the next begins."""
    return f"part {recording['part']}, {rotation(now['rotate_minutes'], now['rotate_mb'])}"


def rotation(minutes: float | None, megabytes: float | None) -> str:
    """When a file is finished and the next one begun."""
    limits = [f"{minutes:g} min" if minutes else "", f"{megabytes:g} MB" if megabytes else ""]
    said = " or ".join(limit for limit in limits if limit)
    return f"a new file every {said}" if said else "one file"


def flush(recording: RecordingSnapshot) -> tuple[str, str]:
    """Level and words of how old the last flush is."""
    age = recording["flush_age_s"]
    if age is None:
        return "wait", "not flushed yet"
    if age > FLUSH_LIMIT_S:
        return (
            "bad",
            f"LATE: last flush {age:.1f} s ago; the disk does not keep up, and what is not flushed can be lost",
        )
    return "none", f"ok, flushed {age:.1f} s ago; every second is due"


def line(now: Snapshot) -> tuple[str, str]:
    """Level and words of the serial line."""
    silent = messages.silence(now)
    if silent is not None:
        return "bad", silent
    if now["silent_s"] is None:
        return "none", "the acquisition has ended" if now["state"] == "ended" else "no packet yet"
    return "none", f"ok, last packet {max(now['silent_s'], 0.0):.1f} s ago"


def losses(now: Snapshot) -> tuple[str, str]:
    """Level and words of what did not arrive."""
    lost, bad, skipped = now["lost_packets_max"], now["bad_checksums"], now["discarded_bytes"]
    said = f"lost {messages.lost(now)}, checksum errors {bad}, resynchronised {skipped} B"
    return ("wait", f"{said}: {now['advice']['losses']}") if lost or bad else ("none", said)


def mark_line(mark: MarkLine) -> str:
    """Time of day, time in the recording, text."""
    since = "" if mark["t"] is None else formatting.clock(mark["t"])
    return f"{mark['utc']}  {since:>8}  {mark['text']}"


def prefilled(now: Snapshot) -> dict[str, str]:
    """What the form begins with: what the acquisition has."""
    return {
        "operator": now["operator"],
        "place": now["place"],
        "table": now["table"],
        # not that of the recording that runs, which is its own
        "note": now["next_note"],
        "rotate_minutes": f"{now['rotate_minutes']:g}" if now["rotate_minutes"] else "",
        "rotate_mb": f"{now['rotate_mb']:g}" if now["rotate_mb"] else "",
    }


def wish(entered: dict[str, str]) -> RecordingWish:
    """What is asked of the recording that begins; a field that is not among those entered stays as it is.

    Raises InputError if a number is none; the message names the field.
    """
    texts = {name: said.strip() for name, said in entered.items()}
    minutes, megabytes = (_number(name, entered[name]) if name in entered else None for name in NUMBERS)
    note, operator, place, table = (texts.get(name) for name in ("note", "operator", "place", "table"))
    return RecordingWish(note, operator, place, table, minutes, megabytes)


def _number(name: str, entered: str) -> float:
    try:
        value = float(entered.strip().replace(",", ".") or 0.0)
    except ValueError:
        raise InputError(f'"{FIELDS[name]}" is "{entered.strip()}", not a number; empty for never') from None
    if not 0.0 <= value < 1e6:
        raise InputError(f'"{FIELDS[name]}" is {value:g}; it must be positive, or empty for never')
    return value


def will_write(now: Snapshot) -> str:
    """Where a file would go."""
    name, number = of_model(now["instrument"]).name, now["serial_number"] or "serial"
    return str(PurePath(now["logs"] or "the logs folder") / f"{name}_{number}_UTC_note.mcap")


def finished(recording: RecordingSnapshot | None, result: "RunDocument") -> list[tuple[str, str]]:
    """What was written: names and values of up to four lines."""
    of_recording = None if recording is None else recording["seconds"]
    seconds = result["duration_s"] if "final" in result else of_recording
    done = "" if "final" not in result or result["converged"] else ", not converged"
    return [
        ("wrote", result["log"]),
        ("holds", f"{formatting.plural(result['samples'], 'sample')} in {formatting.clock(seconds)}"),
        *((name.removesuffix(" bias"), f"bias {values}{done}") for name, values in messages.final_biases(result)),
    ]
