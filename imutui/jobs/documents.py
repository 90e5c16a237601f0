"""Shapes of the documents that `info`, `check`, `recover` and `profile` print as JSON; records only.

That of a replay is `imutui.logbook.results.ResultDocument`, that of a trace `filters.tracing.trace_document`'s.
"""

from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    from filters.tracing.trace_document import CurveEntry as CurveEntry
    from filters.tracing.trace_document import FindingEntry as FindingEntry
    from filters.tracing.trace_document import TraceDocument as TraceDocument
    from imutui.logbook.results import NisFields, SdFields, StateFields
    from imutui.logbook.results import ResultDocument as ResultDocument


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


class ExtentFields(TypedDict):
    """When a log begins (UTC), how long it lasts (s), rates (Hz), and how much it holds."""

    start_utc: str | None
    duration_s: float | None
    rate_asked_hz: float | None
    rate_measured_hz: float | None
    samples: int
    samples_without_reading: int
    packets: int
    unread_channels: list[str]


class TemperatureFields(TypedDict):
    """Temperature in a log, degC."""

    first: float
    last: float
    min: float
    max: float


class EventField(TypedDict):
    """A mark or an event: s since the first sample (None without samples), UTC, text."""

    t: float | None
    utc: str
    text: str


class EventFields(TypedDict):
    """What happened while a log was recorded."""

    marks: list[EventField]
    events: list[EventField]


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


class AddedField(TypedDict):
    """What was said of a log after it was recorded, see `logbook.added_notes`; None where it says nothing."""

    utc: str
    by: str
    note: str | None
    operator: str | None


class LogRow(TypedDict):
    """A log of a folder, from its first and last few kilobytes; None or "" where it does not say."""

    log: str
    bytes: int
    state: str
    why: str
    finished: bool
    start_utc: str | None
    duration_s: float | None
    rate_asked_hz: float | None
    rate_measured_hz: float | None
    samples: int | None
    packets: int | None
    lost_packets: int | None
    kind: str
    instrument: str
    serial_number: str
    operator: str
    place: str
    table: str
    note: str
    added_note: str | None
    added_operator: str | None
    converged: bool | None
    verdict: str


class StatusWordField(TypedDict):
    """A status word of a unit's packets, what its bits mean, and how many packets had it."""

    word: int
    means: str
    packets: int


class InfoDocument(SessionFields, ExtentFields, EventFields):
    """All that is in a log; `imutui info --json`."""

    version: int
    log: str
    bytes: int
    state: str
    why: str
    finished: bool
    temperature_degc: TemperatureFields | None
    effects: list[str]
    topics: dict[str, TopicField]
    attachments: dict[str, int]
    metadata: list[str]
    recovered: dict[str, str] | None
    added: list[AddedField]
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
    log: str
    state: str
    fine: bool
    findings: list[FindingField]
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


class LostFields(TypedDict):
    """How much is missing; None where nothing tells."""

    messages: int | None
    samples: int | None


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
    lost: LostFields
    complete: bool
    readable: bool
    sentences: list[str]
    log_sha256: str
    output_sha256: str


class SegmentField(TypedDict):
    """A segment of a table profile for an operator: its number, what to do, how long (s), what becomes testable."""

    number: int
    text: str
    seconds: float
    makes_testable: list[str]


class GuidedListDocument(TypedDict):
    """A table profile as a guided list; `imutui profile NAME --json`."""

    version: int
    profile: str
    align: str
    duration_s: float
    segments: list[SegmentField]


class SegmentOfProfile(TypedDict):
    """What must be known of a profile's segment to make it again, as an acquisition tells it."""

    kind: str
    seconds: float
    angles_deg: list[float] | None
    axis: str | None
    rate_dps: float | None
    amplitude_deg: float | None
    hz: float | None
