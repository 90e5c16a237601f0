"""Samples, temperatures, packets and table angles as columns, from batches of messages."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from mcap.records import Channel, Message, Schema

from imutui.logbook import layout, schemas
from imutui.logbook.layout import UndecodableError
from imutui.logbook.mcap_stream import CHANNEL, LENGTH, OFFSET, Batch

IGNORED, OTHER, IMU, TEMPERATURE, RAW, TABLE, STATE, ESTIMATE = range(8)
"""What a reader does with a channel's messages; those from `IMU` on become columns, of estimates the stamp alone."""
TOPICS = {
    IMU: schemas.IMU, TEMPERATURE: schemas.TEMPERATURE, RAW: schemas.RAW, TABLE: schemas.REFERENCE,
    STATE: schemas.STATE, ESTIMATE: schemas.ESTIMATE,
}  # fmt: skip
ROLES = {topic: role for role, topic in TOPICS.items()}
_PACKET: tuple[str, ...] = schemas.RAW_DTYPE.names or ()
_TABLE: dict[str, tuple[str, Any]] = {"angles_deg": ("angles_deg", "3f8"), "rates_dps": ("rates_dps", "3f8")}
_COLUMNS: dict[int, dict[str, tuple[str, Any]]] = {
    IMU: {
        "gyro": ("angular_velocity", "3f8"),
        "accel": ("linear_acceleration", "3f8"),
        "gyro_covariance": ("angular_velocity_covariance", "f8"),
        "accel_covariance": ("linear_acceleration_covariance", "f8"),
    },
    TEMPERATURE: {"degc": ("temperature", "f8")},
    RAW: {name: (name, schemas.RAW_DTYPE[name]) for name in _PACKET},
    TABLE: _TABLE,
    STATE: _TABLE | {"uncertainty_ns": ("uncertainty_ns", "i8")},
    ESTIMATE: {},
}
"""Columns of each role: the field of its messages that fills each, and its format."""
DTYPES = {
    role: np.dtype([("stamp_ns", "i8"), *((column, form) for column, (_, form) in columns.items())])
    for role, columns in _COLUMNS.items()
}
_PACKETS = (schemas.TYPES[schemas.RAW], schemas.S1_PACKET)


class Channels(ABC):
    """The channels of a file, and what its reader does with the messages of each."""

    def __init__(self) -> None:
        self.types: dict[int, str] = {}
        self.channels: dict[int, Channel] = {}
        self.columns = Columns()
        self.last_table: Message | None = None
        self._roles = np.full(2**16, IGNORED, np.uint8)

    def declare(self, record: Schema | Channel) -> None:
        """Take a declaration."""
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
        """Take a message that becomes no column; raises UndecodableError if it is not of its topic's type."""

    @abstractmethod
    def _passes_over(self, topic: str, message: Message, error: UndecodableError) -> bool:
        """Return whether to go on behind a message that cannot be decoded."""

    def messages(self, batch: Batch) -> np.ndarray:
        """Take messages in a row; returns the role of each. Raises UndecodableError at one that is not passed over.

        The messages before that one are taken.
        """
        roles: np.ndarray = self._roles[batch.table[:, CHANNEL]]
        for row in np.flatnonzero(roles == OTHER).tolist():
            message = batch.message(row)
            topic = self.channels[message.channel_id].topic
            try:
                self._other(topic, message)
            except UndecodableError as error:
                if not self._passes_over(topic, message, error):
                    self._gather(Batch(batch.content, batch.table[:row]), roles[:row])
                    raise
        self._gather(batch, roles)
        return roles

    def _gather(self, batch: Batch, roles: np.ndarray) -> None:
        found, bad = read(batch, roles)
        for row in sorted(bad):
            if not self._passes_over(self.channels[int(batch.table[row, CHANNEL])].topic, batch.message(row), bad[row]):
                self._gather(Batch(batch.content, batch.table[:row]), roles[:row])
                raise bad[row]
        self.columns.add(found)
        tables = [row for row in np.flatnonzero(roles == TABLE).tolist() if row not in bad]
        if tables:
            self.last_table = batch.message(tables[-1])


# ---------------------------------------------------------------------------------------------------------------------


def read(batch: Batch, roles: np.ndarray) -> tuple[dict[int, np.ndarray], dict[int, UndecodableError]]:
    """Return the rows of each role in a batch, and the errors of undecodable messages by their place in it."""
    found, bad = dict[int, np.ndarray](), dict[int, UndecodableError]()
    data, published = batch.data, batch.heads["publish_ns"]
    for role in TOPICS:
        which = np.flatnonzero(roles == role)
        at, length = batch.table[which, OFFSET], batch.table[which, LENGTH]
        rows, good = np.zeros(which.size, DTYPES[role]), np.ones(which.size, bool)
        rows["stamp_ns"] = published[which]
        for typename, some in _by_type(role, length):
            for k, records in layout.views(data, at[some], length[some], typename):
                if isinstance(records, UndecodableError):
                    good[some[k]] = False
                    bad[int(which[some[k[0]]])] = records
                else:
                    _fill(role, rows, some[k], records)
        if which.size:
            found[role] = rows if good.all() else rows[good]
    return found, bad


def _by_type(role: int, length: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Return the types of a role's messages with the indices of each one's; the length of a packet gives its type."""
    if role != RAW:
        return [(schemas.TYPES[TOPICS[role]], np.arange(length.size))]
    has_details = length == schemas.RAW_DTYPE.itemsize
    return list(zip(_PACKETS, (np.flatnonzero(~has_details), np.flatnonzero(has_details)), strict=True))


def _fill(role: int, rows: np.ndarray, here: np.ndarray, records: np.ndarray) -> None:
    if role != RAW:
        stamps = records["header.stamp.sec"].astype(np.int64) * 1_000_000_000 + records["header.stamp.nanosec"]
        # a header without a stamp leaves the publish time
        rows["stamp_ns"][here] = np.where(stamps != 0, stamps, rows["stamp_ns"][here])
    for column, (name, _) in _COLUMNS[role].items():
        if name in (records.dtype.names or ()):  # packets without details lack some
            # of a covariance the first element says whether there is an estimate
            rows[column][here] = records[name][:, 0] if name.endswith("covariance") else records[name]


class Columns:
    """The fields that are read of every sample, in the order of their messages."""

    def __init__(self) -> None:
        self._rows: dict[int, list[np.ndarray]] = {role: [] for role in TOPICS}

    @property
    def rows(self) -> int:
        """Number of samples or of packets, whichever are more."""
        return max(sum(map(len, self._rows[role])) for role in (IMU, RAW))

    def add(self, found: dict[int, np.ndarray]) -> None:
        """Append the rows of a batch."""
        for role, rows in found.items():
            self._rows[role].append(rows)

    def all(self, role: int) -> dict[str, np.ndarray]:
        """Return the columns of a role by name, and forget them: a day of samples is large.

        Each has `stamp_ns` (UTC, ns, int64, shape (n,)). `IMU`: `gyro` (rad/s, (n, 3)), `accel` (specific force, m/s²),
        `valid` (bool). `TEMPERATURE`: `degc`. `TABLE`: `angles_deg`, `rates_dps`; `STATE`: also `uncertainty_ns`.
        `RAW`: `packets`, records of `schemas.RAW_DTYPE`.
        """
        parts, self._rows[role] = self._rows[role], []
        rows = np.concatenate([np.empty(0, DTYPES[role]), *parts])
        if role == RAW:
            packets = np.zeros(rows.size, schemas.RAW_DTYPE)
            for name in _PACKET:
                packets[name] = rows[name]
            return {"stamp_ns": rows["stamp_ns"].copy(), "packets": packets}
        columns = {name: np.ascontiguousarray(rows[name]) for name in rows.dtype.names or ()}
        if role == IMU:
            # a covariance that begins with -1 states, in sensor_msgs/Imu, that its quantity has no estimate
            unknown = (columns.pop("gyro_covariance"), columns.pop("accel_covariance"))
            columns["valid"] = (np.array(unknown) != schemas.NO_ESTIMATE).all(axis=0)
        return columns
