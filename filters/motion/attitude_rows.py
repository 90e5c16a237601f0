"""Attitude and body rate at samples from rows of attitude, such as those of an optical reference, with their gaps.

Everything is done with rotations, so no attitude is worse than another. Between two rows next to each other the mean
rate is Log(C₁ᵀ C₂)/Δt, which needs no derivative of a noisy signal: means over a block of it say what its end
attitudes say, and the noise of the rows between cancels. What it leaves out: where a row comes from, and accelerations.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

from filters.types import Array

_FAR = 3.0  # steps between rows that are no gap
_WINDOW_S = 1.0
_QUIET = 3.0  # times the quietest windows' standard deviation
_STILL_RATE = np.deg2rad(1.0)
_STILL_FORCE = 0.2  # m/s²
_STILL_TURN = np.deg2rad(0.5)  # over a window
_SETTLED_TURN = np.deg2rad(0.2)  # between the means of the first and the last third of a stretch
_LEAST_WINDOWS = 2.0
_SAME = np.deg2rad(0.1)  # two rests' attitudes: what a measured one is worth


@dataclass(frozen=True, slots=True)
class Orientation:
    """What rows of attitude say at the samples of a recording."""

    quaternion: Array  # w, x, y, z of C_nb, shape (N, 4)
    rate: Array  # of the body relative to n, body axes, rad/s, shape (N, 3)
    unknown: NDArray[np.bool_]  # samples in a gap, where both are only bridged, shape (N,)


def at_samples(t: Array, at: Array, C_nb: Array) -> Orientation:
    """Attitude and rate at samples.

    `t`: of the samples, s, shape (N,).
    `at`: of the rows, s, increasing, shape (M,), M at least 2.
    `C_nb`: of the rows, shape (M, 3, 3).
    """
    rows = Rotation.from_matrix(C_nb)
    step = np.diff(at)
    gap = step > _FAR * float(np.median(step))
    inside = np.clip(t, at[0], at[-1])
    quaternion = Slerp(at, rows)(inside).as_quat()[:, [3, 0, 1, 2]]
    rate = _rates(t, at, (rows[:-1].inv() * rows[1:]).as_rotvec() / step[:, None], gap)
    interval = np.clip(np.searchsorted(at, t, side="right") - 1, 0, step.size - 1)
    # a sample that stands on the row before or after a gap has its attitude, and no rate
    half = 0.5 * float(np.median(step))
    on_row = t - at[interval] < 1e-3 * half
    unknown = gap[interval] | gap[np.maximum(interval - on_row, 0)]
    unknown |= (t < at[0] - half) | (t > at[-1] + half)
    return Orientation(np.asarray(quaternion), rate, unknown)


def _rates(t: Array, at: Array, mean: Array, gap: NDArray[np.bool_]) -> Array:
    """Rates at samples from means between rows, shape (M - 1, 3), stretch by stretch between gaps."""
    middle = 0.5 * (at[1:] + at[:-1])
    out = np.empty((t.size, 3))
    for axis in range(3):
        out[:, axis] = np.interp(t, middle[~gap], mean[~gap, axis]) if not gap.all() else 0.0
    edges = np.flatnonzero(np.diff(np.r_[True, gap, True].astype(np.int8)))
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if last - first < 4:
            continue
        own = slice(first, last)
        rows = (t >= at[first]) & (t <= at[last])
        out[rows] = _smooth_rates(t[rows], at[first : last + 1], middle[own], mean[own])
    return out


def _smooth_rates(t: Array, at: Array, middle: Array, mean: Array) -> Array:
    """Rates of which the mean from row to row is `mean`: to the third order in the time between rows.

    Straight lines between the means would read fast motion as slower than it is, by 0.4 % at 1/40 of the rows' rate,
    and rotations of one axis while another speeds up would add up in the wrong order.
    """
    step = np.diff(at)[:, None]
    slope = np.gradient(mean, middle, axis=0)
    # for a rate that changes evenly Log(C₁ᵀ C₂) = ω Δt + Δt³/12 ω × ω'
    instant = mean - step**2 / 12.0 * np.cross(mean, slope)
    bend = np.zeros_like(instant)
    bend[1:-1] = instant[2:] - 2.0 * instant[1:-1] + instant[:-2]
    # the value at the middle from the means around it
    centre = instant - bend / 24.0
    lines = np.stack([np.interp(t, middle, column) for column in centre.T], axis=1)
    # of a parabola through the middles, a line between two of them is short by x (1 - x) / 2 of the second difference
    place = np.clip(np.interp(t, middle, np.arange(middle.size)), 0.0, middle.size - 1.0)
    x = (place - np.floor(place))[:, None]
    curved = np.stack([np.interp(t, middle, column) for column in bend.T], axis=1)
    return np.asarray(lines - 0.5 * x * (1.0 - x) * curved)


def rests(t: Array, gyro: Array, force: Array, known: Orientation) -> NDArray[np.int_]:
    """Stretches at rest: readings as quiet as ever, and no turn that the rows would show.

    `t`: s, shape (N,).
    `gyro`, `force`: readings, rad/s and m/s², shape (N, 3).
    `known`: at the same samples.
    Returns first sample of each stretch and the one after its last, shape (R, 2).
    """
    period = float(t[-1] - t[0]) / (t.size - 1)
    size = max(3, round(_WINDOW_S / period))
    if t.size < 2 * size:
        return np.zeros((0, 2), np.int64)
    still = np.ones(t.size, bool)
    for values, most in ((gyro, _STILL_RATE), (force, _STILL_FORCE)):
        for axis in range(3):
            sd = _running_sd(values[:, axis], size)
            quietest = float(np.quantile(sd, 0.02))
            still &= sd < min(most, _QUIET * quietest + 1e-12)
    q = known.quaternion
    cosine = np.abs(np.sum(q[size:] * q[:-size], axis=1))
    turned = np.zeros(t.size, bool)
    half = size // 2
    turned[half : half + cosine.size] = np.arccos(np.minimum(cosine, 1.0)) > 0.5 * _STILL_TURN
    still &= ~turned & ~known.unknown
    edges = np.flatnonzero(np.diff(np.r_[False, still, False].astype(np.int8))).reshape(-1, 2)
    lasting = [(a, b) for a, b in edges.tolist() if b - a >= _LEAST_WINDOWS * size and _settled(q[a:b])]
    return np.array(lasting, np.int64).reshape(-1, 2)


def at_rest(known: Orientation, stretches: NDArray[np.int_]) -> Orientation:
    """With one attitude for each stretch at rest, the mean of its rows, and no rate there.

    Rests that differ by less than a measured attitude is worth have the same: else what the accelerometers read of the
    reference's error, a few mg, would pass for an effect of the attitude.
    """
    quaternion, rate = known.quaternion.copy(), known.rate.copy()
    seen: list[Array] = []
    for first, last in stretches.tolist():
        own = _mean(quaternion[first:last])
        alike = [other for other in seen if _angle(own, other) < _SAME]
        seen.append(alike[0] if alike else own)
        quaternion[first:last] = seen[-1]
        rate[first:last] = 0.0
    return Orientation(quaternion, rate, known.unknown)


def _settled(q: Array) -> bool:
    """Whether attitudes end where they begin."""
    third = max(1, len(q) // 3)
    return bool(_angle(_mean(q[:third]), _mean(q[-third:])) < _SETTLED_TURN)


def _angle(a: Array, b: Array) -> float:
    """Of the rotation between two attitudes, rad."""
    return 2.0 * float(np.arccos(min(1.0, abs(float(a @ b)))))


def _mean(q: Array) -> Array:
    """Mean of quaternions that lie close together."""
    mean = (q * np.sign(q @ q[0])[:, None]).mean(axis=0)
    return np.asarray(mean / np.linalg.norm(mean))


def _running_sd(x: Array, size: int) -> Array:
    """Standard deviation over the `size` samples around each."""
    x = x - np.mean(x)
    mean = uniform_filter1d(x, size, mode="nearest")
    return np.asarray(np.sqrt(np.maximum(uniform_filter1d(x * x, size, mode="nearest") - mean * mean, 0.0)))
