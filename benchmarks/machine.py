"""What every benchmark prints of the machine it ran on, and how it tells a ratio on a noisy one."""

import os
import platform
import statistics
from importlib import metadata
from pathlib import Path

_FLAGS = ("sse4_2", "avx", "avx2", "fma", "avx512f", "avx512dq", "avx512vl")


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
