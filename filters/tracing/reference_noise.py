"""Noise of a measured attitude, such as an optical reference's, in residuals: where the unit moves, and not at rest.

At rest the attitude is the mean of many rows, and the rate is zero; in motion every block has the noise of the rows at
its ends. Blocks in motion then count for less, by how much more they scatter in what effects leave.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from filters.allan import CHI2_MEDIAN
from filters.channels import CHANNELS
from filters.tracing.blocks import Blocks
from filters.types import Array

_LEAST = 30
"""Blocks in motion and at rest that show what their noise is."""


@dataclass(frozen=True, slots=True)
class ReferenceNoise:
    """Variance at rest over variance in motion, at most 1."""

    of_blocks: Array  # of means over blocks, shape (6,)
    of_samples: Array  # of differences of neighbouring samples, shape (6,)

    def counted(self, blocks: Blocks) -> Blocks:
        """Blocks with the weight that their reference's noise leaves them; others as they are."""
        if blocks.run.attitude is None:
            return blocks
        moves = moving(blocks)[:, None]
        return replace(
            blocks,
            weight=np.where(moves, blocks.weight * self.of_blocks, blocks.weight),
            rough=np.where(moves, blocks.rough * self.of_samples, blocks.rough),
        )


EXACT = ReferenceNoise(np.ones(len(CHANNELS)), np.ones(len(CHANNELS)))
"""Of a reference without noise."""


def reference_noise(left: Sequence[Blocks]) -> ReferenceNoise:
    """How much more residuals of runs with a measured attitude scatter in motion.

    `left`: of what effects leave of the runs.
    """
    measured = [b for b in left if b.run.attitude is not None]
    if not measured:
        return EXACT
    blocks, samples = np.ones(len(CHANNELS)), np.ones(len(CHANNELS))
    for c in range(len(CHANNELS)):
        rest, motion = (_levels(measured, c, turns=turns) for turns in (False, True))
        if rest is not None and motion is not None:
            blocks[c], samples[c] = (min(1.0, a / b) for a, b in zip(rest, motion, strict=True))
    return ReferenceNoise(blocks, samples)


def moving(blocks: Blocks) -> NDArray[np.bool_]:
    """Blocks in which a unit turns at some sample, shape (n,)."""
    if blocks.run.still:
        return np.zeros(blocks.t.size, bool)
    return np.asarray(np.add.reduceat(np.abs(blocks.run.rates).sum(axis=1), blocks.edges[:-1]) > 0.0)


def _levels(measured: Sequence[Blocks], channel: int, *, turns: bool) -> tuple[float, float] | None:
    """Variance of a block's mean, and of differences of samples, at rest or in motion; None with too few blocks."""
    steps, rough = [], []
    for b in measured:
        good = (moving(b) == turns) & (b.weight[:, channel] > 0.0)
        w = b.weight[:, channel]
        pairs = good[1:] & good[:-1]
        steps.append(np.diff(b.y[:, channel])[pairs] ** 2 / (1.0 / w[1:][pairs] + 1.0 / w[:-1][pairs]))
        some = good & (b.pairs[:, channel] > 0.0)
        rough.append(b.rough[some, channel] / b.pairs[some, channel])
    step, each = np.concatenate(steps), np.concatenate(rough)
    if min(step.size, each.size) < _LEAST:
        return None
    return float(np.median(step)) / CHI2_MEDIAN, float(np.median(each))
