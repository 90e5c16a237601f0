"""The samples that the estimator takes, as `imutui import` reads them: its names, units, axes and sign."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from filters import attitude
from filters.errors import InputError
from filters.imu import STANDARD_GRAVITY, AxisMap
from filters.motion.reference import Trajectory
from filters.types import Array
from imutui.command_line import joined
from imutui.logbook import pieces, reference_file
from imutui.logbook.export.formats import Block, Column, Table
from imutui.logbook.pieces import Outline
from imutui.logbook.reader import Log, UnreadableLogError, seconds_since
from imutui.logbook.reference_file import ATTACHMENTS
from imutui.logbook.samples import Held, Samples
from imutui.logbook.session_info import SessionInfo

_KNOWN_MOTION = ("profile", "trajectory")
DEFAULTS = SessionInfo()


def table(known: Outline, start: float | None = None, end: float | None = None, rows: int = pieces.ROWS) -> Table:
    """Samples of a log, those without a reading left out.

    `known`: of the log.
    `start`, `end`: part to take, s since its first sample.
    `rows`: about so many in a block.
    Raises InputError if the log has no sample in that part.
    """
    path = known.log.path
    seconds = seconds_since(known.last_ns, known.first_ns)
    if (start or 0.0) > seconds or (end is not None and end < (start or 0.0)):
        raise InputError(f"{path}: --start and --end leave no sample; the log lasts {seconds:.3f} s.")
    info = session_of(known.log)
    columns = [Column("t", "s"), Column("gyro", "deg/s", 3), Column("accel", "g", 3)]
    columns += [Column("temp", "degC")] if np.isfinite(known.first_temperature) else []
    if info.reference in _KNOWN_MOTION:
        columns += [Column("ang", "deg", 3)] if known.has_angles else []
        columns += [Column("rate", "deg/s", 3)] if known.has_rates else []
    names = [column.name for column in columns]
    motion = _known_motion(known, info)
    columns += [] if motion is None else motion.columns
    return Table(
        tuple(columns), lambda: _blocks(known, names, motion, start, end, rows), _about(known), lambda: known.log.damage
    )


def session_of(log: Log) -> SessionInfo:
    """Return the session of a log as a replay has it."""
    return log.info if log.reference is None else replace(log.info, reference=log.reference)


def _known_motion(known: Outline, info: SessionInfo) -> "KnownMotion | None":
    found = attached_reference(known)
    if info.reference != "trajectory" or found is None:
        return None
    try:
        motion = reference_file.parse(f"reference{found[0]}", found[1])
    except InputError as error:
        raise UnreadableLogError(f"{known.log.path}: its trajectory cannot be read: {error}") from error
    if not isinstance(motion, Trajectory):
        return None
    return KnownMotion(motion, info.axes().mount, has_angles=known.has_angles)


def attached_reference(known: Outline) -> tuple[str, bytes] | None:
    """Suffix and content of the file that the log's motion comes from, if it comes from one."""
    for name in ATTACHMENTS:
        if name in known.log.attachments:
            return Path(name).suffix, known.log.attachments[name]
    return None


def import_flags(info: SessionInfo) -> list[str]:
    """What `imutui import` has to be told to make the same log again, but for a reference that is a file."""
    flags = ["--accel-sign", f"{info.accel_sign:+d}"]
    for flag, value, usual in (("--mount", info.mount, DEFAULTS.mount),
                               ("--gyro-sign", info.gyro_sign, DEFAULTS.gyro_sign)):  # fmt: skip
        flags += [flag, value] if value != usual else []
    site = ",".join(repr(value) for value in (info.latitude_deg, info.longitude_deg, info.height_m))
    flags += ["--site", site, "--gravity", repr(info.gravity_mps2)] if info.site_stated else []
    flags += ["--reference", info.reference] if info.reference not in _KNOWN_MOTION else []
    flags += ["--units", "t:s"] if info.rate_hz < 0.5 else []
    flags += ["--instrument", info.instrument] if info.instrument else []
    return [*flags, "--kind", info.kind]


def _about(known: Outline) -> dict[str, str]:
    info = session_of(known.log)
    said = {
        "log": known.log.path.name,
        "kind": info.kind,
        "instrument": info.instrument,
        "serial_number": info.serial_number,
        # a recording made elsewhere does not say when it was made
        "first_sample_utc": "" if info.sampling == "imported" else f"{np.datetime64(known.first_ns, 'ns')}Z",
        "axes": "the instrument's own, with its own sign",
        "import": joined(*import_flags(info)),
    }
    if info.g_unit != STANDARD_GRAVITY:
        said["g_unit"] = f"{info.g_unit!r} m/s^2 (import: instrument.g_unit in imutui.toml)"
    return {name: value for name, value in said.items() if value}


def _blocks(
    known: Outline, names: list[str], motion: "KnownMotion | None", start: float | None, end: float | None, rows: int
) -> Iterator[Block]:
    info = session_of(known.log)
    before = -np.inf
    held = Held(6)
    for every, moved in pieces.pieces(known, rows):
        held.take(moved.stamp_ns, np.hstack([moved.angles_deg, moved.rates_dps]))
        t = seconds_since(every.stamp_ns, known.first_ns)
        wanted = every.valid & (t >= (start or 0.0)) & (t <= (np.inf if end is None else end))
        if not wanted.any():
            continue
        t, some = t[wanted], every.rows(wanted)
        columns = _columns(some, held.at(some.stamp_ns), info, t)
        block = {name: column for name, column in columns.items() if name in names}
        if motion is not None:
            # what was known before a part begins is none of its first sample's
            block |= motion.at(t, before if np.isfinite(before) else t[0] - 1.0 / info.rate_hz)
        before = float(t[-1])
        yield block


def _columns(some: Samples, motion: Array, info: SessionInfo, t: Array) -> Block:
    return {
        "t": info.clock_s + t,
        "gyro": dps_of(some.gyro, info.axes()),
        "accel": g_of(some.accel, info.axes(), info.g_unit),
        "temp": some.degc,
        "ang": motion[:, :3],
        "rate": motion[:, 3:],
    }


def dps_of(gyro: Array, axes: AxisMap) -> Array:
    """Readings in the instrument's axes, deg/s, of angular rates in body axes, rad/s, both (N, 3)."""
    rate = axes.gyro_to_instrument(gyro)
    return _back_to(rate, np.rad2deg(rate), np.deg2rad)


def g_of(accel: Array, axes: AxisMap, g_unit: float) -> Array:
    """Readings in the instrument's axes and sign, g, of specific force in body axes, m/s², both (N, 3)."""
    force = axes.accel_to_instrument(accel)
    return _back_to(force, force / g_unit, lambda reading: reading * g_unit)


def _back_to(wanted: Array, reading: Array, forward: Callable[[Array], Array]) -> Array:
    """Readings that `import` makes the very same samples of, where a number of the next to the last bit does so."""
    for other in (np.nextafter(reading, -np.inf), np.nextafter(reading, np.inf)):
        better = np.abs(forward(other) - wanted) < np.abs(forward(reading) - wanted)
        reading = np.where(better, other, reading)
    return reading


# ------------------------------------------------------------------------------------------------------- known motion
# What a log's trajectory knows, at its samples, in the names and axes of an imported recording; NaN elsewhere.

_NED_OF_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_SAME_S = 1e-6
_POSITION, _VELOCITY, _ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)


class KnownMotion:
    """Rows of a trajectory, each at the first sample from its time on.

    `trajectory`: the log's own.
    `mount`: M from instrument to body axes, shape (3, 3).
    `has_angles`: whether a table's angles are exported: they are its attitude, and its place is the site.
    """

    def __init__(self, trajectory: Trajectory, mount: Array, *, has_angles: bool) -> None:
        self._t = trajectory.t
        values = trajectory.values
        moves = not has_angles or bool(np.nanmax(np.ptp(values[:, _POSITION], axis=0), initial=0.0) > 0.0)
        columns: dict[Column, Array] = {}
        if not has_angles and np.linalg.det(mount) > 0.0:  # no rotation leads from mirrored axes
            columns[Column("ref_quat", "1", 4)] = _quaternions(values[:, _ATTITUDE], mount)
        if moves:
            columns[Column("gps_pos", "deg, deg, m", 3)] = values[:, _POSITION] * [180.0 / np.pi, 180.0 / np.pi, 1.0]
            columns[Column("gps_vel_ned", "m/s", 3)] = values[:, _VELOCITY]
        self._rows = {column: rows for column, rows in columns.items() if np.isfinite(rows).any()}

    @property
    def columns(self) -> list[Column]:
        """Those that have values."""
        return list(self._rows)

    def at(self, t: Array, before: float) -> Block:
        """Columns at samples, s since the log's first, of which the last one before stands at `before`."""
        rows = np.flatnonzero((self._t > before + _SAME_S) & (self._t <= t[-1] + _SAME_S))
        where = np.minimum(np.searchsorted(t, self._t[rows] - _SAME_S), t.size - 1)
        block: Block = {}
        for column, values in self._rows.items():
            out = np.full((t.size, column.width), np.nan)
            out[where] = values[rows]
            block[column.name] = out
        return block


def _quaternions(rpy: Array, mount: Array) -> Array:
    """w, x, y, z from instrument to east-north-up, shape (N, 4), of roll, pitch, yaw of the body, rad, (N, 3)."""
    C_nb = attitude.from_rpys(np.nan_to_num(rpy))
    quaternion = attitude.to_quaternion(_NED_OF_ENU.T @ C_nb @ mount)
    known = np.isfinite(rpy).all(axis=1, keepdims=True)
    return np.where(known, quaternion, np.nan)
