"""Where in a profile the readings depart from the model, in a sentence: position, channel, size, cause."""

from typing import TYPE_CHECKING

import numpy as np

from filters.imu import AxisMap

if TYPE_CHECKING:
    from filters.kalman.alarms import Departure
    from filters.kalman.runner import Estimator

_ACCEL, _GYRO = ("ax", "ay", "az"), ("gx", "gy", "gz")


def sentence(estimator: "Estimator", axes: AxisMap, g_unit: float) -> str | None:
    """The departure that is most certain, in the instrument's axes and units; None if there is none.

    `estimator`: between two samples.
    `axes`: instrument to body.
    `g_unit`: m/s² of one g.
    """
    found = estimator.departure()
    if found is None:
        return None
    name, size, unit, digits = _reading(found, axes, g_unit)
    more = "more" if size > 0.0 else "less"
    what = f"segment {found.segment + 1}: {name} reads {abs(size):.{digits}f} {unit} {more} than the model"
    return f"{what}: {_suspicion(found, name)}"


def _reading(found: "Departure", axes: AxisMap, g_unit: float) -> tuple[str, float, str, int]:
    """Name, size, unit and decimals of the channel that departs, in the instrument's axes."""
    kind = found.channel // 3
    place = int(np.argmax(axes.sd_to_instrument(np.eye(3)[found.channel % 3])))
    if kind == 0:
        size = axes.accel_to_instrument(found.size[:3]) / g_unit * 1e3
        return _ACCEL[place], float(size[place]), "mg", 1
    size = np.rad2deg(axes.gyro_to_instrument(found.size[3:]))
    return _GYRO[place], float(size[place]), "deg/s", 3


def _suspicion(found: "Departure", name: str) -> str:
    """What it may be, and which of table, profile and unit it speaks against."""
    percent, degrees = 100.0 * found.share, np.rad2deg(found.share)
    match found.cause:
        case "scale factor" if name in _ACCEL:
            against = "against the unit, since no angle of the table changes the length of gravity"
            return f"scale factor of {percent:+.2f} %? It speaks {against}"
        case "scale factor":
            return (
                f"scale factor of {percent:+.2f} %? It speaks against the unit, or the table's rate is off by as much"
            )
        case "cross-axis":
            return f"cross-axis of {percent:+.2f} %? It speaks against the unit, or its mounting"
        case "tilt":
            return f"tilt of {degrees:.2f} deg? It speaks against the table or the mounting: gravity has its length"
        case "motion":
            return "was the table at rest? If it was, it speaks against the unit: a bias that moves"
        case "another rate":
            return (
                f"{percent:+.0f} % of the rate. It speaks against the profile or the table: not the rate that it says"
            )
        case "another angle":
            return f"{degrees:.0f} deg off. It speaks against the profile, the mounting or the sign, not the unit"
