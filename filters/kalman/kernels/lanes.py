"""Prediction of all sigma points, compiled: equations (1)-(5) and (11)-(15), 32 lanes at a time."""

import math

from filters import earth
from filters.kalman import layout
from filters.kalman.kernels.arithmetic import (
    CENTRE,
    LANES,
    along,
    cholesky,
    compiled,
    cos_series,
    difference,
    inlined,
    logarithm,
    normal_gravity,
    plus,
    product,
    quaternion,
    radii,
    row,
    sinc_series,
    small_rotation,
    store,
    vector,
)
from filters.kalman.kernels.correction import apply
from filters.kalman.layout import NAV, STRIDE
from filters.kalman.strapdown import MAX_STEP, MAX_STEP_ANGLE

_OMEGA = earth.EARTH_RATE


@compiled
def _both(X, at, d):  # type: ignore[no-untyped-def]
    """Add d to a lane on the plus side, and take it from the one on the other side."""
    X[at] += d
    X[at + 16] -= d


@compiled
def _start(core, L, scale, X):  # type: ignore[no-untyped-def]
    """Sigma points (11): X rows 0..9 latitude, longitude, height, velocity, quaternion; 10..15 biases."""
    r_n, r_e = radii(math.sin(core[0]))
    per_n = 1.0 / (r_n + core[2])
    per_e = 1.0 / ((r_e + core[2]) * math.cos(core[0]))
    for r in range(NAV):
        for j in range(LANES):
            X[r * LANES + j] = core[r]
    for j in range(15):
        at = j * STRIDE
        _both(X, j, scale * L[at] * per_n)
        _both(X, LANES + j, scale * L[at + 1] * per_e)
        _both(X, 2 * LANES + j, -(scale * L[at + 2]))
        for r in range(3):
            _both(X, (layout.NAV_V + r) * LANES + j, scale * L[at + 3 + r])
        for r in range(6):
            _both(X, (layout.NAV_BA + r) * LANES + j, scale * L[at + 9 + r])
        ex, ey, ez = scale * L[at + 6], scale * L[at + 7], scale * L[at + 8]
        if ex != 0.0 or ey != 0.0 or ez != 0.0:
            t = 0.25 * (ex * ex + ey * ey + ez * ez)
            if t < 0.0025:
                c, h = cos_series(t), 0.5 * sinc_series(t)
            else:
                half = math.sqrt(t)
                c, h = math.cos(half), 0.5 * math.sin(half) / half
            for side in range(2):
                k = h - 2.0 * side * h
                turned = product((c, k * ex, k * ey, k * ez), quaternion(core, layout.NAV_Q, 1))
                _store_quaternion(X, j + 16 * side, turned)


@compiled
def _store_quaternion(X, j, q):  # type: ignore[no-untyped-def]
    """Attitude of lane j."""
    for r in range(4):
        X[(layout.NAV_Q + r) * LANES + j] = q[r]


@compiled
def _fastest(X, gyro):  # type: ignore[no-untyped-def]
    """Largest angular rate of any lane at either end of the step, squared."""
    fastest = 0.0
    for end in range(2):
        g = vector(gyro, 3 * end, 1)
        for j in range(LANES):
            x, y, z = along(g, -1.0, vector(X, layout.NAV_BG * LANES + j, LANES))
            square = x * x + y * y + z * z
            if square > fastest:
                fastest = square
    return fastest


@compiled
def _reading(ends, share):  # type: ignore[no-untyped-def]
    """Reading at a share of the step, linear between the two in `ends`."""
    return along(vector(ends, 0, 1), share, along(vector(ends, 3, 1), -1.0, vector(ends, 0, 1)))


@inlined
def _rotated(q, f):  # type: ignore[no-untyped-def]
    """Force in n of force f in b: f + 2 q × (q × f + q0 f)."""
    q0, q1, q2, q3 = q
    x, y, z = f
    tx = q2 * z - q3 * y + q0 * x
    ty = q3 * x - q1 * z + q0 * y
    tz = q1 * y - q2 * x + q0 * z
    return x + 2.0 * (q2 * tz - q3 * ty), y + 2.0 * (q3 * tx - q1 * tz), z + 2.0 * (q1 * ty - q2 * tx)


@inlined
def _acceleration(f, v, place, gravity):  # type: ignore[no-untyped-def]
    """Equation (2) of force f in n and velocity v; `place`: 1/R_n, 1/R_e, sine, cosine and tangent of latitude."""
    vn, ve, vd = v
    per_n, per_e, s, c, tan = place
    north, east = vn * per_n, ve * per_e
    spin = 2.0 * _OMEGA * s + east * tan
    lean = 2.0 * _OMEGA * c + east
    return f[0] - spin * ve + north * vd, f[1] + spin * vn + lean * vd, f[2] + gravity - lean * ve - north * vn


@inlined
def _rule(a, b, c, d):  # type: ignore[no-untyped-def]
    """Six times the mean of the classical Runge-Kutta rule."""
    return (
        a[0] + 2.0 * (b[0] + c[0]) + d[0],
        a[1] + 2.0 * (b[1] + c[1]) + d[1],
        a[2] + 2.0 * (b[2] + c[2]) + d[2],
    )


@compiled
def _substep(X, gyro, accel, a0, a1, h, gravity):  # type: ignore[no-untyped-def]
    """One substep of (1)-(4) for every lane; readings are linear from share a0 of the step to share a1.

    `gyro` and `accel` hold the readings at the start and the end of the whole step.
    """
    am = 0.5 * (a0 + a1)
    # mean rate of each half, and force at start, middle and end
    rate_1, rate_2 = _reading(gyro, 0.5 * (a0 + am)), _reading(gyro, 0.5 * (am + a1))
    force_0, force_m, force_1 = _reading(accel, a0), _reading(accel, am), _reading(accel, a1)
    lat_c = X[CENTRE]
    s_c, c_c = math.sin(lat_c), math.cos(lat_c)
    half = 0.5 * h
    quarter = 0.25 * h
    sixth = h * (1.0 / 6.0)
    for j in range(LANES):
        # the lanes' latitudes differ by so little that three terms are exact
        d = X[j] - lat_c
        dd = 0.5 * d * d
        s = s_c + d * c_c - dd * s_c - dd * d * (1.0 / 3.0) * c_c
        c = c_c - d * s_c - dd * c_c + dd * d * (1.0 / 3.0) * s_c
        r_n, r_e = radii(s)
        height = X[2 * LANES + j]
        per_n, per_e = 1.0 / (r_n + height), 1.0 / (r_e + height)
        tan = s / c
        place = (per_n, per_e, s, c, tan)
        v = (X[3 * LANES + j], X[4 * LANES + j], X[5 * LANES + j])
        q = (X[6 * LANES + j], X[7 * LANES + j], X[8 * LANES + j], X[9 * LANES + j])
        accel_bias = (X[10 * LANES + j], X[11 * LANES + j], X[12 * LANES + j])
        gyro_bias = (X[13 * LANES + j], X[14 * LANES + j], X[15 * LANES + j])

        # (2) at the start
        a1_n = _acceleration(_rotated(q, along(force_0, -1.0, accel_bias)), v, place, gravity)
        v2 = along(v, half, a1_n)
        # last bracket of (3), from the velocity in the middle; it turns n backwards
        n = small_rotation(
            1.0,
            (
                -quarter * (_OMEGA * c + v2[1] * per_e),
                quarter * v2[0] * per_n,
                quarter * (_OMEGA * s + v2[1] * tan * per_e),
            ),
        )
        # first half: q ← n q b
        q = product(product(n, q), small_rotation(quarter, along(rate_1, -1.0, gyro_bias)))
        # (2) in the middle, twice
        force_n = _rotated(q, along(force_m, -1.0, accel_bias))
        a2_n = _acceleration(force_n, v2, place, gravity)
        v3 = along(v, half, a2_n)
        a3_n = _acceleration(force_n, v3, place, gravity)
        v4 = along(v, h, a3_n)
        # second half
        q = product(product(n, q), small_rotation(quarter, along(rate_2, -1.0, gyro_bias)))
        # (2) at the end
        a4_n = _acceleration(_rotated(q, along(force_1, -1.0, accel_bias)), v4, place, gravity)

        moved = _rule(v, v2, v3, v4)
        gained = _rule(a1_n, a2_n, a3_n, a4_n)
        X[j] += sixth * moved[0] * per_n
        X[LANES + j] += sixth * moved[1] * per_e / c
        X[2 * LANES + j] -= sixth * moved[2]
        X[3 * LANES + j] = v[0] + sixth * gained[0]
        X[4 * LANES + j] = v[1] + sixth * gained[1]
        X[5 * LANES + j] = v[2] + sixth * gained[2]
        X[6 * LANES + j] = q[0]
        X[7 * LANES + j] = q[1]
        X[8 * LANES + j] = q[2]
        X[9 * LANES + j] = q[3]


@compiled
def _errors(X, E):  # type: ignore[no-untyped-def]
    """Errors of each lane against the centre, E rows 0..8: metres, m/s, rotation vector in n."""
    lat, lon, height = vector(X, CENTRE, LANES)
    r_n, r_e = radii(math.sin(lat))
    r_n, r_e = r_n + height, (r_e + height) * math.cos(lat)
    v0, v1, v2 = vector(X, layout.NAV_V * LANES + CENTRE, LANES)
    centre = quaternion(X, layout.NAV_Q * LANES + CENTRE, LANES)
    for j in range(LANES):
        E[j] = (X[j] - lat) * r_n
        E[LANES + j] = (X[LANES + j] - lon) * r_e
        E[2 * LANES + j] = height - X[2 * LANES + j]
        E[3 * LANES + j] = X[3 * LANES + j] - v0
        E[4 * LANES + j] = X[4 * LANES + j] - v1
        E[5 * LANES + j] = X[5 * LANES + j] - v2
    largest = 0.0
    for j in range(LANES):
        _, ex, ey, ez = difference((X[6 * LANES + j], X[7 * LANES + j], X[8 * LANES + j], X[9 * LANES + j]), centre)
        t = ex * ex + ey * ey + ez * ez
        largest = max(largest, t)
        # 2 asin(√t)/√t, to rounding for √t ≤ 0.1
        k = 2.0 + t * (
            1.0 / 3.0
            + t * (3.0 / 20.0 + t * (5.0 / 56.0 + t * (35.0 / 576.0 + t * (63.0 / 1408.0 + t * (231.0 / 6656.0)))))
        )
        E[6 * LANES + j] = k * ex
        E[7 * LANES + j] = k * ey
        E[8 * LANES + j] = k * ez
    if largest > 0.01:
        for j in range(LANES):
            turned = logarithm(
                difference((X[6 * LANES + j], X[7 * LANES + j], X[8 * LANES + j], X[9 * LANES + j]), centre)
            )
            for r in range(3):
                E[(6 + r) * LANES + j] = turned[r]


@compiled
def covariance(E, L, scale, weight, mean, D, P):  # type: ignore[no-untyped-def]
    """Mean of the errors (14) and their covariance (15) without Q_d; the block of the biases stays.

    D holds the deviations, a row a lane: nine errors, then six biases, which are still the sigma points' own.
    """
    for r in range(9):
        for j in range(LANES - 1):
            D[j * STRIDE + r] = E[r * LANES + j]
    for j in range(15):
        for i in range(9, 15):
            d = scale * L[j * STRIDE + i]
            D[j * STRIDE + i] = d
            D[(j + 16) * STRIDE + i] = -d
    for i in range(STRIDE):
        mean[i] = 0.0
    for i in range(9 * STRIDE):
        P[i] = 0.0
    for j in range(LANES - 1):
        if j == CENTRE:
            continue
        deviation = row(D, j * STRIDE)
        store(mean, 0, plus(row(mean, 0), weight, deviation))
        for r in range(9):
            store(P, r * STRIDE, plus(row(P, r * STRIDE), weight * D[j * STRIDE + r], deviation))
    total = row(mean, 0)
    for r in range(9):
        store(P, r * STRIDE, plus(row(P, r * STRIDE), -mean[r], total))
    for r in range(9):
        for i in range(9, 15):
            P[i * STRIDE + r] = P[r * STRIDE + i]
    for i in range(9, STRIDE):
        mean[i] = 0.0


@compiled
def _add_noise(q, par, dt, held, turned, C, P):  # type: ignore[no-untyped-def]
    """Q_d of `spkf.process_noise` at the attitude q; `C` is room for its matrix."""
    w, x, y, z = q
    C[0], C[1], C[2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    C[3], C[4], C[5] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    C[6], C[7], C[8] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    for block in range(2):
        at = 3 + 3 * block
        n0, n1, n2 = vector(par, layout.PAR_NOISE + 3 * block, 1)
        k = dt * held
        n0, n1, n2 = n0 * k, n1 * k, n2 * k
        unseen = turned * turned * block
        for i in range(3):
            a, b, c = vector(C, 3 * i, 1)
            for j in range(3):
                s = a * C[3 * j] * n0 + b * C[3 * j + 1] * n1 + c * C[3 * j + 2] * n2
                if i == j:
                    s += unseen
                P[(at + i) * STRIDE + at + j] += s
    for i in range(6):
        P[(9 + i) * STRIDE + 9 + i] += par[layout.PAR_NOISE + 6 + i] * dt


@compiled
def gravity_at(anomaly, latitude, height):  # type: ignore[no-untyped-def]
    """Local gravity: normal gravity there plus the site's own departure from it, m/s²."""
    return anomaly + normal_gravity(latitude, height)


@inlined
def predict(core, P, par, dt, held, turned, work):  # type: ignore[no-untyped-def]
    """Prediction (11)-(15) from the readings in `work`. Returns -1, or the row at which P is not definite."""
    X, E, L, gyro = work.X, work.E, work.L, work.gyro
    failed = cholesky(P, L)
    if failed >= 0:
        return failed
    spread = 15.0 + par[layout.PAR_KAPPA]
    scale = math.sqrt(spread)
    q = quaternion(core, layout.NAV_Q, 1)
    _start(core, L, scale, X)
    gravity = gravity_at(par[layout.PAR_GRAVITY_ANOMALY], core[0], core[2])
    fastest = math.sqrt(_fastest(X, gyro))
    n = max(1, math.ceil(dt * max(fastest / MAX_STEP_ANGLE, 1.0 / MAX_STEP) - 1e-9))
    for k in range(n):
        _substep(X, gyro, work.accel, k / n, (k + 1.0) / n, dt / n, gravity)
    _errors(X, E)
    covariance(E, L, scale, 0.5 / spread, work.mean, work.D, P)
    for r in range(10):
        core[r] = X[r * LANES + CENTRE]
    apply(core, work.mean)
    _add_noise(q, par, dt, held, turned, work.C, P)
    return -1
