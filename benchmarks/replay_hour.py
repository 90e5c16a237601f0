"""What a whole `imutui replay` of an hour at 133 Hz costs, and how much of that is reading and writing.

    python benchmarks/replay_hour.py [--seconds 3600] [--rate 133] [--repeat 3]

The commands are run as a user would, each a process of its own:

    imutui replay LOG --json                              read and filter
    imutui replay LOG --json -o EST.mcap                  and write estimates, 10 a second
    imutui replay LOG --json -o EST.mcap --estimates 0    and write all of them

Their CPU time is the kernel's account of the child (user and system, all threads). From it are taken away the start,
which is the CPU time of the same command on a log of two seconds, and the filter, which is that of
`imutui.jobs.replay.run` on the same samples without writing, in a process of its own. What is left, divided by the
samples, is reading (with the checksum of the file) and writing together. Being a difference of three noisy numbers it
wants a quiet machine; reading is also timed directly in that process. Values are simulated.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import machine
import numpy as np
import reading

TARGET_US = 3.0
SHORT_S = 2
COMMANDS: dict[str, list[str]] = {
    "read, filter": [],
    "and write, 10 Hz": ["-o", "{output}"],
    "and write, all": ["-o", "{output}", "--estimates", "0"],
}
REQUIRED = ("read, filter", "and write, 10 Hz")


@dataclass(frozen=True, slots=True)
class Cost:
    """Of one command: CPU and wall seconds, megabytes at most, and the document it printed."""

    cpu_s: float
    wall_s: float
    peak_mb: float
    document: dict[str, object]


def run(log: Path, options: list[str], cache: Path | None = None) -> Cost:
    """Run `imutui replay` on a log as a process of its own."""
    with tempfile.TemporaryDirectory(dir=log.parent) as folder:
        output = str(Path(folder) / "estimates.mcap")
        words = [sys.executable, "-m", "imutui", "replay", str(log), "--json"]
        words += [word.format(output=output) for word in options]
        environment = os.environ | ({"NUMBA_CACHE_DIR": str(cache)} if cache is not None else {})
        printed = Path(folder) / "printed.json"
        with printed.open("wb") as out:
            started = time.perf_counter()
            child = subprocess.Popen(words, stdout=out, stderr=subprocess.PIPE, env=environment)
            assert child.stderr is not None
            said = child.stderr.read().decode()
            _, status, usage = os.wait4(child.pid, 0)
            wall_s = time.perf_counter() - started
        # 1 is a finding, such as a bias that has not converged on a log of two seconds
        if os.waitstatus_to_exitcode(status) not in (0, 1):
            raise SystemExit(f"{' '.join(words)} failed: {said}")
        document = json.loads(printed.read_text())
    return Cost(usage.ru_utime + usage.ru_stime, wall_s, usage.ru_maxrss / 1024.0, document)


def parts_of(log: Path, short: Path) -> tuple[float, float]:
    """CPU seconds of reading a log, with its checksum, and of the filter over it, in this process."""
    from filters.kalman import runner
    from filters.kalman.runner import Estimator
    from imutui.jobs import replay, replay_input
    from imutui.logbook import reader

    reader.read(short)
    started = time.process_time()
    read = reader.read(log)
    part = replay_input.select(read, None, None)
    reader.sha256(log)
    reading_s = time.process_time() - started
    options = replay.ReplayOptions()
    _, settings = replay.prepare(read, part, options)
    runner.warm_up()
    estimator = Estimator(settings, np.inf)
    started = time.process_time()
    for _ in replay.run(estimator, [part], float(part.t[-1]), None, lambda share: None):
        pass
    return reading_s, time.process_time() - started


def report(log: Path, short: Path, seconds: int, repeat: int) -> None:
    """Measure in turn and print."""
    starts: dict[str, list[float]] = {name: [] for name in COMMANDS}
    costs: dict[str, list[Cost]] = {name: [] for name in COMMANDS}
    readings: list[float] = []
    filters: list[float] = []
    run(short, [])
    for _ in range(repeat):
        words = [sys.executable, __file__, "--parts", str(log), str(short)]
        printed = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()
        readings.append(float(printed[0]))
        filters.append(float(printed[1]))
        for name, options in COMMANDS.items():
            starts[name].append(run(short, options).cpu_s)
            costs[name].append(run(log, options))
    samples = costs["read, filter"][0].document["samples"]
    assert isinstance(samples, int)
    per = 1e6 / samples
    each = [machine.told([s * per for s in part]) for part in (readings, filters)]
    print(f"us of CPU a sample, timed directly: reading {each[0]}, filter {each[1]}\n")
    head = "CPU s | start, CPU s | read and write, us a sample | wall s | times real time | filter_s, read_s | peak MB"
    print(f"| command | {head} |\n| --- |{' ---: |' * 7}")
    for name, runs in costs.items():
        left = [
            (cost.cpu_s - start - alone) * per for cost, start, alone in zip(runs, starts[name], filters, strict=True)
        ]
        timings = [f"{statistics.median(float(str(c.document[k])) for c in runs):.2f}" for k in ("filter_s", "read_s")]
        cells = [
            machine.told([cost.cpu_s for cost in runs]),
            machine.told(starts[name]),
            machine.told(left),
            machine.told([cost.wall_s for cost in runs]),
            machine.told([seconds / cost.wall_s for cost in runs], ".0f"),
            ", ".join(timings),
            machine.told([cost.peak_mb for cost in runs], ".0f"),
        ]
        print(f"| {name} | {' | '.join(cells)} |")
        if name in REQUIRED and statistics.median(left) > TARGET_US:
            print(f"  {name}: more than the {TARGET_US:g} us a sample it should take")
    print("\nfilter_s and read_s are the command's own, wall time; with -o, filter_s contains the writing.")


def start_up(short: Path, repeat: int) -> None:
    """Print the time to a result on a short log, with nothing compiled and with everything compiled."""
    cold, warm = [], []
    for _ in range(repeat):
        with tempfile.TemporaryDirectory(dir=short.parent) as cache:
            cold.append(run(short, [], Path(cache)))
            warm.append(run(short, [], Path(cache)))
    print(f"\nstart-up, the whole command on {SHORT_S} s of samples:")
    for name, runs in (("cold (nothing compiled)", cold), ("warm", warm)):
        wall, cpu = machine.told([c.wall_s for c in runs]), machine.told([c.cpu_s for c in runs])
        print(f"  {name:24} {wall} s wall, {cpu} s CPU, peak {machine.told([c.peak_mb for c in runs], '.0f')} MB")


def main() -> None:
    """Write the logs, run the commands, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=int, default=3600, help="length of the log (default 3600)")
    parser.add_argument("--rate", type=int, default=133, help="samples a second (default 133)")
    parser.add_argument("--repeat", type=int, default=3, help="rounds (default 3)")
    parser.add_argument("--parts", type=Path, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.parts:
        print(*parts_of(*options.parts))
        return
    print(machine.describe("numpy", "numba", "mcap", "rosbags"))
    with tempfile.TemporaryDirectory() as folder:
        log, short = Path(folder) / "hour.mcap", Path(folder) / "short.mcap"
        reading.write(log, options.seconds, options.rate)
        reading.write(short, SHORT_S, options.rate)
        print(f"\n{options.seconds} s at {options.rate} Hz, simulated, {log.stat().st_size / 1e6:.1f} MB; ", end="")
        print(f"median (min..max) of {options.repeat}")
        report(log, short, options.seconds, options.repeat)
        start_up(short, options.repeat)


if __name__ == "__main__":
    main()
