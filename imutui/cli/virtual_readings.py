"""Readings for the virtual instrument: a simulated unit, or a recording brought to the unit's rate."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from filters.imu import STANDARD_GRAVITY
from filters.simulation import LOOP_HZ, Scenario, Unit
from imutui.instrument.virtual import FaultyLine, LineFault, Reading, Source

SIMULATED = "IMU400CD-200 VIRTUAL SIM"
PLAYED = "IMU400CD-200 VIRTUAL REC"

# fates of readings are asked for while their packets are on the line: a few readings later at the slowest speed
_REMEMBERED = 256


class SimulatedReadings:
    """A unit at one of the power-ons of a scenario.

    Parameters
    ----------
    scenario : Scenario
        Without anything in it: still, level, biases and noise of Table 1.
    power_on : int
        Which, from 0.
    """

    def __init__(self, scenario: Scenario, power_on: int = 0) -> None:
        self.unit = Unit(scenario, power_on)
        self._fates: dict[int, tuple[bool, float]] = {}

    def reading(self, k: int) -> Reading:
        """Reading k of the unit's loop, instrument axes."""
        axes = self.unit.scenario.axes
        rate, force = self.unit.reading(k)
        self._fates[k] = self.unit.lost(k), self.unit.late(k)
        if len(self._fates) > _REMEMBERED:
            del self._fates[next(iter(self._fates))]
        dps = np.rad2deg(axes.gyro_to_instrument(rate))
        g = axes.accel_to_instrument(force) / STANDARD_GRAVITY
        return Reading(tuple(dps), tuple(g), self.unit.temperature_degc(k))

    def line(self) -> FaultyLine | None:
        """What its scenario does to bytes on the wire; None where that is nothing."""
        scenario = self.unit.scenario
        faults = [LineFault(fault.at, fault.kind, fault.count, fault.seconds) for fault in scenario.faults]
        lossy = any(effect.name in ("dropout", "jitter") for effect in scenario.effects)
        return FaultyLine(faults, self._fate if lossy else None, scenario.seed) if faults or lossy else None

    def _fate(self, t: float) -> tuple[bool, float]:
        return self._fates.get(math.floor(t * LOOP_HZ + 1e-6), (False, 0.0))


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


def simulated(scenario: Path | None, power_on: int, seed: int | None) -> SimulatedReadings:
    """Readings of a scenario's file, or of a plain unit without one; a seed that is given wins over the file's."""
    from imutui.scenario import load_scenario

    what = Scenario() if scenario is None else load_scenario(scenario)
    return SimulatedReadings(what if seed is None else replace(what, seed=seed), power_on)


def played(recording: Path) -> tuple[Source, str]:
    """Source of a recording's readings, and the version text under which the unit shows them."""
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
