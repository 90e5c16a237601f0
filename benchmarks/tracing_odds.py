"""Whether odds of slow effects beside measured drift are right as often as they say.

    python benchmarks/tracing_odds.py [--count 60] [--final]

The cases are those of `tracing.py --cases slow` whose units stand still: an effect and its temperature are simulated,
the noise and its drift are measured, and five channels of six have no effect. Each channel is judged by its evidence
alone (`filters/tracing/slow_effects.py`), beside nothing that was selected. Told is what has odds of 9:1; it is named
when the leading family is an effect that the truth is. d counts white noise, as in `tracing_real_cases`.
"""

import itertools
import time
from dataclasses import dataclass

import bench
import numpy as np
import tracing_real_cases as measured
from tracing_cases import CHANNELS, Case
from tracing_real_cases import SIZES

from filters.tracing.blocks import average_all
from filters.tracing.design_matrix import Design
from filters.tracing.slow_effects import SlowEffects
from filters.tracing.stack import Stack

TOLD = 0.9
_BLOCK_S = 0.25
_BINS = (0.0, 0.03, 0.1, 0.5, 0.9, 1.0)
_OF_ONE_RUN = {"step", "telegraph"}  # part of drift here


@dataclass(frozen=True)
class Judged:
    """A channel: whether an effect acts, of what d, the probability told, whether the truth leads or is listed."""

    acts: bool
    d: float
    told: float
    named: bool
    listed: bool
    seconds: float


def judged(case: Case) -> list[Judged]:
    """The channels of a case."""
    slow = SlowEffects(Design(Stack.of(average_all(list(case.runs), _BLOCK_S))))
    out = []
    for c, channel in enumerate(CHANNELS):
        truths = [t for t in case.truths if channel in t.channels and t.place == "findings"]
        if any(t.names & _OF_ONE_RUN for t in truths):
            continue
        start = time.process_time()
        rivals = slow.rivals([], c)
        names = [{a.hypothesis.effect for a in r.terms} for r in rivals if r.probability > _BINS[1]]
        true = set().union(*(t.names for t in truths))
        out.append(
            Judged(
                acts=bool(truths),
                d=max((t.d for t in truths), default=0.0),
                told=sum(r.probability for r in rivals),
                named=bool(names and names[0] & true),
                listed=any(own & true for own in names),
                seconds=time.process_time() - start,
            )
        )
    return out


def share(flags: list[bool]) -> str:
    """Count, of how many, and the 95 % Wilson interval."""
    if not flags:
        return "  0 of   0"
    low, high = bench.wilson(sum(flags), len(flags))
    return f"{sum(flags):3d} of {len(flags):3d}   {low:.2f}..{high:.2f}"


def main() -> None:
    asked = bench.options(__doc__, count=60, final=False)
    if why := measured.missing():
        print(f"skipped: {why}")
        return
    made = (measured.case("slow", number, asked.final) for number in range(asked.count))
    found = [own for case in made if all(run.still for run in case.runs) for own in judged(case)]
    print(bench.describe("numpy", "scipy"))
    print(f"\n{len(found)} channels, effects simulated, noise measured; 95 % Wilson intervals\n")
    for low, high in itertools.pairwise(_BINS):
        own = [x for x in found if low <= x.told < high or x.told == high == 1.0]
        mean = f"{np.mean([x.told for x in own]):.3f}" if own else "-"
        print(f"told with {low:.2f} to {high:.2f}, mean {mean}: an effect acts {share([x.acts for x in own])}")
    print()
    print(f"nothing acts, told: {share([x.told > TOLD for x in found if not x.acts])}")
    for d in SIZES:
        own = [x for x in found if x.acts and abs(x.d / d - 1.0) < 0.2]
        told, named, listed = ([flag(x) for x in own] for flag in (_told, _named, _listed))
        print(f"d {d:3.0f}: told {share(told)}, named {share(named)}, listed {share(listed)}")
    print(f"\nCPU time of a channel: {bench.told([x.seconds for x in found])} s")


def _told(x: Judged) -> bool:
    return x.told > TOLD


def _named(x: Judged) -> bool:
    return x.told > TOLD and x.named


def _listed(x: Judged) -> bool:
    return x.listed


if __name__ == "__main__":
    main()
