"""A log in pieces: all of it once, a bounded part of it in memory; however long it is."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from imutui.logbook import reader
from imutui.logbook.reader import Log, UnreadableLogError, parts
from imutui.logbook.reading import AS_STATED, Reading
from imutui.logbook.sample_check import SampleCheck

ROWS = 2**17  # samples in a piece: a quarter of an hour at 133 Hz
_LATE_NS = 10_000_000_000
"""A temperature or a table's angles may stand so much later in the file than the samples that they belong to."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Samples in a row, with what was the case at each."""

    stamp_ns: np.ndarray  # UTC, ns, int64, shape (N,)
    # gyro, accel: rad/s and m/s² (specific force), body axes, shape (N, 3)
    gyro: np.ndarray
    accel: np.ndarray
    valid: np.ndarray  # whether there was a reading, bool, shape (N,)
    # the last one taken by then, shape (N,); the log's first for samples before it, NaN if there is none
    temperature_degc: np.ndarray
    # angles_deg, rates_dps: what /table/reference said last, shape (N, 3); NaN where that is unknown
    angles_deg: np.ndarray
    rates_dps: np.ndarray

    def rows(self, which: np.ndarray) -> "Piece":
        """Some of its samples, by a mask, shape (N,)."""
        return Piece(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


@dataclass(slots=True)
class Outline:
    """What has to be known of a whole log before its first piece can be used."""

    log: Log  # without samples, temperatures, angles and packets; `damage` and `finished` are those of the whole file
    reading: Reading = AS_STATED  # how the log is read
    samples: int = 0  # how many there are
    # first_ns, last_ns: UTC of the first and the last, ns
    first_ns: int = 0
    last_ns: int = 0
    first_temperature: float = float("nan")  # degC; NaN if the log has none
    # has_angles, has_rates: whether the table's are known anywhere
    has_angles: bool = False
    has_rates: bool = False
    # channels that are NaN throughout, bool, shape (6,)
    lacks: np.ndarray = field(default_factory=lambda: np.ones(6, bool))
    kept: list[Log] = field(default_factory=list)  # parts of it, evenly spread, as many as were asked for

    @property
    def seconds(self) -> float:
        """Time from the first sample to the last."""
        return float(reader.seconds_since(self.last_ns, self.first_ns))


def outline(
    path: Path,
    rows: int = ROWS,
    keep: int = 0,
    tell: Callable[[float], None] = lambda seconds: None,
    reading: Reading = AS_STATED,
) -> Outline:
    """Walk through a log once, look at every sample, and keep what is none.

    `keep`: most parts to be kept; there are at least half as many, if the log has them.
    `tell`: told how far it has come, s.
    Raises UnreadableLogError as `reader.read`.
    """
    found, check, every = Outline(Log(path), reading), SampleCheck(), 1
    for number, part in enumerate(parts(path, rows, reading=reading)):
        found.log = part
        check.take(part.stamp_ns, part.gyro, part.accel, part.temperature_degc)
        if part.stamp_ns.size:
            found.first_ns = found.first_ns if found.samples else part.first_ns
            found.last_ns = int(part.stamp_ns[-1])
            found.samples += part.stamp_ns.size
            tell(found.seconds)
            if keep and number % every == 0 and part.stamp_ns.size >= min(rows, found.samples):
                if len(found.kept) == keep:
                    found.kept, every = found.kept[::2], 2 * every
                if number % every == 0:
                    found.kept.append(part)
        if part.temperature_degc.size and np.isnan(found.first_temperature):
            found.first_temperature = float(part.temperature_degc[np.argmin(part.temperature_stamp_ns)])
        found.has_angles |= bool(np.isfinite(part.table.angles_deg).all(axis=1).any())
        found.has_rates |= bool(np.isfinite(part.table.rates_dps).all(axis=1).any())
    if trouble := check.trouble(path):
        raise UnreadableLogError(trouble)
    found.lacks = check.lacks
    found.log = _emptied(found.log)
    return found


def pieces(known: Outline, rows: int = ROWS) -> Iterator[Piece]:
    """All samples of a log in order, so many at a time or a few more.

    `known`: of the log.
    `rows`: samples in a piece.
    Raises UnreadableLogError as `reader.read`.
    """
    waiting = _Waiting(known)
    for part in parts(known.log.path, rows, reading=known.reading):
        waiting.take(part)
        if (piece := waiting.ready()) is not None:
            yield piece
    if (piece := waiting.rest()) is not None:
        yield piece


def _emptied(log: Log) -> Log:
    nothing = Log(log.path)
    return replace(
        log, stamp_ns=nothing.stamp_ns, gyro=nothing.gyro, accel=nothing.accel, valid=nothing.valid,
        temperature_stamp_ns=nothing.temperature_stamp_ns, temperature_degc=nothing.temperature_degc,
        packets=nothing.packets, packet_stamp_ns=nothing.packet_stamp_ns, table=nothing.table, states=nothing.states,
    )  # fmt: skip


class _Followed:
    """A quantity that keeps its value until another one comes: rows of it by stamp.

    `first`: what holds before the first one.
    """

    def __init__(self, first: np.ndarray) -> None:
        self._stamps = np.array([np.iinfo(np.int64).min])
        self._rows = first[None]

    def take(self, stamps: np.ndarray, rows: np.ndarray) -> None:
        """More of them."""
        if stamps.size:
            stamps, rows = np.concatenate([self._stamps, stamps]), np.concatenate([self._rows, rows])
            order = np.argsort(stamps, kind="stable")
            self._stamps, self._rows = stamps[order], rows[order]

    def at(self, stamps: np.ndarray) -> np.ndarray:
        """The last ones taken by then."""
        return np.asarray(self._rows[np.searchsorted(self._stamps, stamps, side="right") - 1])

    def forget(self, before: int) -> None:
        """Let go what nothing after that time needs."""
        first = max(int(np.searchsorted(self._stamps, before, side="right")) - 1, 0)
        self._stamps, self._rows = self._stamps[first:], self._rows[first:]


class _Waiting:
    """Samples that wait for what may be said of them a little later in the file."""

    def __init__(self, known: Outline) -> None:
        self._held: list[tuple[np.ndarray, ...]] = []
        self._temperature = _Followed(np.array([known.first_temperature]))
        self._table = _Followed(np.full(6, np.nan))
        self._newest, self._last_ns = np.iinfo(np.int64).min, known.last_ns

    def take(self, part: Log) -> None:
        """More of the log."""
        if part.stamp_ns.size:
            self._held.append((part.stamp_ns, part.gyro, part.accel, part.valid))
            self._newest = max(self._newest, int(part.stamp_ns[-1]))
        self._temperature.take(part.temperature_stamp_ns, part.temperature_degc[:, None])
        self._table.take(part.table.stamp_ns, np.hstack([part.table.angles_deg, part.table.rates_dps]))

    def ready(self) -> Piece | None:
        """Those of which all is said."""
        return self._until(min(self._newest - _LATE_NS, self._last_ns))

    def rest(self) -> Piece | None:
        """All that is left, without what was written to the file since it was outlined."""
        return self._until(self._last_ns)

    def _until(self, end: int) -> Piece | None:
        if not self._held:
            return None
        columns = [np.concatenate(column) for column in zip(*self._held, strict=True)]
        count = int(np.searchsorted(columns[0], end, side="right"))
        self._held = [tuple(column[count:] for column in columns)] if count < columns[0].size else []
        if not count:
            return None
        stamps, gyro, accel, valid = (column[:count] for column in columns)
        temperature, table = self._temperature.at(stamps)[:, 0], self._table.at(stamps)
        self._temperature.forget(int(stamps[-1]))
        self._table.forget(int(stamps[-1]))
        return Piece(stamps, gyro, accel, valid, temperature, table[:, :3], table[:, 3:])
