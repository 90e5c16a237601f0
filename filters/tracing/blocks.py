"""Residuals averaged over blocks of a quarter of a second, with the inputs of every block.

The mean over a block of a regressor is the exact regressor of the mean residual: regressors of motion are taken at the
samples and averaged. What it leaves out: flags (`effects.faults`), what a perfect unit reads (`residual`), whitening.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.effects.inputs import FOLLOWED, Inputs, levered
from filters.effects.temperature import TemperatureHistory, ThermalMemory, history
from filters.tracing.residual import residual, sensed
from filters.tracing.run import Run
from filters.types import Array

BLOCK_S = 0.25  # length of a block, s
_SHARE_FLAGGED = 0.15
_AT_REST = np.deg2rad(0.01)
_BURSTS = 0.02
_CHUNK = 1 << 13
_AT_ONCE = 1 << 18


@dataclass(frozen=True, slots=True)
class SlowInputs:
    """Inputs with a memory, at the n blocks of a run: temperature, and what follows the table's motion."""

    temperature: TemperatureHistory
    since_motion: Array  # s since the table last moved (since the run's start if it never did), shape (n,)
    direction: Array  # sign of the last motion of each axis, 0 before the first, shape (n, 3)
    followed: Array  # what is sensed, once a block, shape (n, FOLLOWED), see `effects.inputs`

    def rows(self, blocks: NDArray[np.int_]) -> "SlowInputs":
        """Those of some blocks, by number, as often as named."""
        T = self.temperature
        picked = TemperatureHistory(T.level[blocks], T.rate[blocks], T.lagged[blocks], T.plays[blocks])
        return SlowInputs(picked, self.since_motion[blocks], self.direction[blocks], self.followed[blocks])


@dataclass(frozen=True)
class Blocks:
    """A run in blocks."""

    run: Run  # where they come from
    period: float  # length of a block, s
    t: Array  # middle of each, s since the power-on's first known sample, shape (n,)
    y: Array  # mean residual, shape (n, 6); 0 where there is no weight
    # share of the samples that were there and good, 0 to 1, shape (n, 6); 0 if more than 15 % were flagged
    weight: Array
    rough: Array  # sum of the squared differences of neighbouring samples, shape (n, 6), and
    pairs: Array  # how many, shape (n, 6)
    edges: NDArray[np.int_]  # first sample of each block, and the end, shape (n + 1,)
    slow_inputs: SlowInputs  # what has a memory

    def mean(self, columns: Sequence[tuple[Callable[[Inputs], Array], slice]], out: Array) -> None:
        """Block means of columns, functions of the drivers.

        `columns`: what gives the columns at the samples, shape (N, k), and where they go in `out`.
        `out`: shape (n, K), filled in place.
        """
        if self.run.still:
            inputs = self._inputs_at_rest()
            for f, place in columns:
                out[:, place] = f(inputs)
            return
        for first, last in self._chunks():
            inputs, edges = self._inputs_moving(first, last)
            counts = np.diff(np.append(edges, inputs.t.size))[:, None]
            for f, place in columns:
                out[first:last, place] = np.add.reduceat(f(inputs), edges, axis=0) / counts

    def at_samples(self, columns: Sequence[tuple[Callable[[Inputs], Array], int]], out: Array) -> None:
        """Functions of the drivers at the samples themselves, added to columns of `out`, shape (N, K).

        `columns`: what gives one value a sample, and the column it is added to.
        `out`: changed in place.
        """
        if self.run.still:
            inputs, number = self._inputs_at_rest(), np.repeat(np.arange(self.t.size), np.diff(self.edges))
            for f, place in columns:
                out[:, place] += f(inputs)[number]
            return
        for first, last in self._chunks():
            inputs, _ = self._inputs_moving(first, last)
            rows = slice(int(self.edges[first]), int(self.edges[last]))
            for f, place in columns:
                out[rows, place] += f(inputs)

    def slow(self) -> Inputs:
        """Drivers at the middle of the blocks, of which only time, temperature and what follows motion are meant."""
        return self._inputs_at_rest()

    def _chunks(self) -> list[tuple[int, int]]:
        """Ranges of blocks of about as many samples as fit a cache."""
        per = max(1, int(_CHUNK / max(1.0, self.run.t.size / self.t.size)))
        return [(k, min(k + per, self.t.size)) for k in range(0, self.t.size, per)]

    def _inputs_at_rest(self) -> Inputs:
        run, n = self.run, self.t.size
        true, zero = sensed(run, slice(0, 1)), np.zeros((1, 3))
        return _inputs(
            self.slow_inputs,
            t=self.t,
            x=np.broadcast_to(true.reading, (n, 6)),
            x_dot=np.zeros((n, 6)),
            spin=np.broadcast_to(true.spin, (n, 3)),
            horizontal=np.broadcast_to(true.tilt, (n, 3, 2)),
            centripetal=np.zeros((n, 3, 3)),
            angles=np.broadcast_to(run.angles[:1], (n, 3)),
            rates=np.broadcast_to(zero, (n, 3)),
            table_accel=np.zeros(n),
        )

    def _inputs_moving(self, first: int, last: int) -> tuple[Inputs, NDArray[np.int_]]:
        """Drivers at the samples of blocks `first` to `last`, and where the blocks begin in them."""
        run, edges = self.run, self.edges
        begin, end = int(edges[first]), int(edges[last])
        # differences at the ends need a neighbour
        low, high = max(0, begin - 1), min(run.t.size, end + 1)
        true = sensed(run, slice(low, high))
        t, rates = run.t[low:high], run.rates[low:high]
        x_dot, turning_dot, rates_dot = (_slope(values, t) for values in (true.reading, true.turning, rates))
        inner = slice(begin - low, begin - low + end - begin)
        of = np.repeat(np.arange(first, last), np.diff(edges[first : last + 1]))
        inputs = _inputs(
            self.slow_inputs.rows(of),
            t=run.begins + t[inner],
            x=true.reading[inner] - run.latency * x_dot[inner],
            x_dot=x_dot[inner],
            spin=true.spin[inner],
            horizontal=true.tilt[inner],
            centripetal=levered(run.axes, true.turning[inner], turning_dot[inner]),
            angles=run.angles[begin:end],
            rates=rates[inner],
            table_accel=np.linalg.norm(rates_dot, axis=1)[inner],
        )
        return inputs, edges[first:last] - begin


def _inputs(slow: SlowInputs, **fast: Array) -> Inputs:
    """Inputs of some instants from what has a memory and from what is there at once."""
    T = slow.temperature
    return Inputs(
        temperature=T.level,
        temperature_rate=T.rate,
        lagged=T.lagged,
        plays=T.plays,
        since_motion=slow.since_motion,
        direction=slow.direction,
        followed=slow.followed,
        **fast,
    )


def _slope(values: Array, t: Array) -> Array:
    """Derivative by differences, shape as `values`; 0 of a single sample."""
    return np.asarray(np.gradient(values, t, axis=0)) if t.size > 1 else np.zeros_like(values)


def average(run: Run, block_s: float = BLOCK_S, before: ThermalMemory | None = None) -> Blocks:
    """Average a run.

    `block_s`: wanted length, s; a whole number of samples is taken, at least one.
    `before`: what the part before it in its power-on hands on.
    """
    per = max(1, round(block_s * run.rate_hz))
    period = per / run.rate_hz
    t = even_time(run)
    edges = _edges(t, period)
    counts = np.diff(edges)
    y, good, rough, pairs = (np.empty((counts.size, 6)) for _ in range(4))
    for first in range(0, counts.size, max(1, _CHUNK // per)):
        last = min(first + max(1, _CHUNK // per), counts.size)
        rows = slice(first, last)
        y[rows], good[rows], rough[rows], pairs[rows] = _means(run, edges[first : last + 1])
    share = good / np.maximum(per, counts)[:, None]
    weight = np.where(good < (1.0 - _SHARE_FLAGGED) * counts[:, None], 0.0, share)
    mid = run.begins + np.add.reduceat(t, edges[:-1]) / counts
    return Blocks(
        run=run,
        period=period,
        t=mid,
        y=np.where(weight > 0.0, y, 0.0),
        weight=weight,
        rough=rough,
        pairs=pairs,
        edges=edges,
        slow_inputs=_slow_inputs(run, mid, period, edges, before),
    )


def average_all(runs: Sequence[Run], block_s: float = BLOCK_S) -> list[Blocks]:
    """Average runs, of which parts of one power-on go on from each other's temperature; in the order given.

    `runs`: whole power-ons and parts.
    `block_s`: wanted length, s.
    """
    out: dict[int, Blocks] = {}
    known: dict[str, ThermalMemory | None] = {}
    for number, run in sorted(enumerate(runs), key=lambda each: each[1].begins):
        made = average(run, block_s, known.get(run.power_on))
        if run.power_on:
            known[run.power_on] = made.slow_inputs.temperature.end or known.get(run.power_on)
        out[number] = made
    return [out[number] for number in range(len(runs))]


def _edges(t: Array, period: float) -> NDArray[np.int_]:
    """First sample of each block, and the end; samples are gone through in parts, for a day has millions."""
    found, last = [], -1
    for first in range(0, t.size, _AT_ONCE):
        number = np.floor((t[first : first + _AT_ONCE] - t[0]) / period + 1e-6).astype(np.int64)
        found.append(first + np.flatnonzero(np.diff(number, prepend=last)))
        last = int(number[-1])
    return np.append(np.concatenate(found), t.size)


def even_time(run: Run) -> Array:
    """Time base: the stamps, unless they come in bursts, then the mean rate's."""
    T = 1.0 / run.rate_hz
    off = 0
    for first in range(0, run.t.size, _AT_ONCE):
        off += int(np.count_nonzero(np.abs(np.diff(run.t[first : first + _AT_ONCE + 1]) - T) > 0.5 * T))
    bursts = off > _BURSTS * (run.t.size - 1)
    return np.asarray(np.arange(run.t.size) * T, np.float64) if bursts else run.t


def _means(run: Run, edges: NDArray[np.int_]) -> tuple[Array, Array, Array, Array]:
    """Means, numbers of good samples, sums of squared differences and their numbers, of some blocks."""
    begin, end = int(edges[0]), int(edges[-1])
    low = max(0, begin - 1)
    r = residual(run, slice(low, min(run.t.size, end + 1)))[begin - low :][: end - begin]
    good = np.isfinite(r)
    starts = edges[:-1] - begin
    counts = np.add.reduceat(good.astype(np.float64), starts, axis=0)
    means = np.add.reduceat(np.where(good, r, 0.0), starts, axis=0) / np.maximum(counts, 1.0)
    steps = np.diff(r, axis=0, prepend=np.nan)
    paired = np.isfinite(steps)
    paired[starts] = False
    rough = np.add.reduceat(np.where(paired, steps, 0.0) ** 2, starts, axis=0)
    return means, counts, rough, np.add.reduceat(paired.astype(np.float64), starts, axis=0)


def _slow_inputs(
    run: Run, t: Array, period: float, edges: NDArray[np.int_], before: ThermalMemory | None
) -> SlowInputs:
    """Inputs with a memory, at the blocks."""
    past = history(run.temperature, t, period, edges, before)
    if run.still:
        return SlowInputs(past, t - run.begins, np.zeros((t.size, 3)), np.zeros((t.size, len(FOLLOWED))))
    rates = np.add.reduceat(run.rates, edges[:-1], axis=0) / np.diff(edges)[:, None]
    moves = np.abs(rates) > _AT_REST
    direction = _last_sign(np.where(moves, np.sign(rates), 0.0))
    return SlowInputs(past, _since(t, moves.any(axis=1)), direction, _followed(run, t))


def _followed(run: Run, t: Array) -> Array:
    """What is sensed in the middle of each block, which is short beside what operators remember; (n, FOLLOWED)."""
    per = max(1, round(run.t.size / t.size))
    x = sensed(run, slice(per // 2, None, per)).reading
    at = run.begins + run.t[per // 2 :: per]
    known = np.isfinite(x).all(axis=1)
    if not known.any():
        return np.full((t.size, len(FOLLOWED)), np.nan)
    values = np.column_stack([x, np.linalg.norm(x[:, :3], axis=1)])[known]
    return np.stack([np.interp(t, at[known], own) for own in values.T], axis=1)


def _since(t: Array, moves: NDArray[np.bool_]) -> Array:
    last = np.maximum.accumulate(np.where(moves, np.arange(t.size), -1))
    return t - np.where(last >= 0, t[np.maximum(last, 0)], t[0])


def _last_sign(signs: Array) -> Array:
    rows = np.maximum.accumulate(np.where(signs != 0.0, np.arange(len(signs))[:, None], -1), axis=0)
    return np.where(rows >= 0, np.take_along_axis(signs, np.maximum(rows, 0), axis=0), 0.0)
