"""Raw sensor residual against the reference, averaged over blocks, with the drivers of every block.

    r = reading - what a perfect unit would read there

in the instrument's axes and sign, so that an error found is the error of a reading. The mean over a block of a
regressor is the exact regressor of the mean residual: regressors of motion are taken at the samples and averaged.

What it leaves out: flags (`effects.faults`), whitening (`whitening`), what the residual means (`tracing`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from filters import earth
from filters.effects.inputs import LAGS, PLAY_WIDTHS, PLAYS, SLOPE_S, SMOOTH_S, Inputs
from filters.effects.lag import first_order
from filters.imu import AxisMap
from filters.state import Site
from filters.types import Array

BLOCK_S = 0.25
_SHARE_FLAGGED = 0.15
_AT_REST = np.deg2rad(0.01)
_BURSTS = 0.02
_CHUNK = 1 << 13


@dataclass(frozen=True)
class Run:
    """One power-on as recorded, with what is known of its motion.

    Attributes
    ----------
    name : str
        What it is called in a report.
    t : Array
        s since the first sample, shape (N,), increasing.
    reading : Array
        Rates (rad/s) and accelerations (m/s²), instrument axes and sign, shape (N, 6).
    temperature : Array or None
        degC, shape (N,).
    angles, rates : Array
        Rotations of the table about north, east, down, rad, unwrapped, and rad/s; shape (N, 3), or (1, 3) at rest.
    axes : AxisMap
        Sign and mounting.
    site : Site
        Where.
    C_nb : Array or None
        Attitude of a unit at rest that does not sit as the table's angles say, shape (3, 3).
    lsb : Array or None
        Of a count, SI, shape (6,).
    bandwidth : Array or None
        First-order band limits of the specification, Hz, shape (6,).
    latency : Array
        Known delays of the six channels, s.
    flagged : bool array or None
        Readings not to be used, shape (N, 6).
    averaged : bool
        Whether samples are means over so many packets as fell into a period: then their steps differ by a packet.
    """

    name: str
    t: Array
    reading: Array
    temperature: Array | None
    angles: Array
    rates: Array
    axes: AxisMap
    site: Site
    C_nb: Array | None = None
    lsb: Array | None = None
    bandwidth: Array | None = None
    latency: Array = field(default_factory=lambda: np.zeros(6))
    flagged: NDArray[np.bool_] | None = None
    averaged: bool = False

    @property
    def still(self) -> bool:
        """Whether one row of angles stands for all."""
        return len(self.angles) == 1

    @property
    def seconds(self) -> float:
        """Length."""
        return float(self.t[-1] - self.t[0])

    @property
    def rate_hz(self) -> float:
        """Samples a second, by count: the median of the steps is wrong for stamps that come in bursts."""
        return (self.t.size - 1) / self.seconds


def perfect(run: Run, rows: slice = slice(None)) -> Array:
    """What a perfect unit reads: w + C w_ie and C (0, 0, -gamma), instrument axes; shape (n, 6), or (1, 6) at rest."""
    return _sensed(run, rows)[0]


def _sensed(run: Run, rows: slice) -> tuple[Array, Array, Array, Array]:
    """What a perfect unit reads, its Earth rate alone, its reading of tilt, body rate of the table (body axes)."""
    axes, site = run.axes, run.site
    angles, rates = (run.angles, run.rates) if run.still else (run.angles[rows], run.rates[rows])
    C, turning = _attitudes(angles, rates)
    if run.C_nb is not None:
        C = run.C_nb[None]
    spin = axes.gyro_to_instrument(np.einsum("nij,i->nj", C, earth.earth_rate_n(np.array(site.latitude))))
    force = axes.accel_to_instrument(-site.gravity * C[:, 2])
    # δ × (0, 0, -γ) of a tilt about north is γ east, about east -γ north
    tilt = site.gravity * np.stack([axes.accel_to_instrument(C[:, 1]), -axes.accel_to_instrument(C[:, 0])], axis=2)
    return np.hstack([axes.gyro_to_instrument(turning) + spin, force]), spin, tilt, turning


def _attitudes(angles: Array, rates: Array) -> tuple[Array, Array]:
    """As `profile.attitudes` and `profile.body_rate`, shapes (n, 3, 3) and (n, 3).

    Those take sines one by one, so that live and replayed numbers are equal to the last bit; here whole arrays are
    several times as fast, and nothing has to be.
    """
    (so, sm, si), (co, cm, ci) = np.sin(angles).T, np.cos(angles).T
    C = np.empty((len(angles), 3, 3))
    C[:, 0, 0], C[:, 0, 1], C[:, 0, 2] = cm * ci, -(cm * si), sm
    C[:, 1, 0], C[:, 1, 1], C[:, 1, 2] = co * si + so * sm * ci, co * ci - so * sm * si, -(so * cm)
    C[:, 2, 0], C[:, 2, 1], C[:, 2, 2] = so * si - co * sm * ci, so * ci + co * sm * si, co * cm
    o, m, i = rates.T
    return C, np.stack([ci * cm * o + si * m, ci * m - si * cm * o, sm * o + i], axis=1)


@dataclass(frozen=True)
class Blocks:
    """A run in blocks.

    Attributes
    ----------
    run : Run
        Where they come from.
    period : float
        Length of a block, s.
    t : Array
        Middle of each, s, shape (n,).
    y : Array
        Mean residual, shape (n, 6); 0 where there is no weight.
    weight : Array
        Share of the samples that were there and good, 0 to 1, shape (n, 6); 0 if more than 15 % were flagged.
    rough : Array
        Sum of the squared differences of neighbouring samples, shape (n, 6), and
    pairs : Array
        how many, shape (n, 6).
    """

    run: Run
    period: float
    t: Array
    y: Array
    weight: Array
    rough: Array
    pairs: Array
    _edges: NDArray[np.int_]
    _slow: dict[str, Array]

    def mean(self, columns: Sequence[tuple[Callable[[Inputs], Array], slice]], out: Array) -> None:
        """Block means of columns, functions of the drivers.

        Parameters
        ----------
        columns : sequence of (callable, slice)
            What gives the columns at the samples, shape (N, k), and where they go in `out`.
        out : Array
            Shape (n, K), filled in place.
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

    def slow(self) -> Inputs:
        """Drivers at the middle of the blocks, of which only time, temperature and what follows motion are meant."""
        return self._inputs_at_rest()

    def _chunks(self) -> list[tuple[int, int]]:
        """Ranges of blocks of about as many samples as fit a cache."""
        per = max(1, int(_CHUNK / max(1.0, self.run.t.size / self.t.size)))
        return [(k, min(k + per, self.t.size)) for k in range(0, self.t.size, per)]

    def _inputs_at_rest(self) -> Inputs:
        x, spin, tilt, _ = _sensed(self.run, slice(0, 1))
        n = self.t.size
        slow, zero = self._slow, np.zeros((1, 3))
        angles = self.run.angles[:1]
        return Inputs(
            self.t,
            np.broadcast_to(x, (n, 6)),
            np.zeros((n, 6)),
            slow["temperature"],
            slow["temperature_rate"],
            slow["lagged"],
            slow["plays"],
            np.broadcast_to(spin, (n, 3)),
            np.broadcast_to(tilt, (n, 3, 2)),
            np.zeros((n, 3, 3)),
            np.broadcast_to(angles, (n, 3)),
            np.broadcast_to(zero, (n, 3)),
            np.zeros(n),
            slow["since_motion"],
            slow["direction"],
        )

    def _inputs_moving(self, first: int, last: int) -> tuple[Inputs, NDArray[np.int_]]:
        """Drivers at the samples of blocks `first` to `last`, and where the blocks begin in them."""
        run, edges = self.run, self._edges
        begin, end = int(edges[first]), int(edges[last])
        # differences at the ends need a neighbour
        low, high = max(0, begin - 1), min(run.t.size, end + 1)
        x, spin, tilt, turning = _sensed(run, slice(low, high))
        t = run.t[low:high]
        x_dot = np.gradient(x, t, axis=0) if t.size > 1 else np.zeros_like(x)
        turning_dot = np.gradient(turning, t, axis=0) if t.size > 1 else np.zeros_like(turning)
        rates = run.rates[low:high]
        table_accel = np.linalg.norm(np.gradient(rates, t, axis=0), axis=1) if t.size > 1 else np.zeros(t.size)
        inner = slice(begin - low, begin - low + end - begin)
        of = np.repeat(np.arange(first, last), np.diff(edges[first : last + 1]))
        slow = {name: values[of] for name, values in self._slow.items()}
        lever = _lever(run.axes, turning[inner], turning_dot[inner])
        inputs = Inputs(
            t[inner],
            x[inner] - run.latency * x_dot[inner],
            x_dot[inner],
            slow["temperature"],
            slow["temperature_rate"],
            slow["lagged"],
            slow["plays"],
            spin[inner],
            tilt[inner],
            lever,
            run.angles[begin:end],
            rates[inner],
            table_accel[inner],
            slow["since_motion"],
            slow["direction"],
        )
        return inputs, edges[first:last] - begin


def _lever(axes: AxisMap, turning: Array, turning_dot: Array) -> Array:
    """ω × (ω × r) + ω' × r as the accelerometers read it, for r along the instrument's x, y, z; shape (n, 3, 3)."""
    columns = []
    for r in axes.mount.T:
        force = np.cross(turning, np.cross(turning, r)) + np.cross(turning_dot, r)
        columns.append(axes.accel_to_instrument(force))
    return np.stack(columns, axis=2)


def blocks(run: Run, block_s: float = BLOCK_S) -> Blocks:
    """Average a run.

    Parameters
    ----------
    run : Run
        With its flags.
    block_s : float
        Wanted length, s; a whole number of samples is taken, at least one.

    Returns
    -------
    Blocks
    """
    per = max(1, round(block_s * run.rate_hz))
    period = per / run.rate_hz
    t = even_time(run)
    number = np.floor((t - t[0]) / period + 1e-6).astype(np.int64)
    edges = np.append(np.flatnonzero(np.diff(number, prepend=-1)), t.size)
    counts = np.diff(edges)
    y, good, rough, pairs = (np.empty((counts.size, 6)) for _ in range(4))
    for first in range(0, counts.size, max(1, _CHUNK // per)):
        last = min(first + max(1, _CHUNK // per), counts.size)
        rows = slice(first, last)
        y[rows], good[rows], rough[rows], pairs[rows] = _means(run, edges[first : last + 1])
    share = good / np.maximum(per, counts)[:, None]
    weight = np.where(good < (1.0 - _SHARE_FLAGGED) * counts[:, None], 0.0, share)
    mid = np.add.reduceat(t, edges[:-1]) / counts
    made = Blocks(run, period, mid, np.where(weight > 0.0, y, 0.0), weight, rough, pairs, edges, {})
    return replace(made, _slow=_slow(run, made))


def even_time(run: Run) -> Array:
    """Time base: the stamps, unless they come in bursts, then the mean rate's."""
    T = 1.0 / run.rate_hz
    off = np.abs(np.diff(run.t) - T) > 0.5 * T
    return np.asarray(np.arange(run.t.size) * T, np.float64) if off.mean() > _BURSTS else run.t


def residual(run: Run, rows: slice = slice(None)) -> Array:
    """Reading minus what a perfect unit would read, at full rate, NaN where flagged; shape (n, 6)."""
    t = run.t[rows]
    x = perfect(run, rows)
    if run.latency.any() and not run.still and t.size > 1:
        x = x - run.latency * np.gradient(x, t, axis=0)
    r = run.reading[rows] - x
    return r if run.flagged is None else np.where(run.flagged[rows], np.nan, r)


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


def _slow(run: Run, made: Blocks) -> dict[str, Array]:
    """Drivers with a memory, at the blocks."""
    n, edges = made.t.size, made._edges
    out = _thermal(run, made.t, made.period, edges)
    out["since_motion"], out["direction"] = made.t.copy(), np.zeros((n, 3))
    if not run.still:
        rates = np.add.reduceat(run.rates, edges[:-1], axis=0) / np.diff(edges)[:, None]
        out["since_motion"] = _since(made.t, (np.abs(rates) > _AT_REST).any(axis=1))
        out["direction"] = _last_sign(np.where(np.abs(rates) > _AT_REST, np.sign(rates), 0.0))
    return out


def _since(t: Array, moves: NDArray[np.bool_]) -> Array:
    last = np.maximum.accumulate(np.where(moves, np.arange(t.size), -1))
    return t - np.where(last >= 0, t[np.maximum(last, 0)], t[0])


def _last_sign(signs: Array) -> Array:
    rows = np.maximum.accumulate(np.where(signs != 0.0, np.arange(len(signs))[:, None], -1), axis=0)
    return np.where(rows >= 0, np.take_along_axis(signs, np.maximum(rows, 0), axis=0), 0.0)


def _thermal(run: Run, t: Array, period: float, edges: NDArray[np.int_]) -> dict[str, Array]:
    """Temperature, its rate, lagged temperatures and plays."""
    n = t.size
    nan = np.full(n, np.nan)
    if run.temperature is None or not np.isfinite(run.temperature).any():
        return {
            "temperature": nan,
            "temperature_rate": nan,
            "lagged": np.full((n, len(LAGS)), np.nan),
            "plays": np.full((n, len(PLAY_WIDTHS)), np.nan),
        }
    known = np.isfinite(run.temperature)
    sums = np.add.reduceat(np.where(known, run.temperature, 0.0), edges[:-1])
    counts = np.add.reduceat(known.astype(np.float64), edges[:-1])
    have = counts > 0
    raw = np.interp(t, t[have], sums[have] / counts[have])
    smooth, rate = smoothed(raw, period)
    return {
        "temperature": smooth,
        "temperature_rate": rate,
        "lagged": np.stack([lag(smooth, tau / period) for tau in LAGS], axis=1),
        "plays": plays(smooth - smooth[0]),
    }


def smoothed(raw: Array, period: float) -> tuple[Array, Array]:
    """Smooth temperature and its rate by local straight lines, symmetric in time, so that neither lags.

    Parameters
    ----------
    raw : Array
        degC, shape (n,), evenly spaced.
    period : float
        s.

    Returns
    -------
    Array, Array
        degC and K/s, each (n,).
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


def lag(u: Array, samples: float) -> Array:
    """First-order lag of u, from equality at the start; time constant in samples."""
    pole = float(np.exp(-1.0 / samples))
    return first_order(u, pole, pole * float(u[0]))[0]


def plays(u: Array) -> Array:
    """Banks of play operators P(k) = min(max(P(k-1), u(k) - r), u(k) + r), P = 0 at the start.

    Parameters
    ----------
    u : Array
        Temperature less that of the start, K, shape (n,).

    Returns
    -------
    Array
        Mean of the operators of a bank over its width, shape (n, PLAY_WIDTHS).
    """
    widths = np.array(PLAY_WIDTHS)
    r = (widths[:, None] * np.arange(1, PLAYS + 1) / PLAYS).ravel()
    out = np.empty((u.size, r.size))
    at = np.zeros(r.size)
    for k, value in enumerate(u.tolist()):
        at = np.minimum(np.maximum(at, value - r), value + r)
        out[k] = at
    return np.asarray(out.reshape(u.size, widths.size, PLAYS).mean(axis=2) / widths)


def rest_attitudes(angles: Array, tolerance: float = 1e-9) -> Array:
    """Angles as one row if they never change, else as they are, unwrapped; rad, shape (1, 3) or (N, 3)."""
    if np.ptp(angles, axis=0).max() <= tolerance:
        return angles[:1]
    return np.unwrap(angles, axis=0)
