"""From runs to findings: faults out, effects selected, lines out, rivals named, the held-out run judged.

Each step is a module of its own; the package's docstring lists them in order. This one has them done.
"""

from collections.abc import Callable, Sequence

import numpy as np

from filters.errors import InputError
from filters.tracing.assessment import Assessment, assess
from filters.tracing.blocks import BLOCK_S
from filters.tracing.comparison import compare
from filters.tracing.identifiability import untestable
from filters.tracing.report import report
from filters.tracing.result import Trace
from filters.tracing.run import Run, in_order
from filters.tracing.screening import Screening, noise_findings, without_faults

_LEAST_BLOCKS = 20  # of a run: fewer tell neither its noise nor what stands out of it
_ENOUGH_S = 60.0  # of a channel; of shorter runs, half of the longest
# _LONG_S, _LONG_AT_REST_S: of motion and at rest, what blocks of the usual length are made of
_LONG_S, _LONG_AT_REST_S = 4.0 * 3600.0, 16.0 * 3600.0
_LONGEST_S = 10.0  # of a block: errors are told of means over 10 s

Progress = Callable[[float, str], None]


def trace(
    runs: Sequence[Run],
    heldout: Run | None,
    *,
    asked: Sequence[str] = (),
    seed: int = 0,
    progress: Progress = lambda share, text: None,
) -> Trace:
    """Trace what the model of constant biases lacks; arguments and errors as of `assessed`."""
    return report(assessed(runs, heldout, asked=asked, seed=seed, progress=progress))


def assessed(
    runs: Sequence[Run],
    heldout: Run | None,
    *,
    asked: Sequence[str] = (),
    seed: int = 0,
    progress: Progress = lambda share, text: None,
) -> Assessment:
    """What a trace finds, before it is put into a document.

    `runs`: power-ons to learn from, or parts of them, at least one.
    `heldout`: a power-on, or a part of one, that nothing is fitted to; without one, folds of the runs judge.
    `asked`: effects whose limit of detection is to be said.
    `progress`: told a share from 0 to 1 and what is being done.
    Raises InputError if there is no run, or one is too short.
    """
    _check(runs, heldout)
    runs = in_order(runs)
    progress(0.0, "looking for faults")
    cleaned = [without_faults(run) for run in (*runs, *([heldout] if heldout else []))]
    progress(0.1, "comparing effects")
    compared = compare(
        [run for run, _ in cleaned[: len(runs)]],
        cleaned[-1][0] if heldout else None,
        block_s(sum(run.seconds for run in runs), still=all(run.still for run in runs)),
        min(_ENOUGH_S, max(run.seconds for run in runs)),
        lambda share: progress(0.1 + 0.7 * share, "comparing effects"),
    )
    chosen, channels = compared.chosen, compared.channels
    progress(0.8, "judging")
    screening = Screening(
        faults=tuple(fault for _, own in cleaned for fault in own),
        lines=tuple(compared.lines),
        noise_drivers=tuple(compared.drivers),
        noise_findings=tuple(noise_findings(compared.left)) if compared.left else (),
        untestable=tuple(untestable(chosen.design, channels)),
    )
    found = assess(chosen, channels, screening, compared.held_out, asked, seed)
    progress(1.0, "done")
    return found


def block_s(seconds: float, *, still: bool) -> float:
    """Length of a block, s: longer for many hours, so that they fit in memory."""
    return float(np.clip(BLOCK_S * seconds / (_LONG_AT_REST_S if still else _LONG_S), BLOCK_S, _LONGEST_S))


def _check(runs: Sequence[Run], heldout: Run | None) -> None:
    if not runs:
        raise ValueError("`runs` is empty: there is nothing to trace")
    for run in (*runs, *([heldout] if heldout else [])):
        least = _LEAST_BLOCKS * max(BLOCK_S, 1.0 / run.rate_hz if run.t.size > 1 else np.inf)
        if run.seconds < least:
            raise InputError(
                f"{run.name} lasts {run.seconds:.1f} s: nothing can be told from its noise in less than"
                f" {_LEAST_BLOCKS} means, {least:.3g} s. What differs slowly takes longer, half an hour of warming up."
            )
