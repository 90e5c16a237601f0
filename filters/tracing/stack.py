"""Blocks of several runs, one after the other, cut into cells for folds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.allan import CHI2_MEDIAN
from filters.tracing.blocks import Blocks
from filters.types import Array

CELL_S = 20.0
"""Length of a cell, s: what is left out together when a fit is judged on what it has not seen."""
FOLDS = 5
"""A fold leaves out every fifth cell."""


@dataclass(frozen=True)
class Stack:
    """Blocks of all runs, one after the other.

    Attributes
    ----------
    blocks : tuple of Blocks
    t : Array
        s since its run's start, shape (n,).
    run : integer array
        Number of the run, shape (n,).
    starts : integer array
        First row of each run.
    y, weight : Array
        Residual and weight, shape (n, 6).
    cell : integer array
        Number of the 20 s cell, shape (n,).
    period : float
        Of a block, s.
    """

    blocks: tuple[Blocks, ...]
    t: Array
    run: NDArray[np.int_]
    starts: NDArray[np.int_]
    y: Array
    weight: Array
    cell: NDArray[np.int_]
    period: float

    @classmethod
    def of(cls, blocks: Sequence[Blocks]) -> "Stack":
        """Runs one after the other; cells are numbered on from run to run."""
        sizes = [b.t.size for b in blocks]
        run = np.repeat(np.arange(len(blocks)), sizes)
        t = np.concatenate([b.t for b in blocks])
        cell, offset = np.empty(t.size, np.int64), 0
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        for start, size in zip(starts.tolist(), sizes, strict=True):
            own = (t[start : start + size] // CELL_S).astype(np.int64)
            cell[start : start + size] = own + offset
            offset += int(own[-1]) + 1
        y = np.concatenate([b.y for b in blocks])
        weight = np.concatenate([b.weight for b in blocks])
        return cls(tuple(blocks), t, run, starts, y, weight, cell, float(np.mean([b.period for b in blocks])))

    def seconds(self, channel: int) -> float:
        """How long good data of a channel last, s."""
        return float(np.count_nonzero(self.weight[:, channel])) * self.period

    def white_sd(self) -> Array:
        """Standard deviation of a full block's white noise, from the median squared difference; shape (6,)."""
        out = np.empty(6)
        inner = np.diff(self.run) == 0
        for c in range(6):
            w = self.weight[:, c]
            good = inner & (w[1:] > 0.0) & (w[:-1] > 0.0)
            scaled = np.diff(self.y[:, c])[good] ** 2 / (1.0 / w[1:][good] + 1.0 / w[:-1][good])
            out[c] = np.sqrt(np.median(scaled) / CHI2_MEDIAN) if scaled.size else np.nan
        return out
