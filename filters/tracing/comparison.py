"""Effects compared over runs, with lines and noise judged in what effects leave.

Runs at rest lose their lines first: no effect on them is fast enough to look like one. Of runs that move effects are
selected first, with lines in; what they leave shows lines and noise; without the lines, and with that noise, effects
are selected again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from filters.allan import CHI2_MEDIAN
from filters.channels import CHANNELS
from filters.effects.hypothesis import Hypothesis
from filters.effects.inputs import Inputs
from filters.effects.lines import SpectralLine
from filters.effects.run_specific import RunSpecific
from filters.tracing.blocks import Blocks, average, average_all
from filters.tracing.design_matrix import Design
from filters.tracing.line_search import lines_of, rests_of, without_lines
from filters.tracing.noise_level import NoiseDriver, noise_drivers
from filters.tracing.run import Run
from filters.tracing.selection import Selection, select
from filters.tracing.stack import Stack
from filters.tracing.thermal_memory import choose_jointly
from filters.types import Array

# ---------------------------------------------------------------------------------------------------- reference noise
# Noise of a measured attitude, such as an optical reference's, in residuals: where the unit moves, and not at rest.
#
# At rest the attitude is the mean of many rows, and the rate is zero; in motion every block has the noise of the rows
# at
# its ends. Blocks in motion then count for less, by how much more they scatter in what effects leave.

_LEAST = 30  # blocks in motion and at rest that show what their noise is


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


EXACT = ReferenceNoise(np.ones(len(CHANNELS)), np.ones(len(CHANNELS)))  # of a reference without noise


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


# --------------------------------------------------------------------------------------------------------- comparison

_SAME_NOISE = 0.05  # change of the noise that is not worth another selection

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Compared:
    """What was selected, and what was set aside for it."""

    chosen: Selection
    channels: list[int]  # those with data
    lines: list[SpectralLine]
    drivers: list[NoiseDriver]
    held_out: Stack | None  # the run that nothing was fitted to, without lines
    # training runs without lines and without what effects say, for what is said of their noise: the unit's own, so of
    # those whose reference is noisy while they move only what is at rest
    left: list[Run]


def compare(runs: Sequence[Run], heldout: Run | None, block_s: float, least_s: float, progress: Progress) -> Compared:
    """Select effects.

    `heldout`: nothing is fitted to it.
    `block_s`: length of a block, s.
    `least_s`: shorter data of a channel are not used, s.
    """
    everything = [*runs, *([heldout] if heldout else [])]
    if all(run.still for run in runs):
        return _at_rest(everything, len(runs), block_s, least_s, progress)
    return _in_motion(everything, len(runs), block_s, least_s, progress)


def _at_rest(runs: Sequence[Run], count: int, block_s: float, least_s: float, progress: Progress) -> Compared:
    """Lines first; `count` runs are for fitting, what follows is held out."""
    lines = lines_of(runs[:count], runs[:count])
    blocks = average_all([without_lines(run, lines) for run in runs], block_s)
    progress(0.2)
    chosen, channels, drivers = _selected(Design(Stack.of(blocks[:count])), least_s)
    held_out = Stack.of(blocks[count:]) if blocks[count:] else None
    return Compared(chosen, channels, lines, drivers, held_out, [b.run for b in blocks[:count]])


def _in_motion(runs: Sequence[Run], count: int, block_s: float, least_s: float, progress: Progress) -> Compared:
    """Effects first, then lines and noise, then effects again if that changes anything."""
    blocks = average_all(runs, block_s)
    progress(0.2)
    chosen, channels, drivers = _selected(Design(Stack.of(blocks[:count])), least_s)
    progress(0.6)
    said = [explained(b, chosen) for b in blocks]
    lines = lines_of(runs[:count], [without(run, own) for run, own in zip(runs[:count], said[:count], strict=True)])
    blocks = [_less_lines(b, lines, own) for b, own in zip(blocks, said, strict=True)]
    left = [average(without(b.run, own), block_s) for b, own in zip(blocks[:count], said[:count], strict=True)]
    noise = reference_noise(left)
    again = _again(chosen, blocks[:count], left, noise)
    if lines or _noise_changed(chosen.design, again, channels):
        progress(0.7)
        chosen, channels, drivers = _selected(again, least_s)
    held_out = Stack.of([noise.counted(b) for b in blocks[count:]]) if blocks[count:] else None
    rests = [part for b in left for part in rests_of(b.run)]
    return Compared(chosen, channels, lines, drivers, held_out, rests)


def _less_lines(blocks: Blocks, lines: Sequence[SpectralLine], said: Array) -> Blocks:
    """Blocks of a run without its lines, which are found in what effects leave of it."""
    if not lines:
        return blocks
    run = without_lines(blocks.run, lines, said)
    own = average(run, blocks.period)
    return replace(blocks, run=run, y=own.y, rough=own.rough, pairs=own.pairs)


def _selected(design: Design, least_s: float) -> tuple[Selection, list[int], list[NoiseDriver]]:
    channels = [c for c in range(len(CHANNELS)) if design.sd[c] > 0.0 and design.stack.seconds(c) > 0.5 * least_s]
    multiplier, drivers = noise_drivers(design, channels)
    design.set_multiplier(multiplier)
    chosen = select(design, channels)
    choose_jointly(chosen, channels)
    return chosen, channels, drivers


def _again(chosen: Selection, cleaned: Sequence[Blocks], left: Sequence[Blocks], noise: ReferenceNoise) -> Design:
    """The design with residuals that lack lines, and noise as it is in what effects leave."""
    noisy = [replace(b, rough=own.rough, pairs=own.pairs) for b, own in zip(cleaned, left, strict=True)]
    return Design(
        Stack.of([noise.counted(b) for b in noisy]), like=chosen.design, left=np.concatenate([own.y for own in left])
    )


def _noise_changed(before: Design, after: Design, channels: Sequence[int]) -> bool:
    return any(abs(np.log(after.sd[c] / before.sd[c])) > _SAME_NOISE for c in channels)


# ---------------------------------------------------------------------------------------------------------- explained
# What selected effects say of a run at its full rate, and the run without it.
#
# Motion times a delay looks like lines, and makes the noise of blocks look greater than it is: lines and noise are
# judged
# in what effects leave. What it leaves out: events of one run (tones, steps), which have no columns at the samples.


_Said = Callable[[Inputs], Array]  # what one effect says of a channel at the instants of inputs, SI, shape (n,)


def explained(blocks: Blocks, chosen: Selection) -> Array:
    """What the selected effects add to a run's readings, also one that nothing was fitted to; SI, shape (N, 6)."""
    out = np.zeros((blocks.run.t.size, len(CHANNELS)))
    slow, fast = blocks.slow(), dict[int, list[_Said]]()
    fit = chosen.fit()
    for term, theta in zip(fit.terms, fit.theta, strict=True):
        h = term.hypothesis
        for c in () if isinstance(h, RunSpecific) else term.places:
            said = _said(h, c, theta)
            if h.is_slow:
                out[:, c] += np.interp(blocks.run.begins + blocks.run.t, blocks.t, said(slow))
            else:
                fast.setdefault(c, []).append(said)
    if fast:
        blocks.at_samples([(_total(fast[c]), c) for c in sorted(fast)], out)
    return out


def _said(h: Hypothesis, channel: int, theta: Array) -> _Said:
    return lambda inputs: np.asarray(np.nan_to_num(h.columns(inputs, channel)) @ theta)


def _total(parts: Sequence[_Said]) -> _Said:
    return lambda inputs: np.asarray(np.sum([said(inputs) for said in parts], axis=0))


def without(run: Run, said: Array) -> Run:
    """A run whose readings lack what is said of them."""
    return replace(run, reading=run.reading - said)
