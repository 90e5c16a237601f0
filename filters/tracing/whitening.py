"""The bias filter that whitens residuals and regressors alike, and the likelihood of drift.

Model of a channel:  r_k = b_run + g_k + sum θ φ_k + v_k,  v white with standard deviation sd_k, g nothing, a random
walk or a Gauss-Markov process, b diffuse at the start of each power-on. A two-state Kalman filter [b, g] runs once over
r and, with the same gains, over every column of φ; normalised innovations turn generalised into ordinary least squares,
with the exact likelihood. Without g it is the paper's model of a constant bias.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.compilation import cached_njit
from filters.types import Array

TAUS = (2.0, 5.0, 12.0, 30.0, 80.0, 250.0, 1000.0, np.inf)
"""Time constants of drift that are tried, s; infinity is a random walk."""
LEVELS = (0.02, 0.04, 0.08, 0.15, 0.3, 0.6, 1.2, 2.5, 5.0)
"""Standard deviations of drift that are tried, over that of the white noise in 1 s; of a walk, after 100 s."""

_DIFFUSE = 1e8
_COARSE_TAUS, _COARSE_LEVELS, _STARTS = 3, 3, 2
_WALK_S = 100.0


@dataclass(frozen=True, slots=True)
class Drift:
    """A drift process: Gauss-Markov of standard deviation `level` (SI) and `tau` s; a walk of level/√s if infinite."""

    tau: float
    level: float

    @property
    def is_walk(self) -> bool:
        """Whether it is a random walk."""
        return bool(np.isinf(self.tau))

    @property
    def kind(self) -> str:
        """Its name in the catalogue."""
        return "random_walk" if self.is_walk else "gauss_markov"


NONE = Drift(1.0, 0.0)  # no drift


@cached_njit
def _whiten(columns, t, starts, variance, tau, level, out, held, at, b, g, state):  # type: ignore[no-untyped-def]
    """Normalised innovations of every column into `out`; returns the sum of log innovation variances.

    b and g that are foretold of each row's first column go into `held`, shape (n, 2), if it is not empty.

    Of rows from number `at` on; b, g, shape (k,), and `state` (P00, P01, P11, 1 if any was seen, time) are those after
    the row before, zeros at row 0, and become those after the last.
    """
    n, k = columns.shape
    log_det = 0.0
    P00, P01, P11 = state[0], state[1], state[2]
    seen = state[3] > 0.0
    last = state[4]
    walk = np.isinf(tau)
    s = np.searchsorted(starts, at)
    for i in range(n):
        if s < starts.size and at + i == starts[s]:
            s += 1
            b[:] = 0.0
            g[:] = 0.0
            P00, P01, P11 = 0.0, 0.0, 0.0 if walk else level * level
            seen = False
            last = t[i]
        dt = t[i] - last
        last = t[i]
        if dt > 0.0 and level > 0.0:
            if walk:
                P11 += level * level * dt
            else:
                phi = np.exp(-dt / tau)
                P01 *= phi
                P11 = phi * phi * P11 + level * level * (1.0 - phi * phi)
                for j in range(k):
                    g[j] *= phi
        if held.size > 0:
            held[i, 0], held[i, 1] = b[0], g[0]
        r = variance[i]
        if not np.isfinite(r):
            for j in range(k):
                out[i, j] = 0.0
            continue
        if not seen:
            # a diffuse bias: what the first block says is the bias, and nothing about it is surprising
            seen = True
            P00, P01 = _DIFFUSE * (r + P11), 0.0
        S = P00 + 2.0 * P01 + P11 + r
        K0, K1 = (P00 + P01) / S, (P01 + P11) / S
        first = 0.5 * _DIFFUSE * r < P00
        scale = 0.0 if first else 1.0 / np.sqrt(S)
        if not first:
            log_det += np.log(S)
        for j in range(k):
            nu = columns[i, j] - b[j] - g[j]
            out[i, j] = nu * scale
            b[j] += K0 * nu
            g[j] += K1 * nu
        h0, h1 = P00 + P01, P01 + P11
        P00 -= K0 * h0
        P01 -= K0 * h1
        P11 -= K1 * h1
    state[0], state[1], state[2] = P00, P01, P11
    state[3], state[4] = 1.0 if seen else 0.0, last
    return log_det


def whiten(
    columns: Array, t: Array, starts: NDArray[np.int_], variance: Array, drift: Drift = NONE, held: Array | None = None
) -> tuple[Array, float]:
    """Whiten columns.

    `columns`: residual and regressors, shape (n, k).
    `t`: s, shape (n,), increasing within a power-on.
    `starts`: first row of each power-on: bias and drift begin anew there, and go on through a gap anywhere else.
    `variance`: of the white noise of each row, shape (n,); infinite where there is no data.
    `drift`: what g is.
    `held`: becomes bias and drift that are foretold of each row of the first column, shape (n, 2).
    Returns normalised innovations, shape (n, k), zero where there is none; sum of the logarithms of their variances.
    """
    whitener = _Whitener(t, starts, variance, drift)
    return whitener.next(columns, held), whitener.log_det


class _Whitener:
    """Whitens columns that come in consecutive parts; arguments as of `whiten`, of all rows."""

    def __init__(self, t: Array, starts: NDArray[np.int_], variance: Array, drift: Drift) -> None:
        self._rows, self._drift = (t, starts, variance), drift
        self._at, self._state, self._bg = 0, np.zeros(5), np.zeros((2, 0))
        self.log_det = 0.0

    def next(self, columns: Array, held: Array | None = None) -> Array:
        """Normalised innovations of the rows that follow, shape (m, k)."""
        if self._at == 0:
            self._bg = np.zeros((2, columns.shape[1]))
        t, starts, variance = self._rows
        rows, out = slice(self._at, self._at + len(columns)), np.empty(columns.shape)
        held = np.zeros((0, 2)) if held is None else held
        shared = starts, variance[rows], self._drift.tau, self._drift.level, out, held, self._at, *self._bg, self._state
        self.log_det += float(_whiten(np.ascontiguousarray(columns), t[rows], *shared))
        self._at = rows.stop
        return out


def whitened_parts(
    parts: Iterable[Array], t: Array, starts: NDArray[np.int_], variance: Array, drift: Drift
) -> Iterator[Array]:
    """Normalised innovations of columns that come in parts, row after row, as `whiten` gives them of all at once."""
    whitener = _Whitener(t, starts, variance, drift)
    return (whitener.next(part) for part in parts)


def unbiased(columns: Array, run: NDArray[np.int_], variance: Array) -> Array:
    """Columns over their standard deviations, less each run's weighted mean: `whiten` without drift, in closed form."""
    precision = 1.0 / variance
    total = np.maximum(np.bincount(run, precision), 1e-300)
    mean = _sums(columns, run, precision, total.size) / total[:, None]
    return np.asarray(np.sqrt(precision)[:, None] * (columns - mean[run]))


def _sums(columns: Array, run: NDArray[np.int_], weight: Array, count: int) -> Array:
    """Weighted sum of each column over each run, shape (count, k)."""
    of_run = np.zeros((count, run.size))
    of_run[run, np.arange(run.size)] = weight
    return of_run @ columns


def unbiased_parts(
    parts: Callable[[], Iterator[tuple[slice, Array]]], run: NDArray[np.int_], variance: Array
) -> Iterator[Array]:
    """The same of columns that come in parts, rows with their columns, and are gone through twice."""
    precision = 1.0 / variance
    total = np.maximum(np.bincount(run, precision), 1e-300)
    sums = sum(_sums(part, run[rows], precision[rows], total.size) for rows, part in parts())
    mean = sums / total[:, None]
    root = np.sqrt(precision)
    for rows, part in parts():
        part -= mean[run[rows]]
        part *= root[rows, None]
        yield part


def inverse_root(squares: Array) -> Array:
    """One over the root of what is positive, 0 of a column that is nowhere to be seen."""
    return np.where(squares > 0.0, 1.0 / np.sqrt(np.where(squares > 0.0, squares, 1.0)), 0.0)


def profile(whitened: Array) -> float:
    """Squared norm of the first column after the others were fitted to it."""
    gram = whitened.T @ whitened
    own = np.diag(gram)[1:]
    if not own.size:
        return float(gram[0, 0])
    scale = inverse_root(own)
    right = gram[1:, 0] * scale
    theta = np.linalg.lstsq(gram[1:, 1:] * np.outer(scale, scale), right, rcond=1e-10)[0]
    return float(gram[0, 0] - right @ theta)


@dataclass(frozen=True)
class Rows:
    """Means of a channel over some seconds: the residual, columns of what is selected, then others."""

    values: Array  # SI, shape (n, 1 + selected + k)
    t: Array  # s since power-on, shape (n,)
    starts: NDArray[np.int_]  # first row of each power-on
    variance: Array  # of the white noise of each row, infinite where there is no data, shape (n,)
    seconds: float  # length of a row
    selected: int = 0  # how many columns of what is selected there are

    @property
    def unit(self) -> float:
        """Standard deviation of the white noise in 1 s."""
        return float(np.sqrt(np.median(self.variance[np.isfinite(self.variance)]) * self.seconds))

    def whitened(self, drift: Drift) -> tuple[Array, float]:
        """As of `whiten`."""
        return whiten(self.values, self.t, self.starts, self.variance, drift)

    def minus_two_log(self, drift: Drift) -> float:
        """-2 log likelihood under a drift, all regressors fitted."""
        out, log_det = self.whitened(drift)
        return profile(out) + log_det


def drift_grid(unit: float, taus: Sequence[float] = TAUS) -> list[Drift]:
    """Drifts that are tried, for white noise of `unit` in 1 s."""
    return [Drift(tau, level * unit / (np.sqrt(_WALK_S) if np.isinf(tau) else 1.0)) for tau in taus for level in LEVELS]


def best_drift(rows: Rows, taus: Sequence[float] = TAUS) -> tuple[float, Drift, float]:
    """Most likely drift of a channel whose regressors are fitted anew for each of the time constants `taus`, s.

    Returns -2 log likelihood of the best, the best, -2 log likelihood without drift.
    """
    grid = drift_grid(rows.unit, taus)
    best, k = _least(lambda k: rows.minus_two_log(grid[k]), len(taus))
    return best, grid[k], rows.minus_two_log(NONE)


def _least(value: Callable[[int], float], taus: int) -> tuple[float, int]:
    """Least value over the grid of drifts, and its number: from a few of them downhill, for it is smooth."""
    known: dict[tuple[int, int], float] = {}

    def at(i: int, j: int) -> float:
        if (i, j) not in known:
            known[i, j] = value(i * len(LEVELS) + j)
        return known[i, j]

    for i in sorted({*range(0, taus, _COARSE_TAUS), taus - 1}):
        for j in range(_COARSE_LEVELS // 2, len(LEVELS), _COARSE_LEVELS):
            at(i, j)
    for start in sorted(known, key=lambda cell: known[cell])[:_STARTS]:
        here, moved = start, True
        while moved:
            i, j = here
            near = [(i + a, j + b) for a in (-1, 0, 1) for b in (-1, 0, 1)]
            near = [(a, b) for a, b in near if 0 <= a < taus and 0 <= b < len(LEVELS)]
            best = min(near, key=lambda cell: at(*cell))
            here, moved = best, known[best] < known[here]
    i, j = min(known, key=lambda cell: known[cell])
    return known[i, j], i * len(LEVELS) + j


def refined(rows: Rows, found: Drift, best: float) -> Drift:
    """The best drift of the grid, of -2 log likelihood `best`, with level and time constant between the grid's.

    They are where parabolas through -2 log L are least. A level of the grid is up to √2 wrong, and so then is every
    covariance that is made of it.
    """

    def at(place: Array) -> float:
        tau, level = np.exp(place).tolist()
        return rows.minus_two_log(Drift(tau, level))

    place, value = np.log([found.tau, found.level]), best
    # level with the time constant: the rate at which the drift grows is known best
    ways = [np.array([0.0, 0.35])] if found.is_walk else [np.array([0.0, 0.35]), np.array([0.4, 0.2])]
    for way in ways * 2:
        ends = [at(place + sign * way) for sign in (-1.0, 1.0)]
        bend = ends[0] - 2.0 * value + ends[1]
        step = float(np.clip(0.5 * (ends[0] - ends[1]) / bend, -1.5, 1.5)) if bend > 0.0 else 0.0
        tried = at(place + step * way)
        if tried < value:
            place, value = place + step * way, tried
    return Drift(found.tau if found.is_walk else float(np.exp(place[0])), float(np.exp(place[1])))
