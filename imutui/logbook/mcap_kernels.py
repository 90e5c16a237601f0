"""Compiled walks over MCAP records and the fields of our fixed messages; knows bytes, neither files nor libraries.

Imported only by who reads a log: the compiler costs an import of its own, which a recording need not wait for.
"""

import numpy as np
from numba import njit

MESSAGE = 5
HEADER_SIZE = 9
"""Bytes before a record's content: opcode, length (uint64)."""
MESSAGE_HEADER_SIZE = 22
"""Bytes before a message's data: channel id, sequence, log time, publish time."""
OPCODE, CHANNEL, OFFSET, LENGTH = range(4)
"""Columns of a table of records: of a message, offset and length are those of its data."""
IGNORED, OTHER, IMU, TEMPERATURE, RAW, TABLE = range(6)
"""What a channel's messages are to the reader."""

RAW_SIZE = 38
_DOUBLE = 8
_IMU_DOUBLES = 37
_TEMPERATURE_DOUBLES = 2
_TABLE_DOUBLES = 6


@njit(cache=True)
def _uint(data, at, size):  # type: ignore[no-untyped-def]
    value = np.uint64(0)
    for i in range(size):
        value |= np.uint64(data[at + i]) << np.uint64(8 * i)
    return value


@njit(cache=True)
def count(data, start, limit):  # type: ignore[no-untyped-def]
    """How many whole records lie in bytes from `start` on.

    Returns
    -------
    tuple of int
        Their number, and where the first one begins that is not whole or is longer than `limit`.
    """
    n, at, end = 0, start, data.size
    while at + HEADER_SIZE <= end:
        length = _uint(data, at + 1, 8)
        if length > np.uint64(limit) or at + HEADER_SIZE + np.int64(length) > end:
            break
        at += HEADER_SIZE + np.int64(length)
        n += 1
    return n, at


@njit(cache=True)
def tabulate(data, start, wanted, table):  # type: ignore[no-untyped-def]
    """Opcode, channel, offset and length of the whole records from `start` on whose opcode is wanted.

    Parameters
    ----------
    data : np.ndarray
        Bytes, uint8.
    start : int
        Where the first record begins.
    wanted : np.ndarray
        Of each opcode, bool, shape (256,).
    table : np.ndarray
        int64, shape (n, 4), n being what `count` found; filled from its first row on.

    Returns
    -------
    tuple of int
        Rows filled, how many of them are no messages, and how many are messages shorter than their own header.
    """
    at, rows, others, short = start, 0, 0, 0
    for _ in range(table.shape[0]):
        opcode, length = data[at], np.int64(_uint(data, at + 1, 8))
        at += HEADER_SIZE
        if wanted[opcode]:
            channel, offset, size = np.int64(-1), at, length
            if opcode != MESSAGE:
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

    Parameters
    ----------
    table : np.ndarray
        Messages, shape (n, 4).
    roles : np.ndarray
        Role of each channel id, uint8, shape (65536,).
    """
    counts = np.zeros(6, np.int64)
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
    body = at + 4 + (12 + text + 7) // _DOUBLE * _DOUBLE
    if body + doubles * _DOUBLE != at + length:
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
    body = at + 4 + (kind + 4 + letters + 7) // _DOUBLE * _DOUBLE
    if letters < 1 or body + _TABLE_DOUBLES * _DOUBLE != at + length:
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

    Parameters
    ----------
    data : np.ndarray
        Bytes, uint8.
    table : np.ndarray
        From `tabulate`, messages only, shape (n, 4).
    roles : np.ndarray
        Role of each channel id, uint8, shape (65536,).
    imu : np.ndarray
        uint64, shape (N, 9): stamp, the bits of angular rate and specific force, the first elements of their
        covariances.
    temperature : np.ndarray
        uint64, shape (M, 2): stamp, bits of the temperature.
    raw : np.ndarray
        uint8, shape (K, 38).
    motion : np.ndarray
        uint64, shape (L, 7): stamp of a table's reference, bits of its angles and rates.

    Returns
    -------
    bool
        Whether all of them have the plain layout; if not, what was copied means nothing.
    """
    i = j = k = m = 0
    for row in range(table.shape[0]):
        role, at, length = roles[table[row, 1]], table[row, 2], table[row, 3]
        if role == IMU:
            body = _body(data, at, length, _IMU_DOUBLES)
            if body < 0:
                return False
            imu[i, 0] = np.uint64(_stamp(data, at))
            for axis in range(3):
                imu[i, 1 + axis] = _uint(data, body + _DOUBLE * (13 + axis), 8)
                imu[i, 4 + axis] = _uint(data, body + _DOUBLE * (25 + axis), 8)
            imu[i, 7] = _uint(data, body + _DOUBLE * 16, 8)
            imu[i, 8] = _uint(data, body + _DOUBLE * 28, 8)
            i += 1
        elif role == TEMPERATURE:
            body = _body(data, at, length, _TEMPERATURE_DOUBLES)
            if body < 0:
                return False
            temperature[j, 0] = np.uint64(_stamp(data, at))
            temperature[j, 1] = _uint(data, body, 8)
            j += 1
        elif role == RAW:
            if length != RAW_SIZE:
                return False
            for byte in range(RAW_SIZE):
                raw[k, byte] = data[at + byte]
            k += 1
        elif role == TABLE:
            body = _table_body(data, at, length)
            if body < 0:
                return False
            motion[m, 0] = np.uint64(_stamp(data, at))
            for column in range(_TABLE_DOUBLES):
                motion[m, 1 + column] = _uint(data, body + _DOUBLE * column, 8)
            m += 1
    return True
