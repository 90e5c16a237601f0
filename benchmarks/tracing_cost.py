"""What a trace costs: CPU time of a full campaign; time and memory of logs at rest of up to a week.

    python benchmarks/tracing_cost.py [--hours 1,4,24,168] [--keep DIR] [--log LOG.mcap]

The logs are written first, 16 MB an hour, into a temporary folder or the one that is named, and traced as `imutui
trace` does, reading included. `--log` traces another log instead.

One core, one process for each measurement, so that the peak of its memory is its own. Simulated readings: white noise,
a line, a gyro that follows temperature, and a walk of another gyro and of an accelerometer.
"""

import contextlib
import os
import resource
import struct
import time
import zlib
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import bench
import numpy as np
import tracing_cases as cases
import zstandard
from mcap.exceptions import EndOfFile
from mcap.records import Channel
from mcap.stream_reader import StreamReader

from filters.imu import STANDARD_GRAVITY
from filters.tracing.run import Run
from filters.tracing.trace import trace
from imutui.jobs.trace import trace as trace_logs
from imutui.logbook import SessionInfo, schemas
from imutui.logbook.reading import Reading
from imutui.logbook.writer import LogWriter

RATE = 133.0
REQUIRED_S = 10.0
REQUIRED_MB = 1500.0
BASE_NS, PER_CHUNK = 1_700_000_000_000_000_000, 7980
WALK = np.array([np.deg2rad(6e-5), 1.5e-4])  # of the y gyro and accelerometer, rad/s and m/s² per √s
_MEGA = 1e6


def campaign() -> tuple[Run, ...]:
    """Four runs of 87 000 readings, the whole table programme, with an effect to be found."""
    made = cases.case("catalogue", 3)
    assert made.heldout is not None
    assert made.campaign == "full"
    return *made.runs, made.heldout


def write(path: Path, hours: float) -> None:
    """A log of samples and temperatures without a footer, a minute a chunk; by columns, for a week is long."""
    setattr(os, "fdatasync", lambda _: None)  # noqa: B010 - what would be waited for here is the disk
    log = LogWriter(path, SessionInfo(rate_hz=RATE, kind="simulated"), "", BASE_NS, checksum=False)
    marks = np.arange(6) + 1.25
    of_imu = schemas.encode_imus(BASE_NS, marks[:3], marks[3:])[0]
    of_degc = schemas.encode_temperatures(BASE_NS, marks[0])[0]
    log.imu(BASE_NS, BASE_NS, np.zeros(3), np.array([0.0, 0.0, -STANDARD_GRAVITY]))
    log.encoded(schemas.TEMPERATURE, of_degc, BASE_NS, BASE_NS)
    log.flush()
    log._file.close()
    channels: dict[str, int] = {}
    with path.open("rb") as stream, contextlib.suppress(EndOfFile):
        for record in StreamReader(stream).records:
            if isinstance(record, Channel):
                channels[record.topic] = record.id
    rng, walk = np.random.default_rng(0), np.zeros(2)
    sd = cases.density(cases.WHITE) * np.sqrt(RATE)
    count = round(hours * 3600.0 * RATE)
    with path.open("ab") as stream:
        for first in range(1, count, PER_CHUNK):
            k = np.arange(first, min(first + PER_CHUNK, count))
            t = k / RATE
            T = np.round((24.0 - 8.0 * np.expm1(-t / 1800.0) + 4.0 * np.sin(2.0 * np.pi * t / 86400.0)) / 0.05) * 0.05
            x = rng.standard_normal((k.size, 6)) * sd
            x[:, 0] += np.deg2rad(0.002) * (T - 24.0)
            walks = walk + np.cumsum(rng.standard_normal((k.size, 2)) * WALK / np.sqrt(RATE), axis=0)
            walk = walks[-1]
            x[:, [1, 4]] += walks
            x[:, 3] += 0.4 * sd[3] * np.sin(2.0 * np.pi * 17.3 * t)
            x[:, 5] -= STANDARD_GRAVITY
            x = np.rint(x / cases.COUNT) * cases.COUNT
            stamps = BASE_NS + np.rint(t * 1e9).astype(np.int64)
            rows = [
                _messages(channels[schemas.IMU], of_imu, marks, x, stamps, k),
                _messages(channels[schemas.TEMPERATURE], of_degc, marks[:1], T[:, None], stamps, k),
            ]
            stream.write(_chunk(np.hstack(rows).tobytes(), int(stamps[0]), int(stamps[-1])))


def _messages(
    channel: int, like: bytes, marks: np.ndarray, values: np.ndarray, stamps: np.ndarray, number: np.ndarray
) -> np.ndarray:
    """Message records as rows of bytes: copies of one with other stamps and, where its `marks` are, other values."""
    head = struct.pack("<BQHIQQ", 5, 22 + len(like), channel, 0, 0, 0)
    rows = np.tile(np.frombuffer(head + like, np.uint8), (stamps.size, 1))
    places = [(11, number, "<u4"), (15, stamps, "<i8"), (23, stamps, "<i8")]
    data = len(head)
    places += [(data + 4, stamps // 10**9, "<i4"), (data + 8, stamps % 10**9, "<u4")]
    places += [(data + like.index(struct.pack("<d", m)), values[:, c], "<f8") for c, m in enumerate(marks.tolist())]
    for at, column, kind in places:
        own = column.astype(kind)
        rows[:, at : at + own.itemsize] = np.ascontiguousarray(own).view(np.uint8).reshape(stamps.size, -1)
    return rows


def _chunk(content: bytes, first_ns: int, last_ns: int) -> bytes:
    packed = zstandard.ZstdCompressor(level=1).compress(content)
    head = struct.pack("<QQQI", first_ns, last_ns, len(content), zlib.crc32(content))
    body = head + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", 6, len(body)) + body


def measure(what: str) -> tuple[float, int, float, float]:
    """CPU time of a trace (s), readings, when there were first findings (s, 0 without), and memory at the peak (MB)."""
    warm = cases.case("free", 0)
    trace(warm.runs, warm.heldout)  # compiles
    began, start, first = time.monotonic(), time.process_time(), [0.0]
    if what == "campaign":
        runs = campaign()
        start = time.process_time()
        trace(runs[:-1], runs[-1])
        count = sum(run.t.size for run in runs)
    else:
        told = trace_logs([Path(what)], Reading(), so_far=lambda text: first.append(time.monotonic() - began))
        count = told["runs"][0]["samples"]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return time.process_time() - start, count, first[-1], peak


def main() -> None:
    asked = bench.options(__doc__, hours="1,4,24,168", keep=Path, log=str)
    print(bench.describe("numpy", "scipy", "numba"))
    spent, count, _, peak = bench.apart(measure, "campaign")
    verdict = "met" if spent <= REQUIRED_S else "MISSED"
    print(f"\nfour runs, {count} readings: {spent:.1f} s CPU (<= {REQUIRED_S:.0f} s: {verdict}), peak {peak:.0f} MB\n")
    print("log at rest   readings    CPU s   s per million   first findings, s   peak MB")
    with bench.folder_for(asked.keep) as folder:
        for hours in ["0"] if asked.log else asked.hours.split(","):
            log = Path(asked.log or folder / f"still_{hours}h.mcap")
            if not log.exists():
                write(log, float(hours))
            spent, count, first, peak = bench.apart(measure, str(log))
            million, verdict = count / _MEGA, "met" if peak <= REQUIRED_MB else "MISSED"
            print(
                f"{log.stem:>11s} {count:10d} {spent:8.1f} {spent / million:15.2f} {first:19.1f} {peak:9.0f}"
                f" (<= {REQUIRED_MB:.0f}: {verdict})",
                flush=True,
            )


if __name__ == "__main__":
    main()
