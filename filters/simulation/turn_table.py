"""A turn table that is told what to do while it turns, and what a unit on it feels: not what its encoders say.

Each axis has a reference that keeps the limits of rate and acceleration, and follows it through two equal first-order
lags. These have positive responses of unit area, so that rate, acceleration and jerk of the axis stay within those of
the reference, and it comes to rest without overshoot. Its jerk is at most 2 · acceleration / (e · lag).

The true attitude is C_nb = Rx(o) exp(w_o) exp(n_m) Ry(m) exp(w_m) exp(n_i) Rz(i) exp(w_i): n are the constant angles by
which axes are not at right angles, w the wobble of an axis, a small rotation across it that goes round once a turn.
Encoders read the angle about their own axis, with a constant error and noise.

No clock: whoever has one says how late it is. Left out: the controller's language (`imutui.table`).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from filters import attitude
from filters.channels import DPS
from filters.errors import InputError
from filters.motion.kinematics import attitudes
from filters.motion.segments import AXES, axis_number
from filters.types import Array

STEP_S = 0.002
"""Of the grid on which commands take effect; between its points angles are cubics."""

_KEPT = 2**15  # grid points: a minute
_HALF_STEP_S = 1e-4  # of the difference quotient that the body's angular rate is
_SETTLED = 1e-9  # rad: below it an axis is where it was told to be
_ARC_MINUTE = math.radians(1.0 / 60.0)
_NUMBER = {axis: number for number, axis in enumerate(AXES)}


@dataclass(frozen=True, slots=True)
class TableModel:
    """A table. What is not known of it beforehand is drawn from the seed with these standard deviations."""

    axes: tuple[str, ...] = AXES
    seed: int = 0
    rate: float = 400.0 * DPS  # most, of each axis, rad/s
    accel: float = 500.0 * DPS  # most, of each axis, rad/s²
    jerk: float = 20_000.0 * DPS  # most, of each axis, rad/s³
    low: float | None = None  # low, high: ends of the outer and the middle axis, rad; None: they turn without end
    high: float | None = None
    lag: float = 0.03  # of each of the two lags, s, or more where the jerk asks for it
    encoder_noise: float = 1e-4 * DPS  # of a reading, rad
    rate_noise: float = 1e-3 * DPS  # of a reading, rad/s
    encoder_offset_sd: float = 3e-3 * DPS  # rad
    orthogonality_sd: float = 1.0 * _ARC_MINUTE  # rad
    wobble_sd: float = 0.1 * _ARC_MINUTE  # rad

    def __post_init__(self) -> None:
        if not self.axes or len(set(self.axes)) != len(self.axes):
            raise InputError(f"`axes` is {list(self.axes)}, not some of {', '.join(AXES)}, each once")
        for axis in self.axes:
            axis_number(axis)
        if not all(0.0 < value < math.inf for value in (self.rate, self.accel, self.jerk, self.lag)):
            raise InputError(f"limits and lag are {self.rate}, {self.accel}, {self.jerk}, {self.lag}, not all positive")
        if (self.low is None) is not (self.high is None) or (
            self.low is not None and self.high is not None and not self.low < 0.0 < self.high
        ):
            raise InputError(f"`low` and `high` are {self.low} and {self.high}, not an angle below 0 and one above it")

    def ends(self, axis: str) -> tuple[float, float]:
        """Angles beyond which an axis can't go, rad; infinite where it turns without end."""
        if self.low is None or self.high is None or axis == "inner":
            return -math.inf, math.inf
        return self.low, self.high


@dataclass(slots=True)
class Axis:
    """An axis and its drive: what it is told, and where it is, rad and seconds."""

    low: float
    high: float
    lag: float
    rate_limit: float
    accel_limit: float
    brake: float  # deceleration of an axis whose drive is off, rad/s²
    mode: str = "off"  # "off", "position", "rate", "oscillation"
    demand: float = 0.0  # angle or rate that the mode leads to
    amplitude: float = 0.0  # amplitude, omega, phase: of an oscillation
    omega: float = 0.0
    phase: float = 0.0
    is_stuck: bool = False
    angle: float = 0.0
    rate: float = 0.0
    _reference: float = 0.0
    _reference_rate: float = 0.0
    _between: float = 0.0  # behind the first lag
    _centre: float | None = None  # of the oscillation, once the axis has come to rest for it
    _swing: float = 0.0  # present amplitude
    _swing_slew: float = 0.0  # by which it comes and goes
    _swing_t: float = 0.0

    def enter(self, mode: str) -> None:
        """Go over to another mode, from where the axis is and as fast as it turns."""
        if mode != self.mode:
            self._centre, self._swing, self._swing_t = None, 0.0, 0.0
        self.mode = mode

    @property
    def is_idle(self) -> bool:
        """Whether it rests where it is told to be, and nothing changes."""
        if self.is_stuck:
            return self.rate == 0.0
        aims = self._reference_rate == 0.0 and {
            "off": True, "position": self.demand == self._reference, "rate": self.demand == 0.0,
            "oscillation": self.amplitude == 0.0 and self._swing == 0.0,
        }[self.mode]  # fmt: skip
        return aims and self.rate == 0.0 and self.angle == self._reference

    def step(self) -> None:
        """Go on by a step of the grid."""
        if self.is_stuck:
            self.rate, self._between = 0.0, self.angle
            self._reference, self._reference_rate = self.angle, 0.0
            return
        before = self._reference
        match self.mode:
            case "position":
                self._towards(min(max(self.demand, self.low), self.high))
            case "oscillation" if self._centre is not None or self._reference_rate == 0.0:
                self._swing_on()
            case "rate":
                self._at_rate(self.demand, self.accel_limit)
            case _:
                self._at_rate(0.0, self.brake)
        if not self.low <= self._reference <= self.high:  # the stop at its end
            self._reference, self._reference_rate = min(max(self._reference, self.low), self.high), 0.0
        self._follow(before)

    def _at_rate(self, rate: float, accel: float) -> None:
        rate = min(max(rate, -self.rate_limit), self.rate_limit)
        most = accel * STEP_S
        after = self._reference_rate + min(max(rate - self._reference_rate, -most), most)
        self._reference += 0.5 * (self._reference_rate + after) * STEP_S
        self._reference_rate = after

    def _towards(self, to: float) -> None:
        """Along a trapezoid of rate: as fast as the limit allows, and as allows to stop there."""
        left, most = to - self._reference, self.accel_limit * STEP_S
        if abs(left) <= most * STEP_S and abs(self._reference_rate) <= 2.0 * most:
            self._reference, self._reference_rate = to, 0.0
            return
        # of steps of constant acceleration that end at rest there
        stopping = most * (math.sqrt(0.25 + 2.0 * abs(left) / (most * STEP_S)) - 0.5)
        self._at_rate(math.copysign(min(self.rate_limit, stopping), left), self.accel_limit)

    def _swing_on(self) -> None:
        """An oscillation whose amplitude comes and goes within a period."""
        centre = self._reference if self._centre is None else self._centre
        self._centre = centre
        self._swing_t += STEP_S
        if self.amplitude:
            self._swing_slew = self.amplitude * self.omega / (2.0 * math.pi) * STEP_S
        self._swing += min(max(self.amplitude - self._swing, -self._swing_slew), self._swing_slew)
        at = centre + self._swing * math.sin(self.omega * self._swing_t + self.phase)
        self._reference_rate = 0.0 if self._swing == 0.0 else (at - self._reference) / STEP_S
        self._reference = at

    def _follow(self, before: float) -> None:
        """Both lags over a step in which their input is a straight line."""
        keep = math.exp(-STEP_S / self.lag)
        slope = (self._reference - before) / STEP_S
        ramp = STEP_S - self.lag * (1.0 - keep)
        between = self._between * keep + before * (1.0 - keep) + slope * ramp
        slope = (between - self._between) / STEP_S
        angle = self.angle * keep + self._between * (1.0 - keep) + slope * ramp
        self._between, self.angle, self.rate = between, angle, (between - angle) / self.lag
        if self._reference_rate == 0.0 and max(abs(self._reference - angle), abs(self._reference - between)) < _SETTLED:
            self._between = self.angle = self._reference
            self.rate = 0.0


@dataclass(frozen=True, slots=True)
class _Imperfections:
    """What a table is not as it should be, in the order of AXES."""

    offsets: Array  # of the encoders, rad, (3,)
    crooked: Array  # exp(n) of the middle and the inner axis, (2, 3, 3)
    wobble: Array  # rad, (3,)
    wobble_phase: Array  # (3,)

    @classmethod
    def drawn(cls, model: TableModel) -> "_Imperfections":
        rng = np.random.default_rng([model.seed, 5])
        here = np.array([axis in model.axes for axis in AXES], np.float64)
        offsets = rng.standard_normal(3) * model.encoder_offset_sd * here
        middle, inner = rng.standard_normal(2) * model.orthogonality_sd * here[1:] * here[:2]
        crooked = attitude.exp(np.array([[0.0, 0.0, middle], [inner, 0.0, 0.0]]))
        wobble = np.abs(rng.standard_normal(3)) * model.wobble_sd * here
        return cls(offsets, crooked, wobble, rng.uniform(0.0, 2.0 * math.pi, 3))


@dataclass(slots=True)
class _Past:
    """Angles and rates of the axes on the grid, as far back as they are kept."""

    angles: Array = field(default_factory=lambda: np.zeros((_KEPT, 3)))
    rates: Array = field(default_factory=lambda: np.zeros((_KEPT, 3)))
    newest: int = 0

    def located(self, t: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Angles and rates at both ends of the step that a time is in, and the part of the step that has passed."""
        step = np.floor(t / STEP_S).astype(int)
        step = np.clip(step, max(0, self.newest - _KEPT + 1), max(0, self.newest - 1))
        part = t / STEP_S - step
        part = np.where(t < 0.0, 0.0, part)[:, None]
        a, b = step % _KEPT, (step + 1) % _KEPT
        return self.angles[a], self.angles[b], self.rates[a], self.rates[b], part

    def at(self, axis: int, t: float) -> tuple[float, float]:
        """Angle and rate of an axis at a time."""
        step = min(max(math.floor(t / STEP_S), 0, self.newest - _KEPT + 1), max(0, self.newest - 1))
        x, a, b = t / STEP_S - step, step % _KEPT, (step + 1) % _KEPT
        begin, end = float(self.angles[a, axis]), float(self.angles[b, axis])
        rate_a, rate_b = float(self.rates[a, axis]), float(self.rates[b, axis])
        way = (rate_a * (1.0 - x) - rate_b * x) * x * (1.0 - x) * STEP_S
        rate = rate_a * (1.0 - x) * (1.0 - 3.0 * x) - rate_b * x * (2.0 - 3.0 * x)
        rate += (end - begin) * 6.0 * x * (1.0 - x) / STEP_S
        return begin + (end - begin) * x * x * (3.0 - 2.0 * x) + way, rate


class TurnTable:
    """A table at rest at zero at its time 0.

    What it did can be asked for up to `now`, and a minute back; commands are for `axes`, and act from `now` on.
    """

    def __init__(self, model: TableModel) -> None:
        self.model = model
        self.axes = {axis: self._made(axis) for axis in model.axes}
        self._is_not = _Imperfections.drawn(model)
        self._rng = np.random.default_rng([model.seed, 6])
        self._past = _Past()

    def _made(self, axis: str) -> Axis:
        model = self.model
        low, high = model.ends(axis)
        lag = max(model.lag, 2.0 * model.accel / (math.e * model.jerk))
        return Axis(low, high, lag, model.rate, model.accel, brake=0.5 * model.accel)

    @property
    def now(self) -> float:
        """Until when what it does is known, s."""
        return self._past.newest * STEP_S

    def advance(self, t: float) -> None:
        """Go on to a time, or to just after it."""
        past, last = self._past, math.ceil(t / STEP_S - 1e-9)
        while past.newest < last:
            if all(axis.is_idle for axis in self.axes.values()):
                self._rest(last)
                return
            for axis in self.axes.values():
                axis.step()
            past.newest += 1
            row = past.newest % _KEPT
            for name, axis in self.axes.items():
                past.angles[row, _NUMBER[name]], past.rates[row, _NUMBER[name]] = axis.angle, axis.rate

    def _rest(self, last: int) -> None:
        past = self._past
        count = min(last - past.newest, _KEPT - 1)
        rows = np.arange(last - count, last + 1) % _KEPT
        past.angles[rows] = past.angles[past.newest % _KEPT]
        past.rates[rows] = 0.0
        past.newest = last

    def encoder(self, axis: str, t: float) -> tuple[float, float]:
        """Angle and rate of an axis as it is read at a time up to `now`, with noise, rad and rad/s."""
        noise = self._rng.standard_normal(2)
        angle, rate = self._past.at(_NUMBER[axis], t)
        angle += self.encoder_offset(axis) + self.model.encoder_noise * float(noise[0])
        return angle, rate + self.model.rate_noise * float(noise[1])

    def encoder_offset(self, axis: str) -> float:
        """What an axis's encoder reads too much, rad."""
        return float(self._is_not.offsets[_NUMBER[axis]])

    def angles(self, t: Array) -> Array:
        """True angles about outer, middle and inner axis, rad, shape (N, 3)."""
        a, b, rate_a, rate_b, x = self._past.located(t)
        ends, slopes = a + (b - a) * x * x * (3.0 - 2.0 * x), (rate_a * (1.0 - x) - rate_b * x) * x * (1.0 - x)
        return ends + slopes * STEP_S

    def rates(self, t: Array) -> Array:
        """Their derivatives, rad/s, shape (N, 3)."""
        a, b, rate_a, rate_b, x = self._past.located(t)
        ends = (b - a) * 6.0 * x * (1.0 - x) / STEP_S
        return ends + rate_a * (1.0 - x) * (1.0 - 3.0 * x) - rate_b * x * (2.0 - 3.0 * x)

    def pose(self, t: Array) -> tuple[Array, Array]:
        """True attitude C_nb, shape (N, 3, 3), and angular rate in body axes, rad/s, shape (N, 3)."""
        instants = np.concatenate([t, t - _HALF_STEP_S, t + _HALF_STEP_S])
        C, before, after = np.split(self._attitudes(instants), 3)
        return C, attitude.log(np.einsum("nji,njk->nik", before, after)) / (2.0 * _HALF_STEP_S)

    def _attitudes(self, t: Array) -> Array:
        angles = self.angles(t)
        no = np.zeros(len(t))
        C: Array | None = None
        for number, before in enumerate((None, *self._is_not.crooked)):
            alone = [no, no, no]
            alone[number] = angles[:, number]
            turned = attitudes(np.stack(alone, axis=-1))
            if self._is_not.wobble[number]:
                turned = turned @ self._wobble(number, angles[:, number])
            C = turned if C is None or before is None else C @ before @ turned
        assert C is not None
        return C

    def _wobble(self, number: int, angle: Array) -> Array:
        phase = angle + self._is_not.wobble_phase[number]
        across = [np.cos(phase), np.sin(phase)]
        across.insert(number, np.zeros_like(phase))
        return attitude.exp(self._is_not.wobble[number] * np.stack(across, axis=-1))


@dataclass(frozen=True, slots=True)
class OnTable:
    """The motion of a unit on a table, on the unit's own time; a motion that is not known ahead."""

    table: TurnTable
    at: Callable[[Array], Array]  # times of the table at times of the unit, s
    known: Callable[[], float]  # until when of the unit's time the motion is known, s; it has the table go on

    def angles(self, t: Array) -> Array:
        """As `TurnTable.angles`."""
        return self.table.angles(self.at(t))

    def rates(self, t: Array) -> Array:
        """As `TurnTable.rates`."""
        return self.table.rates(self.at(t))

    def pose(self, t: Array) -> tuple[Array, Array]:
        """As `TurnTable.pose`."""
        return self.table.pose(self.at(t))
