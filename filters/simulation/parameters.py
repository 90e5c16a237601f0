"""What effects are told and what they see: parameters with units, channels, true inputs of a stretch of readings."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from filters.channels import CHANNELS, DPS, GYROS, MG, G
from filters.types import Array

GYRO_CHANNELS, ACCEL_CHANNELS = CHANNELS[:3], CHANNELS[3:]
"""Names of the channels of the gyros and of the accelerometers."""


@dataclass(frozen=True, slots=True)
class ScenarioParameter:
    """A parameter of an effect."""

    key: str  # what the effect calls it
    # what a scenario calls it, unit and all; `{e}` stands for the unit of errors, dps or mg by the channel, and `{x}`
    # for that of inputs, dps or g
    name: str
    default: float | str | None = None  # none where it must be given
    inputs: int = 0  # power of the input's unit in the parameter's
    factor: float = 1.0  # to SI, of what is left of the unit
    choices: tuple[str, ...] = ()  # of a parameter that is a word
    # least, most: of a parameter that is a number, in its own unit
    least: float = -math.inf
    most: float = math.inf
    above: bool = False  # whether `least` itself is too little

    def name_on(self, channel: int) -> str:
        """Name in a scenario, for a channel's number."""
        return self.name.format(**({"e": "dps", "x": "dps"} if channel in GYROS else {"e": "mg", "x": "g"}))

    def si(self, value: float, channel: int) -> float:
        """Value in SI and radians of a value in the unit of `name_on`."""
        error, unit = (DPS, DPS) if channel in GYROS else (MG, G)
        return value * self.factor * (error if "{e}" in self.name else 1.0) * unit**self.inputs


def positive(key: str, name: str, default: float | None = None) -> ScenarioParameter:
    """A parameter that is more than zero, in SI already."""
    return ScenarioParameter(key, name, default, least=0.0, above=True)


@dataclass(frozen=True, slots=True)
class Setup:
    """What an effect is made from, on one channel."""

    channel: int  # number in `CHANNELS`
    channels: tuple[int, ...]  # all that the effect was asked for on
    values: dict[str, float | str]  # key to value, SI; a word for a parameter that is one
    rate_hz: float  # of the readings
    rng: np.random.Generator  # the effect's own, of this power-on

    def number(self, key: str) -> float:
        """Value of a parameter that is a number."""
        return float(self.values[key])

    def word(self, key: str) -> str:
        """Value of a parameter that is a word."""
        return str(self.values[key])


class EffectKind:
    """An effect of the catalogue, its equation in its docstring: made from a `Setup` for each channel it is on."""

    channels: ClassVar[tuple[str, ...]] = CHANNELS  # where it may be
    parameters: ClassVar[tuple[ScenarioParameter, ...]]
    everywhere: ClassVar[bool] = False  # whether it is made once for all of `channels`
    selectable: ClassVar[bool] = False  # whether a scenario may name some of them all the same
    together: ClassVar[bool] = False  # whether it is made once for those that a scenario names

    def __init__(self, setup: Setup) -> None:
        self.number, self.word = setup.number, setup.word
        self.channel, self.named = setup.channel, list(setup.channels)
        self.rate_hz, self.rng = setup.rate_hz, setup.rng

    def lasts(self, t: Array) -> NDArray[np.bool_]:
        """Whether an effect that begins `at` a time and goes on for `seconds` is there at t, shape (N,)."""
        return (t >= self.number("at")) & (t < self.number("at") + self.number("seconds"))


@dataclass(frozen=True, slots=True)
class TrueInputs:
    """What there is to sense over N successive readings."""

    t: Array  # since power-on, s, shape (N,)
    # what an instrument without errors reads: rates (rad/s), accelerations (m/s²), its own axes and sign, (N, 6)
    perfect: Array
    temperature: Array  # inside the case, degC, shape (N,)
    temperature_rate: Array  # K/s, shape (N,)
    angles: Array  # rotations of the table about north, east, down, rad, shape (N, 3)
