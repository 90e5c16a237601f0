"""The table's motion as a pure function of time: segments, the moves between them, angles, rates, body rates.

What it leaves out: files (`imutui.scenario` reads them), readings (`filters.simulation`), what the filter makes of it.

A profile is a row of segments. Its clock starts with the first one, and before it and after the last the table rests.

    dwell    Rests at `angles` for `seconds`. If the table is elsewhere it moves there first, all axes at once and along
             a straight line in the angles: a trapezoid of rate, limited by `slew` and `accel` on the axis that has
             farthest to go. `seconds` count from the end of that move. A profile that begins with a dwell begins at
             its angles; any other begins at zero angles.
    rate     Turns one axis at constant `rate` for `seconds`. Speeding up and slowing down at `accel` come before and
             after, and are not in `seconds`. Whole turns made so are not unwound: on that axis the next dwell takes the
             short way round.
    sine     Swings one axis about where it is: amplitude · u(t) · sin(2π hz t). The envelope u is 1 for `seconds`;
             before and after, each one period long and not in `seconds`, it is half a cosine from 0 and back to 0, so
             that angle and rate start and end at zero. `slew` and `accel` do not limit it.
    samples  Angles at given times, between them monotone cubics (no overshoot, so a table at rest stays at rest).

Table angles times `sign` are rotations about north, east and down: C_nb = Rx(outer) Ry(middle) Rz(inner). What the
methods return has the sign applied. `slew` and `accel` are magnitudes of the table's own angles.

Every number is a function of its own time alone, bit for bit, whatever array it comes in: sines are taken one by one.

As a TOML document (`from_document`; angles in degrees)::

    align = "marks"               # "none", "marks" or "gyro": how profile time is joined to log time
    sign = [1, 1, -1]             # of each axis, default 1
    offset_sd_s = 0.05            # standard deviation of that joint, s; absent where it is not known
    slew_dps = 20.0               # of moves
    accel_dps2 = 100.0            # of moves and of ramps

    [[segment]]
    kind = "dwell"
    angles_deg = [0.0, 90.0, 0.0] # outer, middle, inner
    seconds = 30.0

    [[segment]]
    kind = "rate"
    axis = "inner"
    rate_dps = 30.0
    seconds = 12.0

    [[segment]]
    kind = "sine"
    axis = "middle"
    amplitude_deg = 10.0
    hz = 0.5
    seconds = 20.0
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from filters.types import Array

AXES = ("outer", "middle", "inner")
ALIGNS = ("none", "marks", "gyro")
SLEW = math.radians(20.0)
ACCEL = math.radians(100.0)

# a recorded angle that changes slower than this is a table at rest: encoders flicker by their last digit
_REST_RATE = math.radians(0.01)
_SAME_ANGLE = 1e-12


@dataclass(frozen=True, slots=True)
class Dwell:
    """At rest.

    Attributes
    ----------
    angles : tuple of float
        Outer, middle, inner, rad.
    seconds : float
        At rest, without the move there.
    """

    angles: tuple[float, float, float]
    seconds: float

    def __post_init__(self) -> None:
        if len(self.angles) != 3 or not np.isfinite(self.angles).all():
            raise ValueError(f"`angles` is {self.angles}, not three finite angles: outer, middle, inner")
        _positive("seconds", self.seconds)


@dataclass(frozen=True, slots=True)
class Rate:
    """One axis at constant rate.

    Attributes
    ----------
    axis : {"outer", "middle", "inner"}
        Which.
    rate : float
        rad/s, not zero.
    seconds : float
        At that rate, without the ramps.
    """

    axis: str
    rate: float
    seconds: float

    def __post_init__(self) -> None:
        _axis_number(self.axis)
        if not math.isfinite(self.rate) or self.rate == 0.0:
            raise ValueError(f"`rate` is {self.rate}, not a finite rate other than zero")
        _positive("seconds", self.seconds)


@dataclass(frozen=True, slots=True)
class Sine:
    """One axis swinging.

    Attributes
    ----------
    axis : {"outer", "middle", "inner"}
        Which.
    amplitude : float
        rad, positive.
    hz : float
        Frequency.
    seconds : float
        At full amplitude, without the period before and the period after.
    """

    axis: str
    amplitude: float
    hz: float
    seconds: float

    def __post_init__(self) -> None:
        _axis_number(self.axis)
        _positive("amplitude", self.amplitude)
        _positive("hz", self.hz)
        _positive("seconds", self.seconds)


@dataclass(frozen=True, slots=True)
class Sampled:
    """Recorded or computed angles.

    Attributes
    ----------
    t : tuple of float
        s, increasing, at least two. Only differences count: the segment starts with the first.
    angles : tuple of tuple of float
        Outer, middle, inner at those times, rad.
    """

    t: tuple[float, ...]
    angles: tuple[tuple[float, float, float], ...]

    def __post_init__(self) -> None:
        t, angles = np.array(self.t), np.array(self.angles)
        if t.size < 2 or angles.shape != (t.size, 3):
            raise ValueError(f"`t` has {t.size} times and `angles` shape {angles.shape}: at least 2, and 3 angles each")
        finite = np.isfinite(t) & np.isfinite(angles).all(axis=1)
        if not finite.all():
            row = int(np.argmin(finite))
            raise ValueError(f"`angles` or `t` is not finite in row {row}")
        if not (np.diff(t) > 0.0).all():
            row = int(np.argmin(np.diff(t) > 0.0)) + 1
            raise ValueError(f"`t` does not increase in row {row}: {t[row]:g} after {t[row - 1]:g}")


Segment = Dwell | Rate | Sine | Sampled


@dataclass(frozen=True, slots=True)
class _Swing:
    """amplitude · (mean + depth · cos(ω τ / 2)) · sin(ω (τ + elapsed)) on an axis; τ from the piece's start."""

    axis: int
    amplitude: float
    omega: float
    elapsed: float
    mean: float
    depth: float


@dataclass(frozen=True, slots=True)
class _Piece:
    """A stretch of time with one formula: a cubic in each axis, and perhaps a swing."""

    seconds: float
    cubic: Array  # (4, 3), ascending powers of time since the piece's start
    segment: int
    rests: bool = False
    swing: _Swing | None = None


@dataclass(frozen=True, slots=True)
class _Plan:
    """All pieces as arrays; the last one has no end."""

    starts: Array  # (P,)
    cubics: Array  # (P, 4, 3)
    segments: NDArray[np.int_]
    rests: NDArray[np.bool_]
    swings: dict[int, _Swing]


@dataclass(frozen=True)
class Profile:
    """Motion of a table; the module says what its segments mean.

    Attributes
    ----------
    segments : tuple of Dwell, Rate, Sine or Sampled
        In order, at least one.
    sign : tuple of int
        ±1 for each axis: table angle times sign is the rotation about north, east, down.
    align : {"none", "marks", "gyro"}
        How profile time is joined to the time of a log.
    offset_sd : float or None
        Standard deviation of that joint, s, where it is known.
    slew : float
        Limit of the rate in moves, rad/s.
    accel : float
        Angular acceleration of moves and of ramps, rad/s².

    Raises
    ------
    ValueError
        If one of them makes no sense.
    """

    segments: tuple[Segment, ...]
    sign: tuple[int, int, int] = (1, 1, 1)
    align: str = "none"
    offset_sd: float | None = None
    slew: float = SLEW
    accel: float = ACCEL
    _plan: _Plan = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.segments:
            raise ValueError("`segments` is empty: a profile has at least one")
        if len(self.sign) != 3 or any(s not in (-1, 1) for s in self.sign):
            raise ValueError(f"`sign` is {list(self.sign)}, not three of -1 and 1")
        if self.align not in ALIGNS:
            raise ValueError(f'`align` is "{self.align}", not one of: {", ".join(ALIGNS)}')
        if self.offset_sd is not None and not 0.0 <= self.offset_sd < math.inf:
            raise ValueError(f"`offset_sd` is {self.offset_sd}, not a finite number of seconds, 0 or more")
        _positive("slew", self.slew)
        _positive("accel", self.accel)
        object.__setattr__(self, "_plan", _planned(self))

    @property
    def duration(self) -> float:
        """Time at which the last segment ends, s."""
        return float(self._plan.starts[-1])

    @property
    def starts(self) -> Array:
        """Times at which the segments begin, s, shape (S,); that of a dwell begins with the move to it."""
        return self._plan.starts[np.searchsorted(self._plan.segments, np.arange(len(self.segments)))]

    @property
    def rest_starts(self) -> Array:
        """Times at which the dwells come to rest, s, shape (S,); NaN for other segments."""
        starts = np.full(len(self.segments), np.nan)
        for start, segment, rests in zip(
            self._plan.starts[:-1], self._plan.segments[:-1], self._plan.rests[:-1], strict=True
        ):
            if rests and isinstance(self.segments[segment], Dwell):
                starts[segment] = start
        return starts

    @property
    def max_rate(self) -> float:
        """Largest rate of any axis, rad/s."""
        plan = self._plan
        seconds = np.diff(plan.starts)
        # a cubic's rate is largest at an end or at its turning point
        quadratic = plan.cubics[:-1] * np.array([0.0, 1.0, 2.0, 3.0])[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            turning = np.nan_to_num(-quadratic[:, 2] / (2.0 * quadratic[:, 3]), posinf=0.0, neginf=0.0)
        peak = 0.0
        for tau in (np.zeros_like(turning), np.repeat(seconds[:, None], 3, 1), np.clip(turning, 0.0, seconds[:, None])):
            rate = quadratic[:, 1] + (quadratic[:, 2] + quadratic[:, 3] * tau) * tau
            peak = max(peak, float(np.abs(rate).max(initial=0.0)))
        # under the envelope of the first and last period it is less than in full swing
        return max([peak, *(swing.amplitude * swing.omega for swing in plan.swings.values())])

    def angles(self, t: ArrayLike) -> Array:
        """Rotations about north, east and down (outer, middle, inner times sign).

        Parameters
        ----------
        t : array_like
            Times, s, shape (N,) or a number.

        Returns
        -------
        Array
            rad, shape (N, 3).
        """
        piece, tau = self._located(t)
        c = self._plan.cubics[piece]
        x = tau[:, None]
        out = ((c[:, 3] * x + c[:, 2]) * x + c[:, 1]) * x + c[:, 0]
        for rows, swing in self._swinging(piece):
            u, _ = _envelope(swing, tau[rows])
            out[rows, swing.axis] += swing.amplitude * u * _each(math.sin, swing.omega * (tau[rows] + swing.elapsed))
        return out * np.array(self.sign, np.float64)

    def rates(self, t: ArrayLike) -> Array:
        """Time derivatives of `angles`.

        Parameters
        ----------
        t : array_like
            Times, s, shape (N,) or a number.

        Returns
        -------
        Array
            rad/s, shape (N, 3); zero before the first segment and after the last.
        """
        piece, tau = self._located(t)
        c = self._plan.cubics[piece]
        x = tau[:, None]
        out = (3.0 * c[:, 3] * x + 2.0 * c[:, 2]) * x + c[:, 1]
        for rows, swing in self._swinging(piece):
            u, u_dot = _envelope(swing, tau[rows])
            phase = swing.omega * (tau[rows] + swing.elapsed)
            out[rows, swing.axis] += swing.amplitude * (
                u_dot * _each(math.sin, phase) + u * swing.omega * _each(math.cos, phase)
            )
        out[np.atleast_1d(np.asarray(t, np.float64)) < 0.0] = 0.0
        return out * np.array(self.sign, np.float64)

    def index(self, t: ArrayLike) -> NDArray[np.int_]:
        """Number of the segment at each time, shape (N,); the first before the start, the last after the end."""
        return self._plan.segments[self._located(t)[0]]

    def phase(self, t: ArrayLike) -> NDArray[np.bool_]:
        """Whether the table is at rest at each time, shape (N,): in a dwell and not on the move there, or at the end.

        Before the start it rests as well. In sampled angles it rests where they change by less than 0.01 deg/s.
        """
        before = np.atleast_1d(np.asarray(t, np.float64)) < 0.0
        return np.asarray(self._plan.rests[self._located(t)[0]] | before)

    def _located(self, t: ArrayLike) -> tuple[NDArray[np.int_], Array]:
        """Piece of each time, and the time since its start."""
        times = np.maximum(np.atleast_1d(np.asarray(t, np.float64)), 0.0)
        piece = np.searchsorted(self._plan.starts, times, side="right") - 1
        return piece, times - self._plan.starts[piece]

    def _swinging(self, piece: NDArray[np.int_]) -> list[tuple[NDArray[np.int_], _Swing]]:
        return [(rows, swing) for p, swing in self._plan.swings.items() if (rows := np.flatnonzero(piece == p)).size]


def body_rate(angles: Array, rates: Array) -> Array:
    """Angular rate of the body relative to n, in body axes, of C_nb = Rx(outer) Ry(middle) Rz(inner).

    ω = Rzᵀ Ryᵀ x̂ o' + Rzᵀ ŷ m' + ẑ i'.

    Parameters
    ----------
    angles, rates : Array
        As `Profile` gives them, rad and rad/s, shape (N, 3).

    Returns
    -------
    Array
        rad/s, shape (N, 3).
    """
    sin_m, cos_m = _each(math.sin, angles[:, 1]), _each(math.cos, angles[:, 1])
    sin_i, cos_i = _each(math.sin, angles[:, 2]), _each(math.cos, angles[:, 2])
    o, m, i = rates.T
    return np.stack([cos_i * cos_m * o + sin_i * m, cos_i * m - sin_i * cos_m * o, sin_m * o + i], axis=-1)


def attitudes(angles: Array) -> Array:
    """Attitudes C_nb = Rx(outer) Ry(middle) Rz(inner) of many angles; `attitude.table` for one.

    Parameters
    ----------
    angles : Array
        As `Profile` gives them, rad, shape (N, 3).

    Returns
    -------
    Array
        Shape (N, 3, 3).
    """
    (so, sm, si), (co, cm, ci) = ([_each(f, column) for column in angles.T] for f in (math.sin, math.cos))
    C = np.empty((len(angles), 3, 3))
    C[:, 0] = np.stack([cm * ci, -(cm * si), sm], axis=-1)
    C[:, 1] = np.stack([co * si + so * sm * ci, co * ci - so * sm * si, -(so * cm)], axis=-1)
    C[:, 2] = np.stack([so * si - co * sm * ci, so * ci + co * sm * si, co * cm], axis=-1)
    return C


def angles_of(C_nb: Array) -> Array:
    """Outer, middle and inner rotation of attitudes, the inverse of `attitudes`.

    middle = asin C₁₃, outer = atan2(-C₂₃, C₃₃), inner = atan2(-C₁₂, C₁₁); with middle at ±90° only the sum or the
    difference of the other two is known, and means little there.

    Parameters
    ----------
    C_nb : Array
        Shape (N, 3, 3).

    Returns
    -------
    Array
        rad, shape (N, 3), middle within ±π/2, the others within ±π.
    """
    middle = np.arcsin(np.clip(C_nb[:, 0, 2], -1.0, 1.0))
    outer = np.arctan2(-C_nb[:, 1, 2], C_nb[:, 2, 2])
    return np.stack([outer, middle, np.arctan2(-C_nb[:, 0, 1], C_nb[:, 0, 0])], axis=1)


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

    Parameters
    ----------
    t : array_like
        s, increasing, shape (N,); the profile's clock starts with the first.
    outer, middle, inner : array_like
        Table angles, rad, shape (N,).
    sign, align, offset_sd
        As in `Profile`.

    Returns
    -------
    Profile

    Raises
    ------
    ValueError
        If lengths differ, a number is not finite, or time does not increase.
    """
    columns = [np.asarray(v, np.float64) for v in (t, outer, middle, inner)]
    if any(column.shape != (columns[0].size,) for column in columns):
        raise ValueError(f"`t` and the angles have shapes {[column.shape for column in columns]}, not one length")
    angles = tuple((o, m, i) for o, m, i in np.stack(columns[1:], axis=-1).tolist())
    return Profile((Sampled(tuple(columns[0].tolist()), angles),), sign, align, offset_sd)


def from_document(document: Mapping[str, Any]) -> Profile:
    """Profile from the content of a TOML file; the module shows one.

    Parameters
    ----------
    document : mapping
        As `tomllib` gives it.

    Returns
    -------
    Profile

    Raises
    ------
    ValueError
        If a key is missing, unknown, or has a value that does not fit; the message names it.
    """
    _known(document, ("align", "sign", "offset_sd_s", "slew_dps", "accel_dps2", "segment"), "")
    tables = document.get("segment")
    if not isinstance(tables, list) or not tables:
        raise ValueError("`segment` is missing: a profile has at least one [[segment]]")
    sign = document.get("sign", [1, 1, 1])
    if not isinstance(sign, list) or len(sign) != 3 or any(s not in (-1, 1) for s in sign):
        raise ValueError(f"`sign` is {sign}, not three of -1 and 1")
    offset_sd = _number(document, "offset_sd_s", "") if "offset_sd_s" in document else None
    if offset_sd is not None and offset_sd < 0.0:
        raise ValueError(f"`offset_sd_s` is {offset_sd:g}, not 0 or more")
    align = document.get("align", "none")
    limits = [
        math.radians(_number(document, key, "", positive=True)) if key in document else default
        for key, default in (("slew_dps", SLEW), ("accel_dps2", ACCEL))
    ]
    segments = tuple(_segment(table, f"segment {n}: ") for n, table in enumerate(tables, 1))
    return Profile(segments, (int(sign[0]), int(sign[1]), int(sign[2])), align, offset_sd, limits[0], limits[1])


def to_toml(profile: Profile) -> str:
    """Text of a TOML document that `from_document` reads as the same profile, to a billionth of a degree.

    Parameters
    ----------
    profile : Profile
        Without sampled angles, which belong into a CSV file.

    Returns
    -------
    str

    Raises
    ------
    ValueError
        If a segment is sampled.
    """
    head = [f'align = "{profile.align}"', f"sign = {list(profile.sign)}"]
    if profile.offset_sd is not None:
        head.append(f"offset_sd_s = {profile.offset_sd!r}")
    head += [f"slew_dps = {_degrees(profile.slew)!r}", f"accel_dps2 = {_degrees(profile.accel)!r}"]
    return "\n\n".join(["\n".join(head), *map(_segment_text, profile.segments)]) + "\n"


def _segment_text(segment: Segment) -> str:
    match segment:
        case Dwell():
            lines = ['kind = "dwell"', f"angles_deg = {[_degrees(angle) for angle in segment.angles]}"]
        case Rate():
            lines = ['kind = "rate"', f'axis = "{segment.axis}"', f"rate_dps = {_degrees(segment.rate)!r}"]
        case Sine():
            lines = ['kind = "sine"', f'axis = "{segment.axis}"', f"amplitude_deg = {_degrees(segment.amplitude)!r}"]
            lines.append(f"hz = {float(segment.hz)!r}")
        case Sampled():
            raise ValueError("`profile` has sampled angles: they belong into a CSV file")
    return "\n".join(["[[segment]]", *lines, f"seconds = {float(segment.seconds)!r}"])


def _degrees(radians: float) -> float:
    # what was written in degrees comes back as it was written
    return round(math.degrees(radians), 9)


_KEYS = {
    "dwell": ("angles_deg", "seconds"),
    "rate": ("axis", "rate_dps", "seconds"),
    "sine": ("axis", "amplitude_deg", "hz", "seconds"),
}


def _segment(table: Any, where: str) -> Segment:
    kind = table.get("kind") if isinstance(table, dict) else table
    if not isinstance(kind, str) or kind not in _KEYS:
        raise ValueError(f"{where}`kind` is {kind!r}, not one of: {', '.join(_KEYS)}")
    _known(table, ("kind", *_KEYS[kind]), where)
    seconds = _number(table, "seconds", where, positive=True)
    if kind == "dwell":
        angles = table.get("angles_deg")
        if not isinstance(angles, list) or len(angles) != 3 or not all(_is_number(a) for a in angles):
            raise ValueError(f"{where}`angles_deg` is {angles}, not three angles: [outer, middle, inner]")
        return Dwell((math.radians(angles[0]), math.radians(angles[1]), math.radians(angles[2])), seconds)
    axis = table.get("axis")
    if axis not in AXES:
        raise ValueError(f"{where}`axis` is {axis!r}, not one of: {', '.join(AXES)}")
    if kind == "rate":
        rate_dps = _number(table, "rate_dps", where)
        if rate_dps == 0.0:
            raise ValueError(f"{where}`rate_dps` is 0; a dwell rests")
        return Rate(axis, math.radians(rate_dps), seconds)
    amplitude = math.radians(_number(table, "amplitude_deg", where, positive=True))
    return Sine(axis, amplitude, _number(table, "hz", where, positive=True), seconds)


def _known(table: Mapping[str, Any], keys: Sequence[str], where: str) -> None:
    for key in table:
        if key not in keys:
            raise ValueError(f"{where}`{key}` is unknown; known here: {', '.join(keys)}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number(table: Mapping[str, Any], key: str, where: str, *, positive: bool = False) -> float:
    if key not in table:
        raise ValueError(f"{where}`{key}` is missing")
    value = table[key]
    if not _is_number(value) or (positive and not value > 0):
        raise ValueError(f"{where}`{key}` is {value!r}, not a {'positive' if positive else 'finite'} number")
    return float(value)


def _positive(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise ValueError(f"`{name}` is {value}, not a positive finite number")


def _axis_number(axis: str) -> int:
    if axis not in AXES:
        raise ValueError(f'`axis` is "{axis}", not one of: {", ".join(AXES)}')
    return AXES.index(axis)


def _each(function: Callable[[float], float], x: Array) -> Array:
    """`function` of each number by itself: what numpy returns may depend on where in an array a number stands."""
    return np.array([function(v) for v in x.tolist()], np.float64)


def _envelope(swing: _Swing, tau: Array) -> tuple[Array, Array]:
    """Envelope of a swing and its time derivative."""
    if swing.depth == 0.0:
        return np.full_like(tau, swing.mean), np.zeros_like(tau)
    half = 0.5 * swing.omega
    u = swing.mean + swing.depth * _each(math.cos, half * tau)
    return u, -swing.depth * half * _each(math.sin, half * tau)


# --------------------------------------------------------------------------------------------- from segments to pieces


def _planned(profile: Profile) -> _Plan:
    pieces: list[_Piece] = []
    first = profile.segments[0]
    at = np.zeros(3)
    if isinstance(first, Dwell):
        at = np.array(first.angles)
    elif isinstance(first, Sampled):
        at = np.array(first.angles[0])
    turns = np.zeros(3)  # what is added to a dwell's angles: whole turns made by rate segments
    has_turned = np.zeros(3, bool)
    for number, segment in enumerate(profile.segments):
        if isinstance(segment, Dwell | Sampled):
            to = np.array(segment.angles if isinstance(segment, Dwell) else segment.angles[0])
            turns = np.where(has_turned, 2.0 * np.pi * np.round((at - to) / (2.0 * np.pi)), turns)
            has_turned[:] = False
            pieces += _move(at, to + turns, number, profile)
            at = to + turns
        match segment:
            case Dwell():
                pieces.append(_rest(at, number, segment.seconds))
            case Rate():
                axis = _axis_number(segment.axis)
                pieces += _turn(at, axis, segment, number, profile.accel)
                at = at.copy()
                at[axis] += segment.rate * (abs(segment.rate) / profile.accel + segment.seconds)
                has_turned[axis] = True
            case Sine():
                pieces += _swings(at, segment, number)
            case Sampled():
                pieces += _cubics(segment, turns, number)
                at = np.array(segment.angles[-1]) + turns
    pieces.append(_rest(at, len(profile.segments) - 1, math.inf))
    return _Plan(
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


def _rest(at: Array, number: int, seconds: float) -> _Piece:
    return _Piece(seconds, _cubic(at), number, rests=True)


def _move(at: Array, to: Array, number: int, profile: Profile) -> list[_Piece]:
    distance = float(np.abs(to - at).max())
    if distance <= _SAME_ANGLE:
        return []
    ramp = min(profile.slew / profile.accel, math.sqrt(distance / profile.accel))
    peak = profile.accel * ramp
    return _trapezoid(at, (to - at) / distance * peak, ramp, distance / peak - ramp, number)


def _turn(at: Array, axis: int, segment: Rate, number: int, accel: float) -> list[_Piece]:
    rate = np.zeros(3)
    rate[axis] = segment.rate
    return _trapezoid(at, rate, abs(segment.rate) / accel, segment.seconds, number)


def _trapezoid(at: Array, rate: Array, ramp: float, cruise: float, number: int) -> list[_Piece]:
    """From rest to `rate` in `ramp` seconds, on for `cruise` seconds, and back to rest in `ramp` seconds."""
    accel = rate / ramp
    cruising = at + 0.5 * ramp * rate
    braking = cruising + cruise * rate
    pieces = [_Piece(ramp, _cubic(at, np.zeros(3), 0.5 * accel), number)]
    if cruise > 1e-9:
        pieces.append(_Piece(cruise, _cubic(cruising, rate), number))
    return [*pieces, _Piece(ramp, _cubic(braking, rate, -0.5 * accel), number)]


def _swings(at: Array, segment: Sine, number: int) -> list[_Piece]:
    axis, omega, period = _axis_number(segment.axis), 2.0 * math.pi * segment.hz, 1.0 / segment.hz
    stretches = (
        (period, 0.0, 0.5, -0.5),  # seconds, elapsed, mean and depth of the envelope
        (segment.seconds, period, 1.0, 0.0),
        (period, period + segment.seconds, 0.5, 0.5),
    )
    return [
        _Piece(seconds, _cubic(at), number, swing=_Swing(axis, segment.amplitude, omega, elapsed, mean, depth))
        for seconds, elapsed, mean, depth in stretches
    ]


def _cubics(segment: Sampled, turns: Array, number: int) -> list[_Piece]:
    # here, since it would double the start-up time of every command that runs a filter
    from scipy import interpolate

    t, angles = np.array(segment.t), np.array(segment.angles) + turns
    c = interpolate.PchipInterpolator(t, angles, axis=0).c  # (4, N - 1, 3), descending powers
    rests = (np.abs(np.diff(angles, axis=0)).max(axis=1) < _REST_RATE * np.diff(t)).tolist()
    return [_Piece(seconds, c[::-1, n], number, rests=rests[n]) for n, seconds in enumerate(np.diff(t).tolist())]
