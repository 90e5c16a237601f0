"""Rows of a campaign as a summary of the fleet: groups of one model and kind, what was left out and why."""

from collections.abc import Iterator, Sequence

import imutui
from imutui.jobs.campaign import fleet_values, summary_channels, summary_effects, summary_limits
from imutui.jobs.campaign.rows import Row
from imutui.jobs.campaign.summary_document import ErrorField, GroupField, Kind, SummaryDocument, UnitField
from imutui.jobs.quantities import that_many

VERSION = 1
_KINDS: tuple[Kind, ...] = ("measured", "simulated", "unknown")


def summary(rows: Sequence[Row], results: str) -> SummaryDocument:
    """Summary of a fleet.

    `rows`: of `stored_rows.rows_of`, at least one.
    `results`: name of the file that they stand in.
    """
    good = [row for row in rows if not row.get("error") and row["final"] is not None]
    bad = [row for row in rows if row.get("error") or row["final"] is None]
    groups: dict[tuple[int, str], list[Row]] = {}
    for row in good:
        groups.setdefault((_KINDS.index(_kind(row)), row.get("instrument") or ""), []).append(row)
    return {
        "version": VERSION,
        "library": f"imutui {imutui.__version__}",
        "results": results,
        "rows": len(rows),
        "used": len(good),
        "errors": [_error(row, row.get("error") or "no filter ran: its row has no result") for row in bad],
        "trace_errors": [_error(row, told) for row in good if (told := row.get("trace_error"))],
        "groups": [_group(groups[key]) for key in sorted(groups)],
    }


def _kind(row: Row) -> Kind:
    return next((kind for kind in _KINDS if row.get("kind") == kind), "unknown")


def _error(row: Row, told: str) -> ErrorField:
    return {"log": row["log"], "error": told}


def _group(rows: Sequence[Row]) -> GroupField:
    known = [row for row in rows if row.get("serial_number")]
    return {
        "kind": _kind(rows[0]),
        "instrument": rows[0].get("instrument") or "",
        "logs": len(rows),
        "units": _units(known),
        "unknown_unit": [row["log"] for row in rows if not row.get("serial_number")],
        "channels": summary_channels.channels(known) if known else [],
        "limits": summary_limits.limits(rows),
        "effects": summary_effects.effects(known),
        "traced_logs": len(summary_effects.traced(known)),
        "notes": list(_notes(rows, known)),
    }


def _units(rows: Sequence[Row]) -> list[UnitField]:
    units: dict[str, list[Row]] = {}
    for row in rows:
        units.setdefault(row["serial_number"], []).append(row)
    made: list[UnitField] = []
    for serial in sorted(units):
        times = sorted(t for row in units[serial] if (t := row.get("start_utc")))
        made.append(
            {
                "serial_number": serial,
                "logs": len(units[serial]),
                "power_ons": len({fleet_values.power_on(row) for row in units[serial]}),
                "first_utc": times[0] if times else None,
                "last_utc": times[-1] if times else None,
            }
        )
    return made


def _notes(rows: Sequence[Row], known: Sequence[Row]) -> Iterator[str]:
    """What keeps rows of a group from being alike, or out of it."""
    lost = len(rows) - len(known)
    if lost:
        yield (
            f"{that_many(lost, 'log', 'states', 'state')} no serial number. Which unit it is of is not known: no"
            " estimate has it, and it is held to the limits for itself."
        )
    alone = sum(not row.get("power_on") for row in known)
    if alone:
        yield f"{that_many(alone, 'log', 'does', 'do')} not say of which power-on; each is taken for one of its own."
    if len({row.get("settings_sha256") for row in rows}) > 1:
        yield "These rows were made with different settings, which may change biases: make them anew with one."
    references = sorted({told for row in known if (told := row.get("reference"))})
    if len(references) > 1:
        yield (
            f"References differ ({', '.join(references)}): what a bias holds beside the unit's own, such as the tilt of"
            " a table, differs with them."
        )
    if count := sum(not row.get("start_utc") for row in known):
        yield f"{that_many(count, 'log', 'does', 'do')} not say when it was recorded: of such a unit no drift is told."
