"""What a trace gives: findings for a report, effects for the filter, residuals for figures, the run to make next."""

from dataclasses import dataclass

from filters.effects.records import Included
from filters.motion.profile import Profile
from filters.tracing.trace_document import TraceFindings
from filters.types import Array

Thermal = tuple[tuple[float, float], ...]  # temperature in the case: s since power-on, degC, straight lines between


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
    """The run to make next to tell an effect from its rivals."""

    # a, b: effects; b is the hardest of the rivals that it separates
    a: str
    b: str
    profile: Profile  # what the table does
    thermal: Thermal | None  # temperature in the case; None where no temperature is known
    duration_s: float  # of the run
    d_expected: float  # standard deviations between a and b that it adds
    motion: str  # what an operator does, a sentence; it says so if nothing separates them
    leaves: tuple[str, ...]  # effects of the rivals that stay possible


@dataclass(frozen=True)
class Trace:
    """All that a trace gives."""

    # contracts section 6 but for what only the reader of the logs knows (runs, notes) and for the experiment
    document: TraceFindings
    included: tuple[Included, ...]  # what joins the filter
    correlation: Array  # of all states of `included` in order, shape (p, p)
    series: tuple[RunSeries, ...]  # residuals of all runs, the held-out one last
    experiment: SeparatingExperiment | None = None  # what would tell rivals apart; None without any
