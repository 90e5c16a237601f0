"""A day of packets through an acquisition's recorder and filter, as fast as they go: what memory and disk they take.

    python benchmarks/soak.py [--hours 24] [--rate 133] [--filter spkf] [--rotate-minutes 0] [--folder FOLDER]

133.3 simulated packets a second by the packets' own time, each stamped, written, averaged to the rate, filtered; and a
flush and a snapshot each second of theirs. Only the thread that reads the port is left out. A line an hour, then how
memory, descriptors and files have grown.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

from bench import describe

# what is shared with the tests
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from reliability.soak import Taken, soak

from imutui.session.plan import Plan


def line(taken: Taken) -> str:
    """A row."""
    return (
        f"| {taken.seconds / 3600.0:.2f} | {taken.resident_mb:.1f} | {taken.descriptors} | {taken.objects} |"
        f" {taken.file_mb:.1f} | {taken.processor_s:.0f} |"
    )


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--rate", type=float, default=133.0)
    parser.add_argument("--filter", default="spkf")
    parser.add_argument("--rotate-minutes", type=float, default=0.0)
    parser.add_argument("--folder", type=Path, help="where the files go, and stay; else a temporary one")
    options = parser.parse_args()
    print(describe("mcap", "numpy", "numba"), flush=True)
    with tempfile.TemporaryDirectory() as name:
        folder = options.folder or Path(name)
        os.environ["XDG_CACHE_HOME"] = name
        plan = Plan(
            "none", options.rate, logs=str(folder), record=True, filter=options.filter,
            rotate_minutes=options.rotate_minutes,
        )  # fmt: skip
        print(
            "\n| hours | resident, MB | descriptors | objects | files, MB | processor, s |\n|---|---|---|---|---|---|"
        )
        found = []
        began = time.perf_counter()
        for taken in soak(folder, plan, options.hours * 3600.0 + 1.0, min(3600.0, options.hours * 900.0)):
            print(line(taken), flush=True)
            found.append(taken)
        first, last = found[0], found[-1]
        hours = (last.seconds - first.seconds) / 3600.0
        print(
            f"\nan hour: {(last.file_mb - first.file_mb) / hours:.1f} MB on the disk,"
            f" {(last.resident_mb - first.resident_mb) / hours:+.2f} MB of memory,"
            f" {(last.descriptors - first.descriptors) / hours:+.2f} descriptors;"
            f" {last.seconds / (time.perf_counter() - began):.0f} times as fast as real time"
        )


if __name__ == "__main__":
    main()
