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
from imutui.logbook.pieces import Outline
from imutui.logbook.reader import Log, seconds_since
from imutui.logbook.reading import Reading
from imutui.logbook.samples import Samples
from imutui.logbook.session_info import SessionInfo

WHOLE_BYTES = 64 * 2**20  # size of a log up to which it is read at once: an hour and a half at 133 Hz


@dataclass(frozen=True, slots=True)
class Feed:
    """The samples of a log that are to be filtered."""

    log: Log  # what else it holds; without samples where they come in pieces
    first: Samples  # the first samples; all of them where they come at once
    parts: Callable[[], Iterator[Samples]]  # gives all samples in order, anew by each call
    seconds: float  # how long they are
    # accelerometers and gyros, body axes, that the log lacks: their samples are what the reference states
    unread: tuple[bool, ...] = (False,) * 6

    @property
    def first_ns(self) -> int:
        """Sampling instant of the first sample, UTC, ns."""
        return int(self.first.stamp_ns[0])

    @property
    def start(self) -> float:
        """Time of the first sample, s since the log's first sample."""
        return float(seconds_since(self.first_ns, self.log.first_ns))

    def t(self, samples: Samples) -> np.ndarray:
        """Time of samples since the first one, s, shape (N,)."""
        return np.asarray(seconds_since(samples.stamp_ns, self.first_ns))


def outline_of_long(path: Path, reading: Reading) -> Outline | None:
    """Return what is known of a log that is too long to be read at once; None for others."""
    try:
        long = path.stat().st_size > WHOLE_BYTES
    except OSError:
        return None  # opening it reports why not
    return pieces.outline(path, pieces.ROWS, reading=reading) if long else None


def in_pieces(known: Outline, start: float | None, end: float | None) -> Feed:
    """Return the samples of a long log, a bounded number in a part; see `at_once`."""

    def found() -> Iterator[Samples]:
        chosen = (_chosen(samples, known.first_ns, start, end) for samples, _ in pieces.pieces(known, pieces.ROWS))
        return (samples for samples in chosen if len(samples))

    first = next(found(), None)
    if first is None:
        raise InputError(_nothing_left(known.log.path, known.seconds))
    last_ns = known.last_ns if end is None else min(known.last_ns, known.first_ns + round(end * 1e9))
    return Feed(known.log, first, found, float(seconds_since(last_ns, int(first.stamp_ns[0]))))


def at_once(log: Log, start: float | None = None, end: float | None = None) -> Feed:
    """Return the samples of a log from `start` to `end`, s since its first one, without those that are no reading.

    Raises InputError if no sample is left.
    """
    samples = _chosen(log.samples, log.first_ns, start, end)
    if not len(samples):
        raise InputError(_nothing_left(log.path, float(log.seconds()[-1])))
    seconds = float(seconds_since(samples.stamp_ns[-1], int(samples.stamp_ns[0])))
    return Feed(log, samples, lambda: iter([samples]), seconds)


def _chosen(samples: Samples, begin_ns: int, start: float | None, end: float | None) -> Samples:
    t = seconds_since(samples.stamp_ns, begin_ns)
    use = samples.valid.copy()
    if start is not None:
        use &= t >= start
    if end is not None:
        use &= t <= end
    return samples if use.all() else samples.rows(use)


def _nothing_left(path: Path, seconds: float) -> str:
    return f"{path}: --start and --end leave no sample; the log lasts {seconds:.3f} s. Choose a part inside it."


class Temperatures:
    """Mean, least and greatest temperature of samples that pass by."""

    def __init__(self) -> None:
        self._count, self._sum = 0, 0.0
        self._least, self._greatest = np.inf, -np.inf

    def seen(self, parts: Iterable[Samples]) -> Iterator[Samples]:
        """Yield the parts as they come."""
        for part in parts:
            known = part.degc[np.isfinite(part.degc)]
            if known.size:
                self._count += known.size
                self._sum += float(known.mean()) * known.size
                self._least = min(self._least, float(known.min()))
                self._greatest = max(self._greatest, float(known.max()))
            yield part

    def figures(self) -> tuple[float, float, float] | None:
        """In degC; None if no temperature is known."""
        return (self._sum / self._count, self._least, self._greatest) if self._count else None


class Gaps:
    """Gaps in samples that pass by, and the longest stretch without one.

    `period`: of the samples, s.
    `steps`: those that are gaps, s, shape (G,).
    """

    def __init__(self, period: float) -> None:
        self.steps, self._limit = np.empty(0), GAP_PERIODS * period
        self._edges, self._count, self._last = np.zeros(1, np.int64), 0, np.empty(0)

    def take(self, t: np.ndarray) -> None:
        """Take the times of more samples, s, shape (n,)."""
        steps = np.diff(t, prepend=self._last)
        found = np.flatnonzero(steps > self._limit)
        self.steps = np.append(self.steps, steps[found])
        self._edges = np.append(self._edges, found + self._count + t.size - steps.size)
        self._count, self._last = self._count + t.size, t[-1:]

    @property
    def bursts(self) -> bool:
        """Whether there are so many that they are bursts of a host's stamps, and no gaps in the samples."""
        return self.steps.size > max(1.0, 0.001 * self._count)

    def longest_stretch(self) -> tuple[int, int]:
        """Return the number of its first sample, and of the first one behind it."""
        edges = [0, self._count] if self.bursts else [*self._edges.tolist(), self._count]
        return max(pairwise(edges), key=lambda ends: ends[1] - ends[0])


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


def filled(feed: Feed, info: SessionInfo) -> Feed:
    """Return all samples of a log, read at once, with readings in every channel.

    `info`: with the reference in force.
    Raises InputError if the reference does not say what the channels would have read.
    """
    samples, path = feed.first, feed.log.path
    lacks = sample_check.unread(samples.gyro, samples.accel)
    if not lacks.any():
        return feed
    told = ", ".join(sample_check.names(sample_check.in_instrument_axes(lacks, info.axes())))
    site = info.site()
    if info.reference == "level":
        still = references.level(site)
    elif info.reference == "gravity":
        early = feed.t(samples) <= _LEVELLED_S
        try:
            force = level_force(samples.accel[early].mean(axis=0), site.gravity)
            still = alignment.level_by_gravity(site, force, 0.0)
        except InputError as error:
            raise InputError(f"{path} has no readings of {told}: {error}. If it is level: --reference level") from error
    else:
        raise InputError(
            f"{path} has no readings of {told}, and the reference ({info.reference}) lets the unit move: what it would"
            " have read there is not known. Replay a part at rest with --reference level or gravity, or trace it:"
            " `imutui trace` leaves these channels out."
        )
    gyro, accel = samples.gyro.copy(), samples.accel.copy()
    rate, force = still.rates_and_forces()
    gyro[:, lacks[:3]] = rate[lacks[:3]]
    accel[:, lacks[3:]] = force[lacks[3:]]
    made = replace(samples, gyro=gyro, accel=accel)
    unread = (*lacks[3:].tolist(), *lacks[:3].tolist())
    return replace(feed, first=made, parts=lambda: iter([made]), unread=unread)


# ---------------------------------------------------------------------------------------------------------- log noise
# White noise and drift of a log's own samples, for a filter that is to expect these instead of a data sheet's.

_OVERLAP = 2**15
"""Differences of means of so many samples are all taken, those of longer ones at a stride: a deviation then moves by
less than 1e-4 of its own standard deviation."""


def measured_noise(info: SessionInfo, feed: Feed) -> Noise:
    """Return white noise and drift of the samples themselves, by Allan deviation, from their longest stretch.

    `info`: with the reference in force.
    Raises InputError if the unit moves by its reference, or the log is too short.
    """
    if info.reference not in ("level", "gravity"):
        raise InputError(
            f'`noise` is "log" with reference "{info.reference}": noise is measured on a unit at rest. Measure it on a'
            " still log, or leave filter.noise at table1."
        )
    period = 1.0 / info.rate_hz
    gaps = Gaps(period)
    for part in feed.parts():
        gaps.take(feed.t(part))
    first, last = gaps.longest_stretch()
    running, at = RunningAllan(6, _OVERLAP), 0
    for part in feed.parts():
        rows = slice(max(first - at, 0), max(last - at, 0))
        running.add(np.column_stack([part.accel[rows], part.gyro[rows]]))
        at += len(part)
    levels = running.noise(period)
    white, drift = (_like_the_others(each, feed.unread).tolist() for each in (levels.white, levels.drift))
    return Noise(tuple(white[:3]), tuple(white[3:]), tuple(drift[:3]), tuple(drift[3:]))


def _like_the_others(levels: np.ndarray, unread: tuple[bool, ...]) -> np.ndarray:
    """Return levels of six channels; one that was not read has no noise of its own, and gets the most of its kind."""
    kinds = np.where(unread, 0.0, levels).reshape(2, 3)
    return np.where(unread, np.repeat(kinds.max(axis=1), 3), levels)
