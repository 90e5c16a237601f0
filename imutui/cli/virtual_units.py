"""Which virtual unit `imutui virtual` runs: an IMU400CD, an IMU381, or a recorded stream of one, byte for byte."""

import os
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from filters.errors import InputError
from filters.imu import IMU440CA_200, AxisMap
from filters.simulation import Scenario
from imutui import outside_file
from imutui.cli.virtual_readings import Asked, line_of, on_the_line, scenario_of
from imutui.instrument import names
from imutui.instrument.imu400 import unit as imu400cd
from imutui.instrument.uut import unit as uut
from imutui.instrument.uut.fields import RATE_OF_DIVIDER, Field
from imutui.instrument.uut.packet_makers import RecordedStream
from imutui.instrument.uut.unit_options import IMU381ZA, UnitOptions
from imutui.instrument.virtual import Line
from imutui.instrument.virtual_instrument import VirtualInstrument

SERIAL_NUMBER = 9911750
"""Serial number of a virtual unit of the seed 0; that of seed N is N higher."""
_OF_LINKS = range(10_000_000, 100_000_000)
"""Serial numbers of virtual units that only their link tells apart."""

_IMU381 = "IMU381ZA-200"
_IMU381_LOOP_HZ = 100
# "Level, z reads -1 g": specific force, with z down
_IMU381_PLAIN = Scenario(axes=AxisMap(accel_sign=1), spec=IMU440CA_200)

# The one recorded stream that there is comes without an identity; this is what its maker's own stand-in says.
_RECORDED_SERIAL_NUMBER = 2008705635
_RECORDED_TEXT = "IMU381ZA-400 5020-1383-01 10.00.01"
_RECORDED_VERSION = (10, 0, 1, 0, 0)
_RECORDED_BIT = 2
# what a scenario may have that would change readings, and how files call it
_OF_READINGS = {
    "spec": "noise",
    "accel_bias": "biases",
    "gyro_bias": "biases",
    "accel_bias_run_sd": "biases",
    "gyro_bias_run_sd": "biases",
    "temperature": "temperature",
    "profile": "motion",
    "effects": "effects",
    "power_ons": "power-ons",
}
# an hour at the highest rate
_LONGEST_STREAM = 64 * 2**20


@dataclass(frozen=True, slots=True)
class VirtualSetting:
    """A unit, its line, where its readings come from in words ("" where its identity says enough), its table.

    `keep_up`: see `UnitOnTheLine`.
    """

    unit: VirtualInstrument[Any, Any]
    line: Line | None
    source: str
    keep_up: Callable[[float], None] | None = None


def imu400cd_unit(asked: Asked, serial_number: int | None) -> VirtualSetting:
    """An IMU400CD-200."""
    made = on_the_line(asked)
    options = made.options(serial_number_of(asked, made.seed) if serial_number is None else serial_number)
    unit = imu400cd.VirtualUnit(made.readings, options, made.seed)
    return VirtualSetting(unit, made.line, made.source, made.keep_up)


def imu381_unit(asked: Asked, serial_number: int | None) -> VirtualSetting:
    """An IMU381ZA-200."""
    made = on_the_line(asked, _IMU381_LOOP_HZ, _IMU381_PLAIN)
    options = UnitOptions(
        serial_number=serial_number_of(asked, made.seed) if serial_number is None else serial_number,
        text=made.text(f"{_IMU381} {made.version.partition(' ')[2]}") + "\0",
        clock_skew_ppm=made.personality.clock_skew_ppm,
    )
    unit = uut.VirtualUnit(made.readings, options, made.seed)
    return VirtualSetting(unit, made.line, made.source, made.keep_up)


def serial_number_of(asked: Asked, seed: int) -> int:
    """Serial number of a virtual unit, the same each time that the same unit is asked for.

    The seed makes the unit, so it makes the number. Without a seed and a scenario the link tells units apart.
    """
    if asked.link is None or asked.seed is not None or asked.scenario is not None:
        return (SERIAL_NUMBER + seed) % 2**32
    return _OF_LINKS[zlib.crc32(os.fsencode(asked.link)) % len(_OF_LINKS)]


UNITS: dict[str, Callable[[Asked, int | None], VirtualSetting]] = {
    names.IMU400CD: imu400cd_unit,
    names.IMU381: imu381_unit,
}
"""What makes the virtual unit of each instrument, from what is asked and, if one is given, a serial number."""


def instrument_of(recording: Path | None) -> str:
    """Which unit a recording is of, by name; the usual one where it does not say, or is no log."""
    from imutui.instrument import registry
    from imutui.logbook import summary

    if recording is None or recording.suffix.lower() != ".mcap":
        return names.DEFAULT
    try:
        model = summary.read(recording).session.get("instrument", "")
    except OSError:  # whoever plays it says why it can't be read
        return names.DEFAULT
    return registry.of_model(model).name


def recorded_unit(path: Path, scenario: Path | None, seed: int | None, serial_number: int | None) -> VirtualSetting:
    """A unit that sends a recorded stream as it is, once it is told the stream's own rate; quiet at power-up.

    `scenario`: what happens on the wire; it can't change readings.
    `seed`: wins over the scenario's.
    `serial_number`: none: that of the recorded unit.
    Raises InputError if the scenario makes readings.
    Raises ImportDataError if there is nothing to play.
    """
    from imutui.logbook.importing.table import ImportDataError

    made, plain = scenario_of(scenario, seed), Scenario()
    changed = [words for name, words in _OF_READINGS.items() if getattr(made, name) != getattr(plain, name)]
    if changed:
        raise InputError(
            f"{path} is played byte for byte: leave {', '.join(dict.fromkeys(changed))} out of {scenario}."
        )
    try:
        stream = RecordedStream(outside_file.read(path, _LONGEST_STREAM))
    except (OSError, InputError) as error:
        why = f"{error.strerror}. Check the path" if isinstance(error, OSError) else error
        raise ImportDataError(f"{path} can't be played: {why}.") from error
    fields = {**dict(IMU381ZA), **dict(stream.only), Field.RATE_DIVIDER: 0}
    options = UnitOptions(
        serial_number=_RECORDED_SERIAL_NUMBER if serial_number is None else serial_number,
        text=_RECORDED_TEXT,
        version=_RECORDED_VERSION,
        fields=tuple(fields.items()),
        packet_types=(stream.kind,),
        # a divider that no manual has is one of later firmware
        loop_hz=100 if stream.divider in RATE_OF_DIVIDER else 200,
        bit=_RECORDED_BIT,
        clock_skew_ppm=made.personality.clock_skew_ppm,
    )
    said = (
        f"plays {path.name} as {_RECORDED_TEXT.split()[0]} #{options.serial_number}, and a host calls that measured:"
        " only for bytes that a real unit sent"
    )
    return VirtualSetting(uut.VirtualUnit(stream, options, made.seed), line_of(made), said)
