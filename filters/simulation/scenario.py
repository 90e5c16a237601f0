"""What is simulated, as records: a unit and its biases, its power-ons, temperature, motion, effects, faults."""

import itertools
import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from filters.errors import InputError
from filters.imu import IMU400CD_200, AxisMap, ImuSpec
from filters.motion.profile import Profile
from filters.motion.segments import axis_number
from filters.simulation.catalogue import Effect
from filters.simulation.turn_table import TableModel
from filters.state import PAPER_SITE, Site
from filters.types import Array

_WARM_UP_KELVIN = 6.0
_WARM_UP_SECONDS = 600.0
_ROOM_DEGC = 24.0

FAULT_KINDS = {
    "drop_bytes": "count",
    "garbage": "count",
    "bit_flips": "count",
    "silence": "seconds",
}
"""Kinds of fault on the wire, and the measure of each."""

TABLE_FAULT_KINDS = {
    "interlock": (),
    "limit": ("axis",),
    "stuck": ("axis", "seconds"),
    "silent": ("seconds",),
    "cut": ("seconds",),
    "slow": ("seconds", "delay"),
    "unrecognised": ("count",),
}
"""Kinds of fault of a table and its controller, and what else is said of each."""

_VERSION_CHARACTERS = 30
_MOST_SKEW_PPM = 1e5

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Truth:
    """Constant biases of one unit, body axes."""

    # accel_bias, gyro_bias: m/s² and rad/s, shape (3,)
    accel_bias: Array
    gyro_bias: Array


def draw(seed: int, spec: ImuSpec = IMU400CD_200) -> Truth:
    """Biases of a unit: uniform within the specification's limits.

    `seed`: equal seeds give equal units.
    `spec`: limits.
    """
    rng = np.random.default_rng([seed, 0])
    return Truth(rng.uniform(-1, 1, 3) * spec.accel_bias_limit, rng.uniform(-1, 1, 3) * spec.gyro_bias_limit)


@dataclass(frozen=True, slots=True)
class Temperature:
    """Temperature inside the case since power-on."""

    # s and degC, times increasing; straight lines between them, constant before and after. Without any it warms up by
    # itself: 24 degC + 6 K (1 - exp(-t / 600 s)).
    points: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        t = [point[0] for point in self.points]
        if not all(math.isfinite(number) for point in self.points for number in point):
            raise InputError(f"`points` is {list(self.points)}, not all finite")
        if any(b <= a for a, b in itertools.pairwise(t)):
            raise InputError(f"`points` is {list(self.points)}: times do not increase")

    def at(self, t: Array) -> Array:
        """Temperature, degC, shape (N,)."""
        if not self.points:
            return _ROOM_DEGC - _WARM_UP_KELVIN * np.expm1(-t / _WARM_UP_SECONDS)
        times, values = np.array(self.points).T
        return np.asarray(np.interp(t, times, values))

    def rate(self, t: Array) -> Array:
        """Its time derivative, K/s, shape (N,); at a corner that of what follows."""
        if not self.points:
            return _WARM_UP_KELVIN / _WARM_UP_SECONDS * np.exp(-t / _WARM_UP_SECONDS)
        times, values = np.array(self.points).T
        slopes = np.concatenate([[0.0], np.diff(values) / np.diff(times), [0.0]])
        return slopes[np.searchsorted(times, t, side="right")]


@dataclass(frozen=True, slots=True)
class PowerOn:
    """What differs at one power-on."""

    seed: int | None = None  # of noise and of random effects, instead of the scenario's
    temperature: Temperature | None = None  # instead of the scenario's
    # accel_bias, gyro_bias: instead of the scenario's, instrument axes, m/s² and rad/s; nothing from run to run is
    # added to them
    accel_bias: Triple | None = None
    gyro_bias: Triple | None = None


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault on the wire."""

    at: float  # since the first request for data, s
    # "drop_bytes": the next `count` bytes are lost. "garbage": `count` random bytes in between. "bit_flips": one bit in
    # each of the next `count` messages. "silence": nothing arrives for `seconds`, and what was sent is lost.
    kind: str
    count: int = 0
    seconds: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in FAULT_KINDS:
            raise InputError(f'`kind` is "{self.kind}", not one of: {", ".join(FAULT_KINDS)}')
        if not 0.0 <= self.at < math.inf:
            raise InputError(f"`at` is {self.at}, not a time from 0 on")
        amount = self.count if FAULT_KINDS[self.kind] == "count" else self.seconds
        if not 0.0 < amount < math.inf:
            raise InputError(f"`{FAULT_KINDS[self.kind]}` is {amount} for {self.kind}, not positive")


@dataclass(frozen=True, slots=True)
class TableFault:
    """A fault of a table under command, or of the link to its controller."""

    at: float  # since the table is there, s
    # "interlock": it opens, and is at fault until it is reset. "limit": the end switch of `axis` does that. "stuck":
    # `axis` does not move. "silent": nothing is answered. "cut": there is no link, and connections end. "slow": answers
    # are late by `delay`. "unrecognised": the next `count` lines are not understood
    kind: str
    axis: str = "inner"
    seconds: float = math.inf  # for how long
    delay: float = 0.0  # s
    count: int = 1

    def __post_init__(self) -> None:
        if self.kind not in TABLE_FAULT_KINDS:
            raise InputError(f'`kind` is "{self.kind}", not one of: {", ".join(TABLE_FAULT_KINDS)}')
        axis_number(self.axis)
        if not (0.0 <= self.at < math.inf and self.seconds > 0.0 and 0.0 <= self.delay < math.inf and self.count > 0):
            raise InputError(
                f"`at`, `seconds`, `delay` and `count` of {self.kind} are {self.at}, {self.seconds},"
                f" {self.delay} and {self.count}: from 0 on, and seconds and count positive"
            )


@dataclass(frozen=True, slots=True)
class Personality:
    """Behaviour of a unit on a wire, all the time."""

    version: str | None = None  # its version text, instead of the usual one
    version_plain_text: bool = False  # True if that comes without header and checksum
    # effect of a ping besides its answer: none; it ends the stream; it does what power-up does
    ping: Literal["keeps", "stops", "resets"] = "stops"
    clock_skew_ppm: float = 0.0  # how much faster than the host's clock the unit's runs, millionths

    def __post_init__(self) -> None:
        if self.version is not None and not (self.version.isascii() and len(self.version) <= _VERSION_CHARACTERS):
            raise InputError(f"`version` is {self.version!r}, not at most {_VERSION_CHARACTERS} ASCII characters")
        if not abs(self.clock_skew_ppm) <= _MOST_SKEW_PPM:
            raise InputError(f"`clock_skew_ppm` is {self.clock_skew_ppm}, not within ±{_MOST_SKEW_PPM:g}")


@dataclass(frozen=True)
class Scenario:
    """A unit, what is done with it, and what is wrong with it."""

    seed: int = 0  # of all that is drawn
    # noise densities and bandwidths (0: no limit); bias limits, within which biases are drawn
    spec: ImuSpec = IMU400CD_200
    # accel_bias, gyro_bias: instrument axes and sign, m/s² and rad/s; drawn from the seed if None
    accel_bias: Triple | None = None
    gyro_bias: Triple | None = None
    # accel_bias_run_sd, gyro_bias_run_sd: standard deviations of what comes to the biases at each power-on
    accel_bias_run_sd: float = 0.0
    gyro_bias_run_sd: float = 0.0
    temperature: Temperature = Temperature()  # since power-on
    profile: Profile | None = None  # motion of the table from power-on; level and still without
    effects: tuple[Effect, ...] = ()
    power_ons: tuple[PowerOn, ...] = (PowerOn(),)  # at least one
    faults: tuple[Fault, ...] = ()
    personality: Personality = Personality()
    # table, table_faults: of the table under command that it stands on, where there is one
    table: TableModel = field(default_factory=TableModel)
    table_faults: tuple[TableFault, ...] = ()
    site: Site = PAPER_SITE
    axes: AxisMap = field(default_factory=AxisMap)  # sign of the accelerometers, mounting on the table

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InputError(f"`seed` is {self.seed}, negative")
        if not self.power_ons:
            raise InputError("`power_ons` is empty: there is at least one")
        for name in ("accel_bias_run_sd", "gyro_bias_run_sd"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise InputError(f"`{name}` is {getattr(self, name)}, not a finite number from 0 on")
