"""The Crossbow "DMU" serial protocol of the IMU300CC, IMU400CC and IMU400CD: commands, replies and packets.

`decoder` is the host's side of the line. What other members of the family add is left out: magnetometer words and angle
mode (AHRS, VG), and built-in test.
"""

import enum
import struct
from collections.abc import Iterable
from dataclasses import dataclass

# "38400 baud at power-up; 8 data bits, 1 start bit, 1 stop bit, no parity."
POWER_UP_BAUD = 38400

# "Header 0xFF, eight 16-bit words, MSB first, checksum": 18 bytes in scaled and in voltage mode.
HEADER = b"\xff"
PACKET_BYTES = 18

# "Header 0xFF, four bytes of serial number, MSB first, checksum."
SERIAL_BYTES = 6

# "The time counter counts down from 65535 to 0, and wraps"; "one tick is 0.79 microseconds".
TICK_S = 0.79e-6


class Mode(enum.Enum):
    """Measurement mode: what the words of a packet mean."""

    SCALED = "scaled"
    VOLTAGE = "voltage"


# "Scaled data is two's complement; temperature and time are unsigned." Voltage words are all unsigned.
_WORDS = {Mode.SCALED: struct.Struct(">6h2H"), Mode.VOLTAGE: struct.Struct(">8H")}


# ------------------------------------------------------------------------------------------- commands and their replies


class Command(bytes, enum.Enum):
    """Commands of one letter: "single ASCII bytes, case sensitive, without line end". A unit ignores other bytes."""

    PING = b"R"
    """Some units reset themselves on it, so set the mode again afterwards."""
    SCALED_MODE = b"c"
    VOLTAGE_MODE = b"r"
    STOP_STREAM = b"P"
    """There is no reply, and the packet already begun still arrives."""
    START_STREAM = b"C"
    """There is no reply but the packets."""
    GET_PACKET = b"G"
    """During a stream it also returns the unit to polled mode."""
    SERIAL_NUMBER = b"S"
    VERSION = b"v"
    ZERO_RATES = b"z"
    """A byte follows it, see `zero_rates`."""
    REQUEST_BAUD = b"b"
    """Sent at the present speed, and answered at it."""
    MEASURE_BAUD = b"a"
    """The unit measures the new speed from this byte. Outside a change a plain IMU ignores it."""


LETTER_REPLIES = {
    Command.PING: "H",
    Command.SCALED_MODE: "C",
    Command.VOLTAGE_MODE: "R",
    Command.ZERO_RATES: "Z",
    Command.REQUEST_BAUD: "B",
    Command.MEASURE_BAUD: "A",
}
"""Commands that a letter answers."""


def zero_rates(argument: int) -> bytes:
    """Return the command to average the rate sensors, unit still, and subtract the mean from then on.

    `argument`: length of the average, 0 to 255, in a unit that the sources dispute; 0 erases the stored zero.
    """
    return Command.ZERO_RATES + bytes([argument])


def in_words(command: bytes) -> str:
    """Describe a command, for a log: "c: scaled mode"."""
    letter = command[:1]
    meaning = Command(letter).name.lower().replace("_", " ") if letter in set(Command) else "unknown, ignored"
    return f"{ascii(letter.decode('latin-1'))[1:-1]}: {' '.join([meaning, *map(str, command[1:])])}"


class CommandDecoder:
    """The unit's side: bytes from the host in, commands out; `Command.ZERO_RATES` comes with its argument."""

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes from the line, any number, cut anywhere."""
        commands: list[bytes] = []
        for byte in data:
            command = self._begun + bytes([byte])
            self._begun = command if command == Command.ZERO_RATES else b""
            if not self._begun:
                commands.append(command)
        return commands


# ------------------------------------------------------------------------------------------------- frames, unit to host


@dataclass(frozen=True, slots=True)
class Packet:
    """One data packet, in counts."""

    mode: Mode  # the mode that the host assumed; it is not in the packet
    # rates, accels: X, Y, Z; signed in scaled mode, unsigned sensor voltages in voltage mode
    rates: tuple[int, int, int]
    accels: tuple[int, int, int]
    temperature: int  # voltage of the temperature sensor
    ticks: int  # time counter when the sensors were sampled; it counts down

    @property
    def details(self) -> None:
        """Nothing: it has no more than this."""


def checksum(payload: Iterable[int]) -> int:
    """Return the sum of the bytes between header and checksum, modulo 256.

    One manual prints 255 in one place; every driver that has met hardware uses 256.
    """
    return sum(payload) & 0xFF


def framed(payload: bytes) -> bytes:
    """Return a frame: of a packet's words, of a serial number, or of a version text."""
    return HEADER + payload + bytes([checksum(payload)])


def is_whole(frame: bytes) -> bool:
    """Return True if a frame has the right sum."""
    return checksum(frame[1:-1]) == frame[-1]


def serial_number_frame(number: int) -> bytes:
    """Return the reply to `Command.SERIAL_NUMBER`."""
    return framed(number.to_bytes(SERIAL_BYTES - 2, "big"))


def serial_number_in(frame: bytes) -> str:
    """Return the serial number in a frame of 6 bytes."""
    return str(int.from_bytes(frame[1:-1], "big"))


def encode(packet: Packet) -> bytes:
    """Return a packet as it goes over the line; raises ValueError if a word does not fit its place."""
    words = *packet.rates, *packet.accels, packet.temperature, packet.ticks
    try:
        return framed(_WORDS[packet.mode].pack(*words))
    except struct.error as error:
        raise ValueError(f"`packet` must hold 16-bit words, not {packet}") from error


def packet_of(mode: Mode, frame: bytes) -> Packet:
    """Return the packet in a frame of 18 bytes; header and checksum are not checked."""
    gx, gy, gz, ax, ay, az, temperature, ticks = _WORDS[mode].unpack_from(frame, 1)
    return Packet(mode, (gx, gy, gz), (ax, ay, az), temperature, ticks)
