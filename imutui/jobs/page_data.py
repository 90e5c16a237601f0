"""What the log of a result adds to its page, where the log is at hand and unchanged: courses, residual, noise, quality.

A result is a few numbers; its figures need readings. The log is read again, and the filter runs over it again as it
did. What comes out must be the result; else there are no figures of it, and it is said.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from filters.errors import InputError
from filters.tracing.trace_document import ChannelCurvesEntry, TraceDocument
from imutui.estimates import biases
from imutui.jobs import check, driver_curves, replay, residuals, result_files
from imutui.jobs.driver_curves import DriverCurve
from imutui.jobs.linear_correction import Term, of_effects_file, of_states
from imutui.jobs.replay_input import Gaps
from imutui.jobs.residuals import NoiseLevel
from imutui.jobs.result_files import Result
from imutui.logbook import effects_file, reader
from imutui.logbook.reader import Log
from imutui.logbook.reading import AS_STATED, Reading
from imutui.logbook.results import EstimatePoints, ResultDocument, RunDocument

# -------------------------------------------------------------------------------------------------------- log quality
# How whole the readings of a log are: gaps, readings that are none, losses, temperatures, what `check` finds.


@dataclass(frozen=True, slots=True)
class Quality:
    """How whole the readings of a log are."""

    log: str  # its path
    seconds: float  # from its first sample to its last
    # samples, without_reading: all of them, and those flagged as none: a count at its limit
    samples: int
    without_reading: int
    gaps: int  # steps of more than two and a half periods
    # longest_gap_s, missing_s: the longest, and all of them together less a period each
    longest_gap_s: float
    missing_s: float
    # lost_packets, bad_checksums: as the recorder counted; None of an imported log
    lost_packets: int | None
    bad_checksums: int | None
    temperature_degc: tuple[float, float] | None  # least and greatest; None without any
    findings: tuple[str, ...]  # of `imutui check`, with where


def quality_of(log: Log) -> Quality:
    """How whole the readings of a log are, with what `imutui check` finds."""
    t, counters = log.seconds(), log.diagnostics
    seconds = float(t[-1] - t[0])
    period = 1.0 / log.info.rate_hz if log.own else seconds / max(t.size - 1, 1)
    found = Gaps(period)
    found.take(t)
    gaps = found.steps[:0] if not counters and found.bursts else found.steps
    known = log.samples.degc[np.isfinite(log.samples.degc)]
    return Quality(
        str(log.path),
        seconds,
        int(t.size),
        int(np.count_nonzero(~log.samples.valid)),
        int(gaps.size),
        float(gaps.max()) if gaps.size else 0.0,
        float((gaps - period).sum()),
        int(counters["lost_packets"]) if "lost_packets" in counters else None,
        int(counters["bad_checksums"]) if "bad_checksums" in counters else None,
        (float(known.min()), float(known.max())) if known.size else None,
        tuple(f"{one['what']} {one['where']}".strip() for one in check.check(log.path)["findings"]),
    )


# ---------------------------------------------------------------------------------------------------------- page data

_SAME, _SHARE = 1e-9, 1e-3


@dataclass(frozen=True, slots=True)
class Course:
    """Estimates of a filter over a log."""

    name: str  # of the run of the filter, such as "with its effects"
    points: EstimatePoints  # biases and NIS at instants
    is_test: bool  # whether NIS is one


@dataclass(frozen=True, slots=True)
class LogData:
    """What logs add to the page of a result; empty where they are not at hand."""

    courses: tuple[Course, ...] = ()  # one of a replay; of a trace without and with what was found, over its last log
    # residual of a replay by channel, before and after alike
    curves: dict[str, ChannelCurvesEntry] = field(default_factory=dict)
    # noise by channel, and in `levels_of` the name of the log that it is of
    levels: dict[str, NoiseLevel] = field(default_factory=dict)
    levels_of: str = ""
    quality: tuple[Quality, ...] = ()  # one a log that could be read
    effects: str = ""  # text of the effects file that a replay took, or a trace made; empty for none
    terms: tuple[Term, ...] = ()  # what it takes to correct a reading beside the constant bias
    missing: tuple[str, ...] = ()  # what is left out, and why, a sentence each
    driver_curves: tuple[DriverCurve, ...] = ()  # of a trace: what errors follow, and how
    corrected_from: str = ""  # SHA-256 of the log that effects were taken out of to make this one; empty for none


def of_result(result: Result, progress: Callable[[str], None] = lambda text: None) -> LogData:
    """Return what the logs of a result add to its page."""
    if "findings" in result:
        text = result["effects_file"]
        return replace(_of_trace(result, progress), effects=text, terms=of_effects_file(text))
    return replace(_of_replay(result, progress), terms=of_states(result["effects"] if "final" in result else []))


def _of_replay(d: RunDocument, progress: Callable[[str], None]) -> LogData:
    asked = d["asked"] if "final" in d else AS_STATED.document()
    path, without = Path(d["log"]), "biases and NIS over time, residual and Allan deviation are left out"
    progress(path.name)
    log, why = _log(path, d["log_sha256"], replace(Reading.of(asked), start=None, end=None))
    if log is None:
        return LogData(effects=asked["effects"] or "", missing=(f"{why}: {without}.",))
    has_effects = "final" in d and d["effects"]
    effects = replay.effects_of(log, Reading.of(asked)).decode("utf-8", "replace") if has_effects else ""
    made = LogData(quality=(quality_of(log),), effects=effects, corrected_from=log.info.corrected_from_sha256)
    if "final" not in d:
        return made
    if asked["reference"] is not None:
        why = f"{path.name} was filtered with the reference of another file, which the result does not hold"
        return replace(made, missing=(f"{why}: {without}.",))
    courses: tuple[Course, ...] = ()
    missing: list[str] = []
    try:
        again = replay.replayed(path, Reading.of(asked), points=True)
        if _same(again.result, d):
            courses = (_course(again, ""),)
        else:
            missing.append(
                f"{path.name} comes out otherwise when it is filtered again ({again.result['library']}, the result is"
                f" of {d['library']}): biases and NIS over time are left out."
            )
    except InputError as error:
        missing.append(f"{path.name} could not be filtered again ({error}): biases and NIS over time are left out.")
    told = residuals.of_log(path, replace(Reading.of(asked), effects=None))
    missing += [told.why] if told.why else []
    return replace(
        made, courses=courses, curves=told.curves, levels=told.levels, levels_of=path.name, missing=tuple(missing)
    )


def _of_trace(d: TraceDocument, progress: Callable[[str], None]) -> LogData:
    made: list[Quality] = []
    missing: list[str] = []
    at_hand = None
    drivers: dict[str, driver_curves.DriverCourse] = {}
    for run in d["runs"]:
        path = Path(run["log"])
        progress(path.name)
        log, why = _log(path, run["log_sha256"])
        if log is None:
            missing.append(f"{why}: gaps, clipping and figures of it are left out.")
            continue
        made.append(quality_of(log))
        at_hand = run, log
        drivers[run["id"]] = driver_curves.course_of(log, run["begins_s"])
    if at_hand is None:
        return LogData(missing=tuple(missing))
    run, log = at_hand
    path = Path(run["log"])
    levels: dict[str, NoiseLevel] = {}
    courses: list[Course] = []
    if run["reference"] in ("level", "gravity") or run["reference"] == (log.reference or log.info.reference):
        overrides: dict[str, str | float] = (
            {"reference": run["reference"]} if run["reference"] in ("level", "gravity") else {}
        )
        told = residuals.of_log(path, Reading(overrides=overrides))
        levels = told.levels
        courses, why = _without_and_with(path, overrides, d["effects_file"])
        missing += [why] if why else []
    else:
        missing.append(
            f"The reference of {path.name} came from another file, which the result does not hold: biases and NIS over"
            " time are left out."
        )
    return LogData(
        courses=tuple(courses),
        levels=levels,
        levels_of=path.name,
        quality=tuple(made),
        missing=tuple(missing),
        driver_curves=driver_curves.of_trace(d, drivers),
    )


def _without_and_with(
    path: Path, overrides: Mapping[str, str | float], effects: str | None
) -> tuple[list[Course], str]:
    """The filter over a log without and with what a trace found, and what could not be."""
    contents = [("without what was found", effects_file.NONE)]
    if effects and effects_file.parse(effects.encode()).effects:
        contents.append(("with what was found", effects.encode()))
    made: list[Course] = []
    for name, content in contents:
        reading = Reading(overrides=overrides, effects=content)
        try:
            made.append(_course(replay.replayed(path, reading, points=True), name))
        except InputError as error:
            return made, f"{path.name} could not be filtered {name} ({error}): biases and NIS are left out."
    return made, ""


def _course(found: replay.Replayed, name: str) -> Course:
    assert found.points is not None
    return Course(name, found.points, found.result["nis"]["is_test"])


def _same(again: ResultDocument, d: ResultDocument) -> bool:
    """Return whether a replay gives the result, but for what another build of a library may change."""
    pairs = [(a.value, b.value, b.sd) for a, b in zip(biases(again), biases(d), strict=True)]
    a, b, sd = np.array(pairs, float).T  # None is NaN
    equal = (np.isnan(a) & np.isnan(b)) | (np.abs(a - b) <= _SAME + _SHARE * np.nan_to_num(sd))
    return bool(equal.all()) and again["samples"] == d["samples"]


def _log(path: Path, sha256: str | None, reading: Reading = AS_STATED) -> tuple[Log | None, str]:
    """A log that is where a result says and unchanged, or why there is none."""
    return result_files.of_log(path, sha256, lambda path: reader.read(path, reading=reading))
