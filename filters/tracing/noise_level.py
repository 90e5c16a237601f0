"""What the level of the noise follows: the same greedy fit, on the log variance of first differences in 2 s windows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.effects.drivers import Driver
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design
from filters.tracing.stack import CHI2_MEDIAN, FOLDS
from filters.types import Array

_Bools = NDArray[np.bool_]

WINDOW_S = 2.0
_ACCEPT = 14.0
_TERMS = 3
_LEAST_RATIO = 1.08


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


def noise_drivers(design: Design, channels: list[int]) -> tuple[Array, list[NoiseDriver]]:
    """Multipliers of the noise of every block, and what they follow.

    Parameters
    ----------
    design : Design
        Columns of the drivers.
    channels : list of int
        Those with data.

    Returns
    -------
    Array
        Shape (n, 6), 1 where the noise is even.
    list of NoiseDriver
    """
    multiplier, found = np.ones_like(design.stack.y), []
    for c in channels:
        terms = [a for a in design.terms if isinstance(a.hypothesis, Driver) and list(a.places) == [c]]
        fitted, own = _channel(design, c, [a for a in terms if a.hypothesis.effect != "driver:temperature_threshold"])
        multiplier[:, c] = fitted
        found += own
    return multiplier, found


def _channel(design: Design, c: int, terms: list[Term]) -> tuple[Array, list[NoiseDriver]]:
    stack = design.stack
    even = np.ones(stack.t.size)
    per = max(1, round(WINDOW_S / stack.period))
    label = stack.run * (1 << 40) + stack.t.astype(np.int64) // max(1, round(per * stack.period))
    edges = np.flatnonzero(np.diff(label, prepend=-1))
    rough = np.add.reduceat(np.concatenate([b.rough[:, c] for b in stack.blocks]), edges)
    pairs = np.add.reduceat(np.concatenate([b.pairs[:, c] for b in stack.blocks]), edges)
    good = (pairs >= 8) & (rough > 0.0)
    if good.sum() < 64 or not terms:
        return even, []
    v = np.log(np.where(good, rough, 1.0) / np.maximum(pairs, 1.0))
    counts = np.diff(np.append(edges, stack.t.size))[:, None]
    X = np.add.reduceat(design.columns, edges, axis=0) / counts
    steps = np.diff(v)[good[1:] & good[:-1]]
    sd = np.sqrt(np.median(steps**2) / CHI2_MEDIAN / 2.0)
    return _greedy(design, c, terms, v, X, good, max(sd, 1e-3), stack.cell[edges])


def _greedy(
    design: Design, c: int, terms: list[Term], v: Array, X: Array, good: _Bools, sd: float, cell: NDArray[np.int_]
) -> tuple[Array, list[NoiseDriver]]:
    use = good
    mean = np.median(v[use])
    base = np.ones((v.size, 1))
    chosen: list[Term] = []
    found: list[NoiseDriver] = []
    log_n = np.log(design.stack.seconds(c))
    for _ in range(_TERMS):
        best, best_score = None, _ACCEPT
        for term in terms:
            if any(a.hypothesis.effect == term.hypothesis.effect for a in chosen):
                continue
            own = _centred(X[:, term.places[c]], use)
            gain = _gain(base, own, v - mean, use, sd)
            score = gain - term.size * log_n - 2.0 * float(np.log(term.hypothesis.grid))
            if score > best_score and _holds(base, own, v - mean, use, sd, cell, gain):
                best, best_score = term, score
        if best is None:
            break
        own = _centred(X[:, best.places[c]], use)
        base = np.column_stack([base, own])
        theta = _theta(base[use], v[use] - mean)
        part = own @ theta[-own.shape[1] :]
        low, high = np.exp(0.5 * np.quantile(part[use] - np.median(part[use]), [0.0, 1.0]))
        chosen.append(best)
        curve = _curve(best, theta[-own.shape[1] :], X[:, best.places[c]], use)
        name = best.hypothesis.effect.removeprefix("driver:")
        found.append(NoiseDriver(c, name, float(low), float(high), best_score, *curve))
    if not chosen:
        return np.ones(design.stack.t.size), []
    theta = _theta(base[use], v[use] - mean)
    raw = np.ones(design.stack.t.size) * theta[0]
    at = 1
    for term in chosen:
        columns = design.columns[:, term.places[c]]
        centre = X[use][:, term.places[c]].mean(axis=0)
        raw = raw + (columns - centre) @ theta[at : at + term.size]
        at += term.size
    fitted = np.exp(0.5 * (raw - np.median(raw)))
    return np.clip(fitted, 0.05, 20.0), [level for level in found if level.ratio > _LEAST_RATIO]


def _curve(term: Term, theta: Array, columns: Array, use: _Bools) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Relative standard deviation at the knots of a scalar driver."""
    h = term.hypothesis
    if not isinstance(h, Driver) or h.kind != "hat":
        return (), ()
    part = columns[use] @ theta
    at = np.exp(0.5 * (np.append(0.0, theta) - np.median(part)))
    return h.knots, tuple(np.clip(at, 0.05, 20.0).tolist())


def _centred(columns: Array, use: _Bools) -> Array:
    return np.asarray(columns - columns[use].mean(axis=0))


def _theta(X: Array, y: Array) -> Array:
    return np.asarray(np.linalg.lstsq(X, y, rcond=1e-10)[0])


def _gain(base: Array, own: Array, y: Array, use: _Bools, sd: float) -> float:
    rows = use
    part, both = base[rows], np.column_stack([base[rows], own[rows]])
    r0 = y[rows] - part @ _theta(part, y[rows])
    r1 = y[rows] - both @ _theta(both, y[rows])
    return float(r0 @ r0 - r1 @ r1) / sd**2


def _holds(base: Array, own: Array, y: Array, use: _Bools, sd: float, cell: NDArray[np.int_], gain: float) -> bool:
    """Whether it gains on cells that the fit has not seen."""
    rows = use
    both = np.column_stack([base, own])
    total = 0.0
    for fold in range(FOLDS):
        train, test = rows & (cell % FOLDS != fold), rows & (cell % FOLDS == fold)
        if train.sum() < both.shape[1] + 8 or not test.any():
            return False
        before = y[test] - base[test] @ _theta(base[train], y[train])
        after = y[test] - both[test] @ _theta(both[train], y[train])
        total += float(before @ before - after @ after) / sd**2
    return total > 0.5 * gain
