"""Records of effects that join the filter, as a trace finds them and files keep them."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class State:
    """One extra state of the filter.

    Attributes
    ----------
    name, unit : str
        Of the parameter, as reported.
    mean, sd : float
        In that unit.
    tau_s : float
        Time constant, infinity for a constant.
    q : float
        Noise density, unit/√s.
    """

    name: str
    unit: str
    mean: float
    sd: float
    tau_s: float = float("inf")
    q: float = 0.0


@dataclass(frozen=True)
class Included:
    """An effect that joins the filter.

    Attributes
    ----------
    effect : str
        Name in the catalogue, or driver:NAME.
    channels : tuple of str
        Which it acts on, instrument axes.
    include_as : str
        A extra constant states, S stochastic states, N noise, P pre-filter.
    parameters : dict
        What fixes its shape, SI or as named: time constants, knots, ….
    states : tuple of State
        In order.
    """

    effect: str
    channels: tuple[str, ...]
    include_as: str
    parameters: dict[str, Any] = field(default_factory=dict)
    states: tuple[State, ...] = ()
