"""Steps of time from one packet or sample to the next, counted by length: in bounded memory, however long the log."""

import numpy as np

MOST = 2**16
"""Rows of a table from which on steps are rounded, so that steps of almost the same length share one."""
_FEWEST_BITS = 4


class StepCounts:
    """A table of how often each step occurred with what goes with it, and where first.

    Exact while there are at most `MOST` different rows: stamps of a unit's clock make a few thousand. Beyond that
    steps keep as many significant bits as leave room.

    `steps`: ns, float64, shape (R,), increasing.
    `codes`: what goes with them, int64, shape (R,).
    `counts`: how often each row occurred, int64, shape (R,).
    `before_ns`, `after_ns`: stamps at both ends of the first one, int64, shape (R,).
    """

    def __init__(self) -> None:
        self.steps = np.empty(0)
        self.codes, self.counts, self.before_ns, self.after_ns, self._position = (np.empty(0, np.int64),) * 5
        self._bits: int | None = None
        self._taken = 0

    def take(self, steps: np.ndarray, codes: np.ndarray | None, stamps_ns: np.ndarray) -> None:
        """More of them, in order: steps, shape (n,), their codes (None: 0), and the stamps between, shape (n + 1,)."""
        if not steps.size:
            return
        codes = np.zeros(steps.size, np.int64) if codes is None else codes
        position = np.arange(self._taken, self._taken + steps.size)
        self._taken += steps.size
        held = self._rows
        more = self._rounded(steps), codes, np.ones(steps.size, np.int64), stamps_ns[:-1], stamps_ns[1:], position
        self._sum_up([np.concatenate(pair) for pair in zip(held, more, strict=True)])
        while self.steps.size > MOST and (self._bits is None or self._bits > _FEWEST_BITS):
            self._bits = 24 if self._bits is None else self._bits - 2
            self._sum_up([self._rounded(self.steps), *self._rows[1:]])

    @property
    def _rows(self) -> list[np.ndarray]:
        return [self.steps, self.codes, self.counts, self.before_ns, self.after_ns, self._position]

    def _sum_up(self, rows: list[np.ndarray]) -> None:
        """Rows with equal steps and codes become one, the first of them."""
        steps, codes, counts, before, after, position = rows
        order = np.lexsort((position, codes, steps))
        steps, codes = steps[order], codes[order]
        new = np.concatenate([[True], (np.diff(steps) != 0) | (np.diff(codes) != 0)])
        edges, first = np.flatnonzero(new), order[new]
        self.steps, self.codes, self.counts = steps[new], codes[new], np.add.reduceat(counts[order], edges)
        self.before_ns, self.after_ns, self._position = before[first], after[first], position[first]

    def _rounded(self, steps: np.ndarray) -> np.ndarray:
        if self._bits is None:
            return steps
        mantissa, exponent = np.frexp(steps)
        return np.asarray(np.ldexp(np.rint(np.ldexp(mantissa, self._bits)), exponent - self._bits))

    def __len__(self) -> int:
        return self._taken

    def median(self) -> float:
        """Median step, ns; there must be one."""
        return median(self.steps, self.counts)

    def first(self, which: np.ndarray) -> int:
        """The row of those chosen by a mask, shape (R,), that occurred first; there must be one."""
        rows = np.flatnonzero(which)
        return int(rows[np.argmin(self._position[rows])])


def median(values: np.ndarray, counts: np.ndarray) -> float:
    """Median of values, each there so many times, as numpy's of all of them; shapes (R,), R > 0."""
    order = np.argsort(values, kind="stable")
    until = np.cumsum(counts[order])
    total = int(until[-1])
    middle = values[order[np.searchsorted(until, [(total - 1) // 2, total // 2], side="right")]]
    return float(np.mean(middle))
