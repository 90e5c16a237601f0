"""Which unit of the family a virtual one is: identity, fields as they leave the factory, and what documents dispute."""

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from imutui.instrument.uut.counter import Meaning
from imutui.instrument.uut.fields import Field
from imutui.instrument.uut.messages import Version

FieldValues: TypeAlias = tuple[tuple[int, int], ...]

_S1 = int.from_bytes(b"S1", "big")

# "38400 baud, S1, 100 Hz, 10 Hz Butterworth, orientation 0x006B"; the value of the filter is one of those for 10 Hz.
IMU380ZA_200: FieldValues = (
    (Field.RATE_DIVIDER, 1),
    (Field.BAUD, 2),
    (Field.PACKET_TYPE, _S1),
    (Field.LOW_PASS_5, 5000),
    (Field.LOW_PASS_6, 5000),
    (Field.ORIENTATION, 0x006B),
)
# "115200 baud, S1, 100 Hz, 25 Hz": as a stand-in for a real IMU381 has them in its maker's tests.
IMU381ZA: FieldValues = (
    (Field.RATE_DIVIDER, 1),
    (Field.BAUD, 5),
    (Field.PACKET_TYPE, _S1),
    (Field.LOW_PASS_5, 0x085E),
    (Field.LOW_PASS_6, 0x085E),
    (Field.ORIENTATION, 0x0000),
)


@dataclass(frozen=True)
class UnitOptions:
    """What may differ from unit to unit, or is disputed between documents."""

    serial_number: int = 9911750  # first part of the answer to a request for ID
    # the other part: model, part number, version of the firmware and whatever follows, with spaces between. Other
    # programs need three words.
    text: str = "IMU381ZA-200 VIRTUAL 1.0"
    text_ends_with_zero: bool = True  # whether a zero byte follows it
    version: Version = field(default_factory=lambda: Version(1, 0, 0, 0, 0))  # the answer to a request for VR
    # configuration fields in EEPROM at first, as number and value; a unit knows no others
    fields: FieldValues = IMU381ZA
    packet_types: tuple[bytes, ...] = (b"S1", b"S0")  # measurements that it has; the first is the usual one
    baud_codes: tuple[int, ...] = (2, 3, 5, 6)  # values of the field `BAUD` that it takes
    # rate of its own loop, Hz, 100 or 200; only the latter has the dividers of later firmware
    loop_hz: Literal[100, 200] = 100
    counter: Meaning = Meaning.TIME  # what the counter of S1 counts
    bit: int = 0  # its status word
    # address and word of the factory's memory; a unit refuses to read others
    factory_words: tuple[tuple[int, int], ...] = ((0x071C, 0x0081),)
    # whether the reply to a new speed comes at that speed, as the manuals say, or at the old one
    new_baud_at_once: bool = True
    boot_s: float = 0.1  # how long it is deaf and silent after a restart
    reply_delay_s: float = 0.0  # how late it answers
    clock_skew_ppm: float = 0.0  # how much faster than the host's its clock runs: loop, counter and line
