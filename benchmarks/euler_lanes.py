"""The step of `filters.kalman.kernels` with the paper's Euler angles for quaternions, for `filter_speed.py` only.

The peers of the benchmark integrate equations (1)-(5) as printed, by Runge-Kutta of order four; the product integrates
the attitude in closed form. This is the product's kernel (32 lanes of flat arrays, its Cholesky factor, covariance and
scalar updates) on the peers' equations, so that like is compared with like.

State: latitude, longitude (rad), height (m), velocity NED (m/s), roll, pitch, yaw (rad), biases (m/s², rad/s). Its
errors, which P belongs to, are m north, east, down, m/s, rad of the three angles, and biases.
"""

import math

import numpy as np

from filters import earth
from filters.compilation import cached_njit
from filters.kalman.kernels.arithmetic import CENTRE, LANES, cholesky, compiled, plus, row, scaled, store
from filters.kalman.kernels.lanes import covariance, gravity_at
from filters.kalman.layout import STRIDE

_LN = LANES
_A, _E2, _OMEGA = earth.SEMI_MAJOR_AXIS, earth.ECCENTRICITY_SQUARED, earth.EARTH_RATE

_ROUND = 1.5 * 2.0**52  # added and taken away again, it rounds to a whole number, as vector instructions
_TWO_OVER_PI = 2.0 / math.pi
# π/2 in two parts of which the first times a small whole number is exact (fdlibm, e_rem_pio2.c)
_PIO2_1, _PIO2_1T = 1.57079632673412561417e00, 6.07710050650619224932e-11
_S1, _S2, _S3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
_S4, _S5, _S6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
_C1, _C2, _C3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
_C4, _C5, _C6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11


@compiled
def _sincos(x):  # type: ignore[no-untyped-def]
    """Sine and cosine without a branch, for |x| below some thousand rad (polynomials of fdlibm, k_sin.c, k_cos.c)."""
    k = (x * _TWO_OVER_PI + _ROUND) - _ROUND
    r = (x - k * _PIO2_1) - k * _PIO2_1T
    z = r * r
    s = r + r * z * (_S1 + z * (_S2 + z * (_S3 + z * (_S4 + z * (_S5 + z * _S6)))))
    c = 1.0 - 0.5 * z + z * z * (_C1 + z * (_C2 + z * (_C3 + z * (_C4 + z * (_C5 + z * _C6)))))
    # quadrant: -2, -1, 0, 1 or 2
    m = k - 4.0 * ((k * 0.25 + _ROUND) - _ROUND)
    odd = m * m == 1.0
    sine, cosine = (c if odd else s), (s if odd else c)
    half = m * m == 4.0
    return (-sine if half or m == -1.0 else sine), (-cosine if half or m == 1.0 else cosine)


@compiled
def _rates(Y, B, D, gyro, accel, gravity):  # type: ignore[no-untyped-def]
    """Equations (1)-(4) for every lane: Y rows 0..8 the state, B rows 0..5 the biases, D rows 0..8 the derivative."""
    g0, g1, g2 = gyro[0], gyro[1], gyro[2]
    a0, a1, a2 = accel[0], accel[1], accel[2]
    for j in range(_LN):
        height = Y[2 * _LN + j]
        vn, ve, vd = Y[3 * _LN + j], Y[4 * _LN + j], Y[5 * _LN + j]
        s, c = _sincos(Y[j])
        sr, cr = _sincos(Y[6 * _LN + j])
        sp, cp = _sincos(Y[7 * _LN + j])
        sy, cy = _sincos(Y[8 * _LN + j])
        w2 = 1.0 - _E2 * s * s
        root = math.sqrt(w2)
        north = vn / (_A * (1.0 - _E2) / (w2 * root) + height)
        east = ve / (_A / root + height)
        per_c = 1.0 / c
        tan = s * per_c
        # R_p2n of (4)
        c00, c01, c02 = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
        c10, c11, c12 = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
        c20, c21, c22 = -sp, cp * sr, cp * cr
        x, y, z = a0 - B[j], a1 - B[_LN + j], a2 - B[2 * _LN + j]
        fn, fe, fd = c00 * x + c01 * y + c02 * z, c10 * x + c11 * y + c12 * z, c20 * x + c21 * y + c22 * z
        # the braces of (3)
        un, ue, ud = _OMEGA * c + east, -north, -_OMEGA * s - east * tan
        p = g0 - B[3 * _LN + j] - (c00 * un + c10 * ue + c20 * ud)
        q = g1 - B[4 * _LN + j] - (c01 * un + c11 * ue + c21 * ud)
        r = g2 - B[5 * _LN + j] - (c02 * un + c12 * ue + c22 * ud)
        turning = (q * sr + r * cr) / cp
        spin, lean = 2.0 * _OMEGA * s + east * tan, 2.0 * _OMEGA * c + east
        D[j] = north
        D[_LN + j] = east * per_c
        D[2 * _LN + j] = -vd
        D[3 * _LN + j] = fn - spin * ve + north * vd
        D[4 * _LN + j] = fe + spin * vn + lean * vd
        D[5 * _LN + j] = fd + gravity - lean * ve - north * vn
        D[6 * _LN + j] = p + turning * sp
        D[7 * _LN + j] = q * cr - r * sr
        D[8 * _LN + j] = turning


@compiled
def _integrate(X, B, D, Y, Z, gyro, accel, h, gravity):  # type: ignore[no-untyped-def]
    """One Runge-Kutta step for every lane; Y is scratch, the end of the step goes to Z."""
    _rates(X, B, D, gyro, accel, gravity)
    for i in range(9 * _LN):
        Y[i] = X[i] + 0.5 * h * D[i]
        Z[i] = X[i] + h * (1.0 / 6.0) * D[i]
    _rates(Y, B, D, gyro, accel, gravity)
    for i in range(9 * _LN):
        Y[i] = X[i] + 0.5 * h * D[i]
        Z[i] += h * (1.0 / 3.0) * D[i]
    _rates(Y, B, D, gyro, accel, gravity)
    for i in range(9 * _LN):
        Y[i] = X[i] + h * D[i]
        Z[i] += h * (1.0 / 3.0) * D[i]
    _rates(Y, B, D, gyro, accel, gravity)
    for i in range(9 * _LN):
        Z[i] += h * (1.0 / 6.0) * D[i]


@compiled
def _units(x, units):  # type: ignore[no-untyped-def]
    """State per error: rad a metre north and east, -1 for down, 1 for the rest."""
    s = math.sin(x[0])
    w2 = 1.0 - _E2 * s * s
    units[0] = 1.0 / (_A * (1.0 - _E2) / (w2 * math.sqrt(w2)) + x[2])
    units[1] = 1.0 / ((_A / math.sqrt(w2) + x[2]) * math.cos(x[0]))
    units[2] = -1.0


@compiled
def _predict(x, P, gyro, accel, dt, Q, kappa, gravity, units, work):  # type: ignore[no-untyped-def]
    """Prediction (11)-(15); `Q` holds the fifteen variances that (15) adds. Returns -1, or the row that failed."""
    L, mean = work[: 15 * STRIDE], work[15 * STRIDE : 16 * STRIDE]
    lanes = work[16 * STRIDE :]
    X, B, D = lanes[: 9 * _LN], lanes[9 * _LN : 15 * _LN], lanes[15 * _LN : 24 * _LN]
    Y, Z = lanes[24 * _LN : 33 * _LN], lanes[33 * _LN : 42 * _LN]
    deviations = lanes[42 * _LN : 58 * _LN]
    failed = cholesky(P, L)
    if failed >= 0:
        return failed
    spread = 15.0 + kappa
    scale = math.sqrt(spread)
    _units(x, units)
    points = lanes[: 15 * _LN]
    for r in range(15):
        k = scale * units[r]
        for j in range(_LN):
            points[r * _LN + j] = x[r]
        for j in range(15):
            d = k * L[j * STRIDE + r]
            points[r * _LN + j] += d
            points[r * _LN + 16 + j] -= d
    _integrate(X, B, D, Y, Z, gyro, accel, dt, gravity)
    for r in range(9):
        centre = Z[r * _LN + CENTRE]
        x[r] = centre
        per = 1.0 / units[r]
        for j in range(_LN):
            Y[r * _LN + j] = (Z[r * _LN + j] - centre) * per
    covariance(Y, L, scale, 0.5 / spread, mean, deviations, P)
    for r in range(9):
        x[r] += mean[r] * units[r]
    for r in range(15):
        P[r * STRIDE + r] += Q[r]
    return -1


@compiled
def _correct(x, known, R, P, units, gain, error):  # type: ignore[no-untyped-def]
    """Correction (10), H = [I9 0] and R diagonal: one scalar update a row. Returns -1, or the row that failed."""
    for i in range(STRIDE):
        error[i] = 0.0
    for r in range(9):
        S = P[r * STRIDE + r] + R[r]
        if not S > 0.0:
            return r
        root = 1.0 / math.sqrt(S)
        nu = (known[r] - x[r]) / units[r]
        u = scaled(row(P, r * STRIDE), root)
        store(error, 0, plus(row(error, 0), (nu - error[r]) * root, u))
        for q in range(15):
            gain[q] = P[q * STRIDE + r] * root
        for q in range(15):
            store(P, q * STRIDE, plus(row(P, q * STRIDE), -gain[q], u))
    for r in range(15):
        x[r] += error[r] * units[r]
    return -1


@cached_njit
def advance(x, P, gyro, accel, dt, Q, R, known, kappa, anomaly, units, work):  # type: ignore[no-untyped-def]
    """Feed samples (N, 3), each held over the `dt` that it ends. Returns the number used."""
    rest = work[16 * STRIDE + 58 * _LN :]
    gain, error = rest[:STRIDE], rest[STRIDE:]
    for k in range(gyro.shape[0]):
        gravity = gravity_at(anomaly, x[0], x[2])
        if _predict(x, P, gyro[k], accel[k], dt, Q, kappa, gravity, units, work) >= 0:
            return k
        if _correct(x, known, R, P, units, gain, error) >= 0:
            return k
    return gyro.shape[0]


class EulerLanes:
    """The filter of this module.

    `x`: first state, and what is known of its nine first rows, shape (15,).
    `P0_sd`, `Q`, `R`: standard deviations of its errors (15,); variances added at each step (15,) and of the reference
      (9,).
    `dt`: sample period, s.
    """

    def __init__(self, x: np.ndarray, P0_sd: np.ndarray, Q: np.ndarray, R: np.ndarray, dt: float) -> None:
        self.x = x.copy()
        padded = np.zeros((15, STRIDE))
        padded[:, :15] = np.diag(P0_sd**2)
        self._P, self._Q, self._R, self._dt, self._known = padded.ravel(), Q, R, dt, x[:9].copy()
        self._units, self._work = np.ones(15), np.zeros(18 * STRIDE + 58 * LANES)

    def covariance(self) -> np.ndarray:
        """Covariance of the errors, (15, 15)."""
        return self._P.reshape(15, STRIDE)[:, :15].copy()

    def run(self, gyro: np.ndarray, accel: np.ndarray) -> None:
        used = advance(
            self.x, self._P, gyro, accel, self._dt, self._Q, self._R, self._known, 0.0, 0.0, self._units, self._work
        )
        if used < len(gyro):
            raise ArithmeticError(f"the covariance is not positive definite at step {used}")
