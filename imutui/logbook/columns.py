"""Samples, temperatures, packets and table angles as columns, from batches of messages or one by one."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from mcap.records import Channel, Message, Schema

from imutui.logbook import schemas
from imutui.logbook.mcap_stream import CHANNEL, LENGTH, OFFSET, Batch, windows
from imutui.logbook.schemas import UndecodableError

IGNORED, OTHER, IMU, TEMPERATURE, RAW, TABLE, STATE = range(7)
"""What a channel's messages are to a reader; the last five become columns."""
RAW_SIZE, S1_SIZE = 38, schemas.RAW_DTYPE.itemsize
"""Bytes of a raw packet's message: of an IMU400CD's, and of one with details, which begins with the same fields."""
_DOUBLE = 8
# of the numbers of sensor_msgs/Imu behind its header: angular rate, specific force, the first of their covariances
_IMU_DOUBLES, _OF_IMU = 37, (13, 14, 15, 25, 26, 27, 16, 28)
_TEMPERATURE_DOUBLES, _TABLE_DOUBLES, _STATE_NUMBERS = 2, 6, 7


class Channels(ABC):
    """The channels of a file, and what the messages of each are to whoever reads them."""

    def __init__(self) -> None:
        self.types: dict[int, str] = {}
        self.channels: dict[int, Channel] = {}
        self.columns = Columns()
        self.last_table: Message | None = None
        self._roles = np.full(2**16, IGNORED, np.uint8)

    def declare(self, record: Schema | Channel) -> None:
        """Take what is said of messages."""
        if isinstance(record, Schema):
            self.types[record.id] = record.name
        else:
            self.channels[record.id] = record
            self._assign(record, self.types.get(record.schema_id, ""))

    @abstractmethod
    def _assign(self, channel: Channel, typename: str) -> None:
        """Give a channel that was declared its role."""

    @abstractmethod
    def _other(self, topic: str, message: Message) -> None:
        """Take a message that becomes no column; raises UndecodableError if it is none of its topic."""

    @abstractmethod
    def _passes_over(self, topic: str, message: Message, error: UndecodableError) -> bool:
        """Whether to go on behind a message that cannot be decoded."""

    def messages(self, batch: Batch) -> np.ndarray:
        """Take messages in a row; returns the role of each. Raises UndecodableError at one that is not passed over."""
        roles: np.ndarray = self._roles[batch.table[:, CHANNEL]]
        for row in np.flatnonzero(roles == OTHER).tolist():
            message = batch.message(row)
            topic = self.channels[message.channel_id].topic
            try:
                self._other(topic, message)
            except UndecodableError as error:
                if not self._passes_over(topic, message, error):
                    # the samples before it count, those after it don't
                    self._gather(Batch(batch.content, batch.table[:row]), roles[:row])
                    raise
        self._gather(batch, roles)
        return roles

    def _gather(self, batch: Batch, roles: np.ndarray) -> None:
        if self.columns.take(batch, roles):
            for row in np.flatnonzero(roles == TABLE)[-1:].tolist():
                self.last_table = batch.message(row)
            return
        # another program's layout, or damage: message by message, so that all before a bad one count
        for row in np.flatnonzero(roles > OTHER).tolist():
            message = batch.message(row)
            try:
                self.columns.one(int(roles[row]), message)
                self.last_table = message if roles[row] == TABLE else self.last_table
            except UndecodableError as error:
                if not self._passes_over(self.channels[message.channel_id].topic, message, error):
                    raise


class Columns:
    """The fields that are read of every sample, in the order of their messages.

    A row is the stamp and the bits of the numbers, uint64; of a packet, its bytes.
    """

    def __init__(self) -> None:
        self._parts: dict[int, list[np.ndarray]] = {
            role: [np.empty((0, width), dtype)]
            for role, width, dtype in (
                (IMU, 9, np.uint64), (TEMPERATURE, 2, np.uint64), (RAW, S1_SIZE, np.uint8), (TABLE, 7, np.uint64),
                (STATE, 8, np.uint64),
            )
        }  # fmt: skip
        self._packet_stamps: list[np.ndarray] = [np.empty(0, np.int64)]

    @property
    def rows(self) -> int:
        """Samples or packets, whichever are more."""
        return max(sum(map(len, self._parts[role])) for role in (IMU, RAW))

    def take(self, batch: Batch, roles: np.ndarray) -> bool:
        """Take the messages of a batch that become columns, if all of them are plain.

        `batch`: messages.
        `roles`: role of each, shape (n,).
        Returns false if some message has another layout than the plain one; then none is taken.
        """
        data, found = batch.data, {}
        for role, gather in _GATHER.items():
            table = batch.table[roles == role]
            if len(table):
                rows = gather(data, table[:, OFFSET], table[:, LENGTH])
                if rows is None:
                    return False
                found[role] = rows
        for role, rows in found.items():
            self._parts[role].append(rows)
        if RAW in found:
            self._packet_stamps.append(batch.heads["publish_ns"][roles == RAW])
        return True

    def one(self, role: int, message: Message) -> None:
        """One message of any layout that rosbags can decode; raises UndecodableError if it is none."""
        self._parts[role].append(_DECODE[role](message)[None])
        if role == RAW:
            self._packet_stamps.append(np.array([message.publish_time]))

    def imu(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Stamps (ns, int64, (N,)), angular rate (rad/s, (N, 3)), specific force (m/s², (N, 3)), validity (bool, (N,)).

        A covariance that begins with -1 says, in sensor_msgs/Imu, that there is no estimate of its quantity. To be
        asked once: what was collected is given up for it, part by part, since a day of samples is large.
        """
        parts = self._parts[IMU]
        n = sum(map(len, parts))
        stamps, valid = np.empty(n, np.int64), np.empty(n, bool)
        gyro, accel = np.empty((n, 3)), np.empty((n, 3))
        first = 0
        parts.reverse()
        while parts:
            part = parts.pop()
            rows, values = slice(first, first + len(part)), part.view(np.float64)
            stamps[rows] = part[:, 0].view(np.int64)
            gyro[rows], accel[rows] = values[:, 1:4], values[:, 4:7]
            valid[rows] = (values[:, 7:9] != schemas.NO_ESTIMATE).all(axis=1)
            first += len(part)
        return stamps, gyro, accel, valid

    def temperatures(self) -> tuple[np.ndarray, np.ndarray]:
        """Stamps (ns, int64, (M,)) and degC (M,)."""
        rows = np.concatenate(self._parts[TEMPERATURE])
        return rows[:, 0].astype(np.int64), rows[:, 1].copy().view(np.float64)

    def tables(self, role: int = TABLE) -> tuple[np.ndarray, ...]:
        """Stamps (ns, int64, (L,)), angles (deg, (L, 3)) and rates (deg/s, (L, 3)), of `TABLE` or `STATE`.

        Of `STATE` the uncertainty of the stamps too, ns, int64, (L,).
        """
        rows = np.concatenate(self._parts[role])
        numbers = rows[:, 1:4].copy().view(np.float64), rows[:, 4:7].copy().view(np.float64)
        return rows[:, 0].astype(np.int64), *numbers, *rows[:, 7:].astype(np.int64).T

    def packets(self) -> np.ndarray:
        """Records of `schemas.RAW_DTYPE`, shape (K,)."""
        return np.concatenate(self._parts[RAW]).view(schemas.RAW_DTYPE)[:, 0]

    def packet_stamps(self) -> np.ndarray:
        """When each packet was sampled, UTC, ns, int64, shape (K,)."""
        return np.concatenate(self._packet_stamps).astype(np.int64)


# ------------------------------------------------------------------------------------------------- messages of a batch
# Of messages whose bytes begin at `at` and are `length` long, rows of a column; None if the layout of one is not the
# plain one: CDR, little endian; std_msgs/Header with an ASCII frame_id of any length; then so many float64.


def _gather_imu(data: np.ndarray, at: np.ndarray, length: np.ndarray) -> np.ndarray | None:
    numbers = _numbers(data, at, length, _IMU_DOUBLES)
    return None if numbers is None else np.column_stack([_stamps(data, at), numbers[:, _OF_IMU]])


def _gather_temperature(data: np.ndarray, at: np.ndarray, length: np.ndarray) -> np.ndarray | None:
    numbers = _numbers(data, at, length, _TEMPERATURE_DOUBLES)
    return None if numbers is None else np.column_stack([_stamps(data, at), numbers[:, :1]])


def _gather_table(data: np.ndarray, at: np.ndarray, length: np.ndarray) -> np.ndarray | None:
    """With one more string between the header and the numbers."""
    if not _begins(data, at, length):
        return None
    text = _uint32(data, at + 12)
    kind = (12 + text + 3) // 4 * 4
    if ((text < 1) | (4 + kind + 4 > length)).any():
        return None
    letters = _uint32(data, at + 4 + kind)
    body = at + 4 + (kind + 4 + letters + 7) // _DOUBLE * _DOUBLE
    if ((letters < 1) | (body + _TABLE_DOUBLES * _DOUBLE != at + length)).any():
        return None
    return np.column_stack([_stamps(data, at), windows(data, body, _TABLE_DOUBLES * _DOUBLE).view("<u8")])


def _gather_state(data: np.ndarray, at: np.ndarray, length: np.ndarray) -> np.ndarray | None:
    """Numbers right behind the header, the uncertainty of the stamp among them; what follows them is not read."""
    if not _begins(data, at, length):
        return None
    body = at + 4 + (12 + _uint32(data, at + 12) + 7) // _DOUBLE * _DOUBLE
    if (body + _STATE_NUMBERS * _DOUBLE > at + length).any():
        return None
    return np.column_stack([_stamps(data, at), windows(data, body, _STATE_NUMBERS * _DOUBLE).view("<u8")])


def _gather_raw(data: np.ndarray, at: np.ndarray, length: np.ndarray) -> np.ndarray | None:
    rows = np.zeros((at.size, S1_SIZE), np.uint8)
    for size in set(length.tolist()):
        if size not in (RAW_SIZE, S1_SIZE):
            return None
        rows[length == size, :size] = windows(data, at[length == size], size)
    return rows


def _begins(data: np.ndarray, at: np.ndarray, length: np.ndarray) -> bool:
    """Whether messages have a header, and are CDR, little endian."""
    return bool((length >= 16).all()) and bool(((data[at] == 0) & (data[at + 1] == 1)).all())


def _numbers(data: np.ndarray, at: np.ndarray, length: np.ndarray, doubles: int) -> np.ndarray | None:
    """Bits of the numbers behind a header, uint64, shape (n, doubles)."""
    if not _begins(data, at, length):
        return None
    text = _uint32(data, at + 12)
    # float64 are aligned to 8 bytes counted from after the encapsulation's 4
    body = at + 4 + (12 + text + 7) // _DOUBLE * _DOUBLE
    if ((text < 1) | (16 + text > length) | (body + doubles * _DOUBLE != at + length)).any():
        return None
    for size in set(text.tolist()):
        if (windows(data, at[text == size] + 16, size) > 127).any():
            return None
    return windows(data, body, doubles * _DOUBLE).view("<u8")


def _uint32(data: np.ndarray, at: np.ndarray) -> np.ndarray:
    return windows(data, at, 4).view("<u4")[:, 0].astype(np.int64)


def _stamps(data: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Stamps of messages, ns, as uint64: the header's; of a header without one, the publish time before the data."""
    seconds, rest = windows(data, at + 4, 4).view("<i4")[:, 0].astype(np.int64), _uint32(data, at + 8)
    stamps = seconds * 1_000_000_000 + rest
    return np.where(stamps != 0, stamps, windows(data, at - 8, 8).view("<i8")[:, 0]).view(np.uint64)


_GATHER: dict[int, Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray | None]] = {
    IMU: _gather_imu,
    TEMPERATURE: _gather_temperature,
    RAW: _gather_raw,
    TABLE: _gather_table,
    STATE: _gather_state,
}


# ------------------------------------------------------------------------------------------------------- one by one


def _imu_row(message: Message) -> np.ndarray:
    m = schemas.decode(schemas.TYPES[schemas.IMU], message.data)
    w, f = m.angular_velocity, m.linear_acceleration
    unknown = (m.angular_velocity_covariance[0], m.linear_acceleration_covariance[0])
    return _row(m.header, message, [w.x, w.y, w.z, f.x, f.y, f.z, *unknown])


def _temperature_row(message: Message) -> np.ndarray:
    m = schemas.decode(schemas.TYPES[schemas.TEMPERATURE], message.data)
    return _row(m.header, message, [m.temperature])


def _table_row(message: Message) -> np.ndarray:
    m = schemas.decode(schemas.TYPES[schemas.REFERENCE], message.data)
    return _row(m.header, message, [*m.angles_deg, *m.rates_dps])


def _state_row(message: Message) -> np.ndarray:
    m = schemas.decode(schemas.TYPES[schemas.STATE], message.data)
    return np.append(_row(m.header, message, [*m.angles_deg, *m.rates_dps]), np.uint64(m.uncertainty_ns))


def _raw_row(message: Message) -> np.ndarray:
    schemas.decode_raw(message.data)  # its type has one layout only
    return np.frombuffer(message.data.ljust(S1_SIZE, b"\0"), np.uint8)


def _row(header: Any, message: Message, numbers: list[float]) -> np.ndarray:
    """The message's own stamp, else when it was published, int64, ns, and numbers, as bits."""
    stamp = schemas.stamp_ns(header) or message.publish_time
    if stamp >= 2**63:
        raise UndecodableError(f"its publish_time, {stamp}, is none")
    return np.concatenate([np.array([stamp], np.int64).view(np.uint64), np.array(numbers, float).view(np.uint64)])


_DECODE = {IMU: _imu_row, TEMPERATURE: _temperature_row, RAW: _raw_row, TABLE: _table_row, STATE: _state_row}
