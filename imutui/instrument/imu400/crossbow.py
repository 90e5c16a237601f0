"""The Crossbow "DMU" serial protocol of the IMU300CC, IMU400CC and IMU400CD: bytes in, frozen events out.

The module does no input or output, reads no clock, and raises nothing for noise: bytes that mean nothing become a
`Discarded` event and a counter. It knows both ends of the line: `CommandDecoder` is the unit's side, and `encode`
writes anything that it or the host's side (`decoder`) reads. Left out is what other members of the family add:
magnetometer words and angle mode (AHRS, VG), and built-in test.
"""

import enum
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

# "38400 baud at power-up; 8 data bits, 1 start bit, 1 stop bit, no parity."
POWER_UP_BAUD = 38400

# "Header 0xFF, eight 16-bit words, MSB first, checksum": 18 bytes in scaled and in voltage mode.
HEADER = b"\xff"
PACKET_BYTES = 18

# "Scaled data is two's complement; temperature and time are unsigned." Voltage words are all unsigned.
_SCALED_WORDS = struct.Struct(">6h2H")
_VOLTAGE_WORDS = struct.Struct(">8H")

# "Header 0xFF, four bytes of serial number, MSB first, checksum."
SERIAL_BYTES = 6
_SERIAL_WORD = struct.Struct(">I")

# "The time counter counts down from 65535 to 0, and wraps"; "one tick is 0.79 microseconds".
TICK_S = 0.79e-6


class Mode(enum.Enum):
    """Measurement mode: what the words of a packet mean."""

    SCALED = "scaled"
    VOLTAGE = "voltage"


# ---------------------------------------------------------------------------------------------- commands, host to unit


class Command(enum.Enum):
    """Commands of one letter, and what each asks for.

    "Commands are single ASCII bytes, case sensitive, without line end."
    """

    PING = b"R", "ping"
    """Some units reset themselves on it, so set the mode again afterwards."""
    SCALED_MODE = b"c", "scaled mode"
    VOLTAGE_MODE = b"r", "voltage mode"
    STOP_STREAM = b"P", "stop, polled mode"
    """There is no reply, and the packet already begun still arrives."""
    START_STREAM = b"C", "stream, continuous mode"
    """There is no reply but the packets."""
    GET_PACKET = b"G", "one packet"
    """Sent during a stream it also returns the unit to polled mode."""
    SERIAL_NUMBER = b"S", "serial number"
    VERSION = b"v", "version"
    REQUEST_BAUD = b"b", "change of baud rate announced"
    """Sent at the present speed."""
    MEASURE_BAUD = b"a", "measure the baud rate"
    """The unit measures the new speed from this byte. Outside a change a plain IMU ignores it."""

    def __init__(self, letter: bytes, meaning: str) -> None:
        self.letter = letter
        self.meaning = meaning


@dataclass(frozen=True, slots=True)
class ZeroRateSensors:
    """Average the rate sensors, unit still, and subtract the mean from then on: the one command with an argument."""

    argument: int  # length of the average in a unit that the sources dispute, 0 to 255; 0 erases the stored zero


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


class Reply(enum.Enum):
    """Replies of one letter."""

    PONG = b"H"
    SCALED_MODE = b"C"
    VOLTAGE_MODE = b"R"
    RATES_ZEROED = b"Z"
    """Sent when the average is done."""
    BAUD_READY = b"B"
    """Sent at the old speed."""
    BAUD_SET = b"A"
    """Sent at the new one."""


@dataclass(frozen=True, slots=True)
class SerialNumber:
    """The reply to `Command.SERIAL_NUMBER`."""

    number: int


@dataclass(frozen=True, slots=True)
class Version:
    """The reply to `Command.VERSION`."""

    text: str


AnyCommand: TypeAlias = Command | ZeroRateSensors | UnknownCommand
AnyReply: TypeAlias = Reply | SerialNumber | Version

SET_MODE = {Mode.SCALED: Command.SCALED_MODE, Mode.VOLTAGE: Command.VOLTAGE_MODE}
LETTER_REPLY = {
    Command.PING: Reply.PONG,
    Command.SCALED_MODE: Reply.SCALED_MODE,
    Command.VOLTAGE_MODE: Reply.VOLTAGE_MODE,
    Command.REQUEST_BAUD: Reply.BAUD_READY,
    Command.MEASURE_BAUD: Reply.BAUD_SET,
}
"""Commands that are answered by a letter; so is `ZeroRateSensors`."""

_COMMAND_OF_LETTER = {command.letter[0]: command for command in Command}
# `z` alone has a second byte, binary
_ZERO_LETTER = b"z"


def checksum(payload: Iterable[int]) -> int:
    """Return the sum of the bytes between header and checksum, modulo 256.

    One manual prints 255 in one place; every driver that has met hardware uses 256.
    """
    return sum(payload) & 0xFF


def encode(message: AnyCommand | Packet | AnyReply) -> bytes:
    """Write a command, a packet or a reply as it goes over the line.

    `message`: anything that either decoder returns, but `Discarded`.
    Raises ValueError if a field does not fit its place on the line.
    """
    match message:
        case Command():
            return message.letter
        case Reply():
            return message.value
        case Packet():
            return _framed(_packed_words(message))
        case SerialNumber(number):
            if not 0 <= number < 2**32:
                raise ValueError(f"`number` must fit 32 bits, not {number}")
            return _framed(_SERIAL_WORD.pack(number))
        case Version(text):
            if not text.isascii():
                raise ValueError(f"`text` must be ASCII, not {text!r}")
            return _framed(text.encode("ascii"))
        case ZeroRateSensors(argument):
            return _ZERO_LETTER + _one_byte("argument", argument)
        case UnknownCommand(byte):
            return _one_byte("byte", byte)


def in_words(command: AnyCommand) -> str:
    """Describe a command, for a log: "c: scaled mode"."""
    match command:
        case Command():
            meaning = command.meaning
        case ZeroRateSensors(argument):
            meaning = f"zero the rate sensors, argument {argument}"
        case UnknownCommand(byte):
            meaning = f"unknown command 0x{byte:02x}, ignored"
    return f"{ascii(encode(command)[:1].decode('latin-1'))[1:-1]}: {meaning}"


def _framed(payload: bytes) -> bytes:
    return HEADER + payload + bytes([checksum(payload)])


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


def is_whole(frame: bytes) -> bool:
    """Return True if a frame has the right sum."""
    return checksum(frame[1:-1]) == frame[-1]


def packet_of(mode: Mode, frame: bytes) -> Packet:
    """Return the packet in a frame of 18 bytes; header and checksum are not checked."""
    gx, gy, gz, ax, ay, az, temperature, ticks = _words_of(mode).unpack_from(frame, 1)
    return Packet(mode, (gx, gy, gz), (ax, ay, az), temperature, ticks)


def serial_number_of(frame: bytes) -> SerialNumber:
    """Return the serial number in a frame of 6 bytes."""
    return SerialNumber(*_SERIAL_WORD.unpack_from(frame, 1))


class CommandDecoder:
    """The unit's side: bytes from the host in, commands out."""

    def __init__(self) -> None:
        self._wants_argument = False

    def feed(self, data: bytes) -> list[AnyCommand]:
        """Take bytes from the line.

        `data`: any number of bytes; the argument of `z` may come in a later feed than its letter.
        """
        commands: list[AnyCommand] = []
        for byte in data:
            if self._wants_argument:
                self._wants_argument = False
                commands.append(ZeroRateSensors(byte))
            elif byte == _ZERO_LETTER[0]:
                self._wants_argument = True
            else:
                commands.append(_COMMAND_OF_LETTER.get(byte) or UnknownCommand(byte))
        return commands
