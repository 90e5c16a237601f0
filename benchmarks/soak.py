"""A day of packets through an acquisition's recorder and filter, as fast as they go: what memory and disk they take.

    python benchmarks/soak.py [--hours 24] [--rate 133] [--filter spkf] [--rotate-minutes 0] [--folder FOLDER]

133.3 simulated packets a second by the packets' own time, each stamped, written, averaged to the rate, filtered; and a
flush and a snapshot each second of theirs. Only the thread that reads the port is left out. A line an hour, then how
memory, descriptors and files have grown.
"""

import os
import tempfile
import time
from pathlib import Path

import bench
from reliability.soak import soak

from imutui.session.plan import Plan


def main() -> None:
    asked = bench.options(__doc__, hours=24.0, rate=133.0, filter="spkf", rotate_minutes=0.0, folder=Path)
    print(bench.describe("mcap", "numpy", "numba"), flush=True)
    with bench.folder_for(asked.folder) as folder, tempfile.TemporaryDirectory() as cache:
        os.environ["XDG_CACHE_HOME"] = cache
        fields = {"logs": str(folder), "filter": asked.filter, "rotate_minutes": asked.rotate_minutes}
        plan = Plan("none", rate_hz=asked.rate, record=True, **fields)
        bench.head("hours", "resident, MB", "descriptors", "objects", "files, MB", "processor, s")
        found = []
        began = time.perf_counter()
        for taken in soak(folder, plan, asked.hours * 3600.0 + 1.0, min(3600.0, asked.hours * 900.0)):
            figures = (f"{taken.seconds / 3600.0:.2f}", f"{taken.resident_mb:.1f}", taken.descriptors, taken.objects)
            bench.row(*figures, f"{taken.file_mb:.1f}", f"{taken.processor_s:.0f}")
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
