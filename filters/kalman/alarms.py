"""Data that contradict the model, and biases that the motion cannot tell from other effects, in sentences."""

from dataclasses import dataclass

import numpy as np

from filters.imu import STANDARD_GRAVITY, ImuSpec
from filters.kalman.consistency import Convergence
from filters.types import Array

_ALARM_FACTOR = 3.0
_TURNING = np.deg2rad(0.2)
_TURNING_HARD = np.deg2rad(5.0)
_ONE_WAY = 0.25


@dataclass(slots=True)
class Turns:
    """Sums over samples with a known rate, of what tells a bias from the effects that look like it."""

    count: int = 0
    first: Array | None = None
    second: Array | None = None

    def add(self, rates: Array) -> None:
        """Take known angular rates (N, 3), rad/s, NaN where not known."""
        rates = rates[np.isfinite(rates[:, 0])]
        if rates.size:
            values = np.column_stack([rates, np.sum(rates**2, axis=1)])
            zero = np.zeros(4)
            self.count += len(values)
            self.first = (zero if self.first is None else self.first) + values.sum(axis=0)
            self.second = (zero if self.second is None else self.second) + np.sum(values**2, axis=0)

    def constant(self) -> tuple[Array, Array]:
        """Mean rates and mean squared rate, (4,), and whether each has been the same all the time, bool (4,)."""
        if self.first is None or self.second is None:
            return np.zeros(4), np.zeros(4, bool)
        mean = self.first / self.count
        deviation = np.sqrt(np.maximum(self.second / self.count - mean**2, 0.0))
        return mean, np.asarray(deviation < 0.25 * np.abs(mean))

    def _mean_square(self, i: int) -> float:
        return float(self.second[i] / self.count) if self.second is not None else 0.0

    def confounded(self) -> list[str]:
        """Sentences on biases that this motion cannot tell from other effects, body axes."""
        mean, same = self.constant()
        out = []
        for i, axis in enumerate("xyz"):
            if same[i] and abs(mean[i]) > _TURNING:
                out.append(
                    f"{axis} gyro bias: the table turned at {np.rad2deg(mean[i]):.1f} deg/s about {axis} all the time,"
                    f" where scale factor and delay look like bias; turn both ways, at two rates"
                )
            elif mean[i] ** 2 > _ONE_WAY * self._mean_square(i) and abs(mean[i]) > _TURNING_HARD:
                dps = np.rad2deg(mean[i])
                out.append(
                    f"{axis} gyro bias: the table turned about {axis} mostly one way, {dps:.1f} deg/s in the mean; 1 %"
                    f" of scale factor would shift the bias by {abs(dps) * 0.01:.2f} deg/s. Turn both ways alike"
                )
        if same[3] and mean[3] > _TURNING_HARD**2:
            out.append(
                f"accelerometer biases: the table turned at {np.rad2deg(np.sqrt(mean[3])):.1f} deg/s all the time,"
                " where a lever arm looks like bias; add a dwell or a second rate"
            )
        return out


def causes(reference: str) -> str:
    """What puts the accelerometers far off a reference of that name."""
    table = ", or the table is not where the segment says" if reference == "profile" else ""
    return f"wrong accelerometer sign, mounting or attitude{table}"


def of_residuals(
    convergence: Convergence, spec: ImuSpec, observable: tuple[bool, ...], reference: str = "level"
) -> list[str]:
    """Sentences on readings that are off the reference by more than a bias can be.

    `convergence`: with the mean raw residual; without one there is nothing to say.
    `spec`: limits of the biases.
    `observable`: for the six biases, whether they can be told from attitude.
    """
    apparent = convergence.apparent
    out: list[str] = []
    if apparent is None:
        return out
    if np.any(np.abs(apparent[:3]) > 0.5 * STANDARD_GRAVITY):
        size = float(np.max(np.abs(apparent[:3]))) / STANDARD_GRAVITY
        out.append(f"accelerometers are off the reference by {size:.2f} g: {causes(reference)}")
    limits = np.array([spec.accel_bias_limit] * 3 + [spec.gyro_bias_limit] * 3)
    names = ("x accel", "y accel", "z accel", "x gyro", "y gyro", "z gyro")
    for i in np.flatnonzero(np.abs(apparent) > _ALARM_FACTOR * limits):
        if observable[i] and abs(apparent[i]) < 0.5 * STANDARD_GRAVITY:
            out.append(
                f"{names[i]} (body axes) is off by {abs(apparent[i]) / limits[i]:.1f} times the bias limit of"
                f" {spec.source}: tilt, scale, a moving table, or a faulty sensor"
            )
    return out
