"""From runs to findings: faults and lines out, noise levelled, effects selected, rivals named, the held-out run judged.

Each step is a module of its own; the package's docstring lists them in order. This one has them done.
"""

from collections.abc import Callable, Sequence

from filters.channels import CHANNELS
from filters.tracing import validation
from filters.tracing.assessment import assess
from filters.tracing.blocks import BLOCK_S, average_all
from filters.tracing.design_matrix import Design
from filters.tracing.identifiability import untestable
from filters.tracing.noise_level import noise_drivers
from filters.tracing.noise_structure import noise_findings
from filters.tracing.report import report
from filters.tracing.result import Trace
from filters.tracing.run import Run, in_order
from filters.tracing.screening import Screening, lines_of, without_faults, without_lines
from filters.tracing.selection import select
from filters.tracing.stack import Stack

LEAST_S = 60.0
"""A run must be this long to be used at all."""
_LONG_S = 4.0 * 3600.0

Progress = Callable[[float, str], None]


def trace(
    runs: Sequence[Run],
    heldout: Run | None,
    *,
    asked: Sequence[str] = (),
    seed: int = 0,
    progress: Progress = lambda share, text: None,
) -> Trace:
    """Trace what the model of constant biases lacks.

    Parameters
    ----------
    runs : sequence of Run
        Power-ons to learn from, or parts of them, at least one.
    heldout : Run or None
        A power-on, or a part of one, that nothing is fitted to; without one, folds of the runs judge.
    asked : sequence of str
        Effects whose limit of detection is to be said.
    seed : int
        Of intervals and bands.
    progress : callable
        Told a share from 0 to 1 and what is being done.

    Returns
    -------
    Trace

    Raises
    ------
    ValueError
        If there is no run, or one is too short.
    """
    _check(runs, heldout)
    runs = in_order(runs)
    progress(0.0, "looking for faults")
    cleaned = [without_faults(run) for run in (*runs, *([heldout] if heldout else []))]
    lines = lines_of([run for run, _ in cleaned[: len(runs)]])
    ready = [without_lines(run, lines) for run, _ in cleaned]
    progress(0.2, "averaging")
    block_s = _block_s(runs)
    blocks = average_all(ready, block_s)
    design = Design(Stack.of(blocks[: len(runs)]))
    channels = [c for c in range(len(CHANNELS)) if design.sd[c] > 0.0 and design.stack.seconds(c) > 0.5 * LEAST_S]
    progress(0.35, "levelling the noise")
    multiplier, drivers = noise_drivers(design, channels)
    design.set_multiplier(multiplier)
    hidden = untestable(design, channels)
    progress(0.4, "comparing effects")
    chosen = select(design, channels, lambda share: progress(0.4 + 0.4 * share, "comparing effects"))
    progress(0.8, "judging")
    screening = Screening(
        faults=tuple(fault for _, own in cleaned for fault in own),
        lines=tuple(lines),
        noise_drivers=tuple(drivers),
        noise_findings=tuple(noise_findings(ready[: len(runs)])),
        untestable=tuple(hidden),
    )
    held_out = Stack.of(blocks[len(runs) :]) if heldout else None
    found = assess(chosen, channels, screening, held_out, asked, seed)
    progress(1.0, "done")
    return report(found)


def _block_s(runs: Sequence[Run]) -> float:
    """Length of a block, s: longer for many hours of motion, so that they fit in memory."""
    total = sum(run.seconds for run in runs)
    moving = any(not run.still for run in runs)
    return BLOCK_S if total < _LONG_S or not moving else min(1.0, BLOCK_S * total / _LONG_S)


def _check(runs: Sequence[Run], heldout: Run | None) -> None:
    if not runs:
        raise ValueError("`runs` is empty: there is nothing to trace")
    for run in (*runs, *([heldout] if heldout else [])):
        if run.t.size < 8 or run.seconds < LEAST_S:
            raise ValueError(
                f"{run.name} lasts {run.seconds:.1f} s: a run must last {LEAST_S:.0f} s at least, and a held-out one"
                f" {validation.LEAST_S:.0f} s for a verdict"
            )
