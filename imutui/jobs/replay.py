"""The filter over a log: the same step as live, fed with what the file holds."""

import contextlib
import hashlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from filters.errors import InputError
from filters.kalman import layout, runner
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings
from filters.motion import alignment
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from imutui.jobs import channel_health, replay_input
from imutui.jobs.replay_course import ReplayCourse, ReplayPoints
from imutui.jobs.replay_input import Feed
from imutui.logbook import (
    atomic_file,
    checksum_file,
    effects_file,
    foreign_log,
    health,
    log_time,
    reader,
    reference_file,
    results,
    schemas,
)
from imutui.logbook.estimate_rows import BiasVerdicts, EstimateRows
from imutui.logbook.log_stream import MODE
from imutui.logbook.reader import Log
from imutui.logbook.reading import AS_STATED, Reading
from imutui.logbook.results import EstimatePoints, ResultDocument
from imutui.logbook.session_info import FROM_LOG, SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.plain_text import in_line, quoted

ESTIMATES_HZ = 1.0
_ROWS = 1024
_PART = 65536


@dataclass(frozen=True, slots=True)
class EstimatesFile:
    """A log of estimates that a replay writes."""

    path: Path
    hz: float = ESTIMATES_HZ  # estimates a second; 0 for all
    overwrite: bool = False  # replace the file if it exists
    mode: int = MODE  # permissions

    @property
    def every_s(self) -> float:
        """Least time between two estimates, s."""
        return 1.0 / self.hz if self.hz > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class Replayed:
    """A replay's result, with what of the log is not in it."""

    result: ResultDocument  # as in docs/formats.md; `damage` says what is wrong with the file, if anything
    info: SessionInfo  # with the settings in force
    first_ns: int  # sampling instant of the first sample that was taken, UTC, ns
    # mean, least and greatest of the samples that were taken, degC; None if it is not known
    temperature: tuple[float, float, float] | None
    points: EstimatePoints | None = None  # biases and NIS at instants, if they were asked for


def replay(
    path: Path,
    reading: Reading = AS_STATED,
    progress: Callable[[float], None] = lambda share: None,
    say: Callable[[str], None] | None = None,
    **wanted: Any,
) -> ResultDocument:
    """Return the result of the filter over one log; the arguments are those of `replayed`."""
    return replayed(path, reading, progress, say, **wanted).result


def replayed(
    path: Path,
    reading: Reading = AS_STATED,
    progress: Callable[[float], None] = lambda share: None,
    say: Callable[[str], None] | None = None,
    *,
    speed: float | None = None,
    output: EstimatesFile | None = None,
    course: bool = False,
    points: bool = False,
) -> Replayed:
    """Run the filter over one log.

    `progress`: called with the share done, 0 to 1, now and then.
    `say`: called with a sentence on how far compiling has come, the first time on a machine.
    `speed`: times real time to pace the samples at; None goes as fast as it can.
    `output`: file of estimates to write.
    `course`: whether the result has the biases over time, for plots; not with an `output`, which has them.
    `points`: whether biases and NIS at instants are returned, for figures.
    Raises UnreadableLogError if there is nothing to replay.
    Raises InputError if an override is not possible; the message names it.
    Raises DivergenceError if the filter broke down; the message names the sample.
    """
    if output is not None and output.path.exists() and output.path.samefile(path):
        raise InputError(f"{output.path} is the log itself: estimates go into a file of their own")
    with contextlib.ExitStack() as stack:
        part = None
        if output is not None:
            part = stack.enter_context(atomic_file.part_of(output.path, overwrite=output.overwrite, mode=output.mode))
        sink = None if part is None or output is None else replace(output, path=part)
        made = _replayed(path, reading, sink, progress, say, speed, course=course, points=points)
    if output is not None:
        checksum_file.remove(output.path)  # of an earlier file of that name
    return made


def _replayed(
    path: Path,
    reading: Reading,
    output: EstimatesFile | None,
    progress: Callable[[float], None],
    say: Callable[[str], None] | None,
    speed: float | None,
    *,
    course: bool,
    points: bool,
) -> Replayed:
    started = time.perf_counter()
    fed = _fed(path, reading)
    log, first_ns = fed.log, fed.first_ns
    log_sha256 = reader.sha256(path)
    read_s = time.perf_counter() - started

    info, settings = prepare(fed, reading)
    course_of = ReplayCourse(info, fed.seconds) if course else None
    points_of = ReplayPoints(info, fed.seconds) if points else None
    wanted = [taker.every for taker in (course_of, points_of) if taker is not None]
    estimator = Estimator(settings, min([np.inf if output is None else output.every_s, *wanted]))
    for event in log.events:
        if event.name == "mark":
            estimator.mark(reader.seconds_since(event.stamp_ns, first_ns), event.text)
    estimator.warm_up(say)
    sink = None if output is None else _EstimateSink(output.path, info, log, first_ns, output.mode)
    temperature = replay_input.Temperatures()
    seen = replace(fed, parts=lambda: temperature.seen(fed.parts()))
    started = time.perf_counter()
    for rows in run(estimator, seen, speed, progress):
        for taker in (course_of, points_of):
            if taker is not None:
                taker.take(rows, estimator)
        if sink is not None:
            sink.take(rows, estimator)
    if estimator.latest is None:
        raise InputError(f"{path}: {_nothing_used(info)}")
    filter_s = time.perf_counter() - started
    first = channel_health.EARLIEST_NS if reading.start is None else first_ns
    last = channel_health.LATEST_NS if reading.end is None else first_ns + round(fed.seconds * 1e9)
    channels = channel_health.of_log(path, info, reading, first, last)
    found = channels.entries(health.bias_sd(estimator, info), moving=not info.effects_sha256)
    lost, bad = (int(log.diagnostics.get(key, "0")) for key in ("lost_packets", "bad_checksums"))
    readings = results.of_readings(info, path, estimator.taken, (lost, bad), found, log_sha256, finished=log.finished)
    result = results.document(readings, estimator, info, filter_s, read_s)
    result["assumed"] = list(log.assumed)
    if info.sampling in ("foreign", "imported"):
        result["rate_hz"] = info.rate_hz  # which gaps do not change
    result["damage"] = log.damage or None
    result["effects_of_other_unit"] = effects_file.of_other_unit(effects_of(log, reading), info) or None
    if sink is not None:
        sink.finish(result)
    if course_of is not None:
        result["course"] = course_of.rows(result)
    result["asked"] = reading.document()
    points_at = None if points_of is None else points_of.points()
    return Replayed(result, info, first_ns, temperature.figures(), points_at)


def _fed(path: Path, reading: Reading) -> Feed:
    """Samples of a log: those of a long one in pieces, unless something has to be looked for in all of them at once."""
    known = replay_input.outline_of_long(path, reading)
    if known is None or known.lacks.any() or _is_aligned(known.log, reading):
        log = reader.read(path, reading=reading)
        feed = replay_input.at_once(log, reading.start, reading.end)
        return replay_input.filled(feed, session_of(log, reading))
    return replay_input.in_pieces(known, reading.start, reading.end)


def _is_aligned(log: Log, reading: Reading) -> bool:
    """Whether a profile's place in time is found in the samples."""
    motion = motion_of(log, session_of(log, reading), reading, 0.0)
    return isinstance(motion, Profile) and motion.align == "gyro"


def _nothing_used(info: SessionInfo) -> str:
    if info.reference == "turned":
        return (
            "no rest was found: nowhere is the unit quiet and steady for a second. Reference turned is for a unit that"
            " is put down between turns; name another: --reference level|gravity|FILE"
        )
    return "the effects leave no sample to filter. --effects none leaves effects out"


def prepare(
    feed: Feed, reading: Reading, advice: str = ". --effects none leaves effects out"
) -> tuple[SessionInfo, Settings]:
    """Return session and settings of a replay: the log's own, the caller's, and those measured on the samples.

    `advice` follows the reason why effects cannot be used.
    """
    log = feed.log
    info = session_of(log, reading)
    if reading.start:
        # what was remembered is of the file's first sample
        info = replace(info, memory="")
    motion = motion_of(log, info, reading, feed.start)
    offset, offset_sd = -feed.start, None
    if isinstance(motion, Profile) and motion.align == "gyro":
        offset, offset_sd = alignment.offset_of_profile(motion, feed.t(feed.first), feed.first.gyro)
    noise = replay_input.measured_noise(info, feed) if info.noise == FROM_LOG else None
    try:
        content = effects_of(log, reading)
        _refuse_twice(log.info, content)
        make = effects_file.maker(content, info)
    except InputError as error:
        raise InputError(f"{log.path}: {error}{advice}") from error
    return info, replace(info.settings(motion, noise, offset, offset_sd, make), unread=feed.unread)


def _refuse_twice(info: SessionInfo, effects: bytes) -> None:
    if effects and effects_file.digest(effects) == info.applied_effects_sha256:
        raise InputError(f"the effects of this file are taken out of it already ({in_line(info.source)})")


def session_of(log: Log, reading: Reading) -> SessionInfo:
    """Return the session of a log with what the caller states in place of it.

    Raises RefusedLogError if another program's log is said to be level and its forces say otherwise.
    """
    info = log.info
    if log.reference is not None:
        info = replace(info, reference=log.reference)
    if info.filter == "none":
        info = replace(info, filter="spkf")
    if reading.reference is not None:
        digest = hashlib.sha256(reading.reference.content).hexdigest()
        info = replace(info, reference=reading.reference.kind, reference_sha256=digest)
    info = replace(info, effects_sha256=effects_file.digest(effects_of(log, reading)))
    info = info.overridden(reading.overrides)
    if log.mean_force is not None and info.reference == "level":
        foreign_log.refuse_upside_down(log.path, log.mean_force, info.axes(), info.gravity_mps2)
    return info


def effects_of(log: Log, reading: Reading) -> bytes:
    """Content of the effects file that a replay takes: the one asked for, else the log's own."""
    return (
        log.attachments.get(effects_file.ATTACHMENT, effects_file.NONE) if reading.effects is None else reading.effects
    )


def motion_of(log: Log, info: SessionInfo, reading: Reading, start: float) -> Profile | Trajectory | None:
    """Motion that the reference needs, its time counted from `start` s of the log where it has no offset of its own."""
    if info.reference not in ("profile", "trajectory"):
        return None
    if reading.reference is not None:
        motion = reading.reference.motion()
    else:
        name = next((name for name in reference_file.ATTACHMENTS if name in log.attachments), None)
        if name is None:
            raise InputError(
                f'{log.path}: the reference is "{info.reference}", and the log has none of its own (an attachment'
                " reference.toml or reference.csv). Name its file: --reference FILE."
            )
        motion = reference_file.parse(name, log.attachments[name])
    wanted = Profile if info.reference == "profile" else Trajectory
    if not isinstance(motion, wanted):
        raise InputError(f'{log.path}: the reference is "{info.reference}", but its file is something else')
    return motion if isinstance(motion, Profile) else Trajectory(motion.t - start, motion.values)


def run(
    estimator: Estimator,
    feed: Feed,
    speed: float | None,
    progress: Callable[[float], None],
) -> Iterator[np.ndarray]:
    """Feed samples to a filter, paced at `speed` times real time if it is given, and yield rows of estimates."""
    started = time.monotonic()
    size = _PART if speed is None else 1
    for part in feed.parts():
        t = feed.t(part)
        for first in range(0, t.size, size):
            if speed is not None:
                time.sleep(max(0.0, t[first] / speed - (time.monotonic() - started)))
            some = slice(first, first + size)
            yield from runner.rows(estimator, t[some], part.gyro[some], part.accel[some], part.degc[some], last=False)
            if first % 512 == 0:
                progress(min(1.0, float(t[some][-1]) / feed.seconds if feed.seconds > 0.0 else 1.0))
    yield from estimator.use_waiting()
    progress(1.0)


class _EstimateSink:
    """Write estimates to a file as they come."""

    def __init__(self, output: Path, info: SessionInfo, log: Log, first_ns: int, mode: int) -> None:
        self._info = info
        text = f"# replay of {in_line(log.path.name)}\nfilter = {quoted(info.filter)}\n"
        text += f"reference = {quoted(info.reference)}\n"
        # without a checksum beside it: the file can be made again
        self._writer = LogWriter(output, info, text, log_time.now_ns(), overwrite=True, mode=mode, checksum=False)
        self._first_ns = first_ns
        # rows are made messages many at a time, as long as the verdict on the biases is the same
        self._rows: list[np.ndarray] = []
        self._count = 0
        self._said: object = None
        self._verdict = BiasVerdicts(results.ALL_SEEN, ~results.ALL_SEEN, np.zeros(3))

    def take(self, rows: np.ndarray, estimator: Estimator) -> None:
        """Write rows of estimates."""
        since = estimator.monitor.convergence().since
        said = (estimator.observable, tuple(s is not None for s in since), tuple(estimator.vertical))
        if said != self._said or self._count >= _ROWS:
            self._write()
            self._said, self._verdict = said, BiasVerdicts.of(estimator, self._info)
        self._rows.append(rows)
        self._count += len(rows)

    def _write(self) -> None:
        if self._rows:
            rows = np.concatenate(self._rows)
            stamps = self._first_ns + np.round(rows[:, layout.OUT_T] * 1e9).astype(np.int64)
            messages = EstimateRows(rows, self._verdict, self._info).encode(stamps)
            for stamp, message in zip(stamps.tolist(), messages, strict=True):
                self._writer.encoded(schemas.ESTIMATE, message, stamp, stamp)
        self._rows, self._count = [], 0

    def finish(self, result: ResultDocument) -> None:
        """Close the file with the result as its summary."""
        self._write()
        self._writer.finish(result, log_time.now_ns())
