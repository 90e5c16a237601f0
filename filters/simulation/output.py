"""Noise and its colour, and what the electronics and the line do to finished readings."""

import math
from abc import abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from filters.channels import CHANNELS, DPS, G
from filters.effects.inputs import SENSED
from filters.errors import InputError
from filters.simulation.parameters import EffectKind, ScenarioParameter, Setup, TrueInputs, positive
from filters.types import Array

DRIVERS = (
    "time",
    "temperature",
    "temperature_rate",
    *SENSED,
    "rate_norm",
    *("angle_outer", "angle_middle", "angle_inner"),
)


class NoiseLevel(EffectKind):
    """White noise of variance times exp(a + b d), d a driver; `log_variance` a (0), `log_variance_per_unit` b (0).

    `driver` is one of `DRIVERS` (time), d in s, degC, K/s, deg/s, g or deg. Variance 4 times: a = 1.386.
    """

    parameters: ClassVar = (
        ScenarioParameter("a", "log_variance", 0.0),
        ScenarioParameter("b", "log_variance_per_unit", 0.0),
        ScenarioParameter("driver", "driver", "time", choices=DRIVERS),
    )

    def ratio(self, inputs: TrueInputs) -> Array:
        """Standard deviation over the specification's, shape (N,)."""
        return np.exp(0.5 * (self.number("a") + self.number("b") * _driver(self.word("driver"), inputs)))


def _driver(name: str, inputs: TrueInputs) -> Array:
    if name[0] in "wf":
        column = "xyz".index(name[1])
        return inputs.perfect[:, column] / DPS if name[0] == "w" else inputs.perfect[:, 3 + column] / G
    match name:
        case "time":
            return inputs.t
        case "temperature":
            return inputs.temperature
        case "temperature_rate":
            return inputs.temperature_rate
        case "rate_norm":
            return np.asarray(np.sqrt(np.sum(inputs.perfect[:, :3] ** 2, axis=1))) / DPS
    axis = ("angle_outer", "angle_middle", "angle_inner").index(name)
    return inputs.angles[:, axis] / DPS


class Bandwidth(EffectKind):
    """Another first-order band limit than the specification's, of signal and noise alike; `hz` (-3 dB)."""

    parameters: ClassVar = (positive("hz", "hz"),)


class NoiseCrosstalk(EffectKind):
    """White noise of two channels or more correlated by ρ with that of the first named; `correlation`, -1 to 1.

    n_b becomes σ_b (ρ n_a/σ_a + √(1 - ρ²) n_b/σ_b), so that each channel keeps its own level.
    """

    together: ClassVar = True
    parameters: ClassVar = (ScenarioParameter("rho", "correlation", least=-1.0, most=1.0),)

    def __init__(self, setup: Setup) -> None:
        if len(setup.channels) < 2:
            raise InputError(
                f'`channel` is {CHANNELS[setup.channel]} alone: noise_crosstalk is between two, such as ["ax", "ay"]'
            )
        super().__init__(setup)

    def mixed(self, white: Array) -> Array:
        """Noise of unit variance, shape (N, 6), correlated."""
        out, rho = white.copy(), self.number("rho")
        first, *others = self.named
        for other in others:
            out[:, other] = rho * white[:, first] + math.sqrt(1.0 - rho**2) * white[:, other]
        return out


class Output(EffectKind):
    """What is done to the finished readings of one channel, stretch after stretch."""

    @abstractmethod
    def spoiled(self, values: Array, t: Array) -> Array:
        """Readings as they come out, shape (N,)."""


class Saturation(Output):
    """Readings clipped to ± a limit; `limit_dps` or `limit_g`."""

    parameters: ClassVar = (ScenarioParameter("limit", "limit_{x}", inputs=1, least=0.0, above=True),)

    def spoiled(self, values: Array, t: Array) -> Array:
        return np.clip(values, -self.number("limit"), self.number("limit"))


class Coarse(Output):
    """Readings rounded to a lattice coarser than the instrument's counts; `lattice_{e}`."""

    parameters: ClassVar = (ScenarioParameter("lattice", "lattice_{e}", least=0.0, above=True),)

    def spoiled(self, values: Array, t: Array) -> Array:
        return np.rint(values / self.number("lattice")) * self.number("lattice")


class Stuck(Output):
    """The reading at `at_s` repeated for `seconds`."""

    parameters: ClassVar = (ScenarioParameter("at", "at_s", least=0.0), positive("seconds", "seconds"))

    _held: float | None = None

    def spoiled(self, values: Array, t: Array) -> Array:
        rows = np.flatnonzero(self.lasts(t))
        if not rows.size:
            return values
        if self._held is None:
            self._held = float(values[rows[0]])
        out = values.copy()
        out[rows] = self._held
        return out


class Spikes(Output):
    """Single readings off by a size, up or down, at random; `{e}`, `per_hour` (mean number in an hour)."""

    parameters: ClassVar = (ScenarioParameter("size", "{e}"), ScenarioParameter("per_hour", "per_hour", least=0.0))

    def spoiled(self, values: Array, t: Array) -> Array:
        u, up, size = self.rng.random(t.size), self.rng.random(t.size) < 0.5, self.number("size")
        return values + np.where(u < self.number("per_hour") / 3600.0 / self.rate_hz, np.where(up, size, -size), 0.0)


class Dropout(EffectKind):
    """Readings that never arrive: at random with `probability` (0) each, and all from `at_s` (0) for `seconds` (0)."""

    everywhere: ClassVar = True
    parameters: ClassVar = (
        ScenarioParameter("probability", "probability", 0.0, least=0.0, most=1.0),
        ScenarioParameter("at", "at_s", 0.0, least=0.0),
        ScenarioParameter("seconds", "seconds", 0.0, least=0.0),
    )

    def lost(self, t: Array) -> NDArray[np.bool_]:
        """Whether each of the next readings is lost, shape (N,)."""
        return np.asarray((self.rng.random(t.size) < self.number("probability")) | self.lasts(t))


class Jitter(EffectKind):
    """Stamps off by normal noise, readings not; `sd_s`. Never by more than 0.45 of the period: their order stays."""

    everywhere: ClassVar = True
    parameters: ClassVar = (ScenarioParameter("sd", "sd_s", least=0.0),)

    def late(self, t: Array) -> Array:
        """Error of the next readings' stamps, s, shape (N,)."""
        return np.clip(self.number("sd") * self.rng.standard_normal(t.size), -0.45 / self.rate_hz, 0.45 / self.rate_hz)
