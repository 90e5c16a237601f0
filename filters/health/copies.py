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
        self._since = np.full(shape, np.nan)

    def add(self, t: Array, found: NDArray[np.bool_]) -> Array:
        """Take what was found in spans with times `t`, (spans, n).

        Returns since when each had then been found in a row, s, NaN where not for long enough; of the shape of `found`.
        """
        out = np.full(found.shape, np.nan)
        for k in range(len(t)):
            if not found[k].any():
                self._count[...] = 0
                continue
            self._since = np.where(found[k] & (self._count == 0), t[k, 0], self._since)
            self._count = np.where(found[k], self._count + 1, 0)
            long = (self._count >= _SPANS) & (t[k, -1] - self._since >= _LEAST_S)
            out[k, long] = self._since[long]
        return out


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

    def add(self, t: Array, second: Array, still: NDArray[np.bool_]) -> None:
        """Take spans of readings.

        `t`: times, shape (spans, SPAN).
        `second`: second differences of the values, shape (spans, SPAN - 2, channels).
        `still`: whether the unit is at rest, shape (spans,).
        """
        scale = np.median(np.abs(second), axis=1) / 0.6745
        usable = scale > 0.0
        if not still.all():
            usable &= still[:, None] | (np.einsum("sij,sij->sj", second[:, 1:], second[:, :-1]) < 0.0)
        z = np.clip(second / np.where(usable, scale, 1.0)[:, None], -_CLIP, _CLIP)
        z *= usable[:, None]
        by_lag = _correlations(z)
        usable &= np.abs(np.einsum("slii->sli", by_lag)[:, _TONE_LAGS]).max(axis=1) < _TONE
        quietest = np.minimum.accumulate([self._quietest, *np.where(usable, scale, np.inf)])
        self._quietest = quietest[-1]
        # of either channel behind the other one
        turned = by_lag.transpose(0, 1, 3, 2)
        by_lag = np.where(np.abs(by_lag) >= np.abs(turned), by_lag, turned)
        late = np.abs(by_lag).argmax(axis=1)
        alike = np.take_along_axis(by_lag, late[:, None], axis=1)[:, 0]
        # what of a channel's changes the other one does not have
        rest = np.sqrt(np.maximum(1.0 - alike**2, 0.0)) * scale[:, None]
        found = (np.abs(alike) >= _ALIKE) & (rest < _REST * quietest[1:, None]) & usable[:, None] & usable[:, :, None]
        found &= found.transpose(0, 2, 1) & ~np.eye(scale.shape[1], dtype=bool)
        since = self._alike.add(t, found)
        for k, a, b in np.argwhere(np.triu(~np.isnan(since))).tolist():
            if (a, b) not in self.pairs:
                ratio = float(np.sign(alike[k, a, b]) * scale[k, b] / scale[k, a])
                self.pairs[a, b] = Pair(a, b, float(since[k, a, b]), ratio, int(late[k, a, b]))
        summed = _sums(by_lag[:, 0], usable) & ~np.asarray(found.any(axis=(1, 2)))[:, None]
        since = self._summed.add(t, summed)
        for k, c in np.argwhere(~np.isnan(since)).tolist():
            self.sums.setdefault(c, float(since[k, c]))


def _correlations(z: Array) -> Array:
    """Correlation of each column with each one some rows earlier, shape (spans, _LATEST + 1, channels, channels)."""
    spans, rows, channels = z.shape
    kept = rows - _LATEST
    # early[span, channel, lag, row]: the channel's value so many rows before
    early = sliding_window_view(np.ascontiguousarray(z.transpose(0, 2, 1)), kept, axis=2)[:, :, ::-1]
    products = (early.reshape(spans, -1, kept) @ z[:, _LATEST:]).reshape(spans, channels, -1, channels)
    until = np.concatenate([np.zeros((spans, 1, channels)), np.cumsum(z**2, axis=1)], axis=1)
    norms = np.sqrt(np.maximum(until[:, kept:] - until[:, : _LATEST + 1], 0.0))[:, ::-1]
    scale = np.maximum(norms[:, :, None] * norms[:, :1, :, None], 1e-300)
    return np.asarray(products.transpose(0, 2, 3, 1) / scale)


def _sums(correlation: Array, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether each channel is a linear combination of the others, bool, shape (spans, channels).

    Of channels with correlation matrix R, the share of i that the others do not explain is 1/√(R⁻¹)ᵢᵢ.
    """
    own = np.eye(usable.shape[1])
    # a channel that is not usable is like no other
    R = np.where(usable[:, None] & usable[:, :, None], correlation, own) + 1e-9 * own
    explained = np.diagonal(np.linalg.inv(R), axis1=1, axis2=2) > _OF_SUM**-2
    return np.asarray(explained & usable & (usable.sum(axis=1) > 2)[:, None])
