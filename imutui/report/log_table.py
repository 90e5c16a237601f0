"""The logs of a folder as a table: a row each, as wide as the terminal, or as wide as it gets in a pipe."""

import textwrap

from imutui.jobs.info import Brief
from imutui.jobs.quantities import plural
from imutui.plain_text import cut, in_line
from imutui.report.numbers import NOTHING, ORIGIN

_HEADS = ("name", "start, UTC", "length", "unit", "Hz", "lost", "kind", "state")
_RIGHT = {"length", "Hz", "lost"}
_LEAST_NAME, _LEAST_NOTE = 12, 16


def text(folder: str, logs: list[Brief], width: int | None) -> str:
    """The folder, and a row for each log.

    `width`: columns; None for as many as it takes. Where a note has no room it stands below its row.
    """
    if not logs:
        return f"{in_line(folder)}: no logs (.mcap) here"
    cells = [_cells(log, year=width is None or width >= 110) for log in logs]
    widths = [max(len(line[k]) for line in [list(_HEADS), *cells]) for k in range(len(_HEADS))]
    room = 10_000 if width is None else width
    columns = sum(widths[1:])
    between = "  " if _LEAST_NAME + columns + 2 * len(widths[1:]) <= room else " "
    others = columns + len(between) * len(widths[1:])
    widths[0] = max(_LEAST_NAME, min(widths[0], room - others))
    left = room - others - widths[0] - len(between)
    beside = left >= _LEAST_NOTE
    lines = [f"{in_line(folder)}: {plural(len(logs), 'log')}, newest first", ""]
    lines.append((_line([*_HEADS], widths, between) + (f"{between}note" if beside else "")).rstrip())
    for log, line in zip(logs, cells, strict=True):
        # the note as it was said last
        note = log.note if log.added_note is None else f"{log.added_note or 'none'} (added later)"
        lines.append((_line(line, widths, between) + (between + cut(note, left) if beside and note else "")).rstrip())
        if note and not beside:
            lines += textwrap.wrap(note, room, initial_indent="    ", subsequent_indent="    ")
    return "\n".join(lines)


def _cells(log: Brief, *, year: bool) -> list[str]:
    start = log.start_utc or ""
    return [
        log.name,
        (start[0 if year else 5 : 16].replace("T", " ")) or NOTHING,
        _clock(log.seconds),
        unit(log.instrument, log.serial_number) or NOTHING,
        NOTHING if log.rate_hz is None else f"{log.rate_hz:.4g}",
        NOTHING if log.lost_packets is None else f"{log.lost_packets}",
        NOTHING if log.kind == "unknown" else ORIGIN[log.kind],
        log.state,
    ]


def unit(instrument: str, serial_number: str) -> str:
    """Model and serial number, without the version that follows a model's name: "IMU400CD 9911750"."""
    model = instrument.partition("-")[0] if instrument.startswith("IMU") else instrument
    return in_line(f"{model} {serial_number}".strip())


def _line(cells: list[str], widths: list[int], between: str) -> str:
    made = []
    for head, cell, width in zip(_HEADS, cells, widths, strict=True):
        cell = cell if len(cell) <= width else "…" + cell[1 - width :]
        made.append(cell.rjust(width) if head in _RIGHT else cell.ljust(width))
    return between.join(made)


def _clock(seconds: float | None) -> str:
    if seconds is None:
        return NOTHING
    whole = max(0, round(seconds))
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
