"""Stamps and gaps against the truth, of streams that the host, the line or the unit holds up again and again.

    python benchmarks/held_lines.py [--streams 40] [--seconds 60] [--seed 1]

Each stream has holds of the host and of the line, pauses of the unit, silences and losses, at moments and of sizes
drawn from the seed, and is stamped by a clock as the acquisition's. Counted are gaps by whether their bounds hold the
truth and are exact, packets reported as certainly lost that were not, stamps that are off by more than they say, and
the stamps' errors.
"""

import time

import bench
import numpy as np
from helpers.packet_stream import Heard, hear, stream

from imutui.instrument.clock import Clock
from imutui.instrument.counter_spec import SPAN, CounterSpec
from imutui.instrument.imu400.driver import COUNTER

COUNTERS = {"52 ms": COUNTER, "a second": CounterSpec(1e9 / SPAN, 1e-3, +1)}
KINDS = {
    "host": ("host",), "line": ("line",), "losses": ("lose",), "pauses": ("pause",), "silences": ("silence",),
    "all": ("host", "line", "lose", "pause", "silence"), "busy host": ("line", "pause", "silence", "busy"),
}  # fmt: skip


def held_up(counter: CounterSpec, kinds: tuple[str, ...], seconds: float, seed: int) -> Heard:
    """A stream with a fault of one of these kinds up to 2.5 s after the last one, and what a clock makes of it."""
    rng = np.random.default_rng(seed)
    skew_ppm = float(rng.uniform(-300.0, 300.0))
    made = stream(seconds, seed, skew_ppm=skew_ppm)
    if counter is not COUNTER:
        own_s = (made.sampled - made.sampled[0]) / (1.0 + 1e-6 * skew_ppm)
        made.ticks = np.floor(own_s * SPAN).astype(np.int64) % SPAN
    if rng.random() < 0.3:
        made.bursts(0.016)
    begin, at_s = float(made.due[0]), 3.0
    if "busy" in kinds:
        starts = begin + np.cumsum(rng.exponential(0.2, int(5.0 * seconds)))
        made.stalls += [(start, start + float(rng.uniform(0.01, 0.12))) for start in starts.tolist()]
    while at_s < seconds - 4.0:
        first, size_s = int(np.searchsorted(made.due, begin + at_s)), float(rng.uniform(0.03, 2.5))
        match str(rng.choice(kinds)):
            case "host":
                made.stalls.append((begin + at_s, begin + at_s + size_s))
            case "line":
                made.hold_line(begin + at_s, size_s)
            case "pause":
                for times in (made.sampled, made.due, made.arrives):
                    times[first:] += size_s
                ran = counter.direction * round(size_s / (1.0 + 1e-6 * skew_ppm) / (1e-9 * counter.tick_ns))
                made.ticks[first:] = (made.ticks[first:] + ran) % SPAN
            case "silence":
                made.lose(first, int(size_s / 7.5e-3))
        if "lose" in kinds:
            made.lose(first + int(rng.integers(20)), int(rng.integers(1, 4)), cut=bool(rng.integers(2)))
        at_s += size_s + float(rng.uniform(0.1, 2.5))
    return hear(made, Clock(180 / 38400 * 1e9, counter))


def main() -> None:
    asked = bench.options(__doc__, streams=40, seconds=60.0, seed=1)
    print(bench.describe("numpy"), flush=True)
    bench.head(
        "counter wraps in", "faults", "packets", "places lost at", "told", "bounds hold", "exact", "told elsewhere",
        "lost invented", "stamps beyond ±", "error, ms: p99", "max", "us a packet",
    )  # fmt: skip
    for name, counter in COUNTERS.items():
        for kinds in KINDS:
            figures, errors, began = np.zeros(8, int), [], time.process_time()
            for k in range(asked.streams):
                found = held_up(counter, KINDS[kinds], asked.seconds, asked.seed + k)
                gaps = [(stamp.gap, int(lost)) for stamp, lost in zip(found.stamps, found.lost_between, strict=True)]
                at = [(gap, lost) for gap, lost in gaps[1:] if lost]
                told = [(gap, lost) for gap, lost in at if gap is not None]
                figures += [
                    len(gaps), len(at), len(told), sum(g.lost_min <= lost <= g.lost_max for g, lost in told),
                    sum(g.lost_min == lost == g.lost_max for g, lost in told),
                    sum(gap is not None and not lost for gap, lost in gaps[1:]),
                    sum(max(0, gap.lost_min - lost) for gap, lost in gaps[1:] if gap is not None),
                    int(np.sum(np.abs(found.error_s) > found.uncertainty_s)),
                ]  # fmt: skip
                errors.append(np.abs(found.error_s))
            p99, worst = np.percentile(1e3 * np.concatenate(errors), [99.0, 100.0])
            us = 1e6 * (time.process_time() - began) / figures[0]
            bench.row(name, kinds, *figures.tolist(), f"{p99:.3f}", f"{worst:.3g}", f"{us:.0f}")


if __name__ == "__main__":
    main()
