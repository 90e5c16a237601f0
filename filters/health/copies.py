"""Channels that repeat another one: exact, scaled, turned in sign, or one reading late."""

from dataclasses import dataclass

import numpy as np

from filters.types import Array

SPAN = 64  # readings that are compared at a time
_CLIP = 4.0  # standard deviations: one knock, which all channels feel, must not decide
_ALIKE = 0.99  # correlation
_REST = (
    0.3  # what copies do not share, over the noise of the quietest span; motion that two channels feel leaves all noise
)
_SPANS, _LEAST_S = 3, 1.0  # so many in a row, and so long


@dataclass(frozen=True, slots=True)
class Pair:
    """Two channels that read alike."""

    # a, b: their numbers, a < b
    a: int
    b: int
    since_s: float
    ratio: float  # of b's changes over a's, with its sign
    late: bool  # whether one follows the other by a reading


class Copies:
    """Compares the fast part of every pair of channels, span by span.

    Second differences leave slow motion out and keep each sensor's own noise, which no two sensors share. Where the
    unit moves, spans count only if noise rules their second differences: those of white noise alternate in sign.
    """

    def __init__(self, channels: int) -> None:
        self._alike = np.zeros((channels, channels), np.int64)
        self._since = np.full((channels, channels), np.nan)
        self._quietest = np.full(channels, np.inf)
        self.pairs: dict[tuple[int, int], Pair] = {}

    def add(self, t: Array, x: Array, *, still: bool) -> None:
        """Take a span of readings: times (SPAN,), values (SPAN, channels), and whether the unit is at rest."""
        d = x[2:] - 2.0 * x[1:-1] + x[:-2]
        scale = np.median(np.abs(d), axis=0) / 0.6745
        usable = scale > 0.0
        if not still:
            usable &= np.einsum("ij,ij->j", d[1:], d[:-1]) < 0.0
        z = np.clip(d / np.where(usable, scale, 1.0), -_CLIP, _CLIP)
        z *= usable
        z /= np.maximum(np.sqrt(np.einsum("ij,ij->j", z, z)), 1e-300)
        at_once, after = z.T @ z, z[1:].T @ z[:-1]
        alike = np.where(np.abs(after) > np.abs(at_once), after, at_once)
        alike = np.where(np.abs(alike.T) > np.abs(alike), alike.T, alike)
        self._quietest = np.minimum(self._quietest, np.where(usable, scale, np.inf))
        # what of a channel's changes the other one does not have
        rest = np.sqrt(np.maximum(1.0 - alike**2, 0.0)) * scale
        found = (np.abs(alike) >= _ALIKE) & (rest < _REST * self._quietest)
        found &= found.T
        np.fill_diagonal(found, False)
        if not found.any() and not self._alike.any():
            return
        self._since = np.where(found & (self._alike == 0), t[0], self._since)
        self._alike = np.where(found, self._alike + 1, 0)
        for a, b in zip(*np.nonzero(np.triu(self._alike >= _SPANS)), strict=True):
            pair = (int(a), int(b))
            if pair not in self.pairs and t[-1] - self._since[pair] >= _LEAST_S:
                ratio = float(np.sign(alike[pair]) * scale[b] / scale[a])
                late = bool(abs(at_once[pair]) < _ALIKE)
                self.pairs[pair] = Pair(*pair, float(self._since[pair]), ratio, late)
