"""Where in a profile readings depart from the model, and what shows in the residual at rest, in sentences."""

import math
from typing import TYPE_CHECKING

import numpy as np

from filters.imu import CHANNELS
from imutui.estimates import CauseField
from imutui.logbook.session_info import SessionInfo

if TYPE_CHECKING:
    from filters.kalman.alarms import Departure
    from filters.kalman.residual_watch import Cause
    from filters.kalman.runner import Estimator


def sentence(estimator: "Estimator", info: SessionInfo) -> str | None:
    """Return the departure that is most certain; None if there is none."""
    found = estimator.departure()
    if found is None:
        return None
    name, size, unit, digits = _reading(found.channel, found.size, info)
    more = "more" if size > 0.0 else "less"
    what = f"segment {found.segment + 1}: {name} reads {abs(size):.{digits}f} {unit} {more} than the model"
    return f"{what}: {_suspicion(found, name)}"


def _reading(channel: int, size: np.ndarray, info: SessionInfo) -> tuple[str, float, str, int]:
    """Return name, size, unit and decimals of a channel, of sizes of all six in SI and body axes."""
    place = int(np.argmax(info.axes().sd_to_instrument(np.eye(3)[channel % 3])))
    accel, gyro = info.outward(size[:3], size[3:])
    if channel < 3:
        return CHANNELS[3 + place], float(accel[place]), "mg", 1
    return CHANNELS[place], float(gyro[place]), "deg/s", 3


def _suspicion(found: "Departure", name: str) -> str:
    """Return what it may be, and which of table, profile and unit it speaks against."""
    percent, degrees = 100.0 * found.share, np.rad2deg(found.share)
    match found.cause:
        case "scale factor" if name[0] == "a":
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


def causes(estimator: "Estimator", info: SessionInfo) -> list[CauseField]:
    """Return the effects that stand, those that show now first; empty for a unit that is not at rest."""
    watch = estimator.watch
    return [] if watch is None else [cause_field(one, info, shows=watch.shows(one)) for one in watch.causes()]


def withdrawn(estimator: "Estimator", info: SessionInfo) -> list[CauseField]:
    """Return the effects that were reported and withdrawn, the newest first."""
    changes = [] if estimator.watch is None else reversed(estimator.watch.changes)
    return [cause_field(one, info, shows=False) for change, one in changes if change == "cause_gone"]


def cause_field(cause: "Cause", info: SessionInfo, *, shows: bool = True) -> CauseField:
    """Return an effect in the instrument's axes and units."""
    name, sign, unit, digits = _reading(cause.channel, np.eye(6)[cause.channel], info)
    size, sd, extent = cause.size * sign, cause.sd * abs(sign), cause.extent * abs(sign)
    if cause.effect == "tone":
        size = abs(size)
    elif cause.effect == "noise_level":
        size, sd, unit = cause.size, cause.sd, ""
    elif cause.effect == "thermal_lin":
        unit += "/K"
    elif cause.effect == "thermal_rate":
        size, sd, unit = size / 60.0, sd / 60.0, f"{unit}/(K/min)"
    # as many decimals as the certainty is worth
    digits = min(max(1 - math.floor(math.log10(3.0 * sd)), 0), 9) if sd > 0.0 else digits
    text = _told(cause, name, f"{size:+.{digits}f} ±{3.0 * sd:.{digits}f} {unit}", size)
    return {
        "channel": name, "effect": cause.effect, "size": size, "sd": sd, "unit": unit, "odds": cause.odds,
        "since": cause.since, "extent": extent, "t": cause.t, "hz": cause.hz, "shows": shows, "text": text,
    }  # fmt: skip


def event_text(cause: CauseField) -> str:
    """Return the sentence, and behind it the fields for programs."""
    fields = {key: cause[key] for key in ("channel", "effect", "size", "sd", "unit", "odds", "since", "hz")}
    told = (f"{key}={value:.6g}" if isinstance(value, float) else f"{key}={value}" for key, value in fields.items())
    return f"{cause['text']} ({' '.join(told)})"


def _told(cause: "Cause", name: str, size: str, ratio: float) -> str:
    """Return an effect in a sentence."""
    odds = f"odds {cause.odds:.{0 if cause.odds > 1.0 else 2}f}:1" if cause.odds < 1000.0 else "odds over 1000:1"
    at = f" at {cause.since:.0f} s"
    match cause.effect:
        case "tone":
            return f"{name} oscillates at {cause.hz:.3g} Hz by {size.lstrip('+')} ({odds})"
        case "step":
            return f"{name} stepped by {size}{at} ({odds})"
        case "telegraph":
            return f"{name} went to another level and back, {size}{at} ({odds})"
        case "noise_level":
            return f"{name} has {ratio:.2f} times the noise{at} ({odds})"
        case "thermal_lin":
            return f"{name} follows the temperature, {size} ({odds})"
        case "thermal_rate":
            return f"{name} follows the temperature's rate, {size} ({odds})"
