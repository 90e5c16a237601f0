"""Samples in a row: the one form in which logs, of imutui or not, give them to filters, traces, checks and exports."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

_LATE_NS = 10_000_000_000
"""A temperature, or the angles of a table, may stand so much later in the file than the samples that it is of."""


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples in the order of the file."""

    stamp_ns: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))  # sampling instants, UTC, ns, (N,)
    # gyro, accel: rad/s and m/s² (specific force), body axes, shape (N, 3)
    gyro: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    accel: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    # whether there was a reading at this stamp, bool, shape (N,); False where a covariance states "no estimate"
    valid: np.ndarray = field(default_factory=lambda: np.empty(0, bool))
    # temperature, shape (N,): the last one taken by then, the first one for samples before it; NaN if there is none
    degc: np.ndarray = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return self.stamp_ns.size

    def rows(self, which: np.ndarray | slice) -> "Samples":
        """Return some of the samples, by a mask, shape (N,), or a slice."""
        return Samples(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


def joined(parts: Sequence[Samples]) -> Samples:
    """Return parts that follow each other as one."""
    if len(parts) == 1:
        return parts[0]
    names = Samples.__dataclass_fields__
    return Samples(*(np.concatenate([getattr(part, name) for part in (Samples(), *parts)]) for name in names))


class SampleGroups:
    """Joins packets to samples by time, not by number: 133.3 Hz is no multiple of most rates, and packets may be lost.

    A period runs from a whole multiple of 1/rate after the first packet to the next one. Its sample is complete with
    the first packet after it. A period without packets gives no sample.

    `rate_hz`: samples a second.
    `each`: whether each packet is a sample.
    """

    def __init__(self, rate_hz: float, *, each: bool) -> None:
        self._each = each
        self._period_ns = 1e9 / rate_hz
        self._begun_ns: int | None = None
        # of the period that is not over: its number, packets, first stamp, sum of stamps since then, sum of counts
        self._number = self._size = self._first_ns = self._late_ns = 0
        self._sum, self._valid = np.zeros(7), True

    def take(
        self, stamps: np.ndarray, counts: np.ndarray, valid: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Take packets: stamps (ns), shape (N,), counts, shape (N, 7), and whether each is a reading, shape (N,).

        Returns the samples that they complete: which packet completes each, from 0, mean stamps (ns), mean counts, and
          whether each of its packets is a reading.
        """
        if self._each or not stamps.size:
            return np.arange(stamps.size), stamps, counts, valid
        if self._begun_ns is None:
            self._begun_ns = self._first_ns = int(stamps[0])
        since = ((stamps - self._begun_ns) / self._period_ns).astype(np.int64)
        number = np.maximum.accumulate(np.append(self._number, since))
        # the packets of the period that is not over come first, as one row
        edges = np.append(0, np.flatnonzero(number[1:] != number[:-1]) + 1)
        first = np.append(self._first_ns, stamps)
        late = first - np.repeat(first[edges], np.diff(np.append(edges, number.size)))
        late[0] = self._late_ns
        sizes = np.ones(number.size, np.int64)
        sizes[0] = self._size
        sizes, late = np.add.reduceat(sizes, edges), np.add.reduceat(late, edges)
        sums = np.add.reduceat(np.vstack([self._sum, counts]), edges, axis=0)
        valid = np.logical_and.reduceat(np.append(self._valid, valid), edges)
        self._number, self._size, self._first_ns = int(number[-1]), int(sizes[-1]), int(first[edges[-1]])
        self._late_ns, self._sum, self._valid = int(late[-1]), sums[-1], bool(valid[-1])
        mean_late = np.rint(late[:-1] / sizes[:-1]).astype(np.int64)
        return edges[1:] - 1, first[edges[:-1]] + mean_late, sums[:-1] / sizes[:-1, None], valid[:-1]


class Held:
    """A quantity that keeps its value until another one comes: rows of it by stamp.

    `width`: numbers in a row.
    `from_start`: whether the first row holds before its stamp too.
    """

    def __init__(self, width: int, *, from_start: bool = False) -> None:
        self._stamps, self._rows = np.array([np.iinfo(np.int64).min]), np.full((1, width), np.nan)
        self._new: list[tuple[np.ndarray, np.ndarray]] = []
        self._from_start = from_start

    def take(self, stamps: np.ndarray, rows: np.ndarray) -> None:
        """Take more rows, shape (n, width), and their stamps, shape (n,)."""
        if stamps.size:
            self._new.append((stamps, rows))

    def at(self, stamps: np.ndarray) -> np.ndarray:
        """Return the last row by each stamp, shape (N, width); NaN before the first one.

        Rows that no stamp after the last one needs are dropped.
        """
        if self._new:
            each, rows = (np.concatenate(parts) for parts in zip((self._stamps, self._rows), *self._new, strict=True))
            order = np.argsort(each, kind="stable")
            self._stamps, self._rows, self._new = each[order], rows[order], []
            if self._from_start and np.isnan(self._rows[0]).all():
                self._rows[0] = self._rows[1]
        found = np.asarray(self._rows[np.searchsorted(self._stamps, stamps, side="right") - 1])
        if stamps.size:
            first = max(int(np.searchsorted(self._stamps, stamps[-1], side="right")) - 1, 0)
            self._stamps, self._rows = self._stamps[first:], self._rows[first:]
        return found


class Waiting:
    """Samples that wait for temperatures that stand a little later in the file."""

    def __init__(self) -> None:
        self._parts: list[Samples] = []
        self._degc = Held(1, from_start=True)
        self._newest = np.iinfo(np.int64).min

    def __len__(self) -> int:
        return sum(map(len, self._parts))

    def take(self, rows: dict[str, np.ndarray], degc_stamp_ns: np.ndarray, degc: np.ndarray) -> None:
        """Take samples, columns by the names of `Samples`, and temperatures, shape (M,), with their stamps."""
        if (count := rows["stamp_ns"].size) > 0:
            self._parts.append(Samples(**rows, degc=np.broadcast_to(np.nan, count)))
            self._newest = max(self._newest, int(rows["stamp_ns"].max()))
        known = np.isfinite(degc)
        self._degc.take(degc_stamp_ns[known], degc[known, None])

    def ready(self) -> Samples:
        """Return the samples whose temperatures have come."""
        return self._until(self._newest - _LATE_NS)

    def rest(self) -> Samples:
        """Return all samples that are left."""
        return self._until(self._newest)

    def _until(self, end: int) -> Samples:
        if not self._parts:
            return Samples()
        every = joined(self._parts)
        count = int(np.searchsorted(np.maximum.accumulate(every.stamp_ns), end, side="right"))
        self._parts = [every.rows(slice(count, None))] if count < len(every) else []
        found = every if count == len(every) else every.rows(slice(count))
        return replace(found, degc=self._degc.at(found.stamp_ns)[:, 0])
