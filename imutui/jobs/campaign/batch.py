"""The result of a batch: which of its units pass, which fail and why, and what is the table's or the room's.

A unit is held against the specification of its model, as a campaign's summary does; a tilt that all units share is
taken off its biases before. A unit against which there is nothing but what all share does not fail: it is to be
recorded again.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Literal, TypedDict, get_args

import numpy as np

import imutui
from filters.channels import CHANNELS
from filters.types import Array
from imutui.document_shape import VERSION
from imutui.jobs.campaign import common_errors, summary, unit_at_rest
from imutui.jobs.campaign.common_errors import CommonField
from imutui.jobs.campaign.log_list import LogList
from imutui.jobs.campaign.rows import Row, VerdictField
from imutui.jobs.campaign.summary_document import Kind, LimitField
from imutui.jobs.campaign.unit_at_rest import AXES, UnitAtRest
from imutui.logbook import summary as log_summary
from imutui.logbook.reader import UnreadableLogError

_OVERLAP_S = 1.0  # time that two recordings have in common before they are of two units
_WORST = ("RED", "AMBER", "OFF", "GREEN")
_TILTS = ("tilt", "gravity")

Outcome = Literal["fail", "table", "not_told", "pass"]
"""The worst first; `table`: nothing is against the unit but what all units share."""


class UnitField(TypedDict):
    """A unit of a batch.

    `name` tells it apart from all others: it is `unit`, its name in the batch, and its serial number.
    `limits` are those of its sheet that it fails by itself or is too near to tell; `shared_limits` those that it fails
    with what all units share. `common` are numbers of common errors that it has, from 0. `by_itself` names axes of
    the table along which it moves by itself while there is something that all share. `verdict` is the filter's, of its
    worst log.
    """

    name: str
    unit: str
    serial_number: str
    instrument: str
    kind: Kind
    logs: list[str]
    outcome: Outcome
    limits: list[LimitField]
    shared_limits: list[LimitField]
    common: list[int]
    by_itself: list[str]
    verdict: VerdictField | None
    errors: list[str]
    damage: list[str]
    lost_packets: int | None
    gaps_s: float
    temperature_degc: list[float] | None
    start_utc: str | None


class BatchDocument(TypedDict):
    """What `imutui report --batch --json` prints, units worst first.

    `results` is the folder with the rows, `root` what logs are below.
    """

    version: int
    library: str
    batch: str
    results: str
    root: str
    units: list[UnitField]
    common: list[CommonField]


def logs_of(batch: str, found: LogList, say: Callable[[str], None]) -> LogList:
    """Return the logs whose metadata name a batch.

    `say`: reports each file that cannot be opened, which is left out.
    Raises UnreadableLogError if no log names it; the message has the batches that there are.
    """
    own, others = [], set()
    for log in found.logs:
        path = found.path(log)
        try:
            said = log_summary.read(Path(path)).session.get("batch", "")
        except OSError as error:
            say(f"{path}: {error.strerror or error}. It is left out: which batch it is of cannot be read")
            continue
        own += [log] if said == batch else []
        others |= {said} - {""}
    if own:
        return replace(found, logs=tuple(own))
    there = f"There are logs of: {', '.join(sorted(others))}." if others else "No log there is of any batch."
    raise UnreadableLogError(f"{found.root}: no log is of the batch {batch!r}. {there}")


def result(
    batch: str,
    rows: Sequence[Row],
    root: str,
    results: str,
    tell: Callable[[str], None] = lambda text: None,
) -> BatchDocument:
    """Return the result of a batch from the rows of its logs, whose names are relative to `root`."""
    of_units = _by_unit(rows)
    paths = {name: [Path(root) / row["log"] for row in own if row["error"] is None] for name, own in of_units.items()}
    period = unit_at_rest.row_period([path for own in paths.values() for path in own])
    at_rest = []
    for name, own in paths.items():
        tell(f"comparing {name}")
        at_rest += [unit] if (unit := unit_at_rest.unit_at_rest(name, own, period)) else []
    common = common_errors.found_in(at_rest, period)
    seen = {unit.name: unit for unit in at_rest}
    limits = {name: _limits(own, seen.get(name), common) for name, own in of_units.items()}
    common += list(_common_noise(limits, seen))
    alone = common_errors.by_themselves(at_rest) if common else {}
    units = [_unit(name, of_units[name], *limits[name], common, alone.get(name, [])) for name in of_units]
    return {
        "version": VERSION,
        "library": f"imutui {imutui.__version__}",
        "batch": batch,
        "results": results,
        "root": root,
        "units": sorted(units, key=lambda unit: get_args(Outcome).index(unit["outcome"])),
        "common": common,
    }


def _by_unit(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows of each unit by what it is called; recordings that overlap in time are of several units."""
    found: dict[str, list[Row]] = {}
    for row in sorted(rows, key=lambda row: (row["start_utc"] or "", row["log"])):
        name = _name(row)
        several = (name if number == 1 else f"{name} ({number})" for number in itertools.count(1))
        free = next(one for one in several if not any(_overlap(row, other) for other in found.get(one, ())))
        found.setdefault(free, []).append(row)
    return dict(sorted(found.items()))


def _name(row: Row) -> str:
    """Name of a unit in its batch and its serial number; name of the log where that states neither."""
    return " ".join(dict.fromkeys(filter(None, (row["unit"], row["serial_number"])))) or Path(row["log"]).stem


def _overlap(a: Row, b: Row) -> bool:
    """Whether two recordings ran at the same time; a copy of a recording is the same one."""
    if a["log_sha256"] == b["log_sha256"]:
        return False
    (begin, end), (other_begin, other_end) = _span(a), _span(b)
    return begin < other_end - _OVERLAP_S and other_begin < end - _OVERLAP_S


def _span(row: Row) -> tuple[float, float]:
    """Begin and end of a recording, s since 1970; NaN, which overlaps nothing, where they are not known."""
    if row["start_utc"] is None or row["duration_s"] is None:
        return math.nan, math.nan
    begin = datetime.fromisoformat(row["start_utc"]).timestamp()
    return begin, begin + row["duration_s"]


_Limits = tuple[list[LimitField], list[LimitField]]


def _limits(rows: Sequence[Row], unit: UnitAtRest | None, common: Sequence[CommonField]) -> _Limits:
    """What a unit fails or is too near to tell by itself, and what it fails with a tilt that all share."""
    good = [row for row in rows if row["final"] is not None]
    whole = list(summary.limits_of(good)) if good else []
    tilt, sd = np.zeros(3), np.zeros(3)
    for one in common:
        if one["kind"] in _TILTS and unit is not None and unit.still:
            for size in one["sizes"]:
                axis = AXES.index(size["axis"]) - 3
                tilt[axis], sd[axis] = size["value"], size["sd"] or 0.0
    if unit is None or not tilt.any():
        return whole, []
    turned = unit.to_reading @ tilt, np.sqrt(unit.to_reading**2 @ sd**2)
    own = list(summary.limits_of([_less(row, *turned) for row in good]))
    failed = {(one["channel"], one["quantity"]) for one in own if one["verdict"] == "fails"}
    return own, [one for one in whole if one["verdict"] == "fails" and (one["channel"], one["quantity"]) not in failed]


def _less(row: Row, tilt_mg: Array, sd_mg: Array) -> Row:
    """A row whose accelerometer biases are less what a tilt makes of them, and as uncertain as that is."""
    final, sds = row["final"], row["sd"]
    assert final is not None
    assert sds is not None
    biases = [None if b is None else b - t for b, t in zip(final["accel_bias_mg"], tilt_mg.tolist(), strict=True)]
    both = zip(sds["accel_bias_mg"], sd_mg.tolist(), strict=True)
    wider = [None if own is None else float(np.hypot(own, sd)) for own, sd in both]
    return {**row, "final": {**final, "accel_bias_mg": biases}, "sd": {**sds, "accel_bias_mg": wider}}


def _common_noise(limits: dict[str, _Limits], seen: dict[str, UnitAtRest]) -> Iterator[CommonField]:
    """Noise above the sheet along one axis of the table in a quorum of units; it is taken out of the units' own."""
    failed = {
        (name, unit.channel_axes[CHANNELS.index(one["channel"])]): one
        for name, unit in seen.items()
        for one in limits[name][0]
        if one["quantity"] == "noise" and one["verdict"] == "fails"
    }
    for axis in range(len(AXES)):
        own = {name: one for (name, a), one in failed.items() if a == axis}
        if len(own) < common_errors.quorum(max(2, len(limits))):
            continue
        for name, one in own.items():
            limits[name] = [o for o in limits[name][0] if o is not one], [*limits[name][1], one]
        size = float(np.median([one["value"] for one in own.values()]))
        made = common_errors.entry("noise", list(own), {})
        unit = next(iter(own.values()))["unit"]
        yield {**made, "sizes": [{"axis": AXES[axis], "value": size, "unit": unit, "sd": None}]}


def _unit(
    name: str,
    rows: Sequence[Row],
    limits: list[LimitField],
    shared: list[LimitField],
    common: Sequence[CommonField],
    alone: list[str],
) -> UnitField:
    verdicts = [row["verdict"] for row in rows if row["verdict"] is not None]
    verdict = min(verdicts, key=lambda one: _WORST.index(one["word"]), default=None)
    temperatures = [t for row in rows if (t := row["temperature_degc"]) is not None]
    own = [number for number, one in enumerate(common) if name in one["units"]]
    moved = any(is_the_tables(common[number]) and common[number]["kind"] not in _TILTS for number in own)
    made: UnitField = {
        "name": name,
        "unit": rows[0]["unit"] or "",
        "serial_number": rows[0]["serial_number"],
        "instrument": rows[0]["instrument"],
        "kind": rows[0]["kind"],  # type: ignore[typeddict-item]
        "logs": [row["log"] for row in rows],
        "outcome": "not_told",
        "limits": limits,
        "shared_limits": shared,
        "common": own,
        "by_itself": alone,
        "verdict": verdict,
        "errors": [row["error"] for row in rows if row["error"] is not None],
        "damage": [row["damage"] or "the file is unfinished" for row in rows if row["error"] is None and _is_cut(row)],
        "lost_packets": sum(row["lost_packets"] or 0 for row in rows) if verdicts else None,
        "gaps_s": float(sum(row["gaps"]["seconds"] for row in rows if row["gaps"] is not None)),
        "temperature_degc": [min(t["min"] for t in temperatures), max(t["max"] for t in temperatures)]
        if temperatures
        else None,
        "start_utc": rows[0]["start_utc"],
    }
    return {**made, "outcome": _outcome(made, moved=moved)}


def _is_cut(row: Row) -> bool:
    return row["finished"] is not True or row["damage"] is not None


def is_the_tables(one: CommonField) -> bool:
    """Whether a common error is no unit's; what follows temperature, or keeps no phase, may be each one's own."""
    return one["follows_temperature"] is not True and one["in_step"] is not False


def _outcome(unit: UnitField, *, moved: bool) -> Outcome:
    """What a unit comes to; `moved`: whether all units share an error that changes with time."""
    verdict = unit["verdict"]
    if verdict is None or unit["errors"]:
        return "not_told"
    if any(one["verdict"] == "fails" for one in unit["limits"]) or unit["by_itself"]:
        return "fail"
    shared = moved or bool(unit["shared_limits"])
    if verdict["word"] == "RED":
        return "table" if shared else "fail"
    if unit["shared_limits"]:
        return "table"
    near = any(one["verdict"] == "not_told" and one["quantity"] == "bias" for one in unit["limits"])
    if not verdict["passes"] or near or unit["damage"]:
        return "table" if moved and not near and not unit["damage"] else "not_told"
    return "pass"


def folders_of(found: LogList) -> set[str]:
    """Names of the folders that the pages of these logs' units may go to, before any log is filtered."""
    serials = {log: log_summary.read(Path(found.path(log))).session.get("serial_number", "") for log in found.logs}
    return {folder_of(serial or Path(log).stem) for log, serial in serials.items()}


def folder_of(name: str) -> str:
    """Return the name of the folder with a unit's page: its own name as any file system takes it."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name).strip(".") or "unit"


def is_fine(document: BatchDocument) -> bool:
    """Whether all units pass."""
    return all(unit["outcome"] == "pass" for unit in document["units"])
