"""How fast a log is read, and what a whole `imutui replay` of it costs, of which how much is reading and writing.

    python benchmarks/reading.py reader [--seconds 3600] [--rate 133] [--repeat 3] [--file LOG]
    python benchmarks/reading.py replay [--seconds 3600] [--rate 133] [--repeat 3]

reader: our reader against mcap's message loop with rosbags decoding. Only the ratio says something: both sides are
processor time of one process on one machine within one minute.

replay: commands are run as a user would, each a process of its own, which reads and filters, and writes estimates 10 a
second or all of them. From their processor time are taken away the start, which is that of the same command on a log of
two seconds, and the filter, which is that of `imutui.jobs.replay.run` on the same samples without writing, in a process
of its own. What is left, divided by the samples, is reading (with the checksum of the file) and writing together. Being
a difference of three noisy numbers it wants a quiet machine; reading is also timed directly in that process.

Values are simulated.
"""

import json
import os
import resource
import statistics
import time
from collections.abc import Callable
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import bench
import numpy as np
from helpers import ros_messages
from mcap.reader import make_reader

from imutui.logbook import SessionInfo, reader, schemas
from imutui.logbook.reading import Reading
from imutui.logbook.writer import LogWriter

Values = tuple[np.ndarray, np.ndarray, np.ndarray]  # stamps (N,), angular rate and specific force (N, 3)
START_NS = 1_795_257_000_000_000_000
TARGET_US, SHORT_S = 3.0, 2
WRITE = ["-o", "estimates.mcap", "--force"]
COMMANDS = {"read, filter": [], "and write, 10 Hz": WRITE, "and write, all": [*WRITE, "--estimates", "0"]}
REQUIRED = ("read, filter", "and write, 10 Hz")


def write(path: Path, seconds: int, rate: int, flush: Callable[[LogWriter], None] = LogWriter.flush) -> None:
    """Write a log as the recorder does: packet, sample and temperature each period, the rest and a flush each second.

    The values are simulated: noise of the size of the instrument's, quantised as its counts are.
    """
    log = LogWriter(path, SessionInfo(rate_hz=rate, kind="simulated", note="benchmark"), "", START_NS)
    rng = np.random.default_rng(1)
    values = {"packets": 0}
    for second in range(seconds):
        counts = np.round(rng.normal(size=(rate, 6)) * 30.0 + [0, 0, 0, 0, 0, 5450]).astype(int)
        gyro = np.deg2rad(counts[:, :3] * (200.0 * 1.5 / 2**15))
        accel = -counts[:, 3:] * (4.0 * 1.5 / 2**15 * 9.80665)
        for k in range(rate):
            n = second * rate + k
            stamp = START_NS + n * 1_000_000_000 // rate
            a, b, c, d, e, f = counts[k].tolist()
            log.encoded(
                schemas.RAW,
                ros_messages.packet(n, n * 7_500_000, (a, b, c, d, e, f), 1587, -n * 9500 % 65536),
                stamp + 900_000,
                stamp,
            )
            log.imu(stamp + 900_000, stamp, gyro[k], accel[k])
            log.encoded(
                schemas.TEMPERATURE, schemas.encode_temperatures(stamp, 25.0 + k % 3 * 0.02)[0], stamp + 900_000, stamp
            )
            if k % (rate // 10) == 0:
                # as large as an estimate, which nobody reads here
                log.encoded(schemas.ESTIMATE, _estimate(stamp), stamp, stamp)
        values["packets"] += rate
        texts = {key: str(value) for key, value in values.items()} | {"lost_packets": "0", "bad_checksums": "0"}
        log.encoded(
            schemas.REFERENCE,
            schemas.encode_table_references(stamp, "level", np.zeros(3), np.zeros(3))[0],
            stamp,
            stamp,
        )
        log.encoded(schemas.DIAGNOSTICS, schemas.encode_diagnostics(stamp, 0, "ok", texts), stamp, stamp)
        flush(log)
    log.finish({}, START_NS)


def _estimate(stamp: int) -> bytes:
    (data,) = schemas.encode_estimates(stamp, np.append(np.zeros(30), 1.0)[None], 9, [False] * 6)
    return data


# ------------------------------------------------------------------------------------------------------------- reader


def ours(path: Path) -> Values:
    """Read with `reader.read`."""
    log = reader.read(path)
    return log.samples.stamp_ns, log.samples.gyro, log.samples.accel


def ours_with_packets(path: Path) -> Values:
    """Read with the packets too."""
    log = reader.read(path, raw=True)
    assert log.packets.size
    return log.samples.stamp_ns, log.samples.gyro, log.samples.accel


def loop(path: Path) -> Values:
    """Read samples and temperatures with mcap's message loop in file order."""
    stamps, rows, temperatures = [], [], []
    with path.open("rb") as stream:
        topics = [schemas.IMU, schemas.TEMPERATURE]
        for _, channel, message in make_reader(stream).iter_messages(topics=topics, log_time_order=False):
            m = ros_messages.decode(schemas.TYPES[channel.topic], message.data)
            if channel.topic == schemas.IMU:
                w, f = m.angular_velocity, m.linear_acceleration
                stamps.append(ros_messages.stamp_ns(m.header))
                rows.append((w.x, w.y, w.z, f.x, f.y, f.z))
            else:
                temperatures.append((ros_messages.stamp_ns(m.header), m.temperature))
    values = np.array(rows)
    return np.array(stamps), values[:, :3], values[:, 3:]


SIDES: dict[str, Callable[[Path], Values]] = {"ours": ours, "ours, packets": ours_with_packets, "loop": loop}


def measure(path: Path, short: Path, side: str, repeat: int) -> tuple[float, float, float]:
    """CPU seconds (median), megabytes of peak memory above the start's, and a sum of the values; in this process."""
    SIDES[side](short)  # compiled once a machine, loaded once a process
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    times, total = [], 0.0
    for _ in range(repeat):
        started = time.process_time()
        values = SIDES[side](path)
        times.append(time.process_time() - started)
        total = float(sum(part.astype(float).sum() for part in values))
    return statistics.median(times), (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0, total


def report_reader(path: Path, short: Path, repeat: int) -> None:
    """Print both sides, each measured in a process of its own."""
    samples = reader.read(path).samples.stamp_ns.size
    print(f"{samples} samples, {path.stat().st_size / 1e6:.1f} MB, simulated values; CPU time, median of {repeat}")
    results = {side: bench.apart(measure, path, short, side, 1 if side == "loop" else repeat) for side in SIDES}
    assert len({total for _, _, total in results.values()}) == 1, "the sides read different values"
    for side, (seconds, megabytes, _) in results.items():
        each, ratio = seconds / samples * 1e6, results["loop"][0] / seconds
        print(f"{side:14} {seconds:8.3f} s {each:8.3f} us/sample {ratio:7.1f} x {megabytes:7.1f} MB more")


# ------------------------------------------------------------------------------------------------------------- replay


def replay(log: Path, options: list[str], **environ: str) -> bench.Cost:
    """Run `imutui replay` on a log."""
    return bench.cost([*bench.IMUTUI, "replay", str(log), "--json", *options], log.parent, (0, 1), **environ)


def parts_of(log: Path, short: Path) -> tuple[float, float]:
    """CPU seconds of reading a log, with its checksum, and of the filter over it, in this process."""
    from filters.kalman import runner
    from filters.kalman.runner import Estimator
    from imutui.jobs import replay, replay_input

    reader.read(short)
    started = time.process_time()
    read = reader.read(log)
    feed = replay_input.at_once(read)
    reader.sha256(log)
    reading_s = time.process_time() - started
    _, settings = replay.prepare(feed, Reading())
    runner.warm_up()
    estimator = Estimator(settings, np.inf)
    started = time.process_time()
    for _ in replay.run(estimator, feed, None, lambda share: None):
        pass
    return reading_s, time.process_time() - started


def report_replay(log: Path, short: Path, seconds: int, repeat: int) -> None:
    """Measure in turn and print; then the time to a result with nothing compiled and with everything compiled."""
    starts: dict[str, list[float]] = {name: [] for name in COMMANDS}
    costs: dict[str, list[bench.Cost]] = {name: [] for name in COMMANDS}
    alone = []
    replay(short, [])
    for _ in range(repeat):
        alone.append(bench.apart(parts_of, log, short))
        for name, options in COMMANDS.items():
            starts[name].append(replay(short, options).cpu_s)
            costs[name].append(replay(log, options))
    readings, filters = map(list, zip(*alone, strict=True))
    documents = {name: [json.loads(run.printed) for run in runs] for name, runs in costs.items()}
    per = 1e6 / documents["read, filter"][0]["samples"]
    each = [bench.told([s * per for s in part]) for part in (readings, filters)]
    print(f"us of CPU a sample, timed directly: reading {each[0]}, filter {each[1]}")
    columns = ("CPU s", "start, CPU s", "read and write, us a sample", "wall s", "times real time", "filter_s, read_s")
    bench.head("command", *columns, "peak MB")
    for name, runs in costs.items():
        cpu, wall = [run.cpu_s for run in runs], [run.wall_s for run in runs]
        left = [(c - start - own) * per for c, start, own in zip(cpu, starts[name], filters, strict=True)]
        timings = (f"{statistics.median(d[key] for d in documents[name]):.2f}" for key in ("filter_s", "read_s"))
        cells = [*map(bench.told, (cpu, starts[name], left, wall)), bench.told([seconds / s for s in wall], ".0f")]
        bench.row(name, *cells, ", ".join(timings), bench.told([run.peak_mb for run in runs], ".0f"))
        if name in REQUIRED and statistics.median(left) > TARGET_US:
            print(f"  {name}: more than the {TARGET_US:g} us a sample it should take")
    print("\nfilter_s and read_s are the command's own, wall time; with -o, filter_s contains the writing.")
    started: dict[str, list[bench.Cost]] = {"cold (nothing compiled)": [], "warm": []}
    for k in range(repeat):
        for runs in started.values():
            runs.append(replay(short, [], NUMBA_CACHE_DIR=str(log.parent / f"cache{k}")))
    print(f"\nstart-up, the whole command on {SHORT_S} s of samples:")
    for name, runs in started.items():
        took = f"{bench.told([c.wall_s for c in runs])} s wall, {bench.told([c.cpu_s for c in runs])} s CPU"
        print(f"  {name:24} {took}, peak {bench.told([c.peak_mb for c in runs], '.0f')} MB")


def main() -> None:
    asked = bench.options(__doc__, "reader", "replay", seconds=3600, rate=133, repeat=3, file=Path)
    print(bench.describe("numpy", "numba", "mcap", "rosbags"))
    with bench.folder_for() as folder:
        log, short = asked.file or folder / "long.mcap", folder / "short.mcap"
        write(short, SHORT_S, asked.rate)
        if asked.file is None:
            write(log, asked.seconds, asked.rate)
        print(f"\n{asked.seconds} s at {asked.rate} Hz, simulated, {log.stat().st_size / 1e6:.1f} MB; ", end="")
        print(f"median (min..max) of {asked.repeat}")
        if asked.part == "reader":
            report_reader(log, short, asked.repeat)
        else:
            report_replay(log, short, asked.seconds, asked.repeat)


if __name__ == "__main__":
    main()
