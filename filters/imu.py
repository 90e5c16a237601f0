"""The sensor: its samples, its specification (the paper's Table 1), its axes and signs. Leaves out counts and bytes."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from filters.channels import CHANNELS as CHANNELS
from filters.channels import STANDARD_GRAVITY as STANDARD_GRAVITY
from filters.errors import InputError
from filters.specification import IMU400CD_200 as IMU400CD_200
from filters.specification import IMU440CA_200 as IMU440CA_200
from filters.specification import ImuSpec as ImuSpec
from filters.types import Array

LOOP_HZ = 400.0 / 3.0  # readings a second of the IMU400CD's own loop: "up to 133 Hz" in scaled mode, one in 7.5 ms

_Turn = tuple[NDArray[np.int_], Array]


@dataclass(frozen=True, slots=True)
class Samples:
    """A stretch of IMU output in body axes."""

    t: Array  # time since the first sample, s, shape (N,), increasing
    gyro: Array  # angular rate, rad/s, shape (N, 3)
    accel: Array  # specific force, m/s², shape (N, 3)


_Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Noise:
    """Process noise of the filter, per body axis; see `filters.kalman.spkf.process_noise`."""

    accel_vrw: _Triple  # white noise, m/s/√s
    gyro_arw: _Triple  # white noise, rad/√s
    accel_walk: _Triple = (0.0, 0.0, 0.0)  # random walk of the bias, m/s²/√s
    gyro_walk: _Triple = (0.0, 0.0, 0.0)  # random walk of the bias, rad/s/√s

    @classmethod
    def of(cls, spec: ImuSpec) -> "Noise":
        """The paper's noise set: the specification's white noise, constant biases."""
        return cls((spec.accel_vrw,) * 3, (spec.gyro_arw,) * 3)


@dataclass(frozen=True, slots=True)
class AxisMap:
    """Between the instrument's own axes and sign, and body axes; the one place that knows both.

    Raises InputError if `mount` is no signed permutation, if rates would come out left-handed, or a sign is not ±1.
    """

    # M, signed permutation (3, 3) from instrument to body axes, of gyro and accelerometer alike
    mount: Array = field(default_factory=lambda: np.eye(3))
    # s: -1 for a unit that reads +1 g on Z when level with Z down, +1 for one that reads specific force
    accel_sign: int = -1
    # signs of the three gyro readings in the instrument's axes, shape (3,), where the wiring flipped some
    gyro_sign: Array = field(default_factory=lambda: np.ones(3))
    _to_body: _Turn = field(init=False, repr=False, compare=False)
    _to_instrument: _Turn = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.accel_sign not in (-1, 1):
            raise InputError(f"`accel_sign` is {self.accel_sign}, not -1 or +1")
        if self.gyro_sign.shape != (3,) or not np.all(np.abs(self.gyro_sign) == 1.0):
            raise InputError(f"`gyro_sign` is {self.gyro_sign}, not three of -1 and 1")
        M = self.mount
        if M.shape != (3, 3) or not np.array_equal(M @ M.T, np.eye(3)) or not np.all(np.isin(M, (-1.0, 0.0, 1.0))):
            raise InputError(f"`mount` is {M.tolist()}, not a signed permutation of the axes")
        if np.linalg.det(M) < 0.0 and np.all(self.gyro_sign == 1.0):
            raise InputError("`mount` turns right-handed axes into left-handed ones: swap two axes, or flip a sign")
        # worked out once: a reading at a time is turned hundreds of times a second
        object.__setattr__(self, "_to_body", _turn(M))
        object.__setattr__(self, "_to_instrument", _turn(M.T))

    def gyro_to_body(self, rate: Array) -> Array:
        """Angular rate in body axes, M · diag(gyro_sign) · reading; shape (..., 3) in and out."""
        return _turned(rate * self.gyro_sign, self._to_body)

    def accel_to_body(self, reading: Array) -> Array:
        """Specific force in body axes, f = s · M · reading; shape (..., 3) in and out."""
        return np.asarray(self.accel_sign * _turned(reading, self._to_body))

    def gyro_to_instrument(self, rate: Array) -> Array:
        """Rate or gyro bias in the instrument's axes, diag(gyro_sign) · Mᵀ · rate; shape (..., 3) in and out."""
        return np.asarray(_turned(rate, self._to_instrument) * self.gyro_sign)

    def accel_to_instrument(self, force: Array) -> Array:
        """Specific force or its bias as the instrument shows it, s · Mᵀ · force; shape (..., 3) in and out."""
        return np.asarray(self.accel_sign * _turned(force, self._to_instrument))

    def sd_to_instrument(self, sd: Array) -> Array:
        """Standard deviations of a body vector, reordered to the instrument's axes; shape (..., 3) in and out."""
        return _turned(sd, (self._to_instrument[0], np.ones(3)))


def _turn(M: Array) -> _Turn:
    """Which axis each axis is taken from, and its sign, of a signed permutation; shapes (3,)."""
    axis = np.abs(M).argmax(axis=1)
    return axis, M[np.arange(3), axis]


def _turned(v: Array, turn: _Turn) -> Array:
    """M v for a signed permutation, shape (..., 3); an axis that is NaN stays the only one."""
    axis, sign = turn
    # adding zero leaves no negative zero, as the sum of a product of matrices does
    return np.asarray(v[..., axis] * sign + 0.0)


def parse_mount(text: str) -> Array:
    """Signed permutation from a mounting written as body x, y, z in instrument axes, such as "x,-y,-z".

    `text`: three of x, y, z, each once, each with an optional sign, separated by commas.
    Returns M, shape (3, 3): ``v_body = M @ v_instrument``.
    Raises InputError if `text` does not read so.
    """
    names = [part.strip() for part in text.split(",")]
    M = np.zeros((3, 3))
    bare = [name.lstrip("+-") for name in names]
    if sorted(bare) != ["x", "y", "z"] or any(len(name) - len(b) > 1 for name, b in zip(names, bare, strict=True)):
        raise InputError(f'`mount` is "{text}", not three of x, y, z with signs such as "x,-y,-z"')
    for row, (name, b) in enumerate(zip(names, bare, strict=True)):
        M[row, "xyz".index(b)] = -1.0 if name.startswith("-") else 1.0
    return M


def format_mount(M: Array) -> str:
    """Text of a signed permutation, the inverse of `parse_mount`."""
    return ",".join(("-" if row[column] < 0 else "") + "xyz"[column] for row in M for column in np.flatnonzero(row))
