"""Rotations: SO(3) exponential and logarithm, roll-pitch-yaw for display."""

import numpy as np

from filters.types import Array


def skew(v: Array) -> Array:
    """Cross-product matrix: ``skew(a) @ b == np.cross(a, b)``; of vectors (..., 3), matrices (..., 3, 3)."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def exp(rotation_vector: Array) -> Array:
    """Rotation matrix of a rotation vector (Rodrigues).

    exp(ρ) = I + (sin θ/θ) [ρ×] + ((1 - cos θ)/θ²) [ρ×]², θ = |ρ|; rad, shape (..., 3), to matrices, (..., 3, 3).
    """
    x, y, z = rotation_vector[..., 0], rotation_vector[..., 1], rotation_vector[..., 2]
    # the tiny number makes 0/0 a 1 and changes nothing else
    half = 0.5 * np.sqrt(x * x + y * y + z * z) + 1e-300
    sinc = np.sin(half) / half
    a, b = sinc * np.cos(half), 0.5 * sinc * sinc
    C = np.empty((*rotation_vector.shape, 3))
    C[..., 0, 0] = 1.0 - b * (y * y + z * z)
    C[..., 1, 1] = 1.0 - b * (x * x + z * z)
    C[..., 2, 2] = 1.0 - b * (x * x + y * y)
    C[..., 0, 1], C[..., 1, 0] = b * x * y - a * z, b * x * y + a * z
    C[..., 0, 2], C[..., 2, 0] = b * x * z + a * y, b * x * z - a * y
    C[..., 1, 2], C[..., 2, 1] = b * y * z - a * x, b * y * z + a * x
    return C


def log(C: Array) -> Array:
    """Rotation vector of a rotation matrix (..., 3, 3), the inverse of `exp`: rad, (..., 3), norm at most π."""
    axis = np.empty(C.shape[:-1])
    axis[..., 0] = C[..., 2, 1] - C[..., 1, 2]
    axis[..., 1] = C[..., 0, 2] - C[..., 2, 0]
    axis[..., 2] = C[..., 1, 0] - C[..., 0, 1]
    two_cos = C[..., 0, 0] + C[..., 1, 1] + C[..., 2, 2] - 1.0
    if np.any(two_cos < -1.0):
        return _log_by_quaternion(C)
    # below 120° the skew part gives axis and sine in full precision; arccos of the trace would lose half the digits
    two_sin = np.sqrt(np.sum(axis * axis, axis=-1)) + 1e-300
    return np.asarray((np.arctan2(two_sin, two_cos) / two_sin)[..., None] * axis)


def _log_by_quaternion(C: Array) -> Array:
    q = to_quaternion(C)
    n = np.sqrt(np.sum(q[..., 1:] ** 2, axis=-1)) + 1e-300
    return np.asarray((2.0 * np.arctan2(n, q[..., 0]) / n)[..., None] * q[..., 1:])


def to_quaternion(C: Array) -> Array:
    """Unit quaternion (w, x, y, z), w >= 0, shape (..., 4), of a rotation matrix (..., 3, 3).

    From the largest of its four components (Shepperd 1978).
    """
    m = np.moveaxis(C.reshape(*C.shape[:-2], 9), -1, 0)
    xx, xy, xz, yx, yy, yz, zx, zy, zz = m
    # row i is the quaternion times four times its component i: the row of the largest component is well conditioned
    rows = np.stack(
        [
            np.stack([1 + xx + yy + zz, zy - yz, xz - zx, yx - xy], axis=-1),
            np.stack([zy - yz, 1 + xx - yy - zz, yx + xy, xz + zx], axis=-1),
            np.stack([xz - zx, yx + xy, 1 - xx + yy - zz, zy + yz], axis=-1),
            np.stack([yx - xy, xz + zx, zy + yz, 1 - xx - yy + zz], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    q /= np.sqrt(np.sum(q**2, axis=-1))[..., None]
    return np.where(q[..., :1] < 0.0, -q, q)


def from_quaternion(q: Array) -> Array:
    """Rotation matrix of a unit quaternion (w, x, y, z), the inverse of `to_quaternion`; (..., 4) to (..., 3, 3)."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    C = np.empty((*q.shape[:-1], 3, 3))
    C[..., 0, 0], C[..., 0, 1], C[..., 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    C[..., 1, 0], C[..., 1, 1], C[..., 1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    C[..., 2, 0], C[..., 2, 1], C[..., 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return C


def from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """C_nb = Rz(yaw) Ry(pitch) Rx(roll), R_p2n of equation (4), of roll, pitch and yaw (3-2-1), rad; shape (3, 3)."""
    return _axis(2, yaw) @ _axis(1, pitch) @ _axis(0, roll)


def from_rpys(angles: Array) -> Array:
    """C_nb, shape (..., 3, 3), of many roll, pitch, yaw, rad, shape (..., 3); see `from_rpy`."""
    (sr, sp, sy), (cr, cp, cy) = np.moveaxis(np.sin(angles), -1, 0), np.moveaxis(np.cos(angles), -1, 0)
    C = np.empty((*angles.shape, 3))
    C[..., 0, 0], C[..., 0, 1], C[..., 0, 2] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    C[..., 1, 0], C[..., 1, 1], C[..., 1, 2] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    C[..., 2, 0], C[..., 2, 1], C[..., 2, 2] = -sp, cp * sr, cp * cr
    return C


def to_rpy(C_nb: Array) -> Array:
    """Roll, pitch, yaw (3-2-1), rad, shape (..., 3), of an attitude (..., 3, 3).

    At pitch ±90° only roll ∓ yaw is defined; yaw is then what atan2(0, 0) gives, 0.
    """
    roll = np.arctan2(C_nb[..., 2, 1], C_nb[..., 2, 2])
    pitch = np.arctan2(-C_nb[..., 2, 0], np.hypot(C_nb[..., 2, 1], C_nb[..., 2, 2]))
    yaw = np.arctan2(C_nb[..., 1, 0], C_nb[..., 0, 0])
    return np.stack([roll, pitch, yaw], axis=-1)


def rpy_jacobian(C_nb: Array) -> Array:
    """d(roll, pitch, yaw)/dε_n, the inverse of (3)'s rate matrix, in n; shape (..., 3, 3), not finite at pitch ±90°."""
    rpy = to_rpy(C_nb)
    pitch, c, s = rpy[..., 1], np.cos(rpy[..., 2]), np.sin(rpy[..., 2])
    J = np.zeros_like(C_nb)
    J[..., 0, 0], J[..., 0, 1] = c / np.cos(pitch), s / np.cos(pitch)
    J[..., 1, 0], J[..., 1, 1] = -s, c
    J[..., 2, 0], J[..., 2, 1], J[..., 2, 2] = c * np.tan(pitch), s * np.tan(pitch), 1.0
    return J


def _axis(axis: int, angle: float) -> Array:
    v = np.zeros(3)
    v[axis] = angle
    return exp(v)
