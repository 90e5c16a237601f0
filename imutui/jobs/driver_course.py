"""What may drive the errors of a log: temperature, rates and specific forces over time, and their means over cells."""

from dataclasses import dataclass

import numpy as np

from filters.channels import DPS, G
from filters.effects.inputs import SENSED
from filters.types import Array
from imutui.logbook.reader import Log

TEMPERATURE = "temperature"
UNITS = {TEMPERATURE: "°C", **{name: "deg/s" if name.startswith("w") else "g" for name in SENSED}}
LEAST_SPANS = {"°C": 0.5, "deg/s": 2.0, "g": 0.1}
"""Range of a driver, by its unit, below which it shows nothing."""
_MOST_BLOCKS = 20_000


@dataclass(frozen=True, slots=True)
class DriverCourse:
    """What may drive errors over a log, as means over short blocks."""

    t: Array  # times, s since power-on, shape (N,)
    # by driver, "temperature" (degC) and those of `SENSED` as the unit reads them (deg/s, g, its own axes and sign),
    # shape (N,) each; NaN where not known
    values: dict[str, Array]
    has_past: bool = False  # whether the power-on began earlier: what remembers temperature is not known then


def of_log(log: Log, begins_s: float = 0.0) -> DriverCourse:
    """What may drive errors over a log.

    `log`: that was read.
    `begins_s`: when its first sample was taken, s since power-on.
    """
    axes = log.info.axes()
    gyro = axes.gyro_to_instrument(_blocks(log.gyro)) / DPS
    accel = axes.accel_to_instrument(_blocks(log.accel)) / G
    values = dict(zip(SENSED, np.hstack([gyro, accel]).T, strict=True))
    values[TEMPERATURE] = _blocks(log.temperature()[:, None])[:, 0]
    return DriverCourse(_blocks(log.seconds()[:, None])[:, 0] + begins_s, values, begins_s > 0.0)


def _blocks(samples: Array) -> Array:
    """Means over blocks of samples, a bounded number of them; what fills no block at the end is left out."""
    size = max(1, len(samples) // _MOST_BLOCKS)
    n = len(samples) // size * size
    return np.asarray(samples[:n].reshape(-1, size, samples.shape[1]).mean(axis=1), float)


def means(t: Array, values: Array, at: Array) -> tuple[Array, Array]:
    """Means of values over the cells of a residual, and how much they change within each.

    `t`, `values`: times, s, shape (N,), and values then, shape (N, k).
    `at`: middles of the cells, s, shape (M,), increasing.
    Returns shape (M, k) each; NaN of a cell with a value that is not known, or without any.
    """
    half = 0.5 * float(np.median(np.diff(at)))
    first, last = np.searchsorted(t, at - half), np.searchsorted(t, at + half)
    mean = np.full((at.size, values.shape[1]), np.nan)
    change = mean.copy()
    for k in np.flatnonzero(last > first):
        inside = values[first[k] : last[k]]
        mean[k], change[k] = inside.mean(axis=0), np.ptp(inside, axis=0)
    return mean, change
