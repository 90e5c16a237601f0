"""Errors of the reference or of the whole unit: where parameters are shared by channels (catalogue 12, 15-20)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from filters.channels import ACCELS, DPS, GYROS
from filters.effects.hypothesis import ALL, ChannelEffect, HypothesisBase, Parameter
from filters.effects.inputs import Inputs
from filters.motion.segments import AXES
from filters.types import Array


@dataclass(frozen=True)
class SharedEffect(HypothesisBase):
    """An effect of several channels with the same parameters."""

    channels: ClassVar[tuple[int, ...]]
    source: ClassVar = "motion"


@dataclass(frozen=True)
class Mounting(SharedEffect):
    """e = v × d, v = ω and f with the same d: the sensors are turned in their case."""

    effect: ClassVar = "mounting"
    channels: ClassVar = ALL
    text: ClassVar = "the unit sits turned on the table"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        v = inputs.x[:, :3] if channel < 3 else inputs.x[:, 3:]
        return np.cross(v[:, None, :], np.eye(3)[None])[:, :, channel % 3]

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(axis, "rad", 1.0, 0.01) for axis in "xyz")


@dataclass(frozen=True)
class EarthRate(SharedEffect):
    """e = k C ω_ie in a residual that contains Earth rate: -1 for a unit, or a model, without it."""

    effect: ClassVar = "earth_rate"
    channels: ClassVar = GYROS
    text: ClassVar = "Earth rate is not as assumed"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.spin[:, channel, None]

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("k", "1", 1.0, 1.0),)


@dataclass(frozen=True)
class Delay(SharedEffect):
    """e = -tau x'."""

    effect: ClassVar = "delay"
    channels: ClassVar = ALL
    text: ClassVar = "readings are late"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return -inputs.x_dot[:, channel, None]

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("tau", "s", 1.0, 5e-3),)


@dataclass(frozen=True)
class LeverArm(SharedEffect):
    """e = ω × (ω × r) + ω' × r."""

    effect: ClassVar = "lever_arm"
    channels: ClassVar = ACCELS
    text: ClassVar = "the unit is away from the axes of rotation"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.centripetal[:, channel - 3]

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(axis, "m", 1.0, 0.05) for axis in "xyz")


@dataclass(frozen=True)
class Tilt(SharedEffect):
    """e = C (δ × (0, 0, -γ)): the base of the table is not level."""

    effect: ClassVar = "tilt"
    channels: ClassVar = ACCELS
    text: ClassVar = "the table's base is not level"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.horizontal[:, channel - 3]

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(axis, "deg", DPS, 0.05) for axis in ("north", "east"))


@dataclass(frozen=True)
class Gravity(SharedEffect):
    """e = k C (0, 0, -γ): equals a common scale factor of the accelerometers."""

    effect: ClassVar = "gravity"
    channels: ClassVar = ACCELS
    text: ClassVar = "gravity is not as assumed"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.x[:, channel, None]

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("k", "1", 1.0, 1e-4),)


@dataclass(frozen=True)
class CommonScale(Gravity):
    """One scale factor of all accelerometers: the columns of gravity, whose rival it is; never selected itself."""

    effect: ClassVar = "scale"
    text: ClassVar = "accelerometers have a common scale factor"


@dataclass(frozen=True)
class Harmonic(ChannelEffect):
    """e = a sin(h θ) + b cos(h θ) of a table angle: magnetic field, wobble of an axis."""

    axis: int = 0
    order: int = 1

    effect: ClassVar = "harmonic"
    source: ClassVar = "motion"
    text: ClassVar = "error turns with the table"

    @property
    def grid(self) -> int:
        """Three axes, two orders."""
        return 6

    @property
    def label(self) -> str:
        return f"{AXES[self.axis]} {self.order}/rev"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        angle = self.order * inputs.angles[:, self.axis]
        return np.stack([np.sin(angle), np.cos(angle)], axis=1)

    def parameters(self) -> tuple[Parameter, ...]:
        return (*self.channel_parameter("sin", "", 1.0, 0.05, 2.0), *self.channel_parameter("cos", "", 1.0, 0.05, 2.0))

    def shape(self) -> Mapping[str, float | str]:
        return {"axis": AXES[self.axis], "order": float(self.order)}


def shared() -> list[SharedEffect]:
    """All hypotheses that several channels share."""
    return [Mounting(), EarthRate(), Delay(), LeverArm(), Tilt(), Gravity()]


def harmonics(channel: int) -> list[Harmonic]:
    """Harmonics of the table's angles on a channel."""
    return [Harmonic(channel, axis, order) for axis in range(3) for order in (1, 2)]
