"""Specifications of units: what data sheets promise of noise, biases and bandwidths. Standard library only."""

import math
from dataclasses import dataclass

from filters.channels import STANDARD_GRAVITY

_DEG = math.pi / 180.0
_SQRT_HOUR = 60.0


@dataclass(frozen=True, slots=True)
class ImuSpec:
    """What the filter believes of the sensor; the defaults are the paper's Table 1 (IMU400CD-200)."""

    gyro_arw: float = 4.5 * _DEG / _SQRT_HOUR  # angle random walk, rad/√s (Table 1: 4.5 deg/√h)
    accel_vrw: float = 1.0 / _SQRT_HOUR  # velocity random walk, m/s/√s (Table 1: 1 m/s/√h)
    gyro_bias_limit: float = 1.0 * _DEG  # rad/s (Table 1: 1 deg/s)
    accel_bias_limit: float = 12e-3 * STANDARD_GRAVITY  # m/s² (Table 1: 12 mg)
    # gyro_bandwidth, accel_bandwidth: -3 dB frequencies, Hz (Table 1: 25 and 75)
    gyro_bandwidth: float = 25.0
    accel_bandwidth: float = 75.0
    source: str = "Table 1"  # where the figures are from, for people


IMU400CD_200 = ImuSpec()  # Table 1 of the paper
IMU440CA_200 = ImuSpec(
    gyro_bias_limit=0.75 * _DEG,
    accel_bias_limit=15e-3 * STANDARD_GRAVITY,
    accel_bandwidth=25.0,
    source="IMU440 data sheet",
)
"""Crossbow's data sheet 6020-0090-02 Rev A: noise as in Table 1, biases over temperature, bandwidths nominal."""

NOT_KNOWN = ImuSpec(source="no data sheet")
"""Of a unit of another kind, or one that is not stated: the filter expects Table 1's noise, and no limit holds."""

_SPECIFICATIONS = {
    "IMU400": IMU400CD_200,
    "IMU440": IMU440CA_200,
    # of these no data sheet was to be had as text: that of the unit whose protocol they speak stands in
    **dict.fromkeys(("IMU380", "IMU381", "DMU380", "DMU381"), IMU440CA_200),
}
"""By the beginning of a model's name."""


def of_model(model: str) -> ImuSpec:
    """Return the specification of a model; `NOT_KNOWN` where there is none."""
    return next((spec for name, spec in _SPECIFICATIONS.items() if model.upper().startswith(name)), NOT_KNOWN)


def is_known(model: str) -> bool:
    """Whether there is a specification of this kind of unit."""
    return model.upper().startswith(tuple(_SPECIFICATIONS))
