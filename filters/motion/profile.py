"""The table's motion as a pure function of time: a row of segments, and angles and rates at any time.

What it leaves out: files (`imutui.logbook.reference_file`), readings (`filters.simulation`), what the filter makes of
it (`filters.motion.reference`). What segments mean is in `filters.motion.segments`.

A profile's clock starts with the first segment, and before it and after the last the table rests.

Table angles times `sign` are rotations about north, east and down: C_nb = Rx(outer) Ry(middle) Rz(inner). What the
methods return has the sign applied. `slew` and `accel` are magnitudes of the table's own angles.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from filters.errors import InputError
from filters.motion.kinematics import PieceTable, Swing, attitudes, body_rate, each, envelope, piece_table
from filters.motion.segments import Dwell, Sampled, Segment, check_positive
from filters.types import Array

ALIGNS = ("none", "marks", "gyro")  # how profile time may be joined to log time
SLEW = math.radians(20.0)  # rad/s: limit of the rate in moves, unless a profile says otherwise
ACCEL = math.radians(100.0)  # rad/s²: of moves and ramps, unless a profile says otherwise


@dataclass(frozen=True)
class Profile:
    """Motion of a table; the module says what its segments mean.

    Raises InputError if one of them makes no sense.
    """

    segments: tuple[Segment, ...]  # in order, at least one
    # ±1 for each axis: table angle times sign is the rotation about north, east, down
    sign: tuple[int, int, int] = (1, 1, 1)
    align: str = "none"  # how profile time is joined to the time of a log
    offset_sd: float | None = None  # standard deviation of that joint, s, where it is known
    slew: float = SLEW  # limit of the rate in moves, rad/s
    accel: float = ACCEL  # angular acceleration of moves and of ramps, rad/s²
    _pieces: PieceTable = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.segments:
            raise InputError("`segments` is empty: a profile has at least one")
        if len(self.sign) != 3 or any(s not in (-1, 1) for s in self.sign):
            raise InputError(f"`sign` is {list(self.sign)}, not three of -1 and 1")
        if self.align not in ALIGNS:
            raise InputError(f'`align` is "{self.align}", not one of: {", ".join(ALIGNS)}')
        if self.offset_sd is not None and not 0.0 <= self.offset_sd < math.inf:
            raise InputError(f"`offset_sd` is {self.offset_sd}, not a finite number of seconds, 0 or more")
        check_positive("slew", self.slew)
        check_positive("accel", self.accel)
        object.__setattr__(self, "_pieces", piece_table(self.segments, self.slew, self.accel))

    @property
    def duration(self) -> float:
        """Time at which the last segment ends, s."""
        return float(self._pieces.starts[-1])

    @property
    def starts(self) -> Array:
        """Times at which the segments begin, s, shape (S,); that of a dwell begins with the move to it."""
        return self._pieces.starts[np.searchsorted(self._pieces.segments, np.arange(len(self.segments)))]

    @property
    def rest_starts(self) -> Array:
        """Times at which the dwells come to rest, s, shape (S,); NaN for other segments."""
        starts = np.full(len(self.segments), np.nan)
        for start, segment, rests in zip(
            self._pieces.starts[:-1], self._pieces.segments[:-1], self._pieces.rests[:-1], strict=True
        ):
            if rests and isinstance(self.segments[segment], Dwell):
                starts[segment] = start
        return starts

    @property
    def max_rate(self) -> float:
        """Largest rate of any axis, rad/s."""
        pieces = self._pieces
        seconds = np.diff(pieces.starts)
        # a cubic's rate is largest at an end or at its turning point
        quadratic = pieces.cubics[:-1] * np.array([0.0, 1.0, 2.0, 3.0])[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            turning = np.nan_to_num(-quadratic[:, 2] / (2.0 * quadratic[:, 3]), posinf=0.0, neginf=0.0)
        peak = 0.0
        for tau in (np.zeros_like(turning), np.repeat(seconds[:, None], 3, 1), np.clip(turning, 0.0, seconds[:, None])):
            rate = quadratic[:, 1] + (quadratic[:, 2] + quadratic[:, 3] * tau) * tau
            peak = max(peak, float(np.abs(rate).max(initial=0.0)))
        # under the envelope of the first and last period it is less than in full swing
        return max([peak, *(swing.amplitude * swing.omega for swing in pieces.swings.values())])

    def angles(self, t: ArrayLike) -> Array:
        """Rotations about north, east and down (outer, middle, inner times sign), rad, shape (N, 3), at times, s."""
        piece, tau = self._located(t)
        c = self._pieces.cubics[piece]
        x = tau[:, None]
        out = ((c[:, 3] * x + c[:, 2]) * x + c[:, 1]) * x + c[:, 0]
        for rows, swing in self._swinging(piece):
            u, _ = envelope(swing, tau[rows])
            out[rows, swing.axis] += swing.amplitude * u * each(math.sin, swing.omega * (tau[rows] + swing.elapsed))
        return out * np.array(self.sign, np.float64)

    def rates(self, t: ArrayLike) -> Array:
        """Time derivatives of `angles`, rad/s; zero before the first segment and after the last."""
        piece, tau = self._located(t)
        c = self._pieces.cubics[piece]
        x = tau[:, None]
        out = (3.0 * c[:, 3] * x + 2.0 * c[:, 2]) * x + c[:, 1]
        for rows, swing in self._swinging(piece):
            u, u_dot = envelope(swing, tau[rows])
            phase = swing.omega * (tau[rows] + swing.elapsed)
            out[rows, swing.axis] += swing.amplitude * (
                u_dot * each(math.sin, phase) + u * swing.omega * each(math.cos, phase)
            )
        out[np.atleast_1d(np.asarray(t, np.float64)) < 0.0] = 0.0
        return out * np.array(self.sign, np.float64)

    def pose(self, t: ArrayLike) -> tuple[Array, Array]:
        """Attitude C_nb, shape (N, 3, 3), and angular rate relative to n in body axes, rad/s, shape (N, 3)."""
        angles, rates = self.angles(t), self.rates(t)
        return attitudes(angles), body_rate(angles, rates)

    def index(self, t: ArrayLike) -> NDArray[np.int_]:
        """Number of the segment at each time, shape (N,); the first before the start, the last after the end."""
        return self._pieces.segments[self._located(t)[0]]

    def phase(self, t: ArrayLike) -> NDArray[np.bool_]:
        """Whether the table is at rest at each time, shape (N,): in a dwell and not on the move there, or at the end.

        Before the start it rests as well. In sampled angles it rests where they change by less than 0.01 deg/s.
        """
        before = np.atleast_1d(np.asarray(t, np.float64)) < 0.0
        return np.asarray(self._pieces.rests[self._located(t)[0]] | before)

    def piece(self, t: float) -> tuple[float, float, Array]:
        """Start and end of the piece of motion at a time, s, and its cubics in the time since its start, (4, 3), rad.

        For callers that look at many times one by one; swings are left out.
        """
        n = int(self._located(t)[0][0])
        end = float(self._pieces.starts[n + 1]) if n + 1 < self._pieces.starts.size else math.inf
        return float(self._pieces.starts[n]), end, self._pieces.cubics[n] * np.array(self.sign, np.float64)

    def _located(self, t: ArrayLike) -> tuple[NDArray[np.int_], Array]:
        """Piece of each time, and the time since its start."""
        times = np.maximum(np.atleast_1d(np.asarray(t, np.float64)), 0.0)
        piece = np.searchsorted(self._pieces.starts, times, side="right") - 1
        return piece, times - self._pieces.starts[piece]

    def _swinging(self, piece: NDArray[np.int_]) -> list[tuple[NDArray[np.int_], Swing]]:
        return [(rows, swing) for p, swing in self._pieces.swings.items() if (rows := np.flatnonzero(piece == p)).size]


def from_samples(
    t: ArrayLike,
    outer: ArrayLike,
    middle: ArrayLike,
    inner: ArrayLike,
    *,
    sign: tuple[int, int, int] = (1, 1, 1),
    align: str = "none",
    offset_sd: float | None = None,
) -> Profile:
    """Profile of sampled table angles.

    `t`: s, increasing, shape (N,); the profile's clock starts with the first.
    `outer`, `middle`, `inner`: Table angles, rad, shape (N,).
    `sign`, `align`, `offset_sd`: as in `Profile`.
    Raises ValueError if lengths differ, a number is not finite, or time does not increase.
    """
    columns = [np.asarray(v, np.float64) for v in (t, outer, middle, inner)]
    if any(column.shape != (columns[0].size,) for column in columns):
        raise ValueError(f"`t` and the angles have shapes {[column.shape for column in columns]}, not one length")
    angles = tuple((o, m, i) for o, m, i in np.stack(columns[1:], axis=-1).tolist())
    return Profile((Sampled(tuple(columns[0].tolist()), angles),), sign, align, offset_sd)
