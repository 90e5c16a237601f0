"""Samples of a log on their way to a filter: all at once, or in pieces where the log is long."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from filters.allan import RunningAllan
from filters.errors import InputError
from filters.imu import Noise
from filters.kalman.settings import GAP_PERIODS
from filters.motion import alignment
from filters.motion import reference as references
from imutui.logbook import pieces, sample_check
from imutui.logbook.pieces import Outline, Piece
from imutui.logbook.reader import Log, seconds_since
from imutui.logbook.reading import Reading
from imutui.logbook.session_info import SessionInfo

WHOLE_BYTES = 64 * 2**20  # size of a log up to which it is read at once: an hour and a half at 133 Hz


@dataclass(frozen=True, slots=True)
class Part:
    """The samples of a log that are to be filtered."""

    start: float  # time of the first one, s since the log's first sample
    first_ns: int  # its sampling instant, UTC, ns
    t: np.ndarray  # s since the first one, shape (N,)
    # gyro, accel: rad/s and m/s², body axes, shape (N, 3)
    gyro: np.ndarray
    accel: np.ndarray
    temperature: np.ndarray  # degC, shape (N,); NaN where it is not known
    # of the accelerometers and gyros, body axes, those that the log lacks; what stands there is what the reference
    # says. Empty if it lacks none.
    unread: tuple[bool, ...] = ()


@dataclass(frozen=True, slots=True)
class Feed:
    """Samples of a log."""

    log: Log  # what else it holds; without samples where they come in pieces
    first: Part  # the first samples; all of them where they come at once
    parts: Callable[[], Iterator[Part]]  # gives all samples in order, anew by each call; times count from the first one
    seconds: float  # how long they are


def outline_of_long(path: Path, reading: Reading) -> Outline | None:
    """Return what is known of a log that is too long to be read at once; None for others."""
    try:
        long = path.stat().st_size > WHOLE_BYTES
    except OSError:
        return None  # whoever opens it says why not
    return pieces.outline(path, pieces.ROWS, reading=reading) if long else None


def in_pieces(known: Outline, start: float | None, end: float | None) -> Feed:
    """Samples of a log, a bounded number in a part; see `select`.

    Raises UnreadableLogError as `reader.read`.
    Raises InputError if no sample is left.
    """
    begin_ns = known.first_ns

    def found() -> Iterator[Piece]:
        chosen = (_chosen(piece, begin_ns, start, end) for piece in pieces.pieces(known, pieces.ROWS))
        return (piece for piece in chosen if piece.stamp_ns.size)

    first = next(found(), None)
    if first is None:
        raise InputError(_nothing_left(known.log.path, float(seconds_since(known.last_ns, begin_ns))))
    first_ns = int(first.stamp_ns[0])
    last_ns = known.last_ns if end is None else min(known.last_ns, begin_ns + round(end * 1e9))
    return Feed(
        known.log,
        _part(first, first_ns, begin_ns),
        lambda: (_part(piece, first_ns, begin_ns) for piece in found()),
        float(seconds_since(last_ns, first_ns)),
    )


def _chosen(piece: Piece, begin_ns: int, start: float | None, end: float | None) -> Piece:
    t = seconds_since(piece.stamp_ns, begin_ns)
    use = piece.valid.copy()
    if start is not None:
        use &= t >= start
    if end is not None:
        use &= t <= end
    return piece if use.all() else piece.rows(use)


def _part(piece: Piece, first_ns: int, begin_ns: int) -> Part:
    t = seconds_since(piece.stamp_ns, first_ns)
    begun = float(seconds_since(first_ns, begin_ns))
    return Part(begun, first_ns, t, piece.gyro, piece.accel, piece.temperature_degc)


def _nothing_left(path: Path, seconds: float) -> str:
    return f"{path}: --start and --end leave no sample; the log lasts {seconds:.3f} s. Choose a part inside it."


def select(log: Log, start: float | None, end: float | None) -> Part:
    """Samples from `start` to `end`, s since the first, without those that are flagged as no reading."""
    begin_ns, nothing = log.first_ns, np.empty((log.stamp_ns.size, 0))
    every = Piece(log.stamp_ns, log.gyro, log.accel, log.valid, log.temperature(), nothing, nothing)
    piece = _chosen(every, begin_ns, start, end)
    if not piece.stamp_ns.size:
        raise InputError(_nothing_left(log.path, float(log.seconds()[-1])))
    return _part(piece, int(piece.stamp_ns[0]), begin_ns)


class Temperatures:
    """Mean, least and greatest temperature of parts that pass by."""

    def __init__(self) -> None:
        self._count, self._sum = 0, 0.0
        self._least, self._greatest = np.inf, -np.inf

    def seen(self, parts: Iterable[Part]) -> Iterator[Part]:
        """The parts as they come."""
        for part in parts:
            known = part.temperature[np.isfinite(part.temperature)]
            if known.size:
                self._count += known.size
                self._sum += float(known.mean()) * known.size
                self._least, self._greatest = (
                    min(self._least, float(known.min())),
                    max(self._greatest, float(known.max())),
                )
            yield part

    def figures(self) -> tuple[float, float, float] | None:
        """In degC; None if no temperature is known."""
        return (self._sum / self._count, self._least, self._greatest) if self._count else None


# ------------------------------------------------------------------------------------------------------ unread filled
# Readings for the filter in place of channels that a log lacks: what the reference says of a unit at rest.
#
# A filter needs three of each kind to integrate. With what a perfect unit reads there the missing channels neither add
# anything nor pull at the others; what it then holds of their biases is nothing, and is told as not observable. A unit
# that moves has no such readings, and is refused.

_LEVELLED_S = 10.0
_FLAT = 0.1


def level_force(force: np.ndarray, gravity: float) -> np.ndarray:
    """Mean specific force of a unit at rest, body axes, with an axis that was not read made up to gravity.

    `force`: m/s², shape (3,), NaN for an axis that was not read.
    `gravity`: m/s².
    Raises InputError if it can't be: two axes are missing, or one that does not point down and feels too much of
      gravity to be flat.
    """
    lacking = np.flatnonzero(np.isnan(force))
    if not lacking.size:
        return force
    if lacking.size > 1:
        raise InputError("with one accelerometer or none the level can't be read from gravity")
    (axis,) = lacking.tolist()
    rest = float(np.sqrt(max(0.0, gravity**2 - np.nansum(force**2))))
    if axis != 2 and rest > _FLAT * gravity:
        name = "xyz"[axis]
        raise InputError(
            f"without the accelerometer along the table's {name} it can't be told which way the unit is tilted"
        )
    made = force.copy()
    # upright, as mounted: specific force is up, and the third body axis points down
    made[axis] = -rest if axis == 2 else 0.0
    return made


def filled(part: Part, info: SessionInfo, path: Path) -> Part:
    """All samples of a log with readings in every channel.

    `part`: as the log has them, NaN where a channel was not read.
    `info`: with the reference in force.
    `path`: the log, for messages.
    Raises InputError if the reference does not say what the channels would have read.
    """
    lacks = sample_check.unread(part.gyro, part.accel)
    if not lacks.any():
        return part
    told = ", ".join(sample_check.names(sample_check.in_instrument_axes(lacks, info.axes())))
    site = info.site()
    if info.reference == "level":
        still = references.level(site)
    elif info.reference == "gravity":
        early = part.t <= _LEVELLED_S
        try:
            force = level_force(part.accel[early].mean(axis=0), site.gravity)
            still = alignment.level_by_gravity(site, force, 0.0)
        except InputError as error:
            raise InputError(f"{path} has no readings of {told}: {error}. If it is level: --reference level") from error
    else:
        raise InputError(
            f"{path} has no readings of {told}, and the reference ({info.reference}) lets the unit move: what it would"
            " have read there is not known. Replay a part at rest with --reference level or gravity, or trace it:"
            " `imutui trace` leaves these channels out."
        )
    gyro, accel = part.gyro.copy(), part.accel.copy()
    rate, force = still.rates_and_forces()
    gyro[:, lacks[:3]] = rate[lacks[:3]]
    accel[:, lacks[3:]] = force[lacks[3:]]
    return replace(part, gyro=gyro, accel=accel, unread=(*lacks[3:].tolist(), *lacks[:3].tolist()))


# ---------------------------------------------------------------------------------------------------------- log noise
# White noise and drift of a log's own samples, for a filter that is to expect these instead of a data sheet's.

_OVERLAP = 2**15
"""Differences of means of so many samples are all taken, those of longer ones at a stride: a deviation then moves by
less than 1e-4 of its own standard deviation."""


def measured_noise(info: SessionInfo, parts: Callable[[], Iterable[Part]]) -> Noise:
    """White noise and drift of the samples themselves, by Allan deviation, from the longest stretch without a gap.

    `info`: with the reference in force.
    `parts`: gives the samples from the first one on, each time that it is called.
    Raises InputError if the unit moves by its reference, or the log is too short.
    """
    if info.reference not in ("level", "gravity"):
        raise InputError(
            f'`noise` is "log" with reference "{info.reference}": noise is measured on a unit at rest. Measure it on a'
            " still log, or leave filter.noise at table1."
        )
    period = 1.0 / info.rate_hz
    first, last = _longest(parts(), period)
    running, at = RunningAllan(6, _OVERLAP), 0
    unread: tuple[bool, ...] = ()
    for part in parts():
        rows = slice(max(first - at, 0), max(last - at, 0))
        running.add(np.column_stack([part.accel[rows], part.gyro[rows]]))
        at += part.t.size
        unread = part.unread
    levels = running.noise(period)
    white, drift = (_like_the_others(each, unread).tolist() for each in (levels.white, levels.drift))
    return Noise(tuple(white[:3]), tuple(white[3:]), tuple(drift[:3]), tuple(drift[3:]))


def _longest(parts: Iterable[Part], period: float) -> tuple[int, int]:
    """Number of the first sample of the longest stretch without a gap, and of the first one behind it."""
    begin = count = breaks = 0
    longest, last = (0, 0), np.empty(0)
    for part in parts:
        steps = np.diff(part.t, prepend=last)
        found = np.flatnonzero(steps > GAP_PERIODS * period) + count + part.t.size - steps.size
        breaks, count = breaks + found.size, count + part.t.size
        edges = [begin, *found.tolist(), count]
        stretch = max(pairwise(edges), key=lambda ends: ends[1] - ends[0])
        longest = max(longest, stretch, key=lambda ends: ends[1] - ends[0])
        begin, last = edges[-2], part.t[-1:]
    # bursts of a host's stamps are no gaps in the samples
    return (0, count) if breaks > 0.001 * count else longest


def _like_the_others(levels: np.ndarray, unread: tuple[bool, ...]) -> np.ndarray:
    """Levels of six channels; one that was not read has no noise of its own, and gets the most of its kind."""
    if not unread:
        return levels
    kinds = np.where(unread, 0.0, levels).reshape(2, 3)
    return np.where(unread, np.repeat(kinds.max(axis=1), 3), levels)
