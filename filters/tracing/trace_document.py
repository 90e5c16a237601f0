"""The document of a trace, docs/formats.md, as types: what `imutui trace --json` prints and reports are made from.

Needs the standard library only, so that texts can be made of a document where no array library is loaded.

`TraceFindings` is the tracer's part; `TraceDocument` is all of it, with what only the reader of the logs knows and with
the separating experiment's profile as text. Figures that are not finite are None in a finished document.
"""

import math
from typing import Annotated, Literal, TypeAlias, TypedDict

from filters.health.finding import HealthEntry

SEPARATES = 5.0  # a d of this tells two effects apart
PRIOR = 0.1
"""Probability that a slow effect acts on a channel that drifts, before the data are seen; of others the same."""
MOST_ODDS = 1e6  # beyond it nothing is known of how often they are right


def odds_of(score: float) -> float:
    """Odds of a cause by its score, twice the logarithm of how much likelier it makes the data, its choice paid."""
    return odds(PRIOR / (1.0 - PRIOR) * math.exp(min(0.5 * score, 100.0)))


def odds(value: float) -> float:
    """Odds as they are told."""
    return min(value, MOST_ODDS)


Ends: TypeAlias = Annotated[list[float], 2]  # of an interval
HeldOut = Literal["run", "part", "folds"]
"""What nothing was fitted to: a power-on, a later part of one, or folds of 20 s cells."""


class ParameterEntry(TypedDict):
    """A parameter of an effect; `sd` is None where it fixes the effect's shape and was not fitted."""

    name: str
    value: float
    sd: float | None
    unit: str
    plausible: bool


class RivalEntry(TypedDict):
    """Another effect that would do in a finding's place; the difference of scores is rival minus finding.

    `odds` are against drift and noise alone. `weight` is its share of the evidence where several forms were averaged,
    of which the finding is the leading one.
    """

    effect: str
    label: str
    score_difference: float
    odds: float
    weight: float | None


class DriverCurveEntry(TypedDict):
    """Error over driver, relative to the first knot."""

    driver: str
    unit: str
    x: list[float]
    y: list[float]
    sd: list[float]
    y_unit: str


class FindingEntry(TypedDict):
    """An effect that was found; `common` is the number of the common cause, in `common`, that it is part of.

    `odds` are those that it acts, against drift and noise alone.
    """

    effect: str
    label: str
    channels: list[str]
    params: list[ParameterEntry]
    shape: dict[str, float | str | list[float]]
    score: float
    odds: float
    gain: float
    heldout_gain: float | None
    share_of_excess: float | None
    driver_curve: DriverCurveEntry | None
    proposed_form: str | None
    rivals: list[RivalEntry]
    include_as: str
    confirmed: bool | None
    common: int | None


class RefutedEntry(TypedDict):
    """What the runs at hand chose and the held-out run contradicts: its error with it and without all that is left out.

    With it is with everything that was chosen, as the `after` of the held-out run's error.
    """

    effect: str
    label: str
    channels: list[str]
    metric: str
    after_with: float
    after_without: float
    unit: str


class CommonCurve(TypedDict):
    """Course of a common cause in time, s since the start of its run; on the first channel, in `unit`.

    `run` names the run of each point where there are several.
    """

    t_s: list[float]
    y: list[float]
    run: list[str] | None


class CommonSize(TypedDict):
    """How much of a common cause there is in a channel: an event's step, a drift's standard deviation, signed."""

    channel: str
    value: float
    sd: float
    unit: str


class CommonEntry(TypedDict):
    """What moves several channels at once and nothing logged explains: an event, a drift, or a remainder.

    `coherence` is the share of the channels' power in it that is one signal, 0 to 1. Entries of one channel that belong
    to it name it by its number as `common`. `p` is the probability of as much by chance, in channels that have
    nothing in common; `record` what to log beside the readings, so that the cause can be told.
    """

    kind: str
    label: str
    channels: list[str]
    coherence: float
    t_start_s: float
    t_end_s: float
    curve: CommonCurve
    unit: str
    sizes: list[CommonSize]
    p: float
    record: list[str]
    run: str | None


UntestableEntry = TypedDict("UntestableEntry", {"effect": str, "reason": str, "with": str | None, "rho": float | None})
"""An effect that the logs can't show: equals_bias, no_excitation, or collinear_with another."""


class IntegrityEntry(TypedDict):
    """A fault of the data; `size` in rad/s, m/s² or s, as the effect has it."""

    effect: str
    channels: list[str]
    count: int
    where: str
    size: float | None


class LineEntry(TypedDict):
    """A narrow peak in the spectra, with the multiples of its frequency that were found."""

    channels: list[str]
    hz: float
    width_hz: float
    rms: float
    unit: str
    harmonics: list[int]
    rivals: list[RivalEntry]


class NoiseLevelEntry(TypedDict):
    """What the noise of a channel follows; greatest over least standard deviation."""

    channels: list[str]
    driver: str
    ratio: float | None


class WeakEntry(TypedDict):
    """What scored and is not used, and why; `limit` is the smallest size of its first parameter that would be used."""

    effect: str
    label: str
    channels: list[str]
    params: list[ParameterEntry]
    score: float
    guarded_score: float
    limit: float | None
    why: str
    odds: float | None  # of a slow effect beside drift, against drift alone


class DriftEntry(TypedDict):
    """Drift that nothing logged explains; `tau_s` is None of a random walk."""

    channels: list[str]
    kind: str
    tau_s: float | None
    level: float
    unit: str
    common: int | None


class RemainderEntry(TypedDict):
    """Whitened residual that is not white: variance of sums over a scale, over that of white noise."""

    channel: str
    scale_s: float
    ratio: float | None
    p: float
    common: int | None


class ErrorEntry(TypedDict):
    """A figure of error before and after; `channel` is None of what is no channel's own, "all" of free navigation.

    `heldout` is "run" of a power-on, "part" of a later part of a power-on, "folds" within the runs that were fitted.
    `after_again` is the error with what a new power-on must measure again fitted to it, rests left out in turn.
    """

    metric: str
    channel: str | None
    unit: str
    before: float | None
    after: float | None
    floor: float | None
    before_x_floor: float | None
    after_x_floor: float | None
    ci95: Ends
    before_ci95: Ends
    floor_band95: Ends
    n: int
    heldout: HeldOut
    after_again: float | None


class CarryOverEntry(TypedDict):
    """How a kind of effect, on some channels, differs between power-ons of a unit; None where one shows nothing of it.

    `session_sd` is the standard deviation between power-ons, with its interval; `expected_sd` what to expect at the
    next one, as few power-ons widen it; `measure_again` whether the next one must be measured anew, None: not told.
    """

    effect: str
    channels: list[str]
    power_ons: int
    unit: str
    session_sd: float | None
    session_ci95: Ends | None
    expected_sd: float | None
    measure_again: bool | None


class LimitEntry(TypedDict):
    """Smallest size of an effect that the logs would show; None where they can't show it at all."""

    effect: str
    channels: list[str]
    limit: float | None
    unit: str
    text: str


class ExperimentEntry(TypedDict):
    """The run to make next; `profile` is the text of a table profile, `thermal` is [[s, degC], …]."""

    a: str
    b: str
    profile: str
    thermal: list[list[float]] | None
    duration_s: float
    d_expected: float
    motion: str
    leaves: list[str]


class IdentityEntry(TypedDict):
    """What a log says of the unit, and of who recorded it where and with what; "" where it does not say."""

    instrument: str
    serial_number: str
    firmware: str
    operator: str
    table: str
    place: str
    note: str
    software: str


class CurveEntry(TypedDict):
    """A curve before and after, for a figure; None where it is interrupted."""

    x: list[float]
    before: list[float | None]
    after: list[float | None]


class ChannelCurvesEntry(TypedDict):
    """Residual over time (s), its amplitude spectrum over frequency (Hz), its Allan deviation over averaging time (s).

    In deg/s and mg, the spectrum per √Hz. `bridged` says whether the last two have straight lines over gaps.
    """

    residual: CurveEntry
    spectrum: CurveEntry
    allan: CurveEntry
    bridged: bool


class RunCurvesEntry(TypedDict):
    """Curves of a run, by channel."""

    run: str
    heldout: bool
    channels: dict[str, ChannelCurvesEntry]


class RunEntry(TypedDict):
    """A log that was read; logs of the same `power_on` are parts of one run.

    `start_utc` is when it begins, "" where it does not say; `temperature_degc` the least and the greatest.
    """

    id: str
    log: str
    kind: str
    source: str
    rate_hz: float
    seconds: float
    samples: int
    accel_sign: int
    mount: str
    reference: str
    heldout: bool
    power_on: str
    begins_s: float
    history_known: bool
    log_sha256: str
    identity: IdentityEntry
    start_utc: str
    temperature_degc: list[float] | None
    assumed: list[str]  # of another program's log, in words
    health: list[HealthEntry]


Status = Literal["clean", "explained", "confounded", "partial", "stochastic", "run_specific", "unexplained"]


class TraceFindings(TypedDict):
    """What the tracer knows of a document."""

    untestable: list[UntestableEntry]
    integrity: list[IntegrityEntry]
    lines: list[LineEntry]
    noise_level: list[NoiseLevelEntry]
    findings: list[FindingEntry]
    refuted: list[RefutedEntry]
    common: list[CommonEntry]
    weak: list[WeakEntry]
    drift: list[DriftEntry]
    remainder: list[RemainderEntry]
    status: dict[str, Status]
    error: list[ErrorEntry]
    limits: list[LimitEntry]
    carries_over: list[CarryOverEntry]
    seed: int
    sentence: str


class TraceDocument(TraceFindings):
    """All of a document."""

    version: int
    runs: list[RunEntry]
    separating_experiment: ExperimentEntry | None
    notes: list[str]
    library: str
    source: str
    damage: list[str]
    effects_file: str
    curves: list[RunCurvesEntry]
    diary: dict[str, object] | None  # of the investigation that made the runs, see `imutui investigate`
