"""Channels that repeat others: exact, scaled, turned in sign, some readings late, or as a sum of several."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from filters.types import Array

SPAN = 64  # readings that are compared at a time
_CLIP = 4.0  # standard deviations: one knock, which all channels feel, must not decide
_ALIKE = 0.99  # correlation
_REST = 0.3
"""What copies do not share, over the noise of the quietest span; motion that two channels feel leaves their noise."""
_OF_SUM = 0.03  # what a sum does not share with its parts, over its own noise
_SPANS, _LEAST_S = 3, 1.0  # so many in a row, and so long
_LATEST = 16  # readings by which a copy may come late
_TONE, _TONE_LAGS = 0.7, range(8, _LATEST + 1)
"""Correlation of a channel with itself so many readings later, above which a tone rules it, and no noise of its own."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two channels that read alike."""

    # a, b: their numbers, a < b
    a: int
    b: int
    since_s: float
    ratio: float  # of b's changes over a's, with its sign
    late: int  # by how many readings one follows the other


class _InARow:
    """Counts for how many spans in a row each of several things was found, and since when."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._count = np.zeros(shape, np.int64)
        self.since = np.full(shape, np.nan)

    def add(self, t: Array, found: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Take what was found in a span with times `t`; returns what has now been found for long enough."""
        self.since = np.where(found & (self._count == 0), t[0], self.since)
        self._count = np.where(found, self._count + 1, 0)
        return np.asarray((self._count >= _SPANS) & (t[-1] - self.since >= _LEAST_S))


class Copies:
    """Compares the fast part of all channels, span by span.

    Second differences leave slow motion out and keep each sensor's own noise, which no two sensors share. Where the
    unit moves, spans count only if noise rules their second differences: those of white noise alternate in sign. A
    tone, which several channels may feel, counts nowhere.
    """

    def __init__(self, channels: int) -> None:
        self._alike, self._summed = _InARow((channels, channels)), _InARow((channels,))
        self._quietest = np.full(channels, np.inf)
        self.pairs: dict[tuple[int, int], Pair] = {}
        self.sums: dict[int, float] = {}
        """Channels that are sums of others, and since when, s."""

    def add(self, t: Array, x: Array, *, still: bool) -> None:
        """Take a span of readings: times (SPAN,), values (SPAN, channels), and whether the unit is at rest."""
        d = x[2:] - 2.0 * x[1:-1] + x[:-2]
        scale = np.median(np.abs(d), axis=0) / 0.6745
        usable = scale > 0.0
        if not still:
            usable &= np.einsum("ij,ij->j", d[1:], d[:-1]) < 0.0
        z = np.clip(d / np.where(usable, scale, 1.0), -_CLIP, _CLIP)
        z *= usable
        by_lag = _correlations(z)
        usable &= np.abs(np.einsum("kii->ki", by_lag[_TONE_LAGS])).max(axis=0) < _TONE
        self._quietest = np.minimum(self._quietest, np.where(usable, scale, np.inf))
        # of either channel behind the other one
        by_lag = np.where(np.abs(by_lag) >= np.abs(by_lag.transpose(0, 2, 1)), by_lag, by_lag.transpose(0, 2, 1))
        late = np.abs(by_lag).argmax(axis=0)
        alike = np.take_along_axis(by_lag, late[None], axis=0)[0]
        # what of a channel's changes the other one does not have
        rest = np.sqrt(np.maximum(1.0 - alike**2, 0.0)) * scale
        found = (np.abs(alike) >= _ALIKE) & (rest < _REST * self._quietest) & usable & usable[:, None]
        found &= found.T
        np.fill_diagonal(found, False)
        for a, b in zip(*np.nonzero(np.triu(self._alike.add(t, found))), strict=True):
            pair = (int(a), int(b))
            if pair not in self.pairs:
                ratio = float(np.sign(alike[pair]) * scale[b] / scale[a])
                self.pairs[pair] = Pair(*pair, float(self._alike.since[pair]), ratio, int(late[pair]))
        summed = _sums(by_lag[0], usable) if not found.any() else np.zeros(scale.size, np.bool_)
        for c in np.flatnonzero(self._summed.add(t, summed)).tolist():
            self.sums.setdefault(c, float(self._summed.since[c]))


def _correlations(z: Array) -> Array:
    """Correlation of each column with each one some rows earlier, shape (_LATEST + 1, channels, channels)."""
    late = z[_LATEST:]
    # early[row, channel, lag]: the channel's value so many rows before
    early = sliding_window_view(z, _LATEST + 1, axis=0)[:, :, ::-1]
    products = np.tensordot(early, late, axes=(0, 0))
    norms = np.sqrt(np.einsum("rcl,rcl->lc", early, early)), np.sqrt(np.einsum("rc,rc->c", late, late))
    scale = np.maximum(norms[0][:, None, :] * norms[1][:, None], 1e-300)
    return np.asarray(products.transpose(1, 2, 0) / scale)


def _sums(correlation: Array, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether each channel is a linear combination of the others, bool, shape (channels,).

    Of channels with correlation matrix R, the share of i that the others do not explain is 1/√(R⁻¹)ᵢᵢ.
    """
    rows = np.flatnonzero(usable)
    out = np.zeros(usable.size, np.bool_)
    if rows.size > 2:
        R = correlation[np.ix_(rows, rows)] + 1e-9 * np.eye(rows.size)
        out[rows] = np.diag(np.linalg.inv(R)) > _OF_SUM**-2
    return out
