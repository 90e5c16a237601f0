"""What the logs page says of recordings, a line each. Pure functions."""

import time
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from imutui.session.snapshot import RecordingSnapshot
from imutui.tui import formatting

if TYPE_CHECKING:
    from imutui.jobs.info import Brief

_FIXED = 58
_LEAST_NAME = 21
_STATES = {"being written": "writing"}
_MAKE = "imu400cd_"  # every name that we make up begins so
_NOTE_FROM = 112
_NOTE = 28


def heading(width: int) -> str:
    """Names of the columns."""
    name = _name_width(width)
    note = "  note" if width >= _NOTE_FROM else ""
    return f"   {'name':<{name}} {'when, UTC':<11} {'length':>7} {'Hz':>4} {'kind':<9} {'state':<10} {'size':>8}{note}"


def row(brief: "Brief", chosen: bool, width: int) -> str:
    """A recording in a line: name, start, length, rate, origin, state, size, and its note if there is room."""
    name = formatting.shorten(brief.name.removesuffix(".mcap").removeprefix(_MAKE), _name_width(width))
    when = "–" if brief.started is None else time.strftime("%m-%d %H:%M", time.gmtime(brief.started))
    length = "–" if brief.seconds is None else formatting.clock(brief.seconds)
    rate = "–" if brief.rate_hz is None else f"{brief.rate_hz:.4g}"
    state = _STATES.get(brief.state, brief.state)
    note = f"  {formatting.shorten(brief.note, _NOTE)}" if width >= _NOTE_FROM else ""
    return (
        f" {'x' if chosen else ' '} {name:<{_name_width(width)}} {when:<11} {length:>7} {rate:>4} {brief.kind:<9}"
        f" {state:<10} {formatting.size(brief.bytes):>8}{note}"
    )


def _name_width(width: int) -> int:
    note = _NOTE + 2 if width >= _NOTE_FROM else 0
    return max(width - _FIXED - note, _LEAST_NAME)


def lead(folder: Path, briefs: "Sequence[Brief] | None", chosen: Collection[Path], width: int) -> tuple[str, str]:
    """Where these are, and how many are chosen."""
    if briefs is None:
        count = "looking…"
    elif not briefs:
        count = "no recordings here; o opens another folder"
    else:
        count = f"{formatting.plural(len(briefs), 'recording')}, newest first"
    right = f"{len(chosen)} chosen for t" if chosen else ""
    room = max(width - len(count) - len(right) - 8, 10)
    return f"{formatting.shorten_path(str(folder), room)}   {count}", right


def order(chosen: "Sequence[Brief]") -> list[Path]:
    """Runs for a trace, oldest first: the newest is the one that is held out."""
    return [brief.path for brief in sorted(chosen, key=lambda b: (b.started or b.modified, str(b.path)))]


def detail(brief: "Brief | None") -> str:
    """What a line has no room for."""
    if brief is None:
        return ""
    unit = f"{brief.instrument} #{brief.serial_number}" if brief.serial_number else brief.instrument
    told = [
        brief.name,
        brief.why,
        unit,
        f"reference {brief.reference}" if brief.reference else "",
        {True: "converged", False: "not converged"}.get(brief.converged, "") if brief.converged is not None else "",
        f"{formatting.plural(brief.lost_packets, 'packet')} lost" if brief.lost_packets else "",
        f"operator {brief.operator}" if brief.operator else "",
        brief.place,
        brief.note,
    ]
    return " · ".join(part for part in told if part)


def refused(recording: RecordingSnapshot | None, what: str) -> str | None:
    """Why the filter cannot take something now, if it can't."""
    return f"a recording runs: r finishes it, then {what} can be loaded" if recording is not None else None
