"""What an acquisition takes of a processor, and what a flush costs on this disk.

    python benchmarks/acquisition_cost.py [--seconds 60] [--flushes 120] [--folder FOLDER]

Processor share of the acquisition's process alone, from its own account, while it records a virtual unit at 133 Hz:
without a filter, with one at two rates, and with a viewer that asks ten times a second. A flush is `LogWriter.flush`
after a second of packets, samples and temperatures: a chunk is compressed and written, and fdatasync.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from machine import describe

from filters.kalman import runner
from imutui.logbook import SessionInfo, schemas
from imutui.logbook.schemas import RawPacket
from imutui.logbook.writer import LogWriter
from imutui.session import client as session
from imutui.session.plan import Plan

_WARM_UP_S = 8.0
_START_NS = 1_795_257_000_000_000_000
_RATE = 133
_CASES = (
    ("no filter", 133.0, "none", 0.0),
    ("spkf at 20 Hz", 20.0, "spkf", 0.0),
    ("spkf at 133 Hz", 133.0, "spkf", 0.0),
    ("spkf at 133 Hz, asked ten times a second", 133.0, "spkf", 10.0),
)


def share(seconds: float, rate: float, name: str, asks_hz: float, folder: Path) -> float:
    """Part of a processor that an acquisition takes once it runs."""
    plan = Plan("virtual", rate, logs=str(folder), record=True, filter=name, name=f"bench-cost-{os.getpid()}")
    client = session.start(plan)
    try:
        time.sleep(_WARM_UP_S)
        before, since, series = _taken_s(client.pid), time.monotonic(), 2**62
        while time.monotonic() - since < seconds:
            time.sleep(1.0 / asks_hz if asks_hz else seconds)
            if asks_hz:
                series = client.snapshot(series)["series"]["next"]
        return (_taken_s(client.pid) - before) / (time.monotonic() - since)
    finally:
        client.stop()


def _taken_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def flushes_ms(folder: Path, count: int) -> np.ndarray:
    """Time of each flush; between two of them other programs have the disk as long as in a recording."""
    log = LogWriter(folder / "flushes.mcap", SessionInfo(rate_hz=_RATE, kind="simulated"), "", _START_NS)
    rng, found = np.random.default_rng(1), []
    for second in range(count):
        for k in range(_RATE):
            stamp = _START_NS + (second * _RATE + k) * 1_000_000_000 // _RATE
            a, b, c, d, e, f = np.round(rng.normal(size=6) * 30.0).astype(int).tolist()
            log.raw(RawPacket(k, stamp, (a, b, c, d, e, f), 1587, k), stamp, stamp)
            log.imu(stamp, stamp, rng.normal(size=3), rng.normal(size=3))
            log.message(schemas.TEMPERATURE, schemas.temperature(stamp, 25.0), stamp, stamp)
        time.sleep(0.5)
        began = time.perf_counter()
        log.flush()
        found.append((time.perf_counter() - began) * 1e3)
    log.finish({}, _START_NS)
    return np.array(found)


def main() -> None:
    """Measure both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--flushes", type=int, default=120)
    parser.add_argument("--folder", type=Path, help="on the disk to measure; else a temporary one")
    options = parser.parse_args()
    print(describe("mcap", "numpy", "numba"), flush=True)
    runner.warm_up()  # else the first acquisition has a compiler in it
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        print("\n| acquisition at 133 Hz | % of a processor |\n|---|---|", flush=True)
        for what, rate, filter_name, asks_hz in _CASES:
            print(f"| {what} | {100.0 * share(options.seconds, rate, filter_name, asks_hz, folder):.1f} |", flush=True)
        print("flushing", file=sys.stderr)
        taken = flushes_ms(folder, options.flushes)
        median, p99, most = np.percentile(taken, [50.0, 99.0, 100.0])
        print(f"\nflush: {median:.1f} ms (median), {p99:.1f} (p99), {most:.1f} (max) of {taken.size}")


if __name__ == "__main__":
    main()
