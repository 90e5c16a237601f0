"""What the benchmarks share: command line, the machine they ran on, processes that are measured, a log, and tables.

It also lets them import what is shared with the tests.
"""

import argparse
import multiprocessing
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from types import GenericAlias
from typing import Any, TypeVar, get_args

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"  # measured recordings, which not every machine has
IMUTUI = (sys.executable, "-m", "imutui")
_FLAGS = ("sse4_2", "avx", "avx2", "fma", "avx512f", "avx512dq", "avx512vl")
_Found = TypeVar("_Found")

sys.path.insert(0, str(ROOT / "tests" / "support"))


def options(doc: str | None, *parts: str, **defaults: Any) -> argparse.Namespace:
    """The command line of a script whose docstring is its help: options by name, and what holds without them.

    A type instead of a value: none by default, of `list[…]` several. False: a switch. A mapping: several of its names,
    all by default. Of `parts` one is chosen, as `part`.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    if parts:
        parser.add_argument("part", choices=parts)
    for name, default in defaults.items():
        flag = f"--{name.replace('_', '-')}"
        if default is False:
            parser.add_argument(flag, action="store_true")
        elif isinstance(default, Mapping):
            parser.add_argument(flag, nargs="+", choices=list(default), default=list(default))
        elif isinstance(default, list | GenericAlias):
            of = get_args(default)[0] if isinstance(default, GenericAlias) else type(default[0])
            parser.add_argument(flag, nargs="+", type=of, default=default if isinstance(default, list) else None)
        elif isinstance(default, type):
            parser.add_argument(flag, type=default)
        else:
            parser.add_argument(flag, type=type(default), default=default)
    return parser.parse_args()


def describe(*packages: str) -> str:
    """Processor, its vector instructions, threads of the linear algebra, and versions; three lines."""
    fields: dict[str, str] = {}
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        name, _, value = line.partition(":")
        fields.setdefault(name.strip(), value.strip())
    has = set(fields.get("flags", "").split())
    flags = " ".join(("" if flag in has else "no-") + flag for flag in _FLAGS)
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in packages)
    threads = os.environ.get("OPENBLAS_NUM_THREADS", "unset")
    return (
        f"{fields.get('model name', 'unknown processor')}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}\n"
        f"{flags}; OPENBLAS_NUM_THREADS={threads}\n"
        f"Python {platform.python_version()}, {versions}"
    )


def told(values: list[float], form: str = "") -> str:
    """Median and, in brackets, least and greatest; three digits of each unless `form` says otherwise."""

    def text(value: float) -> str:
        return f"{value:{form or ('.0f' if abs(value) >= 100.0 else '.3g')}}"

    return f"{text(statistics.median(values))} ({text(min(values))}..{text(max(values))})"


def wilson(count: int, of: int) -> tuple[float, float]:
    """95 % interval of a share."""
    from scipy import stats

    if of == 0:
        return 0.0, 1.0
    interval = stats.binomtest(count, of).proportion_ci(0.95, "wilson")
    return float(interval.low), float(interval.high)


def row(*cells: object) -> None:
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


def head(*names: str) -> None:
    print(f"\n| {' | '.join(names)} |\n|{'---|' * len(names)}", flush=True)


@contextmanager
def folder_for(keep: Path | None = None) -> Iterator[Path]:
    """The folder that is to keep what is made, or a temporary one."""
    with tempfile.TemporaryDirectory(prefix="imutui-bench-") as name:
        folder = (keep or Path(name)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        yield folder


# ---------------------------------------------------------------------------------------------------------- processes


@dataclass(frozen=True, slots=True)
class Cost:
    """What a process took, with those that it waited for: processor and wall time, memory at most; what it printed."""

    cpu_s: float
    wall_s: float
    peak_mb: float
    printed: str


def cost(command: list[str], folder: Path, allowed: tuple[int, ...] | None = (0, 1), **environ: str) -> Cost:
    """Run a command in a folder, and wait for it.

    `allowed`: exit codes that are none of a failure, of which 1 is a finding; None: all.
    `**environ`: variables beside this process's.
    """
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        began = time.perf_counter()
        streams: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": out, "stderr": err}
        process = subprocess.Popen(command, cwd=folder, env={**os.environ, **environ}, **streams)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall_s = time.perf_counter() - began
        out.seek(0)
        err.seek(0)
        if allowed is not None and process.returncode not in allowed:
            sys.exit(f"{' '.join(command)} failed with {process.returncode}: {err.read().decode()}")
        return Cost(used.ru_utime + used.ru_stime, wall_s, used.ru_maxrss / 1024.0, out.read().decode())


def apart(function: Callable[..., _Found], *arguments: object) -> _Found:
    """What a function returns in a process of its own, which has read this script and nothing else before."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()
