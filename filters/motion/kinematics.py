"""From segments to numbers: pieces of time with one formula each, and rotations and body rates of table angles.

Every number is a function of its own time alone, bit for bit, whatever array it comes in: sines are taken one by one.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.motion.segments import Dwell, Rate, Sampled, Segment, Sine, axis_number
from filters.types import Array

# a recorded angle that changes slower than this is a table at rest: encoders flicker by their last digit
_REST_RATE = math.radians(0.01)
_SAME_ANGLE = 1e-12


@dataclass(frozen=True, slots=True)
class Swing:
    """amplitude · (mean + depth · cos(ω τ / 2)) · sin(ω (τ + elapsed)) on an axis; τ from the piece's start."""

    axis: int
    amplitude: float
    omega: float
    elapsed: float
    mean: float
    depth: float


@dataclass(frozen=True, slots=True)
class Piece:
    """A stretch of time with one formula: a cubic in each axis, and perhaps a swing."""

    seconds: float
    cubic: Array  # (4, 3), ascending powers of time since the piece's start
    segment: int
    rests: bool = False
    swing: Swing | None = None


@dataclass(frozen=True, slots=True)
class PieceTable:
    """All pieces as arrays; the last one has no end."""

    starts: Array  # (P,)
    cubics: Array  # (P, 4, 3)
    segments: NDArray[np.int_]
    rests: NDArray[np.bool_]
    swings: dict[int, Swing]


def body_rate(angles: Array, rates: Array) -> Array:
    """Angular rate of the body relative to n, in body axes, of C_nb = Rx(outer) Ry(middle) Rz(inner).

    ω = Rzᵀ Ryᵀ x̂ o' + Rzᵀ ŷ m' + ẑ i'; angles and rates as `Profile` gives them, rad and rad/s, shape (N, 3).
    """
    sin_m, cos_m = each(math.sin, angles[:, 1]), each(math.cos, angles[:, 1])
    sin_i, cos_i = each(math.sin, angles[:, 2]), each(math.cos, angles[:, 2])
    o, m, i = rates.T
    return np.stack([cos_i * cos_m * o + sin_i * m, cos_i * m - sin_i * cos_m * o, sin_m * o + i], axis=-1)


def attitudes(angles: Array) -> Array:
    """C_nb = Rx(outer) Ry(middle) Rz(inner), shape (N, 3, 3), of angles as `Profile` gives them, rad, shape (N, 3)."""
    (so, sm, si), (co, cm, ci) = ([each(f, column) for column in angles.T] for f in (math.sin, math.cos))
    C = np.empty((len(angles), 3, 3))
    C[:, 0] = np.stack([cm * ci, -(cm * si), sm], axis=-1)
    C[:, 1] = np.stack([co * si + so * sm * ci, co * ci - so * sm * si, -(so * cm)], axis=-1)
    C[:, 2] = np.stack([so * si - co * sm * ci, so * ci + co * sm * si, co * cm], axis=-1)
    return C


def angles_of(C_nb: Array) -> Array:
    """Outer, middle and inner rotation of attitudes, the inverse of `attitudes`.

    middle = asin C₁₃, outer = atan2(-C₂₃, C₃₃), inner = atan2(-C₁₂, C₁₁); with middle at ±90° only the sum or the
    difference of the other two is known, and means little there. Rad, shape (N, 3), middle within ±π/2.
    """
    middle = np.arcsin(np.clip(C_nb[:, 0, 2], -1.0, 1.0))
    outer = np.arctan2(-C_nb[:, 1, 2], C_nb[:, 2, 2])
    return np.stack([outer, middle, np.arctan2(-C_nb[:, 0, 1], C_nb[:, 0, 0])], axis=1)


def each(function: Callable[[float], float], x: Array) -> Array:
    """`function` of each number by itself: what numpy returns may depend on where in an array a number stands."""
    return np.array([function(v) for v in x.tolist()], np.float64)


def envelope(swing: Swing, tau: Array) -> tuple[Array, Array]:
    """Envelope of a swing and its time derivative."""
    if swing.depth == 0.0:
        return np.full_like(tau, swing.mean), np.zeros_like(tau)
    half = 0.5 * swing.omega
    u = swing.mean + swing.depth * each(math.cos, half * tau)
    return u, -swing.depth * half * each(math.sin, half * tau)


def piece_table(segments: Sequence[Segment], slew: float, accel: float) -> PieceTable:
    """Pieces of a row of segments and of the moves between them.

    `segments`: in order, at least one.
    `slew`: limit of the rate in moves, rad/s.
    `accel`: angular acceleration of moves and of ramps, rad/s².
    Returns ending with a rest that has no end.
    """
    pieces: list[Piece] = []
    first = segments[0]
    at = np.zeros(3)
    if isinstance(first, Dwell):
        at = np.array(first.angles)
    elif isinstance(first, Sampled):
        at = np.array(first.angles[0])
    turns = np.zeros(3)  # what is added to a dwell's angles: whole turns made by rate segments
    has_turned = np.zeros(3, bool)
    for number, segment in enumerate(segments):
        if isinstance(segment, Dwell | Sampled):
            to = np.array(segment.angles if isinstance(segment, Dwell) else segment.angles[0])
            turns = np.where(has_turned, 2.0 * np.pi * np.round((at - to) / (2.0 * np.pi)), turns)
            has_turned[:] = False
            pieces += _move(at, to + turns, number, slew, accel)
            at = to + turns
        match segment:
            case Dwell():
                pieces.append(_rest(at, number, segment.seconds))
            case Rate():
                axis = axis_number(segment.axis)
                pieces += _turn(at, axis, segment, number, accel)
                at = at.copy()
                at[axis] += segment.rate * (abs(segment.rate) / accel + segment.seconds)
                has_turned[axis] = True
            case Sine():
                pieces += _swings(at, segment, number)
            case Sampled():
                pieces += _cubics(segment, turns, number)
                at = np.array(segment.angles[-1]) + turns
    pieces.append(_rest(at, len(segments) - 1, math.inf))
    return PieceTable(
        np.concatenate([[0.0], np.cumsum([piece.seconds for piece in pieces[:-1]])]),
        np.array([piece.cubic for piece in pieces]),
        np.array([piece.segment for piece in pieces]),
        np.array([piece.rests for piece in pieces]),
        {n: piece.swing for n, piece in enumerate(pieces) if piece.swing is not None},
    )


def _cubic(*coefficients: Array) -> Array:
    out = np.zeros((4, 3))
    for power, coefficient in enumerate(coefficients):
        out[power] = coefficient
    return out


def _rest(at: Array, number: int, seconds: float) -> Piece:
    return Piece(seconds, _cubic(at), number, rests=True)


def _move(at: Array, to: Array, number: int, slew: float, accel: float) -> list[Piece]:
    distance = float(np.abs(to - at).max())
    if distance <= _SAME_ANGLE:
        return []
    ramp = min(slew / accel, math.sqrt(distance / accel))
    peak = accel * ramp
    return _trapezoid(at, (to - at) / distance * peak, ramp, distance / peak - ramp, number)


def _turn(at: Array, axis: int, segment: Rate, number: int, accel: float) -> list[Piece]:
    rate = np.zeros(3)
    rate[axis] = segment.rate
    return _trapezoid(at, rate, abs(segment.rate) / accel, segment.seconds, number)


def _trapezoid(at: Array, rate: Array, ramp: float, cruise: float, number: int) -> list[Piece]:
    """From rest to `rate` in `ramp` seconds, on for `cruise` seconds, and back to rest in `ramp` seconds."""
    accel = rate / ramp
    cruising = at + 0.5 * ramp * rate
    braking = cruising + cruise * rate
    pieces = [Piece(ramp, _cubic(at, np.zeros(3), 0.5 * accel), number)]
    if cruise > 1e-9:
        pieces.append(Piece(cruise, _cubic(cruising, rate), number))
    return [*pieces, Piece(ramp, _cubic(braking, rate, -0.5 * accel), number)]


def _swings(at: Array, segment: Sine, number: int) -> list[Piece]:
    axis, omega, period = axis_number(segment.axis), 2.0 * math.pi * segment.hz, 1.0 / segment.hz
    stretches = (
        (period, 0.0, 0.5, -0.5),  # seconds, elapsed, mean and depth of the envelope
        (segment.seconds, period, 1.0, 0.0),
        (period, period + segment.seconds, 0.5, 0.5),
    )
    return [
        Piece(seconds, _cubic(at), number, swing=Swing(axis, segment.amplitude, omega, elapsed, mean, depth))
        for seconds, elapsed, mean, depth in stretches
    ]


def _cubics(segment: Sampled, turns: Array, number: int) -> list[Piece]:
    # here, since it would double the start-up time of every command that runs a filter
    from scipy import interpolate

    t, angles = np.array(segment.t), np.array(segment.angles) + turns
    c = interpolate.PchipInterpolator(t, angles, axis=0).c  # (4, N - 1, 3), descending powers
    rests = (np.abs(np.diff(angles, axis=0)).max(axis=1) < _REST_RATE * np.diff(t)).tolist()
    return [Piece(seconds, c[::-1, n], number, rests=rests[n]) for n, seconds in enumerate(np.diff(t).tolist())]
