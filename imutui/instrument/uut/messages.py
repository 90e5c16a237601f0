"""What goes over the line of the 440, 380 and 381: requests, measurements and replies, and their payloads.

Left out is what a plain inertial unit does not have: attitude and navigation packets, magnetic calibration, and the
bootloader; and S2 of the 440, sums that no sample is made of. Their frames come as `OtherFrame`, and so does a payload
that is not what its type has: nothing raises for what comes.
"""

import enum
import struct
from dataclasses import dataclass
from typing import TypeAlias

from imutui.instrument.counts import PacketDetails, Scaling, Triple
from imutui.instrument.uut.frames import Frame, framed

SCALING = Scaling(rate_lsb_dps=1260.0 / 2**16, accel_lsb_g=20.0 / 2**16, temperature_lsb_degc=200.0 / 2**16)
"""Of S0 and S1, in the axes and signs of the packets; the same for all units. "1260 / 2^16 deg/s": 7 pi rad/s."""


class Memory(enum.Enum):
    """Where configuration fields are kept."""

    RAM = "RAM"
    """In force at once, gone with the power."""

    EEPROM = "EEPROM"
    """In force from the next power-up on."""


class Bit(enum.IntFlag, boundary=enum.KEEP):
    """Flags of the status word that the manuals call BIT, built-in test; all other bits are reserved."""

    MASTER_FAIL = 1 << 0
    HARDWARE_ERROR = 1 << 1
    COM_ERROR = 1 << 2
    SOFTWARE_ERROR = 1 << 3
    MASTER_STATUS = 1 << 8
    HARDWARE_STATUS = 1 << 9
    COM_STATUS = 1 << 10
    SOFTWARE_STATUS = 1 << 11
    SENSOR_STATUS = 1 << 12
    """A sensor is beyond its range."""


def names_of_bits(word: int) -> tuple[str, ...]:
    """Return the names of the bits set in a status word, from the lowest: "hardware error", "reserved 5"."""
    return tuple(
        (Bit(1 << place).name or f"reserved {place}").lower().replace("_", " ")
        for place in range(16)
        if word >> place & 1
    )


# ------------------------------------------------------------------------------------------------------ both directions


@dataclass(frozen=True, slots=True)
class Ping:
    """Ask for a sign of life, and the answer to it."""


@dataclass(frozen=True, slots=True)
class Echo:
    """Ask to have bytes sent back, and the answer to it."""

    payload: bytes


@dataclass(frozen=True, slots=True)
class Reset:
    """Restart as after power-up, and the answer to it, which comes before."""


@dataclass(frozen=True, slots=True)
class OtherFrame:
    """A whole frame of an unknown type, or one whose payload is not what its type has."""

    type: bytes  # two bytes
    payload: bytes


# ------------------------------------------------------------------------------------------------ requests, to the unit


@dataclass(frozen=True, slots=True)
class GetPacket:
    """Ask for one packet of a type, such as b"ID"; it comes with its own type."""

    type: bytes


@dataclass(frozen=True, slots=True)
class GetFields:
    """Ask for configuration fields by number."""

    memory: Memory
    ids: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class SetFields:
    """Set configuration fields: pairs of number and value."""

    memory: Memory
    values: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class ReadFactoryWords:
    """Ask for words of the factory's memory: the first one's address, and how many."""

    address: int
    count: int


# ----------------------------------------------------------------------------------------------- replies, from the unit


@dataclass(frozen=True, slots=True)
class Fields:
    """The reply to `GetFields`: pairs of number and value of the fields that there are."""

    memory: Memory
    values: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class FieldsSet:
    """The reply to `SetFields`: numbers of the fields that were taken."""

    memory: Memory
    ids: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class FactoryWords:
    """The reply to `ReadFactoryWords`."""

    address: int
    words: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Refused:
    """A request that the unit refuses, wholly or in part, by its type."""

    type: bytes


@dataclass(frozen=True, slots=True)
class Identification:
    """Serial number, and a text: model, part number of the firmware, and more, with spaces between."""

    serial_number: int
    text: str


@dataclass(frozen=True, slots=True)
class Version:
    """Version of the firmware."""

    major: int
    minor: int
    patch: int
    stage: int
    build: int

    @property
    def text(self) -> str:
        """All five with points between."""
        return f"{self.major}.{self.minor}.{self.patch}.{self.stage}.{self.build}"


@dataclass(frozen=True, slots=True)
class StatusWords:
    """Packet T0: the status word and the 13 that say more."""

    words: tuple[int, ...]


# --------------------------------------------------------------------------------------------------------- measurements


class Measured:
    """What the session takes of either packet; see `counts.DataPacket`. The temperature is the X rate sensor's."""

    __slots__ = ()
    rate_temperatures: Triple
    board_temperature: int
    counter: int
    bit: int

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
class PacketS1(Measured):
    """Packet S1, in counts with sign; every unit of the family has it."""

    # accels, rates: X, Y, Z
    accels: Triple
    rates: Triple
    rate_temperatures: Triple  # of the rate sensors X, Y, Z
    board_temperature: int  # declared unused on the IMU380ZA-200
    counter: int  # 0 to 65535. Its meaning depends on the unit: see `counter`.
    # status word, declared unused on the IMU380ZA-200; none of its flags says that the data are bad
    bit: int


@dataclass(frozen=True, slots=True)
class PacketS0(Measured):
    """Packet S0: as S1, with a magnetometer."""

    # accels, rates, magnetics: X, Y, Z
    accels: Triple
    rates: Triple
    magnetics: Triple
    rate_temperatures: Triple  # of the rate sensors X, Y, Z
    board_temperature: int
    counter: int  # 0 to 65535: time of week, a timer or nothing, by the product
    bit: int  # status word


Measurement: TypeAlias = PacketS0 | PacketS1
Request: TypeAlias = Ping | Echo | Reset | GetPacket | GetFields | SetFields | ReadFactoryWords | OtherFrame
Reply: TypeAlias = (
    Ping
    | Echo
    | Reset
    | Fields
    | FieldsSet
    | FactoryWords
    | Refused
    | Identification
    | Version
    | StatusWords
    | OtherFrame
)


# ------------------------------------------------------------------------------------------------------------ payloads

GET = {Memory.RAM: b"GF", Memory.EEPROM: b"RF"}
SET = {Memory.RAM: b"SF", Memory.EEPROM: b"WF"}
_MEMORY = {kind: memory for kinds in (GET, SET) for memory, kind in kinds.items()}

# "Accelerations, rates, magnetometer, temperatures of the rate sensors: X, Y, Z each; board temperature, time, BIT."
_S0 = struct.Struct(">13h2H")
# "Accelerations, rates, temperatures of the rate sensors: X, Y, Z each; board temperature, counter, BIT."
_S1 = struct.Struct(">10h2H")
_STATUS = struct.Struct(">14H")
_SERIAL = struct.Struct(">I")
_FACTORY = struct.Struct(">HB")


def read_request(frame: Frame) -> Request:
    """Return the request in a frame from the host."""
    payload = frame.payload
    match frame.type, len(payload):
        case (b"PK", 0):
            return Ping()
        case (b"SR", 0):
            return Reset()
        case (b"CH", _):
            return Echo(payload)
        case (b"GP", 2):
            return GetPacket(payload)
        case (b"GF" | b"RF", _) if ids := _listed(payload, ">H"):
            return GetFields(_MEMORY[frame.type], tuple(each for (each,) in ids))
        case (b"SF" | b"WF", _) if pairs := _listed(payload, ">HH"):
            return SetFields(_MEMORY[frame.type], tuple((number, value) for number, value in pairs))
        case (b"RE", 3):
            return ReadFactoryWords(*_FACTORY.unpack(payload))
    return OtherFrame(frame.type, payload)


def read_reply(frame: Frame) -> Measurement | Reply:
    """Return the measurement or reply in a frame from the unit."""
    payload = frame.payload
    match frame.type, len(payload):
        case (b"S0", _S0.size):
            ax, ay, az, gx, gy, gz, mx, my, mz, tx, ty, tz, board, time, bit = _S0.unpack(payload)
            return PacketS0((ax, ay, az), (gx, gy, gz), (mx, my, mz), (tx, ty, tz), board, time, bit)
        case (b"S1", _S1.size):
            ax, ay, az, gx, gy, gz, tx, ty, tz, board, counter, bit = _S1.unpack(payload)
            return PacketS1((ax, ay, az), (gx, gy, gz), (tx, ty, tz), board, counter, bit)
        case (b"PK", 0):
            return Ping()
        case (b"SR", 0):
            return Reset()
        case (b"CH", _):
            return Echo(payload)
        case (b"\x15\x15", 2):
            return Refused(payload)
        case (b"ID", length) if length >= _SERIAL.size:
            return _identification(payload)
        case (b"VR", 5):
            return Version(*payload)
        case (b"T0", _STATUS.size):
            return StatusWords(_STATUS.unpack(payload))
        case (b"GF" | b"RF", _) if pairs := _listed(payload, ">HH"):
            return Fields(_MEMORY[frame.type], tuple((number, value) for number, value in pairs))
        case (b"SF" | b"WF", _) if ids := _listed(payload, ">H"):
            return FieldsSet(_MEMORY[frame.type], tuple(each for (each,) in ids))
        case (b"RE", length) if length >= _FACTORY.size and length == _FACTORY.size + 2 * payload[2]:
            address, count = _FACTORY.unpack_from(payload)
            return FactoryWords(address, struct.unpack_from(f">{count}H", payload, _FACTORY.size))
    return OtherFrame(frame.type, payload)


def encode(message: Request | Reply | Measurement) -> bytes:
    """Write a request, a reply or a measurement as it goes over the line.

    `message`: anything that either decoder returns, but `Discarded`.
    Raises ValueError if a field does not fit its place on the line.
    """
    try:
        return framed(frame_of(message))
    except struct.error as error:
        raise ValueError(f"`message` has a number that does not fit its place: {message}") from error


def frame_of(message: Request | Reply | Measurement) -> Frame:
    """Return the frame of a message; raises struct.error where a number does not fit."""
    match message:
        case PacketS0(accels, rates, magnetics, temperatures, board, counter, bit):
            return Frame(b"S0", _S0.pack(*accels, *rates, *magnetics, *temperatures, board, counter, bit))
        case PacketS1(accels, rates, temperatures, board, counter, bit):
            return Frame(b"S1", _S1.pack(*accels, *rates, *temperatures, board, counter, bit))
        case Ping():
            return Frame(b"PK")
        case Reset():
            return Frame(b"SR")
        case Echo(payload):
            return Frame(b"CH", payload)
        case OtherFrame(kind, payload):
            return Frame(kind, payload)
        case GetPacket(kind):
            return Frame(b"GP", kind)
        case Refused(kind):
            return Frame(b"\x15\x15", kind)
        case GetFields(memory, ids):
            return Frame(GET[memory], _list_of(ids))
        case FieldsSet(memory, ids):
            return Frame(SET[memory], _list_of(ids))
        case Fields(memory, values):
            return Frame(GET[memory], _list_of_pairs(values))
        case SetFields(memory, values):
            return Frame(SET[memory], _list_of_pairs(values))
        case ReadFactoryWords(address, count):
            return Frame(b"RE", _FACTORY.pack(address, count))
        case FactoryWords(address, words):
            return Frame(b"RE", _FACTORY.pack(address, len(words)) + struct.pack(f">{len(words)}H", *words))
        case Identification(number, text):
            return Frame(b"ID", _SERIAL.pack(number) + _ascii(text) + b"\0")
        case Version(major, minor, patch, stage, build):
            return Frame(b"VR", struct.pack("5B", major, minor, patch, stage, build))
        case StatusWords(words):
            return Frame(b"T0", _STATUS.pack(*words))


def _identification(payload: bytes) -> Identification:
    (number,) = _SERIAL.unpack_from(payload)
    text = payload[_SERIAL.size :].removesuffix(b"\0")
    return Identification(number, text.decode("ascii", "backslashreplace"))


def _ascii(text: str) -> bytes:
    if not text.isascii():
        raise ValueError(f"`text` must be ASCII, not {text!r}")
    return text.encode("ascii")


def _listed(payload: bytes, each: str) -> list[tuple[int, ...]]:
    """Return the entries of a payload that begins with their number; none if the length differs, or the number is 0."""
    if not payload or len(payload) != 1 + payload[0] * struct.calcsize(each):
        return []
    return list(struct.iter_unpack(each, payload[1:])) if payload[0] else []


def _list_of(ids: tuple[int, ...]) -> bytes:
    return struct.pack(f">B{len(ids)}H", len(ids), *ids)


def _list_of_pairs(values: tuple[tuple[int, int], ...]) -> bytes:
    return struct.pack(f">B{2 * len(values)}H", len(values), *(word for pair in values for word in pair))
