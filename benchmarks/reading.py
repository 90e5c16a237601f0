"""How fast a log is read: our reader against mcap's message loop with rosbags decoding, one file, one run.

    python benchmarks/reading.py [--seconds 3600] [--rate 133] [--repeat 3]

Only the ratio says something: both sides are CPU time of one process on one machine within one minute.
"""

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from imutui.logbook import SessionInfo, reader, schemas
from imutui.logbook.schemas import RawPacket
from imutui.logbook.writer import LogWriter

Values = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Stamps (N,), angular rate and specific force (N, 3)."""
START_NS = 1_795_257_000_000_000_000


def write(path: Path, seconds: int, rate: int) -> None:
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
            log.raw(RawPacket(n, n * 7_500_000, (a, b, c, d, e, f), 1587, -n * 9500 % 65536), stamp + 900_000, stamp)
            log.imu(stamp + 900_000, stamp, gyro[k], accel[k])
            log.message(schemas.TEMPERATURE, schemas.temperature(stamp, 25.0 + k % 3 * 0.02), stamp + 900_000, stamp)
            if k % (rate // 10) == 0:
                # as large as an estimate, which nobody reads here
                log.message(schemas.ESTIMATE, _estimate(stamp), stamp, stamp)
        values["packets"] += rate
        texts = {key: str(value) for key, value in values.items()} | {"lost_packets": "0", "bad_checksums": "0"}
        log.message(schemas.REFERENCE, schemas.table_reference(stamp, "level", np.zeros(3), np.zeros(3)), stamp, stamp)
        log.message(schemas.DIAGNOSTICS, schemas.diagnostics(stamp, 0, "ok", texts), stamp, stamp)
        log.flush()
    log.finish({}, START_NS)


def _estimate(stamp: int) -> object:
    three = np.zeros(3)
    names = ("position_deg_m", "velocity_mps", "rpy_deg", "accel_bias_mg", "gyro_bias_dps")
    sds = ("position_sd_m", "velocity_sd_mps", "rpy_sd_deg", "accel_bias_sd_mg", "gyro_bias_sd_dps")
    return schemas.make(
        schemas.TYPES[schemas.ESTIMATE],
        header=schemas.header(stamp, "table"),
        **dict.fromkeys((*names, *sds), three),
        nis=1.0,
        nis_dof=9,
        converged=np.zeros(6, bool),
    )


def ours(path: Path) -> Values:
    """Read with `reader.read`."""
    log = reader.read(path)
    return log.stamp_ns, log.gyro, log.accel


def ours_with_packets(path: Path) -> Values:
    """Read with the packets too."""
    log = reader.read(path, raw=True)
    assert log.packets.size
    return log.stamp_ns, log.gyro, log.accel


def loop(path: Path) -> Values:
    """Read samples and temperatures with mcap's message loop in file order."""
    stamps, rows, temperatures = [], [], []
    with path.open("rb") as stream:
        topics = [schemas.IMU, schemas.TEMPERATURE]
        for _, channel, message in make_reader(stream).iter_messages(topics=topics, log_time_order=False):
            m = schemas.decode(schemas.TYPES[channel.topic], message.data)
            if channel.topic == schemas.IMU:
                w, f = m.angular_velocity, m.linear_acceleration
                stamps.append(schemas.stamp_ns(m.header))
                rows.append((w.x, w.y, w.z, f.x, f.y, f.z))
            else:
                temperatures.append((schemas.stamp_ns(m.header), m.temperature))
    values = np.array(rows)
    return np.array(stamps), values[:, :3], values[:, 3:]


SIDES: dict[str, Callable[[Path], Values]] = {"ours": ours, "ours, packets": ours_with_packets, "loop": loop}


def measure(path: Path, side: str, repeat: int) -> tuple[float, float, float]:
    """CPU seconds (median), megabytes of peak memory above the start's, and a sum of the values; in this process."""
    read = SIDES[side]
    with tempfile.TemporaryDirectory() as folder:
        # compiled once a machine, loaded once a process
        write(Path(folder) / "short.mcap", 1, 20)
        read(Path(folder) / "short.mcap")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    times, total = [], 0.0
    for _ in range(repeat):
        started = time.process_time()
        values = read(path)
        times.append(time.process_time() - started)
        total = float(sum(part.astype(float).sum() for part in values))
    return statistics.median(times), (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0, total


def main() -> None:
    """Write the log, measure both sides each in a process of its own, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=3600)
    parser.add_argument("--rate", type=int, default=133)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--side", choices=tuple(SIDES), help=argparse.SUPPRESS)
    parser.add_argument("--file", type=Path, help="use this log instead of writing one")
    options = parser.parse_args()
    if options.side:
        print(*map(repr, measure(options.file, options.side, options.repeat)))
        return
    with tempfile.TemporaryDirectory() as folder:
        path = options.file or Path(folder) / "hour.mcap"
        if options.file is None:
            write(path, options.seconds, options.rate)
        report(path, options.repeat)


def report(path: Path, repeat: int) -> None:
    """Print both sides."""
    samples = reader.read(path).stamp_ns.size
    print(f"{samples} samples, {path.stat().st_size / 1e6:.1f} MB, simulated values; CPU time, median of {repeat}")
    results = {}
    for side in SIDES:
        command = [sys.executable, __file__, "--side", side, "--file", str(path), "--repeat"]
        times = "1" if side == "loop" else str(repeat)
        out = subprocess.run([*command, times], capture_output=True, text=True, check=True).stdout
        results[side] = [float(word) for word in out.split()]
    assert len({total for _, _, total in results.values()}) == 1, "the sides read different values"
    loop_s = results["loop"][0]
    for side, (seconds, megabytes, _) in results.items():
        each = seconds / samples * 1e6
        print(f"{side:14} {seconds:8.3f} s {each:8.3f} us/sample {loop_s / seconds:7.1f} x {megabytes:7.1f} MB more")


if __name__ == "__main__":
    main()
