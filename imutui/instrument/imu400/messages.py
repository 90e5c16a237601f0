"""What goes over the line of a Crossbow IMU300CC, IMU400CC or IMU400CD: commands, packets, replies, and their bytes.

Left out is what other members of the family add: magnetometer words and angle mode (AHRS, VG), and built-in test.
"""

import enum
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

from imutui.instrument.discarded import Discarded

# "38400 baud at power-up; 8 data bits, 1 start bit, 1 stop bit, no parity."
POWER_UP_BAUD = 38400

# "Header 0xFF, eight 16-bit words, MSB first, checksum": 18 bytes in scaled and in voltage mode.
HEADER = 0xFF
PACKET_BYTES = 18

# "Scaled data is two's complement; temperature and time are unsigned." Voltage words are all unsigned.
_SCALED_WORDS = struct.Struct(">6h2H")
_VOLTAGE_WORDS = struct.Struct(">8H")

# "Header 0xFF, four bytes of serial number, MSB first, checksum."
SERIAL_BYTES = 6
SERIAL_WORD = struct.Struct(">I")

# "The time counter counts down from 65535 to 0, and wraps"; "one tick is 0.79 microseconds".
COUNTER_SPAN = 65536
TICK_S = 0.79e-6


class Mode(enum.Enum):
    """Measurement mode: what the words of a packet mean."""

    SCALED = "scaled"
    VOLTAGE = "voltage"


# ---------------------------------------------------------------------------------------------- commands, host to unit


@dataclass(frozen=True, slots=True)
class Ping:
    """Ask for a sign of life. Some units reset themselves on it, so set the mode again afterwards."""


@dataclass(frozen=True, slots=True)
class SetMode:
    """Choose scaled or voltage mode."""

    mode: Mode


@dataclass(frozen=True, slots=True)
class StopStream:
    """Return to polled mode. There is no reply, and the packet already begun still arrives."""


@dataclass(frozen=True, slots=True)
class StartStream:
    """Send packets continuously. There is no reply but the packets."""


@dataclass(frozen=True, slots=True)
class GetPacket:
    """Ask for one packet. Sent during a stream it also returns the unit to polled mode."""


@dataclass(frozen=True, slots=True)
class AskSerialNumber:
    """Ask for the serial number."""


@dataclass(frozen=True, slots=True)
class AskVersion:
    """Ask for the version text."""


@dataclass(frozen=True, slots=True)
class ZeroRateSensors:
    """Average the rate sensors, unit still, and subtract the mean from then on."""

    argument: int  # length of the average in a unit that the sources dispute, 0 to 255; 0 erases the stored zero


@dataclass(frozen=True, slots=True)
class RequestBaud:
    """Announce a change of baud rate, at the present one."""


@dataclass(frozen=True, slots=True)
class MeasureBaud:
    """Let the unit measure the new baud rate from this byte. Outside a change a plain IMU ignores it."""


@dataclass(frozen=True, slots=True)
class UnknownCommand:
    """A byte that commands nothing; units keep silent on it."""

    byte: int


# ------------------------------------------------------------------------------------ packets and replies, unit to host


@dataclass(frozen=True, slots=True)
class Packet:
    """One data packet, in counts."""

    mode: Mode  # the mode the host believed in; the packet itself does not say
    # rates, accels: X, Y, Z; signed in scaled mode, unsigned sensor voltages in voltage mode
    rates: tuple[int, int, int]
    accels: tuple[int, int, int]
    temperature: int  # voltage of the temperature sensor
    ticks: int  # time counter when the sensors were sampled; it counts down

    @property
    def details(self) -> None:
        """Nothing: it has no more than this."""


@dataclass(frozen=True, slots=True)
class Pong:
    """The reply to `Ping`."""


@dataclass(frozen=True, slots=True)
class ModeSet:
    """The reply to `SetMode`."""

    mode: Mode


@dataclass(frozen=True, slots=True)
class SerialNumber:
    """The reply to `AskSerialNumber`."""

    number: int


@dataclass(frozen=True, slots=True)
class Version:
    """The reply to `AskVersion`."""

    text: str


@dataclass(frozen=True, slots=True)
class RatesZeroed:
    """The reply to `ZeroRateSensors`, sent when the average is done."""


@dataclass(frozen=True, slots=True)
class BaudReady:
    """The reply to `RequestBaud`, at the old baud rate."""


@dataclass(frozen=True, slots=True)
class BaudSet:
    """The reply to `MeasureBaud`, at the new baud rate."""


Command: TypeAlias = (
    Ping
    | SetMode
    | StopStream
    | StartStream
    | GetPacket
    | AskSerialNumber
    | AskVersion
    | ZeroRateSensors
    | RequestBaud
    | MeasureBaud
    | UnknownCommand
)
Reply: TypeAlias = Pong | ModeSet | SerialNumber | Version | RatesZeroed | BaudReady | BaudSet
Event: TypeAlias = Packet | Reply | Discarded

# "Commands are single ASCII bytes, case sensitive, without line end." `z` alone has a second byte, binary.
COMMAND_LETTERS: dict[Command, bytes] = {
    Ping(): b"R",
    SetMode(Mode.SCALED): b"c",
    SetMode(Mode.VOLTAGE): b"r",
    StopStream(): b"P",
    StartStream(): b"C",
    GetPacket(): b"G",
    AskSerialNumber(): b"S",
    AskVersion(): b"v",
    RequestBaud(): b"b",
    MeasureBaud(): b"a",
}
COMMAND_OF_BYTE = {letter[0]: command for command, letter in COMMAND_LETTERS.items()}
ZERO_LETTER = b"z"

REPLY_LETTERS: dict[Reply, bytes] = {
    Pong(): b"H",
    ModeSet(Mode.SCALED): b"C",
    ModeSet(Mode.VOLTAGE): b"R",
    RatesZeroed(): b"Z",
    BaudReady(): b"B",
    BaudSet(): b"A",
}


def checksum(payload: Iterable[int]) -> int:
    """Sum of the bytes between header and checksum, modulo 256.

    One manual prints 255 in one place; every driver that has met hardware uses 256.
    """
    return sum(payload) & 0xFF


def encode(message: Command | Packet | Reply) -> bytes:
    """Write a command, a packet or a reply as it goes over the line.

    `message`: anything that either decoder returns, but `Discarded`.
    Raises ValueError if a field does not fit its place on the line.
    """
    match message:
        case Packet():
            return _framed(_packed_words(message))
        case SerialNumber(number):
            if not 0 <= number < 2**32:
                raise ValueError(f"`number` must fit 32 bits, not {number}")
            return _framed(SERIAL_WORD.pack(number))
        case Version(text):
            if not text.isascii():
                raise ValueError(f"`text` must be ASCII, not {text!r}")
            return _framed(text.encode("ascii"))
        case ZeroRateSensors(argument):
            return ZERO_LETTER + _one_byte("argument", argument)
        case UnknownCommand(byte):
            return _one_byte("byte", byte)
        case Pong() | ModeSet() | RatesZeroed() | BaudReady() | BaudSet():
            return REPLY_LETTERS[message]
        case _:
            return COMMAND_LETTERS[message]


def _framed(payload: bytes) -> bytes:
    return bytes([HEADER, *payload, checksum(payload)])


def _one_byte(name: str, value: int) -> bytes:
    if not 0 <= value <= 0xFF:
        raise ValueError(f"`{name}` must fit one byte, not {value}")
    return bytes([value])


def _words_of(mode: Mode) -> struct.Struct:
    return _SCALED_WORDS if mode is Mode.SCALED else _VOLTAGE_WORDS


def _packed_words(packet: Packet) -> bytes:
    try:
        return _words_of(packet.mode).pack(*packet.rates, *packet.accels, packet.temperature, packet.ticks)
    except struct.error as error:
        raise ValueError(f"`packet` must hold 16-bit words, not {packet}") from error


def packet_of(mode: Mode, frame: bytes) -> Packet:
    """Packet that a frame of 18 bytes holds; header and checksum are not looked at."""
    gx, gy, gz, ax, ay, az, temperature, ticks = _words_of(mode).unpack_from(frame, 1)
    return Packet(mode, (gx, gy, gz), (ax, ay, az), temperature, ticks)
