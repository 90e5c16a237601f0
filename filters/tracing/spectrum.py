"""Power-law spectra of drift, and rows of a channel whitened by each of them.

A channel's rows are white noise and drift whose spectrum is f^-slope, as strong as the white noise at one period. Drift
is a sum of Gauss-Markov processes whose time constants double, a random walk where the slope is 2; each power-on has a
bias of its own, of which nothing is known. All covariances are over the variance of the white noise of a median row.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from filters.types import Array

SLOPES = (0.8, 1.1, 1.4, 1.7, 2.0)
_PERIODS = 8
_WHITE = 0.5  # probability that a channel has no drift, before the data are seen
_SHORTEST = 2.4  # period, in rows
_TAUS: Array = 0.6 * np.exp2(np.arange(14.0))  # in rows


@dataclass(frozen=True)
class Spectrum:
    """White noise and drift."""

    slope: float  # of f^-slope; 0 where there is no drift
    period: float  # at which drift is as strong as white noise, s


def spectra(row_s: float, longest_s: float) -> list[Spectrum]:
    """Those that are tried for rows of so many seconds, in power-ons of at most so many."""
    periods = np.geomspace(_SHORTEST * row_s, max(longest_s, 10.0 * _SHORTEST * row_s), _PERIODS)
    return [Spectrum(0.0, np.inf), *(Spectrum(slope, float(p)) for slope in SLOPES for p in periods)]


def covariances(t: Array, row_s: float) -> list[Array]:
    """Covariances of drift of each of `SLOPES` at instants, s, over `density`'s; shape (n, n) each."""
    gaps, since = np.abs(t[:, None] - t), t - t[0]
    parts = np.array([np.exp(-gaps / tau) for tau in _TAUS * row_s])
    mixed = [np.tensordot((_TAUS * row_s) ** (slope - 1.0), parts, 1) for slope in SLOPES[:-1]]
    return [*mixed, np.minimum(since[:, None], since)]


def density(slope: float, period: float, row_s: float) -> float:
    """Spectral density, 1/Hz, at a period, s, of the drift whose covariance `covariances` gives."""
    if slope == SLOPES[-1]:
        return float((period / (2.0 * np.pi)) ** 2)
    taus = _TAUS * row_s
    return float(np.sum(taus ** (slope - 1.0) * 2.0 * taus / (1.0 + (2.0 * np.pi * taus / period) ** 2)))


class Whitening:
    """Rows of power-ons under every spectrum.

    `t`: of all rows, s, shape (n,); `starts`: first row of each power-on; `variance`: of the white noise of each row,
    infinite where there is no data; `row_s`: length of a row. Rows without data are left out of all that it gives.
    """

    def __init__(self, t: Array, starts: NDArray[np.int_], variance: Array, row_s: float) -> None:
        self.used = np.flatnonzero(np.isfinite(variance))
        power_on = np.searchsorted(starts, self.used, side="right") - 1
        counts = np.bincount(power_on)[np.unique(power_on)]
        ends = np.cumsum(counts)
        self.parts = [slice(int(b - a), int(b)) for a, b in zip(counts, ends, strict=True)]
        unit = float(np.median(variance[self.used]))
        own = t[self.used]
        self.spectra = spectra(row_s, max(float(np.ptp(own[p])) for p in self.parts))
        drifting = len(self.spectra) - 1
        self.log_prior: Array = np.log(np.append(_WHITE, np.full(drifting, (1.0 - _WHITE) / drifting)))
        drifts = [covariances(own[p], row_s) for p in self.parts]
        white = [np.diag(variance[self.used][p] / unit) for p in self.parts]
        self._factors: list[list[Array]] = []
        for s in self.spectra:
            if not s.slope:
                made = white
            else:
                k, size = SLOPES.index(s.slope), row_s / density(s.slope, s.period, row_s)
                made = [w + size * d[k] for w, d in zip(white, drifts, strict=True)]
            self._factors.append([cholesky(C, lower=True, check_finite=False) for C in made])
        self._steps: dict[int, tuple[list[Array], list[Array]]] = {}

    @cached_property
    def _ones(self) -> list[list[tuple[Array, float]]]:
        """A bias whitened, of length 1, and the logarithm of its square before; of spectra and power-ons."""
        out = []
        for factors in self._factors:
            own = [solve_triangular(L, np.ones(len(L)), lower=True, check_finite=False) for L in factors]
            out.append([(u / np.linalg.norm(u), float(np.log(u @ u))) for u in own])
        return out

    def log_det(self, k: int) -> float:
        """Logarithm of the determinant of the covariance, biases integrated out."""
        of_rows = sum(2.0 * float(np.sum(np.log(np.diag(L)))) for L in self._factors[k])
        return of_rows + sum(log for _, log in self._ones[k])

    def white(self, k: int, columns: Array) -> Array:
        """Columns whitened by a spectrum, biases taken off; of the used rows, shape (n, m)."""
        out = np.empty(columns.shape)
        for L, (u, _), p in zip(self._factors[k], self._ones[k], self.parts, strict=True):
            w = solve_triangular(L, columns[p], lower=True, check_finite=False)
            out[p] = w - np.outer(u, u @ w)
        return out

    def unwhitened(self, k: int, whitened: Array) -> Array:
        """What products of whitened columns with these, shape (n, m), are those of the columns themselves with."""
        out = np.empty(whitened.shape)
        for L, (u, _), p in zip(self._factors[k], self._ones[k], self.parts, strict=True):
            w = whitened[p] - np.outer(u, u @ whitened[p])
            out[p] = solve_triangular(L, w, lower=True, trans=1, check_finite=False)
        return out

    def steps(self, k: int) -> tuple[list[Array], list[Array]]:
        """Steps behind each row but the last of each power-on, whitened, (n, n - 1) each, and their products."""
        if k not in self._steps:
            made = []
            for L, (u, _) in zip(self._factors[k], self._ones[k], strict=True):
                w = solve_triangular(L, np.tri(len(L), len(L) - 1, -1), lower=True, check_finite=False)
                made.append(w - np.outer(u, u @ w))
            self._steps[k] = made, [w.T @ w for w in made]
        return self._steps[k]
