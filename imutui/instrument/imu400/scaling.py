"""Counts of a Crossbow IMU to degrees per second, g, volts and degrees Celsius, and back."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imutui.instrument import counts
from imutui.instrument.counts import nearest

# "Rate, deg/s: data · RR · 1.5 / 2^15. Acceleration, g: data · GR · 1.5 / 2^15."
FULL_SCALE_RATIO = 1.5
_SCALED_COUNTS = 2**15

# "Voltage: data · 5 / 4096", a 12-bit word.
VOLTS_SPAN = 5.0
_VOLTAGE_COUNTS = 4096
_VOLTS_LSB = VOLTS_SPAN / _VOLTAGE_COUNTS

# "Temperature, degC: 44.4 · (V - 1.375)". The manual's appendix has 44.44; 0.02 degC at room temperature.
_DEGC_PER_VOLT = 44.4
_VOLTS_AT_0_DEGC = 1.375


class Scaling(counts.Scaling):
    """Scales of scaled mode, and volts of voltage mode; the temperature is a voltage in either mode.

    The ranges follow from the model's suffix and are not in the packets; words reach 1.5 times as far.

    `rate_range_dps`: RR, 200 deg/s for the IMU400CD-200.
    `accel_range_g`: GR, 4 g for the IMU400CD-200.
    """

    def __init__(self, rate_range_dps: float = 200.0, accel_range_g: float = 4.0) -> None:
        super().__init__(
            rate_range_dps * FULL_SCALE_RATIO / _SCALED_COUNTS,
            accel_range_g * FULL_SCALE_RATIO / _SCALED_COUNTS,
            _DEGC_PER_VOLT * _VOLTS_LSB,
        )

    def temperature_degc(self, words: ArrayLike) -> NDArray[np.float64]:
        """Temperature inside the case, degC: 44.4 · (V - 1.375)."""
        return _DEGC_PER_VOLT * (self.volts(words) - _VOLTS_AT_0_DEGC)

    def temperature_counts(self, temperature_degc: ArrayLike) -> NDArray[np.int64]:
        """Nearest counts of a temperature in degC, clipped to 12 bits."""
        return self.volts_counts(np.asarray(temperature_degc, np.float64) / _DEGC_PER_VOLT + _VOLTS_AT_0_DEGC)

    def volts(self, words: ArrayLike) -> NDArray[np.float64]:
        """Sensor voltage, V, of a word in voltage mode: data · 5 / 4096."""
        return np.asarray(words, np.float64) * _VOLTS_LSB

    def volts_counts(self, volts: ArrayLike) -> NDArray[np.int64]:
        """Nearest counts of a sensor voltage, clipped to 12 bits."""
        return nearest(volts, _VOLTS_LSB, (0, _VOLTAGE_COUNTS - 1))
