"""What thermal effects are functions of, over the blocks of a run: temperature, its rate, lags and play operators.

Symmetric in time where that can be, since a trace has the whole run; what the filter makes of the past alone is in
`filters.effects.runtime`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.effects.inputs import LAGS, PLAY_WIDTHS, PLAYS, SLOPE_S, SMOOTH_S
from filters.first_order import first_order
from filters.tracing.run import Run
from filters.types import Array


@dataclass(frozen=True, slots=True)
class TemperatureHistory:
    """Temperature of a run at its n blocks, and what remembers it; NaN without a temperature.

    Attributes
    ----------
    level, rate : Array
        degC and K/s, shape (n,).
    lagged, plays : Array
        As in `filters.effects.inputs.Inputs`, shapes (n, LAGS) and (n, PLAY_WIDTHS).
    """

    level: Array
    rate: Array
    lagged: Array
    plays: Array


def history(run: Run, t: Array, period: float, edges: NDArray[np.int_]) -> TemperatureHistory:
    """Temperature of a run's blocks, its rate, lagged temperatures and plays.

    Parameters
    ----------
    run : Run
        With its temperature.
    t : Array
        Middle of each block, s, shape (n,).
    period : float
        Of a block, s.
    edges : integer array
        First sample of each block, and the end, shape (n + 1,).
    """
    n = t.size
    nan = np.full(n, np.nan)
    if run.temperature is None or not np.isfinite(run.temperature).any():
        return TemperatureHistory(nan, nan, np.full((n, len(LAGS)), np.nan), np.full((n, len(PLAY_WIDTHS)), np.nan))
    known = np.isfinite(run.temperature)
    sums = np.add.reduceat(np.where(known, run.temperature, 0.0), edges[:-1])
    counts = np.add.reduceat(known.astype(np.float64), edges[:-1])
    have = counts > 0
    raw = np.interp(t, t[have], sums[have] / counts[have])
    smooth, rate = smoothed(raw, period)
    lagged = np.stack([lag(smooth, tau / period) for tau in LAGS], axis=1)
    return TemperatureHistory(smooth, rate, lagged, plays(smooth - smooth[0]))


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
    return first_order(u, 1.0 - pole, pole, pole * float(u[0]))[0]


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
