"""Memory and time of replay, export, check, info and recover on logs of an hour to a day; a week is computed.

    python benchmarks/long_logs.py [--hours 1 6 24] [--keep DIR]
    python benchmarks/long_logs.py --hours 1 --commands check info --against CHECKOUT [--rounds 5]

Simulated, at 133 Hz. Each command is a process of its own; memory is the most that it ever had resident, time that of
its processor. A command whose memory is flat has the same figure in every row; "a week" goes on with the last two rows'
slope. The second measures another version in turn with this one, and says the ratio of their least times.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from machine import describe

from filters.simulation import simulate
from imutui.logbook import SessionInfo, schemas
from imutui.logbook.schemas import RawPacket
from imutui.logbook.writer import LogWriter

HZ = 133.0
BASE_NS = 1_700_000_000_000_000_000
WEEK_H = 168.0
HERE = Path(__file__).resolve().parents[1]
COMMANDS = {
    "replay": ("replay", "{log}", "--json"),
    "replay, its noise": ("replay", "{log}", "--json", "--set", "filter.noise=log"),
    "export csv": ("export", "{log}", "-o", "{out}.csv", "--force"),
    "export npz": ("export", "{log}", "-o", "{out}.npz", "--force"),
    "export parquet": ("export", "{log}", "-o", "{out}.parquet", "--force"),
    "check": ("check", "{log}"),
    "info": ("info", "{log}"),
    "recover": ("recover", "{log}", "-o", "{out}.mcap", "--force"),
}


@dataclass(frozen=True, slots=True)
class Cost:
    """What a command took: processor time, s, and memory, MB."""

    cpu_s: float
    memory_mb: float


def make(path: Path, hours: float) -> None:
    """A level unit's log with samples, temperatures, packets and the reference, a chunk a second as it is recorded."""
    setattr(os, "fdatasync", lambda _: None)  # noqa: B010 - a chunk a second would only wait for the disk here
    minute, _ = simulate(rate_hz=HZ, seconds=60.0, seed=1)
    log = LogWriter(path, SessionInfo(rate_hz=HZ, kind="simulated"), "", BASE_NS, overwrite=True, checksum=False)
    count = round(hours * 3600.0 * HZ)
    counts = (0, 0, 0, 0, 0, 5460)
    for k in range(count):
        stamp = BASE_NS + round(k / HZ * 1e9)
        row = k % minute.t.size
        log.raw(RawPacket(k, k * 7_518_797, counts, 1600, (65535 - 9517 * k) % 65536), stamp, stamp)
        log.imu(stamp, stamp, minute.gyro[row], minute.accel[row])
        if k % 133 == 0:
            log.encoded(schemas.TEMPERATURE, schemas.encode_temperature(stamp, 25.0), stamp, stamp)
            table = schemas.encode_table_reference(stamp, "level", [0.0] * 3, [0.0] * 3)
            log.encoded(schemas.REFERENCE, table, stamp, stamp)
            log.flush()
    log.finish({}, BASE_NS)


def measured(command: tuple[str, ...], log: Path, folder: Path, checkout: Path = HERE) -> Cost:
    """Run a command of a version on a log."""
    words = [word.format(log=log, out=folder / "out") for word in command]
    with (folder / "said").open("wb") as said:
        # what is run with -m is found in the folder where that is done
        process = subprocess.Popen(
            [sys.executable, "-m", "imutui", *words], stdout=said, stderr=subprocess.DEVNULL, cwd=checkout
        )
        _, _, used = os.wait4(process.pid, 0)
    return Cost(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0)


def compare(name: str, log: Path, folder: Path, other: Path, rounds: int) -> None:
    """Print what a command takes here and in another version, each the least of some rounds in turn."""
    costs = [[measured(COMMANDS[name], log, folder, checkout) for checkout in (other, HERE)] for _ in range(rounds)]
    before, now = (min(costs, key=lambda cost: cost.cpu_s) for costs in zip(*costs, strict=True))
    print(
        f"{log.name}: {name:<17} {before.cpu_s:.2f} s, {before.memory_mb:.0f} MB before;"
        f" {now.cpu_s:.2f} s, {now.memory_mb:.0f} MB now; time now over before {now.cpu_s / before.cpu_s:.2f}",
        flush=True,
    )


def _week(hours: list[float], values: list[float]) -> float:
    """The straight line through the last two rows, at a week."""
    slope = (values[-1] - values[-2]) / (hours[-1] - hours[-2])
    return values[-1] + slope * (WEEK_H - hours[-1])


def main() -> None:
    """Make the logs, run the commands, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", nargs="+", type=float, default=[1.0, 6.0, 24.0])
    parser.add_argument("--commands", nargs="+", choices=list(COMMANDS), default=list(COMMANDS))
    parser.add_argument("--keep", type=Path, help="folder for the logs, which are taken again from there")
    parser.add_argument("--against", type=Path, help="checkout of another version to be measured in turn")
    parser.add_argument("--rounds", type=int, default=5, help="of these (%(default)s)")
    options = parser.parse_args()
    print(describe("numpy", "numba"), flush=True)
    costs: dict[str, list[Cost]] = {name: [] for name in options.commands}
    with tempfile.TemporaryDirectory() as temporary:
        folder = (options.keep or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        for hours in options.hours:
            log = folder / f"{hours:g}h.mcap"
            if not log.exists():
                began = time.monotonic()
                make(log, hours)
                size = log.stat().st_size / 1e6
                print(f"{log.name}: {size:.0f} MB, made in {time.monotonic() - began:.0f} s", flush=True)
            for name in options.commands:
                if options.against is not None:
                    compare(name, log, folder, options.against.resolve(), options.rounds)
                    continue
                cost = measured(COMMANDS[name], log, folder)
                costs[name].append(cost)
                print(f"{hours:5g} h  {name:<17} {cost.memory_mb:7.0f} MB  {cost.cpu_s:7.1f} s", flush=True)
    for name, found in costs.items():
        if len(found) > 1:
            memory = _week(options.hours, [cost.memory_mb for cost in found])
            cpu = _week(options.hours, [cost.cpu_s for cost in found])
            print(f"a week, computed: {name:<17} {memory:7.0f} MB  {cpu:7.0f} s")


if __name__ == "__main__":
    main()
