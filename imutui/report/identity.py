"""Whose readings a result is of: unit, people, place, dates, temperatures, files. What is unknown is "not stated"."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING

from filters.tracing.trace_document import IdentityEntry, RunEntry
from imutui.report.blocks import Column, Facts, Section, Table
from imutui.report.numbers import ORIGIN, duration

if TYPE_CHECKING:
    from imutui.jobs.documents import RunDocument

NOT_STATED = "not stated"
ORIGINS = {
    "measured": "These readings are those of a real unit.",
    "simulated": (
        "These readings come from a virtual unit, or effects were added to them. They say nothing of a real unit."
    ),
    "unknown": "Whether these readings were measured or simulated is unknown.",
}
_UNKNOWN = ("", "unknown", "none")
_LABELS: tuple[tuple[str, str], ...] = (
    ("Unit", "instrument"),
    ("Serial number", "serial_number"),
    ("Firmware", "firmware"),
    ("Operator", "operator"),
    ("Turn table", "table"),
    ("Place", "place"),
)


@dataclass(frozen=True, slots=True)
class LogFacts:
    """What is known of a log that a result is of; None where it is not."""

    log: str
    role: str
    kind: str
    source: str
    seconds: float | None
    rate_hz: float | None
    start_utc: str | None
    temperature_degc: Sequence[float] | None
    sha256: str | None
    identity: IdentityEntry


def of_run(run: RunEntry) -> LogFacts:
    """Facts of a log that was traced."""
    role = "held out" if run["heldout"] else "fitted"
    return LogFacts(
        run["log"], role, run["kind"], run["source"], run["seconds"], run["rate_hz"],
        run["start_utc"], run["temperature_degc"], run["log_sha256"], run["identity"],
    )  # fmt: skip


def of_result(d: "RunDocument") -> LogFacts:
    """Facts of a log that was filtered, or only recorded."""
    seconds, rate_hz = (d["duration_s"], d["rate_hz"]) if "final" in d else (None, None)
    return LogFacts(
        d["log"], "filtered", d["kind"], "", seconds, rate_hz, d["start_utc"],
        d["temperature_degc"], d["log_sha256"], d["identity"],
    )  # fmt: skip


def kind_of(logs: Sequence[LogFacts]) -> str:
    """Who made the readings: "simulated" if any of them are, "measured" only if all are."""
    kinds = {log.kind for log in logs}
    if "simulated" in kinds:
        return "simulated"
    return "measured" if kinds == {"measured"} else "unknown"


def section(logs: Sequence[LogFacts], library: str) -> Section:
    """The block that stands first."""
    rows = [(label, _stated(_all(logs, key))) for label, key in _LABELS]
    rows += [
        ("Recorded", _dates(logs)),
        ("Temperature in the case", _temperatures(logs)),
        ("Readings", _readings(logs)),
        ("Recorded with", _stated(_all(logs, "software"))),
        ("Computed with", library),
    ]
    notes = [f"{_name(log)}: {note}" for log in logs if (note := _text(log, "note"))]
    rows.append(("Notes", "; ".join(notes) or NOT_STATED))
    stated = [row for row in rows if row[1] != NOT_STATED]
    if silent := [label.lower() for label, value in rows if value == NOT_STATED]:
        stated.append(("Not stated", ", ".join(silent)))
    return Section("Unit and files", (Facts(tuple(stated)), _files(logs)))


def _files(logs: Sequence[LogFacts]) -> Table:
    columns = (
        Column("File", "file"), Column("Use"), Column("Begins (UTC)"), Column("Length"), Column("Rate", "number"),
        Column("Temperature", "number"), Column("SHA-256", "hash"),
    )  # fmt: skip
    rows = tuple(
        (
            _name(log),
            log.role,
            minute(log.start_utc),
            NOT_STATED if log.seconds is None else duration(log.seconds),
            NOT_STATED if log.rate_hz is None else f"{log.rate_hz:.4g} Hz",
            _range(log.temperature_degc),
            log.sha256 or NOT_STATED,
        )
        for log in logs
    )
    return Table(columns, rows)


def _name(log: LogFacts) -> str:
    return PurePath(log.log).name or NOT_STATED


def _text(log: LogFacts, key: str) -> str:
    said: Mapping[str, object] = log.identity
    value = str(said[key]).strip()
    return "" if value.lower() in _UNKNOWN else value


def _all(logs: Iterable[LogFacts], key: str) -> list[str]:
    """What the logs say of one thing, each answer once; those that say nothing count where others do."""
    return list(dict.fromkeys(_text(log, key) for log in logs))


def _stated(values: list[str]) -> str:
    said = [value for value in values if value]
    if not said:
        return NOT_STATED
    text = ", ".join(said)
    text += f" ({NOT_STATED} in some of the files)" if len(said) < len(values) else ""
    return text if len(said) == 1 else f"{text} (the files differ)"


def _readings(logs: Sequence[LogFacts]) -> str:
    sources: dict[str, dict[str, None]] = {}
    for log in logs:
        sources.setdefault(ORIGIN.get(log.kind, ORIGIN["unknown"]), {})[log.source] = None
    named = {word: ", ".join(source for source in own if source) for word, own in sources.items()}
    return "; ".join(f"{word} ({own})" if own else word for word, own in named.items())


def _dates(logs: Sequence[LogFacts]) -> str:
    starts = sorted(minute(log.start_utc) for log in logs if log.start_utc)
    text = " to ".join(dict.fromkeys([*starts[:1], *starts[-1:]]))
    return _of_some(f"{text} UTC", len(starts), len(logs))


def minute(start: str | None) -> str:
    """A time in UTC, to the minute."""
    return NOT_STATED if not start else start[:16].replace("T", " ")


def _temperatures(logs: Sequence[LogFacts]) -> str:
    known = [log.temperature_degc for log in logs if log.temperature_degc]
    text = _range([min(t[0] for t in known), max(t[-1] for t in known)]) if known else ""
    return _of_some(text, len(known), len(logs))


def _of_some(text: str, known: int, of: int) -> str:
    """What some of the files say, or all."""
    return NOT_STATED if not known else text if known == of else f"{text} ({NOT_STATED} of some of the files)"


def _range(values: Sequence[float] | None) -> str:
    return NOT_STATED if not values else f"{values[0]:.1f} to {values[-1]:.1f} °C"
