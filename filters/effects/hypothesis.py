"""What every deterministic effect is: columns over the inputs that its parameters multiply, and how it differs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from filters.channels import ACCELS, GYROS, error_unit
from filters.effects import plain_names
from filters.effects.inputs import Inputs
from filters.types import Array

ALL = (*GYROS, *ACCELS)  # numbers of all channels


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of an effect on one channel."""

    # name, unit: as reported
    name: str
    unit: str
    si: float  # SI value of one unit
    prior: float  # plausible standard deviation for this class of instruments, in the unit


def own_parameter(
    channel: int, name: str, per: str, gyro_prior: float, accel_prior: float, si: float = 1.0
) -> Parameter:
    """A parameter in the channel's unit of error, deg/s or mg, per something of which one is `si`."""
    unit, factor = error_unit(channel)
    return Parameter(name, unit + per, factor / si, gyro_prior if channel in GYROS else accel_prior)


def _no_columns(inputs: Inputs, channel: int) -> Array:
    raise TypeError("an effect of one run's own rows is no function of the inputs")


@dataclass(frozen=True, eq=False, kw_only=True)
class Hypothesis:
    """One way in which readings may be wrong: e = columns · θ; equal to another of the same name, channels and shape.

    `columns` gives the regressor of a channel, SI per SI of the parameters, shape (n, k).
    """

    effect: str  # name in the catalogue, driver:NAME or cause:OPERATOR(NAME)
    channels: tuple[int, ...]  # those it acts on with the same θ: one, or several where it is shared
    # what it is a function of: "time", "temperature", "motion"; "run_specific" for what each run has its own of
    source: str
    parameters: tuple[Parameter, ...]  # what the k columns' factors are, in their order
    columns: Callable[[Inputs, int], Array] = field(default=_no_columns, repr=False)
    shape: Mapping[str, float | str] = field(default_factory=dict)  # what else fixes it: time constants, orders, axes
    words: str = ""  # a few, for a sentence, where those of `plain_names` are not enough
    grid: int = 1  # how many hypotheses of this effect there are on the channel: what choosing among them costs
    rank: int = 16  # of two that do as well the one of the lower rank is taken; free curves come last
    needs: tuple[str, ...] = ()  # drivers and table axes that must vary for it to show; () of motion: any input
    over: tuple[str, ...] = ()  # drivers that it is a sum of curves over
    is_wide: bool = False  # whether it needs a long run, far through temperature
    is_everywhere: bool = False  # whether its columns are the same on every channel
    follows_rates: bool = False  # of what several channels share: as fast as the motion, not as slow as drift
    at_blocks: bool = False  # of motion: whether it is a function of what the motion was, which changes slowly

    is_free: ClassVar = False  # whether it is a free curve, and no effect of the catalogue

    @cached_property
    def key(self) -> tuple[str, tuple[int, ...], str]:
        """Effect, channels and shape: what makes two the same, whatever the data."""
        return self.effect, self.channels, str(sorted(self.shape.items()))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Hypothesis) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    def blank(self) -> Array:
        """What `going_on` remembers before anything is known."""
        return np.empty((0, 2))

    def going_on(self, inputs: Inputs, channel: int, memory: Array) -> Array:
        """Columns of instants that follow those before in a power-on; what is remembered is changed in place."""
        return self.columns(inputs, channel)

    @property
    def channel(self) -> int:
        """The one that it is on, or the first."""
        return self.channels[0]

    @property
    def label(self) -> str:
        """A few words for a sentence."""
        return self.words or plain_names.effect(self.effect)

    @property
    def is_slow(self) -> bool:
        """Whether it is a function of time, temperature and what the motion was: the middle of a block tells it."""
        return self.at_blocks or self.source != "motion"
