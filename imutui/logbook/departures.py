"""Where in a profile readings depart from the model, and what shows in the residual at rest, in sentences."""

import math
from typing import TYPE_CHECKING

import numpy as np

from filters.imu import AxisMap
from imutui.filter_snapshot import WatchedSnapshot

if TYPE_CHECKING:
    from filters.kalman.alarms import Departure
    from filters.kalman.residual_watch import Finding
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
    name, size, unit, digits = _reading(found.channel, found.size, axes, g_unit)
    more = "more" if size > 0.0 else "less"
    what = f"segment {found.segment + 1}: {name} reads {abs(size):.{digits}f} {unit} {more} than the model"
    return f"{what}: {_suspicion(found, name)}"


def _reading(channel: int, size: np.ndarray, axes: AxisMap, g_unit: float) -> tuple[str, float, str, int]:
    """Name, size, unit and decimals of a channel of six, in the instrument's axes."""
    place = int(np.argmax(axes.sd_to_instrument(np.eye(3)[channel % 3])))
    if channel < 3:
        size = axes.accel_to_instrument(size[:3]) / g_unit * 1e3
        return _ACCEL[place], float(size[place]), "mg", 1
    size = np.rad2deg(axes.gyro_to_instrument(size[3:]))
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


def watched(estimator: "Estimator", axes: AxisMap, g_unit: float) -> list[WatchedSnapshot]:
    """What shows now, the most certain first, then what was told before; empty of a unit that is not at rest."""
    if estimator.watch is None:
        return []
    told = [(one, True) for one in estimator.watch.findings()] + [(one, False) for one in estimator.watch.past()]
    return [watched_field(one, axes, g_unit, shows=shows) for one, shows in told]


def watched_field(found: "Finding", axes: AxisMap, g_unit: float, *, shows: bool = True) -> WatchedSnapshot:
    """One of them."""
    of_channel = np.eye(6)[found.channel]
    name, sign, unit, digits = _reading(found.channel, of_channel, axes, g_unit)
    size, sd, extent = found.size * sign, found.sd * abs(sign), found.extent * abs(sign)
    if found.kind == "oscillation":
        size = abs(size)
    elif found.kind == "noise":
        size, sd, unit = found.size, found.sd, ""
    elif found.kind == "temperature slope":
        unit += "/K"
    elif found.kind == "temperature rate":
        size, sd, unit = size / 60.0, sd / 60.0, f"{unit}/(K/min)"
    # as many decimals as the certainty is worth
    digits = min(max(1 - math.floor(math.log10(3.0 * sd)), 0), 9) if sd > 0.0 else digits
    text = _told(found, name, f"{size:+.{digits}f} ±{3.0 * sd:.{digits}f} {unit}", size)
    return {
        "kind": found.kind, "channel": name, "size": size, "sd": sd, "unit": unit, "extent": extent,
        "odds": found.odds, "t": found.t, "at": found.at, "hz": found.hz, "shows": shows, "text": text,
    }  # fmt: skip


def _told(found: "Finding", name: str, size: str, ratio: float) -> str:
    """An effect in a sentence."""
    odds = f"odds {found.odds:.0f}:1" if found.odds < 1000.0 else "odds over 1000:1"
    at = "" if found.at is None else f" at {found.at:.0f} s"
    match found.kind:
        case "oscillation":
            return f"{name} oscillates at {found.hz:.3g} Hz by {size.lstrip('+')} ({odds})"
        case "step":
            return f"{name} stepped by {size}{at} ({odds})"
        case "levels":
            return f"{name} went to another level and back, {size}{at} ({odds})"
        case "noise":
            return f"{name} has {ratio:.2f} times the noise{at} ({odds})"
        case "temperature slope":
            return f"{name} follows the temperature, {size} ({odds})"
        case "temperature rate":
            return f"{name} follows the temperature's rate, {size} ({odds})"
