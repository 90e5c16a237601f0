"""Effects compared over runs, with lines and noise judged in what effects leave.

Runs at rest lose their lines first: no effect on them is fast enough to look like one. Of runs that move effects are
selected first, with lines in; what they leave shows lines and noise; without the lines, and with that noise, effects
are selected again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from filters.channels import CHANNELS
from filters.effects.lines import SpectralLine
from filters.tracing.blocks import Blocks, average, average_all
from filters.tracing.design_matrix import Design
from filters.tracing.explained import explained, without
from filters.tracing.line_search import lines_of, rests_of, without_lines
from filters.tracing.noise_level import NoiseDriver, noise_drivers
from filters.tracing.reference_noise import ReferenceNoise, reference_noise
from filters.tracing.run import Run
from filters.tracing.selection import Selection, select
from filters.tracing.stack import Stack
from filters.tracing.thermal_memory import choose_jointly
from filters.types import Array

_SAME_NOISE = 0.05
"""Change of the noise that is not worth another selection."""

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

    `runs`: without faults.
    `heldout`: nothing is fitted to it.
    `block_s`: length of a block, s.
    `least_s`: shorter data of a channel are not used, s.
    `progress`: told a share from 0 to 1.
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
        Stack.of([noise.counted(b) for b in noisy]),
        like=chosen.design,
        left=np.concatenate([own.y for own in left]),
    )


def _noise_changed(before: Design, after: Design, channels: Sequence[int]) -> bool:
    return any(abs(np.log(after.sd[c] / before.sd[c])) > _SAME_NOISE for c in channels)
