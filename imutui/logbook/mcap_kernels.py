"""Compiled walks over MCAP records and the fields of our fixed messages; knows bytes, neither files nor libraries.

Imported only for logs so long that loading the compiler pays; `record_walk` says the same without it.
"""

import numpy as np
from numba import njit

from imutui.logbook.message_layout import (
    DOUBLE,
    FORCE,
    FORCE_COVARIANCE,
    HEADER_SIZE,
    IMU,
    IMU_DOUBLES,
    MESSAGE_HEADER_SIZE,
    MESSAGE_OPCODE,
    OTHER,
    RATE,
    RATE_COVARIANCE,
    RAW,
    RAW_SIZE,
    ROLES,
    S1_SIZE,
    TABLE,
    TABLE_DOUBLES,
    TEMPERATURE,
    TEMPERATURE_DOUBLES,
    RecordTable,
)

LAYOUT_CRC = 0x88F1222D
"""Of the numbers above. They are compiled in, and numba's cache notices a change of this file alone: it has to change
with them, and a test says so."""


@njit(cache=True)
def _uint(data, at, size):  # type: ignore[no-untyped-def]
    value = np.uint64(0)
    for i in range(size):
        value |= np.uint64(data[at + i]) << np.uint64(8 * i)
    return value


def end_of_whole(data: np.ndarray, limit: int) -> int:
    """Where the first record begins that is not whole, or is longer than `limit`; the end if there is none."""
    return int(_count(data, limit)[1])


@njit(cache=True)
def _count(data, limit):  # type: ignore[no-untyped-def]
    """How many whole records lie in bytes, and where the first one begins that is not."""
    n, at, end = 0, np.int64(0), data.size
    while at + HEADER_SIZE <= end:
        length = _uint(data, at + 1, 8)
        if length > np.uint64(limit) or at + HEADER_SIZE + np.int64(length) > end:
            break
        at += HEADER_SIZE + np.int64(length)
        n += 1
    return n, at


def tabulate(data: np.ndarray, limit: int, wanted: np.ndarray) -> RecordTable:
    """Opcode, channel, offset and length of the whole records whose opcode is wanted.

    `data`: bytes, uint8.
    `limit`: longest record, bytes.
    `wanted`: of each opcode, bool, shape (256,).
    """
    n, end = _count(data, limit)
    table = np.empty((n, 4), np.int64)
    rows, others, short = _fill(data, wanted, table)
    return RecordTable(table[:rows], end, others, short)


@njit(cache=True)
def _fill(data, wanted, table):  # type: ignore[no-untyped-def]
    """Fill a table from its first row on; returns rows filled, and `others` and `short` of `RecordTable`."""
    at, rows, others, short = np.int64(0), 0, 0, 0
    for _ in range(table.shape[0]):
        opcode, length = data[at], np.int64(_uint(data, at + 1, 8))
        at += HEADER_SIZE
        if wanted[opcode]:
            channel, offset, size = np.int64(-1), at, length
            if opcode != MESSAGE_OPCODE:
                others += 1
            elif length < MESSAGE_HEADER_SIZE:
                short += 1
            else:
                channel = np.int64(_uint(data, at, 2))
                offset, size = at + MESSAGE_HEADER_SIZE, length - MESSAGE_HEADER_SIZE
            table[rows, 0], table[rows, 1], table[rows, 2], table[rows, 3] = opcode, channel, offset, size
            rows += 1
        at += length
    return rows, others, short


@njit(cache=True)
def tally(table, roles):  # type: ignore[no-untyped-def]
    """How many messages have each role, shape (6,), and the rows of those with role OTHER.

    `table`: messages, shape (n, 4).
    `roles`: role of each channel id, uint8, shape (65536,).
    """
    counts = np.zeros(ROLES, np.int64)
    for row in range(table.shape[0]):
        counts[roles[table[row, 1]]] += 1
    others = np.empty(counts[OTHER], np.int64)
    k = 0
    for row in range(table.shape[0]):
        if roles[table[row, 1]] == OTHER:
            others[k] = row
            k += 1
    return counts, others


@njit(cache=True)
def _body(data, at, length, doubles):  # type: ignore[no-untyped-def]
    """Where the numbers of a stamped message begin, or -1 if its layout is not the plain one.

    Plain is: CDR, little endian; std_msgs/Header with an ASCII frame_id of any length; then so many float64.
    """
    if length < 16 or data[at] != 0 or data[at + 1] != 1:
        return -1
    text = np.int64(_uint(data, at + 12, 4))
    if text < 1 or 16 + text > length:
        return -1
    # float64 are aligned to 8 bytes counted from after the encapsulation's 4
    body = at + 4 + (12 + text + 7) // DOUBLE * DOUBLE
    if body + doubles * DOUBLE != at + length:
        return -1
    for i in range(at + 16, at + 16 + text):
        if data[i] > 127:
            return -1
    return body


@njit(cache=True)
def _table_body(data, at, length):  # type: ignore[no-untyped-def]
    """As `_body`, for a message with one more string between the header and its six float64."""
    if length < 16 or data[at] != 0 or data[at + 1] != 1:
        return -1
    text = np.int64(_uint(data, at + 12, 4))
    kind = (12 + text + 3) // 4 * 4
    if text < 1 or 4 + kind + 4 > length:
        return -1
    letters = np.int64(_uint(data, at + 4 + kind, 4))
    body = at + 4 + (kind + 4 + letters + 7) // DOUBLE * DOUBLE
    if letters < 1 or body + TABLE_DOUBLES * DOUBLE != at + length:
        return -1
    return body


@njit(cache=True)
def _stamp(data, at):  # type: ignore[no-untyped-def]
    """Stamp of a message, ns: the header's; of a header without one, the publish time before the data."""
    seconds = np.int64(np.int32(np.uint32(_uint(data, at + 4, 4))))
    stamp = seconds * 1_000_000_000 + np.int64(_uint(data, at + 8, 4))
    return stamp if stamp != 0 else np.int64(_uint(data, at - 8, 8))


@njit(cache=True)
def gather(data, table, roles, imu, temperature, raw, motion):  # type: ignore[no-untyped-def]
    """Copy the fields of a table's messages into columns, in the table's order.

    `data`: bytes, uint8.
    `table`: from `tabulate`, messages only, shape (n, 4).
    `roles`: role of each channel id, uint8, shape (65536,).
    `imu`: uint64, shape (N, 9): stamp, the bits of angular rate and specific force, the first elements of their
      covariances.
    `temperature`: uint64, shape (M, 2): stamp, bits of the temperature.
    `raw`: uint8, shape (K, 48); zeros behind a message of 38 bytes.
    `motion`: uint64, shape (L, 7): stamp of a table's reference, bits of its angles and rates.
    Returns whether all of them have the plain layout; if not, what was copied means nothing.
    """
    i = j = k = m = 0
    for row in range(table.shape[0]):
        role, at, length = roles[table[row, 1]], table[row, 2], table[row, 3]
        if role == IMU:
            body = _body(data, at, length, IMU_DOUBLES)
            if body < 0:
                return False
            imu[i, 0] = np.uint64(_stamp(data, at))
            for axis in range(3):
                imu[i, 1 + axis] = _uint(data, body + DOUBLE * (RATE + axis), 8)
                imu[i, 4 + axis] = _uint(data, body + DOUBLE * (FORCE + axis), 8)
            imu[i, 7] = _uint(data, body + DOUBLE * RATE_COVARIANCE, 8)
            imu[i, 8] = _uint(data, body + DOUBLE * FORCE_COVARIANCE, 8)
            i += 1
        elif role == TEMPERATURE:
            body = _body(data, at, length, TEMPERATURE_DOUBLES)
            if body < 0:
                return False
            temperature[j, 0] = np.uint64(_stamp(data, at))
            temperature[j, 1] = _uint(data, body, 8)
            j += 1
        elif role == RAW:
            if length != RAW_SIZE and length != S1_SIZE:
                return False
            for byte in range(S1_SIZE):
                raw[k, byte] = data[at + byte] if byte < length else 0
            k += 1
        elif role == TABLE:
            body = _table_body(data, at, length)
            if body < 0:
                return False
            motion[m, 0] = np.uint64(_stamp(data, at))
            for column in range(TABLE_DOUBLES):
                motion[m, 1 + column] = _uint(data, body + DOUBLE * column, 8)
            m += 1
    return True
