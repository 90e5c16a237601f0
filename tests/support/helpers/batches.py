"""Logs of a batch: units at rest on one table, of which all have an error, and some another."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from filters.imu import ImuSpec
from filters.simulation import simulate
from filters.types import Array
from helpers import logs
from imutui.logbook import SessionInfo

HZ = 20.0
Error = Callable[[Array], Array]
"""Of t, s, shape (N,): six errors in the table's axes, rad/s and m/s², shape (N, 6)."""
HALF = ImuSpec(gyro_arw=0.5 * ImuSpec().gyro_arw, accel_vrw=0.5 * ImuSpec().accel_vrw)
"""Units whose noise is half of what Table 1 allows."""


def along(axis: int, values: Array) -> Array:
    """Errors along one axis, the sixth being down."""
    out = np.zeros((values.size, 6))
    out[:, axis] = values
    return out


def nothing(t: Array) -> Array:
    return np.zeros((t.size, 6))


def batch(
    folder: Path,
    count: int = 4,
    seed: int = 1,
    seconds: float = 120.0,
    common: Error = nothing,
    own: Mapping[int, Error] | None = None,
    mounts: tuple[str, ...] = ("x,y,z",),
    names: tuple[str, ...] = (),
) -> list[Path]:
    """Finished logs of units `U1`, `U2`, … of the batch "B7".

    `common`: error of all units.
    `own`: errors of single units, by their number from 0.
    `mounts`: how units are mounted, in turn.
    `names`: the units' names in the batch. All units then have the serial number 9911750.
    """
    made = []
    for k in range(count):
        samples, _ = simulate(rate_hz=HZ, seconds=seconds, seed=1000 * seed + k, spec=HALF)
        error = common(samples.t) + (own or {}).get(k, nothing)(samples.t)
        samples = replace(samples, gyro=samples.gyro + error[:, :3], accel=samples.accel + error[:, 3:])
        info = SessionInfo(
            rate_hz=HZ,
            kind="simulated",
            serial_number=f"U{k + 1}",
            batch="B7",
            mount=mounts[k % len(mounts)],
            site_stated=True,
        )
        if names:
            info = replace(info, serial_number="9911750", acquisition=f"B7:{names[k]}")
        made.append(logs.of_samples(folder / f"u{k + 1}.mcap", samples, info))
    return made
