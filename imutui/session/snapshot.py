"""The records that viewers get of an acquisition: its snapshot, and answers to other requests.

They travel over the socket as JSON objects; `observe` fills the snapshot. Times are seconds, sizes bytes, biases and
channels in the instrument's own axes and sign. None stands for a value that is unknown or absent.
"""

from typing import Literal, TypedDict

from filters.health.finding import HealthEntry
from imutui.estimates import FilterSnapshot

NO_SERIES = 2**62  # number of a packet that never comes: a snapshot from it on is one without a series

# "ended" is a viewer's word for an acquisition that does not answer any more
SessionState = Literal["connecting", "running", "stopping", "stopped", "failed", "ended"]
GuideState = Literal["go", "hold", "done", "cancelled"]


class EventLine(TypedDict):
    """An event of the acquisition."""

    utc: str
    name: str
    text: str


class MarkLine(TypedDict):
    """A mark of the operator; `t` since the recording began, None if it belongs to an earlier one."""

    t: float | None
    utc: str
    text: str


class LineAdvice(TypedDict):
    """Likely places of a fault, in a few words, when packets are lost or damaged, and when none come."""

    losses: str
    silence: str


class RecordingSnapshot(TypedDict):
    """The file that is being written; `part` is its number among the recording's, from 1.

    `to_full_s` is the time until the disk has only the room that is kept free.
    """

    path: str
    bytes: int
    seconds: float
    samples: int
    flush_age_s: float | None
    marks: int
    bytes_per_s: float | None
    to_full_s: float | None
    part: int


class ReconnectingSnapshot(TypedDict):
    """A unit that has been away for `seconds`; `waits_for` names the missing port or unit, in words."""

    seconds: float
    waits_for: str


class ReferenceSnapshot(TypedDict):
    """The filter's reference; `profile` is true if it is a table profile, `file` the name of its file."""

    name: str
    file: str
    profile: bool


class GuideSnapshot(TypedDict):
    """The operator's place in a table profile: `segment` (from 0) of `count`, which goes on for `left_s`.

    `begun` is the time of each segment's begin since the recording began; None of one that has not begun.
    """

    state: GuideState
    segment: int
    count: int
    left_s: float | None
    begun: list[float | None]


class ControllerSnapshot(TypedDict):
    """A table under command, as its controller reported `age_s` ago; angles and rates of outer, middle, inner.

    `moves`: it turns under command, or is about to; `error`: why it is no longer commanded, "" while it is.
    `investigates`: `imutui investigate` gives its motions, and records and ends the acquisition.
    """

    url: str
    identity: str
    axes: list[str]
    angles_deg: list[float] | None
    rates_dps: list[float] | None
    mode: str
    fault: str
    age_s: float | None
    moves: bool
    error: str
    investigates: bool


class ChannelSnapshot(TypedDict):
    """Newest reading of a channel in counts and `unit`, and statistics over the last `statistics_s` seconds."""

    name: str
    counts: int
    value: float | None
    unit: str
    mean: float
    sd: float | None
    min: float
    max: float


class SeriesSnapshot(TypedDict):
    """Packets since the number asked for: `t` since start, `values` a row of seven each; `next` is asked for next."""

    next: int
    t: list[float]
    values: list[list[float]]


class Snapshot(TypedDict):
    """Everything a screen shows of an acquisition.

    `owner` is its user and computer. `findings` are those of its end so far. `ended_by` is the program or event that
    asked for the end, empty before. Recording leaves `min_free_bytes` of a disk. `status` is the unit's status word in
    words, "" if no bit is set or it has none.
    """

    name: str
    batch: str
    pid: int
    owner: str
    state: SessionState
    error: str | None
    findings: list[str]
    ended_by: str
    instrument: str
    serial_number: str
    firmware: str
    kind: str
    site_stated: bool
    port: str
    baud: int
    rate_hz: float
    sampling: str
    measured_hz: float | None
    packet_hz: float | None
    packets: int
    lost_packets: int
    lost_packets_max: int
    bad_checksums: int
    discarded_bytes: int
    doubled_packets: int
    status: str
    advice: LineAdvice
    silent_s: float | None
    zeroing: bool
    reconnecting: ReconnectingSnapshot | None
    since_start_s: float
    utc: str
    recording: RecordingSnapshot | None
    logs: str
    operator: str
    place: str
    table: str
    note: str
    next_note: str
    rotate_minutes: float
    rotate_mb: float
    free_bytes: int | None
    min_free_bytes: int
    marks: list[MarkLine]
    reference: ReferenceSnapshot
    effects: list[str]
    ends_unwatched_s: float | None
    guide: GuideSnapshot | None
    controller: ControllerSnapshot | None
    channels: list[ChannelSnapshot]
    statistics_s: float
    health: list[HealthEntry]
    filter: FilterSnapshot | None
    events: list[EventLine]
    series: SeriesSnapshot


class SegmentDescription(TypedDict):
    """A segment of a table profile: `text` is the instruction, `seconds` count from the operator's word on."""

    kind: str
    text: str
    seconds: float


class ProfileDescription(TypedDict):
    """A table profile, for a viewer: name and text of its file, how it is joined to the log, its segments in order."""

    name: str
    text: str
    about: list[str]  # what its file says at the top: what it is for, what else is to be done
    align: str
    segments: list[SegmentDescription]


class ProbeAnswer(TypedDict):
    """The unit that answers at a port; empty or None if none does. `error` is why it cannot be used, None if it can."""

    port: str
    answers: bool
    instrument: str
    serial_number: str
    firmware: str
    baud: int | None
    error: str | None


class AllanSnapshot(TypedDict):
    """Allan deviation of a channel at averaging times `tau`, s, in the channel's unit.

    `dof` are the degrees of freedom of its square: the relative standard deviation of the deviation is 1/√(2 dof).
    """

    tau: list[float]
    deviation: list[float]
    dof: list[float]


class SpectrumSnapshot(TypedDict):
    """One-sided amplitude spectral density of a channel, its unit/√Hz, in bands of frequency.

    `density` is the mean of a band (of power), `peak` its greatest value, which is at `peak_hz`. `averages` are the
    independent estimates in the mean: the relative standard deviation of `density` is 1/(2 √averages). `segments` were
    averaged; lines `resolution_hz` apart are resolved.
    """

    hz: list[float]
    density: list[float]
    peak: list[float]
    peak_hz: list[float]
    averages: list[float]
    segments: int
    resolution_hz: float


class HistogramSnapshot(TypedDict):
    """Histogram of a channel, in bins of `width_counts` counts, which is `width` in its unit, from `edge` on.

    `below` and `above` are packets outside the bins; `mean` and `sd` are of all packets.
    """

    counts: list[int]
    edge: float
    width: float
    width_counts: int
    below: int
    above: int
    mean: float
    sd: float


class StatisticsSnapshot(TypedDict):
    """Statistics of a channel over all packets of the last `seconds`; None where there are too few of them.

    `stretches` are those parts without a gap, in which packets are `period_s` apart. `white` is the white noise of the
    data sheet, unit·√s, up to `bandwidth_hz`; None of a channel that it does not state. `white_of` names that data
    sheet.
    """

    channel: int
    unit: str
    seconds: float
    packets: int
    stretches: int
    period_s: float | None
    white: float | None
    white_of: str
    bandwidth_hz: float | None
    allan: AllanSnapshot | None
    spectrum: SpectrumSnapshot | None
    histogram: HistogramSnapshot | None


def not_said(serial_number: str, version: str) -> str | None:
    """Return which of these a unit did not report, in words; None if it reported both."""
    missing = [name for name, said in (("serial number", serial_number), ("version", version)) if not said]
    if not missing:
        return None
    said = f"the unit did not say its {' and its '.join(missing)}: the log has none."
    return said if serial_number else f"{said} Were another unit in its place, nobody would know."


def unit_in_words(instrument: str, serial_number: str) -> str:
    """Return model and serial number, as far as they are known."""
    return f"{instrument} #{serial_number}" if serial_number else f"{instrument} without a serial number"
