"""Which unit a virtual one is, and what it measures: records, and the protocol of a source of readings."""

from dataclasses import dataclass, field
from typing import Literal

from filters.imu import LOOP_HZ
from imutui.instrument.imu400.crossbow import Mode, Scaling

VERSION_CHARACTERS = 30
"""The longest text of an answer to `v`."""


@dataclass(frozen=True)
class UnitOptions:
    """What may differ from unit to unit, or is disputed between documents."""

    serial_number: int = 9911750  # the answer to `S`
    # the answer to `v`, at most 30 characters; 24 on the units that others have seen
    version: str = "IMU400CD-200 VIRTUAL 1.0"
    # where the readings come from, for a unit that can say more than fits into a version. The version then ends in "+"
    # and a number: so many further `v` are answered with the text piece by piece; a ping begins anew. No real unit has
    # it.
    source: str = ""
    # what `R` does besides answering: nothing (VG700M manual); it stops the stream and keeps the mode (seen on
    # hardware); it returns to power-up, voltage mode and polled (AHRS400 manual)
    ping: Literal["keeps", "stops", "resets"] = "stops"
    power_up_mode: Mode = Mode.VOLTAGE  # mode at power-up, and after an `R` that resets. The unit is polled then.
    # loop_hz, loop_hz_voltage: rate of the unit's own loop in scaled and in voltage mode. The line may allow less.
    loop_hz: float = LOOP_HZ
    loop_hz_voltage: float = 213.3
    # samples averaged for each unit of the argument of `z`; 10 or 100 by different sources
    zero_samples_per_unit: int = 10
    scaling: Scaling = field(default_factory=Scaling)  # ranges of the model
    reply_delay_s: float = 0.0  # how late it answers; packets are never late. While an answer is due no packet begins.
    # whether the answer to `v` comes without header and checksum, as the manuals can be read
    version_plain_text: bool = False
    auto_baud: bool = True  # whether it knows `b`; else it is silent on it
    clock_skew_ppm: float = 0.0  # how much faster than the host's its clock runs: loop, counter and line
