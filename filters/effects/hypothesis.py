"""What every deterministic effect offers: columns that its parameters multiply, and what the parameters mean."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

from filters.channels import ACCELS, DPS, GYROS, G, error_unit
from filters.effects.inputs import Inputs
from filters.types import Array

ALL = (*GYROS, *ACCELS)
"""Numbers of all channels."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of an effect on one channel."""

    # name, unit: as reported
    name: str
    unit: str
    si: float  # SI value of one unit
    prior: float  # plausible standard deviation for this class of instruments, in the unit


@runtime_checkable
class Hypothesis(Protocol):
    """One way in which readings may be wrong: e = columns · θ.

    `effect`: name in the catalogue, or driver:NAME.
    `label`: a few words for a sentence.
    `channels`: those it acts on with the same θ: one, or several where it is shared.
    `source`: "time", "temperature" or "motion": what it is a function of; "run_specific" for what each run has its own
      of.
    `grid`: how many hypotheses of this effect there are on the channel: what choosing among them costs.
    """

    @property
    def effect(self) -> str: ...  # noqa: D102
    @property
    def label(self) -> str: ...  # noqa: D102
    @property
    def channels(self) -> tuple[int, ...]: ...  # noqa: D102
    @property
    def source(self) -> str: ...  # noqa: D102
    @property
    def grid(self) -> int: ...  # noqa: D102

    def columns(self, inputs: Inputs, channel: int) -> Array:
        """Regressor, SI per SI of the parameters, shape (n, k)."""
        ...

    def parameters(self) -> tuple[Parameter, ...]:
        """What the k columns' factors are, in their order."""
        ...

    def shape(self) -> Mapping[str, float | str]:
        """What else fixes it: time constants, orders, axes."""
        ...


@dataclass(frozen=True)
class HypothesisBase(ABC):
    """What all effects of the catalogue share; subclasses give columns and parameters."""

    effect: ClassVar[str]
    source: ClassVar[str]
    text: ClassVar[str]

    @property
    def grid(self) -> int:
        """One, unless a subclass has a grid."""
        return 1

    @property
    def label(self) -> str:
        """A few words for a sentence."""
        return self.text

    def shape(self) -> Mapping[str, float | str]:
        """Nothing, unless a subclass has something."""
        return {}

    @abstractmethod
    def columns(self, inputs: Inputs, channel: int) -> Array:
        """Regressor, SI per SI of the parameters, shape (n, k)."""

    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """What the k columns' factors are, in their order."""


@dataclass(frozen=True)
class ChannelEffect(HypothesisBase):
    """An effect of one channel by itself."""

    channel: int

    where: ClassVar[tuple[int, ...]] = ALL

    @property
    def channels(self) -> tuple[int, ...]:
        """The one channel that it is on, as a tuple."""
        return (self.channel,)

    @property
    def gyro(self) -> bool:
        """Whether the channel is a gyro's."""
        return self.channel in GYROS

    def channel_parameter(
        self, name: str, per: str, si: float, gyro_prior: float, accel_prior: float
    ) -> tuple[Parameter, ...]:
        """A parameter in the channel's unit of error, deg/s or mg, per something of which one is `si`; alone."""
        unit, factor = error_unit(self.channel)
        return (Parameter(name, unit + per, factor / si, gyro_prior if self.gyro else accel_prior),)

    def input_unit(self) -> tuple[str, float]:
        """Unit of what the channel senses, and its SI value."""
        return ("(deg/s)", DPS) if self.gyro else ("g", G)
