"""What a log's trajectory knows, at its samples, in the names and axes of an imported recording; NaN elsewhere."""

import numpy as np

from filters import attitude
from filters.motion.reference import Trajectory
from filters.types import Array
from imutui.logbook.export.columns import Block, Column

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
