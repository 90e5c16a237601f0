"""Shapes of the documents that `info`, `check` and `recover` print as JSON; records only.

That of a replay is `imutui.logbook.results.ResultDocument`, that of a trace `filters.tracing.trace_document`'s.
"""

from typing import TYPE_CHECKING, TypedDict

from filters.health.finding import HealthEntry

if TYPE_CHECKING:
    from filters.tracing.trace_document import CurveEntry as CurveEntry
    from filters.tracing.trace_document import FindingEntry as FindingEntry
    from filters.tracing.trace_document import TraceDocument as TraceDocument
    from imutui.estimates import NisFields, SdFields, StateFields
    from imutui.logbook.results import ResultDocument as ResultDocument
    from imutui.logbook.results import RunDocument as RunDocument


class SessionFields(TypedDict):
    """What a log's session says, "" or None where it does not; see `logbook.session_info.SessionInfo`."""

    kind: str
    instrument: str
    serial_number: str
    operator: str
    place: str
    table: str
    note: str
    reference: str
    filter: str
    firmware: str
    configuration: str
    own_mount: str
    sampling: str
    mode: str
    mount: str
    gyro_sign: str
    port: str
    host: str
    measurements: str
    noise: str
    software: str
    source: str
    log_id: str
    power_on: str
    continues: str
    continues_id: str
    continues_sha256: str
    acquisition: str
    boot_id: str
    previous: str
    previous_id: str
    previous_end: str
    restart: str
    accel_sign: float | None
    g_unit: float | None
    rate_range_dps: float | None
    accel_range_g: float | None
    baud: float | None
    latitude_deg: float | None
    longitude_deg: float | None
    height_m: float | None
    gravity_mps2: float | None
    site_stated: bool


class EventField(TypedDict):
    """A mark or an event: s since the first sample (None without samples), UTC, text."""

    t: float | None
    utc: str
    text: str


class TopicField(TypedDict):
    """Type of a topic, and how many messages it has."""

    type: str
    messages: int


class QualityFields(TypedDict, total=False):
    """The recorder's last counts, and figures of the summary that was attached on closing, as far as there are any."""

    lost_packets: int | None
    bad_checksums: int | None
    resynchronised_bytes: int | None
    verdict: str
    converged: bool
    converged_s: dict[str, list[float | None]]
    final: "StateFields"
    sd: "SdFields"
    nis: "NisFields"
    gaps: list[dict[str, float]]
    alarms: list[str]


class StatusWordField(TypedDict):
    """A status word of a unit's packets, what its bits mean, and how many packets had it."""

    word: int
    means: str
    packets: int


class InfoDocument(SessionFields):
    """All that is in a log; `imutui info --json`."""

    start_utc: str | None
    duration_s: float | None
    rate_asked_hz: float | None
    rate_measured_hz: float | None
    samples: int
    samples_without_reading: int
    packets: int
    unread_channels: list[str]
    marks: list[EventField]
    events: list[EventField]
    version: int
    assumed: list[str]  # of another program's log, in words
    log: str
    bytes: int
    state: str
    why: str
    finished: bool
    temperature_degc: dict[str, float] | None  # first, last, min, max
    effects: list[str]
    topics: dict[str, TopicField]
    attachments: dict[str, int]
    metadata: list[str]
    recovered: dict[str, str] | None
    added: list[dict[str, str | None]]  # see `logbook.added_notes`
    quality: QualityFields
    status_words: list[StatusWordField]


class FindingField(TypedDict):
    """Something that is not as it should be: a short name for programs, and what, where, what to do."""

    code: str
    what: str
    where: str
    next: str


class CheckDocument(TypedDict):
    """Whether a log is whole, and whether its parts agree; `imutui check --json`."""

    version: int
    assumed: list[str]  # of another program's log, in words
    log: str
    state: str
    fine: bool
    findings: list[FindingField]
    health: list[HealthEntry]
    notes: list[str]
    bytes: int
    chunks: int
    messages: int
    topics: dict[str, int]
    samples: int
    packets: int
    duration_s: float
    log_sha256: str


class DamageField(TypedDict):
    """Bytes that are no whole record: where in the file, what they were, why, and the times around, s of the log."""

    offset: int
    bytes: int
    what: str
    why: str
    after_s: float | None
    before_s: float | None


class RecoverDocument(TypedDict):
    """What a rebuilt log holds, and what was lost; `imutui recover --json`."""

    version: int
    log: str
    output: str
    state: str
    messages: int
    samples: int
    duration_s: float
    topics: dict[str, int]
    chunks: int
    metadata: list[str]
    attachments: list[str]
    damages: list[DamageField]
    lost: dict[str, int | None]  # messages and samples; None where nothing tells
    complete: bool  # whether nothing is lost, as far as can be told, but an unfinished end
    readable: bool  # whether it can be replayed
    sentences: list[str]  # on what was lost
    log_sha256: str
    output_sha256: str
