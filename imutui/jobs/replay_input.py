"""Samples of a log on their way to a filter: all at once, or in pieces where the log is long."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from filters.errors import InputError
from imutui.logbook import pieces, reader
from imutui.logbook.pieces import Outline, Piece
from imutui.logbook.reader import Log, seconds_since

WHOLE_BYTES = 64 * 2**20
"""Size of a log up to which it is read at once: an hour and a half at 133 Hz."""


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

    def with_part(self, part: Part) -> "Feed":
        """Another part instead of the only one."""
        return replace(self, first=part, parts=lambda: iter([part]))


def whole(path: Path, start: float | None, end: float | None) -> Feed:
    """All samples of a log in one part; see `select`."""
    log = reader.read(path)
    part = select(log, start, end)
    return Feed(log, part, lambda: iter([part]), float(part.t[-1]))


def outline_of_long(path: Path) -> Outline | None:
    """What is known of a log that is too long to be read at once; None for others."""
    try:
        long = path.stat().st_size > WHOLE_BYTES
    except OSError:
        return None  # whoever opens it says why not
    return pieces.outline(path, pieces.ROWS) if long else None


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
    t = log.seconds()
    use = log.valid.copy()
    if start is not None:
        use &= t >= start
    if end is not None:
        use &= t <= end
    if not use.any():
        raise InputError(_nothing_left(log.path, float(t[-1])))
    stamps = log.stamp_ns[use] if not use.all() else log.stamp_ns
    first_ns = int(stamps[0])
    begun = float(reader.seconds_since(first_ns, int(log.stamp_ns[0])))
    every = bool(use.all())
    columns = log.gyro, log.accel, log.temperature()
    return Part(
        begun, first_ns, reader.seconds_since(stamps, first_ns), *(columns if every else (c[use] for c in columns))
    )


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
