"""Payloads of the frames that a plain inertial unit of the family has.

Attitude and navigation packets, magnetic calibration, the bootloader and S2, sums that no sample is made of, are left
out: their frames stay as they are. Nothing raises for what comes over the line.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from imutui.instrument.counts import PacketDetails, Scaling, Triple
from imutui.instrument.uut.frames import Frame, framed

SCALING = Scaling(rate_lsb_dps=1260.0 / 2**16, accel_lsb_g=20.0 / 2**16, temperature_lsb=200.0 / 2**16)
"""Of S0 and S1, in the axes and signs of the packets; the same for all units. "1260 / 2^16 deg/s": 7 pi rad/s."""

# Flags of the status word that the manuals call BIT, built-in test; all other bits are reserved.
_BITS = {
    0: "master fail",
    1: "hardware error",
    2: "com error",
    3: "software error",
    8: "master status",
    9: "hardware status",
    10: "com status",
    11: "software status",
    12: "sensor status",  # a sensor is beyond its range
}


def names_of_bits(word: int) -> tuple[str, ...]:
    """Return the names of the bits set in a status word, from the lowest: "hardware error", "reserved 5"."""
    return tuple(_BITS.get(place, f"reserved {place}") for place in range(16) if word >> place & 1)


# ------------------------------------------------------------------------------------------------ requests and replies

PING = Frame(b"PK")
"""A question for a sign of life, and its answer."""

RESET = Frame(b"SR")
"""A restart as after power-up, and the answer to it, which the unit sends before it restarts."""

REFUSED = b"\x15\x15"
"""Type of the reply to a request that the unit refuses, wholly or in part; its payload is the request's type."""

GET_PACKET = b"GP"
"""Type of the request for one packet; its payload is the packet's type, such as b"ID"."""


class Memory(Enum):
    """Where the unit keeps configuration fields, with the types of the requests for them."""

    RAM = b"GF", b"SF"
    """In force at once, lost with the power."""
    EEPROM = b"RF", b"WF"
    """In force from the next power-up on."""

    def __init__(self, read: bytes, write: bytes) -> None:
        self.read = read  # numbers of fields; the reply has pairs of number and value of those that the unit has
        self.write = write  # pairs of number and value; the reply has the numbers of those that the unit took


def numbers(fields: Iterable[int]) -> bytes:
    """Return the payload that lists numbers of fields."""
    listed = tuple(fields)
    return struct.pack(f">B{len(listed)}H", len(listed), *listed)


def numbers_in(payload: bytes) -> tuple[int, ...]:
    """Return the numbers of fields in a payload; none if its length does not fit."""
    return tuple(number for (number,) in _entries(payload, ">H"))


def pairs(fields: Iterable[tuple[int, int]]) -> bytes:
    """Return the payload that lists numbers and values of fields."""
    listed = tuple(fields)
    return bytes([len(listed)]) + b"".join(struct.pack(">HH", *pair) for pair in listed)


def pairs_in(payload: bytes) -> tuple[tuple[int, int], ...]:
    """Return the numbers and values of fields in a payload; none if its length does not fit."""
    return tuple((number, value) for number, value in _entries(payload, ">HH"))


def _entries(payload: bytes, entry: str) -> list[tuple[int, ...]]:
    fits = len(payload) == 1 + payload[0] * struct.calcsize(entry) if payload else False
    return list(struct.iter_unpack(entry, payload[1:])) if fits else []


SERIAL_BYTES = 4
"""Of the serial number, with which a payload of ID begins."""


def identification(payload: bytes) -> tuple[str, str]:
    """Return the serial number and the text of a payload of ID: model, part number and more, with spaces between."""
    text = payload[SERIAL_BYTES:].removesuffix(b"\0").decode("ascii", "backslashreplace")
    return str(int.from_bytes(payload[:SERIAL_BYTES], "big")), text


# -------------------------------------------------------------------------------------------------------- measurements

_S0, _S1 = struct.Struct(">13h2H"), struct.Struct(">10h2H")


@dataclass(frozen=True, slots=True)
class PacketS1:
    """Packet S1, in counts with sign; every unit of the family has it. See `counts.DataPacket`."""

    # accels, rates: X, Y, Z
    accels: Triple
    rates: Triple
    rate_temperatures: Triple  # of the rate sensors X, Y, Z
    board_temperature: int  # declared unused on the IMU380ZA-200
    counter: int  # 0 to 65535; its meaning depends on the unit, see `counter`
    # status word, declared unused on the IMU380ZA-200; none of its flags means that the data are bad
    bit: int

    @property
    def frame(self) -> Frame:
        """The packet as a frame."""
        tail = self.board_temperature, self.counter, self.bit
        return Frame(b"S1", _S1.pack(*self.accels, *self.rates, *self.rate_temperatures, *tail))

    @property
    def temperature(self) -> int:
        """That of the X rate sensor."""
        return self.rate_temperatures[0]

    @property
    def ticks(self) -> int:
        """The counter."""
        return self.counter

    @property
    def details(self) -> PacketDetails:
        """Temperatures of all rate sensors and of the board, and the status word."""
        return PacketDetails(self.rate_temperatures, self.board_temperature, self.bit)


@dataclass(frozen=True, slots=True)
class PacketS0(PacketS1):
    """Packet S0: as S1, with a magnetometer. By the product its counter is time of week, a timer or nothing."""

    magnetics: Triple  # X, Y, Z

    @property
    def frame(self) -> Frame:
        """The packet as a frame."""
        tail = *self.rate_temperatures, self.board_temperature, self.counter, self.bit
        return Frame(b"S0", _S0.pack(*self.accels, *self.rates, *self.magnetics, *tail))


def content_of(frame: Frame) -> PacketS1 | Frame:
    """Return the measurement in a frame from the unit; any other frame as it is."""
    if frame.type == b"S1" and len(frame.payload) == _S1.size:
        # "Accelerations, rates, temperatures of the rate sensors: X, Y, Z each; board temperature, counter, BIT."
        ax, ay, az, gx, gy, gz, tx, ty, tz, board, counter, bit = _S1.unpack(frame.payload)
        return PacketS1((ax, ay, az), (gx, gy, gz), (tx, ty, tz), board, counter, bit)
    if frame.type == b"S0" and len(frame.payload) == _S0.size:
        # as S1, with the magnetometer behind the rates
        ax, ay, az, gx, gy, gz, mx, my, mz, tx, ty, tz, board, counter, bit = _S0.unpack(frame.payload)
        return PacketS0((ax, ay, az), (gx, gy, gz), (tx, ty, tz), board, counter, bit, (mx, my, mz))
    return frame


def encode(message: PacketS1 | Frame) -> bytes:
    """Return the bytes of a measurement, a request or a reply on the line."""
    return framed(message if isinstance(message, Frame) else message.frame)
