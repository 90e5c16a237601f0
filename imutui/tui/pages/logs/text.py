"""What the logs page says of recordings, a line each. Pure functions."""

import time
from collections.abc import Collection, Sequence
from pathlib import Path

from imutui.jobs.info import Brief
from imutui.plain_text import in_line
from imutui.report import log_table
from imutui.session.plan import INSTRUMENT_NAMES
from imutui.session.snapshot import RecordingSnapshot
from imutui.tui import formatting

WRITING = "being written"  # state of a recording that an acquisition has open
WRITTEN = "it is being written: r finishes it"
NOTE_HINT = "What you change goes into a file beside the log, with the time: the log and its SHA-256 stay as they are."
RENAME_HINT = "Its SHA-256, notes and results get the new name too."
_FIXED = 66
_UNIT = 16
_TOLD = 6  # files that a question lists by name
_LEAST_NAME = 13
_STATES = {WRITING: "writing"}
_WIDE = 112
_NOTE = 20
_SIZE_AND_NOTE = 9 + 2 + _NOTE
_NOTE_IN_DETAIL = 60


def heading(width: int) -> str:
    """Names of the columns."""
    name = _name_width(width)
    more = f" {'size':>8}  note" if width >= _WIDE else ""
    columns = f"{'when, UTC':<11} {'length':>7} {'Hz':>4} {'kind':<9} {'state':<10} {'unit':<{_UNIT}}"
    return f"   {'name':<{name}} {columns}{more}".rstrip()


def rows(briefs: Sequence[Brief], chosen: Collection[Path], width: int) -> list[str]:
    """Recordings in a line each; no two names read the same."""
    names = formatting.apart([short(brief.path) for brief in briefs], _name_width(width))
    return [_row(brief, name, brief.path in chosen, width) for brief, name in zip(briefs, names, strict=True)]


def _row(brief: Brief, name: str, chosen: bool, width: int) -> str:
    """A recording in a line: name, start, length, rate, origin, state, unit; size and note if there is room."""
    when = "–" if brief.started is None else time.strftime("%m-%d %H:%M", time.gmtime(brief.started))
    length = "–" if brief.seconds is None else formatting.clock(brief.seconds)
    rate = "–" if brief.rate_hz is None else f"{brief.rate_hz:.4g}"
    state = _STATES.get(brief.state, brief.state)
    note = formatting.shorten(brief.latest_note, _NOTE)
    more = f" {formatting.size(brief.bytes):>8}  {note}" if width >= _WIDE else ""
    unit = formatting.shorten(log_table.unit(brief.instrument, brief.serial_number) or formatting.NOTHING, _UNIT)
    return (
        f" {'x' if chosen else ' '} {name:<{_name_width(width)}} {when:<11} {length:>7} {rate:>4} {brief.kind:<9}"
        f" {state:<10} {unit:<{_UNIT}}{more}"
    ).rstrip()


def _name_width(width: int) -> int:
    return max(width - _FIXED - (_SIZE_AND_NOTE if width >= _WIDE else 0), _LEAST_NAME)


def lead(folder: Path, briefs: Sequence[Brief] | None, chosen: Collection[Path], width: int) -> tuple[str, str]:
    """Where these are, and how many are chosen for a trace."""
    if briefs is None:
        count = "looking…"
    elif not briefs:
        count = "no recordings here; o opens another folder"
    else:
        count = f"{formatting.plural(len(briefs), 'recording')}, newest first"
    right = f"{len(chosen)} chosen, Esc chooses none" if chosen else ""
    room = max(width - len(count) - len(right) - 8, 10)
    return f"{formatting.shorten_path(str(folder), room)}   {count}", right


def order(chosen: Sequence[Brief]) -> list[Path]:
    """Runs for a trace, oldest first: the newest is the one that is held out."""
    return [brief.path for brief in sorted(chosen, key=lambda b: (b.began, str(b.path)))]


def short(path: Path) -> str:
    """A recording's name as rows have it: without what every name has."""
    name = in_line(path.name).removesuffix(".mcap")
    kind, _, rest = name.partition("_")
    return rest if rest and kind in INSTRUMENT_NAMES else name


def takes(chosen: Sequence[Path], here: Path | None, width: int) -> str:
    """What `t` traces if it is pressed now; the last of several is held out."""
    if not chosen:
        return "" if here is None else f"t traces {formatting.shorten(short(here), width - 9)}"
    count = "one" if len(chosen) == 1 else f"{len(chosen)}"
    if here is not None and here not in chosen:
        lead, tail = f"t asks: the {count} chosen (", ") or the line with the cursor"
    else:
        lead, tail = f"t traces the {count} chosen: ", "; the last is held out" if len(chosen) > 1 else ""
    said = lead + named(chosen, width - len(lead) - len(tail)) + tail
    return said if len(said) <= width else f"t asks: the {count} chosen or the line with the cursor"


def named(paths: Sequence[Path], room: int) -> str:
    """Names of recordings in so many characters: the first ones, and how many more."""
    names = [short(path) for path in paths]
    for shown in range(len(names), 0, -1):
        more = f" and {len(names) - shown} more" if shown < len(names) else ""
        said = ", ".join(names[:shown]) + more
        if len(said) <= room:
            return said
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    return formatting.shorten(names[0], max(room - len(more), 8)) + more


def deletion(name: str, beside: Sequence[str], size: int) -> str:
    """What is deleted with a recording, before it is."""
    told = ", ".join(in_line(one) for one in beside[:_TOLD])
    told += f" and {len(beside) - _TOLD} more" if len(beside) > _TOLD else ""
    also = f" With it goes what is its own: {told}." if beside else ""
    return f"{name}, {formatting.size(size)}{' in all' if beside else ''}.{also} There is no way back."


def _verdict(brief: Brief) -> str:
    """The verdict on the run that was recorded; "converged" stands beside no RED."""
    if brief.verdict in ("RED", "OFF") or brief.converged is None:
        return brief.verdict.replace("OFF", "no filter")
    said = "converged" if brief.converged else "not converged"
    return f"{brief.verdict}, {said}" if brief.verdict else said


def detail(brief: Brief | None) -> str:
    """What a line has no room for."""
    if brief is None:
        return ""
    unit = f"{brief.instrument} #{brief.serial_number}" if brief.serial_number else brief.instrument
    told = [
        brief.name,
        brief.why,
        unit,
        formatting.size(brief.bytes),
        f"reference {brief.reference}" if brief.reference else "",
        _verdict(brief),
        f"{formatting.plural(brief.lost_packets, 'packet')} lost" if brief.lost_packets else "",
        f"operator {brief.latest_operator}" if brief.latest_operator else "",
        brief.place,
        formatting.shorten(brief.latest_note, _NOTE_IN_DETAIL) + (" (added later)" if brief.added_note else ""),
    ]
    return " · ".join(part for part in told if part)


def refused(recording: RecordingSnapshot | None, what: str) -> str | None:
    """Why the filter cannot take something now, if it can't."""
    return f"a recording runs: r finishes it, then {what} can be loaded" if recording is not None else None
