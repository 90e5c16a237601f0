"""What is in a log: in a millisecond for a list of them (`brief`), or all of it (`info`)."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_type_hints

from filters.errors import InputError
from filters.imu import AxisMap
from imutui.document_shape import VERSION
from imutui.instrument.registry import of_model
from imutui.jobs.documents import EventField, InfoDocument, QualityFields, SessionFields
from imutui.jobs.quantities import utc_text
from imutui.logbook import added_notes, sample_check, schemas, summary
from imutui.logbook.reading import AS_STATED, Reading
from imutui.logbook.session_info import MEASURED, SIMULATED, UNKNOWN
from imutui.plain_text import NOTE_LIMIT, in_line, one_line

if TYPE_CHECKING:
    from imutui.logbook.audit import Audit
    from imutui.logbook.scan import Scan

SUFFIX = ".mcap"


@dataclass(frozen=True, slots=True)
class Brief:
    """A log as a list shows it; None and "" where the file does not say."""

    path: Path
    bytes: int  # its size
    modified: float  # when it was last written to, Unix time, s
    state: str  # "finished", "unfinished", "damaged", "being written" or "not a log"
    why: str = ""  # what is behind a state other than finished, or that a finished file has no samples
    started: float | None = None  # when the recording began, Unix time, s
    seconds: float | None = None  # time from its first to its last sample (to its last message, if nobody counted)
    samples: int | None = None  # output samples
    rate_hz: float | None = None  # rate that was asked for; of another program's file the measured one
    measured_hz: float | None = None  # samples over time
    kind: str = UNKNOWN  # "measured", "simulated" or "unknown"
    # whether samples and seconds come from the file's first and last chunk, since there is no summary
    by_ends: bool = False
    # instrument, serial_number, operator, place, table, note, reference, filter: from the session
    instrument: str = ""
    serial_number: str = ""
    operator: str = ""
    place: str = ""
    table: str = ""
    note: str = ""
    reference: str = ""
    filter: str = ""
    converged: bool | None = None  # of the filter that ran when it was recorded
    verdict: str = ""  # on the run that was recorded: GREEN, AMBER, RED or OFF; "" where nothing is known of one
    lost_packets: int | None = None  # as counted when it was recorded
    packets: int | None = None  # as received from the unit; None without a summary
    # added_note, added_operator: what was said of them later, in a file beside the log; None if nothing
    added_note: str | None = None
    added_operator: str | None = None

    @property
    def latest_note(self) -> str:
        """The note as it was said last, in the log or beside it."""
        return self.note if self.added_note is None else self.added_note

    @property
    def latest_operator(self) -> str:
        """The operator as said last, in the log or beside it."""
        return self.operator if self.added_operator is None else self.added_operator

    @property
    def began(self) -> float:
        """When the recording began, or when the file was last written to if it does not say; Unix time, s."""
        return self.modified if self.started is None else self.started

    @property
    def start_utc(self) -> str | None:
        """When the recording began, in words; None if the file does not say."""
        return None if self.started is None else utc_text(round(self.started * 1e9))

    @property
    def name(self) -> str:
        """Name of the file, without its folder, as it can be shown."""
        return in_line(self.path.name)


_TEXTS = ("instrument", "serial_number", "operator", "place", "table", "note", "reference", "filter")


def brief(path: Path) -> Brief:
    """A log as a list shows it, from its first and last few kilobytes.

    `path`: any file: one that cannot be opened, or is no log, is told as such.
    """
    try:
        found = summary.read(path)
    except OSError as error:
        return Brief(path, 0, 0.0, summary.NO_LOG, f"it cannot be opened: {error.strerror or error}")
    span, samples, session = found.seconds, found.samples, found.session
    measured = (samples - 1) / span if samples and samples > 1 and span else None
    added_note, added_operator = added_notes.latest(added_notes.read_or_none(path))
    converged, lost = found.result.get("converged"), found.result.get("lost_packets")
    verdict = found.result.get("verdict", "RED" if found.result.get("alarms") else "")
    return Brief(
        path,
        found.bytes,
        found.modified,
        found.state,
        found.why,
        None if found.started_ns is None else found.started_ns / 1e9,
        span,
        samples,
        _number(session.get("rate_hz")) if session else measured,
        measured,
        _kind(session),
        found.by_ends,
        **{name: one_line(session.get(name, ""), NOTE_LIMIT) for name in _TEXTS},
        converged=converged if isinstance(converged, bool) else None,
        verdict=str(verdict),
        lost_packets=lost if isinstance(lost, int) else None,
        packets=found.counts.get(schemas.RAW),
        added_note=added_note,
        added_operator=added_operator,
    )


def newest_first(briefs: Iterable[Brief]) -> list[Brief]:
    """Logs by when they were begun, the last one first; a file that does not say, by when it was written to."""
    return sorted(briefs, key=lambda b: (-b.began, -b.modified, b.path.name))


def recordings(folder: Path) -> list[Brief]:
    """Logs of a folder (not of folders in it), the newest first; empty if there is no such folder."""
    try:
        return folder_logs(folder)
    except OSError:
        return []


def folder_logs(folder: Path) -> list[Brief]:
    """As `recordings`; raises OSError where the folder cannot be read."""
    paths = [path for path in folder.iterdir() if path.suffix == SUFFIX and path.is_file()]
    return newest_first(brief(path) for path in paths)


def row(b: Brief) -> dict[str, object]:
    """A log of a folder as JSON has it; names and units as in `info`."""
    return {
        "log": str(b.path.resolve()),
        "bytes": b.bytes,
        "state": b.state,
        "why": b.why,
        "finished": b.state == summary.FINISHED,
        "start_utc": b.start_utc,
        "duration_s": b.seconds,
        "rate_asked_hz": b.rate_hz,
        "rate_measured_hz": b.measured_hz,
        **{name: getattr(b, name) for name in ("samples", "packets", "lost_packets", "kind", *_TEXTS[:6])},
        **{name: getattr(b, name) for name in ("added_note", "added_operator", "converged", "verdict")},
    }


def info(
    path: Path,
    progress: Callable[[float, str], None] = lambda share, text: None,
    reading: Reading = AS_STATED,
) -> InfoDocument:
    """All that is in a log, read from beginning to end; damaged parts are passed over.

    `progress`: told the share done, 0 to 1, and what is being done.
    Returns JSON-ready; None or "" where the log does not say.
    Raises UnreadableLogError if there is no such file, or it is no MCAP file.
    """
    # a list of logs does without
    from imutui.logbook.audit import audit
    from imutui.logbook.scan import Scan

    found = Scan(path)
    content = audit(found, reading, lambda share: progress(share, f"reading {path.name}"))
    ends, degc = summary.read(path), content.temperatures
    progress(1.0, "done")
    told = {
        "version": VERSION,
        "log": str(path.resolve()),
        "bytes": found.size,
        "state": ends.state,
        "why": ends.why,
        "finished": found.end.finished,
        **_session(content),
        "assumed": list(content.assumed),
        **_extent(content, found),
        "temperature_degc": degc and {"first": degc.first, "last": degc.last, "min": degc.least, "max": degc.greatest},
        "effects": _effects(content),
        "marks": _happened(content, mark=True),
        "events": _happened(content, mark=False),
        "topics": {
            topic: {"type": typename, "messages": run.count if (run := content.messages.get(topic)) else 0}
            for topic, typename in content.types.items()
        },
        "attachments": {name: len(data) for name, data in content.attachments.items()},
        "metadata": list(content.metadata),
        "recovered": content.metadata.get("imutui.recovered"),
        "added": [asdict(note) for note in added_notes.read_or_none(path)],
        "quality": _quality(content),
        "status_words": [
            {"word": word, "means": means, "packets": count} for word, means, count in status_words(content)
        ],
    }
    return cast("InfoDocument", told)


def _session(content: "Audit") -> dict[str, Any]:
    session = content.session
    told = {
        name: _number(session.get(name)) if shape is not str else session.get(name, "")
        for name, shape in get_type_hints(SessionFields).items()
    }
    # zero says that a range is not stated
    told |= {name: told[name] or None for name in ("rate_range_dps", "accel_range_g")}
    return told | {"kind": _kind(session), "site_stated": session.get("site_stated") == "True"}


def _kind(session: Mapping[str, str]) -> str:
    """Nothing passes for measured that does not say so."""
    kind = session.get("kind", UNKNOWN)
    return kind if kind in (MEASURED, SIMULATED) else UNKNOWN


def _extent(content: "Audit", found: "Scan") -> dict[str, Any]:
    count = content.samples
    first = content.first_ns if count else found.first_ns
    span = float(content.last_ns - content.first_ns) / 1e9 if count else None
    return {
        "start_utc": None if first is None else utc_text(first),
        "duration_s": span,
        "rate_asked_hz": _number(content.session.get("rate_hz")),
        "rate_measured_hz": (count - 1) / span if span else None,
        "samples": count,
        "samples_without_reading": content.unread_samples,
        "packets": content.packets,
        "unread_channels": list(lacking_channels(content)),
    }


def lacking_channels(content: "Audit") -> tuple[str, ...]:
    """Channels that a log's samples lack, NaN throughout, by their names in the instrument's axes."""
    if not content.samples:
        return ()
    axes = AxisMap(accel_sign=1) if content.info is None else content.info.axes()
    return sample_check.names(sample_check.in_instrument_axes(content.lacks, axes))


def _effects(content: "Audit") -> list[str]:
    from imutui.jobs.log_files import effect_names
    from imutui.logbook import effects_file

    attached = content.attachments.get(effects_file.ATTACHMENT)
    if not attached:
        return []
    try:
        return list(effect_names(attached))
    except InputError as error:
        return [f"a file that cannot be used: {error}"]


def _happened(content: "Audit", *, mark: bool) -> list[EventField]:
    first = content.first_ns if content.samples else None
    return [
        {
            "t": None if first is None else (event.stamp_ns - first) / 1e9,
            "utc": utc_text(event.stamp_ns),
            "text": event.text,
        }
        for event in content.events
        if (event.name == "mark") == mark
    ]


def status_words(content: "Audit") -> Iterator[tuple[int, str, int]]:
    """Each status word of a log's packets, what it means, and in how many; none of units whose packets have none."""
    instrument = None if content.info is None else of_model(content.info.instrument)
    if instrument is not None and instrument.status_names is not None:
        for word, count in sorted(content.statuses.items()):
            yield word, instrument.status_in_words(word), count


def _quality(content: "Audit") -> QualityFields:
    """Figures of the quality summary, and the recorder's last counts."""
    counts = {key: _number(content.diagnostics.get(key)) for key in _COUNTS if key in content.diagnostics}
    result = content.result
    kept = {key: result[key] for key in _FIGURES if key in result}
    told = {key: None if n is None else int(n) for key, n in counts.items()}
    # the summary is as its recorder wrote it
    return cast("QualityFields", told | kept)


_COUNTS = ("lost_packets", "bad_checksums", "resynchronised_bytes", "doubled_packets")
_FIGURES = ("verdict", "converged", "converged_s", "final", "sd", "nis", "gaps", "alarms")


def _number(text: str | None) -> float | None:
    try:
        value = float(text) if text else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None
