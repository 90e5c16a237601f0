"""The row that a campaign makes of a log, and the document of its rows, `results.json`.

A row holds numbers and words, never arrays of samples. Two runs over the same log with the same settings, wherever they
run, give rows that are equal in all fields but `TIMINGS`.
"""

from collections.abc import Sequence
from typing import Annotated, TypedDict

from filters.health.finding import HealthEntry
from imutui.estimates import ConvergedFields, MeanNis, MeasuredNoise, SdFields, StateFields
from imutui.logbook.reading import ReadingFields
from imutui.logbook.results import SpreadFields

TIMINGS = ("wall_s", "filter_s", "read_s", "log_mtime_ns", "versions")
"""Fields of a row that depend on where and when it was made, or where the log lay."""


class TemperatureField(TypedDict):
    """Temperature of a log's samples, degC."""

    mean: float
    min: float
    max: float


class GapsField(TypedDict):
    """How many gaps the samples have, and how long they are together, s."""

    count: int
    seconds: float


class VerdictField(TypedDict):
    """The verdict on the filter: GREEN, AMBER or RED, whether a command that ends with it exits with 0, and why."""

    word: str
    passes: bool
    reason: str


class ParameterField(TypedDict):
    """A parameter of an effect; `sd` is None where it fixes the effect's shape and was not fitted."""

    name: str
    value: float
    sd: float | None
    unit: str


class FindingField(TypedDict):
    """An effect that a trace found; the names are those of `imutui trace --json`."""

    effect: str
    label: str
    channels: list[str]
    params: list[ParameterField]
    confirmed: bool | None


class VersionsField(TypedDict):
    """What a row was computed with: `imutui`, `numpy`, `numba` and `python`."""

    imutui: str
    numpy: str
    numba: str
    python: str


class Row(TypedDict):
    """A log in a campaign. For a log that could not be used, fields that are not known are None or empty."""

    log: str  # path relative to the campaign's root, with slashes
    error: str | None  # why the log has no result, in words; None if it has one
    retry: bool
    """Whether the next run tries again though the log has not changed: the error is the machine's."""
    log_sha256: str | None
    log_bytes: int | None
    log_mtime_ns: int | None
    """When the log was last changed. With its size it shows, without a read, that the log is still the same."""
    config_sha256: str | None  # hash of all that decides the estimates of this log apart from its samples
    settings_sha256: str  # hash of what the campaign was asked for: see `results.json`'s `settings`
    kind: str
    """"measured", "simulated" or "unknown"."""
    instrument: str
    serial_number: str
    operator: str
    start_utc: str | None  # ISO text; None where it is not known, as for an import
    power_on: str | None  # id of the power-on that the log is a part of
    duration_s: float | None
    samples: int | None
    rate_hz: float | None
    temperature_degc: TemperatureField | None
    finished: bool | None
    damage: str | None  # what is wrong with the file, if anything; what could be read of it is used
    filter: str | None
    reference: str | None
    accel_sign: int | None
    mount: str | None
    unobservable: list[str]
    final: StateFields | None
    sd: SdFields | None
    site_sd_mg: Annotated[list[float], 3] | None
    """Part of the accelerometers' `sd`, in quadrature, that comes from an unstated site."""
    spread: SpreadFields | None
    converged: bool | None
    converged_s: ConvergedFields | None
    nis: MeanNis | None
    noise: MeasuredNoise | None
    gaps: GapsField | None
    lost_packets: int | None
    bad_checksums: int | None
    alarms: list[str]
    health: list[HealthEntry]
    verdict: VerdictField | None
    # batch, unit: which batch its unit was recorded in, and the unit's name there; None for none
    batch: str | None
    unit: str | None
    findings: list[FindingField] | None  # of a trace; None without one, or where the log cannot be traced
    trace_error: str | None  # why the log could not be traced, where that was asked
    wall_s: float
    filter_s: float | None
    read_s: float | None
    versions: VersionsField


def is_fine(row: Row) -> bool:
    """Whether `imutui replay`, and `imutui trace` where it was asked for, would end with 0 on this log."""
    whole = row["finished"] is True and row["damage"] is None and row["trace_error"] is None
    return row["error"] is None and whole and row["verdict"] is not None and row["verdict"]["passes"]


def told_apart(rows: Sequence[Row]) -> list[Row]:
    """Rows in which one serial number is of one unit.

    Units of one batch may state one serial number under several names: their rows get the batch and the name behind
    the number. All other rows stay as they are.
    """
    names: dict[tuple[str, str], set[str]] = {}
    for row in rows:
        if row["batch"] and row["unit"]:
            names.setdefault((row["serial_number"], row["batch"]), set()).add(row["unit"])
    shared = {serial for (serial, _), units in names.items() if serial and len(units) > 1}
    return [
        {**row, "serial_number": f"{row['serial_number']} {row['batch']}:{row['unit']}"}
        if row["serial_number"] in shared and row["batch"] and row["unit"]
        else row
        for row in rows
    ]


class SettingsFields(TypedDict):
    """What a campaign was asked for, the same for all of its logs."""

    reading: ReadingFields
    trace: bool


class HeadFields(TypedDict):
    """Head of `results.json`, and the line that each run begins with in `rows.jsonl`."""

    version: int
    root: str  # folder that `log` of the rows is relative to
    shard: str | None  # which part of the logs, such as "2/4"; None for all of them
    logs: int  # how many logs the last run was asked for
    settings: SettingsFields
    settings_sha256: str
    complete: bool  # whether each of these logs has its row


class ResultsDocument(HeadFields):
    """`results.json`: rows in the order of their `log`."""

    rows: list[Row]
