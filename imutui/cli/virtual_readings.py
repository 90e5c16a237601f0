"""Readings for the virtual instrument: a simulated unit, a recording, or a recording with something added."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from filters.errors import InputError
from filters.imu import STANDARD_GRAVITY
from filters.simulation import LOOP_HZ, OnTable, Personality, Scenario, Temperature, Unit
from filters.simulation.background import Background
from imutui.cli.played_recording import PlayedReadings, PlayedRecording, load
from imutui.cli.spoil import ErrorFunction, Spoiled
from imutui.instrument.imu400.unit import UnitOptions
from imutui.instrument.virtual import Line
from imutui.instrument.virtual_instrument import Reading, Source

SIMULATED = "IMU400CD-200 VIRTUAL SIM"
PLAYED = "IMU400CD-200 VIRTUAL REC"

# fates of readings are asked for while their packets are on the line: a few readings later at the slowest speed
_REMEMBERED = 256
_BEHIND = 4096  # readings: whoever asks next asks for later ones
_ROOM = Temperature(((0.0, 25.0),))


@dataclass(frozen=True, slots=True)
class UnitOnTheLine:
    """What the virtual instrument measures, and what it says of that."""

    readings: Source  # what it measures
    version: str  # how its version text begins
    source: str = ""  # where the readings come from, in words; "" where the version says enough
    line: Line | None = None  # what happens on the wire
    seed: int = 0  # of the time counter's start
    personality: Personality = field(default_factory=Personality)  # what the unit is like
    # makes the readings of a rest, up to a time of theirs, s: all at once would take longer than a host waits; None
    # where they take next to no time
    keep_up: Callable[[float], None] | None = None

    def text(self, usual: str) -> str:
        """Return the unit's text: the usual one or the scenario's, and the origin of readings where there is one."""
        own = usual if self.personality.version is None else self.personality.version
        return f"{own} from {self.source}".encode("ascii", "backslashreplace").decode() if self.source else own

    def options(self, serial_number: int) -> UnitOptions:
        """Which unit this is."""
        it = self.personality
        return UnitOptions(
            serial_number=serial_number,
            version=self.text(self.version),
            ping=it.ping,
            version_plain_text=it.version_plain_text,
            clock_skew_ppm=it.clock_skew_ppm,
        )


class SimulatedReadings:
    """A unit at one of the power-ons of a scenario.

    `scenario`: without anything in it: still, level, biases and noise of Table 1.
    `power_on`: which, from 0.
    `background`: a recording that is played in place of biases and noise.
    `rate_hz`: rate of the unit's loop.
    `table`: what it stands on, under command.
    """

    def __init__(
        self,
        scenario: Scenario,
        power_on: int = 0,
        background: Background | None = None,
        rate_hz: float = LOOP_HZ,
        table: OnTable | None = None,
    ) -> None:
        self.unit = Unit(scenario, power_on, rate_hz, background, table)
        self.newest = -1
        self._fates: dict[int, tuple[bool, float]] = {}

    def reading(self, k: int) -> Reading | None:
        """Reading k of the unit's loop, instrument axes; None after the end of a recording."""
        axes, self.newest = self.unit.scenario.axes, max(k, self.newest)
        rate, force = self.unit.reading(k)
        if not math.isfinite(rate[0]):
            return None
        self._fates[k] = self.unit.lost(k), self.unit.late(k)
        if len(self._fates) > _REMEMBERED:
            del self._fates[next(iter(self._fates))]
        dps = np.rad2deg(axes.gyro_to_instrument(rate))
        g = axes.accel_to_instrument(force) / STANDARD_GRAVITY
        return Reading(tuple(dps), tuple(g), self.unit.temperature_degc(k))

    def line(self) -> Line | None:
        """Return the line of its scenario; None if that is a plain one."""
        scenario = self.unit.scenario
        lossy = any(effect.name in ("dropout", "jitter") for effect in scenario.effects)
        return line_of(scenario, self._fate if lossy else None)

    def _fate(self, t: float) -> tuple[bool, float]:
        return self._fates.get(math.floor(t * self.unit.rate_hz + 1e-6), (False, 0.0))


def line_of(scenario: Scenario, fate: Callable[[float], tuple[bool, float]] | None = None) -> Line | None:
    """Return the line of a scenario, see `virtual.Line`; None if that is a plain one."""
    return Line(scenario.faults, fate, scenario.seed) if scenario.faults or fate is not None else None


@dataclass(frozen=True, slots=True)
class Asked:
    """What the options of `imutui virtual` ask for."""

    scenario: Path | None = None  # its file
    power_on: int = 0  # which of the scenario's, from 0
    seed: int | None = None  # wins over the scenario's
    recording: Path | None = None  # what to play instead of made noise
    start: float = 0.0  # where in the recording to begin, s
    spoil: ErrorFunction | None = None  # what to add besides
    # makes the table under command that a unit of this scenario stands on
    table: Callable[[Scenario], OnTable] | None = None
    link: Path | None = None  # symbolic link to its port, as it was typed


def on_the_line(asked: Asked, rate_hz: float = LOOP_HZ, plain: Scenario | None = None) -> UnitOnTheLine:
    """The unit that is asked for.

    `rate_hz`: rate of the unit's loop.
    `plain`: the unit without a scenario: how it reads, sits, and what it promises; None: an IMU400CD.
    """
    scenario, spoil = asked.scenario, asked.spoil
    made = scenario_of(scenario, asked.seed, plain)
    played = None if asked.recording is None else load(asked.recording, asked.start, made.axes, made.site)
    if played is not None and np.isnan(played.values).any():
        raise InputError(
            f"{asked.recording} lacks a channel, and the virtual instrument sends six: play another recording, or name"
            " a --scenario instead."
        )
    if asked.table is not None and made.profile is not None:
        raise InputError(f"{scenario} has a motion of its own, and the table has a controller: leave one of them out.")
    table = None if asked.table is None else asked.table(made)
    if played is not None and scenario is None and spoil is None and table is None:
        version = SIMULATED if played.simulated else PLAYED
        return UnitOnTheLine(PlayedReadings(played.t, played.values, played.degc, rate_hz), version, seed=made.seed)
    if played is not None and scenario is None and played.degc is None:
        made = replace(made, temperature=_ROOM)
    background = None if played is None else played.background(made.site, rate_hz)
    readings = SimulatedReadings(made, asked.power_on, background, rate_hz, table)
    source: Source = readings if spoil is None else Spoiled(readings, readings.unit, spoil)
    told = "" if played is None and spoil is None else _source(played, readings.unit, spoil)
    made_unit = UnitOnTheLine(source, SIMULATED, told, readings.line(), made.seed, made.personality)
    if table is not None:

        def keep_up(t: float) -> None:
            if (k := math.floor(t * rate_hz) - _BEHIND) > readings.newest:
                source.reading(k)

        made_unit = replace(made_unit, keep_up=keep_up)
    return made_unit


def scenario_of(path: Path | None, seed: int | None, plain: Scenario | None = None) -> Scenario:
    """Scenario of a file, or of a plain unit without one; a seed that is given wins over the file's."""
    from imutui.scenario import load_scenario

    usual = plain or Scenario()
    what = usual if path is None else load_scenario(path, usual)
    return what if seed is None else replace(what, seed=seed)


def _source(played: PlayedRecording | None, unit: Unit, spoil: ErrorFunction | None) -> str:
    """Where readings come from: the noise, what was added to it, and that temperature is made where it is."""
    if played is None:
        base = "simulated readings"
    else:
        base = f"{'simulated readings' if played.simulated else 'measured noise'} of {played.name}"
    added = ["motion"] if played is not None and unit.motion is not None else []
    added += [] if played is None else list(dict.fromkeys(effect.name for effect in unit.scenario.effects))
    added += [] if spoil is None else [spoil.name]
    made_up = played is not None and unit.temperature is not getattr(unit.background, "temperature", None)
    return " + ".join([base, *added]) + ("; temperature simulated" if made_up else "")
