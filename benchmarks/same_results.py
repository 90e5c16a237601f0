"""Are results the same at two commits? Writes what `replay` and `trace` say of logs, and compares two such files.

    python benchmarks/same_results.py write before.json        # at one commit, with its imutui installed
    python benchmarks/same_results.py write after.json         # at the other
    python benchmarks/same_results.py compare before.json after.json

The logs: `logs/sample.mcap`, and the measured recordings of `../shared/data` where that folder is present, each
imported by the flags of the JSON beside it. Timings are left out. `compare` says "equal byte for byte", or lists every
text, decision and figure that differs, figures beyond `--relative` only (default 1e-9); exit code 1 if anything is
listed.
"""

import argparse
import json
import math
import shutil
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "logs" / "sample.mcap"
DATA = ROOT.parent / "shared" / "data"
TIMINGS = ("filter_s", "read_s", "steps_per_s", "times_real_time", "library", "log", "log_sha256", "id", "report")
REPLAYS = (
    ("--filter", "spkf"),
    ("--filter", "spkf-paper"),
    ("--filter", "ekf"),
    ("--set", "filter.noise=log"),
    ("--set", "filter.measurements=drawn"),
    ("--reference", "gravity"),
)


def result(folder: Path, *arguments: str) -> Any:
    """What a command prints as JSON, run in a folder, without timings; its words on stderr where it prints none."""
    command = [sys.executable, "-m", "imutui", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL, cwd=folder)
    document = json.loads(done.stdout) if done.stdout.strip() else {"stderr": done.stderr.splitlines()[-1:]}
    return {"exit": done.returncode, "document": without_timings(document)}


def without_timings(value: Any) -> Any:
    """A document without what differs from run to run."""
    if isinstance(value, dict):
        return {key: without_timings(inner) for key, inner in value.items() if key not in TIMINGS}
    return [without_timings(inner) for inner in value] if isinstance(value, list) else value


def results(folder: Path) -> Iterator[tuple[str, Any]]:
    """Name and result of every command, run in a folder."""
    shutil.copy(SAMPLE, folder / "sample.mcap")
    for flags in REPLAYS:
        yield f"replay sample {' '.join(flags)}", result(folder, "replay", "sample.mcap", *flags, "--json")
    yield "trace sample", result(folder, "trace", "sample.mcap", "--json")
    for source in sorted(DATA.glob("*.npz")):
        flags = json.loads(source.with_suffix(".json").read_text())["import"]
        log = f"{source.stem}.mcap"
        imported = result(folder, "import", str(source), "-o", log, *flags)
        yield f"import {source.stem}", imported
        if imported["exit"] == 0:
            yield f"replay {source.stem}", result(folder, "replay", log, "--json")
            yield f"trace {source.stem}", result(folder, "trace", log, "--json")
    source = DATA / "thermal_chamber_part1.npz"
    if source.exists():
        yield from results_of_halves(folder, source)


def results_of_halves(folder: Path, source: Path) -> Iterator[tuple[str, Any]]:
    """A trace with a held-out run: a recording's first half against its second."""
    flags = json.loads(source.with_suffix(".json").read_text())["import"]
    with np.load(source) as arrays:
        middle = float(np.median(arrays["t"]))
    for name, cut in (("first", ("--end", f"{middle}")), ("second", ("--start", f"{middle}"))):
        yield f"import {name} half", result(folder, "import", str(source), "-o", f"{name}.mcap", *cut, *flags)
    yield "trace halves", result(folder, "trace", "first.mcap", "second.mcap", "--json")


def differences(a: Any, b: Any, relative: float, place: str = "") -> Iterator[str]:
    """A line for everything in which two documents differ."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in sorted(a.keys() | b.keys()):
            yield from differences(a.get(key, "(absent)"), b.get(key, "(absent)"), relative, f"{place}/{key}")
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for number, (one, other) in enumerate(zip(a, b, strict=True)):
            yield from differences(one, other, relative, f"{place}/{number}")
    elif isinstance(a, float) and isinstance(b, float):
        if not math.isclose(a, b, rel_tol=relative):
            yield f"{place}: {a!r} {b!r}, relative {abs(a - b) / max(abs(a), abs(b)):.1e}"
    elif a != b:
        yield f"{place}: {textwrap.shorten(repr(a), 80)} {textwrap.shorten(repr(b), 80)}"


def compare(before: Path, after: Path, relative: float) -> int:
    """Print in what two files of results differ; 0 if in nothing that counts."""
    if before.read_bytes() == after.read_bytes():
        print(f"{len(json.loads(before.read_text()))} results equal byte for byte")
        return 0
    found = list(differences(json.loads(before.read_text()), json.loads(after.read_text()), relative))
    print(*(found or [f"not byte for byte, but text and decisions equal and figures within {relative:g}"]), sep="\n")
    return int(bool(found))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    writing = verbs.add_parser("write")
    writing.add_argument("output", type=Path)
    comparing = verbs.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    comparing.add_argument("--relative", type=float, default=1e-9)
    asked = parser.parse_args()
    if asked.verb == "compare":
        return compare(asked.before, asked.after, asked.relative)
    collected = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, found in results(Path(folder)):
            print(name, f"exit {found['exit']}", file=sys.stderr)
            collected[name] = found
    asked.output.write_text(json.dumps(collected, indent=1, sort_keys=True) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
