"""Scales of a Crossbow IMU's words."""

from imutui.instrument.counts import Scaling

VOLTAGE_LIMITS = (0, 4095)
"""Least and largest word of a sensor voltage: "data · 5 / 4096", V, a 12-bit word."""
VOLTAGE_AT_REST, SCALED_A_VOLTAGE_COUNT = 2048, 16
""""2.5 V at rest": the middle of that; its ends are those of scaled words, which count so many times finer."""
_VOLTS_LSB = 5.0 / 4096


def scaling(rate_range_dps: float = 200.0, accel_range_g: float = 4.0) -> Scaling:
    """Return the scales of scaled mode: "rate, deg/s: data · RR · 1.5 / 2^15. Acceleration, g: data · GR · 1.5 / 2^15".

    The ranges follow from the model's suffix and are not in the packets; those of the IMU400CD-200 are the defaults.
    """
    return Scaling(
        rate_lsb_dps=rate_range_dps * 1.5 / 2**15,
        accel_lsb_g=accel_range_g * 1.5 / 2**15,
        # "44.4 · (V - 1.375)". The manual's appendix has 44.44; 0.02 degC at room temperature.
        temperature_lsb=_VOLTS_LSB,
        temperature_zero=1.375,
        degc_per_unit=44.4,
        temperature_limits=VOLTAGE_LIMITS,
    )
