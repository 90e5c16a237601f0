"""Configuration fields of the 440, 380 and 381: numbers, what their values mean, and which go together.

Fields that a plain inertial unit does not have are left out: user switches, magnetic calibration, status enables.
"""

import enum
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

from imutui.instrument.transmitter import BITS_PER_BYTE
from imutui.instrument.uut.frames import OVERHEAD_BYTES


class Field(enum.IntEnum):
    """Numbers of fields; documents disagree which of the two low-pass filters is the rate sensors'."""

    RATE_DIVIDER = 0x0001
    BAUD = 0x0002
    PACKET_TYPE = 0x0003
    LOW_PASS_5 = 0x0005
    LOW_PASS_6 = 0x0006
    ORIENTATION = 0x0007


S1 = int.from_bytes(b"S1", "big")
"""The usual value of `Field.PACKET_TYPE`."""

QUIET = 0
"""The divider that stops the stream."""

# "100 Hz divided by": as the guides list them. No manual has 200 (which is 200 Hz) and 100; later firmware knows both.
RATE_OF_DIVIDER = {1: 100, 2: 50, 4: 25, 5: 20, 10: 10, 20: 5, 25: 4, 50: 2}
RATE_OF_DIVIDER_LATER = {200: 200, **RATE_OF_DIVIDER, 100: 1}
"""Packets a second by divider, Hz; without `QUIET`."""

BAUD_OF_CODE = {0: 9600, 1: 19200, 2: 38400, 3: 57600, 4: 4800, 5: 115200, 6: 230400, 7: 460800}
"""Speeds by the value of the field; the 440 and the 380 know 0 to 3, the 381 2, 3, 5 and 6."""

# Later firmware refuses a rate that would take more of the line than this.
_LINE_SHARE = 0.81


def fits_line(rate_hz: float, payload_bytes: int, baud: int) -> bool:
    """Return True if packets of so many payload bytes fit the line by the firmware's rule."""
    return rate_hz * (payload_bytes + OVERHEAD_BYTES) <= _LINE_SHARE * baud / BITS_PER_BYTE


# "X axis: Ux, Uy, Uz; Y axis: Uy, Uz, Ux; Z axis: Uz, Ux, Uy": two bits each, above a bit for the sign.
_AXES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
_BITS_PER_AXIS = 3


@dataclass(frozen=True, slots=True)
class Orientation:
    """How the axes of the packets lie in the case: a rotation by quarter turns."""

    field: int  # value of the field
    axes: tuple[int, ...]  # which axis of the case, 0 to 2, the X, Y and Z of the packets are
    signs: tuple[int, ...]  # +1 or -1 for each

    @property
    def mount(self) -> str:
        """Axes of the case in those of the packets, as `filters.imu.parse_mount` reads it: "x,-y,-z"."""
        packet_axes = (self.axes.index(axis) for axis in range(3))
        return ",".join(f"{'' if self.signs[k] > 0 else '-'}{'xyz'[k]}" for k in packet_axes)

    @property
    def text(self) -> str:
        """As the manuals write it: "+Ux +Uy +Uz"."""
        return " ".join(
            f"{'+' if sign > 0 else '-'}U{'xyz'[axis]}" for axis, sign in zip(self.axes, self.signs, strict=True)
        )


def _orientations() -> Iterator[Orientation]:
    for codes in product(range(3), repeat=3):
        axes = tuple(choice[code] for choice, code in zip(_AXES, codes, strict=True))
        for signs in product((1, -1), repeat=3):
            # a cyclic order of the axes makes a right-handed frame, any other one a left-handed
            if len(set(axes)) == 3 and math.prod(signs) == (1 if axes in _AXES else -1):
                bits = (code << 1 | (sign < 0) for code, sign in zip(codes, signs, strict=True))
                yield Orientation(sum(bit << _BITS_PER_AXIS * k for k, bit in enumerate(bits)), axes, signs)


ORIENTATIONS = {orientation.field: orientation for orientation in _orientations()}
"""The 24 that a unit takes, by the value of the field."""


def in_words(values: Mapping[int, int]) -> str:
    """Describe the fields in force; those that a unit did not report are left out.

    `values`: value by number of the field; 16 bits each.
    """
    said = []
    for field, value in values.items():
        match field:
            case Field.RATE_DIVIDER:
                rate = {QUIET: " (quiet)"} | {n: f" ({hz} Hz)" for n, hz in RATE_OF_DIVIDER_LATER.items()}
                said.append(f"rate divider {value}{rate.get(value, '')}")
            case Field.BAUD:
                said.append(f"{BAUD_OF_CODE[value]} baud" if value in BAUD_OF_CODE else f"baud rate field {value}")
            case Field.PACKET_TYPE:
                letters = value.to_bytes(2, "big")
                kind = letters.decode() if letters.isalnum() else f"{value:#06x}"
                said.append(f"packets {kind}")
            case Field.ORIENTATION:
                orientation = ORIENTATIONS.get(value)
                words = "which is none of the 24" if orientation is None else orientation.text
                said.append(f"orientation {value:#06x} ({words})")
            case _:
                # which filter it is, and what its steps are, documents disagree about
                said.append(f"field {field} {value}")
    return ", ".join(said)
