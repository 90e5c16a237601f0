"""What selected effects say of a run at its full rate, and the run without it.

Motion times a delay looks like lines, and makes the noise of blocks look greater than it is: lines and noise are judged
in what effects leave. What it leaves out: events of one run (tones, steps), which have no columns at the samples.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from filters.channels import CHANNELS
from filters.effects.hypothesis import Hypothesis
from filters.effects.inputs import Inputs
from filters.effects.run_specific import RunSpecific
from filters.tracing.blocks import Blocks
from filters.tracing.columns import is_slow
from filters.tracing.run import Run
from filters.tracing.selection import Selection
from filters.types import Array


@dataclass(frozen=True, slots=True)
class _Part:
    """One effect on one channel with its parameters."""

    hypothesis: Hypothesis
    channel: int
    theta: Array

    def __call__(self, inputs: Inputs) -> Array:
        return np.asarray(np.nan_to_num(self.hypothesis.columns(inputs, self.channel)) @ self.theta)


def explained(blocks: Blocks, chosen: Selection) -> Array:
    """What the selected effects add to a run's readings, SI, shape (N, 6).

    `blocks`: of the run; any run, also one that nothing was fitted to.
    `chosen`: with its joint fit.
    """
    parts = _parts(chosen)
    out = np.zeros((blocks.run.t.size, len(CHANNELS)))
    fast = [p for p in parts if not is_slow(p.hypothesis)]
    if fast:
        blocks.at_samples([(_on(fast, c), c) for c in sorted({p.channel for p in fast})], out)
    slow = blocks.slow()
    for p in parts:
        if is_slow(p.hypothesis):
            out[:, p.channel] += np.interp(blocks.run.begins + blocks.run.t, blocks.t, p(slow))
    return out


def without(run: Run, said: Array) -> Run:
    """A run whose readings lack what is said of them."""
    return replace(run, reading=run.reading - said)


def _parts(chosen: Selection) -> list[_Part]:
    fit = chosen.fit()
    return [
        _Part(term.hypothesis, c, theta)
        for term, theta in zip(fit.terms, fit.theta, strict=True)
        if not isinstance(term.hypothesis, RunSpecific)
        for c in term.places
    ]


def _on(parts: Sequence[_Part], channel: int) -> Callable[[Inputs], Array]:
    own = [p for p in parts if p.channel == channel]

    def total(inputs: Inputs) -> Array:
        return np.asarray(np.sum([p(inputs) for p in own], axis=0))

    return total
