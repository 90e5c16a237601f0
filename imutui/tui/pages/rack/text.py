"""What the rack page says of the units of a batch. Pure functions."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from imutui.session.batch import CONNECTING, ENDED, Answer
from imutui.session.snapshot import GuideSnapshot, ProfileDescription
from imutui.tui import formatting, messages
from imutui.tui.connection.rack import UnitView
from imutui.tui.formatting import StyledText
from imutui.tui.pages.table.text import guided
from imutui.verdict import sources
from imutui.verdict.rules import RANK, SIGNS, TRACE_KEY, WORDS

MORE = " also: n note  p profile  c cancel it  s stop  S start  2-5 its pages  d detach"
TRACE = "Enter goes to the unit; there, t on 4 Filter traces its recording"
ALL = "A key counts for all units, or for those that x has chosen. Enter goes to one."
_NAME, _PLACE, _WIDE, _SEVERAL = 9, 30, 112, 2
_STYLES = {"good": "$text-success", "wait": "$text-warning", "bad": "$text-error", "none": "dim"}
NOTE_HINT = "Enter takes it, for all units that are meant; Esc: not yet."
EXCHANGE = "s stops it, and S then starts the unit that is there"
AGAIN = "S starts it again, once that is put right or another unit is in its place"
PROFILES = "Filters begin anew with it. The batch's file may name one: profile = NAME or FILE."
NO_PROFILE = "finish the recordings first: each has one reference. r does"
GUIDED = {"begin": "begun", "next": "the table is there", "cancel": "cancelled", "resume": "resumed"}
"""What is said once guides have done something."""
_NOT_GUIDED = "no table profile: the units stand as their reference says; p takes one for all"


class Wrong(NamedTuple):
    """What is wrong with a unit, at which level, and what to do about it."""

    said: str
    level: str
    todo: str = ""


def heading(width: int) -> str:
    """Names of the columns; x, y and z stand above the marks of gyros and accelerometers."""
    place = f" {'port':<{_PLACE}}" if width >= _WIDE else ""
    return f"   {'unit':<{_NAME}}{place} {'Hz':>5}  lost rec gxyz axyz   °C  {'verdict':<7} what is wrong"


def rows(units: Sequence[UnitView], chosen: Collection[str], width: int) -> list[StyledText]:
    """Units in a line each; no two names read the same."""
    names = formatting.apart([label(unit) for unit in units], _NAME)
    return [_row(unit, name, unit.name in chosen, width) for unit, name in zip(units, names, strict=True)]


def _row(unit: UnitView, name: str, chosen: bool, width: int) -> StyledText:
    """A unit in a line: name, rate, losses, whether it records, a mark a bias, temperature, verdict, what is wrong."""
    now, found = unit.now, wrong(unit)
    start = f" {'x' if chosen else ' '} {name:<{_NAME}}"
    if width >= _WIDE:
        start += f" {formatting.port_name(now['port'] if now else _port(unit), _PLACE):<{_PLACE}}"
    rate = formatting.number(now["measured_hz"] if now else None, 5, 1)
    lost = formatting.clipped(messages.lost(now).replace(" to ", "-") if now else formatting.NOTHING, 5)
    records = "rec" if now is not None and now["recording"] is not None else f" {formatting.NOTHING} "
    marks = [(SIGNS[WORDS.get(mark, "OFF")], _STYLES[mark]) for mark in unit.gauges or ("none",) * 6]
    parts: StyledText = [f"{start} {rate} {lost:>5} {records}  ", *marks[:3], "  ", *marks[3:]]
    parts += [f" {formatting.number(_degc(unit), 5, 1)}  ", (f"{badge(unit):<7} ", f"bold {_STYLES[found.level]}")]
    room = width - sum(len(part) if isinstance(part, str) else len(part[0]) for part in parts)
    return [*parts, formatting.clipped(_brief(unit, found, room), max(room, 1))]


def _brief(unit: UnitView, found: Wrong, room: int) -> str:
    """Return what is wrong in few words: a channel that departs from the model first, what is well only if it fits."""
    departure = _departure(unit)
    if departure and departure in found.said:
        return departure.partition(": ")[2]
    what_waits = found.said.partition(", but ")[2]
    return what_waits if what_waits and len(found.said) > room else found.said


def _departure(unit: UnitView) -> str:
    estimates = unit.now["filter"] if unit.now is not None else None
    return estimates["departure"] or "" if estimates is not None else ""


def common(units: Sequence[UnitView]) -> str:
    """That all units depart from the model at the same step, if they do: what they have in common is the table."""
    steps = {_departure(unit).partition(":")[0] for unit in units}
    if len(units) < _SEVERAL or len(steps) != 1 or "" in steps:
        return ""
    return f"All depart from the model at {steps.pop()}: look at table, profile or room first."


def label(unit: UnitView) -> str:
    """Name of a unit in its batch, with its serial number where the name is a mere number."""
    name = unit.name.partition(":")[2] or unit.name
    return f"{name} {unit.serial_number}" if name.isdecimal() and unit.serial_number not in ("", name) else name


def _port(unit: UnitView) -> str:
    return unit.unit.port if unit.unit is not None else ""


def _degc(unit: UnitView) -> float | None:
    return unit.now["channels"][-1]["value"] if unit.now is not None and unit.now["channels"] else None


def level(unit: UnitView) -> str:
    """How bad it is: that of what is wrong with it."""
    return wrong(unit).level


def badge(unit: UnitView) -> str:
    """Sign and word of the verdict; of a unit that does not answer what it does instead."""
    if unit.answer is None or unit.answer.missing == CONNECTING:
        return f"{SIGNS['WAIT']} WAIT"
    if unit.now is None:
        sign = SIGNS["RED" if level(unit) == "bad" else "ENDED"]
        return f"{sign} {'ENDED' if unit.answer.missing == ENDED else 'SILENT'}"
    if unit.verdict is None or RANK[level(unit)] > RANK[unit.verdict.level]:
        word = WORDS[level(unit)]
        return f"{SIGNS[word]} {word}"
    return unit.verdict.badge


def wrong(unit: UnitView) -> Wrong:
    """What is wrong with a unit: with its acquisition and its line first, then what the verdict on its filter says."""
    answer, now, verdict = unit.answer, unit.now, unit.verdict
    if answer is None or answer.missing == CONNECTING:
        return Wrong("connecting to its instrument", "wait")
    if now is None and answer.missing == ENDED:
        return _ended(answer)
    if now is None or verdict is None:
        return Wrong("its process lives, but does not answer", "bad")
    if now["error"] or now["state"] != "running":
        return Wrong(now["error"] or now["state"], "bad" if now["error"] else "wait")
    silent = messages.silence(now)
    if silent is not None:
        return Wrong(silent, "bad", EXCHANGE)
    todo = verdict.todo.replace(TRACE_KEY, TRACE)
    if verdict.level == "bad":
        return Wrong(verdict.reason, "bad", todo)
    also = [*now["findings"][-1:]]
    if now["lost_packets"] or now["bad_checksums"]:
        also.append(f"lost {messages.lost(now)}, bad checksums {now['bad_checksums']}: {now['advice']['losses']}")
    if verdict.word == "WAIT":
        return Wrong("; ".join([*also, verdict.reason.replace(" 5 Table,", "")]), "wait" if also else "none")
    if verdict.level == "wait":
        return Wrong("; ".join([verdict.reason, *also]), "wait", todo)
    return Wrong("; ".join(also), "wait" if also else verdict.level)


def _ended(answer: Answer) -> Wrong:
    """Of a unit that does not run: why, and what its filter said at last. To be asked to end is no fault."""
    report = answer.report
    if report is None or report["error"] is not None:
        return Wrong(answer.why, "bad", AGAIN)
    found = sources.of_document(report["result"]) if report["result"] is not None else None
    last = "" if found is None else f"; at its end {found.word}: {found.reason}"
    return Wrong(answer.why + last, "bad" if found is not None and found.level == "bad" else "none", AGAIN)


def worst_first(units: Sequence[UnitView]) -> list[UnitView]:
    """Units by how bad they are; those alike as they were."""
    return sorted(units, key=lambda unit: -RANK[level(unit)])


def summary(units: Sequence[UnitView], room: int) -> str:
    """How many units there are, and at which level; signs without words where there is little room."""
    counts = Counter(level(unit) for unit in units)
    told = [(counts[one], WORDS[one]) for one in ("bad", "wait", "good") if counts[one]]
    count = formatting.plural(len(units), "unit")
    long = "  ".join([count, *(f"{of} {SIGNS[word]} {word}" for of, word in told)])
    return long if len(long) <= room else "  ".join([count, *(f"{of} {SIGNS[word]}" for of, word in told)])


def detail(unit: UnitView | None) -> tuple[str, str, str]:
    """Of the unit under the cursor: who it is and what it writes; what is wrong; what to do."""
    if unit is None:
        return "", "", ""
    now = unit.now
    who = label(unit)
    if now is not None:
        recording = now["recording"]
        file = recording["path"].rpartition("/")[2] if recording else "not recording"
        port = formatting.port_name(now["port"], _PLACE)
        who += f": {now['instrument']} #{now['serial_number']} on {port}, {file}"
    elif unit.unit is not None:
        who += f": {unit.unit.port or f'serial number {unit.unit.serial}'}"
    found = wrong(unit)
    return who, found.said or (unit.verdict.reason if unit.verdict is not None else ""), found.todo


# -- the table, which is one for all units ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Step:
    """Where the table is in the profile that units share."""

    can: Mapping[str, Sequence[str]]  # names of units by what can be asked of their guides: begin, next, cancel, resume
    said: str  # what the operator is to do
    then: str  # and what happens then


def step(units: Sequence[UnitView]) -> Step:
    """The step that is due: the one that most of the units wait for, when none of them holds one still."""
    can: dict[str, list[str]] = {}
    waits: dict[int, list[UnitView]] = {}
    holds: list[tuple[UnitView, GuideSnapshot]] = []
    profile: ProfileDescription | None = None
    for unit in units:
        now, found = unit.now, unit.profile
        if now is None or found is None or not guided(found, now):
            continue
        profile = profile or found
        guide = now["guide"]
        state = guide["state"] if guide is not None else ""
        if state == "cancelled" and now["recording"] is not None:
            can.setdefault("resume", []).append(unit.name)
        elif guide is None or (state in ("done", "cancelled") and now["recording"] is None):
            can.setdefault("begin", []).append(unit.name)
        if guide is not None and state == "go":
            waits.setdefault(guide["segment"], []).append(unit)
        elif guide is not None and state == "hold":
            holds.append((unit, guide))
        if state in ("go", "hold"):
            can.setdefault("cancel", []).append(unit.name)
    if profile is None:
        return Step(can, _NOT_GUIDED, ALL)
    segments = profile["segments"]
    if holds:
        _, guide = max(holds, key=lambda one: one[1]["left_s"] or 0.0)
        of = f"Segment {guide['segment'] + 1} of {len(segments)}: hold {_where(profile, guide['segment'])}"
        return Step(can, of, f"{guide['left_s'] or 0.0:.0f} s left for {_units(holds)}. Leave the table alone.")
    if waits:
        due = max(waits, key=lambda segment: (len(waits[segment]), -segment))
        here, others = waits[due], sum(len(of) for of in waits.values()) - len(waits[due])
        can["next"] = [unit.name for unit in here]
        then = f"t: the table is there, for {_units(here)}."
        wait = "waits" if others == 1 else "wait"
        later = f" {_units(range(others))} {wait} for another segment." if others else ""
        return Step(can, f"Segment {due + 1} of {len(segments)}: {segments[due]['text']}", then + later)
    return Step(can, *_idle(profile, can))


def _idle(profile: ProfileDescription, can: Mapping[str, Sequence[str]]) -> tuple[str, str]:
    name, count = formatting.profile_name(profile["name"]), len(profile["segments"])
    if "resume" in can:
        return f"{name} is cancelled.", f"The recordings go on: b resumes {_units(can['resume'])}."
    if "begin" in can:
        seconds = sum(segment["seconds"] for segment in profile["segments"])
        length = f"{formatting.plural(count, 'segment')}, {formatting.minutes(seconds)} without the moves"
        return f"Table profile {name}: {length}.", f"b begins, and records: {_units(can['begin'])}."
    return f"All {count} segments are done.", "r finishes the files."


def _where(profile: ProfileDescription, segment: int) -> str:
    return profile["segments"][segment]["text"].removeprefix("go to ")


def _units(of: Collection[object] | range) -> str:
    return formatting.plural(len(of), "unit")
