"""Samples, temperatures, packets and table angles as columns that grow, from batches of messages or one by one."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from mcap.records import Message

from imutui.logbook import message_layout, schemas
from imutui.logbook.mcap_stream import Batch
from imutui.logbook.record_walk import Walk

_BLOCK = 2**19
"""Rows. Of samples 38 MB, which the C library gives back to the system when they are let go; smaller ones it keeps."""


class Growing:
    """Rows of one kind of message, in blocks: what is there never moves.

    `width`: elements in a row.
    `dtype`: of an element.
    """

    def __init__(self, width: int, dtype: type) -> None:
        self._blocks: list[np.ndarray] = [np.empty((0, width), dtype)]
        self._filled = 0

    def room(self, more: int) -> np.ndarray:
        """So many rows after the last, to be filled, shape (more, width)."""
        block = self._blocks[-1]
        if self._filled + more > len(block):
            self._blocks[-1] = block[: self._filled]
            self._blocks.append(np.empty((max(more, _BLOCK), block.shape[1]), block.dtype))
            self._filled = 0
        return self._blocks[-1][self._filled : self._filled + more]

    def keep(self, more: int) -> None:
        """Take rows given by `room` as filled."""
        self._filled += more

    def columns(self, first: int, last: int) -> np.ndarray:
        """Columns from `first` up to `last` of all rows, shape (N, last - first)."""
        *whole, latest = self._blocks
        return np.concatenate([block[:, first:last] for block in (*whole, latest[: self._filled])])

    def given_up(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Blocks with the rows that they are, each let go when the next is asked for: a day of samples is large."""
        self._blocks[-1] = self._blocks[-1][: self._filled]
        first = 0
        self._blocks.reverse()
        while self._blocks:
            block = self._blocks.pop()
            yield slice(first, first + len(block)), block
            first += len(block)
        self._blocks, self._filled = [block[:0]], 0

    def __len__(self) -> int:
        return sum(len(block) for block in self._blocks[:-1]) + self._filled


class Columns:
    """The fields that are read of every sample.

    `walk`: how they are copied out of bytes.
    """

    def __init__(self, walk: Walk) -> None:
        self._gather = walk.gather
        self._imu = Growing(9, np.uint64)
        self._temperature = Growing(2, np.uint64)
        self._raw = Growing(message_layout.S1_SIZE, np.uint8)
        self._table = Growing(7, np.uint64)

    @property
    def rows(self) -> int:
        """Samples or packets, whichever are more."""
        return max(len(self._imu), len(self._raw))

    def take(self, batch: Batch, roles: np.ndarray, counts: np.ndarray) -> bool:
        """Take the samples, temperatures, packets and table angles of a batch, if all are plain.

        `batch`: messages.
        `roles`: role of each channel id, uint8, shape (65536,).
        `counts`: how many of the messages have each role, see `Walk.tally`.
        Returns false if some message has another layout than the plain one; then none is taken.
        """
        _, _, imu, temperature, raw, table = counts.tolist()
        rooms = self._imu.room(imu), self._temperature.room(temperature), self._raw.room(raw), self._table.room(table)
        if not self._gather(batch.data, batch.table, roles, *rooms):
            return False
        self._imu.keep(imu)
        self._temperature.keep(temperature)
        self._raw.keep(raw)
        self._table.keep(table)
        return True

    def sample(self, message: Message) -> None:
        """One Imu message of any layout that rosbags can decode."""
        m = schemas.decode(schemas.TYPES[schemas.IMU], message.data)
        w, f = m.angular_velocity, m.linear_acceleration
        row = self._imu.room(1)
        row[0, 0] = _stamp(m.header, message)
        unknown = (m.angular_velocity_covariance[0], m.linear_acceleration_covariance[0])
        row[0, 1:] = np.array([w.x, w.y, w.z, f.x, f.y, f.z, *unknown]).view(np.uint64)
        self._imu.keep(1)

    def temperature(self, message: Message) -> None:
        """One Temperature message of any layout."""
        m = schemas.decode(schemas.TYPES[schemas.TEMPERATURE], message.data)
        row = self._temperature.room(1)
        row[0, 0] = _stamp(m.header, message)
        row[0, 1] = np.float64(m.temperature).view(np.uint64)
        self._temperature.keep(1)

    def packet(self, message: Message) -> None:
        """One raw packet, whose type has one layout only."""
        schemas.decode_raw(message.data)
        row = self._raw.room(1)[0]
        row[:] = 0
        row[: len(message.data)] = np.frombuffer(message.data, np.uint8)
        self._raw.keep(1)

    def table(self, message: Message) -> None:
        """One TableReference of any layout."""
        m = schemas.decode(schemas.TYPES[schemas.REFERENCE], message.data)
        row = self._table.room(1)
        row[0, 0] = _stamp(m.header, message)
        row[0, 1:] = np.concatenate([m.angles_deg, m.rates_dps]).astype(np.float64).view(np.uint64)
        self._table.keep(1)

    def imu(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Stamps (ns, int64, (N,)), angular rate (rad/s, (N, 3)), specific force (m/s², (N, 3)), validity (bool, (N,)).

        A covariance that begins with -1 says, in sensor_msgs/Imu, that there is no estimate of its quantity. To be
        asked once: what was collected is given up for it.
        """
        n = len(self._imu)
        stamps, valid = np.empty(n, np.int64), np.empty(n, bool)
        gyro, accel = np.empty((n, 3)), np.empty((n, 3))
        for rows, block in self._imu.given_up():
            values = block.view(np.float64)
            stamps[rows] = block[:, 0].view(np.int64)
            gyro[rows], accel[rows] = values[:, 1:4], values[:, 4:7]
            valid[rows] = (values[:, 7:9] != schemas.NO_ESTIMATE).all(axis=1)
        return stamps, gyro, accel, valid

    def temperatures(self) -> tuple[np.ndarray, np.ndarray]:
        """Stamps (ns, int64, (M,)) and degC (M,)."""
        stamps, values = (self._temperature.columns(column, column + 1)[:, 0] for column in range(2))
        return stamps.view(np.int64), values.view(np.float64)

    def tables(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stamps (ns, int64, (L,)), angles (deg, (L, 3)) and rates (deg/s, (L, 3))."""
        angles, rates = (self._table.columns(first, first + 3).view(np.float64) for first in (1, 4))
        return self._table.columns(0, 1)[:, 0].view(np.int64), angles, rates

    def packets(self) -> np.ndarray:
        """Records of `schemas.RAW_DTYPE`, shape (K,)."""
        return self._raw.columns(0, message_layout.S1_SIZE).view(schemas.RAW_DTYPE)[:, 0]


def _stamp(header: Any, message: Message) -> np.uint64:
    """Stamp of a message as its column keeps it: the message's own, else when it was published; int64, ns."""
    stamp = schemas.stamp_ns(header) or message.publish_time
    if stamp >= 2**63:
        raise schemas.UndecodableError(f"its publish_time, {stamp}, is none")
    return np.int64(stamp).view(np.uint64)
