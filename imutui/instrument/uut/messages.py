"""What goes over the line of the 440, 380 and 381: requests, measurements and replies, without their bytes.

Left out is what a plain inertial unit does not have: attitude and navigation packets, magnetic calibration, and the
bootloader. Their frames come as `OtherFrame`.
"""

import enum
from dataclasses import dataclass
from typing import TypeAlias

from imutui.instrument.discarded import Discarded

Triple: TypeAlias = tuple[int, int, int]


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
    """Names of the bits that are set in a status word, from the lowest: "hardware error", "reserved 5"."""
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

    @property
    def bit(self) -> Bit:
        """Flags of the first word."""
        return Bit(self.words[0])


# --------------------------------------------------------------------------------------------------------- measurements


@dataclass(frozen=True, slots=True)
class PacketS1:
    """Packet S1, in counts with sign; every unit of the family has it."""

    # accels, rates: X, Y, Z
    accels: Triple
    rates: Triple
    rate_temperatures: Triple  # of the rate sensors X, Y, Z
    board_temperature: int  # declared unused on the IMU380ZA-200
    counter: int  # 0 to 65535. Its meaning depends on the unit: see `counter`.
    bit: int  # status word; see `flags`. Declared unused on the IMU380ZA-200.

    @property
    def flags(self) -> Bit:
        """Status flags. None of them says that the data are bad."""
        return Bit(self.bit)


@dataclass(frozen=True, slots=True)
class PacketS0:
    """Packet S0: as S1, with a magnetometer."""

    # accels, rates, magnetics: X, Y, Z
    accels: Triple
    rates: Triple
    magnetics: Triple
    rate_temperatures: Triple  # of the rate sensors X, Y, Z
    board_temperature: int
    time: int  # 0 to 65535: time of week, a timer or nothing, by the product
    bit: int  # status word

    @property
    def flags(self) -> Bit:
        """Status flags. None of them says that the data are bad."""
        return Bit(self.bit)


@dataclass(frozen=True, slots=True)
class PacketS2:
    """Packet S2 of the 440: sums over the time since the packet before."""

    # velocity_steps, angle_steps: X, Y, Z, 32 bits with sign
    velocity_steps: Triple
    angle_steps: Triple
    counter: int
    bit: int  # status word

    @property
    def flags(self) -> Bit:
        """Status flags. None of them says that the data are bad."""
        return Bit(self.bit)


Measurement: TypeAlias = PacketS0 | PacketS1 | PacketS2
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
Event: TypeAlias = Measurement | Reply | Discarded
