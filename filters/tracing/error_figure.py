"""A figure of error, before and after, beside what white noise alone leaves; intervals of what it is made of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from filters.tracing.trace_document import ErrorEntry, HeldOut
from filters.types import Array

DRAWS = 1000  # times that errors are drawn again for an interval


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorFigure:
    """One figure of error, docs/formats.md."""

    metric: str  # what it is,
    channel: str | None  # of which channel, "all" of free navigation, None of what is no channel's own,
    unit: str
    # before, after, floor: without and with the corrections, and what white noise alone leaves
    before: float
    after: float
    floor: float
    # ci95, before_ci95: intervals of `after` and of `before`
    ci95: tuple[float, float]
    before_ci95: tuple[float, float]
    floor_band95: tuple[float, float]  # where 95 % of clean units would be
    n: int  # errors in it
    # "run" for a power-on that nothing was fitted to, "part" for a later part of one, "folds" within the runs
    heldout: HeldOut

    def entry(self) -> ErrorEntry:
        """As the document of a trace has it."""
        return {
            "metric": self.metric, "channel": self.channel, "unit": self.unit,
            "before": self.before, "after": self.after, "floor": self.floor,
            "before_x_floor": self.before / self.floor, "after_x_floor": self.after / self.floor,
            "ci95": list(self.ci95), "before_ci95": list(self.before_ci95), "floor_band95": list(self.floor_band95),
            "n": self.n, "heldout": self.heldout, "after_again": None,
        }  # fmt: skip


def chi2_quantiles(freedom: int) -> tuple[float, float]:
    """2.5 % and 97.5 % quantiles of chi-square."""
    low, high = 2.0 * special.gammaincinv(0.5 * freedom, np.array([0.025, 0.975]))
    return float(low), float(high)


def rms(errors: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(errors**2)))


def drawn_again(rng: np.random.Generator, n: int) -> NDArray[np.int32]:
    """Numbers of n errors drawn again, shape (DRAWS, n); row after row, for a week has sixty thousand."""
    picks = np.empty((DRAWS, n), np.int32)
    for row in picks:
        row[:] = rng.integers(0, n, n)
    return picks


def rms_interval(errors: Array, picks: NDArray[np.integer], scale: float) -> tuple[float, float]:
    """Interval of a root mean square by drawing the errors again, 95 %, times a scale."""
    squares = errors**2
    means = [squares[row].mean() for row in picks]
    low, high = np.quantile(np.sqrt(means), [0.025, 0.975])
    return float(low) * scale, float(high) * scale


def wilson_interval(share: float, n: int) -> tuple[float, float]:
    """Interval of a share of n, 95 % (Wilson 1927)."""
    k = round(share * n)
    p, z = k / n, float(special.ndtri(0.5 + 0.5 * 0.95))
    denominator = 2 * (n + z**2)
    centre = (2 * n * p + z**2) / denominator
    half = z / denominator * float(np.sqrt(4 * n * p * (1 - p) + z**2))
    return (0.0 if k == 0 else centre - half), (1.0 if k == n else centre + half)


def binomial_quantile(probability: float, n: int, share: float) -> int:
    """Smallest k of n with so much probability at or below it, each of n being so likely."""
    return int(np.searchsorted(special.bdtr(np.arange(n + 1), n, share), probability))
