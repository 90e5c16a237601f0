"""Compiled arithmetic that the kernels share: rows of 16 numbers, quaternions, vectors, the shape of the Earth."""

import math
from collections.abc import Callable
from typing import Any

import numba

from filters import earth
from filters.kalman.layout import STRIDE

# vector instructions out of straight-line code (rows below), which numba leaves off unless told
numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]

LANES = 32
CENTRE = 15  # lanes 0..14 are x̂ + columns, 15 the centre, 16..30 x̂ - columns, 31 a copy of the centre


_WITHIN: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    "fastmath": False,
    # nobody calls them from Python: without the code for that they compile faster
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}


PARTS: list[Any] = []  # the functions of `compiled`, in the order in which they were read


def compiled(function: Callable[..., Any]) -> Any:
    """Compiler of functions that other compiled ones call: numpy's rules of arithmetic, no lock held."""
    PARTS.append(numba.njit(**_WITHIN)(function))
    return PARTS[-1]


def inlined(function: Callable[..., Any]) -> Any:
    """As `compiled`, for what is pasted into its callers before they are compiled.

    Needed by what the loops over lanes call: compiled by itself, a function that gives several numbers is turned into
    short vector instructions of its own, and the loop around it then cannot be. It also spares the handing over of
    many arrays where a function is called at one place.
    """
    return numba.njit(inline="always", **_WITHIN)(function)


radii = inlined(earth.radii)
normal_gravity = compiled(earth.normal_gravity)


# Rows of 16 numbers, held in registers: written out, since only so the compiler makes vector instructions of them.


@compiled
def row(A, b):  # type: ignore[no-untyped-def]
    """Row of `A` that begins at b."""
    return (A[b], A[b + 1], A[b + 2], A[b + 3], A[b + 4], A[b + 5], A[b + 6], A[b + 7],
            A[b + 8], A[b + 9], A[b + 10], A[b + 11], A[b + 12], A[b + 13], A[b + 14], A[b + 15])  # fmt: skip


@compiled
def scaled(u, k):  # type: ignore[no-untyped-def]
    """Row times a number."""
    return (u[0] * k, u[1] * k, u[2] * k, u[3] * k, u[4] * k, u[5] * k, u[6] * k, u[7] * k,
            u[8] * k, u[9] * k, u[10] * k, u[11] * k, u[12] * k, u[13] * k, u[14] * k, u[15] * k)  # fmt: skip


@compiled
def plus(a, k, u):  # type: ignore[no-untyped-def]
    """Row a plus k times row u."""
    return (a[0] + k * u[0], a[1] + k * u[1], a[2] + k * u[2], a[3] + k * u[3],
            a[4] + k * u[4], a[5] + k * u[5], a[6] + k * u[6], a[7] + k * u[7],
            a[8] + k * u[8], a[9] + k * u[9], a[10] + k * u[10], a[11] + k * u[11],
            a[12] + k * u[12], a[13] + k * u[13], a[14] + k * u[14], a[15] + k * u[15])  # fmt: skip


@compiled
def store(A, b, u):  # type: ignore[no-untyped-def]
    """Write a row to `A` from b on."""
    A[b], A[b + 1], A[b + 2], A[b + 3], A[b + 4], A[b + 5], A[b + 6], A[b + 7] = u[:8]
    A[b + 8], A[b + 9], A[b + 10], A[b + 11], A[b + 12], A[b + 13], A[b + 14], A[b + 15] = u[8:]


@compiled
def cholesky(P, L):  # type: ignore[no-untyped-def]
    """Lower factor of P; column j of L stands in L[j * STRIDE:]. Returns -1, or the row at which P is not definite.

    Columns are subtracted from all that remains, whole rows at a time: no sum is reordered, every loop is a vector's.
    """
    for i in range(15 * STRIDE):
        L[i] = P[i]
    for j in range(15):
        pivot = L[j * STRIDE + j]
        if not pivot > 0.0:
            return j
        column = scaled(row(L, j * STRIDE), 1.0 / math.sqrt(pivot))
        store(L, j * STRIDE, column)
        for i in range(j):
            L[j * STRIDE + i] = 0.0
        for k in range(j + 1, 15):
            store(L, k * STRIDE, plus(row(L, k * STRIDE), -L[j * STRIDE + k], column))
    return -1


# Vectors are tuples of three, quaternions of four, the real part first.


@compiled
def vector(A, at, step):  # type: ignore[no-untyped-def]
    """Three numbers of `A`, `step` apart."""
    return A[at], A[at + step], A[at + 2 * step]


@inlined
def along(a, k, u):  # type: ignore[no-untyped-def]
    """Vector a plus k times vector u."""
    return a[0] + k * u[0], a[1] + k * u[1], a[2] + k * u[2]


@inlined
def product(p, q):  # type: ignore[no-untyped-def]
    """Product of two quaternions."""
    w, x, y, z = p
    a, b, c, d = q
    return (
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )


@compiled
def quaternion(A, at, step):  # type: ignore[no-untyped-def]
    """Four numbers of `A`, `step` apart."""
    return A[at], A[at + step], A[at + 2 * step], A[at + 3 * step]


@inlined
def difference(p, q):  # type: ignore[no-untyped-def]
    """Quaternion p times the inverse of q."""
    return product(p, (q[0], -q[1], -q[2], -q[3]))


@compiled
def logarithm(q):  # type: ignore[no-untyped-def]
    """Rotation vector of a quaternion."""
    size = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]) + 1e-300
    k = 2.0 * math.atan2(math.copysign(size, q[0]), abs(q[0])) / size
    return k * q[1], k * q[2], k * q[3]


@compiled
def cos_series(t):  # type: ignore[no-untyped-def]
    """cos √t for t ≤ 0.0025, to rounding."""
    return 1.0 + t * (-0.5 + t * (1.0 / 24.0 + t * (-1.0 / 720.0 + t * (1.0 / 40320.0))))


@compiled
def sinc_series(t):  # type: ignore[no-untyped-def]
    """sin √t/√t for t ≤ 0.0025, to rounding."""
    return 1.0 + t * (-1.0 / 6.0 + t * (1.0 / 120.0 + t * (-1.0 / 5040.0 + t * (1.0 / 362880.0))))


@inlined
def small_rotation(k, u):  # type: ignore[no-untyped-def]
    """Quaternion of the rotation vector 2 k u, |k u| ≤ 0.05 rad, by series."""
    x, y, z = k * u[0], k * u[1], k * u[2]
    t = x * x + y * y + z * z
    s = sinc_series(t)
    return cos_series(t), s * x, s * y, s * z
