"""Records of what a trace finds, in the shape that reports, files and the filter take."""

from dataclasses import dataclass, field
from typing import Any

from filters.types import Array


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


@dataclass(frozen=True)
class RunSeries:
    """Block means of one run, for figures: t (n,) s; before, after (n, 6) rad/s and m/s², NaN without weight."""

    run: str
    period: float
    t: Array
    before: Array
    after: Array


@dataclass(frozen=True)
class Trace:
    """All that a trace gives.

    Attributes
    ----------
    document : dict
        Contracts section 6 but for `runs` (whoever read the logs knows those), JSON-ready.
    included : tuple of Included
        What joins the filter.
    correlation : Array
        Of all states of `included` in order, shape (p, p).
    series : tuple of RunSeries
        Residuals of all runs, the held-out one last.
    """

    document: dict[str, Any]
    included: tuple[Included, ...]
    correlation: Array
    series: tuple[RunSeries, ...]
