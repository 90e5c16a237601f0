"""Frames of the 440, 380 and 381: preamble, type, length, payload and CRC, all big-endian.

Nothing here searches for frames in a stream of bytes (`frame_search`) or looks into a payload (`payloads`).
"""

import binascii
from dataclasses import dataclass

# "0x5555, packet type, payload length, payload, CRC": the length counts payload bytes only.
PREAMBLE = b"\x55\x55"
TYPE_BYTES = 2
HEADER_BYTES = len(PREAMBLE) + TYPE_BYTES + 1
CRC_BYTES = 2
OVERHEAD_BYTES = HEADER_BYTES + CRC_BYTES
MOST_PAYLOAD_BYTES = 255

# Polynomial 0x1021, not reflected, no final xor. The manuals' 0xFFFF belongs to the form that appends two zero bytes to
# the message; byte by byte it is this.
_CRC_START = 0x1D0F


@dataclass(frozen=True, slots=True)
class Frame:
    """What a whole frame with the right CRC carried."""

    type: bytes  # two bytes, mostly letters
    payload: bytes = b""


def crc16(covered: bytes) -> int:
    """CRC over type, length and payload; the preamble is not covered."""
    return binascii.crc_hqx(covered, _CRC_START)


def framed(frame: Frame) -> bytes:
    """Bytes of a frame as it goes over the line.

    Raises ValueError if type or payload are of a length that no frame has.
    """
    if len(frame.type) != TYPE_BYTES:
        raise ValueError(f"`type` must be two bytes, not {frame.type!r}")
    if len(frame.payload) > MOST_PAYLOAD_BYTES:
        raise ValueError(f"`payload` must have 255 bytes at most, not {len(frame.payload)}")
    covered = frame.type + bytes([len(frame.payload)]) + frame.payload
    return PREAMBLE + covered + crc16(covered).to_bytes(CRC_BYTES, "big")


def is_whole(held: bytes | bytearray, start: int, end: int) -> bool:
    """Whether the frame that lies from `start` to `end` in the bytes held has the right CRC."""
    covered = bytes(held[start + len(PREAMBLE) : end - CRC_BYTES])
    return crc16(covered) == int.from_bytes(held[end - CRC_BYTES : end], "big")
