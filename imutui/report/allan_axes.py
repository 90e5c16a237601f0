"""Axes of an Allan deviation, with the line that white noise of the specification (Table 1) would be."""

from typing import TYPE_CHECKING

import numpy as np

from filters.channels import STANDARD_GRAVITY
from filters.imu import IMU400CD_200
from filters.types import Array
from imutui.report import axes
from imutui.report.axes import FLOOR

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CAPTION = (
    "The grey line is white noise of the specification, 4.5 deg/√h of a gyro and 1 m/s/√h of an accelerometer: the"
    " paper's Table 1 has it of the IMU400CD-200, its data sheet of the IMU440CA-200."
)
_WHITE = {"deg/s": float(np.rad2deg(IMU400CD_200.gyro_arw)), "mg": IMU400CD_200.accel_vrw / STANDARD_GRAVITY * 1e3}


def specification(tau: Array, unit: str) -> Array:
    """Allan deviation of the specification's white noise, N/√τ.

    `tau`: averaging times, s.
    `unit`: "deg/s" or "mg".
    """
    return np.asarray(_WHITE[unit] / np.sqrt(tau))


def finish(ax: "Axes", tau: Array, unit: str, *curves: Array) -> None:
    """Draw the specification's line, make both axes logarithmic, and name them.

    `ax`: with the curves in it.
    `tau`: averaging times of all of them, s.
    `unit`: "deg/s" or "mg".
    `*curves`: all that is drawn.
    """
    if tau.size:
        ends = np.array([tau.min(), tau.max()])
        white = specification(ends, unit)
        ax.plot(ends, white, color=FLOOR, lw=1.0, label="specification")
        axes.logarithmic(ax, "x", tau)
        axes.logarithmic(ax, "y", white, *curves)
    axes.name(ax, "averaging time, s", unit, legend=True)
