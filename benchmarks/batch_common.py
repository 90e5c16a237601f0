"""What units of a batch show together: how often it is told where there is nothing, and where there is something.

    python benchmarks/batch_common.py [--batches 100] [--units 4 10] [--seconds 300]

Simulated logs at 20 Hz of units that sit straight, noise half of Table 1's, biases drawn within its limits. Without
anything common each unit has, in turn, nothing of its own, a drift, a step, a tone at one frequency, or a warming up
with a coefficient of its own (all at one time); then all have an error of the table's beside these. Told is counted as
right if it is of the kind, along the axis, in a quorum of units. A unit that moves by itself is counted too.
"""

import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import bench
import numpy as np
from helpers import batches
from helpers.batches import Error, along

from imutui.jobs.campaign import common_errors, unit_at_rest

if TYPE_CHECKING:
    from filters.types import Array

Course: TypeAlias = "Callable[[Array], Array]"
Told: TypeAlias = tuple[list[common_errors.CommonField], bool]
MG = 9.80665e-3


def _own(kind: str, seed: int, unit: int) -> Error:
    rng = np.random.default_rng([seed, unit, len(kind)])
    axis = int(rng.integers(6))
    size = float(rng.uniform(1.0, 5.0)) * (np.deg2rad(0.05) if axis < 3 else 2.0 * MG) * float(rng.choice([-1.0, 1.0]))
    at, phase = rng.uniform(0.2, 0.8), rng.uniform(0.0, 2.0 * np.pi)
    courses: dict[str, Course] = {
        "nothing": lambda t: np.zeros(t.size),
        "drift": lambda t: size * np.cumsum(np.random.default_rng([seed, unit]).normal(size=t.size)) / np.sqrt(t.size),
        "step": lambda t: size * (t > at * t[-1]),
        "tone": lambda t: size * np.sin(2.0 * np.pi * (3.0 + unit) * t + phase),
        "warming up": lambda t: size * (1.0 - np.exp(-t / 100.0)),
    }
    return lambda t: along(axis, courses[kind](t))


def _shared(kind: str, size: float, seed: int) -> Error:
    courses: dict[str, Course] = {
        "event": lambda t: size * (t > 0.5 * t[-1]),
        "drift": lambda t: size * np.cumsum(np.random.default_rng(seed).normal(size=t.size)) / np.sqrt(0.2 * t.size),
        "tilt": lambda t: np.full(t.size, size),
        "tone": lambda t: size * np.sqrt(2.0) * np.sin(2.0 * np.pi * 4.3 * t),
    }
    return lambda t: along(3, courses[kind](t))


def told(count: int, seed: int, seconds: float, common: Error, own: str) -> Told:
    """Common errors of a batch, and whether a unit is said to move by itself."""
    with tempfile.TemporaryDirectory() as folder:
        each = {unit: _own(own, seed, unit) for unit in range(count)}
        logs = batches.batch(Path(folder), count, seed, seconds, common, each)
        found = [unit_at_rest.unit_at_rest(log.stem, [log], 1.0) for log in logs]
    units = [unit for unit in found if unit is not None]
    return common_errors.found_in(units, 1.0), bool(common_errors.by_themselves(units))


def main() -> None:
    options = bench.options(__doc__, batches=100, units=[4, 10], seconds=300.0)
    print(bench.describe("numpy", "scipy"))
    bench.head("nothing common; of its own each unit has", "units", "told, of batches", "95 %", "kinds", "by itself")
    for count in options.units:
        for own in ("nothing", "drift", "step", "tone", "warming up"):
            kinds, wrong, alone = Counter[str](), 0, 0
            for seed in range(options.batches):
                found, moves = told(count, 1 + seed, options.seconds, batches.nothing, own)
                kinds.update(one["kind"] for one in found)
                wrong, alone = wrong + bool(found), alone + moves
            low, high = bench.wilson(wrong, options.batches)
            bench.row(own, count, f"{wrong} of {options.batches}", f"{low:.3f}..{high:.3f}", dict(kinds) or "", alone)
    bench.head("common along fx", "size", "units", "told, of batches", "more told", "by itself")
    sizes = {
        "event": (1.0, 2.0, 4.0, 8.0),
        "drift": (0.5, 1.0, 2.0, 4.0),
        "tilt": (8.7, 17.0, 35.0),
        "tone": (0.5, 2.0),
    }
    for kind, own_sizes in sizes.items():
        for size in own_sizes:
            for count in options.units:
                right = more = alone = 0
                for seed in range(max(10, options.batches // 5)):
                    common = _shared(kind, size * MG, 7 + seed)
                    found, moves = told(count, 500 + seed, options.seconds, common, "nothing")
                    mine = [
                        one for one in found if one["kind"] == kind and any(s["axis"] == "fx" for s in one["sizes"])
                    ]
                    right, more, alone = right + bool(mine), more + len(found) - len(mine[:1]), alone + moves
                bench.row(kind, f"{size:g} mg", count, f"{right} of {max(10, options.batches // 5)}", more, alone)


if __name__ == "__main__":
    main()
