"""Readings for the virtual instrument: a simulated still unit, or a recording brought to the unit's rate."""

from pathlib import Path

import numpy as np

from filters.imu import AxisMap
from filters.simulation import StillUnit
from imutui.instrument.virtual import Reading, Source

LOOP_HZ = 400.0 / 3.0
SIMULATED = "IMU400CD-200 VIRTUAL SIM"
PLAYED = "IMU400CD-200 VIRTUAL REC"


class SimulatedReadings:
    """A still, level unit with biases and noise of Table 1."""

    def __init__(self, seed: int) -> None:
        self.unit = StillUnit(seed, LOOP_HZ)
        self._axes = AxisMap()

    def reading(self, k: int) -> Reading:
        """Reading k of the unit's loop, instrument axes."""
        from filters.imu import STANDARD_GRAVITY

        rate, force = self.unit.reading(k)
        dps = np.rad2deg(self._axes.gyro_to_instrument(rate))
        g = self._axes.accel_to_instrument(force) / STANDARD_GRAVITY
        return Reading(tuple(dps), tuple(g), self.unit.temperature_degc(k))


class PlayedReadings:
    """A recording at the unit's rate.

    Slower recordings are held between samples, so that every reading was really made; faster ones are averaged
    over the unit's period. The recording ends; the unit is then silent.

    Parameters
    ----------
    t : np.ndarray
        s, shape (N,), increasing.
    values : np.ndarray
        deg/s and g, instrument axes, and degC; shape (N, 7).
    """

    def __init__(self, t: np.ndarray, values: np.ndarray) -> None:
        self._t = t - t[0]
        self._values = values
        self._sums = np.vstack([np.zeros(7), np.cumsum(values, axis=0)])

    def reading(self, k: int) -> Reading | None:
        """Reading k of the unit's loop; None after the end."""
        instant = k / LOOP_HZ
        if instant > self._t[-1]:
            return None
        # samples of the period that ends at this instant; else the last one before it
        first = int(np.searchsorted(self._t, instant - 1.0 / LOOP_HZ + 1e-9, side="right"))
        last = int(np.searchsorted(self._t, instant + 1e-9, side="right"))
        if last - first > 1:
            v = (self._sums[last] - self._sums[first]) / (last - first)
        else:
            v = self._values[max(last - 1, 0)]
        return Reading((v[0], v[1], v[2]), (v[3], v[4], v[5]), float(v[6]))


def source_of(recording: Path | None, seed: int) -> tuple[Source, str]:
    """Source of readings, and the version text under which the unit shows them."""
    if recording is None:
        return SimulatedReadings(seed), SIMULATED
    if recording.suffix.lower() == ".mcap":
        return _from_log(recording)
    from imutui.logbook import importer

    r = importer.load(recording)
    degc = r.temperature_degc if r.temperature_degc is not None else np.full(r.t.size, 25.0)
    return PlayedReadings(r.t, np.column_stack([r.gyro_dps, r.accel_g, degc])), PLAYED


def _from_log(path: Path) -> tuple[Source, str]:
    from imutui.logbook import reader

    log = reader.read(path)
    axes = log.info.axes()
    dps = np.rad2deg(axes.gyro_to_instrument(log.gyro))
    g = axes.accel_to_instrument(log.accel) / log.info.g_unit
    whole = log.temperature_degc.size == log.stamp_ns.size
    degc = log.temperature_degc if whole else np.full(log.stamp_ns.size, 25.0)
    version = SIMULATED if log.info.kind == "simulated" else PLAYED
    return PlayedReadings(log.seconds(), np.column_stack([dps, g, degc])), version
