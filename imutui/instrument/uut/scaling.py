"""Counts of a 440, 380 or 381 to degrees per second, g and degrees Celsius, and back."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

COUNT_LIMITS = (-(2**15), 2**15 - 1)
"""Least and largest count of S0 and S1; a reading there says only "this or more"."""


@dataclass(frozen=True)
class Scaling:
    """Counts to units and back, in the axes and signs of the packets. All units of the family share the scales.

    Each method takes an int, a tuple or an array of any shape, and returns a numpy scalar or array of that shape.
    """

    accel_lsb_g: float = 20.0 / 2**16
    rate_lsb_dps: float = 1260.0 / 2**16  # "1260 / 2^16 deg/s": 7 pi rad/s
    temperature_lsb_degc: float = 200.0 / 2**16
    magnetic_lsb_gauss: float = 2.0 / 2**16  # "2 / 2^16 gauss"; some tables have 20
    velocity_lsb_mps: float = 200.0 / 2**32  # "200 / 2^32 m/s" of S2
    angle_lsb_deg: float = 1260.0 / 2**32  # "1260 / 2^32 deg" of S2

    def accels_g(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Specific force as the unit reads it, g."""
        return np.asarray(counts, np.float64) * self.accel_lsb_g

    def rates_dps(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Angular rate, deg/s."""
        return np.asarray(counts, np.float64) * self.rate_lsb_dps

    def temperature_degc(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Temperature, degC, of a rate sensor or of the board."""
        return np.asarray(counts, np.float64) * self.temperature_lsb_degc

    def magnetics_gauss(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Magnetic field, gauss."""
        return np.asarray(counts, np.float64) * self.magnetic_lsb_gauss

    def velocity_steps_mps(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Change of velocity over a packet's time, m/s."""
        return np.asarray(counts, np.float64) * self.velocity_lsb_mps

    def angle_steps_deg(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Change of angle over a packet's time, deg."""
        return np.asarray(counts, np.float64) * self.angle_lsb_deg

    def accel_counts(self, accels_g: ArrayLike) -> NDArray[np.int64]:
        """Nearest counts of a specific force in g, clipped to 16 bits with sign."""
        return _nearest(accels_g, self.accel_lsb_g)

    def rate_counts(self, rates_dps: ArrayLike) -> NDArray[np.int64]:
        """Nearest counts of an angular rate in deg/s, clipped to 16 bits with sign."""
        return _nearest(rates_dps, self.rate_lsb_dps)

    def temperature_counts(self, temperature_degc: ArrayLike) -> NDArray[np.int64]:
        """Nearest counts of a temperature in degC, clipped to 16 bits with sign."""
        return _nearest(temperature_degc, self.temperature_lsb_degc)


def _nearest(values: ArrayLike, lsb: float) -> NDArray[np.int64]:
    return np.clip(np.rint(np.asarray(values, np.float64) / lsb), *COUNT_LIMITS).astype(np.int64)
