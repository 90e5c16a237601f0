"""The step of `spkf`, compiled: equations (1)-(5), (11)-(15) and (10) over 32 lanes, and the loop over samples.

The same mathematics as `strapdown` and `spkf`, which are written to be read; a test holds the two together. What is
different here is there for speed: 31 sigma points and a spare in 32 lanes of flat arrays with constant offsets, so
that each loop runs as vector instructions; quaternions and short series instead of sines, which the 0.2 rad of a
substep allow; biases, which have no dynamics, left out of the propagation; and one scalar update a row, which needs no
inverse. `fastmath` stays off: it may drop the very terms that keep rounding harmless.

The arrays are laid out as `filters.kalman.layout` says.

States beyond the 15 (`filters.kalman.augmentation`) act through the effective bias b + φ x alone. The step therefore
takes the lanes through with z = (navigation errors, effective bias), 15 of them whatever p is, and carries the rest
along with the linear regression of the lanes on z; see `_carry`. Everything compiled stays in this one file: numba's
cache would not notice a change in another.
"""

import math
from typing import Any

import numba

from filters import earth
from filters.kalman.layout import (
    CORE_ACCEL,
    CORE_DOF_LAST,
    CORE_DOF_SUM,
    CORE_GYRO,
    CORE_IN_A_ROW,
    CORE_NEXT_OUT,
    CORE_NIS_COUNT,
    CORE_NIS_FIRST,
    CORE_NIS_LAST,
    CORE_NIS_SUM,
    CORE_NU,
    CORE_OVERRULED,
    CORE_REJECTED,
    CORE_SAMPLES,
    CORE_SPREAD,
    CORE_T,
    DONE,
    EXTRA_BEFORE,
    EXTRA_DENSITY,
    EXTRA_ERROR,
    EXTRA_GAIN,
    EXTRA_MEAN,
    EXTRA_OWN,
    EXTRA_SHARE,
    EXTRA_TAU,
    EXTRA_WHITE,
    INDEFINITE,
    KNOWN,
    KNOWN_FORCE,
    KNOWN_Q,
    KNOWN_R,
    KNOWN_RATE,
    KNOWN_V,
    MOMENT_COUNT,
    MOMENT_MEAN,
    MOMENT_SCATTER,
    NAV,
    NAV_BA,
    NAV_BG,
    NAV_Q,
    NAV_V,
    NOT_FINITE,
    OUT_DOF,
    OUT_INDEX,
    OUT_NAV,
    OUT_NIS,
    OUT_NU,
    OUT_P,
    OUT_T,
    PAR_EVERY,
    PAR_GATE,
    PAR_GRAVITY_ANOMALY,
    PAR_KAPPA,
    PAR_LINEAR,
    PAR_NOISE,
    PAR_PERIOD,
    PAR_WHITE,
    STRIDE,
    SUM_BIAS,
    SUM_BIASES,
    SUM_RESIDUAL,
    SUM_RESIDUALS,
)
from filters.kalman.settings import GAP_PERIODS
from filters.kalman.strapdown import MAX_STEP, MAX_STEP_ANGLE

# vector instructions out of straight-line code (rows below), which numba leaves off unless told
numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]

LANES = 32
CENTRE = 15
"""Lanes 0..14 are x̂ + columns, 15 the centre, 16..30 x̂ - columns, 31 a copy of the centre."""
MAX_REJECTIONS = 5
"""Updates that may be left out in a row: the reference is not wrong for long, so after these the filter is."""

_E2 = earth.ECCENTRICITY_SQUARED
_A = earth.SEMI_MAJOR_AXIS
_F = earth.FLATTENING
_OMEGA = earth.EARTH_RATE
_G0 = earth.EQUATORIAL_GRAVITY
_K = earth.SOMIGLIANA
_M = earth._M_RATIO
_LN = LANES


def _compiled(function: Any) -> Any:
    """Numba's compiler with the settings of this module: numpy's rules of arithmetic, no lock held, kept on disk."""
    return numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=False)(function)


# Rows of 16 numbers, held in registers: written out, since only so the compiler makes vector instructions of them.


@_compiled
def _row(A, b):  # type: ignore[no-untyped-def]
    """Row of `A` that begins at b."""
    return (A[b], A[b + 1], A[b + 2], A[b + 3], A[b + 4], A[b + 5], A[b + 6], A[b + 7],
            A[b + 8], A[b + 9], A[b + 10], A[b + 11], A[b + 12], A[b + 13], A[b + 14], A[b + 15])  # fmt: skip


@_compiled
def _scaled(u, k):  # type: ignore[no-untyped-def]
    """Row times a number."""
    return (u[0] * k, u[1] * k, u[2] * k, u[3] * k, u[4] * k, u[5] * k, u[6] * k, u[7] * k,
            u[8] * k, u[9] * k, u[10] * k, u[11] * k, u[12] * k, u[13] * k, u[14] * k, u[15] * k)  # fmt: skip


@_compiled
def _plus(a, k, u):  # type: ignore[no-untyped-def]
    """Row a plus k times row u."""
    return (a[0] + k * u[0], a[1] + k * u[1], a[2] + k * u[2], a[3] + k * u[3],
            a[4] + k * u[4], a[5] + k * u[5], a[6] + k * u[6], a[7] + k * u[7],
            a[8] + k * u[8], a[9] + k * u[9], a[10] + k * u[10], a[11] + k * u[11],
            a[12] + k * u[12], a[13] + k * u[13], a[14] + k * u[14], a[15] + k * u[15])  # fmt: skip


@_compiled
def _store(A, b, u):  # type: ignore[no-untyped-def]
    """Write a row to `A` from b on."""
    A[b], A[b + 1], A[b + 2], A[b + 3], A[b + 4], A[b + 5], A[b + 6], A[b + 7] = u[:8]
    A[b + 8], A[b + 9], A[b + 10], A[b + 11], A[b + 12], A[b + 13], A[b + 14], A[b + 15] = u[8:]


@_compiled
def _cholesky(P, L):  # type: ignore[no-untyped-def]
    """Lower factor of P; column j of L stands in L[j * STRIDE:]. Returns -1, or the row at which P is not definite.

    Columns are subtracted from all that remains, whole rows at a time: no sum is reordered, every loop is a vector's.
    """
    for i in range(15 * STRIDE):
        L[i] = P[i]
    for j in range(15):
        pivot = L[j * STRIDE + j]
        if not pivot > 0.0:
            return j
        column = _scaled(_row(L, j * STRIDE), 1.0 / math.sqrt(pivot))
        _store(L, j * STRIDE, column)
        for i in range(j):
            L[j * STRIDE + i] = 0.0
        for k in range(j + 1, 15):
            _store(L, k * STRIDE, _plus(_row(L, k * STRIDE), -L[j * STRIDE + k], column))
    return -1


@_compiled
def _lanes_start(core, L, scale, X):  # type: ignore[no-untyped-def]
    """Sigma points (11): X rows 0..9 latitude, longitude, height, velocity, quaternion; 10..15 biases."""
    s_lat, c_lat = math.sin(core[0]), math.cos(core[0])
    w2 = 1.0 - _E2 * s_lat * s_lat
    per_n = 1.0 / (_A * (1.0 - _E2) / (w2 * math.sqrt(w2)) + core[2])
    per_e = 1.0 / ((_A / math.sqrt(w2) + core[2]) * c_lat)
    for r in range(NAV):
        for j in range(_LN):
            X[r * _LN + j] = core[r]
    largest = 0.0
    for j in range(15):
        d = scale * L[j * STRIDE + 0]
        X[j] += d * per_n
        X[j + 16] -= d * per_n
        d = scale * L[j * STRIDE + 1]
        X[_LN + j] += d * per_e
        X[_LN + j + 16] -= d * per_e
        d = scale * L[j * STRIDE + 2]
        X[2 * _LN + j] -= d
        X[2 * _LN + j + 16] += d
        for r in range(3):
            d = scale * L[j * STRIDE + 3 + r]
            X[(NAV_V + r) * _LN + j] += d
            X[(NAV_V + r) * _LN + j + 16] -= d
        for r in range(6):
            d = scale * L[j * STRIDE + 9 + r]
            X[(NAV_BA + r) * _LN + j] += d
            X[(NAV_BA + r) * _LN + j + 16] -= d
        ex, ey, ez = scale * L[j * STRIDE + 6], scale * L[j * STRIDE + 7], scale * L[j * STRIDE + 8]
        if ex != 0.0 or ey != 0.0 or ez != 0.0:
            t = 0.25 * (ex * ex + ey * ey + ez * ez)
            if t > largest:
                largest = t
            if t < 0.0025:
                c, h = _cos_series(t), 0.5 * _sinc_series(t)
            else:
                half = math.sqrt(t)
                c, h = math.cos(half), 0.5 * math.sin(half) / half
            for side in range(2):
                sign = 1.0 - 2.0 * side
                _quaternion_left(c, sign * h * ex, sign * h * ey, sign * h * ez, core, X, j + 16 * side)


@_compiled
def _cos_series(t):  # type: ignore[no-untyped-def]
    """cos √t for t ≤ 0.0025, to rounding."""
    return 1.0 + t * (-0.5 + t * (1.0 / 24.0 + t * (-1.0 / 720.0 + t * (1.0 / 40320.0))))


@_compiled
def _sinc_series(t):  # type: ignore[no-untyped-def]
    """sin √t/√t for t ≤ 0.0025, to rounding."""
    return 1.0 + t * (-1.0 / 6.0 + t * (1.0 / 120.0 + t * (-1.0 / 5040.0 + t * (1.0 / 362880.0))))


@_compiled
def _quaternion_left(w, x, y, z, core, X, j):  # type: ignore[no-untyped-def]
    """Lane j's attitude: (w, x, y, z) times the state's."""
    a, b, c, d = core[NAV_Q], core[NAV_Q + 1], core[NAV_Q + 2], core[NAV_Q + 3]
    X[NAV_Q * _LN + j] = w * a - x * b - y * c - z * d
    X[(NAV_Q + 1) * _LN + j] = w * b + x * a + y * d - z * c
    X[(NAV_Q + 2) * _LN + j] = w * c - x * d + y * a + z * b
    X[(NAV_Q + 3) * _LN + j] = w * d + x * c - y * b + z * a


@_compiled
def _lanes_fastest(X, gyro):  # type: ignore[no-untyped-def]
    """Largest angular rate of any lane at either end of the step, squared."""
    fastest = 0.0
    for end in range(2):
        g0, g1, g2 = gyro[3 * end], gyro[3 * end + 1], gyro[3 * end + 2]
        for j in range(_LN):
            x = g0 - X[NAV_BG * _LN + j]
            y = g1 - X[(NAV_BG + 1) * _LN + j]
            z = g2 - X[(NAV_BG + 2) * _LN + j]
            square = x * x + y * y + z * z
            if square > fastest:
                fastest = square
    return fastest


@_compiled
def _lanes_substep(X, gyro, accel, a0, a1, h, gravity):  # type: ignore[no-untyped-def]
    """One substep of (1)-(4) for every lane; readings are linear from share a0 of the step to share a1.

    `gyro` and `accel` hold the readings at the start and the end of the whole step.
    """
    am = 0.5 * (a0 + a1)
    # mean rate of each half, and force at start, middle and end
    b1, b2 = 0.5 * (a0 + am), 0.5 * (am + a1)
    p0 = gyro[0] + b1 * (gyro[3] - gyro[0])
    p1 = gyro[1] + b1 * (gyro[4] - gyro[1])
    p2 = gyro[2] + b1 * (gyro[5] - gyro[2])
    r0 = gyro[0] + b2 * (gyro[3] - gyro[0])
    r1 = gyro[1] + b2 * (gyro[4] - gyro[1])
    r2 = gyro[2] + b2 * (gyro[5] - gyro[2])
    fs0 = accel[0] + a0 * (accel[3] - accel[0])
    fs1 = accel[1] + a0 * (accel[4] - accel[1])
    fs2 = accel[2] + a0 * (accel[5] - accel[2])
    fm0 = accel[0] + am * (accel[3] - accel[0])
    fm1 = accel[1] + am * (accel[4] - accel[1])
    fm2 = accel[2] + am * (accel[5] - accel[2])
    fe0 = accel[0] + a1 * (accel[3] - accel[0])
    fe1 = accel[1] + a1 * (accel[4] - accel[1])
    fe2 = accel[2] + a1 * (accel[5] - accel[2])
    lat_c = X[CENTRE]
    s_c, c_c = math.sin(lat_c), math.cos(lat_c)
    half = 0.5 * h
    quarter = 0.25 * h
    two_omega = 2.0 * _OMEGA
    for j in range(_LN):
        # the lanes' latitudes differ by so little that three terms are exact
        d = X[j] - lat_c
        dd = 0.5 * d * d
        s = s_c + d * c_c - dd * s_c - dd * d * (1.0 / 3.0) * c_c
        c = c_c - d * s_c - dd * c_c + dd * d * (1.0 / 3.0) * s_c
        w2 = 1.0 - _E2 * s * s
        root = math.sqrt(w2)
        height = X[2 * _LN + j]
        per_n = 1.0 / (_A * (1.0 - _E2) / (w2 * root) + height)
        per_e = 1.0 / (_A / root + height)
        tan = s / c
        vn, ve, vd = X[3 * _LN + j], X[4 * _LN + j], X[5 * _LN + j]
        q0, q1, q2, q3 = X[6 * _LN + j], X[7 * _LN + j], X[8 * _LN + j], X[9 * _LN + j]
        ba0, ba1, ba2 = X[10 * _LN + j], X[11 * _LN + j], X[12 * _LN + j]
        bg0, bg1, bg2 = X[13 * _LN + j], X[14 * _LN + j], X[15 * _LN + j]

        # force in n at the start: f + 2 q × (q × f + q0 f)
        x, y, z = fs0 - ba0, fs1 - ba1, fs2 - ba2
        tx = q2 * z - q3 * y + q0 * x
        ty = q3 * x - q1 * z + q0 * y
        tz = q1 * y - q2 * x + q0 * z
        fn = x + 2.0 * (q2 * tz - q3 * ty)
        fe = y + 2.0 * (q3 * tx - q1 * tz)
        fd = z + 2.0 * (q1 * ty - q2 * tx)

        # (2) at the start
        north, east = vn * per_n, ve * per_e
        spin = two_omega * s + east * tan
        lean = two_omega * c + east
        a1n = fn - spin * ve + north * vd
        a1e = fe + spin * vn + lean * vd
        a1d = fd + gravity - lean * ve - north * vn
        v2n, v2e, v2d = vn + half * a1n, ve + half * a1e, vd + half * a1d

        # last bracket of (3), from the velocity in the middle; it turns n backwards
        ux = -quarter * (_OMEGA * c + v2e * per_e)
        uy = quarter * v2n * per_n
        uz = quarter * (_OMEGA * s + v2e * tan * per_e)
        t = ux * ux + uy * uy + uz * uz
        nc, ns = _cos_series(t), _sinc_series(t)
        ux, uy, uz = ns * ux, ns * uy, ns * uz

        # first half: q ← n q b
        x, y, z = quarter * (p0 - bg0), quarter * (p1 - bg1), quarter * (p2 - bg2)
        t = x * x + y * y + z * z
        bc, bs = _cos_series(t), _sinc_series(t)
        x, y, z = bs * x, bs * y, bs * z
        k0 = nc * q0 - ux * q1 - uy * q2 - uz * q3
        k1 = nc * q1 + ux * q0 + uy * q3 - uz * q2
        k2 = nc * q2 - ux * q3 + uy * q0 + uz * q1
        k3 = nc * q3 + ux * q2 - uy * q1 + uz * q0
        q0 = k0 * bc - k1 * x - k2 * y - k3 * z
        q1 = k0 * x + k1 * bc + k2 * z - k3 * y
        q2 = k0 * y - k1 * z + k2 * bc + k3 * x
        q3 = k0 * z + k1 * y - k2 * x + k3 * bc

        # force in n in the middle; (2) twice
        x, y, z = fm0 - ba0, fm1 - ba1, fm2 - ba2
        tx = q2 * z - q3 * y + q0 * x
        ty = q3 * x - q1 * z + q0 * y
        tz = q1 * y - q2 * x + q0 * z
        fn = x + 2.0 * (q2 * tz - q3 * ty)
        fe = y + 2.0 * (q3 * tx - q1 * tz)
        fd = z + 2.0 * (q1 * ty - q2 * tx)
        north, east = v2n * per_n, v2e * per_e
        spin = two_omega * s + east * tan
        lean = two_omega * c + east
        a2n = fn - spin * v2e + north * v2d
        a2e = fe + spin * v2n + lean * v2d
        a2d = fd + gravity - lean * v2e - north * v2n
        v3n, v3e, v3d = vn + half * a2n, ve + half * a2e, vd + half * a2d
        north, east = v3n * per_n, v3e * per_e
        spin = two_omega * s + east * tan
        lean = two_omega * c + east
        a3n = fn - spin * v3e + north * v3d
        a3e = fe + spin * v3n + lean * v3d
        a3d = fd + gravity - lean * v3e - north * v3n
        v4n, v4e, v4d = vn + h * a3n, ve + h * a3e, vd + h * a3d

        # second half
        x, y, z = quarter * (r0 - bg0), quarter * (r1 - bg1), quarter * (r2 - bg2)
        t = x * x + y * y + z * z
        bc, bs = _cos_series(t), _sinc_series(t)
        x, y, z = bs * x, bs * y, bs * z
        k0 = nc * q0 - ux * q1 - uy * q2 - uz * q3
        k1 = nc * q1 + ux * q0 + uy * q3 - uz * q2
        k2 = nc * q2 - ux * q3 + uy * q0 + uz * q1
        k3 = nc * q3 + ux * q2 - uy * q1 + uz * q0
        q0 = k0 * bc - k1 * x - k2 * y - k3 * z
        q1 = k0 * x + k1 * bc + k2 * z - k3 * y
        q2 = k0 * y - k1 * z + k2 * bc + k3 * x
        q3 = k0 * z + k1 * y - k2 * x + k3 * bc

        # force in n at the end; (2) the last time
        x, y, z = fe0 - ba0, fe1 - ba1, fe2 - ba2
        tx = q2 * z - q3 * y + q0 * x
        ty = q3 * x - q1 * z + q0 * y
        tz = q1 * y - q2 * x + q0 * z
        fn = x + 2.0 * (q2 * tz - q3 * ty)
        fe = y + 2.0 * (q3 * tx - q1 * tz)
        fd = z + 2.0 * (q1 * ty - q2 * tx)
        north, east = v4n * per_n, v4e * per_e
        spin = two_omega * s + east * tan
        lean = two_omega * c + east
        a4n = fn - spin * v4e + north * v4d
        a4e = fe + spin * v4n + lean * v4d
        a4d = fd + gravity - lean * v4e - north * v4n

        sixth = h * (1.0 / 6.0)
        X[j] += sixth * (vn + 2.0 * (v2n + v3n) + v4n) * per_n
        X[_LN + j] += sixth * (ve + 2.0 * (v2e + v3e) + v4e) * per_e / c
        X[2 * _LN + j] -= sixth * (vd + 2.0 * (v2d + v3d) + v4d)
        X[3 * _LN + j] = vn + sixth * (a1n + 2.0 * (a2n + a3n) + a4n)
        X[4 * _LN + j] = ve + sixth * (a1e + 2.0 * (a2e + a3e) + a4e)
        X[5 * _LN + j] = vd + sixth * (a1d + 2.0 * (a2d + a3d) + a4d)
        X[6 * _LN + j] = q0
        X[7 * _LN + j] = q1
        X[8 * _LN + j] = q2
        X[9 * _LN + j] = q3


@_compiled
def _lanes_errors(X, E):  # type: ignore[no-untyped-def]
    """Errors of each lane against the centre, E rows 0..8: metres, m/s, rotation vector in n."""
    lat, lon, height = X[CENTRE], X[_LN + CENTRE], X[2 * _LN + CENTRE]
    s = math.sin(lat)
    w2 = 1.0 - _E2 * s * s
    r_n = _A * (1.0 - _E2) / (w2 * math.sqrt(w2)) + height
    r_e = (_A / math.sqrt(w2) + height) * math.cos(lat)
    v0, v1, v2 = X[3 * _LN + CENTRE], X[4 * _LN + CENTRE], X[5 * _LN + CENTRE]
    c0, c1, c2, c3 = X[6 * _LN + CENTRE], X[7 * _LN + CENTRE], X[8 * _LN + CENTRE], X[9 * _LN + CENTRE]
    for j in range(_LN):
        E[j] = (X[j] - lat) * r_n
        E[_LN + j] = (X[_LN + j] - lon) * r_e
        E[2 * _LN + j] = height - X[2 * _LN + j]
        E[3 * _LN + j] = X[3 * _LN + j] - v0
        E[4 * _LN + j] = X[4 * _LN + j] - v1
        E[5 * _LN + j] = X[5 * _LN + j] - v2
    largest = 0.0
    for j in range(_LN):
        # vector part of q_j q_c*
        w, x, y, z = X[6 * _LN + j], X[7 * _LN + j], X[8 * _LN + j], X[9 * _LN + j]
        ex = -w * c1 + x * c0 - y * c3 + z * c2
        ey = -w * c2 + x * c3 + y * c0 - z * c1
        ez = -w * c3 - x * c2 + y * c1 + z * c0
        t = ex * ex + ey * ey + ez * ez
        largest = max(largest, t)
        # 2 asin(√t)/√t, to rounding for √t ≤ 0.1
        k = 2.0 + t * (
            1.0 / 3.0
            + t * (3.0 / 20.0 + t * (5.0 / 56.0 + t * (35.0 / 576.0 + t * (63.0 / 1408.0 + t * (231.0 / 6656.0)))))
        )
        E[6 * _LN + j] = k * ex
        E[7 * _LN + j] = k * ey
        E[8 * _LN + j] = k * ez
    if largest > 0.01:
        for j in range(_LN):
            w, x, y, z = X[6 * _LN + j], X[7 * _LN + j], X[8 * _LN + j], X[9 * _LN + j]
            real = w * c0 + x * c1 + y * c2 + z * c3
            ex = -w * c1 + x * c0 - y * c3 + z * c2
            ey = -w * c2 + x * c3 + y * c0 - z * c1
            ez = -w * c3 - x * c2 + y * c1 + z * c0
            size = math.sqrt(ex * ex + ey * ey + ez * ez) + 1e-300
            k = 2.0 * math.atan2(math.copysign(size, real), abs(real)) / size
            E[6 * _LN + j] = k * ex
            E[7 * _LN + j] = k * ey
            E[8 * _LN + j] = k * ez


@_compiled
def _covariance(E, L, scale, weight, mean, D, P):  # type: ignore[no-untyped-def]
    """Mean of the errors (14) and their covariance (15) without Q_d; the block of the biases stays.

    D holds the deviations, a row a lane: nine errors, then six biases, which are still the sigma points' own.
    """
    for r in range(9):
        for j in range(_LN - 1):
            D[j * STRIDE + r] = E[r * _LN + j]
    for j in range(15):
        for i in range(9, 15):
            d = scale * L[j * STRIDE + i]
            D[j * STRIDE + i] = d
            D[(j + 16) * STRIDE + i] = -d
    for i in range(STRIDE):
        mean[i] = 0.0
    for i in range(9 * STRIDE):
        P[i] = 0.0
    for j in range(_LN - 1):
        if j == CENTRE:
            continue
        deviation = _row(D, j * STRIDE)
        _store(mean, 0, _plus(_row(mean, 0), weight, deviation))
        for r in range(9):
            _store(P, r * STRIDE, _plus(_row(P, r * STRIDE), weight * D[j * STRIDE + r], deviation))
    total = _row(mean, 0)
    for r in range(9):
        _store(P, r * STRIDE, _plus(_row(P, r * STRIDE), -mean[r], total))
    for r in range(9):
        for i in range(9, 15):
            P[i * STRIDE + r] = P[r * STRIDE + i]
    for i in range(9, STRIDE):
        mean[i] = 0.0


@_compiled
def _add_noise(w, x, y, z, par, dt, held, turned, P):  # type: ignore[no-untyped-def]
    """Q_d of `spkf.process_noise` at the attitude (w, x, y, z)."""
    c00, c01, c02 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    c10, c11, c12 = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    c20, c21, c22 = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    for block in range(2):
        at = 3 + 3 * block
        k = dt * held
        n0, n1, n2 = par[PAR_NOISE + 3 * block] * k, par[PAR_NOISE + 3 * block + 1] * k, 0.0
        n2 = par[PAR_NOISE + 3 * block + 2] * k
        q00 = c00 * c00 * n0 + c01 * c01 * n1 + c02 * c02 * n2
        q01 = c00 * c10 * n0 + c01 * c11 * n1 + c02 * c12 * n2
        q02 = c00 * c20 * n0 + c01 * c21 * n1 + c02 * c22 * n2
        q11 = c10 * c10 * n0 + c11 * c11 * n1 + c12 * c12 * n2
        q12 = c10 * c20 * n0 + c11 * c21 * n1 + c12 * c22 * n2
        q22 = c20 * c20 * n0 + c21 * c21 * n1 + c22 * c22 * n2
        extra = turned * turned * block
        P[at * STRIDE + at] += q00 + extra
        P[(at + 1) * STRIDE + at + 1] += q11 + extra
        P[(at + 2) * STRIDE + at + 2] += q22 + extra
        P[at * STRIDE + at + 1] += q01
        P[(at + 1) * STRIDE + at] += q01
        P[at * STRIDE + at + 2] += q02
        P[(at + 2) * STRIDE + at] += q02
        P[(at + 1) * STRIDE + at + 2] += q12
        P[(at + 2) * STRIDE + at + 1] += q12
    for i in range(6):
        P[(9 + i) * STRIDE + 9 + i] += par[PAR_NOISE + 6 + i] * dt


@_compiled
def _apply(core, error):  # type: ignore[no-untyped-def]
    """State with errors added, as `NavState.plus`; the quaternion normalised."""
    s = math.sin(core[0])
    w2 = 1.0 - _E2 * s * s
    r_n = _A * (1.0 - _E2) / (w2 * math.sqrt(w2)) + core[2]
    r_e = (_A / math.sqrt(w2) + core[2]) * math.cos(core[0])
    core[0] += error[0] / r_n
    core[1] += error[1] / r_e
    core[2] -= error[2]
    for i in range(3):
        core[NAV_V + i] += error[3 + i]
    for i in range(6):
        core[NAV_BA + i] += error[9 + i]
    x, y, z = error[6], error[7], error[8]
    half = 0.5 * math.sqrt(x * x + y * y + z * z) + 1e-300
    k = 0.5 * math.sin(half) / half
    w, x, y, z = math.cos(half), k * x, k * y, k * z
    a, b, c, d = core[NAV_Q], core[NAV_Q + 1], core[NAV_Q + 2], core[NAV_Q + 3]
    q0 = w * a - x * b - y * c - z * d
    q1 = w * b + x * a + y * d - z * c
    q2 = w * c - x * d + y * a + z * b
    q3 = w * d + x * c - y * b + z * a
    size = 1.0 / math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    core[NAV_Q], core[NAV_Q + 1], core[NAV_Q + 2], core[NAV_Q + 3] = q0 * size, q1 * size, q2 * size, q3 * size


@_compiled
def _innovation(core, known, at, nu):  # type: ignore[no-untyped-def]
    """Nine errors that turn the state into what is known, as `NavState.minus`."""
    s = math.sin(core[0])
    w2 = 1.0 - _E2 * s * s
    nu[0] = (known[at] - core[0]) * (_A * (1.0 - _E2) / (w2 * math.sqrt(w2)) + core[2])
    d = known[at + 1] - core[1]
    d -= 2.0 * math.pi * math.floor(d / (2.0 * math.pi) + 0.5)
    nu[1] = d * (_A / math.sqrt(w2) + core[2]) * math.cos(core[0])
    nu[2] = core[2] - known[at + 2]
    for i in range(3):
        nu[3 + i] = known[at + KNOWN_V + i] - core[NAV_V + i]
    w, x, y, z = known[at + KNOWN_Q], known[at + KNOWN_Q + 1], known[at + KNOWN_Q + 2], known[at + KNOWN_Q + 3]
    a, b, c, d = core[NAV_Q], core[NAV_Q + 1], core[NAV_Q + 2], core[NAV_Q + 3]
    real = w * a + x * b + y * c + z * d
    ex = -w * b + x * a - y * d + z * c
    ey = -w * c + x * d + y * a - z * b
    ez = -w * d - x * c + y * b + z * a
    size = math.sqrt(ex * ex + ey * ey + ez * ez) + 1e-300
    k = 2.0 * math.atan2(math.copysign(size, real), abs(real)) / size
    nu[6], nu[7], nu[8] = k * ex, k * ey, k * ez


# States beyond the 15, p of them, which is known at run time only; `extra` and `across` are laid out as `layout` says.


@_compiled
def _drift(extra, across, p, dt):  # type: ignore[no-untyped-def]
    """x ← x exp(-dt/τ), with its covariances, and the variance that w adds over dt; as `augmentation.drift`."""
    for j in range(p):
        tau, power = extra[EXTRA_TAU * p + j], extra[EXTRA_DENSITY * p + j] ** 2
        keep = math.exp(-dt / tau)
        grown = power * dt if math.isinf(tau) else -0.5 * power * tau * math.expm1(-2.0 * dt / tau)
        extra[EXTRA_MEAN * p + j] *= keep
        for i in range(STRIDE):
            across[j * STRIDE + i] *= keep
        for i in range(p):
            extra[(EXTRA_OWN + j) * p + i] *= keep
            extra[(EXTRA_OWN + i) * p + j] *= keep
        extra[(EXTRA_OWN + j) * p + j] += grown


@_compiled
def _take_away(extra, p, phi, k, linear, gyro, accel):  # type: ignore[no-untyped-def]
    """Take the mean effect from the readings at both ends of the step, and note the share of x in the bias of it.

    What x is off by is taken with the mean of both regressors: the angle and, to dt²/12, the velocity are the same.
    """
    for i in range(6):
        start, end = 0.0, 0.0
        for j in range(p):
            last = phi[k, i, j]
            first = extra[(EXTRA_BEFORE + i) * p + j] if linear else last
            extra[(EXTRA_SHARE + i) * p + j] = 0.5 * (first + last)
            start += first * extra[EXTRA_MEAN * p + j]
            end += last * extra[EXTRA_MEAN * p + j]
        if i < 3:
            accel[i] -= start
            accel[3 + i] -= end
        else:
            gyro[i - 3] -= start
            gyro[i] -= end


@_compiled
def _gather(P, extra, across, p, kept):  # type: ignore[no-untyped-def]
    """P ← covariance of z = (navigation errors, b + φ x), its block of b put by; and Cov(z, x)."""
    for i in range(36):
        kept[i] = P[(9 + i // 6) * STRIDE + 9 + i % 6]
    for j in range(p):
        for r in range(15):
            extra[(EXTRA_WHITE + r) * p + j] = across[j * STRIDE + r]
    for i in range(6):
        share = (EXTRA_SHARE + i) * p
        for r in range(15):
            s = 0.0
            for j in range(p):
                s += extra[share + j] * across[j * STRIDE + r]
            P[(9 + i) * STRIDE + r] += s
            P[r * STRIDE + 9 + i] += s
        for j in range(p):
            s = 0.0
            for m in range(p):
                s += extra[share + m] * extra[(EXTRA_OWN + m) * p + j]
            extra[(EXTRA_WHITE + 9 + i) * p + j] += s
            for m in range(6):
                P[(9 + i) * STRIDE + 9 + m] += s * extra[(EXTRA_SHARE + m) * p + j]


@_compiled
def _carry(P, extra, across, p, kept, E, L, par, dt):  # type: ignore[no-untyped-def]
    """Covariances after the lanes went through with z: of navigation from the lanes, across by regression on z.

    P_zz = L Lᵀ and the lanes stand at ± scale L, so Cov(nav', z) P_zz⁻¹ = (E⁺ - E⁻)/(2 scale) L⁻¹; what is left of nav'
    is not correlated with z, and x and b act on nav' through z alone. Hence Cov(nav', x) is that times Cov(z, x).
    """
    white = EXTRA_WHITE * p
    for j in range(15):
        pivot = 1.0 / L[j * STRIDE + j]
        for i in range(p):
            extra[white + j * p + i] *= pivot
        for r in range(j + 1, 15):
            for i in range(p):
                extra[white + r * p + i] -= L[j * STRIDE + r] * extra[white + j * p + i]
    half = 0.5 / math.sqrt(15.0 + par[PAR_KAPPA])
    for r in range(9):
        for i in range(p):
            s = 0.0
            for j in range(15):
                s += (E[r * _LN + j] - E[r * _LN + j + 16]) * extra[white + j * p + i]
            across[i * STRIDE + r] = half * s
        for i in range(6):
            # b is the effective bias less φ x
            s = P[r * STRIDE + 9 + i]
            for j in range(p):
                s -= extra[(EXTRA_SHARE + i) * p + j] * across[j * STRIDE + r]
            P[r * STRIDE + 9 + i] = s
            P[(9 + i) * STRIDE + r] = s
    for i in range(36):
        P[(9 + i // 6) * STRIDE + 9 + i % 6] = kept[i]
    for i in range(6):
        P[(9 + i) * STRIDE + 9 + i] += par[PAR_NOISE + 6 + i] * dt


@_compiled
def _keep_or_restore(extra, across, p, keep):  # type: ignore[no-untyped-def]
    """Keep the covariances of x before an update, or bring them back; forget its errors."""
    own, size = EXTRA_OWN * p, p * STRIDE
    for i in range(size):
        if keep:
            across[size + i] = across[i]
        else:
            across[i] = across[size + i]
    for i in range(p * p):
        if keep:
            extra[own + p * p + i] = extra[own + i]
        else:
            extra[own + i] = extra[own + p * p + i]
    for i in range(p):
        extra[EXTRA_ERROR * p + i] = 0.0


@_compiled
def _correct_extra(extra, across, p, r, root, normal, u):  # type: ignore[no-untyped-def]
    """Update of x by row r: `u` is that row of P over √S, `root` 1/√S, `normal` the innovation over √S."""
    gain = EXTRA_GAIN * p
    for j in range(p):
        k = across[j * STRIDE + r] * root
        extra[gain + j] = k
        extra[EXTRA_ERROR * p + j] += normal * k
        _store(across, j * STRIDE, _plus(_row(across, j * STRIDE), -k, u))
    for j in range(p):
        for i in range(p):
            extra[(EXTRA_OWN + j) * p + i] -= extra[gain + j] * extra[gain + i]


@_compiled
def _effect(extra, p, phi, k, i):  # type: ignore[no-untyped-def]
    """Effect on channel i at sample k."""
    s = 0.0
    for j in range(p):
        s += phi[k, i, j] * extra[EXTRA_MEAN * p + j]
    return s


@_compiled
def _correct(core, known, at, draws, k_draw, par, P, saved, nu, gain, error, extra, across, p):  # type: ignore[no-untyped-def]
    """Correction (10), H = [I9 0] and R diagonal: one scalar update a row. Returns -1 or the row that failed."""
    _innovation(core, known, at, nu)
    for i in range(15 * STRIDE):
        saved[i] = P[i]
    for i in range(STRIDE):
        error[i] = 0.0
    if p:
        _keep_or_restore(extra, across, p, True)
    nis = 0.0
    dof = 0
    for r in range(9):
        variance = known[at + KNOWN_R + r]
        core[CORE_NU + r] = math.nan
        if variance < 0.0:
            continue
        if draws.size:
            nu[r] += math.sqrt(variance) * draws[k_draw, r]
        core[CORE_NU + r] = nu[r]
        S = P[r * STRIDE + r] + variance
        if not S > 0.0:
            return r
        root = 1.0 / math.sqrt(S)
        normal = (nu[r] - error[r]) * root
        nis += normal * normal
        dof += 1
        u = _scaled(_row(P, r * STRIDE), root)
        _store(error, 0, _plus(_row(error, 0), normal, u))
        for q in range(15):
            gain[q] = P[q * STRIDE + r] * root
        for q in range(15):
            _store(P, q * STRIDE, _plus(_row(P, q * STRIDE), -gain[q], u))
        if p:
            _correct_extra(extra, across, p, r, root, normal, u)
    core[CORE_DOF_LAST] = dof
    if dof == 0:
        core[CORE_NIS_LAST] = math.nan
        return -1
    core[CORE_NIS_LAST] = nis
    if core[CORE_NIS_COUNT] == 0.0:
        core[CORE_NIS_FIRST] = nis
    core[CORE_NIS_SUM] += nis
    core[CORE_DOF_SUM] += dof
    core[CORE_NIS_COUNT] += 1.0
    if nis > par[PAR_GATE + dof] and core[CORE_IN_A_ROW] < MAX_REJECTIONS:
        core[CORE_REJECTED] += 1.0
        core[CORE_IN_A_ROW] += 1.0
        for i in range(15 * STRIDE):
            P[i] = saved[i]
        if p:
            _keep_or_restore(extra, across, p, False)
        return -1
    if nis > par[PAR_GATE + dof]:
        core[CORE_OVERRULED] += 1.0
    core[CORE_IN_A_ROW] = 0.0
    _apply(core, error)
    for j in range(p):
        extra[EXTRA_MEAN * p + j] += extra[EXTRA_ERROR * p + j]
    return -1


@_compiled
def gravity_at(anomaly, latitude, height):  # type: ignore[no-untyped-def]
    """Local gravity: normal gravity there plus the site's own departure from it, m/s²."""
    s2 = math.sin(latitude) ** 2
    surface = _G0 * (1.0 + _K * s2) / math.sqrt(1.0 - _E2 * s2)
    linear = 2.0 / _A * (1.0 + _F + _M - 2.0 * _F * s2) * height
    return anomaly + surface * (1.0 - linear + 3.0 * height * height / (_A * _A))


@_compiled
def _predict(core, P, gyro, accel, dt, par, held, turned, X, E, D, L, mean):  # type: ignore[no-untyped-def]
    """Prediction (11)-(15). Returns -1, or the row at which P is not definite."""
    failed = _cholesky(P, L)
    if failed >= 0:
        return failed
    spread = 15.0 + par[PAR_KAPPA]
    scale = math.sqrt(spread)
    w, x, y, z = core[NAV_Q], core[NAV_Q + 1], core[NAV_Q + 2], core[NAV_Q + 3]
    _lanes_start(core, L, scale, X)
    gravity = gravity_at(par[PAR_GRAVITY_ANOMALY], core[0], core[2])
    fastest = math.sqrt(_lanes_fastest(X, gyro))
    n = max(1, math.ceil(dt * max(fastest / MAX_STEP_ANGLE, 1.0 / MAX_STEP) - 1e-9))
    for k in range(n):
        _lanes_substep(X, gyro, accel, k / n, (k + 1.0) / n, dt / n, gravity)
    _lanes_errors(X, E)
    _covariance(E, L, scale, 0.5 / spread, mean, D, P)
    for r in range(10):
        core[r] = X[r * _LN + CENTRE]
    _apply(core, mean)
    _add_noise(w, x, y, z, par, dt, held, turned, P)
    return -1


@_compiled
def _tally(core, gyro, accel, known, at, sums, moments, nu, extra, p, phi, k):  # type: ignore[no-untyped-def]
    """Sums for the convergence monitor, moments of the error while `CORE_SPREAD` is set; residuals without effects."""
    for i in range(3):
        sums[SUM_BIAS + i] += core[NAV_BA + i]
        sums[SUM_BIAS + 3 + i] += core[NAV_BG + i]
    sums[SUM_BIASES] += 1.0
    if known[at + KNOWN_RATE] == known[at + KNOWN_RATE]:
        for i in range(3):
            sums[SUM_RESIDUAL + i] += accel[i] - known[at + KNOWN_FORCE + i]
            sums[SUM_RESIDUAL + 3 + i] += gyro[i] - known[at + KNOWN_RATE + i]
        if p:
            for i in range(6):
                sums[SUM_RESIDUAL + i] -= _effect(extra, p, phi, k, i)
        sums[SUM_RESIDUALS] += 1.0
    if core[CORE_SPREAD] != 0.0:
        _innovation(core, known, at, nu)
        moments[MOMENT_COUNT] += 1.0
        share = 1.0 / moments[MOMENT_COUNT]
        for i in range(15):
            # error of the state against what is known: the innovation the other way round; biases as they are
            value = -nu[i] if i < 9 else core[NAV_BA + i - 9]
            before = value - moments[MOMENT_MEAN + i]
            moments[MOMENT_MEAN + i] += before * share
            nu[i] = before
        for i in range(15):
            for k in range(15):
                moments[MOMENT_SCATTER + 15 * i + k] += nu[i] * nu[k] * (1.0 - share)


@_compiled
def advance(  # type: ignore[no-untyped-def]
    core, P, par, t, gyro, accel, known, draws, phi, scale, first, stop, sums, moments, out, work, extra, across
):
    """Feed samples from `first` while t < `stop` and the output has room.

    Parameters are the arrays of `filters.kalman.layout`: `core` (CORE,), `P` (15·STRIDE,), `par` (PAR,); `t`
    (N,), `gyro` and `accel` (N, 3); `known` (KNOWN,) for what never changes or (N·KNOWN,); `draws` (N, 9), or empty for
    exact measurements; `phi` (N, 6, p) the regressor of the extra states, `scale` (N, 6) the factors on white noise, or
    either empty; `sums` (SUMS,), `moments` (MOMENTS,), `out` (rows, OUT), `work` scratch, `extra` and
    `across` of the extra states.

    Returns
    -------
    tuple of int
        Index of the first sample not used, rows written to `out`, why it returned (`DONE`, `INDEFINITE`, `NOT_FINITE`),
        and the row of P at fault.
    """
    X, D, E = work[: 16 * _LN], work[16 * _LN : 32 * _LN], work[32 * _LN : 41 * _LN]
    rest = 41 * _LN
    L = work[rest : rest + 15 * STRIDE]
    rest += 15 * STRIDE
    saved = work[rest : rest + 15 * STRIDE]
    rest += 15 * STRIDE
    mean, nu = work[rest : rest + 16], work[rest + 16 : rest + 32]
    gain, error = work[rest + 32 : rest + 48], work[rest + 48 : rest + 64]
    g, a = work[rest + 64 : rest + 70], work[rest + 70 : rest + 76]
    kept = work[rest + 80 : rest + 116]
    stride = KNOWN if known.size > KNOWN else 0
    p = across.size // (2 * STRIDE)
    rows = 0
    k = first
    while k < t.size and t[k] < stop and rows < out.shape[0]:
        if core[CORE_SAMPLES] > 0.0:
            dt = t[k] - core[CORE_T]
            held = max(1.0, dt / par[PAR_PERIOD])
            turned = 0.0
            for i in range(3):
                g[i] = core[CORE_GYRO + i] if par[PAR_LINEAR] != 0.0 else gyro[k, i]
                a[i] = core[CORE_ACCEL + i] if par[PAR_LINEAR] != 0.0 else accel[k, i]
                g[3 + i] = gyro[k, i]
                a[3 + i] = accel[k, i]
            if scale.size:
                for i in range(6):
                    par[PAR_NOISE + i] = par[PAR_WHITE + i] * scale[k, i] * scale[k, i]
            if p:
                _drift(extra, across, p, dt)
                _take_away(extra, p, phi, k, par[PAR_LINEAR] != 0.0, g, a)
                _gather(P, extra, across, p, kept)
            if held > GAP_PERIODS:
                # nobody saw how it turned: what the two ends say of the rate is off by as much as they say
                for i in range(3):
                    turned += max((g[i] - core[NAV_BG + i]) ** 2, (g[3 + i] - core[NAV_BG + i]) ** 2)
                turned = math.sqrt(turned) * dt
            failed = _predict(core, P, g, a, dt, par, held, turned, X, E, D, L, mean)
            if failed >= 0:
                return k, rows, INDEFINITE, failed
            if p:
                _carry(P, extra, across, p, kept, E, L, par, dt)
            failed = _correct(core, known, k * stride, draws, k, par, P, saved, nu, gain, error, extra, across, p)
            if failed >= 0:
                return k, rows, INDEFINITE, failed
            check = core[0] + core[CORE_NIS_SUM]
            for i in range(NAV):
                check += core[i]
            if not math.isfinite(check):
                return k, rows, NOT_FINITE, 0
        core[CORE_T] = t[k]
        for i in range(3):
            core[CORE_GYRO + i] = gyro[k, i]
            core[CORE_ACCEL + i] = accel[k, i]
        _tally(
            core,
            core[CORE_GYRO : CORE_GYRO + 3],
            core[CORE_ACCEL : CORE_ACCEL + 3],
            known,
            k * stride,
            sums,
            moments,
            nu,
            extra,
            p,
            phi,
            k,
        )
        for j in range(p):
            for i in range(6):
                extra[(EXTRA_BEFORE + i) * p + j] = phi[k, i, j]
        core[CORE_SAMPLES] += 1.0
        if t[k] >= core[CORE_NEXT_OUT] - 1e-9:
            out[rows, OUT_INDEX] = core[CORE_SAMPLES] - 1.0
            out[rows, OUT_T] = t[k]
            for i in range(NAV):
                out[rows, OUT_NAV + i] = core[i]
            out[rows, OUT_NIS] = core[CORE_NIS_LAST]
            out[rows, OUT_DOF] = core[CORE_DOF_LAST]
            for i in range(9):
                out[rows, OUT_NU + i] = core[CORE_NU + i]
            for i in range(15 * STRIDE):
                out[rows, OUT_P + i] = P[i]
            rows += 1
            core[CORE_NEXT_OUT] += par[PAR_EVERY]
            if core[CORE_NEXT_OUT] <= t[k]:
                core[CORE_NEXT_OUT] = t[k] + par[PAR_EVERY]
        k += 1
    return k, rows, DONE, 0


WORK = 41 * LANES + 30 * STRIDE + 116
"""Length of the scratch array."""
