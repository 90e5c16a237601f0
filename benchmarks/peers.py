"""The other sides of `filter_speed.py`: filterpy, turbo-ckf and a step in numpy, all on one Euler-angle model.

All have the state latitude, longitude (rad), height (m), velocity NED (m/s), roll, pitch, yaw (rad), biases; κ = 0;
Runge-Kutta of order four; Q_d and R of the paper. filterpy and turbo-ckf are given the model compiled by numba, which
is the best that their interfaces allow.
"""

import math
from collections.abc import Callable

import numba
import numpy as np
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter
from scipy.linalg import lapack
from turbo_ckf import TurboCKF

from filters import earth

_A, _E2, _OMEGA = earth.SEMI_MAJOR_AXIS, earth.ECCENTRICITY_SQUARED, earth.EARTH_RATE
_ANGLES = np.array([0, 6, 7, 8])


@numba.njit(cache=True, error_model="numpy")
def _rates(x, gyro, accel, gravity, d):  # type: ignore[no-untyped-def]
    """Equations (1)-(4) of one state (15,); writes d[:9]."""
    height, vn, ve, vd = x[2], x[3], x[4], x[5]
    s, c = math.sin(x[0]), math.cos(x[0])
    sr, cr, sp, cp = math.sin(x[6]), math.cos(x[6]), math.sin(x[7]), math.cos(x[7])
    sy, cy = math.sin(x[8]), math.cos(x[8])
    w2 = 1.0 - _E2 * s * s
    root = math.sqrt(w2)
    north, east, tan = vn / (_A * (1.0 - _E2) / (w2 * root) + height), ve / (_A / root + height), s / c
    c00, c01, c02 = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    c10, c11, c12 = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    c20, c21, c22 = -sp, cp * sr, cp * cr
    a, b, e = accel[0] - x[9], accel[1] - x[10], accel[2] - x[11]
    un, ue, ud = _OMEGA * c + east, -north, -_OMEGA * s - east * tan
    p = gyro[0] - x[12] - (c00 * un + c10 * ue + c20 * ud)
    q = gyro[1] - x[13] - (c01 * un + c11 * ue + c21 * ud)
    r = gyro[2] - x[14] - (c02 * un + c12 * ue + c22 * ud)
    turning = (q * sr + r * cr) / cp
    spin, lean = 2.0 * _OMEGA * s + east * tan, 2.0 * _OMEGA * c + east
    d[0], d[1], d[2] = north, east / c, -vd
    d[3] = c00 * a + c01 * b + c02 * e - spin * ve + north * vd
    d[4] = c10 * a + c11 * b + c12 * e + spin * vn + lean * vd
    d[5] = c20 * a + c21 * b + c22 * e + gravity - lean * ve - north * vn
    d[6], d[7], d[8] = p + turning * sp, q * cr - r * sr, turning


@numba.njit(cache=True, error_model="numpy")
def model(points, dt, gyro, accel, gravity):  # type: ignore[no-untyped-def]
    """Points (K, 15) after dt."""
    out = np.empty_like(points)
    y, d, total = np.empty(15), np.empty(9), np.empty(9)
    for k in range(points.shape[0]):
        x = points[k]
        y[:] = x
        total[:] = 0.0
        for stage in range(4):
            _rates(y, gyro, accel, gravity, d)
            weight = 2.0 if stage in (1, 2) else 1.0
            ahead = dt if stage == 2 else 0.5 * dt
            for i in range(9):
                total[i] += weight * d[i]
                y[i] = x[i] + ahead * d[i]
        for i in range(9):
            out[k, i] = x[i] + dt / 6.0 * total[i]
        for i in range(9, 15):
            out[k, i] = x[i]
    return out


@numba.njit(cache=True, error_model="numpy")
def model_of_one(x, dt, gyro, accel, gravity):  # type: ignore[no-untyped-def]
    """One point (15,) after dt."""
    return model(x.reshape(1, 15), dt, gyro, accel, gravity)[0]


class Peer:
    """A filter with its belief in the paper's coordinates.

    `x`: first state, and what is known of its nine first rows, shape (15,).
    `P0`, `Q`: first covariance; process noise of a step; (15, 15).
    `R`: variances of what is known, (9,).
    `dt`, `gravity`: s, m/s².
    """

    def __init__(self, x: np.ndarray, P0: np.ndarray, Q: np.ndarray, R: np.ndarray, dt: float, gravity: float) -> None:
        self.x, self.P, self.Q, self.R = x.copy(), P0.copy(), Q, R
        self.dt, self.gravity, self.known = dt, gravity, x[:9].copy()

    def run(self, gyro: np.ndarray, accel: np.ndarray) -> None:
        """Feed samples (N, 3), each held over the dt that it ends."""
        raise NotImplementedError


class Filterpy(Peer):
    """`filterpy.kalman.UnscentedKalmanFilter`, as its documentation shows, predict and update."""

    def run(self, gyro: np.ndarray, accel: np.ndarray) -> None:
        """Feed samples; see `Peer`."""
        sample = [gyro[0], accel[0]]
        gravity = self.gravity
        kf = UnscentedKalmanFilter(
            dim_x=15,
            dim_z=9,
            dt=self.dt,
            hx=lambda x: x[:9],
            fx=lambda x, dt: model_of_one(x, dt, sample[0], sample[1], gravity),
            points=JulierSigmaPoints(15, kappa=0.0),
        )
        kf.x, kf.P, kf.Q, kf.R = self.x, self.P, self.Q, np.diag(self.R)
        for sample[0], sample[1] in zip(gyro, accel, strict=True):
            kf.predict()
            self._correct(kf)
        self.x, self.P = kf.x, kf.P

    def _correct(self, kf: UnscentedKalmanFilter) -> None:
        kf.update(self.known)


class FilterpyLinear(Filterpy):
    """filterpy's prediction with a linear correction of our own, which a user who knows that H = [I9 0] would write."""

    def _correct(self, kf: UnscentedKalmanFilter) -> None:
        kf.x, kf.P = corrected(kf.x, kf.P, self.known, self.R)


class Turbo(Peer):
    """`turbo_ckf.TurboCKF` (points x̂ ± √n columns of L, that is κ = 0) with a batch model, predict and update."""

    def run(self, gyro: np.ndarray, accel: np.ndarray) -> None:
        kf = TurboCKF(dim_x=15, dim_z=9, dt=self.dt, hx=lambda points: points[:, :9], fx=model)
        kf.x, kf.P, kf.Q, kf.R = self.x, self.P, self.Q, np.diag(self.R)
        for rate, force in zip(gyro, accel, strict=True):
            kf.predict(fx_args=(rate, force, self.gravity))
            kf.update(self.known)
        if kf.jitter_count:
            raise ArithmeticError(f"turbo-ckf added jitter {kf.jitter_count} times")
        self.x, self.P = kf.x, kf.P


class Vectorised(Peer):
    """31 points in one array, LAPACK called directly, linear correction: what numpy alone allows."""

    def run(self, gyro: np.ndarray, accel: np.ndarray) -> None:
        x, P, h = self.x, self.P, self.dt
        points = np.empty((15, 31))
        weight = 0.5 / 15.0
        for rate, force in zip(gyro[:, :, None], accel[:, :, None], strict=True):
            L, failed = lapack.dpotrf(P, lower=1, clean=1)
            if failed:
                raise ArithmeticError("the covariance is not positive definite")
            L *= math.sqrt(15.0)
            column = x[:, None]
            points[:, 0] = x
            np.add(column, L, out=points[:, 1:16])
            np.subtract(column, L, out=points[:, 16:])
            rates, forces = rate - points[12:], force - points[9:12]
            start = points[:9]
            k1 = self._rates(start, rates, forces)
            k2 = self._rates(start + 0.5 * h * k1, rates, forces)
            k3 = self._rates(start + 0.5 * h * k2, rates, forces)
            k4 = self._rates(start + h * k3, rates, forces)
            k2 += k3
            k2 *= 2.0
            k1 += k2
            k1 += k4
            k1 *= h / 6.0
            start += k1
            # differences to the centre, of which the plain mean is exact
            errors = points - points[:, :1]
            mean = weight * errors.sum(axis=1)
            spread = errors[:, 1:] - mean[:, None]
            x, P = corrected(points[:, 0] + mean, weight * (spread @ spread.T) + self.Q, self.known, self.R)
        self.x, self.P = x, P

    def _rates(self, Y: np.ndarray, rates: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Equations (1)-(4) of points (9, 31)."""
        angles = Y[_ANGLES]
        (s, sr, sp, sy), (c, cr, cp, cy) = np.sin(angles), np.cos(angles)
        height, vn, ve, vd = Y[2], Y[3], Y[4], Y[5]
        w2 = 1.0 - _E2 * s * s
        root = np.sqrt(w2)
        north, east, tan = vn / (_A * (1.0 - _E2) / (w2 * root) + height), ve / (_A / root + height), s / c
        sysp, cysp = sy * sp, cy * sp
        c00, c01, c02 = cy * cp, cysp * sr - sy * cr, cysp * cr + sy * sr
        c10, c11, c12 = sy * cp, sysp * sr + cy * cr, sysp * cr - cy * sr
        c21, c22 = cp * sr, cp * cr
        a, b, e = forces
        un, ud = _OMEGA * c + east, -_OMEGA * s - east * tan
        p = rates[0] - (c00 * un - c10 * north - sp * ud)
        q = rates[1] - (c01 * un - c11 * north + c21 * ud)
        r = rates[2] - (c02 * un - c12 * north + c22 * ud)
        turning = (q * sr + r * cr) / cp
        spin, lean = 2.0 * _OMEGA * s + east * tan, 2.0 * _OMEGA * c + east
        out = np.empty_like(Y)
        out[0], out[1] = north, east / c
        np.negative(vd, out=out[2])
        out[3] = c00 * a + c01 * b + c02 * e - spin * ve + north * vd
        out[4] = c10 * a + c11 * b + c12 * e + spin * vn + lean * vd
        out[5] = c21 * b + c22 * e - sp * a + self.gravity - lean * ve - north * vn
        out[6], out[7], out[8] = p + turning * sp, q * cr - r * sr, turning
        return out


def corrected(x: np.ndarray, P: np.ndarray, known: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Correction (10) with H = [I9 0] and diagonal R, by one Cholesky factor."""
    S = P[:9, :9].copy()
    S.ravel()[::10] += R
    L, failed = lapack.dpotrf(S, lower=1)
    if failed:
        raise ArithmeticError("the innovation's covariance is not positive definite")
    K, _ = lapack.dpotrs(L, P[:9], lower=1)
    return x + (known - x[:9]) @ K, P - P[:, :9] @ K


PEERS: dict[str, Callable[..., Peer]] = {
    "filterpy": Filterpy,
    "filterpy, own linear correction": FilterpyLinear,
    "numpy, vectorised": Vectorised,
    "turbo-ckf": Turbo,
}
