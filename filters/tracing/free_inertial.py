"""Position error of free inertial navigation that starts from the true state, with the bias filter's biases.

drift_10s, drift_60s   root mean square over starts a minute apart; the floor is what white noise alone leaves
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from filters.tracing.error_figure import DRAWS, ErrorFigure, chi2_quantiles, rms, rms_interval
from filters.tracing.residual import attitude_and_rate
from filters.tracing.stack import Stack
from filters.tracing.whitening import NONE, Drift
from filters.types import Array

_START_EVERY_S = 60.0
_DIFFUSE = 1e8


def free_drift(
    stack: Stack, before: Array, after: Array, white: Array, drifts: Sequence[Drift], seconds: float, seed: int
) -> ErrorFigure | None:
    """Position error of free inertial navigation, to first order in the sensors' errors, started true every minute.

    ε' = C δω, δv' = C δf + ε × f_n, δp' = δv with δω, δf what is left of the readings' errors when the bias filter's
    estimate at the start is taken off: a bias stays, a Gauss-Markov drift is forgotten at its own rate.

    `stack`: of the held-out run alone.
    `before`, `after`: residuals of all channels, instrument axes, SI, shape (n, 6).
    `white`: white densities, shape (6,).
    `drifts`: of the six channels, in the bias filter after.
    `seconds`: of free navigation, 10 or 60.
    `seed`: of the interval.
    Returns none with fewer than two starts.
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
    values = []
    for r, own in ((before, [NONE] * 6), (after, list(drifts))):
        held = _biases(stack, r, starts, steps, white, own)
        rows = zip(starts.tolist(), held, strict=True)
        values.append(np.array([_position(stack, r[s : s + steps] - b, C, s) for s, b in rows]))
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


def _position(stack: Stack, errors: Array, C: Array, start: int) -> float:
    """Position error at the end of readings' errors of shape (steps, 6) from a row on, m."""
    run, dt, steps = stack.blocks[0].run, stack.period, len(errors)
    own = C if len(C) == 1 else C[start : start + steps]
    turn = np.einsum("nij,nj->ni", np.broadcast_to(own, (steps, 3, 3)), run.axes.gyro_to_body(errors[:, :3]))
    push = np.einsum("nij,nj->ni", np.broadcast_to(own, (steps, 3, 3)), run.axes.accel_to_body(errors[:, 3:]))
    # at the middle of each block: sums to its end are 8 % too large over 40 blocks
    tilt = (np.cumsum(turn, axis=0) - 0.5 * turn) * dt
    push = push + np.cross(tilt, np.array([0.0, 0.0, -run.site.gravity]))
    speed = (np.cumsum(push, axis=0) - 0.5 * push) * dt
    return float(np.linalg.norm(np.sum(speed, axis=0) * dt))


def _biases(
    stack: Stack, r: Array, starts: NDArray[np.int_], steps: int, white: Array, drifts: Sequence[Drift]
) -> Array:
    """What the bias filter foretells at each start of the rows that follow it, shape (starts, steps, 6)."""
    out = np.empty((starts.size, steps, 6))
    ahead = np.arange(steps) * stack.period
    for c, drift in enumerate(drifts):
        variance = white[c] ** 2 / stack.period
        held = _states(r[:, c], stack.t, stack.weight[:, c], variance, drift.tau, drift.level)[starts]
        keep = np.ones(steps) if drift.is_walk else np.exp(-ahead / drift.tau)
        out[:, :, c] = held[:, :1] + held[:, 1:] * keep
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _states(r, t, weight, variance, tau, level):  # type: ignore[no-untyped-def]
    """Bias and drift that the bias filter foretells of each row from those before it, shape (n, 2)."""
    n = r.size
    out = np.zeros((n, 2))
    walk = np.isinf(tau)
    b = g = 0.0
    P01 = 0.0
    P11 = 0.0 if walk else level * level
    P00 = _DIFFUSE * (variance + P11)
    for i in range(n):
        dt = t[i] - t[i - 1] if i else 0.0
        if level > 0.0 and walk:
            P11 += level * level * dt
        elif level > 0.0:
            phi = np.exp(-dt / tau)
            g *= phi
            P01 *= phi
            P11 = phi * phi * P11 + level * level * (1.0 - phi * phi)
        out[i, 0], out[i, 1] = b, g
        if weight[i] > 0.0:
            h0, h1 = P00 + P01, P01 + P11
            S = h0 + h1 + variance / weight[i]
            nu = r[i] - b - g
            b += h0 / S * nu
            g += h1 / S * nu
            P00, P01, P11 = P00 - h0 * h0 / S, P01 - h0 * h1 / S, P11 - h1 * h1 / S
    return out
