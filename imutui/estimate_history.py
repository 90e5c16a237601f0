"""The past of estimates over a whole run: extremes of every second, and of longer spans the older they are."""

from typing import TypedDict

import numpy as np
import numpy.typing as npt


class HistoryRows(TypedDict):
    """Extremes of estimates over short spans, a row each, as they travel and are kept in a result document.

    `t` is where a span begins, s since the run's first sample, and `width` its length. `low` and `high` have the least
    and the greatest estimate of each column, `bottom` and `top` the ends of the band of 3 sd, None where nothing is
    known. `converged` says of each column whether it was converged all the time; `newest` is the instant of the last
    estimate.
    """

    t: list[float]
    width: list[float]
    low: list[list[float | None]]
    high: list[list[float | None]]
    bottom: list[list[float | None]]
    top: list[list[float | None]]
    converged: list[list[bool]]
    newest: float | None


class HistorySnapshot(TypedDict):
    """The past of a run of samples, or the next piece of it; `run` tells runs apart.

    `estimates` has gyro biases (deg/s), then accelerometer biases (mg), `temperature` one column in degC. Of what is
    not `complete` there is more: ask with the last `t` of both.
    """

    run: int
    estimates: HistoryRows
    temperature: HistoryRows
    complete: bool


Floats = npt.NDArray[np.floating]
Flags = npt.NDArray[np.bool_]
CAPACITY = 1 << 13
_SECOND = 1.0
_BREAK_S = 3.0
_BREAK_STEPS = 5.0
_RECENT = 256
_DECIMALS = 6
_LOW, _HIGH, _BOTTOM, _TOP = range(4)
_KINDS = ("low", "high", "bottom", "top")


class EstimateHistory:
    """Extremes of estimates and of their bands, in rows of a second; the older half is thinned when it is full.

    Thinning joins pairs of the old rows whose spans are shortest, keeping minimum and maximum: a run of any length
    fits, its last part stays at 1 Hz, and no excursion is ever lost.

    `columns`: estimates of a row.
    `capacity`: rows kept; 2.2 h before the first thinning by default.
    """

    def __init__(self, columns: int, capacity: int = CAPACITY) -> None:
        self._t = np.zeros(capacity)
        self._width = np.zeros(capacity)
        self._rows = np.zeros((capacity, 4, columns), np.float32)
        self._converged = np.zeros((capacity, columns), bool)
        self._count = 0
        self._newest = -np.inf

    def __len__(self) -> int:
        return self._count

    @property
    def newest(self) -> float:
        """Instant of the last estimate, s; minus infinity without one."""
        return self._newest

    def add(self, t: float, values: Floats, sd3: Floats, converged: Flags | None = None) -> None:
        """Take estimates (columns,) and their three standard deviations, NaN where nothing is known.

        `t` is s since the run's first sample: an earlier instant is another run. `converged` is None for none.
        """
        self.add_all(np.array([t]), values[None], sd3[None], converged)

    def add_all(self, t: Floats, values: Floats, sd3: Floats, converged: Flags | None = None) -> None:
        """`add` of each of some rows of estimates, shapes (N,), (N, columns), (N, columns); `converged` is of all."""
        settled = np.zeros(values.shape[1], bool) if converged is None else converged
        rows = np.stack([values, values, values - sd3, values + sd3], axis=1)
        first = 0
        while first < t.size:
            if t[first] < self._newest:
                self._count = 0
            if not self._count or t[first] >= self._t[self._count - 1] + _SECOND:
                self._make_room(1)
                self._t[self._count], self._width[self._count] = t[first], _SECOND
                self._rows[self._count], self._converged[self._count] = rows[first], settled
                self._count += 1
            last = max(first + 1, int(np.searchsorted(t, self._t[self._count - 1] + _SECOND)))
            _widen(self._rows[self._count - 1], _extremes(rows[first:last]))
            self._converged[self._count - 1] &= settled
            self._newest = float(t[last - 1])
            first = last

    def rows(self, since: float | None, most: int) -> HistoryRows:
        """Rows for a viewer that has all before `since` (s; None: nothing), the row of that instant among them.

        Oldest first, and not more than `most`.
        """
        t = self.instants()
        first = 0 if since is None else max(int(np.searchsorted(t, since, "right")) - 1, 0)
        part = slice(first, min(first + most, self._count))
        columns = np.round(self._rows[part].astype(float), _DECIMALS)
        low, high, bottom, top = (_known(columns[:, kind]) for kind in range(4))
        return {
            "t": np.round(t[part], _DECIMALS).tolist(),
            "width": self._width[part].tolist(),
            "low": low,
            "high": high,
            "bottom": bottom,
            "top": top,
            "converged": self._converged[part].tolist(),
            "newest": float(self._newest) if self._count else None,
        }

    def extend(self, more: HistoryRows) -> None:
        """Take rows of another one, which go on where these end; its first row may be the last one of these."""
        t = np.array(more["t"], float)
        if not t.size:
            return
        rows = np.stack([np.array(_column(more, kind), np.float32) for kind in _KINDS], axis=1)
        converged, width = np.array(more["converged"], bool), np.array(more["width"], float)
        new = slice(0, None)
        if self._count and t[0] <= self._t[self._count - 1] + 10.0**-_DECIMALS:
            _widen(self._rows[self._count - 1], rows[0])
            self._converged[self._count - 1] &= converged[0]
            new = slice(1, None)
        count = t[new].size
        self._make_room(count)
        place = slice(self._count, self._count + count)
        self._t[place], self._width[place] = t[new], width[new]
        self._rows[place], self._converged[place] = rows[new], converged[new]
        self._count += count
        self._newest = float(self._t[self._count - 1]) if more["newest"] is None else more["newest"]

    def _make_room(self, count: int) -> None:
        while self._count + count > len(self._t):
            self._thin()

    def _thin(self) -> None:
        left = self._pairs()
        apart = np.where(self._pauses()[left], self._width[left], self._t[left + 1] - self._t[left])
        self._width[left] = apart + self._width[left + 1]
        self._converged[left] &= self._converged[left + 1]
        rows = self._rows[left]
        _widen(rows, self._rows[left + 1])
        self._rows[left] = rows
        kept = np.delete(np.arange(self._count), left + 1)
        for column in (self._t, self._width, self._rows, self._converged):
            column[: kept.size] = column[kept]
        self._count = kept.size

    def _pairs(self) -> npt.NDArray[np.int64]:
        """First rows of the pairs to join: of the older half, those that span least, none across a pause."""
        half = self._count // 2
        width, paused = self._width[:half], self._pauses()[: half - 1]
        enough = max(half // 8, 1)  # a thinning that pays for its copying
        for across in (paused, np.zeros_like(paused)):
            for level in np.unique(width):
                pairs = _adjacent(across, int(np.argmax(width <= level)))
                if pairs.size >= enough:
                    return pairs
        return np.array([0])

    def instants(self) -> Floats:
        """When the rows begin, (N,), s since the run's first sample; a view."""
        return self._t[: self._count]

    def estimate(self, column: int) -> tuple[Floats, Floats]:
        """Lowest and highest estimate of each row, (N,)."""
        return self._rows[: self._count, _LOW, column], self._rows[: self._count, _HIGH, column]

    def band(self, column: int) -> tuple[Floats, Floats]:
        """Lowest lower and highest upper end of the band of 3 sd, (N,)."""
        return self._rows[: self._count, _BOTTOM, column], self._rows[: self._count, _TOP, column]

    def converged(self, column: int) -> Flags:
        """Whether the estimate was converged all through each row, (N,)."""
        return self._converged[: self._count, column]

    def breaks(self) -> list[tuple[float, float]]:
        """Where nothing came: begin and end of each pause that is longer than the usual step between estimates, s."""
        t, width = self.instants(), self._width
        return [(float(t[k] + width[k]), float(t[k + 1])) for k in np.flatnonzero(self._pauses())]

    def _pauses(self) -> Flags:
        """Whether there is a pause between a row and the next one, (N - 1,)."""
        steps = np.diff(self.instants())
        if not steps.size:
            return np.zeros(0, bool)
        usual = max(_BREAK_S, _BREAK_STEPS * float(np.median(steps[-_RECENT:])))
        # a row of a second stands for as much, a joined one for the seconds that are in it
        return np.asarray(steps - self._width[: steps.size] > usual)

    def slope_per_minute(self, column: int, seconds: float = 60.0) -> float | None:
        """Straight line through the middles of the last seconds' rows; None before half of them have come."""
        first = int(np.searchsorted(self.instants(), self._newest - seconds))
        t = self.instants()[first:]
        if t.size < 3 or t[-1] - t[0] < seconds / 2:
            return None
        low, high = self.estimate(column)
        centred = t - t.mean()
        return float(60.0 * (centred @ (0.5 * (low[first:] + high[first:]))) / (centred @ centred))

    def frozen(self) -> "EstimateHistory":
        """A copy that stays as it is now."""
        copy = EstimateHistory(self._rows.shape[2], max(self._count, 1))
        copy._count, copy._newest = self._count, self._newest
        kept = slice(len(copy._t))
        copy._t[:], copy._width[:] = self._t[kept], self._width[kept]
        copy._rows[:], copy._converged[:] = self._rows[kept], self._converged[kept]
        return copy


def _widen(rows: npt.NDArray[np.float32], more: Floats) -> None:
    """Extremes of both, in place; unknown ones give way."""
    lows, highs = [_LOW, _BOTTOM], [_HIGH, _TOP]
    rows[..., lows, :] = np.fmin(rows[..., lows, :], more[..., lows, :])
    rows[..., highs, :] = np.fmax(rows[..., highs, :], more[..., highs, :])


def _extremes(rows: Floats) -> Floats:
    """Of several rows, (N, 4, columns)."""
    found = np.asarray(np.fmax.reduce(rows))
    found[[_LOW, _BOTTOM]] = np.fmin.reduce(rows[:, [_LOW, _BOTTOM]])
    return found


def _adjacent(paused: Flags, first: int) -> npt.NDArray[np.int64]:
    """First rows of pairs of neighbours, each row in one pair at most, none with a pause between them."""
    pairs, row = [], first
    while row < paused.size:
        if paused[row]:
            row += 1
        else:
            pairs.append(row)
            row += 2
    return np.array(pairs, np.int64)


def _known(values: Floats) -> list[list[float | None]]:
    """Numbers as JSON has them: None where there is none."""
    if not np.isnan(values).any():
        known: list[list[float | None]] = values.tolist()
        return known
    return [[None if value != value else value for value in row] for row in values.tolist()]


def _column(more: HistoryRows, kind: str) -> list[list[float | None]]:
    found = {"low": more["low"], "high": more["high"], "bottom": more["bottom"], "top": more["top"]}[kind]
    return [[np.nan if value is None else value for value in row] for row in found]
