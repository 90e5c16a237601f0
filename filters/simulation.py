"""A still unit with known truth, for the virtual instrument and for tests; nothing from here is ever called measured.

Truth first (`draw`), then readings: reference plus bias plus white noise of the specification's density, band-limited
by a first-order filter at the specification's bandwidth. Quantisation is the instrument's (counts), not done here.
"""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from filters import reference as references
from filters.imu import IMU400CD_200, ImuSpec, Samples
from filters.state import PAPER_SITE, Site
from filters.types import Array

_BLOCK = 1024
_WARM_UP_KELVIN = 6.0
_WARM_UP_SECONDS = 600.0
_ROOM_DEGC = 24.0


@dataclass(frozen=True, slots=True)
class Truth:
    """Constant biases of one unit, body axes.

    Attributes
    ----------
    accel_bias, gyro_bias : Array
        m/s² and rad/s, shape (3,).
    """

    accel_bias: Array
    gyro_bias: Array


def draw(seed: int, spec: ImuSpec = IMU400CD_200) -> Truth:
    """Biases of a unit: uniform within the specification's limits.

    Parameters
    ----------
    seed : int
        Equal seeds give equal units.
    spec : ImuSpec
        Limits.

    Returns
    -------
    Truth
    """
    rng = np.random.default_rng([seed, 0])
    return Truth(rng.uniform(-1, 1, 3) * spec.accel_bias_limit, rng.uniform(-1, 1, 3) * spec.gyro_bias_limit)


class StillUnit:
    """Readings of a still, level unit, one after the other, in body axes.

    Parameters
    ----------
    seed : int
        Of biases and noise.
    rate_hz : float
        Readings a second of unit time.
    site : Site
        Where it stands.
    spec : ImuSpec
        Noise densities, bandwidths, bias limits.
    """

    def __init__(self, seed: int, rate_hz: float, site: Site = PAPER_SITE, spec: ImuSpec = IMU400CD_200) -> None:
        self.truth = draw(seed, spec)
        self.rate_hz = rate_hz
        rate, force = references.level(site).rates_and_forces()
        self._mean = np.concatenate([rate + self.truth.gyro_bias, force + self.truth.accel_bias])
        self._white_sd = np.repeat([spec.gyro_arw, spec.accel_vrw], 3) * np.sqrt(rate_hz)
        bandwidth = np.array([spec.gyro_bandwidth, spec.accel_bandwidth])
        self._pole = np.exp(-2.0 * np.pi * bandwidth / rate_hz)
        self._rng = np.random.default_rng([seed, 1])
        self._memory = np.zeros((1, 6))
        self._start = 0
        self._block = self._next_block()

    def reading(self, k: int) -> tuple[Array, Array]:
        """Rate (rad/s) and specific force (m/s²) of reading k, body axes, shape (3,); k must not go back a block."""
        if k < self._start:
            raise ValueError(f"`k` is {k}: readings before {self._start} are gone")
        while k >= self._start + _BLOCK:
            self._start += _BLOCK
            self._block = self._next_block()
        values = self._mean + self._block[k - self._start]
        return values[:3], values[3:]

    def temperature_degc(self, k: int) -> float:
        """Temperature inside the case at reading k, degC: it warms up after power-on; the biases do not follow it."""
        t = k / self.rate_hz
        return _ROOM_DEGC + _WARM_UP_KELVIN * float(-np.expm1(-t / _WARM_UP_SECONDS))

    def samples(self, count: int) -> Samples:
        """The next `count` readings from 0 as arrays; uses the unit up."""
        values = [np.concatenate(self.reading(k)) for k in range(count)]
        stacked = np.array(values)
        return Samples(np.arange(count) / self.rate_hz, stacked[:, :3], stacked[:, 3:])

    def _next_block(self) -> Array:
        white = self._rng.standard_normal((_BLOCK, 6)) * self._white_sd
        out: Array = np.empty_like(white)
        for part, pole in zip((slice(0, 3), slice(3, 6)), self._pole, strict=True):
            # unit gain at zero frequency: the density that a filter integrates is the specification's
            out[:, part], self._memory[:, part] = signal.lfilter(
                [1.0 - pole], [1.0, -pole], white[:, part], axis=0, zi=self._memory[:, part]
            )
        return out
