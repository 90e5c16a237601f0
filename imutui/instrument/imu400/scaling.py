"""Counts of a Crossbow IMU to degrees per second, g, volts and degrees Celsius, and back."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

# "Rate, deg/s: data · RR · 1.5 / 2^15. Acceleration, g: data · GR · 1.5 / 2^15."
FULL_SCALE_RATIO = 1.5
_SCALED_COUNTS = 2**15
COUNT_LIMITS = (-_SCALED_COUNTS, _SCALED_COUNTS - 1)
"""Least and largest scaled count; a reading there says only "this or more"."""

# "Voltage: data · 5 / 4096", a 12-bit word.
VOLTS_SPAN = 5.0
_VOLTAGE_COUNTS = 4096

# "Temperature, degC: 44.4 · (V - 1.375)". The manual's appendix has 44.44; 0.02 degC at room temperature.
_DEGC_PER_VOLT = 44.4
_VOLTS_AT_0_DEGC = 1.375


@dataclass(frozen=True)
class Scaling:
    """Counts to units and back, in the instrument's own axes and signs.

    Each method takes an int, a tuple or an array of any shape, and returns a numpy scalar or array of that shape.
    The ranges follow from the model's suffix and are not in the packets.
    """

    rate_range_dps: float = 200.0  # RR, 200 deg/s for the IMU400CD-200. Words reach 1.5 times as far.
    accel_range_g: float = 4.0  # GR, 4 g for the IMU400CD-200. Words reach 1.5 times as far.

    def rates_dps(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Angular rate, deg/s, of scaled counts: data · RR · 1.5 / 2^15."""
        return np.asarray(counts, np.float64) * self._rate_lsb_dps

    def accels_g(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Acceleration as the unit reads it, g, of scaled counts: data · GR · 1.5 / 2^15."""
        return np.asarray(counts, np.float64) * self._accel_lsb_g

    def temperature_degc(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Temperature inside the case, degC, in either mode: 44.4 · (V - 1.375)."""
        return _DEGC_PER_VOLT * (self.volts(counts) - _VOLTS_AT_0_DEGC)

    def volts(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Sensor voltage, V, of a word in voltage mode: data · 5 / 4096."""
        return np.asarray(counts, np.float64) * (VOLTS_SPAN / _VOLTAGE_COUNTS)

    def rate_counts(self, rates_dps: ArrayLike) -> NDArray[np.int64]:
        """Nearest scaled counts of an angular rate in deg/s, clipped to 16 bits with sign."""
        return _nearest(rates_dps, self._rate_lsb_dps, *COUNT_LIMITS)

    def accel_counts(self, accels_g: ArrayLike) -> NDArray[np.int64]:
        """Nearest scaled counts of an acceleration in g, clipped to 16 bits with sign."""
        return _nearest(accels_g, self._accel_lsb_g, *COUNT_LIMITS)

    def temperature_counts(self, temperature_degc: ArrayLike) -> NDArray[np.int64]:
        """Nearest counts of a temperature in degC, clipped to 12 bits."""
        return self.volts_counts(np.asarray(temperature_degc, np.float64) / _DEGC_PER_VOLT + _VOLTS_AT_0_DEGC)

    def volts_counts(self, volts: ArrayLike) -> NDArray[np.int64]:
        """Nearest counts of a sensor voltage, clipped to 12 bits."""
        return _nearest(volts, VOLTS_SPAN / _VOLTAGE_COUNTS, 0, _VOLTAGE_COUNTS - 1)

    @property
    def _rate_lsb_dps(self) -> float:
        return self.rate_range_dps * FULL_SCALE_RATIO / _SCALED_COUNTS

    @property
    def _accel_lsb_g(self) -> float:
        return self.accel_range_g * FULL_SCALE_RATIO / _SCALED_COUNTS


def _nearest(values: ArrayLike, lsb: float, lowest: int, highest: int) -> NDArray[np.int64]:
    return np.clip(np.rint(np.asarray(values, np.float64) / lsb), lowest, highest).astype(np.int64)
