"""What a trace costs: CPU time of a full campaign, and time and memory of still logs of up to a day.

    python benchmarks/tracing_cost.py [--hours 1,4,12,24] [--log LOG.mcap]

`--log` traces a log as `imutui trace` does, reading included, instead of the still ones.

One core, one process for each measurement, so that the peak of its memory is its own. Simulated readings.
"""

import os
import resource
import time
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import bench
import numpy as np
import tracing_cases as cases

from filters.imu import STANDARD_GRAVITY, AxisMap
from filters.tracing.run import Run
from filters.tracing.trace import trace
from imutui.jobs.trace import TraceOptions
from imutui.jobs.trace import trace as trace_logs

RATE = 133.0
REQUIRED_S = 10.0
REQUIRED_MB = 1500.0  # of a still log of 24 h, the log itself included
_MEGA = 1e6


def campaign() -> tuple[Run, ...]:
    """Four runs of 87 000 readings, the whole table programme, with an effect to be found."""
    made = cases.case("catalogue", 3)
    assert made.heldout is not None
    assert made.campaign == "full"
    return *made.runs, made.heldout


def still(hours: float) -> tuple[Run, ...]:
    rng = np.random.default_rng(0)
    n = round(hours * 3600.0 * RATE)
    sd = cases.density(cases.WHITE) * np.sqrt(RATE)
    reading = np.empty((n, 6))
    for c in range(6):
        values = rng.standard_normal(n) * sd[c] + (STANDARD_GRAVITY if c == 5 else 0.0)
        reading[:, c] = np.rint(values / cases.COUNT[c]) * cases.COUNT[c]
    t = np.arange(n) / RATE
    T = np.round((24.0 - 6.0 * np.expm1(-t / 600.0)) / 0.05) * 0.05
    zero = np.zeros((1, 3))
    return (Run("still", t, reading, T, zero, zero, AxisMap(), cases.forms.SITE, None, cases.COUNT),)


def measure(what: str) -> tuple[float, int, float, float]:
    """CPU time of a trace (s), readings, memory before and at the peak (MB), of this process."""
    warm = cases.case("free", 0)
    trace(warm.runs, warm.heldout)  # compiles
    runs = () if what.endswith(".mcap") else campaign() if what == "campaign" else still(float(what))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    start = time.process_time()
    if runs:
        trace(runs[:-1] or runs, runs[-1] if len(runs) > 1 else None)
        count = sum(run.t.size for run in runs)
    else:
        count = trace_logs([Path(what)], TraceOptions()).document["runs"][0]["samples"]
    return time.process_time() - start, count, before, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def main() -> None:
    asked = bench.options(__doc__, hours="1,4,12,24", log=str)
    print(bench.describe("numpy", "scipy", "numba"))
    spent, count, _, peak = bench.apart(measure, "campaign")
    verdict = "met" if spent <= REQUIRED_S else "MISSED"
    print(f"\nfour runs, {count} readings: {spent:.1f} s CPU (<= {REQUIRED_S:.0f} s: {verdict}), peak {peak:.0f} MB\n")
    print("still log   readings    CPU s   s per million   peak MB   MB per million beyond the log itself")
    for what in [asked.log] if asked.log else asked.hours.split(","):
        spent, count, before, peak = bench.apart(measure, what)
        million = count / _MEGA
        verdict = f" (<= {REQUIRED_MB:.0f}: {'met' if peak <= REQUIRED_MB else 'MISSED'})" if what == "24" else ""
        print(
            f"{what if asked.log else what + ' h':>8s} {count:12d} {spent:8.1f} {spent / million:15.2f} {peak:9.0f}"
            f" {(peak - before) / million:10.0f}{verdict}",
            flush=True,
        )


if __name__ == "__main__":
    main()
