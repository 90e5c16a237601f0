"""Processor time of commands from start to end, beside what Python, numpy and numba take to be there; one run.

    python benchmarks/startup.py [--repeat 7] [--also PATH]...
    python benchmarks/startup.py --parts [--repeat 7]

Medians of user and system time, as multiples of `import numpy` and `import numba` in the same run; each round runs
every command once, so that a busy minute of the machine falls on all of them. Modules are compiled and kernels cached
before the first round. `--also PATH` runs the commands of another checkout's package in the same rounds, with its own
interpreter if it is PATH=PYTHON. `--only COMMAND` times another choice of commands, such as `demo --headless
--seconds 5`; what an acquisition that outlives its command takes is not counted. `--parts` says instead what a replay
of the sample, of a minute, spends its start on, in the order in which the parts come, and `import numba` beside it.

The folder is temporary, with sockets and configuration of its own: no acquisition runs in it.
"""

import argparse
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import machine
import numpy as np

ROOT = Path(__file__).parents[1]
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
    "hash, filter, result": "result = job.replay(path, job.ReplayOptions())",
    "the table: rich": "from imutui.cli.result_table import print_result; print_result(result)",
}
"""What a replay does, in order; what a part needs besides is loaded by then."""
BEFORE = {
    "numba's own types and functions": "from numba.core.registry import cpu_target as target",
    "kernels from the cache": "from filters.kalman import runner",
    "mcap, rosbags, reading": "from imutui.logbook import reader; from pathlib import Path; path = Path('sample.mcap')",
}
"""Names that a part uses, which are there by then."""


@dataclass(frozen=True)
class Checkout:
    """A package to time: its root, and the interpreter that runs it."""

    root: Path
    python: str

    @classmethod
    def parse(cls, text: str) -> "Checkout":
        """From PATH or PATH=PYTHON."""
        root, _, python = text.partition("=")
        return cls(Path(root).resolve(), python or sys.executable)


def seconds(arguments: list[str], folder: Path, root: Path) -> float:
    """Processor time of a process and of those it starts and waits for, user and system, s."""
    environment = os.environ | {
        "PYTHONPATH": str(root),
        "XDG_RUNTIME_DIR": str(folder / "run"),
        "XDG_CONFIG_HOME": str(folder / "config"),
    }
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        arguments, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, check=False, timeout=300
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def measure(checkouts: list[Checkout], repeat: int, commands: list[str]) -> dict[tuple[str, str], list[float]]:
    """Times of every yardstick and of every command of each checkout, s, by checkout and command."""
    with tempfile.TemporaryDirectory(prefix="imutui-startup-") as name:
        folder = Path(name)
        (folder / "run").mkdir(mode=0o700)
        shutil.copy(ROOT / "logs" / "sample.mcap", folder)
        still = np.zeros((6000, 3))
        np.savez(folder / "still.npz", t=np.arange(6000) * 0.01, gyro=still, accel=still - [0.0, 0.0, 1.0])
        runs = {("", what): ([sys.executable, "-c", code], ROOT) for what, code in YARDSTICKS.items()}
        for checkout in checkouts:
            for command in commands:
                arguments = [checkout.python, "-m", "imutui", *command.split()]
                runs[str(checkout.root), command] = arguments, checkout.root
        times: dict[tuple[str, str], list[float]] = {key: [] for key in runs}
        for number in range(repeat + 1):
            for key, (arguments, root) in runs.items():
                taken = seconds(arguments, folder, root)
                if number:
                    times[key].append(taken)
            print(f"round {number} of {repeat}", file=sys.stderr)
        return times


def measure_parts(repeat: int) -> None:
    """Print what each part of a replay takes, and `import numba` alone, in processes that take turns."""
    program = "import sys, time\n"
    for name, code in PARTS.items():
        program += f"{BEFORE.get(name, '')}\n{code}\nprint(time.process_time(), file=sys.stderr)\n"
    parts: list[np.ndarray] = []
    numba: list[np.ndarray] = []
    with tempfile.TemporaryDirectory(prefix="imutui-startup-") as folder:
        shutil.copy(ROOT / "logs" / "sample.mcap", folder)
        os.environ |= {"PYTHONPATH": str(ROOT), "XDG_CONFIG_HOME": folder}
        for _ in range(repeat + 1):
            for code, found in ((program, parts), ("import numba", numba)):
                before = resource.getrusage(resource.RUSAGE_CHILDREN)
                command = [sys.executable, "-c", code]
                said = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stderr
                after = resource.getrusage(resource.RUSAGE_CHILDREN)
                whole = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
                found.append(np.diff([*map(float, said.split()), whole], prepend=0.0))
    took, (yardstick,) = np.median(parts[1:], axis=0), np.median(numba[1:], axis=0)
    print(machine.describe("numpy", "numba", "typer"))
    print(f"{'':<44}{'processor ms':>13}{'× numba':>9}")
    names = [*PARTS, "the end", "all of it", "import numba, in a process of its own"]
    for name, each in zip(names, [*took, took.sum(), yardstick], strict=True):
        print(f"{name:<44}{1e3 * each:>13.0f}{each / yardstick:>9.2f}")


def main() -> None:
    """Measure and print a table for each checkout."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=7, help="rounds that count")
    parser.add_argument("--also", action="append", default=[], metavar="PATH[=PYTHON]", help="another checkout")
    parser.add_argument("--only", action="append", metavar="COMMAND", help="a command instead of all of them")
    parser.add_argument("--parts", action="store_true", help="the parts of a replay's start instead")
    options = parser.parse_args()
    if options.parts:
        measure_parts(options.repeat)
        return
    checkouts = [Checkout(ROOT, sys.executable), *map(Checkout.parse, options.also)]
    commands = options.only or list(COMMANDS)
    times = measure(checkouts, options.repeat, commands)
    middle = {key: statistics.median(values) for key, values in times.items()}
    print(machine.describe("numpy", "numba", "typer"))
    print(f"{'':<62}{'processor s':>12}{'× numpy':>9}{'× numba':>9}")
    for what in YARDSTICKS:
        print(_row(what, middle["", what], middle))
    for checkout in checkouts:
        print(checkout.root)
        for command in commands:
            print(_row(f"  imutui {command}", middle[str(checkout.root), command], middle))


def _row(name: str, taken: float, middle: dict[tuple[str, str], float]) -> str:
    numpy, numba = middle["", "import numpy"], middle["", "import numba"]
    return f"{name:<62}{taken:>12.3f}{taken / numpy:>9.2f}{taken / numba:>9.2f}"


if __name__ == "__main__":
    main()
