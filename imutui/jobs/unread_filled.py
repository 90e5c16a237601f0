"""Readings for the filter in place of channels that a log lacks: what the reference says of a unit at rest.

A filter needs three of each kind to integrate. With what a perfect unit reads there the missing channels neither add
anything nor pull at the others; what it then holds of their biases is nothing, and is told as not observable. A unit
that moves has no such readings, and is refused.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from filters.errors import InputError
from filters.motion import alignment
from filters.motion import reference as references
from imutui.logbook import unread_channels
from imutui.logbook.session_info import SessionInfo

_LEVELLED_S = 10.0
_FLAT = 0.1


@dataclass(frozen=True, slots=True)
class Filled:
    """Readings with every channel."""

    # gyro, accel: rad/s and m/s², body axes, shape (N, 3)
    gyro: np.ndarray
    accel: np.ndarray
    unread: tuple[bool, ...] = ()  # of accelerometers and gyros, body axes, those that were made up; empty if none was


def level_force(force: np.ndarray, gravity: float) -> np.ndarray:
    """Mean specific force of a unit at rest, body axes, with an axis that was not read made up to gravity.

    `force`: m/s², shape (3,), NaN for an axis that was not read.
    `gravity`: m/s².
    Raises InputError if it can't be: two axes are missing, or one that does not point down and feels too much of
      gravity to be flat.
    """
    lacking = np.flatnonzero(np.isnan(force))
    if not lacking.size:
        return force
    if lacking.size > 1:
        raise InputError("with one accelerometer or none the level can't be read from gravity")
    (axis,) = lacking.tolist()
    rest = float(np.sqrt(max(0.0, gravity**2 - np.nansum(force**2))))
    if axis != 2 and rest > _FLAT * gravity:
        name = "xyz"[axis]
        raise InputError(
            f"without the accelerometer along the table's {name} it can't be told which way the unit is tilted"
        )
    made = force.copy()
    # upright, as mounted: specific force is up, and the third body axis points down
    made[axis] = -rest if axis == 2 else 0.0
    return made


def filled(t: np.ndarray, gyro: np.ndarray, accel: np.ndarray, info: SessionInfo, path: Path) -> Filled:
    """Readings with every channel.

    `t`: s since the first sample, shape (N,).
    `gyro`, `accel`: as the log has them, body axes, NaN where a channel was not read, shape (N, 3).
    `info`: with the reference in force.
    `path`: the log, for messages.
    Raises InputError if the reference does not say what the channels would have read.
    """
    lacks = unread_channels.unread(gyro, accel)
    if not lacks.any():
        return Filled(gyro, accel)
    told = ", ".join(unread_channels.names(unread_channels.in_instrument_axes(lacks, info.axes())))
    site = info.site()
    if info.reference == "level":
        still = references.level(site)
    elif info.reference == "gravity":
        early = t <= _LEVELLED_S
        try:
            force = level_force(accel[early].mean(axis=0), site.gravity)
            still = alignment.level_by_gravity(site, force, 0.0)
        except InputError as error:
            raise InputError(f"{path} has no readings of {told}: {error}. If it is level: --reference level") from error
    else:
        raise InputError(
            f"{path} has no readings of {told}, and the reference ({info.reference}) lets the unit move: what it would"
            " have read there is not known. Replay a part at rest with --reference level or gravity, or trace it:"
            " `imutui trace` leaves these channels out."
        )
    gyro, accel = gyro.copy(), accel.copy()
    rate, force = still.rates_and_forces()
    gyro[:, lacks[:3]] = rate[lacks[:3]]
    accel[:, lacks[3:]] = force[lacks[3:]]
    return Filled(gyro, accel, (*lacks[3:].tolist(), *lacks[:3].tolist()))
