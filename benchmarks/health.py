"""Channel health: which faults are found and named, what is found where nothing is wrong, and what it costs.

    python benchmarks/health.py [spoiled|healthy|measured|live|cost] [--seeds 10] [--healthy 300]

Spoiled: a simulated unit at rest for 180 s, one channel spoiled in each of some thirty ways, at 20 and 133 Hz, with the
scaling of both instruments, once as a unit that states its data sheet and counts, once as an import that states
neither. Healthy: the same without a fault. Measured: each recording beside the repository, by its own import flags.
Live: a virtual unit with a fault, recorded over its line by `imutui record`. Cost: processor time of the monitor over
the packets of a stream in blocks of 0.5 s, with a look each second, as a share of the stream's time.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import bench
import numpy as np
from bench import DATA, IMUTUI
from helpers.spoiled_channels import KINDS, channel_of, findings, healthy

from filters.channels import CHANNELS
from filters.health.monitor import Expected, HealthMonitor
from imutui.logbook.health import entries
from imutui.verdict.rules import judge

UNITS = [(instrument, rate) for instrument in ("imu400cd", "imu381") for rate in (20.0, 400.0 / 3.0)]
LIVE = {
    "dead": 'name = "stuck"\nchannel = "gy"\nat_s = 0.0\nseconds = 1e5',
    "frozen": 'name = "stuck"\nchannel = "gy"\nat_s = 10.0\nseconds = 1e5',
    "clipped": 'name = "saturation"\nchannel = "gy"\nlimit_dps = 0.3',
    "coarse": 'name = "coarse"\nchannel = "gy"\nlattice_dps = 0.6',
    "noisy": 'name = "noise_level"\nchannel = "gy"\nlog_variance = 4.6',
    "quiet": 'name = "noise_level"\nchannel = "gy"\nlog_variance = -6.8',
    "invalid": 'name = "spikes"\nchannel = "gy"\ndps = 20.0\nper_hour = 600',
}


def spoiled(seeds: int) -> None:
    """How often each way to spoil a channel is not GREEN, and how often kind and channel are right."""
    rows = []
    total = Counter[str]()
    for name, (expected, spoil) in KINDS.items():
        count = Counter[str]()
        for instrument, rate in UNITS:
            for stated in (True, False):
                for seed in range(seeds):
                    c = seed % len(CHANNELS)
                    made = spoil(healthy(instrument, rate, seed), c, np.random.default_rng(seed))
                    found = findings(made, stated=stated)
                    named = {(one.kind, one.channel) for one in found}
                    wanted = (
                        {"gx", "gy", "gz"}
                        if name in ("gyros in rad/s", "noise 10 times in all gyros")
                        else {channel_of(expected, c)}
                    )
                    count["cases"] += 1
                    count["not green"] += judge(None, entries(found)).level != "none"
                    count["named"] += bool({(expected, channel) for channel in wanted} & named)
        total += count
        rows.append((name, expected, f"{count['not green']} of {count['cases']}", f"{count['named']}"))
        print(*rows[-1], sep=" | ", flush=True)
    print(
        f"all: {total['not green']} of {total['cases']} not GREEN,"
        f" {total['named']} named ({total['named'] / total['cases']:.3f})"
    )


def without_fault(count: int) -> None:
    """Findings on recordings in which nothing is wrong."""
    wrong = 0
    for number in range(count):
        instrument, rate = UNITS[number % len(UNITS)]
        made = healthy(instrument, rate, 1000 + number)
        for stated in (True, False):
            found = findings(made, stated=stated)
            wrong += bool(found)
            for one in found:
                print(f"seed {1000 + number}, {instrument}, {rate:.0f} Hz, stated {stated}: {one.said}")
    print(f"healthy: {wrong} of {2 * count} with a finding")


def measured() -> None:
    """Findings on measured recordings, as `imutui check` and `imutui replay` report them."""
    with tempfile.TemporaryDirectory() as folder:
        for path in sorted(DATA.glob("*.npz")):
            log, flags = Path(folder) / f"{path.stem}.mcap", json.loads(path.with_suffix(".json").read_text())["import"]
            subprocess.run([*IMUTUI, "import", path, "-o", log, *flags], check=True, capture_output=True)
            for command in ("check", "replay"):
                done = subprocess.run([*IMUTUI, command, log, "--json"], check=False, capture_output=True, text=True)
                found = json.loads(done.stdout)["health"] if done.stdout else [{"said": done.stderr.strip()}]
                print(f"{path.stem}, {command}: " + ("; ".join(one["said"] for one in found) or "nothing"), flush=True)


def live() -> None:
    """Faults of a virtual unit's channel, recorded over its line."""
    for kind, effect in LIVE.items():
        with tempfile.TemporaryDirectory() as folder:
            scenario, port = Path(folder) / "scenario.toml", Path(folder) / "port"
            scenario.write_text(f"seed = 3\n[biases]\ngyro_dps = [0.1, 0.3, -0.1]\n[[effect]]\n{effect}\n")
            env = {**os.environ, "XDG_RUNTIME_DIR": folder}
            unit = subprocess.Popen(
                [*IMUTUI, "virtual", "--link", port, "--scenario", scenario],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
            try:
                assert unit.stdout is not None
                unit.stdout.readline()
                done = subprocess.run(
                    [*IMUTUI, "record", "--port", port, "--rate", "133", "--duration", "40", "--json"],
                    check=False, capture_output=True, text=True, env=env, cwd=folder,
                )  # fmt: skip
                found = json.loads(done.stdout)
                named = any(one["channel"] == "gy" and one["kind"] == kind for one in found["health"])
                print(
                    f"{kind}: exit {done.returncode}, {'named' if named else 'NOT named'}:",
                    *(one["said"] for one in found["health"]),
                )
            finally:
                unit.terminate()
                unit.wait()


def cost(seconds: float = 600.0) -> None:
    """Processor time of the monitor, as a share of the time of the stream that it follows."""
    for instrument, rate in UNITS:
        made = healthy(instrument, rate, 1, seconds)
        monitor = HealthMonitor(Expected(made.spec, made.lsb))
        step, begun = max(1, round(0.5 * rate)), time.process_time()
        for number, first in enumerate(range(0, made.t.size, step)):
            rows = slice(first, first + step)
            monitor.add(made.t[rows], made.x[rows, :3], made.x[rows, 3:], made.degc[rows])
            if number % 2:
                monitor.findings()
        share = (time.process_time() - begun) / seconds
        print(f"{instrument}, {rate:.0f} Hz: {100.0 * share:.3f} % of a processor")


if __name__ == "__main__":
    options = bench.options(__doc__, "spoiled", "healthy", "measured", "live", "cost", seeds=10, healthy=300)
    print(bench.describe("numpy"), file=sys.stderr)
    {"spoiled": lambda: spoiled(options.seeds), "healthy": lambda: without_fault(options.healthy), "measured": measured,
     "live": live, "cost": cost}[options.part]()  # fmt: skip
