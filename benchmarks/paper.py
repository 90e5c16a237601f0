"""The paper's Table 3 and convergence times beside ours, on virtual recordings over the wire.

    python benchmarks/paper.py [--duration 100] [--units 20] [--noise table1|log] [--keep DIR]

Three recordings are made at the same time, each by `imutui record --port virtual` (a simulated IMU400CD-200 on a
pseudo-terminal, still and level, that answers as the instrument does): 20 Hz polled, 20 Hz averaged from the stream,
133 Hz. Each is replayed by `imutui replay --json -o EST.mcap --estimates 0`. Everything is simulated; the paper's
figures are of a real unit.

Convergence is told in two ways. As the paper reads it off its figures: from when on all six biases stay within 0.6 mg
and 0.05 deg/s (Table 1's resolution) of their last values. And as `imutui` tells it while it lasts: by the convergence
monitor, which needs ten seconds of proof and counts them.

One recording says little of convergence, which is a matter of chance; so many more units are simulated without a wire.
"""

import json
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import bench
import numpy as np
from helpers import ros_messages
from mcap.reader import make_reader

from filters.imu import STANDARD_GRAVITY
from filters.kalman import layout, runner
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings
from filters.simulation import LOOP_HZ, StillUnit
from imutui.logbook import schemas

ACCEL_MG, GYRO_DPS = 0.6, 0.05


@dataclass(frozen=True, slots=True)
class Ours:
    """A replayed recording: the document, and seconds until the biases stay near their last values, each."""

    document: dict[str, Any]
    settled_s: np.ndarray


RECORDINGS: dict[str, list[str]] = {
    "20 Hz polled": ["--rate", "20", "--sampling", "polled"],
    "20 Hz averaged": ["--rate", "20"],
    "133 Hz": ["--rate", "133"],
}

# mean, standard deviation: the paper's Table 3
PAPER: dict[str, dict[str, tuple[float, float]]] = {
    "20": {
        "height m": (641.2033, 0.0042),
        "V_N m/s": (-0.0008, 0.0107),
        "V_E m/s": (-0.0003, 0.0122),
        "V_D m/s": (-0.0003, 0.0035),
        "roll deg": (0.0002, 0.0581),
        "pitch deg": (0.0016, 0.0549),
        "yaw deg": (0.0274, 0.1448),
    },
    "133": {
        "height m": (641.2032, 0.0000),
        "V_N m/s": (-0.0000, 0.0000),
        "V_E m/s": (0.0001, 0.0002),
        "V_D m/s": (-0.0001, 0.0004),
        "roll deg": (-0.0000, 0.0048),
        "pitch deg": (0.0001, 0.0041),
        "yaw deg": (0.0033, 0.0099),
    },
}
PAPER_CONVERGED = {"20": "< 50", "133": "< 10"}

ROWS: list[tuple[str, str, str, int]] = [
    ("height m", "position_deg_m", "position_m", 2),
    *((f"V_{axis} m/s", "velocity_mps", "velocity_mps", k) for k, axis in enumerate("NED")),
    *((f"{name} deg", "rpy_deg", "rpy_deg", k) for k, name in enumerate(("roll", "pitch", "yaw"))),
    *((f"accel bias {axis} mg", "accel_bias_mg", "accel_bias_mg", k) for k, axis in enumerate("xyz")),
    *((f"gyro bias {axis} deg/s", "gyro_bias_dps", "gyro_bias_dps", k) for k, axis in enumerate("xyz")),
]
"""Name, field of the mean, field of its standard deviation, and which of the three."""

DIFFERENCES = """\
* The unit is simulated: white noise of Table 1's density up to the band limit, constant biases, no drift, no table.
* 20 Hz: the paper does not say how it was made. A polled sample is one of the instrument's 133 a second, so it has
  the noise of the whole band, aliased: more than twice Table 1's density. Averaging the stream has not. The paper's
  scatter of attitude and its 50 s are those of polling.
* 133 Hz: scatter is in proportion to the noise of the unit. A quarter of Table 1's limits would give the paper's own
  0.004, 0.004 and 0.010 deg, but neither its velocities, which are ten times smaller still, nor its 20 Hz column: no
  one noise level gives both. The paper does not print Q; here it is Table 1's random walk.
* Convergence at 133 Hz: white noise of 1 m/s/sqrt(h) alone leaves 0.6 mg after 8 s, one standard deviation of one axis,
  so that 10 s is about the middle of what chance gives six of them. One recording cannot tell 10 s from 25 s.
* Settled is read as the paper reads its figures, with Table 1's resolution as the limit; the monitor's time counts the
  ten seconds in which it asks for proof, and tells of the estimates while they last.
* Height: exact measurements are fed; the height's row of R (30 m) lets through what is left.
* Yaw scatters 2.5 times as much as roll and pitch, in the paper and here: R gives it 0.5 deg, them 0.1 deg."""


def record(folder: Path, duration: float) -> dict[str, Path]:
    """Make the recordings, all at once."""
    logs = {name: folder / f"{name.replace(' ', '-')}.mcap" for name in RECORDINGS}

    def made(name: str) -> None:
        words = ["record", "--port", "virtual", *RECORDINGS[name], "--duration", str(duration), "--note", "benchmark"]
        words += ["--name", f"paper-{os.getpid()}-{logs[name].stem}", "-o", str(logs[name]), "--force"]
        bench.cost([*bench.IMUTUI, *words], folder)

    with ThreadPoolExecutor(len(RECORDINGS)) as pool:
        list(pool.map(made, RECORDINGS))
    return logs


def replay(log: Path, noise: str) -> Ours:
    """Replay a recording with an estimate for each sample."""
    output = log.with_suffix(".estimates.mcap")
    words = ["replay", str(log), "--json", "-o", str(output), "--estimates", "0", "--force"]
    done = bench.cost([*bench.IMUTUI, *words, "--set", f"filter.noise={noise}"], log.parent)
    return Ours(json.loads(done.printed), settled(output))


def settled(estimates: Path) -> np.ndarray:
    """Seconds from which on each bias stays near its last value, accelerometer x, y, z, gyro x, y, z; shape (6,)."""
    stamps, rows = [], []
    with estimates.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages(topics=[schemas.ESTIMATE], log_time_order=False):
            estimate = ros_messages.decode(schemas.TYPES[schemas.ESTIMATE], message.data)
            stamps.append(ros_messages.stamp_ns(estimate.header))
            rows.append(np.concatenate([estimate.accel_bias_mg, estimate.gyro_bias_dps]))
    return _settled((np.array(stamps) - stamps[0]) / 1e9, np.array(rows))


def _settled(t: np.ndarray, biases: np.ndarray) -> np.ndarray:
    """As `settled`, of times (N,) and biases (N, 6) in mg and deg/s."""
    limits = np.array([ACCEL_MG] * 3 + [GYRO_DPS] * 3)
    outside = np.abs(biases - biases[-1]) > limits
    # the sample after the last one outside
    last = np.array([np.flatnonzero(column)[-1] + 1 if column.any() else 0 for column in outside.T])
    return np.asarray(t[last])


def of_units(count: int, duration: float) -> dict[str, np.ndarray]:
    """Seconds until all six biases stay near their last values, of units simulated without a wire, shape (count,)."""
    out: dict[str, list[float]] = {name: [] for name in RECORDINGS}
    for seed in range(1, count + 1):
        # the reading that a request finds; the mean of those since the last output; every reading
        loop = StillUnit(seed, LOOP_HZ).samples(round(duration * LOOP_HZ))
        values = np.column_stack([loop.accel, loop.gyro])
        edges = np.round(np.arange(1, duration * 20.0) * LOOP_HZ / 20.0).astype(int)
        averaged = np.add.reduceat(values, np.concatenate([[0], edges[:-1]]), axis=0)
        averaged = averaged[1:-1] / np.diff(edges)[:-1, None]
        for name, samples, rate in (
            ("20 Hz polled", values[edges[edges < len(values)]], 20.0),
            ("20 Hz averaged", averaged, 20.0),
            ("133 Hz", values, LOOP_HZ),
        ):
            estimator = Estimator(Settings(1.0 / rate), every=0.0)
            t = np.arange(len(samples)) / rate
            accel, gyro = np.ascontiguousarray(samples[:, :3]), np.ascontiguousarray(samples[:, 3:])
            rows = np.concatenate(list(runner.rows(estimator, t, gyro, accel)))
            biases = rows[:, layout.OUT_NAV + layout.NAV_BA : layout.OUT_NAV + layout.NAV]
            units = np.array([1e3 / STANDARD_GRAVITY] * 3 + [np.rad2deg(1.0)] * 3)
            out[name].append(float(_settled(rows[:, layout.OUT_T], biases * units).max()))
    return {name: np.array(values) for name, values in out.items()}


def table(ours: dict[str, Ours]) -> list[str]:
    """Lines of the markdown table."""
    paper_of = {"20 Hz polled": "20", "133 Hz": "133"}
    heads = []
    for name in RECORDINGS:
        heads += [f"paper {paper_of[name]} Hz"] if name in paper_of else []
        heads.append(f"here, {name} (simulated)")
    lines = [f"| | {' | '.join(heads)} |", f"| --- |{' ---: |' * len(heads)}"]
    for label, mean, sd, k in ROWS:
        cells = []
        for name in RECORDINGS:
            if name in paper_of:
                known = PAPER[paper_of[name]].get(label)
                cells.append(f"{known[0]:.4f} ± {known[1]:.4f}" if known else "")
            spread = ours[name].document["spread"]
            value, scatter = _field(spread, "mean", mean, k), _field(spread, "sd", sd, k)
            cells.append("not converged" if value is None or scatter is None else f"{value:.4f} ± {scatter:.4f}")
        lines.append(f"| {label} | {' | '.join(cells)} |")
    for label, part in (("settled s: accelerometer", slice(0, 3)), ("settled s: gyro", slice(3, 6))):
        cells = []
        for name in RECORDINGS:
            cells += [PAPER_CONVERGED[paper_of[name]]] if name in paper_of else []
            cells.append(", ".join(f"{s:.1f}" for s in ours[name].settled_s[part]))
        lines.append(f"| {label} x, y, z | {' | '.join(cells)} |")
    for label, key in (("monitor s: accelerometer", "accel_bias"), ("monitor s: gyro", "gyro_bias")):
        cells = []
        for name in RECORDINGS:
            cells += [""] if name in paper_of else []
            times = ours[name].document["converged_s"][key]
            cells.append(", ".join("-" if s is None else f"{s:.0f}" for s in times))
        lines.append(f"| {label} x, y, z | {' | '.join(cells)} |")
    cells = []
    for name in RECORDINGS:
        cells += [""] if name in paper_of else []
        cells.append(f"{ours[name].document['nis']['mean']:.2f}")
    lines.append(f"| NIS, 9 rows, mean (no test) | {' | '.join(cells)} |")
    return lines


def _field(spread: Any, kind: str, name: str, k: int) -> float | None:
    three = (spread or {}).get(kind)
    return None if three is None or three[name] is None else three[name][k]


def noise_line(document: dict[str, Any]) -> str:
    used, found = document["noise"]["used"], document["noise"]
    return (
        f"Q ({used['source']}): gyro {_three(used['gyro_arw_deg_sqrt_h'])} deg/sqrt(h), accelerometer"
        f" {_three(used['accel_vrw_mps_sqrt_h'])} m/s/sqrt(h); seen on the log"
        f" {_three(found['gyro_arw_deg_sqrt_h'])} and {_three(found['accel_vrw_mps_sqrt_h'])}"
    )


def _three(values: list[float | None] | None) -> str:
    return "unknown" if values is None else ", ".join("-" if v is None else f"{v:.2f}" for v in values)


def main() -> None:
    options = bench.options(__doc__, duration=100.0, units=20, noise="table1", keep=Path)
    print(bench.describe("numpy", "numba"))
    with bench.folder_for(options.keep) as folder:
        logs = {name: folder / f"{name.replace(' ', '-')}.mcap" for name in RECORDINGS}
        if not all(log.exists() for log in logs.values()):
            print(f"recording {options.duration:g} s over the wire, three at a time")
            record(folder, options.duration)
        ours = {name: replay(log, options.noise) for name, log in logs.items()}
    print(f"\nTable 3 of the paper (measured), and the same here (simulated, {options.duration:g} s): mean ± sd after")
    print("convergence\n")
    print("\n".join(table(ours)))
    print()
    for name, side in ours.items():
        print(f"{name}: settled in {side.settled_s.max():.1f} s; {noise_line(side.document)}")
    if options.units:
        print(f"\nall six biases settled, {options.units} units simulated without a wire, {options.duration:g} s each:")
        for name, times in of_units(options.units, options.duration).items():
            limit = 10.0 if name == "133 Hz" else 50.0
            share = f"{np.count_nonzero(times < limit)} of {options.units} in less than the paper's {limit:g} s"
            print(f"  {name}: {bench.told(times.tolist(), '.1f')} s; {share}")
    print(f"\n{DIFFERENCES}")


if __name__ == "__main__":
    main()
