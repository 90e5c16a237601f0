"""What the level of the noise follows: the same greedy fit, on the log variance of first differences in 2 s windows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.allan import CHI2_MEDIAN
from filters.effects.drivers import Driver
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design
from filters.tracing.stack import FOLDS
from filters.types import Array

_Bools = NDArray[np.bool_]

WINDOW_S = 2.0
_ACCEPT = 14.0
_TERMS = 3
_LEAST_RATIO = 1.08
_LEAST_WINDOWS = 64
_MULTIPLIERS = (0.05, 20.0)


@dataclass(frozen=True, slots=True)
class NoiseDriver:
    """A driver of a channel's noise: standard deviation from `low` to `high` of its median over the data.

    `knots` and `at`: values of the driver, in its unit, and the relative standard deviation there; empty for a driver
    that is no scalar.
    """

    channel: int
    driver: str
    low: float
    high: float
    score: float
    knots: tuple[float, ...] = ()
    at: tuple[float, ...] = ()

    @property
    def ratio(self) -> float:
        """Greatest over least standard deviation."""
        return self.high / self.low


def _may_drive(h: Driver) -> bool:
    """Whether noise is tried to follow a driver: of forms of one step or bend a curve over the same is enough."""
    return h.kind == "lag" or not (h.chain or h.kind == "threshold")


def noise_drivers(design: Design, channels: list[int]) -> tuple[Array, list[NoiseDriver]]:
    """Multipliers of the noise of every block, and what they follow.

    `design`: columns of the drivers.
    Returns shape (n, 6), 1 where the noise is even.
    """
    multiplier, found = np.ones_like(design.stack.y), []
    edges = _window_edges(design)
    counts = np.diff(np.append(edges, design.stack.t.size))[:, None]
    means = np.add.reduceat(design.columns, edges, axis=0) / counts
    for c in channels:
        usable = [
            a for a in design.terms if list(a.places) == [c] and isinstance(h := a.hypothesis, Driver) and _may_drive(h)
        ]
        fitted, own = _channel(design, _windows(design, c, edges, means), usable)
        multiplier[:, c] = fitted
        found += own
    return multiplier, found


@dataclass(frozen=True)
class _Windows:
    """One channel in windows of 2 s."""

    channel: int
    log_variance: Array  # of first differences, less its median over the good windows, shape (W,)
    columns: Array  # means of the design's columns, shape (W, K)
    good: _Bools  # windows with enough differences, shape (W,)
    sd: float  # of `log_variance` in even noise
    cell: NDArray[np.int_]  # number of the cell for folds, shape (W,)

    def centred(self, term: Term) -> Array:
        """Columns of a term less their means over the good windows, shape (W, k)."""
        columns = self.columns[:, term.places[self.channel]]
        return np.asarray(columns - columns[self.good].mean(axis=0))

    def gain(self, base: Array, own: Array) -> float:
        """Drop of chi-square when columns join a base, both of shape (W, …)."""
        y, part = self.log_variance[self.good], base[self.good]
        both = np.column_stack([part, own[self.good]])
        r0, r1 = (y - X @ _theta(X, y) for X in (part, both))
        return float(r0 @ r0 - r1 @ r1) / self.sd**2

    def holds(self, base: Array, own: Array, gain: float) -> bool:
        """Whether columns gain on cells that the fit has not seen."""
        y, both = self.log_variance, np.column_stack([base, own])
        total = 0.0
        for fold in range(FOLDS):
            train, test = self.good & (self.cell % FOLDS != fold), self.good & (self.cell % FOLDS == fold)
            if train.sum() < both.shape[1] + 8 or not test.any():
                return False
            before, after = (y[test] - X[test] @ _theta(X[train], y[train]) for X in (base, both))
            total += float(before @ before - after @ after) / self.sd**2
        return total > 0.5 * gain


def _channel(design: Design, windows: _Windows | None, terms: list[Term]) -> tuple[Array, list[NoiseDriver]]:
    """Multiplier of the noise of every block of a channel, shape (n,), and what it follows."""
    even = np.ones(design.stack.t.size)
    if windows is None or not terms:
        return even, []
    log_seconds = float(np.log(design.stack.seconds(windows.channel)))
    base = np.ones((windows.log_variance.size, 1))
    chosen: list[Term] = []
    found: list[NoiseDriver] = []
    for _ in range(_TERMS):
        taken = {a.hypothesis.effect for a in chosen}
        best, score = _best(windows, [a for a in terms if a.hypothesis.effect not in taken], base, log_seconds)
        if best is None:
            break
        chosen.append(best)
        base = np.column_stack([base, windows.centred(best)])
        theta = _theta(base[windows.good], windows.log_variance[windows.good])
        found.append(_driver(windows, best, theta[-best.size :], score))
    if not chosen:
        return even, []
    return _multiplier(design, windows, chosen, theta), [driver for driver in found if driver.ratio > _LEAST_RATIO]


def _window_edges(design: Design) -> NDArray[np.int_]:
    """First block of each window of 2 s, shape (W,); the same on all channels."""
    stack = design.stack
    # of two blocks at least, for the differences of one are too few
    per = max(2, round(WINDOW_S / stack.period))
    label = stack.run * (1 << 40) + stack.part_t.astype(np.int64) // max(1, round(per * stack.period))
    return np.flatnonzero(np.diff(label, prepend=-1))


def _windows(design: Design, c: int, edges: NDArray[np.int_], means: Array) -> _Windows | None:
    """A channel's windows; None with too few good ones. `means` of the design's columns, shape (W, K)."""
    stack = design.stack
    rough = np.add.reduceat(np.concatenate([b.rough[:, c] for b in stack.blocks]), edges)
    pairs = np.add.reduceat(np.concatenate([b.pairs[:, c] for b in stack.blocks]), edges)
    good = (pairs >= 8) & (rough > 0.0)
    if good.sum() < _LEAST_WINDOWS:
        return None
    v = np.log(np.where(good, rough, 1.0) / np.maximum(pairs, 1.0))
    steps = np.diff(v)[good[1:] & good[:-1]]
    sd = np.sqrt(np.median(steps**2) / CHI2_MEDIAN / 2.0)
    return _Windows(
        channel=c,
        log_variance=v - np.median(v[good]),
        columns=means,
        good=good,
        sd=max(sd, 1e-3),
        cell=stack.cell[edges],
    )


def _best(windows: _Windows, terms: list[Term], base: Array, log_seconds: float) -> tuple[Term | None, float]:
    """The term of the best score that holds on unseen cells, and its score; None if none is accepted."""
    best, best_score = None, _ACCEPT
    for term in terms:
        own = windows.centred(term)
        gain = windows.gain(base, own)
        score = gain - term.size * log_seconds - 2.0 * float(np.log(term.hypothesis.grid))
        if score > best_score and windows.holds(base, own, gain):
            best, best_score = term, score
    return best, best_score


def _driver(windows: _Windows, term: Term, theta: Array, score: float) -> NoiseDriver:
    """What a chosen term says of the noise."""
    part = (windows.centred(term) @ theta)[windows.good]
    low, high = np.exp(0.5 * np.quantile(part - np.median(part), [0.0, 1.0]))
    h, at = term.hypothesis, np.zeros(0)
    knots: tuple[float, ...] = ()
    if isinstance(h, Driver) and h.kind == "hat":
        whole = windows.columns[windows.good][:, term.places[windows.channel]] @ theta
        knots, at = h.knots, np.exp(0.5 * (np.append(0.0, theta) - np.median(whole)))
    return NoiseDriver(
        channel=windows.channel,
        driver=h.effect.removeprefix("driver:").rpartition("(")[2].rstrip(")"),
        low=float(low),
        high=float(high),
        score=score,
        knots=knots,
        at=tuple(np.clip(at, *_MULTIPLIERS).tolist()),
    )


def _multiplier(design: Design, windows: _Windows, chosen: list[Term], theta: Array) -> Array:
    """Of every block, 1 in the median, shape (n,)."""
    raw = np.ones(design.stack.t.size) * theta[0]
    first = 1
    for term in chosen:
        columns = design.columns[:, term.places[windows.channel]]
        centre = windows.columns[windows.good][:, term.places[windows.channel]].mean(axis=0)
        raw = raw + (columns - centre) @ theta[first : first + term.size]
        first += term.size
    return np.asarray(np.clip(np.exp(0.5 * (raw - np.median(raw))), *_MULTIPLIERS))


def _theta(X: Array, y: Array) -> Array:
    return np.asarray(np.linalg.lstsq(X, y, rcond=1e-10)[0])
