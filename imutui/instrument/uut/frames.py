"""Frames of the 440, 380 and 381: preamble, type, length, payload and CRC, all big-endian.

Nothing here searches for frames in a stream of bytes (`decoder`) or looks into a payload (`messages`).
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
    """Return the CRC over type, length and payload; the preamble is not covered."""
    return binascii.crc_hqx(covered, _CRC_START)


def framed(frame: Frame) -> bytes:
    """Return the bytes of a frame on the line.

    Raises ValueError if type or payload are of a length that no frame has.
    """
    if len(frame.type) != TYPE_BYTES:
        raise ValueError(f"`type` must be two bytes, not {frame.type!r}")
    if len(frame.payload) > MOST_PAYLOAD_BYTES:
        raise ValueError(f"`payload` must have 255 bytes at most, not {len(frame.payload)}")
    covered = frame.type + bytes([len(frame.payload)]) + frame.payload
    return PREAMBLE + covered + crc16(covered).to_bytes(CRC_BYTES, "big")


def frame_of(data: bytes) -> Frame:
    """Return the frame in its bytes; preamble and CRC are not checked."""
    return Frame(data[2:4], data[HEADER_BYTES:-CRC_BYTES])


FIXED_LENGTHS = {
    b"S0": 30,
    b"S1": 24,
    b"S2": 28,
    b"A0": 30,
    b"A1": 32,
    b"A2": 30,
    b"N0": 32,
    b"N1": 42,
    b"B1": 18,
    b"B2": 10,
    b"T0": 28,
    b"VR": 5,
    b"GP": 2,
    b"SR": 0,
    b"AR": 0,
    b"\x15\x15": 2,
}
"""Payload bytes of the types that have always as many."""
