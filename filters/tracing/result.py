"""What a trace gives: findings for a report, effects for the filter, residuals for figures, the run to make next."""

from dataclasses import dataclass

from filters.effects.records import Included
from filters.motion.profile import Profile
from filters.tracing.trace_document import TraceFindings
from filters.types import Array

Thermal = tuple[tuple[float, float], ...]
"""Temperature in the case: s since power-on, degC, straight lines between."""


@dataclass(frozen=True)
class RunSeries:
    """Block means of one run, for figures: t (n,) s; before, after (n, 6) rad/s and m/s², NaN without weight."""

    run: str
    period: float
    t: Array
    before: Array
    after: Array


@dataclass(frozen=True, kw_only=True)
class SeparatingExperiment:
    """The run to make next to tell an effect from its rivals.

    Attributes
    ----------
    a, b : str
        Effects; b is the hardest of the rivals that it separates.
    profile : Profile
        What the table does.
    thermal : tuple of (float, float) or None
        Temperature in the case; None where no temperature is known.
    duration_s : float
        Of the run.
    d_expected : float
        Standard deviations between a and b that it adds.
    motion : str
        What an operator does, a sentence; it says so if nothing separates them.
    leaves : tuple of str
        Effects of the rivals that stay possible.
    """

    a: str
    b: str
    profile: Profile
    thermal: Thermal | None
    duration_s: float
    d_expected: float
    motion: str
    leaves: tuple[str, ...]


@dataclass(frozen=True)
class Trace:
    """All that a trace gives.

    Attributes
    ----------
    document : TraceFindings
        Contracts section 6 but for what only the reader of the logs knows (runs, notes) and for the experiment.
    included : tuple of Included
        What joins the filter.
    correlation : Array
        Of all states of `included` in order, shape (p, p).
    series : tuple of RunSeries
        Residuals of all runs, the held-out one last.
    experiment : SeparatingExperiment or None
        What would tell rivals apart; None without any.
    """

    document: TraceFindings
    included: tuple[Included, ...]
    correlation: Array
    series: tuple[RunSeries, ...]
    experiment: SeparatingExperiment | None = None
