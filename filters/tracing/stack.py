"""Blocks of several runs, one after the other, cut into cells for folds; runs may be parts of one power-on."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.allan import CHI2_MEDIAN
from filters.errors import InputError
from filters.tracing.blocks import Blocks
from filters.types import Array

# of a cell, s, at most: what is left out together when a fit is judged on what it has not seen; there is one a fold
CELL_S = 20.0
FOLDS = 5  # a fold leaves out every fifth cell
_MARGIN = 1e-3  # so that the last block falls into the last cell


@dataclass(frozen=True)
class Stack:
    """Blocks of all runs, one after the other."""

    blocks: tuple[Blocks, ...]
    t: Array  # s since the first known sample of its power-on, shape (n,)
    part_t: Array  # s since its run's first sample, shape (n,)
    run: NDArray[np.int_]  # number of the run, shape (n,)
    starts: NDArray[np.int_]  # first row of each run
    power_on: NDArray[np.int_]  # number of the power-on, shape (n,): of each there is one bias
    begins: NDArray[np.int_]  # first row of each power-on
    # y, weight: residual and weight, shape (n, 6)
    y: Array
    weight: Array
    cell: NDArray[np.int_]  # number of the cell of 20 s, of short runs a fifth of all, shape (n,)
    period: float  # of a block, s

    @classmethod
    def of(cls, blocks: Sequence[Blocks]) -> "Stack":
        """Runs one after the other; cells are numbered on from run to run.

        Raises InputError if parts of a power-on do not follow each other in time.
        """
        first_runs = _first_runs(blocks)
        sizes = [b.t.size for b in blocks]
        run = np.repeat(np.arange(len(blocks)), sizes)
        t = np.concatenate([b.t for b in blocks])
        cell, offset = np.empty(t.size, np.int64), 0
        cell_s = min(CELL_S, (1.0 + _MARGIN) * sum(b.run.seconds for b in blocks) / FOLDS)
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        part_t = t - np.repeat([b.run.begins for b in blocks], sizes)
        for start, size in zip(starts.tolist(), sizes, strict=True):
            own = (part_t[start : start + size] // cell_s).astype(np.int64)
            cell[start : start + size] = own + offset
            offset += int(own[-1]) + 1
        begins = starts[first_runs]
        power_on = np.searchsorted(begins, np.arange(t.size), side="right") - 1
        # of one run there is no need of copies
        y = blocks[0].y if len(blocks) == 1 else np.concatenate([b.y for b in blocks])
        weight = blocks[0].weight if len(blocks) == 1 else np.concatenate([b.weight for b in blocks])
        period = float(np.mean([b.period for b in blocks]))
        return cls(tuple(blocks), t, part_t, run, starts, power_on, begins, y, weight, cell, period)

    @property
    def unread(self) -> set[int]:
        """Channels that all runs lack."""
        return set.intersection(*(set(b.run.unread) for b in self.blocks))

    def seconds(self, channel: int) -> float:
        """How long good data of a channel last, s."""
        return float(np.count_nonzero(self.weight[:, channel])) * self.period

    def white_sd(self, y: Array | None = None) -> Array:
        """Standard deviation of a full block's white noise, from the median squared difference; shape (6,).

        Of the residual, or of what is left of it, shape (n, 6).
        """
        y = self.y if y is None else y
        out = np.empty(6)
        inner = np.diff(self.run) == 0
        for c in range(6):
            w = self.weight[:, c]
            good = inner & (w[1:] > 0.0) & (w[:-1] > 0.0)
            scaled = np.diff(y[:, c])[good] ** 2 / (1.0 / w[1:][good] + 1.0 / w[:-1][good])
            out[c] = np.sqrt(np.median(scaled) / CHI2_MEDIAN) if scaled.size else np.nan
        return out


def _first_runs(blocks: Sequence[Blocks]) -> list[int]:
    """Numbers of the runs that begin a power-on."""
    out: list[int] = []
    seen: set[str] = set()
    for number, b in enumerate(blocks):
        own, before = b.run, blocks[number - 1].run if number else None
        if before is None or not own.power_on or own.power_on != before.power_on:
            if own.power_on in seen:
                raise InputError(f"{own.name} does not stand beside the other parts of its power-on")
            out.append(number)
            seen |= {own.power_on} - {""}
        elif own.begins <= before.begins + before.seconds:
            raise InputError(f"{own.name} begins before {before.name}, of the same power-on, ends")
    return out
