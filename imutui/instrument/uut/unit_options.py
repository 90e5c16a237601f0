"""Options of a virtual unit of the family, and its fields: in RAM, where they are in force, and in EEPROM."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

from imutui.instrument import virtual_instrument
from imutui.instrument.uut.fields import (
    BAUD_OF_CODE,
    ORIENTATIONS,
    QUIET,
    RATE_OF_DIVIDER,
    RATE_OF_DIVIDER_LATER,
    S1,
    Field,
    fits_line,
)
from imutui.instrument.uut.frames import FIXED_LENGTHS
from imutui.instrument.uut.messages import Memory

FieldValues: TypeAlias = tuple[tuple[int, int], ...]

# "115200 baud, S1, 100 Hz, 25 Hz": as a stand-in for a real IMU381 has them in its maker's tests.
IMU381ZA: FieldValues = (
    (Field.RATE_DIVIDER, 1),
    (Field.BAUD, 5),
    (Field.PACKET_TYPE, S1),
    (Field.LOW_PASS_5, 0x085E),
    (Field.LOW_PASS_6, 0x085E),
    (Field.ORIENTATION, 0x0000),
)


@dataclass(frozen=True)
class UnitOptions(virtual_instrument.UnitOptions):
    """What differs from unit to unit."""

    # text behind the serial number: model, part number, version of the firmware and more, with spaces between, and a
    # zero where the unit ends it so; other programs need three words
    text: str = "IMU381ZA-200 VIRTUAL 1.0\0"
    version: tuple[int, ...] = (1, 0, 0, 0, 0)  # the answer to a request for VR
    # configuration fields in EEPROM at first, as number and value; a unit knows no others
    fields: FieldValues = IMU381ZA
    packet_types: tuple[bytes, ...] = (b"S1", b"S0")  # measurements that it has; the first is the usual one
    baud_codes: tuple[int, ...] = (2, 3, 5, 6)  # values of the field `BAUD` that it takes
    # rate of its own loop, Hz, 100 or 200; only the latter has the dividers of later firmware
    loop_hz: Literal[100, 200] = 100
    bit: int = 0  # its status word


# Fields that are judged together: a rate has to fit the line.
_TOGETHER = (Field.RATE_DIVIDER, Field.BAUD, Field.PACKET_TYPE)


class Configuration:
    """The fields of a unit.

    `options`: its fields at first, and what it takes.
    `only`: fields that take no value but this; a divider may be `QUIET` all the same.
    `baud`: speed in force.
    `packet_type`: type of the stream's packets in force.
    `rate_hz`: packets a second in force; 0 if the unit is quiet.
    `orientation`: orientation in force.
    """

    def __init__(self, options: UnitOptions, only: FieldValues = ()) -> None:
        self._rates = RATE_OF_DIVIDER if options.loop_hz == 100 else RATE_OF_DIVIDER_LATER
        kinds = {int.from_bytes(kind, "big") for kind in options.packet_types}
        # values that a field takes; any where it is not named
        self._values: dict[int, Collection[int]] = {
            Field.RATE_DIVIDER: self._rates,
            Field.BAUD: options.baud_codes,
            Field.PACKET_TYPE: kinds,
            Field.ORIENTATION: ORIENTATIONS,
            **{number: {value} for number, value in only},
        }
        self._values[Field.RATE_DIVIDER] = {QUIET, *self._values[Field.RATE_DIVIDER]}
        self._kept = {Memory.EEPROM: dict(options.fields)}
        self.power_up()

    def power_up(self) -> None:
        """Put what is in EEPROM in force."""
        self._kept[Memory.RAM] = dict(self._kept[Memory.EEPROM])
        self._put_in_force()

    def _put_in_force(self) -> None:
        ram = self._kept[Memory.RAM]
        self.baud = BAUD_OF_CODE[ram[Field.BAUD]]
        self.packet_type = ram[Field.PACKET_TYPE].to_bytes(2, "big")
        self.rate_hz = self._rates.get(ram[Field.RATE_DIVIDER], 0)
        self.orientation = ORIENTATIONS[ram[Field.ORIENTATION]]

    def get(self, memory: Memory, ids: Iterable[int]) -> FieldValues:
        """Return fields by number, without those that it does not have."""
        kept = self._kept[memory]
        return tuple((number, kept[number]) for number in ids if number in kept)

    def put(self, memory: Memory, values: FieldValues) -> tuple[int, ...]:
        """Take new values as far as they are possible; return the numbers of the fields that were taken."""
        kept = self._kept[memory]
        good = {n: value for n, value in values if n in kept and value in self._values.get(n, (value,))}
        if not self._go_together({**kept, **good}):
            good = {number: value for number, value in good.items() if number not in _TOGETHER}
        kept.update(good)
        self._put_in_force()
        return tuple(number for number, value in values if good.get(number) == value)

    def _go_together(self, kept: dict[int, int]) -> bool:
        rate_hz = self._rates.get(kept[Field.RATE_DIVIDER], 0)
        payload_bytes = FIXED_LENGTHS[kept[Field.PACKET_TYPE].to_bytes(2, "big")]
        return fits_line(rate_hz, payload_bytes, BAUD_OF_CODE[kept[Field.BAUD]])
