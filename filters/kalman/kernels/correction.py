"""The update, compiled: innovation, equation (10) one row at a time, and errors added to the state."""

import math

from filters.kalman import layout
from filters.kalman.kernels.arithmetic import (
    compiled,
    difference,
    logarithm,
    plus,
    product,
    quaternion,
    radii,
    row,
    scaled,
    store,
)
from filters.kalman.kernels.extra_states import add_errors, correct_extra, keep, restore
from filters.kalman.layout import STRIDE

MAX_REJECTIONS = 5
"""Updates that may be left out in a row: the reference is not wrong for long, so after these the filter is."""


@compiled
def apply(core, error):  # type: ignore[no-untyped-def]
    """State with errors added, as `NavState.plus`; the quaternion normalised."""
    r_n, r_e = radii(math.sin(core[0]))
    r_e = (r_e + core[2]) * math.cos(core[0])
    core[0] += error[0] / (r_n + core[2])
    core[1] += error[1] / r_e
    core[2] -= error[2]
    for i in range(3):
        core[layout.NAV_V + i] += error[3 + i]
    for i in range(6):
        core[layout.NAV_BA + i] += error[9 + i]
    x, y, z = error[6], error[7], error[8]
    half = 0.5 * math.sqrt(x * x + y * y + z * z) + 1e-300
    k = 0.5 * math.sin(half) / half
    q = product((math.cos(half), k * x, k * y, k * z), quaternion(core, layout.NAV_Q, 1))
    size = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        core[layout.NAV_Q + i] = q[i] * size


@compiled
def innovation(core, known, at, nu):  # type: ignore[no-untyped-def]
    """Nine errors that turn the state into what is known, as `NavState.minus`."""
    r_n, r_e = radii(math.sin(core[0]))
    nu[0] = (known[at] - core[0]) * (r_n + core[2])
    d = known[at + 1] - core[1]
    d -= 2.0 * math.pi * math.floor(d / (2.0 * math.pi) + 0.5)
    nu[1] = d * (r_e + core[2]) * math.cos(core[0])
    nu[2] = core[2] - known[at + 2]
    for i in range(3):
        nu[3 + i] = known[at + layout.KNOWN_V + i] - core[layout.NAV_V + i]
    turned = logarithm(difference(quaternion(known, at + layout.KNOWN_Q, 1), quaternion(core, layout.NAV_Q, 1)))
    for i in range(3):
        nu[6 + i] = turned[i]


@compiled
def correct(run, samples, k, at, work, extra):  # type: ignore[no-untyped-def]
    """Correction (10), H = [I9 0] and R diagonal: one scalar update a row. Returns -1 or the row that failed.

    `k` is the number of the sample, `at` where what is known of it begins.
    """
    core, P, known = run.core, run.P, samples.known
    nu, error, gain, saved = work.nu, work.error, work.gain, work.saved
    innovation(core, known, at, nu)
    for i in range(15 * STRIDE):
        saved[i] = P[i]
    for i in range(STRIDE):
        error[i] = 0.0
    if extra is not None:
        keep(extra)
    nis = 0.0
    dof = 0
    for r in range(9):
        variance = known[at + layout.KNOWN_R + r]
        core[layout.CORE_NU + r] = math.nan
        if variance < 0.0:
            continue
        if samples.draws.size:
            nu[r] += math.sqrt(variance) * samples.draws[k, r]
        core[layout.CORE_NU + r] = nu[r]
        S = P[r * STRIDE + r] + variance
        if not S > 0.0:
            return r
        root = 1.0 / math.sqrt(S)
        normal = (nu[r] - error[r]) * root
        nis += normal * normal
        dof += 1
        u = scaled(row(P, r * STRIDE), root)
        store(error, 0, plus(row(error, 0), normal, u))
        for i in range(15):
            gain[i] = P[i * STRIDE + r] * root
        for i in range(15):
            store(P, i * STRIDE, plus(row(P, i * STRIDE), -gain[i], u))
        if extra is not None:
            correct_extra(extra, r, root, normal, u)
    core[layout.CORE_DOF_LAST] = dof
    if dof == 0:
        core[layout.CORE_NIS_LAST] = math.nan
        return -1
    core[layout.CORE_NIS_LAST] = nis
    if core[layout.CORE_NIS_COUNT] == 0.0:
        core[layout.CORE_NIS_FIRST] = nis
    core[layout.CORE_NIS_SUM] += nis
    core[layout.CORE_DOF_SUM] += dof
    core[layout.CORE_NIS_COUNT] += 1.0
    if nis > run.par[layout.PAR_GATE + dof]:
        if core[layout.CORE_IN_A_ROW] < MAX_REJECTIONS:
            core[layout.CORE_REJECTED] += 1.0
            core[layout.CORE_IN_A_ROW] += 1.0
            for i in range(15 * STRIDE):
                P[i] = saved[i]
            if extra is not None:
                restore(extra)
            return -1
        core[layout.CORE_OVERRULED] += 1.0
    core[layout.CORE_IN_A_ROW] = 0.0
    apply(core, error)
    if extra is not None:
        add_errors(extra)
    return -1
