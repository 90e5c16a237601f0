"""What thermal effects are functions of: temperature, its rate, lags and play operators.

Two front ends: `history` has a whole run, in blocks, and smooths symmetrically in time; `CausalTemperature` has the
past alone, unless it is told what is to come. What remembers temperature is the same for both. It goes on from one part
of a power-on to the next, between which temperature is taken to have gone by a straight line.
"""

import json
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.compilation import cached_njit
from filters.effects.inputs import BANKS, LAGS, PLAY_HALF_WIDTHS, PLAYS_AT_START, SLOPE_S, SMOOTH_S
from filters.errors import InputError
from filters.first_order import first_order
from filters.types import Array


@dataclass(frozen=True, slots=True)
class TemperatureHistory:
    """Temperature at n blocks or samples, and what remembers it; NaN without a temperature."""

    # level, rate: degC and K/s, shape (n,)
    level: Array
    rate: Array
    # lagged, plays: as in `filters.effects.inputs.Inputs`, shapes (n, LAGS) and (n, BANKS)
    lagged: Array
    plays: Array
    end: "ThermalMemory | None" = None  # what the part that follows goes on from; None without a temperature


@dataclass(frozen=True, slots=True)
class ThermalMemory:
    """What a part of a power-on hands on to the next."""

    t: float  # of its last block, s since the power-on's first known sample
    level: float  # smooth temperature then, degC
    start: float  # smooth temperature at the first known sample, degC: where the plays were at rest
    lagged: Array  # T_tau for `LAGS` then, degC
    plays: Array  # each play operator then, K from `start`, shape (BANKS · PLAYS,)


def history(
    temperature: Array | None, t: Array, period: float, edges: NDArray[np.int_], before: ThermalMemory | None = None
) -> TemperatureHistory:
    """Temperature of a run's blocks, its rate, lagged temperatures and plays.

    `temperature`: of the samples, degC, shape (N,), NaN where it is not known; None without any.
    `t`: middle of each block, s since the power-on's first known sample, shape (n,).
    `edges`: first sample of each block, and the end, shape (n + 1,).
    `before`: what the part before it in its power-on hands on; None where nothing is known of what came before: lags
      then start in equality, plays at rest.
    """
    if temperature is None or not np.isfinite(temperature).any():
        return unknown(t.size)
    known = np.isfinite(temperature)
    sums = np.add.reduceat(temperature if known.all() else np.where(known, temperature, 0.0), edges[:-1])
    counts = np.add.reduceat(known, edges[:-1], dtype=np.float64)
    have = counts > 0
    raw = np.interp(t, t[have], sums[have] / counts[have])
    smooth, rate = smoothed(raw, period)
    start = float(smooth[0]) if before is None else before.start
    first = [None] * len(LAGS) if before is None else lagged_after(before, float(t[0]), float(smooth[0])).tolist()
    lagged = np.stack([lag(smooth, tau / period, x) for tau, x in zip(LAGS, first, strict=True)], axis=1)
    played, at = plays(smooth - start, None if before is None else before.plays)
    end = ThermalMemory(float(t[-1]), float(smooth[-1]), start, lagged[-1], at)
    return TemperatureHistory(smooth, rate, lagged, played, end)


def unknown(n: int) -> TemperatureHistory:
    """Nothing known at n blocks or samples."""
    nan = np.full((n, max(len(LAGS), len(BANKS))), np.nan)
    return TemperatureHistory(nan[:, 0], nan[:, 0], nan[:, : len(LAGS)], nan[:, : len(BANKS)])


def smoothed(raw: Array, period: float) -> tuple[Array, Array]:
    """Smooth temperature and its rate by local straight lines, symmetric in time, so that neither lags.

    `raw`: degC, shape (n,), evenly spaced.
    Returns degC and K/s, each (n,).
    """
    # takes half a second to load, and runs without temperature need it not
    from scipy.signal import savgol_filter

    out: list[Array] = []
    for seconds, derivative in ((SMOOTH_S, 0), (SLOPE_S, 1)):
        half = int(min(max(1, round(seconds / period)), (raw.size - 1) // 2))
        if half < 1:
            return raw, np.zeros_like(raw)
        line = savgol_filter(raw, 2 * half + 1, 1, deriv=derivative, delta=period, mode="interp")
        out.append(line.astype(np.float64))
    return np.asarray(out[0], np.float64), np.asarray(out[1], np.float64)


def lag(u: Array, samples: float, first: float | None = None) -> Array:
    """First-order lag of u, its first value given, or that of u; time constant in samples."""
    pole = float(np.exp(-1.0 / samples))
    first = float(u[0]) if first is None else first
    return first_order(u, 1.0 - pole, pole, first - (1.0 - pole) * float(u[0]))[0]


def lagged_after(before: ThermalMemory, t: float, level: float) -> Array:
    """Lagged temperatures at the first block of the part that follows, temperature having gone straight; (LAGS,)."""
    tau, dt = np.array(LAGS), t - before.t
    behind = (level - before.level) / dt * tau
    return np.asarray(level - behind + (before.lagged - before.level + behind) * np.exp(-dt / tau))


def plays(u: Array, at: Array | None = None) -> tuple[Array, Array]:
    """Banks of play operators P(k) = min(max(P(k-1), u(k) - r), u(k) + r).

    `u`: temperature less that of the start, K, shape (n,).
    `at`: where each operator was before, K, shape (BANKS · PLAYS,); without, as at the start. A straight way from there
      needs no more: play is the same at any speed.
    Returns mean of the operators of a bank over its width, shape (n, BANKS).
    Returns where each operator ends, K.
    """
    widths = np.array([width for width, _ in BANKS])
    at = np.array(PLAYS_AT_START if at is None else at, np.float64)
    means = np.empty((u.size, widths.size))
    cached_njit(_play)(np.ascontiguousarray(u), PLAY_HALF_WIDTHS, at, means)
    return np.asarray(means / widths), at


def _play(u, r, at, means):  # type: ignore[no-untyped-def]
    """Banks of play operators of half widths `r`; `at` becomes where they end, `means` (n, BANKS) those of a bank."""
    each = r.size // means.shape[1]
    for k in range(u.size):
        for b in range(means.shape[1]):
            total = 0.0
            for j in range(b * each, (b + 1) * each):
                at[j] = min(max(at[j], u[k] - r[j]), u[k] + r[j])
                total += at[j]
            means[k, b] = total / each


_NOISE = 0.008  # of a thermometer, K √s
_SETTLES: Array = np.array([5.0, 15.0])  # in which the fast filter and the slow one settle, s
_APART_S = 10.0  # over which the difference of their rates is judged
_FIRST_RATE = 0.03  # standard deviation of the first rate, K/s
_BLOCK_S = 0.25  # of the symmetric history, as the tracer has it


class CausalTemperature:
    """Temperature and its rate by two Kalman filters, to which the rate is a random walk; lagged temperatures, plays.

    One is fast, for what turns, the other slow, for coarse thermometers. Of the difference d of their rates, with its
    mean m and variance v over the last seconds, m² / (m² + v) is added to the slow one: what is steady is lag, what
    comes and goes is noise. The first rate is not taken to be zero.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._lags = [float(np.exp(-period / tau)) for tau in LAGS]
        # the temperature last known and the first, degC; what `_line` has as `state`, recursions of the lags, both
        # empty before any temperature is known; plays
        self._held, self._start = np.nan, 0.0
        self._smooth = np.zeros(0)
        self._lagging: list[float] = []
        self._plays = PLAYS_AT_START
        self._ahead: TemperatureHistory | None = None
        self._shown = 0

    def look_ahead(self, temperature: Array) -> None:
        """Take all temperatures that will be followed, degC, shape (N,): smoothed symmetrically, as by the tracer."""
        per = max(1, round(_BLOCK_S / self._period))
        edges = np.append(np.arange(0, temperature.size, per), temperature.size)
        period = per * self._period
        before = None
        if self._lagging:
            lagged = np.array(self._lagging) / np.array(self._lags)
            before = ThermalMemory(-0.5 * period, float(self._smooth[0]), self._start, lagged, self._plays)
        middles = period * np.asarray(np.arange(edges.size - 1) + 0.5, np.float64)
        self._ahead = history(temperature, middles, period, edges, before)

    def memory(self) -> str:
        """All of its state as JSON, to the last bit; "" before any temperature is known."""
        if not self._lagging:
            return ""
        vectors = {"smooth": self._smooth.tolist(), "lags": self._lagging, "plays": self._plays.tolist()}
        return json.dumps({"held": self._held, "start": self._start, **vectors})

    def restore(self, memory: str) -> None:
        """Take such a text; one of other lags or plays, as another version had them, leaves all unknown.

        Raises InputError if the text is none.
        """
        try:
            found = json.loads(memory)
            held, start = (float(found[name]) for name in ("held", "start"))
            vectors = [[float(v) for v in found[name]] for name in ("smooth", "lags", "plays")]
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            raise InputError(f"the memory of temperature does not read as one ({error})") from error
        if not np.isfinite([held, start, *(v for vector in vectors for v in vector)]).all():
            raise InputError("the memory of temperature has a number that is not finite")
        if [len(vector) for vector in vectors] == [_STATES, len(self._lags), self._plays.size]:
            if min(vectors[0][k] for k in _VARIANCES) < 0.0:
                raise InputError("the memory of temperature has a variance below zero")
            self._held, self._start = held, start
            self._smooth, self._lagging, self._plays = np.array(vectors[0]), vectors[1], np.array(vectors[2])

    def follow(self, temperature: Array) -> TemperatureHistory:
        """Of the next samples."""
        self._shown += temperature.size
        if self._ahead is not None:
            return _between(self._ahead, self._shown - temperature.size, temperature.size, self._period)
        raw = self._filled(temperature)
        if not np.isfinite(raw).all():
            return unknown(raw.size)
        if not self._lagging:
            self._start = float(raw[0])
            first = [self._start, 0.0, _NOISE**2 / self._period, 0.0, _FIRST_RATE**2]
            self._smooth = np.array([*first, *first, 0.0, 0.0])
            self._lagging = [p * self._start for p in self._lags]
        smooth = np.empty((2, raw.size))
        turning = _NOISE**2 / _SETTLES**4
        gain = -float(np.expm1(-self._period / _APART_S))
        cached_njit(_line)(raw, self._period, _NOISE**2 / self._period, turning, gain, self._smooth, smooth)
        level, slope = smooth
        lagged = np.empty((raw.size, len(LAGS)))
        for k, pole in enumerate(self._lags):
            lagged[:, k], self._lagging[k] = first_order(level, 1.0 - pole, pole, self._lagging[k])
        played, self._plays = plays(level - self._start, self._plays)
        return TemperatureHistory(level, slope, lagged, played)

    def _filled(self, temperature: Array) -> Array:
        """The last known temperature where there is none."""
        if np.isfinite(temperature).all():
            self._held = float(temperature[-1])
            return temperature
        out = temperature.copy()
        for k in range(out.size):
            if np.isfinite(out[k]):
                self._held = float(out[k])
            out[k] = self._held
        return out


_STATES, _VARIANCES = 12, (2, 4, 7, 9, 11)


def _line(x, dt, r, q, gain, state, out):  # type: ignore[no-untyped-def]
    """Level and rate of x, variance r, when the rate is a random walk, by filters of two densities q.

    `gain`: of the mean and variance of the difference of their rates. `state`: level, rate, and P, C, V of their
    covariance, of each filter; that mean and that variance; it becomes the last.
    """
    for k in range(x.size):
        for m in range(2):
            level, rate, P, C, V = state[5 * m : 5 * m + 5]
            level += dt * rate
            P += dt * (2.0 * C + dt * (V + q[m] * dt / 3.0))
            C += dt * (V + 0.5 * q[m] * dt)
            V += q[m] * dt
            nu, S = x[k] - level, P + r
            state[5 * m] = level + P / S * nu
            state[5 * m + 1] = rate + C / S * nu
            state[5 * m + 2] = P * r / S
            state[5 * m + 3] = C * r / S
            state[5 * m + 4] = V - C * C / S
        apart = state[1] - state[6]
        state[10] += gain * (apart - state[10])
        state[11] += gain * ((apart - state[10]) ** 2 - state[11])
        steady = state[10] * state[10]
        out[0, k] = state[0]
        out[1, k] = state[6] + (apart * steady / (steady + state[11]) if steady > 0.0 else 0.0)


def _between(ahead: TemperatureHistory, first: int, count: int, period: float) -> TemperatureHistory:
    """A history's blocks at so many samples from one on."""
    per = max(1, round(_BLOCK_S / period))
    at = (first + np.arange(count) + 0.5) / per - 0.5
    low = np.clip(at.astype(np.int_), 0, max(ahead.level.size - 2, 0))
    high = np.minimum(low + 1, ahead.level.size - 1)
    share = np.clip(at - low, 0.0, 1.0)

    def values(x: Array) -> Array:
        return np.asarray((x[low].T + (x[high] - x[low]).T * share).T)

    return TemperatureHistory(values(ahead.level), values(ahead.rate), values(ahead.lagged), values(ahead.plays))
