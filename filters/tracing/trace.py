"""From runs to findings: faults and lines out, noise levelled, effects selected, rivals named, the held-out run judged.

`selection` decides what is there, `assessment` checks it on data it has not seen, `report` says it in the fields of a
report; this module gives them clean blocks and has them do it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from filters.effects import faults, lines
from filters.effects.records import Trace
from filters.tracing import (
    identifiability,
    noise_level,
    residual,
    selection,
    validation,
)
from filters.tracing.assessment import Judgement
from filters.tracing.design_matrix import Design, Stack
from filters.tracing.report import Document
from filters.tracing.residual import Run

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
        Power-ons to learn from, at least one.
    heldout : Run or None
        A power-on that nothing is fitted to; without one, folds of the runs judge.
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
    progress(0.0, "looking for faults")
    clean = [_cleaned(run) for run in (*runs, *([heldout] if heldout else []))]
    spectral = _lines(clean[: len(runs)])
    ready = [_without_lines(run, spectral) for run, _ in clean]
    progress(0.2, "averaging")
    total = sum(run.seconds for run in runs)
    moving = any(not run.still for run in runs)
    block_s = residual.BLOCK_S if total < _LONG_S or not moving else min(1.0, residual.BLOCK_S * total / _LONG_S)
    blocks = [residual.blocks(run, block_s) for run in ready]
    design = Design(Stack.of(blocks[: len(runs)]))
    channels = [c for c in range(6) if design.sd[c] > 0.0 and design.stack.seconds(c) > 0.5 * LEAST_S]
    progress(0.35, "levelling the noise")
    design.multiplier, level = noise_level.levels(design, channels)
    hidden = identifiability.untestable(design, channels)
    progress(0.4, "comparing effects")
    chosen = selection.select(design, channels, lambda share: progress(0.4 + 0.4 * share, "comparing effects"))
    progress(0.8, "judging")
    work = Judgement(chosen, channels, seed, Stack.of(blocks[len(runs) :]) if heldout else None)
    work.faults = [fault for _, own in clean for fault in own]
    work.fault_runs = [run.name for run, own in clean for _ in own]
    work.lines, work.levels, work.untestable = spectral, level, hidden
    work.judge(ready, asked)
    progress(1.0, "done")
    return Document(work).trace()


def _check(runs: Sequence[Run], heldout: Run | None) -> None:
    if not runs:
        raise ValueError("`runs` is empty: there is nothing to trace")
    for run in (*runs, *([heldout] if heldout else [])):
        if run.t.size < 8 or run.seconds < LEAST_S:
            raise ValueError(
                f"{run.name} lasts {run.seconds:.1f} s: a run must last {LEAST_S:.0f} s at least, and a held-out one"
                f" {validation.LEAST_S:.0f} s for a verdict"
            )


def _cleaned(run: Run) -> tuple[Run, list[faults.DataFault]]:
    """A run with its faults flagged."""
    flagged, found = faults.find(run.t, run.reading, residual.perfect(run), run.lsb)
    if run.flagged is not None:
        flagged |= run.flagged
    # the steps of averaged samples are uneven by design, and their stamps say so truly
    return replace(run, flagged=flagged), [f for f in found if not (run.averaged and f.effect == "jitter")]


def _lines(clean: Sequence[tuple[Run, list[faults.DataFault]]]) -> list[lines.SpectralLine]:
    return lines.find([(run.rate_hz, residual.residual(run)) for run, _ in clean])


def _without_lines(run: Run, spectral: list[lines.SpectralLine]) -> Run:
    """A run without its lines."""
    if not spectral:
        return run
    r = residual.residual(run)
    less = lines.removed(spectral, run.rate_hz, r) - r
    return replace(run, reading=run.reading + np.nan_to_num(less))
