"""States beyond the 15 (`filters.kalman.augmentation`), compiled: p of them, which is known at run time only.

They act through the effective bias b + φ x alone. The step therefore takes the lanes through with z = (navigation
errors, effective bias), 15 of them whatever p is, and carries the rest along with the linear regression of the lanes
on z; see `carry`.
"""

import math

from filters.kalman import layout
from filters.kalman.kernels.arithmetic import LANES, compiled, plus, row, store
from filters.kalman.layout import STRIDE


@compiled
def count(extra):  # type: ignore[no-untyped-def]
    """How many extra states there are, p."""
    return extra.across.size // (2 * STRIDE)


@compiled
def drift(extra, dt):  # type: ignore[no-untyped-def]
    """x ← x exp(-dt/τ), with its covariances, and the variance that w adds over dt; as `augmentation.drift`."""
    p, states, across = count(extra), extra.states, extra.across
    for j in range(p):
        tau, density = states[layout.EXTRA_TAU * p + j], states[layout.EXTRA_DENSITY * p + j]
        power = density * density
        fade = math.exp(-dt / tau)
        grown = power * dt if math.isinf(tau) else -0.5 * power * tau * math.expm1(-2.0 * dt / tau)
        states[layout.EXTRA_MEAN * p + j] *= fade
        for i in range(STRIDE):
            across[j * STRIDE + i] *= fade
        for i in range(p):
            states[(layout.EXTRA_OWN + j) * p + i] *= fade
            states[(layout.EXTRA_OWN + i) * p + j] *= fade
        states[(layout.EXTRA_OWN + j) * p + j] += grown


@compiled
def take_away(extra, k, par, work):  # type: ignore[no-untyped-def]
    """Take the mean effect from the readings at both ends of the step, and note the share of x in the bias of it.

    What x is off by is taken with the mean of both regressors: the angle and, to dt²/12, the velocity are the same.
    """
    p, states, phi = count(extra), extra.states, extra.phi
    for i in range(6):
        start, end = 0.0, 0.0
        for j in range(p):
            last = phi[k, i, j]
            first = states[(layout.EXTRA_BEFORE + i) * p + j] if par[layout.PAR_LINEAR] != 0.0 else last
            states[(layout.EXTRA_SHARE + i) * p + j] = 0.5 * (first + last)
            start += first * states[layout.EXTRA_MEAN * p + j]
            end += last * states[layout.EXTRA_MEAN * p + j]
        if i < 3:
            work.accel[i] -= start
            work.accel[3 + i] -= end
        else:
            work.gyro[i - 3] -= start
            work.gyro[i] -= end


@compiled
def note_regressor(extra, k):  # type: ignore[no-untyped-def]
    """Keep the regressor of sample k, as that before the next one."""
    p = count(extra)
    for j in range(p):
        for i in range(6):
            extra.states[(layout.EXTRA_BEFORE + i) * p + j] = extra.phi[k, i, j]


@compiled
def gather(P, extra, kept):  # type: ignore[no-untyped-def]
    """P ← covariance of z = (navigation errors, b + φ x), its block of b put by; and Cov(z, x)."""
    p, states, across = count(extra), extra.states, extra.across
    for i in range(36):
        kept[i] = P[(9 + i // 6) * STRIDE + 9 + i % 6]
    for j in range(p):
        for r in range(15):
            states[(layout.EXTRA_WHITE + r) * p + j] = across[j * STRIDE + r]
    for i in range(6):
        share = (layout.EXTRA_SHARE + i) * p
        for r in range(15):
            s = 0.0
            for j in range(p):
                s += states[share + j] * across[j * STRIDE + r]
            P[(9 + i) * STRIDE + r] += s
            P[r * STRIDE + 9 + i] += s
        for j in range(p):
            s = 0.0
            for m in range(p):
                s += states[share + m] * states[(layout.EXTRA_OWN + m) * p + j]
            states[(layout.EXTRA_WHITE + 9 + i) * p + j] += s
            for m in range(6):
                P[(9 + i) * STRIDE + 9 + m] += s * states[(layout.EXTRA_SHARE + m) * p + j]


@compiled
def carry(P, extra, par, dt, work):  # type: ignore[no-untyped-def]
    """Covariances after the lanes went through with z: of navigation from the lanes, across by regression on z.

    P_zz = L Lᵀ and the lanes stand at ± scale L, so Cov(nav', z) P_zz⁻¹ = (E⁺ - E⁻)/(2 scale) L⁻¹; what is left of nav'
    is not correlated with z, and x and b act on nav' through z alone. Hence Cov(nav', x) is that times Cov(z, x).
    """
    p, states, across, E, L = count(extra), extra.states, extra.across, work.E, work.L
    white = layout.EXTRA_WHITE * p
    for j in range(15):
        pivot = 1.0 / L[j * STRIDE + j]
        for i in range(p):
            states[white + j * p + i] *= pivot
        for r in range(j + 1, 15):
            for i in range(p):
                states[white + r * p + i] -= L[j * STRIDE + r] * states[white + j * p + i]
    half = 0.5 / math.sqrt(15.0 + par[layout.PAR_KAPPA])
    for r in range(9):
        for i in range(p):
            s = 0.0
            for j in range(15):
                s += (E[r * LANES + j] - E[r * LANES + j + 16]) * states[white + j * p + i]
            across[i * STRIDE + r] = half * s
        for i in range(6):
            # b is the effective bias less φ x
            s = P[r * STRIDE + 9 + i]
            for j in range(p):
                s -= states[(layout.EXTRA_SHARE + i) * p + j] * across[j * STRIDE + r]
            P[r * STRIDE + 9 + i] = s
            P[(9 + i) * STRIDE + r] = s
    for i in range(36):
        P[(9 + i // 6) * STRIDE + 9 + i % 6] = work.kept[i]
    for i in range(6):
        P[(9 + i) * STRIDE + 9 + i] += par[layout.PAR_NOISE + 6 + i] * dt


@compiled
def keep(extra):  # type: ignore[no-untyped-def]
    """Keep the covariances of x before an update, and forget its errors."""
    p, states, across = count(extra), extra.states, extra.across
    own = layout.EXTRA_OWN * p
    for i in range(p * STRIDE):
        across[p * STRIDE + i] = across[i]
    for i in range(p * p):
        states[own + p * p + i] = states[own + i]
    for i in range(p):
        states[layout.EXTRA_ERROR * p + i] = 0.0


@compiled
def restore(extra):  # type: ignore[no-untyped-def]
    """Bring back the covariances of x from before an update."""
    p, states, across = count(extra), extra.states, extra.across
    own = layout.EXTRA_OWN * p
    for i in range(p * STRIDE):
        across[i] = across[p * STRIDE + i]
    for i in range(p * p):
        states[own + i] = states[own + p * p + i]


@compiled
def correct_extra(extra, r, root, normal, u):  # type: ignore[no-untyped-def]
    """Update of x by row r: `u` is that row of P over √S, `root` 1/√S, `normal` the innovation over √S."""
    p, states, across = count(extra), extra.states, extra.across
    gain = layout.EXTRA_GAIN * p
    for j in range(p):
        k = across[j * STRIDE + r] * root
        states[gain + j] = k
        states[layout.EXTRA_ERROR * p + j] += normal * k
        store(across, j * STRIDE, plus(row(across, j * STRIDE), -k, u))
    for j in range(p):
        for i in range(p):
            states[(layout.EXTRA_OWN + j) * p + i] -= states[gain + j] * states[gain + i]


@compiled
def add_errors(extra):  # type: ignore[no-untyped-def]
    """Add to x what the update found it to be off by."""
    p, states = count(extra), extra.states
    for j in range(p):
        states[layout.EXTRA_MEAN * p + j] += states[layout.EXTRA_ERROR * p + j]


@compiled
def effect(extra, k, i):  # type: ignore[no-untyped-def]
    """Effect on channel i at sample k."""
    p, s = count(extra), 0.0
    for j in range(p):
        s += extra.phi[k, i, j] * extra.states[layout.EXTRA_MEAN * p + j]
    return s
