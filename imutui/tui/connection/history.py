"""The biases' past over a whole run: extremes of every second, and of longer spans the older they are."""

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.floating]
CAPACITY = 1 << 14
_SECOND = 1.0
_LOW, _HIGH, _BOTTOM, _TOP = range(4)


class BiasHistory:
    """Extremes of estimates and of their bands, in rows of a second; the older half is thinned when it is full.

    Thinning joins pairs of the old rows whose spans are shortest, keeping minimum and maximum: a run of any length
    fits, its last hours stay at 1 Hz, and no excursion is ever lost.

    Parameters
    ----------
    columns : int
        Estimates of a row.
    capacity : int
        Rows kept; 4.5 h before the first thinning by default.
    """

    def __init__(self, columns: int, capacity: int = CAPACITY) -> None:
        self._t = np.zeros(capacity)
        self._width = np.zeros(capacity)
        self._rows = np.zeros((capacity, 4, columns), np.float32)
        self._count = 0
        self._newest = -np.inf
        self.attached_late = False
        """Whether the run had begun before anybody looked."""

    def __len__(self) -> int:
        return self._count

    @property
    def newest(self) -> float:
        """Instant of the last estimate, s; minus infinity without one."""
        return self._newest

    @property
    def begin(self) -> float:
        """Where a time axis begins, s: at the run's first sample, or at the first one that was seen of it."""
        return float(self._t[0]) if self.attached_late and self._count else 0.0

    def add(self, t: float, values: Floats, sd3: Floats) -> None:
        """Take estimates (columns,) and their three standard deviations; an earlier instant is another run."""
        if t < self._newest:
            self._count, self.attached_late = 0, False
        row = np.stack([values, values, values - sd3, values + sd3])
        if self._count and t < self._t[self._count - 1] + _SECOND:
            _widen(self._rows[self._count - 1], row)
        else:
            if self._count == len(self._t):
                self._thin()
            self._t[self._count], self._width[self._count] = t, _SECOND
            self._rows[self._count] = row
            self._count += 1
        self._newest = t

    def _thin(self) -> None:
        half = self._count // 2
        width = self._width[:half]
        for level in np.unique(width):
            first = int(np.argmax(width <= level))
            pairs = (half - first) // 2
            if pairs >= max(half // 8, 1):  # a thinning that pays for its copying
                break
        joined, rest = slice(first, first + pairs), slice(first + 2 * pairs, self._count)
        left, right = slice(first, first + 2 * pairs, 2), slice(first + 1, first + 2 * pairs, 2)
        rows = self._rows[left].copy()
        _widen(rows, self._rows[right])
        t, width = self._t[left].copy(), self._width[left] + self._width[right]
        self._count -= pairs
        moved = slice(first + pairs, self._count)
        self._t[joined], self._width[joined], self._rows[joined] = t, width, rows
        self._t[moved], self._width[moved] = self._t[rest].copy(), self._width[rest].copy()
        self._rows[moved] = self._rows[rest].copy()

    def instants(self) -> Floats:
        """When the rows begin, (N,), s since the run's first sample; a view."""
        return self._t[: self._count]

    def estimate(self, column: int) -> tuple[Floats, Floats]:
        """Lowest and highest estimate of each row, (N,)."""
        return self._rows[: self._count, _LOW, column], self._rows[: self._count, _HIGH, column]

    def band(self, column: int) -> tuple[Floats, Floats]:
        """Lowest lower and highest upper end of the band of 3 sd, (N,)."""
        return self._rows[: self._count, _BOTTOM, column], self._rows[: self._count, _TOP, column]

    def frozen(self) -> "BiasHistory":
        """A copy that stays as it is now."""
        copy = BiasHistory(self._rows.shape[2], max(self._count, 1))
        copy._count, copy._newest, copy.attached_late = self._count, self._newest, self.attached_late
        kept = slice(len(copy._t))
        copy._t[:], copy._width[:], copy._rows[:] = self._t[kept], self._width[kept], self._rows[kept]
        return copy


def _widen(rows: npt.NDArray[np.float32], more: Floats) -> None:
    """Extremes of both, in place; unknown ones give way."""
    lows, highs = [_LOW, _BOTTOM], [_HIGH, _TOP]
    rows[..., lows, :] = np.fmin(rows[..., lows, :], more[..., lows, :])
    rows[..., highs, :] = np.fmax(rows[..., highs, :], more[..., highs, :])
