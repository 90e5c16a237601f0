"""What the walks over records tell of messages: the columns of their tables, and the roles and sizes of messages."""

from typing import NamedTuple

import numpy as np

from imutui.logbook import mcap_format

MESSAGE_OPCODE = 5
HEADER_SIZE = mcap_format.HEAD.size
"""Bytes before a record's content: opcode, length (uint64)."""
MESSAGE_HEADER_SIZE = mcap_format.MESSAGE.size
"""Bytes before a message's data: channel id, sequence, log time, publish time."""
OPCODE, CHANNEL, OFFSET, LENGTH = range(4)
"""Columns of a table of records: of a message, offset and length are those of its data."""
IGNORED, OTHER, IMU, TEMPERATURE, RAW, TABLE = range(6)
"""What a channel's messages are to the reader."""
ROLES = 6

RAW_SIZE, S1_SIZE = 38, 48
"""Bytes of a raw packet's message: of an IMU400CD's, and of one with details, which begins with the same fields."""
DOUBLE = 8
IMU_DOUBLES = 37
"""Numbers of sensor_msgs/Imu behind its header."""
RATE, RATE_COVARIANCE, FORCE, FORCE_COVARIANCE = 13, 16, 25, 28
"""Where in them angular rate, specific force and their covariances begin."""
TEMPERATURE_DOUBLES = 2
TABLE_DOUBLES = 6


class RecordTable(NamedTuple):
    """Records found in bytes."""

    # opcode, channel, offset and length of those wanted, int64, shape (n, 4); channel is -1 for what is no message, or
    # too short to be one
    rows: np.ndarray
    end: int  # where the first record begins that is not whole, or is longer than the limit
    others: int  # how many of the rows are no messages
    short: int  # how many are messages shorter than their own header
