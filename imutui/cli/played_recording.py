"""A recording as the virtual instrument plays it: at the unit's rate, by itself or under what a scenario adds."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from filters.channels import DPS
from filters.imu import STANDARD_GRAVITY, AxisMap
from filters.motion.kinematics import attitudes
from filters.simulation import LOOP_HZ
from filters.simulation.background import (
    Background,
    RecordedMotion,
    RecordedTemperature,
    at_rest,
    from_angles,
    from_attitudes,
)
from filters.state import Site
from imutui.instrument.virtual_instrument import Reading

# what a recording without temperature is said to have where nothing else says it
_ROOM_DEGC = 25.0
_OWN_MOTION = ("profile", "trajectory")


@dataclass(frozen=True, slots=True)
class PlayedRecording:
    """A recording in the instrument's axes and sign."""

    name: str  # of its file
    t: np.ndarray  # s since the part that is played begins, shape (N,), increasing
    values: np.ndarray  # deg/s and g, shape (N, 6)
    degc: np.ndarray | None  # shape (N,); None if it has no temperature
    simulated: bool  # whether it says that no sensor made it
    motion: RecordedMotion | None  # where it says how it moved

    def background(self, site: Site, rate_hz: float = LOOP_HZ) -> Background:
        """The recording as what a scenario adds to; without a motion of its own it is at rest."""
        readings = PlayedReadings(self.t, self.values, self.degc, rate_hz)
        unit = np.repeat([DPS, STANDARD_GRAVITY], 3)
        motion = self.motion if self.motion is not None else at_rest(self.values[:, 3:] * STANDARD_GRAVITY, site)
        temperature = None if self.degc is None else RecordedTemperature(self.t, self.degc)
        return Background(lambda t: readings.at(t)[:, :6] * unit, motion, temperature)


class PlayedReadings:
    """A recording at the unit's rate.

    Slower recordings are held between samples, so that every reading was really made; faster ones are averaged
    over the unit's period. The recording ends; the unit is then silent.

    `t`: s, shape (N,), increasing.
    `values`: deg/s and g, instrument axes, shape (N, 6).
    `degc`: shape (N,).
    `rate_hz`: rate of the unit's loop.
    """

    def __init__(self, t: np.ndarray, values: np.ndarray, degc: np.ndarray | None, rate_hz: float = LOOP_HZ) -> None:
        self._rate_hz = rate_hz
        self._t = t - t[0]
        self._values = np.column_stack([values, np.full(t.size, _ROOM_DEGC) if degc is None else degc])
        self._sums = np.vstack([np.zeros(7), np.cumsum(self._values, axis=0)])

    def reading(self, k: int) -> Reading | None:
        """Reading k of the unit's loop; None after the end."""
        v = self.at(np.array([k / self._rate_hz]))[0].tolist()
        return Reading((v[0], v[1], v[2]), (v[3], v[4], v[5]), v[6]) if v[0] == v[0] else None

    def at(self, instants: np.ndarray) -> np.ndarray:
        """Readings at times of the loop, s, shape (M,): deg/s, g, degC, shape (M, 7); NaN after the end."""
        # samples of the period that ends at the instant; else the last one before it
        first = np.searchsorted(self._t, instants - 1.0 / self._rate_hz + 1e-9, side="right")
        last = np.searchsorted(self._t, instants + 1e-9, side="right")
        count = (last - first)[:, None]
        mean = (self._sums[last] - self._sums[first]) / np.maximum(count, 1)
        out = np.where(count > 1, mean, self._values[np.maximum(last - 1, 0)])
        out[instants > self._t[-1]] = np.nan
        return out


def load(path: Path, start: float, axes: AxisMap, site: Site) -> PlayedRecording:
    """A recording from a log, or from an NPZ or CSV file.

    `start`: where in it to begin, s after its first sample.
    `axes`: of the unit that plays it. A log of a known instrument is played in the unit's own sign; for the motion that
      an NPZ or CSV file knows the sign that fits its readings is taken.
    Raises UnreadableLogError, ImportDataError if there is nothing to play.
    """
    if path.suffix.lower() == ".mcap":
        return _from_log(path, start, axes.accel_sign)
    from imutui.logbook.importing import recording

    r = recording.load(path)
    samples = r.whole()
    t = samples.t
    _check_start(path, start, t)
    part = slice(int(np.searchsorted(t, start)), None)
    t = t[part] - t[part][0]
    known = {name: values[part] for name, values in r.known.items()}
    motion = _known_motion(t, known, samples.accel_g[part], axes, site)
    degc = samples.temperature_degc[part] if np.isfinite(samples.temperature_degc).all() else None
    return PlayedRecording(path.name, t, np.hstack([samples.gyro_dps, samples.accel_g])[part], degc, False, motion)


def _from_log(path: Path, start: float, accel_sign: int) -> PlayedRecording:
    from imutui.instrument import registry
    from imutui.jobs.log_motion import motion_of
    from imutui.logbook import reader
    from imutui.logbook.reading import Reading

    log = reader.read(path)
    t = log.seconds()
    _check_start(path, start, t)
    part = t >= start
    axes, model = log.info.axes(), log.info.instrument
    if registry.is_known(model) and registry.of_model(model).accel_sign == axes.accel_sign:
        # what another kind of unit would have read
        axes = replace(axes, accel_sign=accel_sign)
    dps = np.rad2deg(axes.gyro_to_instrument(log.samples.gyro))
    g = axes.accel_to_instrument(log.samples.accel) / log.info.g_unit
    motion = None
    if log.info.reference in _OWN_MOTION:
        known = motion_of(log, log.info, Reading())
        angles, rates = np.broadcast_to(known.angles, (t.size, 3)), np.broadcast_to(known.rates, (t.size, 3))
        told = part & np.isfinite(angles).all(axis=1) & np.isfinite(rates).all(axis=1)
        if known.unknown is not None:
            told &= ~known.unknown
        if told.any():
            begin = t[part][0]
            motion = from_angles(t[told] - begin, angles[told], rates[told], axes, log.info.site())
    degc = log.samples.degc[part] if np.isfinite(log.samples.degc).all() else None
    simulated = log.info.kind == "simulated"
    return PlayedRecording(path.name, t[part] - t[part][0], np.hstack([dps, g])[part], degc, simulated, motion)


def _check_start(path: Path, start: float, t: np.ndarray) -> None:
    from imutui.logbook.importing.table import ImportDataError

    if np.count_nonzero(t >= start) < 2:
        raise ImportDataError(f"{path} lasts {t[-1]:.1f} s: nothing of it is left from {start:g} s on (--from-start).")


def _known_motion(
    t: np.ndarray, known: dict[str, np.ndarray], accel_g: np.ndarray, axes: AxisMap, site: Site
) -> RecordedMotion | None:
    """Motion that a recording's own arrays say, `ang` before `ref_quat`; None where they say nothing."""
    from imutui.logbook.import_reference import body_attitude

    name = next((name for name in ("ang", "ref_quat") if name in known), None)
    told = np.zeros(t.size, bool) if name is None else np.isfinite(known[name]).all(axis=1)
    if name is None or np.count_nonzero(told) < 2:
        return None
    rows = t[told]
    if name == "ang":
        angles = np.unwrap(np.deg2rad(known["ang"][told]), axis=0)
        C_nb = attitudes(angles)
        rates = np.deg2rad(known["rate"][told]) if "rate" in known else np.gradient(angles, rows, axis=0)
    else:
        # in the instrument's own axes, so that no mounting is needed
        axes = AxisMap()
        C_nb = body_attitude(known["ref_quat"][told], axes.mount)
    force = np.swapaxes(C_nb, 1, 2) @ np.array([0.0, 0.0, -1.0])
    sign = 1 if float(np.sum(accel_g[told] * (force @ axes.mount))) > 0.0 else -1
    axes = AxisMap(axes.mount, sign, axes.gyro_sign)
    if name == "ang":
        return from_angles(rows, angles, np.nan_to_num(rates), axes, site)
    return from_attitudes(rows, C_nb, axes, site)
