"""Spoilt inputs to everything that takes bytes from outside, for as long as is wanted: what ends without words is told.

    python benchmarks/fuzzing.py [--minutes 10] [--only info recover …] [--first SEED] [--keep FOLDER]

Targets, seeds and mutators are those of tests/fuzz; a minute is shared by all targets. Each target runs in a process of
its own whose memory is limited, so that an input that asks for too much fails as one that asks wrongly does. For each
failure its seed and its error are printed, and `--keep` writes the input, to be mended and put into tests/fuzz/cases.
Exit code 1 if there was one.
"""

import itertools
import multiprocessing
import re
import resource
import sys
import tempfile
import time
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path

import bench
from helpers import fuzzing

from filters.kalman import runner

MEMORY_MB = 2048  # address space that a target has beyond what it begins with


def main() -> int:
    asked = bench.options(__doc__, minutes=10.0, only=fuzzing.TARGETS, first=int(time.time()) * 1_000_000, keep=Path)
    runner.warm_up()
    print(f"seeds from {asked.first} on, {asked.minutes:g} min over {len(asked.only)} targets")
    failed = 0
    for name in asked.only:
        failed += _target(name, asked.first, asked.minutes * 60.0 / len(asked.only), asked.keep)
    return 1 if failed else 0


def _target(name: str, first: int, seconds: float, keep: Path | None) -> int:
    """Spoil one target's inputs; prints and returns how many failed, alike ones once."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=_work, args=(theirs, name, first, seconds))
    process.start()
    theirs.close()
    alike: Counter[str] = Counter()
    count: int | None = None
    while True:
        try:
            told = ours.recv()
        except EOFError:
            break
        if isinstance(told, int):
            count = told
            continue
        kind = re.sub(r"\d+", "N", told.error)[:80]
        alike[kind] += 1
        if alike[kind] == 1:
            print(f"  {name} seed {told.seed}: {told.error[:300]}", flush=True)
            if keep is not None:
                keep.mkdir(parents=True, exist_ok=True)
                (keep / f"{name}-{told.seed}.bin").write_bytes(told.data)
    process.join()
    ended = "" if process.exitcode == 0 else f", and the process ended with {process.exitcode}"
    inputs = "an unknown number of" if count is None else f"{count:,}"
    print(f"{name:<14} {inputs} inputs, {alike.total()} failed{ended}", flush=True)
    return alike.total() + (process.exitcode != 0)


def _work(tell: Connection, name: str, first: int, seconds: float) -> None:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_MB * 2**20,) * 2)
    seeds = itertools.count(first)
    with tempfile.TemporaryDirectory(prefix="imutui-fuzz-") as folder:
        for failure in fuzzing.campaign(name, seeds, Path(folder), time.monotonic() + seconds):
            tell.send(failure)
    tell.send(next(seeds) - first - 1)


if __name__ == "__main__":
    sys.exit(main())
