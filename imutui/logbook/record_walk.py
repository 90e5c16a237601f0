"""Which walk over a log's records pays: the plain one, which is there at once, or the compiled one, which is faster.

Both say the same. Loading the compiler takes as long as the plain walk takes over many megabytes; where a filter is to
run it is loaded anyway. Where the kernels are loaded already, as when one log after the other is read, they always pay.
"""

import struct
import sys
from array import array
from typing import NamedTuple, Protocol

import numpy as np

from imutui.logbook.message_layout import (
    CHANNEL,
    DOUBLE,
    FORCE,
    FORCE_COVARIANCE,
    HEADER_SIZE,
    IMU,
    IMU_DOUBLES,
    LENGTH,
    MESSAGE_HEADER_SIZE,
    MESSAGE_OPCODE,
    OFFSET,
    OPCODE,
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

COMPILER_PAYS_BYTES = 20 * 2**20
"""Size of a log from which on loading the compiler for its sake pays."""
KERNELS_PAY_BYTES = 2 * 2**20
"""Size of a log from which on loading the kernels pays where the compiler is loaded anyway."""


class _EndOfWhole(Protocol):
    def __call__(self, data: np.ndarray, limit: int, /) -> int: ...


class _Tabulate(Protocol):
    def __call__(self, data: np.ndarray, limit: int, wanted: np.ndarray, /) -> RecordTable: ...


class _Tally(Protocol):
    def __call__(self, table: np.ndarray, roles: np.ndarray, /) -> tuple[np.ndarray, np.ndarray]: ...


class _Gather(Protocol):
    def __call__(
        self,
        data: np.ndarray,
        table: np.ndarray,
        roles: np.ndarray,
        imu: np.ndarray,
        temperature: np.ndarray,
        raw: np.ndarray,
        motion: np.ndarray,
        /,
    ) -> bool: ...


class Walk(NamedTuple):
    """The walks over records and the fields of our messages; see the plain ones for each."""

    end_of_whole: _EndOfWhole
    tabulate: _Tabulate
    tally: _Tally
    gather: _Gather


# ---------------------------------------------------------------------------------------------------- the plain walk
# The walks of `mcap_kernels` without a compiler: slower by the byte, and there at once.

_LENGTH_OF_RECORD = struct.Struct("<xQ")
_READ_OF_IMU = (*range(RATE, RATE + 3), *range(FORCE, FORCE + 3), RATE_COVARIANCE, FORCE_COVARIANCE)


def end_of_whole(data: np.ndarray, limit: int) -> int:
    """Where the first record begins that is not whole, or is longer than `limit`; the end if there is none."""
    return _starts(data, limit)[1]


def tabulate(data: np.ndarray, limit: int, wanted: np.ndarray) -> RecordTable:
    """Opcode, channel, offset and length of the whole records whose opcode is wanted.

    `data`: bytes, uint8.
    `limit`: longest record, bytes.
    `wanted`: of each opcode, bool, shape (256,).
    """
    starts, end = _starts(data, limit)
    lengths = np.diff(starts, append=end) - HEADER_SIZE
    opcodes = data[starts]
    use = wanted[opcodes]
    starts, lengths, opcodes = starts[use], lengths[use], opcodes[use]
    messages = opcodes == MESSAGE_OPCODE
    whole = messages & (lengths >= MESSAGE_HEADER_SIZE)
    rows = np.empty((starts.size, 4), np.int64)
    rows[:, OPCODE] = opcodes
    rows[:, CHANNEL] = -1
    rows[whole, CHANNEL] = _numbers(data, starts[whole] + HEADER_SIZE, 2)
    rows[:, OFFSET] = starts + HEADER_SIZE + MESSAGE_HEADER_SIZE * whole
    rows[:, LENGTH] = lengths - MESSAGE_HEADER_SIZE * whole
    return RecordTable(rows, end, int(np.sum(~messages)), int(np.sum(messages & ~whole)))


def _starts(data: np.ndarray, limit: int) -> tuple[np.ndarray, int]:
    """Where each whole record begins, int64, and where the first one does that is none."""
    content, end, at = data.data, data.size, 0
    # eight bytes each, where a list takes forty: records may be as short as their heads
    starts = array("q")
    length_at, append, last = _LENGTH_OF_RECORD.unpack_from, starts.append, end - HEADER_SIZE
    while at <= last:
        (length,) = length_at(content, at)
        after = at + HEADER_SIZE + length
        if length > limit or after > end:
            break
        append(at)
        at = after
    return np.frombuffer(starts, np.int64), at


def tally(table: np.ndarray, roles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How many messages have each role, shape (6,), and the rows of those with role OTHER.

    `table`: messages, shape (n, 4).
    `roles`: role of each channel id, uint8, shape (65536,).
    """
    each = roles[table[:, CHANNEL]]
    return np.bincount(each, minlength=ROLES), np.flatnonzero(each == OTHER)


def gather(
    data: np.ndarray,
    table: np.ndarray,
    roles: np.ndarray,
    imu: np.ndarray,
    temperature: np.ndarray,
    raw: np.ndarray,
    motion: np.ndarray,
) -> bool:
    """Copy the fields of a table's messages into columns, in the table's order; as `mcap_kernels.gather`.

    `data`, `table`, `roles`: bytes, messages in them, role of each channel id.
    `imu`, `temperature`, `raw`, `motion`: columns to fill: shapes (N, 9), (M, 2), (K, 48), (L, 7).
    Returns whether all of them have the plain layout; if not, what was copied means nothing.
    """
    each = roles[table[:, CHANNEL]]
    at, length = table[:, OFFSET], table[:, LENGTH]
    samples, degc, packets, angles = (each == role for role in (IMU, TEMPERATURE, RAW, TABLE))
    imu_body = _bodies(data, at[samples], length[samples], IMU_DOUBLES)
    degc_body = _bodies(data, at[degc], length[degc], TEMPERATURE_DOUBLES)
    angles_body = _table_bodies(data, at[angles], length[angles])
    sizes = length[packets]
    plain = bool(((sizes == RAW_SIZE) | (sizes == S1_SIZE)).all())
    if imu_body is None or degc_body is None or angles_body is None or not plain:
        return False
    imu[:, 0], imu[:, 1:] = _stamps(data, at[samples]), _doubles(data, imu_body, _READ_OF_IMU)
    temperature[:, 0], temperature[:, 1:] = _stamps(data, at[degc]), _doubles(data, degc_body, (0,))
    raw[:, RAW_SIZE:] = 0
    for size in (RAW_SIZE, S1_SIZE):
        raw[sizes == size, :size] = data[at[packets][sizes == size][:, None] + np.arange(size)]
    motion[:, 0], motion[:, 1:] = _stamps(data, at[angles]), _doubles(data, angles_body, range(TABLE_DOUBLES))
    return True


def _numbers(data: np.ndarray, at: np.ndarray, size: int) -> np.ndarray:
    """Unsigned numbers of so many bytes, shape (n,)."""
    return data[at[:, None] + np.arange(size)].view(f"<u{size}")[:, 0]


def _doubles(data: np.ndarray, body: np.ndarray, which: "tuple[int, ...] | range") -> np.ndarray:
    """Bits of some of a message's float64, uint64, shape (n, len(which))."""
    offsets = (DOUBLE * np.array(which)[:, None] + np.arange(DOUBLE)).ravel()
    return data[body[:, None] + offsets].view("<u8")


def _stamps(data: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Stamps of messages, ns, as uint64: the header's; of a header without one, the publish time before the data."""
    seconds = _numbers(data, at + 4, 4).view(np.int32).astype(np.int64)
    stamps = seconds * 1_000_000_000 + _numbers(data, at + 8, 4).astype(np.int64)
    return np.where(stamps != 0, stamps, _numbers(data, at - 8, 8).view(np.int64)).view(np.uint64)


def _begins(data: np.ndarray, at: np.ndarray, length: np.ndarray) -> bool:
    """Whether messages have a header, and are CDR, little endian."""
    return bool((length >= 16).all()) and bool(((data[at] == 0) & (data[at + 1] == 1)).all())


def _bodies(data: np.ndarray, at: np.ndarray, length: np.ndarray, doubles: int) -> np.ndarray | None:
    """Where the numbers of stamped messages begin, shape (n,), or None if the layout of one is not the plain one.

    Plain is: CDR, little endian; std_msgs/Header with an ASCII frame_id of any length; then so many float64.
    """
    if not _begins(data, at, length):
        return None
    text = _numbers(data, at + 12, 4).astype(np.int64)
    # float64 are aligned to 8 bytes counted from after the encapsulation's 4
    body: np.ndarray = at + 4 + (12 + text + 7) // DOUBLE * DOUBLE
    if ((text < 1) | (16 + text > length) | (body + doubles * DOUBLE != at + length)).any():
        return None
    for size in set(text.tolist()):
        if (data[at[text == size][:, None] + 16 + np.arange(size)] > 127).any():
            return None
    return body


def _table_bodies(data: np.ndarray, at: np.ndarray, length: np.ndarray) -> np.ndarray | None:
    """As `_bodies`, for messages with one more string between the header and their six float64."""
    if not _begins(data, at, length):
        return None
    text = _numbers(data, at + 12, 4).astype(np.int64)
    kind = (12 + text + 3) // 4 * 4
    if ((text < 1) | (4 + kind + 4 > length)).any():
        return None
    letters = _numbers(data, at + 4 + kind, 4).astype(np.int64)
    body: np.ndarray = at + 4 + (kind + 4 + letters + 7) // DOUBLE * DOUBLE
    if ((letters < 1) | (body + TABLE_DOUBLES * DOUBLE != at + length)).any():
        return None
    return body


# ---------------------------------------------------------------------------------------------------------- which pays

PLAIN = Walk(end_of_whole, tabulate, tally, gather)


def compiled() -> Walk:
    """The compiled walks; loads the compiler."""
    from imutui.logbook import mcap_kernels

    return Walk(mcap_kernels.end_of_whole, mcap_kernels.tabulate, mcap_kernels.tally, mcap_kernels.gather)


def for_reading(size: int) -> Walk:
    """Walks over a log of so many bytes where nothing else needs the compiler."""
    return compiled() if size >= COMPILER_PAYS_BYTES or _is_loaded() else PLAIN


def for_filtering(size: int) -> Walk:
    """Walks over a log of so many bytes that a filter is to take."""
    return compiled() if size >= KERNELS_PAY_BYTES or _is_loaded() else PLAIN


def _is_loaded() -> bool:
    return "imutui.logbook.mcap_kernels" in sys.modules
