"""Position error of free inertial navigation that starts from the true state, with the bias filter's biases.

drift_10s, drift_60s   root mean square over starts a minute apart; the floor is what white noise alone leaves
"""

from collections.abc import Sequence

import numpy as np

from filters.tracing.error_figure import DRAWS, ErrorFigure, chi2_quantiles, rms, rms_interval
from filters.tracing.residual import attitude_and_rate
from filters.tracing.stack import Stack
from filters.tracing.whitening import NONE, Drift
from filters.types import Array

_START_EVERY_S = 60.0


def free_drift(
    stack: Stack, before: Array, after: Array, white: Array, drifts: Sequence[Drift], seconds: float, seed: int
) -> ErrorFigure | None:
    """Position error of free inertial navigation, to first order in the sensors' errors, started true every minute.

    ε' = C δω, δv' = C δf + ε × f_n, δp' = δv with δω, δf what is left of the readings' errors when the bias filter's
    estimate at the start is taken off.

    Parameters
    ----------
    stack : Stack
        Of the held-out run alone.
    before, after : Array
        Residuals of all channels, instrument axes, SI, shape (n, 6).
    white : Array
        White densities, shape (6,).
    drifts : sequence of Drift
        Of the six channels, in the bias filter after.
    seconds : float
        Of free navigation, 10 or 60.
    seed : int
        Of the interval.

    Returns
    -------
    ErrorFigure or None
        None with fewer than two starts.
    """
    run = stack.blocks[0].run
    dt = stack.period
    steps = round(seconds / dt)
    starts = np.flatnonzero(np.diff((stack.part_t // _START_EVERY_S).astype(int), prepend=0) > 0)
    starts = starts[starts + steps <= stack.t.size]
    starts = starts[[bool((stack.weight[s : s + steps] > 0.0).all()) for s in starts]]
    if starts.size < 2:
        return None
    C = _attitudes_at(stack)
    values = [
        np.array([_position(stack, r, C, int(s), steps, white, own) for s in starts])
        for r, own in ((before, [NONE] * 6), (after, list(drifts)))
    ]
    gamma = run.site.gravity
    gyro, accel = float(np.mean(white[:3] ** 2)), float(np.mean(white[3:] ** 2))
    floor = float(np.sqrt(3.0 * accel * seconds**3 / 3.0 + 2.0 * gamma**2 * gyro * seconds**5 / 20.0))
    rng = np.random.default_rng(seed)
    picks = rng.integers(0, starts.size, (DRAWS, starts.size))
    low, high = (float(np.sqrt(q / (2 * starts.size))) for q in chi2_quantiles(2 * starts.size))
    return ErrorFigure(
        metric=f"drift_{seconds:.0f}s",
        channel="all",
        unit="m",
        before=rms(values[0]),
        after=rms(values[1]),
        floor=floor,
        ci95=rms_interval(values[1], picks, 1.0),
        before_ci95=rms_interval(values[0], picks, 1.0),
        floor_band95=(low * floor, high * floor),
        n=int(starts.size),
        heldout="run",
    )


def _attitudes_at(stack: Stack) -> Array:
    """C_nb of every block, shape (n or 1, 3, 3)."""
    run = stack.blocks[0].run
    middles = np.minimum((stack.blocks[0].edges[:-1] + stack.blocks[0].edges[1:]) // 2, run.t.size - 1)
    return attitude_and_rate(run, middles)[0]


def _position(stack: Stack, r: Array, C: Array, start: int, steps: int, white: Array, drifts: Sequence[Drift]) -> float:
    run, dt = stack.blocks[0].run, stack.period
    rows = slice(start, start + steps)
    errors = r[rows] - _biases(stack, r, start, white, drifts)
    own = C if len(C) == 1 else C[rows]
    turn = np.einsum("nij,nj->ni", np.broadcast_to(own, (steps, 3, 3)), run.axes.gyro_to_body(errors[:, :3]))
    push = np.einsum("nij,nj->ni", np.broadcast_to(own, (steps, 3, 3)), run.axes.accel_to_body(errors[:, 3:]))
    # at the middle of each block: sums to its end are 8 % too large over 40 blocks
    tilt = (np.cumsum(turn, axis=0) - 0.5 * turn) * dt
    push = push + np.cross(tilt, np.array([0.0, 0.0, -run.site.gravity]))
    speed = (np.cumsum(push, axis=0) - 0.5 * push) * dt
    return float(np.linalg.norm(np.sum(speed, axis=0) * dt))


def _biases(stack: Stack, r: Array, start: int, white: Array, drifts: Sequence[Drift]) -> Array:
    """What the bias filter holds at a row, from the rows before it; shape (6,)."""
    out = np.empty(6)
    for c in range(6):
        w = stack.weight[:start, c]
        age = stack.t[start] - stack.t[:start]
        own = drifts[c]
        if own.level > 0.0:
            # steady state of the filter for a walk: the past counts for √(white² / q) seconds
            q = own.level if np.isinf(own.tau) else own.level * np.sqrt(2.0 / own.tau)
            w = w * np.exp(-age * q / white[c])
        out[c] = float(w @ r[:start, c] / max(float(w.sum()), 1e-12))
    return out
