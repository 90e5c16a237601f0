"""From a log to a run: readings in the instrument's axes and sign, temperature, and what is known of the motion.

Samples that the log flags as no reading (a count at its limit) stay in and are flagged.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from filters import specification
from filters.effects.lines import SpectralLine
from filters.errors import InputError
from filters.imu import AxisMap
from filters.tracing import long_run
from filters.tracing.run import Run
from filters.tracing.trace import block_s
from filters.types import Array
from imutui.instrument import registry
from imutui.jobs import replay, replay_input
from imutui.jobs.log_motion import Motion, motion_of
from imutui.logbook import pieces, reader, samples, summary
from imutui.logbook.pieces import Outline
from imutui.logbook.reader import Log, Table
from imutui.logbook.reading import Reading
from imutui.logbook.samples import Samples
from imutui.logbook.session_info import SessionInfo

Tell = Callable[[float, str], None]
_AT_ONCE = 1 << 18


@dataclass(frozen=True, slots=True)
class LoggedRun:
    """A log that was read for tracing."""

    log: Log  # without samples and table
    info: SessionInfo  # its session, with the reference in force
    run: Run  # its samples
    how: str  # how the motion is known, where that is worth a word
    sha256: str  # of the file
    reading: Reading  # how it was read

    @property
    def path(self) -> Path:
        """Where the log lies."""
        return self.log.path


def read_run(path: Path, name: str, reading: Reading, shortest: float = 0.0) -> LoggedRun:
    """Read a log as one run.

    `reading`: reference and overrides of the session.
    `shortest`: least length, s; how much a trace takes depends on what it is of.
    Raises UnreadableLogError if there is nothing to read.
    Raises InputError if it is too short, or its motion is not known.
    """
    log = reader.read(path, reading=reading)
    info = replay.session_of(log, reading)
    seconds = float(log.seconds()[-1])
    if seconds < shortest:
        raise InputError(f"{path} lasts {seconds:.1f} s; at least {shortest:.0f} s are needed. Record a longer one.")
    motion = motion_of(log, info, reading, (_figures(info) if log.own else _UNKNOWN)[2])
    return LoggedRun(_bare(log), info, _run(name, log, info, motion), motion.how, reader.sha256(path), reading)


def read_beginning(path: Path, name: str, reading: Reading) -> LoggedRun:
    """Read the first samples of a log as a run, twenty minutes at 133 Hz; it is not said whether the file is whole.

    Raises as `read_run`, and InputError where only all of a log tells its motion.
    """
    log = next(reader.parts(path, _BEGINNING, reading=reading))
    info = replay.session_of(log, reading)
    if info.reference not in _IN_PIECES or not len(log.samples):
        raise InputError(f"{path}: its beginning says too little")
    motion = motion_of(log, info, reading)
    known = replace(_bare(log), finished=True, damage="")
    return LoggedRun(known, info, _run(name, log, info, motion), motion.how, f"the beginning of {path}", reading)


def _bare(log: Log) -> Log:
    """Return a log without samples and table."""
    return replace(log, samples=Samples(), table=Table(), states=Table())


def _run(name: str, log: Log, info: SessionInfo, motion: Motion) -> Run:
    """Return the samples of a log, or of a part of one, as a run; their readings are freed."""
    t, axes = log.seconds(), info.axes()
    lsb, bandwidth, latency = _figures(info) if log.own else _UNKNOWN
    samples = log.samples
    reading = _reading(samples, axes)
    lacks = np.isnan(reading).all(axis=0)
    reading[:, lacks] = 0.0
    bad = ~samples.valid if motion.unknown is None else ~samples.valid | motion.unknown
    flagged = None
    if bad.any() or lacks.any() or motion.carried is not None:
        flagged = np.repeat(bad[:, None], 6, axis=1)
        if motion.carried is not None:
            flagged[:, 3:] |= motion.carried[:, None]
        flagged[:, lacks] = True
    return Run(
        name,
        t,
        reading,
        samples.degc if np.isfinite(samples.degc).any() else None,
        motion.angles,
        motion.rates,
        axes,
        info.settings().site,
        motion.C_nb,
        lsb,
        bandwidth,
        latency,
        flagged if flagged is not None and flagged.any() else None,
        averaged=info.sampling == "stream",
        attitude=motion.attitude,
        unread=tuple(np.flatnonzero(lacks).tolist()),
    )


# ------------------------------------------------------------------------------------------------------- in pieces
# Logs that are too long together to be held are read twice: to see what they are, and keep stretches in which lines are
# sought; then to make means of them.

_IN_PIECES = ("level", "gravity")  # references of which every piece of a log knows what the whole does
_HELD = 1 << 22  # samples of all logs together that are held at their full rate, nine hours at 133 Hz
_BEGINNING = 160_000  # samples
_STRETCHES = 16  # of a quarter of an hour, of all logs together
_OUTLINED = 0.4  # share of the time that the first reading takes


def read_runs(
    paths: Sequence[Path], names: Sequence[str], reading: Reading, fitted: int, tell: Tell
) -> list[LoggedRun]:
    """Read logs as runs; as means over rows, in pieces, if they are long.

    `fitted`: how many of them, the first ones, are not held out.
    `tell`: told the share done, 0 to 1, and what is being done.
    Raises as `read_run`.
    """
    known = _outlines(paths, reading, tell)
    if not known:
        made = []
        for number, (path, name) in enumerate(zip(paths, names, strict=True)):
            tell(number / len(paths), f"reading {path.name}")
            made.append(read_run(path, name, reading))
        return made
    logs = [_LongLog(name, outline, reading) for name, outline in zip(names, known, strict=True)]
    stretches = [[log.run(part) for part in log.known.kept] for log in logs]
    still = all(part.still for own in stretches for part in own)
    period = block_s(sum(log.known.seconds for log in logs[:fitted]), still=still)
    lines = long_run.lines_in([part for own in stretches[:fitted] for part in own])
    every = sum(log.known.samples for log in logs)
    return [
        log.read(own, lines, period, _after(tell, sum(other.known.samples for other in logs[:number]), every, log.name))
        for number, (log, own) in enumerate(zip(logs, stretches, strict=True))
    ]


def _after(tell: Tell, before: int, every: int, name: str) -> Callable[[int], None]:
    """Tells how far the second reading is, from how many samples of one log are done."""
    return lambda done: tell(_OUTLINED + (1.0 - _OUTLINED) * (before + done) / every, f"means of {name}")


def is_long(paths: Sequence[Path]) -> bool:
    """Whether logs together are so large that they may have to be read in pieces."""
    return sum(path.stat().st_size for path in paths if path.is_file()) > replay_input.WHOLE_BYTES


def _outlines(paths: Sequence[Path], reading: Reading, tell: Tell) -> list[Outline]:
    """What is known of logs that are to be read in pieces; empty if they are not."""
    if not is_long(paths):
        return []
    keep, known = -(-_STRETCHES // len(paths)), list[Outline]()
    for number, path in enumerate(paths):
        expected = summary.read(path).seconds or np.inf  # by its own account

        def told(seconds: float, before: int = number, of: float = expected, name: str = path.name) -> None:
            share = (before + min(1.0, seconds / of)) / len(paths)
            tell(_OUTLINED * share, f"reading {name}, {seconds / 3600.0:.0f} h")

        known.append(pieces.outline(path, pieces.ROWS, keep, told, reading))
        if replay.session_of(known[-1].log, reading).reference not in _IN_PIECES:
            return []
    return known if sum(outline.samples for outline in known) > _HELD else []


class _LongLog:
    """A log that is read in pieces, of which stretches are known.

    Raises InputError if it is too short, or its motion is not known.
    """

    def __init__(self, name: str, known: Outline, reading: Reading) -> None:
        self.name, self.known, path = name, known, known.log.path
        self.info = replay.session_of(known.log, reading)
        self._motion = motion_of(Log(path, samples=samples.joined(known.kept)), self.info, reading)

    def run(self, part: Samples) -> Run:
        """Return a part of it as a run; its readings are freed."""
        return _run(self.name, replace(self.known.log, samples=part), self.info, self._motion)

    def read(
        self, stretches: Sequence[Run], lines: Sequence[SpectralLine], block_s: float, tell: Callable[[int], None]
    ) -> LoggedRun:
        """All of it as one run of means; see `long_run.condensed`. `tell`: told how many samples are done."""
        known = self.known
        run = long_run.condensed(self._pieces(tell), stretches, lines, block_s, known.samples)
        log = replace(known.log, first_ns=known.first_ns)
        return LoggedRun(log, self.info, run, self._motion.how, reader.sha256(log.path), known.reading)

    def _pieces(self, tell: Callable[[int], None]) -> Iterator[Run]:
        done, known = 0, self.known
        for part, _ in pieces.pieces(known, pieces.ROWS):
            done += len(part)
            if len(part) > 1:
                yield self.run(part)
            tell(done)


def _reading(found: Samples, axes: AxisMap) -> Array:
    """Return readings in the instrument's axes, SI, shape (N, 6); the samples' own are freed.

    They are freed from the end on, each part as soon as it is copied: of a day both take half a gigabyte.
    """
    reading = np.empty((len(found), 6))
    gyro, accel = (x if x.flags.owndata else x.copy() for x in (found.gyro, found.accel))
    for first in reversed(range(0, len(reading), _AT_ONCE)):
        reading[first : first + _AT_ONCE, :3] = axes.gyro_to_instrument(gyro[first:])
        reading[first : first + _AT_ONCE, 3:] = axes.accel_to_instrument(accel[first:])
        gyro.resize((first, 3), refcheck=False)
        accel.resize((first, 3), refcheck=False)
    return reading


_UNKNOWN = (None, None, np.zeros(6))


def _figures(info: SessionInfo) -> tuple[Array | None, Array | None, Array]:
    """Size of a count (SI), band limits (Hz) and latencies (s) of the six channels, as far as the unit is known."""
    if info.sampling == "imported" or not registry.is_known(info.instrument):
        return _UNKNOWN
    instrument, spec = registry.of_model(info.instrument), specification.of_model(info.instrument)
    scaling = instrument.scaling(info.rate_range_dps, info.accel_range_g)
    lsb = np.repeat([np.deg2rad(float(scaling.rates_dps(1))), float(scaling.accels_g(1)) * info.g_unit], 3)
    loop_hz = instrument.low_pass_loop_hz
    if loop_hz is None:
        return lsb, None, np.zeros(6)
    bandwidth = np.repeat([spec.gyro_bandwidth, spec.accel_bandwidth], 3)
    # the first-order filter that the unit runs once a loop, y += (1 - p) (x - y): a ramp comes out p/(1 - p) loops late
    p = np.exp(-2.0 * np.pi * bandwidth / loop_hz)
    return lsb, bandwidth, p / (1.0 - p) / loop_hz
