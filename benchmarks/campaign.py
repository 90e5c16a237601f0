"""What a campaign of many logs costs beside the filter itself, each way that there is, and what a large one would take.

    python benchmarks/campaign.py [--logs 120] [--rounds 3] [--long 600]

Logs of a minute at 133 Hz, as the recorder writes them, are run as a user would run them, by processes on this machine,
by dask's own scheduler and workers over TCP on loopback, and as shards, each with one and with two workers:

    imutui campaign LOGS -o RESULTS --workers N
    imutui campaign LOGS -o RESULTS --cluster tcp://127.0.0.1:PORT
    imutui campaign LOGS -o PART --shard I/N --workers 1

Printed are logs a minute once workers are warm, the CPU time of all processes for a log (that of a campaign of these
logs less that of one of two logs, which is the start) as a multiple of the bare filter's, which is timed in a process
of its own before and after each round on the same samples; what of that is spent where rows are handed out; and the
memory of workers over a longer run. From these figures and nothing else the last part computes a campaign of a million
logs of an hour. Wall times want a quiet machine; ratios of CPU time do with less. Values are simulated.
"""

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"

import bench
import numpy as np
import reading
from helpers.processes import children, processor_s

from imutui.logbook.reading import Reading

SECONDS, RATE = 60, 133
DISTINCT = 6
FEW = 2
MILLION, HOUR_S, CORES = 1_000_000, 3600, (64, 512, 4096)
LEAST = 2.0  # times its filter time is what a row of a log of a minute may cost
PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, slots=True)
class Cost:
    """Of one campaign: logs a minute, wall seconds, CPU seconds of all and of what hands out, bytes a row."""

    per_minute: float
    wall_s: float
    cpu_s: float
    driver_s: float
    row_bytes: float


def bare(log: Path) -> tuple[float, float]:
    """CPU seconds of the filter over a log, and of a whole replay, in this process, once warm; the least of some."""
    from filters.kalman.runner import Estimator
    from imutui.jobs import replay, replay_input
    from imutui.jobs.campaign import one_log
    from imutui.logbook import reader

    one_log.prepare()
    feed = replay_input.at_once(reader.read(log))
    _, settings = replay.prepare(feed, Reading())
    filters, replays = [], []
    for _ in range(8):
        estimator = Estimator(settings, np.inf)
        started = time.process_time()
        for _rows in replay.run(estimator, feed, None, lambda share: None):
            pass
        filters.append(time.process_time() - started)
        started = time.process_time()
        replay.replay(log, Reading())
        replays.append(time.process_time() - started)
    return statistics.median(filters), statistics.median(replays)


def cpu_of(pids: list[int]) -> float:
    """CPU seconds that running processes have used, with those of their children that have ended."""
    return sum(processor_s(pid, ended_children=True) for pid in pids)


def campaign(logs: Path, results: Path, options: list[str], others: list[int]) -> Cost:
    """Run one campaign as a process; `others` are processes that work for it and go on."""
    before = cpu_of(others)
    took = bench.cost([*bench.IMUTUI, "campaign", str(logs), "-o", str(results), "--json", *options], logs.parent)
    told = json.loads(took.printed)
    size = (results / "results.json").stat().st_size / max(1, told["logs"])
    return Cost(told["per_minute"] or 0.0, took.wall_s, took.cpu_s + cpu_of(others) - before, took.cpu_s, size)


@contextmanager
def cluster(workers: int, folder: Path) -> Iterator[tuple[str, list[int]]]:
    """Dask's scheduler and workers on loopback: its address, and their processes, the scheduler's first."""
    place = folder / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "dask"]
    line = [*dask, "scheduler", "--no-dashboard", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(place)]
    with ExitStack() as stack:
        started = [subprocess.Popen(line, **quiet)]  # type: ignore[call-overload]
        stack.callback(started[0].wait)
        stack.callback(started[0].kill)
        while not place.exists() or not place.read_text().endswith("}"):
            time.sleep(0.05)
        address = json.loads(place.read_text())["address"]
        line = [*dask, "worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        for k in range(workers):
            worker = subprocess.Popen([*line, "--local-directory", str(folder / f"w{k}")], **quiet)  # type: ignore[call-overload]
            started.append(worker)
            stack.callback(worker.wait)
            stack.callback(worker.kill)
        yield address, [process.pid for process in started]


def by_way(way: str, workers: int, logs: Path, folder: Path) -> tuple[Cost, float]:
    """Cost of a campaign by a way, and the scheduler's own CPU seconds."""
    results = folder / "results"
    if way == "local":
        return campaign(logs, results, ["--workers", str(workers)], []), 0.0
    if way == "dask":
        with cluster(workers, folder) as (address, pids):
            # warm: what is measured is a cluster that stands
            campaign(logs.with_name("few"), folder / "first", ["--cluster", address], pids)
            before = cpu_of(pids[:1])
            cost = campaign(logs, results, ["--cluster", address], pids)
            return cost, cpu_of(pids[:1]) - before

    def shard(k: int) -> Cost:
        return campaign(logs, folder / f"part{k}", ["--shard", f"{k + 1}/{workers}", "--workers", "1"], [])

    with ThreadPoolExecutor(workers) as pool:
        done = list(pool.map(shard, range(workers)))
    return Cost(
        sum(cost.per_minute for cost in done),
        max(cost.wall_s for cost in done),
        sum(cost.cpu_s for cost in done),
        0.0,
        done[0].row_bytes,
    ), 0.0


def memory(logs: Path, folder: Path) -> list[tuple[float, float]]:
    """Share of a campaign done, and MB that its largest worker holds then, looked at all the time."""
    results = folder / "results"
    words = [sys.executable, "-m", "imutui", "campaign", str(logs), "-o", str(results), "--workers", "2"]
    child = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    count = sum(1 for _ in logs.iterdir())
    seen: list[tuple[float, float]] = []
    while child.poll() is None:
        journal = results / "rows.jsonl"
        done = journal.read_bytes().count(b'{"log":') if journal.exists() else 0
        held = [rss for pid in children(child.pid) if (rss := resident(pid))]
        if done and held:
            seen.append((done / count, max(held)))
        time.sleep(0.1)
    return seen


def resident(pid: int) -> float:
    """MB that a process holds; 0 if it has gone."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE / 1e6
    except OSError:
        return 0.0


def make(folder: Path, count: int) -> None:
    """So many logs of which some are distinct, the others further names of these."""
    folder.mkdir()
    first = folder.with_name("distinct")
    if not first.exists():
        first.mkdir()
        for k in range(DISTINCT):
            reading.write(first / f"{k}.mcap", SECONDS, RATE)
    for k in range(count):
        os.link(first / f"{k % DISTINCT}.mcap", folder / f"{k:05}.mcap")


def measure(count: int, rounds: int, long: int, place: Path) -> None:
    logs, few = place / "logs", place / "few"
    make(logs, count)
    make(few, FEW)
    log = logs / "00000.mcap"
    filters, replays = map(list, zip(*[bench.apart(bare, log)], strict=True))
    rows: dict[tuple[str, int], list[tuple[float, float, float]]] = {}
    scheduler_s: list[float] = []
    client_s: list[float] = []
    row_bytes = 0.0
    number = 0
    for _ in range(rounds):
        for way in ("local", "dask", "shard"):
            for workers in (1, 2):
                number += 1
                folder = place / f"run{number}"
                start = place / f"start{number}"
                folder.mkdir()
                start.mkdir()
                short, short_scheduler = by_way(way, workers, few, start)
                cost, scheduler = by_way(way, workers, logs, folder)
                made = count - FEW
                # the same number of processes has started in both
                per_log = (cost.cpu_s - short.cpu_s) / made
                rows.setdefault((way, workers), []).append((cost.per_minute, per_log, cost.wall_s))
                row_bytes = cost.row_bytes
                if way == "dask":
                    scheduler_s.append((scheduler - short_scheduler) / made)
                    client_s.append((cost.driver_s - short.driver_s) / made)
        again = bench.apart(bare, log)
        filters.append(again[0])
        replays.append(again[1])
    filter_s = statistics.median(filters)
    print(f"filter alone {bench.told([1e3 * s for s in filters])} ms of CPU a log, a replay", end=" ")
    print(f"{bench.told([s / filter_s for s in replays])} times that\n")
    print("way, workers | logs a minute | with 2 / with 1 | CPU of a log / filter alone | wall s with the start")
    worst = 0.0
    for (way, workers), found in rows.items():
        rates, costs, walls = zip(*found, strict=True)
        alone = statistics.median(rate for rate, _, _ in rows[way, 1])
        ratio = [cost / filter_s for cost in costs]
        worst = max(worst, statistics.median(ratio))
        print(f"{way}, {workers} | {bench.told(list(rates), '.0f')} | {statistics.median(rates) / alone:.2f}", end="")
        print(f" | {bench.told(ratio, '.2f')} | {bench.told(list(walls), '.1f')}")
    print(f"\na row costs at most {worst:.2f} times its filter (asked: {LEAST:g})")
    print(
        f"CPU of dask's scheduler a task {bench.told([1e3 * s for s in scheduler_s])} ms, of the client that", end=" "
    )
    print(f"writes rows {bench.told([1e3 * s for s in client_s])} ms")
    report_memory(long, place)
    cost_s = statistics.median(cost for _, cost, _ in rows["local", 1])
    hand_s = max(statistics.median(scheduler_s), statistics.median(client_s))
    estimate(filter_s, cost_s, hand_s, log.stat().st_size, row_bytes)


def report_memory(long: int, place: Path) -> None:
    """Memory of workers over a longer campaign, by quarters of it."""
    logs = place / "long"
    make(logs, long)
    folder = place / "memory"
    folder.mkdir()
    seen = memory(logs, folder)
    quarters = [[mb for share, mb in seen if k / 4 < share <= (k + 1) / 4] for k in range(4)]
    told = ", ".join(f"{statistics.median(quarter):.0f}" for quarter in quarters if quarter)
    print(
        f"\nMB of the larger of two workers in the quarters of {long} logs: {told}; most {max(m for _, m in seen):.0f}"
    )


def estimate(filter_s: float, cost_s: float, hand_s: float, log_bytes: int, row_bytes: float) -> None:
    """A million logs of an hour from the figures above: filter and reading grow with the length, the rest stays."""
    hours = HOUR_S / SECONDS
    hour_s = cost_s * hours  # no less than it is: a part of a log's cost does not grow with it
    size = log_bytes * hours
    print(f"\ncomputed, not measured: {MILLION:,} logs of an hour at {RATE} Hz, {size / 1e6:.0f} MB each")
    print(
        f"CPU {hour_s:.2f} s a log (filter {filter_s * hours:.2f}), {MILLION * hour_s / 3600:,.0f} core hours;", end=" "
    )
    print(f"logs {MILLION * size / 1e12:.0f} TB, results {MILLION * row_bytes / 1e9:.1f} GB")
    print("cores | hours | GB/s to be read | share of a scheduler's and a client's time")
    for cores in CORES:
        rate = cores / hour_s
        print(f"{cores} | {MILLION / rate / 3600:.1f} | {rate * size / 1e9:.1f} | {rate * hand_s:.0%}")
    at_most = hour_s / hand_s
    print(
        f"one gigabyte a second of storage keeps {1e9 * hour_s / size:.0f} cores busy: that limits first;",
        end=" ",
    )
    print(f"one scheduler or client {at_most:,.0f} cores (shards have neither)")


def main() -> None:
    asked = bench.options(__doc__, logs=120, rounds=3, long=600)
    print(bench.describe("numpy", "numba", "distributed"))
    print(f"\n{asked.logs} logs of {SECONDS} s at {RATE} Hz, simulated; median (min..max) of {asked.rounds} rounds")
    with bench.folder_for() as folder:
        measure(asked.logs, asked.rounds, asked.long, folder)


if __name__ == "__main__":
    main()
