"""Processor time and memory of commands: on the sample, and on logs of an hour to a day; a week is computed.

    python benchmarks/commands.py sample [--repeat 7] [--also CHECKOUT] [--only COMMAND ...]
    python benchmarks/commands.py parts [--repeat 7]
    python benchmarks/commands.py long [--hours 1 6 24] [--only NAME ...] [--keep DIR] [--also CHECKOUT] [--repeat 5]

Each command is a process of its own; time is that of its processor, memory the most that it ever had resident. Each
round runs every command once, so that a busy minute of the machine falls on all of them. `--also` runs the commands of
another checkout's package in the same rounds, with its own interpreter if it is CHECKOUT=PYTHON.

sample: medians, as multiples of `import numpy` and `import numba` in the same run. Modules are compiled and kernels
cached before the first round. `--only` times another choice of commands, such as `demo --headless --seconds 5`; what an
acquisition that outlives its command takes is not counted.

parts: what a replay of the sample, of a minute, spends its start on, in the order in which the parts come, and `import
numba` beside it.

long: simulated logs, at 133 Hz. A command whose memory is flat has the same figure at each length; "a week" goes on
with the last two lengths' slope. With `--also` the least of all rounds, and the ratio of these times.

The folder is temporary, with sockets and configuration of its own: no acquisition runs in it.
"""

import os
import shutil
import statistics
import sys
import time
from pathlib import Path

import bench
import numpy as np
from helpers import ros_messages

HZ, WEEK_H, BASE_NS = 133.0, 168.0, 1_700_000_000_000_000_000
YARDSTICKS = {"python -c pass": "pass", "import numpy": "import numpy", "import numba": "import numba"}
COMMANDS = (
    "--help",
    "status",
    "mark x",
    "stop",
    "devices",
    "config --show",
    "info sample.mcap",
    "check sample.mcap",
    "recover sample.mcap -o made.mcap --force",
    "replay sample.mcap",
    "import still.npz -o imported.mcap --force --accel-sign +1",
    "profile",
)
LONG = {
    "replay": "replay {log} --json",
    "replay, its noise": "replay {log} --json --set filter.noise=log",
    "export csv": "export {log} -o out.csv --force",
    "export npz": "export {log} -o out.npz --force",
    "export parquet": "export {log} -o out.parquet --force",
    "check": "check {log}",
    "info": "info {log}",
    "recover": "recover {log} -o out.mcap --force",
}
# what a replay does, in order; what a part needs besides is loaded by then
PARTS = {
    "Python": "import atexit, gc; gc.set_threshold(30_000, 5, 5); atexit.register(gc.freeze)",
    "the command line: typer, pydantic": "import imutui.cli.replay, imutui.config",
    "import numba": "import numba",
    "scipy.linalg, which numba asks for BLAS": "import scipy.linalg.cython_blas",
    "numba's own types and functions": "target.target_context.refresh(); target.typing_context.refresh()",
    "the job's modules": "import imutui.jobs.replay as job",
    "kernels from the cache": "runner.warm_up(None)",
    "mcap, rosbags, reading": "log = reader.read(path)",
    "scipy.special, for the band of the NIS": "import scipy.special",
    "hash, filter, result": "result = job.replay(path, Reading())",
    "the table": "from imutui.report import replay_text; replay_text.text(result, 80)",
}
# names that a part uses, which are there by then
BEFORE = {
    "numba's own types and functions": "from numba.core.registry import cpu_target as target",
    "kernels from the cache": "from filters.kalman import runner",
    "mcap, rosbags, reading": "from imutui.logbook import reader; from pathlib import Path; path = Path('sample.mcap')",
}


Run = tuple[list[str], Path]  # a command, and the root of the checkout that it is of


def checkouts(also: str | None) -> dict[str, tuple[Path, str]]:
    """Root and interpreter of this checkout, and of the other one, PATH or PATH=PYTHON."""
    root, _, python = (also or "").partition("=")
    there = {f"there, {root}": (Path(root).resolve(), python or sys.executable)} if also else {}
    return {"here": (bench.ROOT, sys.executable)} | there


def rounds(runs: dict[tuple[str, str], Run], repeat: int, folder: Path) -> dict[tuple[str, str], list[bench.Cost]]:
    """What each command took in each round."""
    (folder / "run").mkdir(mode=0o700, exist_ok=True)
    places = {"XDG_RUNTIME_DIR": str(folder / "run"), "XDG_CONFIG_HOME": str(folder / "config")}
    costs: dict[tuple[str, str], list[bench.Cost]] = {key: [] for key in runs}
    for number in range(repeat):
        for key, (command, root) in runs.items():
            costs[key].append(bench.cost(command, folder, None, PYTHONPATH=str(root), **places))
        print(f"round {number + 1} of {repeat}", file=sys.stderr)
    return costs


def sample(folder: Path, repeat: int, also: str | None, commands: list[str]) -> None:
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    shutil.copy(bench.ROOT / "logs" / "sample.mcap", folder)
    still = np.zeros((6000, 3))
    np.savez(folder / "still.npz", t=np.arange(6000) * 0.01, gyro=still, accel=still - [0.0, 0.0, 1.0])
    runs: dict[tuple[str, str], Run] = {
        ("beside", what): ([sys.executable, "-c", code], bench.ROOT) for what, code in YARDSTICKS.items()
    }
    for which, (root, python) in checkouts(also).items():
        for command in commands:
            runs[which, f"imutui {command}"] = [python, "-m", "imutui", *command.split()], root
    costs = rounds(runs, repeat + 1, folder)
    taken = {key: statistics.median(cost.cpu_s for cost in each[1:]) for key, each in costs.items()}
    numpy, numba = taken["beside", "import numpy"], taken["beside", "import numba"]
    print(f"{'':<62}{'processor s':>12}{'× numpy':>9}{'× numba':>9}")
    for (which, name), seconds in taken.items():
        if name in ("python -c pass", f"imutui {commands[0]}"):
            print(which)
        print(f"  {name:<60}{seconds:>12.3f}{seconds / numpy:>9.2f}{seconds / numba:>9.2f}")


def parts(folder: Path, repeat: int) -> None:
    """Print what each part of a replay takes, and `import numba` alone, in processes that take turns."""
    shutil.copy(bench.ROOT / "logs" / "sample.mcap", folder)
    program = "import time\n"
    for name, code in PARTS.items():
        program += f"{BEFORE.get(name, '')}\n{code}\nprint('took', time.process_time())\n"
    codes = {("", "all"): program, ("", "numba"): "import numba"}
    costs = rounds({key: ([sys.executable, "-c", code], bench.ROOT) for key, code in codes.items()}, repeat + 1, folder)
    times = []
    for cost in costs["", "all"][1:]:
        told = [float(line.split()[1]) for line in cost.printed.splitlines() if line.startswith("took ")]
        times.append(np.diff([*told, cost.cpu_s], prepend=0.0))
    took, yardstick = np.median(times, axis=0), statistics.median(cost.cpu_s for cost in costs["", "numba"][1:])
    print(f"{'':<44}{'processor ms':>13}{'× numba':>9}")
    names = [*PARTS, "the end", "all of it", "import numba, in a process of its own"]
    for name, each in zip(names, [*took, took.sum(), yardstick], strict=True):
        print(f"{name:<44}{1e3 * each:>13.0f}{each / yardstick:>9.2f}")


def make(path: Path, hours: float) -> None:
    """A level unit's log with samples, temperatures, packets and the reference, a chunk a second as it is recorded."""
    from filters.simulation import simulate
    from imutui.logbook import SessionInfo, schemas
    from imutui.logbook.writer import LogWriter

    setattr(os, "fdatasync", lambda _: None)  # noqa: B010 - a chunk a second would only wait for the disk here
    minute, _ = simulate(rate_hz=HZ, seconds=60.0, seed=1)
    log = LogWriter(path, SessionInfo(rate_hz=HZ, kind="simulated"), "", BASE_NS, overwrite=True, checksum=False)
    count = round(hours * 3600.0 * HZ)
    counts = (0, 0, 0, 0, 0, 5460)
    for k in range(count):
        stamp = BASE_NS + round(k / HZ * 1e9)
        row = k % minute.t.size
        log.encoded(
            schemas.RAW, ros_messages.packet(k, k * 7_518_797, counts, 1600, (65535 - 9517 * k) % 65536), stamp, stamp
        )
        log.imu(stamp, stamp, minute.gyro[row], minute.accel[row])
        if k % 133 == 0:
            log.encoded(schemas.TEMPERATURE, schemas.encode_temperatures(stamp, 25.0)[0], stamp, stamp)
            table = schemas.encode_table_references(stamp, "level", [0.0] * 3, [0.0] * 3)[0]
            log.encoded(schemas.REFERENCE, table, stamp, stamp)
            log.flush()
    log.finish({}, BASE_NS)


def long(folder: Path, hours: list[float], names: list[str], repeat: int, also: str | None) -> None:
    """Make the logs, run the commands, print; what a week takes follows from the straight line of the last two."""
    found: dict[str, list[bench.Cost]] = {name: [] for name in names}
    for length in hours:
        log = folder / f"{length:g}h.mcap"
        if not log.exists():
            began = time.monotonic()
            make(log, length)
            size = log.stat().st_size / 1e6
            print(f"{log.name}: {size:.0f} MB, made in {time.monotonic() - began:.0f} s", flush=True)
        for name in names:
            words = LONG[name].format(log=log).split()
            runs = {
                (which, name): ([python, "-m", "imutui", *words], root)
                for which, (root, python) in checkouts(also).items()
            }
            costs = rounds(runs, repeat if also else 1, folder)
            now, *before = (min(each, key=lambda cost: cost.cpu_s) for each in costs.values())
            line = f"{length:5g} h  {name:<17} {now.peak_mb:7.0f} MB  {now.cpu_s:7.2f} s"
            for cost in before:
                line += f"; there {cost.peak_mb:.0f} MB, {cost.cpu_s:.2f} s; ratio {now.cpu_s / cost.cpu_s:.2f}"
            print(line, flush=True)
            found[name].append(now)
    if len(hours) > 1 and not also:
        ahead = (WEEK_H - hours[-1]) / (hours[-1] - hours[-2])
        for name, each in found.items():
            (b_mb, b_s), (a_mb, a_s) = ((cost.peak_mb, cost.cpu_s) for cost in each[-2:])
            week_mb, week_s = a_mb + ahead * (a_mb - b_mb), a_s + ahead * (a_s - b_s)
            print(f"a week, computed: {name:<17} {week_mb:7.0f} MB  {week_s:7.0f} s")


def main() -> None:
    defaults = {"repeat": 7, "also": str, "only": list[str], "hours": [1.0, 6.0, 24.0], "keep": Path}
    asked = bench.options(__doc__, "sample", "parts", "long", **defaults)
    print(bench.describe("numpy", "numba", "typer"), flush=True)
    with bench.folder_for(asked.keep) as folder:
        match asked.part:
            case "sample":
                sample(folder, asked.repeat, asked.also, asked.only or list(COMMANDS))
            case "parts":
                parts(folder, asked.repeat)
            case "long":
                long(folder, asked.hours, asked.only or list(LONG), asked.repeat, asked.also)


if __name__ == "__main__":
    main()
