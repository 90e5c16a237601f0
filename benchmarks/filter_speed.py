"""How fast the filter steps: ours against filterpy, turbo-ckf and vectorised numpy, one process, one problem.

    python benchmarks/filter_speed.py [--seconds 60] [--repeat 5]

The problem: 15 states, 31 sigma points, κ = 0, one step of 1/133 s a sample, the paper's R, Table 1's Q, on synthetic
static samples quantised to the instrument's counts (simulated). All sides feed the same samples and must agree within
1e-3 of a standard deviation, which is checked first; then they are timed in turn, each peer between two runs of ours.
Ours is the product's step as `imutui replay` runs it (attitude in closed form, with gate, tallies and convergence
monitor), and the same kernel on the peers' own Euler equations. CPU time; only the ratios say something.
"""

import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import bench
import numpy as np
import peers
from euler_lanes import EulerLanes

from filters import attitude, earth
from filters.imu import IMU400CD_200, STANDARD_GRAVITY
from filters.kalman import runner
from filters.kalman.runner import Estimator
from filters.kalman.settings import P0_ACCEL_BIAS_SD, P0_GYRO_BIAS_SD, Settings
from filters.motion import reference
from filters.motion.reference import PAPER_R_SD
from filters.state import PAPER_SITE

RATE = 133
SO3, EULER = "ours", "ours, Euler angles"
REQUIRED = {"filterpy": 50.0, "numpy, vectorised": 50.0, "turbo-ckf": 5.0}
AGREE = 1e-3
_BURST = 5


@dataclass(frozen=True, slots=True)
class Problem:
    """Samples of a still, level unit, and what all sides believe of it; the state's position in rad, rad, m."""

    t: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    x: np.ndarray
    P0_sd: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    units: np.ndarray
    gravity: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """Estimate and standard deviations, m, m/s, rad, m/s², rad/s; shapes (15,)."""

    x: np.ndarray
    sd: np.ndarray


Side = Callable[[Problem], Callable[[], Outcome]]
"""Makes a filter ready to run over the samples; the call that comes back runs it."""


def problem(seconds: float, seed: int = 1) -> Problem:
    """White noise of Table 1 and constant biases within its limits, as 16-bit counts."""
    rng, spec, site = np.random.default_rng(seed), IMU400CD_200, PAPER_SITE
    n = round(seconds * RATE)
    still = reference.level(site)
    rates, force = still.rates_and_forces()
    gyro = rates + rng.uniform(-1, 1, 3) * spec.gyro_bias_limit + rng.normal(size=(n, 3)) * spec.gyro_arw * RATE**0.5
    accel = force + rng.uniform(-1, 1, 3) * spec.accel_bias_limit + rng.normal(size=(n, 3)) * spec.accel_vrw * RATE**0.5
    gyro_count, accel_count = np.deg2rad(200.0 * 1.5 / 2**15), 4.0 * 1.5 / 2**15 * STANDARD_GRAVITY
    P0_sd = np.concatenate([PAPER_R_SD, np.full(3, P0_ACCEL_BIAS_SD), np.full(3, P0_GYRO_BIAS_SD)])
    Q = np.zeros(15)
    Q[3:6], Q[6:9] = spec.accel_vrw**2 / RATE, spec.gyro_arw**2 / RATE
    phi, height = np.array(site.latitude), np.array(site.height)
    units = np.ones(15)
    R_n, R_e = earth.curvature(phi, height)
    units[0], units[1] = 1.0 / R_n, 1.0 / (R_e * np.cos(phi))
    units[2] = -1.0
    x = np.zeros(15)
    x[:3] = site.latitude, site.longitude, site.height
    return Problem(
        np.arange(n) / RATE,
        np.round(gyro / gyro_count).astype(np.int16) * gyro_count,
        np.round(accel / accel_count).astype(np.int16) * accel_count,
        x,
        P0_sd,
        Q,
        PAPER_R_SD**2,
        units,
        site.gravity,
    )


def ours(p: Problem) -> Callable[[], Outcome]:
    """The product: `filters.kalman.runner` with the compiled step."""
    estimator = Estimator(Settings(1.0 / RATE), every=np.inf)

    def run() -> Outcome:
        for _ in runner.rows(estimator, p.t, p.gyro, p.accel):
            pass
        latest = estimator.latest
        assert latest is not None
        nav = latest.belief.nav
        position = np.array([nav.latitude, nav.longitude, nav.height])
        x = np.concatenate([position, nav.velocity_n, attitude.to_rpy(nav.C_nb), nav.accel_bias, nav.gyro_bias])
        return _outcome(p, x, np.sqrt(np.diag(latest.belief.P)))

    return run


def ours_euler(p: Problem) -> Callable[[], Outcome]:
    """The product's kernel on Euler angles."""
    side = EulerLanes(p.x, p.P0_sd, p.Q, p.R, 1.0 / RATE)

    def run() -> Outcome:
        # the first sample only sets the clock
        side.run(p.gyro[1:], p.accel[1:])
        return _outcome(p, side.x, np.sqrt(np.diag(side.covariance())))

    return run


def peer(name: str) -> Side:
    """One of `peers.PEERS`."""

    def ready(p: Problem) -> Callable[[], Outcome]:
        per = p.units**2
        side = peers.PEERS[name](
            p.x, np.diag(p.P0_sd**2 * per), np.diag(p.Q * per), p.R * per[:9], 1.0 / RATE, p.gravity
        )

        def run() -> Outcome:
            side.run(p.gyro[1:], p.accel[1:])
            return _outcome(p, side.x, np.sqrt(np.diag(side.P)) / np.abs(p.units))

        return run

    return ready


def _outcome(p: Problem, x: np.ndarray, sd: np.ndarray) -> Outcome:
    return Outcome((x - p.x) / p.units, sd)


SIDES: dict[str, Side] = {SO3: ours, EULER: ours_euler} | {name: peer(name) for name in peers.PEERS}


def verify(p: Problem) -> bool:
    """Print how far each side is from vectorised numpy after all samples, and whether all agree."""
    outcomes = {name: side(p)() for name, side in SIDES.items()}
    of = outcomes["numpy, vectorised"]
    print(f"agreement after {p.t.size - 1} steps, against vectorised numpy:")
    fine = True
    for name, outcome in outcomes.items():
        states = np.abs(outcome.x - of.x) / of.sd
        sds = np.abs(outcome.sd / of.sd - 1.0)
        fine &= bool(states.max() < AGREE and sds.max() < AGREE)
        print(f"  {name:32} states {states.max():.1e} sd (row {states.argmax()}), sd {sds.max():.1e} of itself")
    return fine


def seconds_of(side: Side, p: Problem, times: int = 1) -> float:
    """CPU seconds of one run."""
    runs = [side(p) for _ in range(times)]
    started = time.process_time()
    for run in runs:
        run()
    return (time.process_time() - started) / times


def measure(p: Problem, repeat: int) -> None:
    steps = p.t.size - 1
    each: dict[str, list[float]] = {name: [] for name in SIDES}
    ratios: dict[tuple[str, str], list[float]] = {}
    for _ in range(repeat):
        before = {name: seconds_of(SIDES[name], p, _BURST) for name in (SO3, EULER)}
        for name in peers.PEERS:
            seconds = seconds_of(SIDES[name], p)
            after = {name: seconds_of(SIDES[name], p, _BURST) for name in (SO3, EULER)}
            each[name].append(seconds / steps * 1e6)
            for our in (SO3, EULER):
                each[our].append(after[our] / steps * 1e6)
                ratios.setdefault((our, name), []).append(seconds / (0.5 * (before[our] + after[our])))
            before = after
    print(f"\nCPU time a step, us: median (min..max) of {repeat}; and how many times faster ours is")
    print("| | us a step | ours (product) | ours (Euler angles) | required |\n| --- | ---: | ---: | ---: | ---: |")
    missed = []
    for name in SIDES:
        cells = [bench.told(ratios[our, name]) if (our, name) in ratios else "" for our in (SO3, EULER)]
        required = REQUIRED.get(name)
        print(f"| {name} | {bench.told(each[name])} | {' | '.join(cells)} | {f'{required:g}' if required else ''} |")
        missed += [
            f"{name} by {our}" for our in (SO3, EULER) if required and statistics.median(ratios[our, name]) < required
        ]
    real = 1.0 / (statistics.median(each[SO3]) * 1e-6 * RATE)
    print(f"\nours: {real:.0f} times real time; required ratios {'missed: ' + ', '.join(missed) if missed else 'met'}")


def main() -> None:
    options = bench.options(__doc__, seconds=60.0, repeat=5)
    print(bench.describe("numpy", "scipy", "numba", "llvmlite", "filterpy", "turbo-ckf"))
    runner.warm_up()
    p = problem(options.seconds)
    print(f"\n{p.t.size} samples at {RATE} Hz, simulated, static, quantised")
    if not verify(p):
        raise SystemExit("the sides do not agree: they do not solve the same problem")
    measure(p, options.repeat)


if __name__ == "__main__":
    main()
