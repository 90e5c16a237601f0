"""Several folders of results made one: shards of a campaign, or campaigns of several machines over one set of logs."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypedDict

from filters.errors import InputError
from imutui.document_shape import VERSION
from imutui.jobs.campaign import log_list, stored_rows
from imutui.jobs.campaign.results_folder import ResultsFolder
from imutui.jobs.campaign.rows import TIMINGS, HeadFields, Row, is_fine
from imutui.jobs.campaign.stored_rows import Part
from imutui.jobs.quantities import plural, that_many

_SHOWN = 3


class CollectDocument(TypedDict):
    """What `imutui collect --json` prints."""

    version: int
    results: str
    table: str | None
    parts: list[str]
    logs: int
    errors: int
    not_fine: int
    twice: int  # logs that more than one part has a row of
    complete: bool
    notes: list[str]


def collect(paths: Sequence[Path], results: Path, mode: int) -> CollectDocument:
    """Join the results of parts.

    `results`: folder to make; it must have no results.
    Raises UnreadableLogError if one of the parts has no results.
    Raises InputError if they are of different settings.
    Raises OSError if the disk does not take the results.
    """
    parts = [stored_rows.read(path) for path in paths]
    for part in parts[1:]:
        _check_settings(parts[0], part)
    notes = list(_notes_on(parts))
    complete = not _missing(parts) and all(part.head["complete"] for part in parts)
    rows = {log: k for k, part in enumerate(parts) for log in part.rows}
    head: HeadFields = {**parts[0].head, "shard": None, "logs": len(rows), "complete": False}
    errors = not_fine = 0
    changed: list[str] = []
    with ResultsFolder(results, head, mode) as folder:
        for log in sorted(rows):
            found = [part.rows[log] for part in parts if log in part.rows]
            # one without an error, of the log as it was last changed; else the first
            row = max(found, key=lambda row: (row["error"] is None, row["log_mtime_ns"] or 0))
            if any(_comparable(other) != _comparable(row) for other in found):
                changed.append(log)
            errors += row["error"] is not None
            not_fine += row["error"] is None and not is_fine(row)
            folder.add(row)
        table = folder.finish(complete=complete)
    if changed:
        notes.append(
            f"{that_many(len(changed), 'log', 'has', 'have')} rows that differ from part to part, such as"
            f" {', '.join(changed[:_SHOWN])}: of each, the row of the log as it was last changed is taken"
        )
    return {
        "version": VERSION,
        "results": str(results.resolve()),
        "table": None if table is None else str(table.resolve()),
        "parts": [str(part.folder) for part in parts],
        "logs": len(rows),
        "errors": errors,
        "not_fine": not_fine,
        "twice": sum(len(part.rows) for part in parts) - len(rows),
        "complete": complete,
        "notes": notes,
    }


def _comparable(row: Row) -> dict[str, object]:
    return {key: value for key, value in row.items() if key not in TIMINGS}


def _check_settings(first: Part, other: Part) -> None:
    if first.head["settings_sha256"] == other.head["settings_sha256"]:
        return
    a, b = ({**part.head["settings"], **part.head["settings"]["reading"]} for part in (first, other))
    del a["reading"], b["reading"]
    key = next((key for key in a if a[key] != b[key]), "settings")
    raise InputError(
        f"{first.folder} and {other.folder} are results of different settings, {key} {json.dumps(a[key])} and"
        f" {json.dumps(b[key])}: rows of both do not belong into one table. Run the campaign of one of them again"
        " with the other's settings."
    )


def _notes_on(parts: Sequence[Part]) -> Iterator[str]:
    roots = list(dict.fromkeys(part.head["root"] for part in parts))
    if len(roots) > 1:
        yield f"the logs lay below {' and '.join(roots)}: they are told apart by their paths below these alone"
    if missing := _missing(parts):
        yield f"no part is of shard {', '.join(missing)}"
    for part in parts:
        if not part.head["complete"]:
            of = plural(part.head["logs"], "log")
            yield f"{part.folder} is not complete: {len(part.rows):,} of {of}. Run it again."
    for part in parts:
        if part.broken:
            yield f"{part.folder}: {that_many(part.broken, 'line', 'is', 'are')} not readable; run it again"


def _missing(parts: Sequence[Part]) -> list[str]:
    """Shards that no part is of."""
    shards = [log_list.parse_shard(part.head["shard"]) for part in parts if part.head["shard"]]
    of = max((shard.of for shard in shards), default=0)
    return [f"{k}/{of}" for k in range(1, of + 1) if not any(s.number == k and s.of == of for s in shards)]
