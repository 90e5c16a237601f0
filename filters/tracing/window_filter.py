"""The bias filter over means of windows: what it foretells of the next, when drift goes on within a window.

Drift is averaged over a window as the readings are: the mean over 10 s of a process that forgets in 2 s varies a third
as much as the process itself, and a covariance that takes one for the other is twice too wide. So the filter goes from
block to block with [b, g, s], s the sum since the window's start, and meets a reading at a window's end: the sum.

What a correction's parameters are not known to is a state too, constant, with the covariance of their fit. The same
for every window, it is no noise of each.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.compilation import cached_njit
from filters.tracing.whitening import Drift
from filters.types import Array

_DIFFUSE = 1e8


@dataclass(frozen=True, slots=True)
class Foretold:
    """What the filter found at windows' ends, but for the first of each power-on, which tells it the bias."""

    window: NDArray[np.int_]  # number of each, shape (m,)
    error: Array  # mean of the window less what was foretold, SI, shape (m,)
    sd: Array  # standard deviation that was foretold, SI, shape (m,)

    @property
    def normalised(self) -> Array:
        """Errors over their standard deviations, shape (m,)."""
        return self.error / self.sd


def foretell(
    columns: Array,
    t: Array,
    weight: Array,
    sd: float,
    ends: NDArray[np.bool_],
    begins: NDArray[np.bool_],
    drift: Drift,
    covariance: Array | None = None,
) -> Foretold:
    """Run the filter over a channel's blocks.

    `columns`: residual with the correction, then the correction's regressors, SI, shape (n, 1 + k).
    `t`: s, shape (n,), increasing within a power-on.
    `weight`: share of each block that is good, 0 to 1, shape (n,).
    `sd`: standard deviation of a full block's white noise, SI.
    `ends`, `begins`: whether a window ends with the block; whether a power-on begins with it; shape (n,).
    `drift`: of the channel.
    `covariance`: of the correction's parameters, shape (k, k); None without regressors.
    """
    columns = np.ascontiguousarray(columns, np.float64)
    count = int(ends.sum())
    nu, root = np.zeros((count, columns.shape[1])), np.zeros(count)
    _run(columns, t, weight, sd * sd, ends, begins, drift.tau, drift.level, nu, root)
    told = np.flatnonzero(root > 0.0)
    nu, root = nu[told], root[told]
    if covariance is None or nu.shape[1] == 1:
        return Foretold(told, nu[:, 0], root)
    error, wider = _learn(nu / root[:, None], np.array(covariance, np.float64))
    return Foretold(told, error * root, wider * root)


@cached_njit
def _run(columns, t, weight, variance, ends, begins, tau, level, nu, root):  # type: ignore[no-untyped-def]
    """Innovations of windows' means of all columns into `nu`, their standard deviations into `root`, 0 for none."""
    n, k = columns.shape
    x = np.zeros((3, k))
    P = np.zeros((3, 3))
    total = 0.0
    z = np.zeros(k)
    last = 0.0
    walk = np.isinf(tau)
    known = False
    w = 0
    for i in range(n):
        if begins[i]:
            x[:] = 0.0
            z[:] = 0.0
            P[:] = 0.0
            P[1, 1] = 0.0 if walk else level * level
            P[0, 0] = _DIFFUSE * (variance + P[1, 1])
            total, known, last = 0.0, False, t[i]
        dt = t[i] - last
        last = t[i]
        if dt > 0.0 and level > 0.0:
            if walk:
                P[1, 1] += level * level * dt
            else:
                phi = np.exp(-dt / tau)
                for a in (0, 2):
                    P[1, a] *= phi
                    P[a, 1] *= phi
                P[1, 1] = phi * phi * P[1, 1] + level * level * (1.0 - phi * phi)
                for j in range(k):
                    x[1, j] *= phi
        m = weight[i]
        if m > 0.0:
            total += m
            h0, h1 = P[0, 0] + P[1, 0], P[0, 1] + P[1, 1]
            P[2, 2] += 2.0 * m * (P[2, 0] + P[2, 1]) + m * m * (h0 + h1) + m * variance
            P[2, 0] += m * h0
            P[2, 1] += m * h1
            P[0, 2], P[1, 2] = P[2, 0], P[2, 1]
            for j in range(k):
                x[2, j] += m * (x[0, j] + x[1, j])
                z[j] += m * columns[i, j]
        if not ends[i]:
            continue
        if total > 0.0:
            S = P[2, 2]
            if known:
                root[w] = np.sqrt(S) / total
            K0, K1 = P[0, 2] / S, P[1, 2] / S
            for j in range(k):
                e = z[j] - x[2, j]
                nu[w, j] = e / total
                x[0, j] += K0 * e
                x[1, j] += K1 * e
            P00 = P[0, 0] - K0 * P[0, 2]
            P01 = P[0, 1] - K0 * P[1, 2]
            P11 = P[1, 1] - K1 * P[1, 2]
            P[0, 0], P[0, 1], P[1, 0], P[1, 1] = P00, P01, P01, P11
            known = True
        P[2, :] = 0.0
        P[:, 2] = 0.0
        x[2, :] = 0.0
        z[:] = 0.0
        total = 0.0
        w += 1


@cached_njit
def _learn(whitened, P):  # type: ignore[no-untyped-def]
    """Errors while parameters of a prior are learned from the windows before, and their standard deviations."""
    m, k = whitened.shape[0], whitened.shape[1] - 1
    theta, gain = np.zeros(k), np.zeros(k)
    error, sd = np.zeros(m), np.zeros(m)
    for i in range(m):
        e, S = whitened[i, 0], 1.0
        for a in range(k):
            gain[a] = 0.0
            for b in range(k):
                gain[a] += P[a, b] * whitened[i, 1 + b]
            e -= whitened[i, 1 + a] * theta[a]
            S += whitened[i, 1 + a] * gain[a]
        error[i], sd[i] = e, np.sqrt(S)
        for a in range(k):
            theta[a] += gain[a] * e / S
        for a in range(k):
            for b in range(k):
                P[a, b] -= gain[a] * gain[b] / S
    return error, sd
