from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import chi2

from filters.imu import IMU400CD_200, STANDARD_GRAVITY, Noise
from filters.kalman import consistency, engines, layout, runner
from filters.kalman.consistency import ConvergenceMonitor
from filters.kalman.filter_input import FilterInput, draws
from filters.kalman.runner import Estimator
from filters.kalman.settings import P0_ACCEL_BIAS_SD, P0_GYRO_BIAS_SD, Settings
from filters.motion import reference
from filters.state import PAPER_SITE, SIZE

SPEC = IMU400CD_200
LEVEL = reference.level(PAPER_SITE)
P0_SD = np.concatenate([reference.PAPER_R_SD, np.full(3, P0_ACCEL_BIAS_SD), np.full(3, P0_GYRO_BIAS_SD)])
TAILS = np.array([0.001, 0.999])
SIGMA = np.repeat([SPEC.accel_vrw, SPEC.gyro_arw], 3)


@dataclass(frozen=True)
class Trial:
    """NEES at each time asked for, shape (T,); sum of NIS, updates, updates left out."""

    nees: np.ndarray
    nis_sum: float
    updates: int
    rejected: int


def trial(name: str, seed: int, hz: float, times: tuple[float, ...], noise: float = 1.0) -> Trial:
    """One still, level unit whose errors at the start are a draw from P0, in white noise of `noise` times Table 1."""
    n, rng = round(times[-1] * hz) + 1, np.random.default_rng([seed, 77])
    # the filter begins at the truth plus a draw; it believes in no bias, so the true one is minus the draw
    wrong = rng.standard_normal(SIZE) * P0_SD
    bias = -wrong[9:]
    rate, force = LEVEL.rates_and_forces()
    gyro = rate + bias[3:] + rng.standard_normal((n, 3)) * noise * SPEC.gyro_arw * np.sqrt(hz)
    accel = force + bias[:3] + rng.standard_normal((n, 3)) * noise * SPEC.accel_vrw * np.sqrt(hz)
    engine = engines.ENGINES[name](Settings(1.0 / hz, noise=Noise.of(SPEC)), False, np.inf)
    engine.start(LEVEL.nav.plus(np.append(wrong[:9], np.zeros(6))), P0_SD)
    t = np.arange(n) / hz
    feed = FilterInput(t, gyro, accel, LEVEL.known(t, -np.inf, gyro), draws(seed, 0, n))
    k, nees = 0, []
    for time in times:
        stop = time + 0.5 / hz
        while k < n and t[k] < stop:
            k, _ = engine.advance(feed, k, stop)
        belief = engine.belief()
        error = belief.nav.minus(LEVEL.nav)
        error[9:] -= bias
        nees.append(error @ np.linalg.solve(belief.P, error))
    core = engine.core
    sums = core[layout.CORE_NIS_SUM], core[layout.CORE_NIS_COUNT], core[layout.CORE_REJECTED]
    return Trial(np.array(nees), float(sums[0]), int(sums[1]), int(sums[2]))


@pytest.mark.parametrize(
    ("name", "hz", "seeds", "times"),
    [
        ("spkf", 133.0, 120, (0.5, 2.0, 10.0)),
        ("spkf", 20.0, 200, (0.5, 2.0, 10.0, 60.0)),
        ("spkf", 1.0, 200, (5.0, 60.0)),
        ("ekf", 20.0, 8, (0.5, 2.0, 5.0)),
        ("spkf-paper", 20.0, 8, (0.5, 2.0, 5.0)),
    ],
)
def test_errors_and_innovations_are_as_large_as_the_filter_says(
    name: str, hz: float, seeds: int, times: tuple[float, ...]
) -> None:
    trials = [trial(name, seed, hz, times) for seed in range(seeds)]
    low, high = chi2.ppf(TAILS, SIZE * seeds) / seeds
    for time, nees in zip(times, np.mean([one.nees for one in trials], axis=0), strict=True):
        assert low < nees < high, f"NEES {nees:.2f} of 15 after {time:g} s, band {low:.2f} to {high:.2f}"
    updates = sum(one.updates for one in trials)
    nis = sum(one.nis_sum for one in trials) / updates
    low, high = chi2.ppf(TAILS, 9 * updates) / updates
    assert low < nis < high, f"NIS {nis:.3f} of 9, band {low:.3f} to {high:.3f}"
    # a gate of 1e-9 leaves out none of some hundred thousand
    assert sum(one.rejected for one in trials) == 0


def test_a_filter_that_believes_in_half_the_noise_leaves_the_band() -> None:
    """The test above can fail: in twice the believed noise NEES after 10 s is beyond its band, and so is NIS."""
    seeds = 40
    trials = [trial("spkf", seed, 20.0, (10.0,), noise=2.0) for seed in range(seeds)]
    assert np.mean([one.nees for one in trials]) > chi2.ppf(TAILS[1], SIZE * seeds) / seeds
    updates = sum(one.updates for one in trials)
    assert sum(one.nis_sum for one in trials) > chi2.ppf(TAILS[1], 9 * updates)


@pytest.mark.parametrize(("dof", "count"), [(9, 1), (9, 7980), (5, 40), (7.5, 1000)])
@pytest.mark.parametrize("level", [0.95, 0.998])
def test_the_nis_band_is_scipys_chi_square(dof: float, count: int, level: float) -> None:
    tail = 0.5 * (1.0 - level)
    expected = chi2.ppf([tail, 1.0 - tail], dof * count) / count
    assert np.allclose(consistency.nis_band(dof, count, level), expected, rtol=1e-9)


def test_the_gates_are_the_one_in_a_billion_quantiles() -> None:
    gates = consistency.nis_gates()
    assert gates.shape == (10,)
    assert np.isinf(gates[0])
    assert np.allclose(chi2.sf(gates[1:], np.arange(1, 10)), 1e-9, rtol=1e-6)


class Clean:
    """Blocks of a second of a clean unit, and a filter that averages them: estimate and sd of the running mean."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.monitor = ConvergenceMonitor(0.05)
        self.monitor.begin(0.0)
        self.seconds, self.sum = 0, np.zeros(6)
        self.turned_off = 0
        self.before: tuple[float | None, ...] = (None,) * 6

    def run(self, seconds: int, shift: np.ndarray | None = None, *, known: bool = True) -> None:
        shift = np.zeros(6) if shift is None else shift
        for _ in range(seconds):
            self.seconds += 1
            residual = self.rng.standard_normal(6) * SIGMA
            self.sum += residual
            mean = self.sum / self.seconds
            seen = residual + shift if known else np.full(6, np.nan)
            self.monitor.close(float(self.seconds), seen, mean, mean, SIGMA / np.sqrt(self.seconds))
            since = self.monitor.convergence().since
            self.turned_off += sum(b is not None and s is None for b, s in zip(self.before, since, strict=True))
            self.before = since


def test_a_day_of_clean_data_turns_a_bias_off_at_most_once() -> None:
    """Four hours of six biases at 4 Hz, which is a day of one: once converged they stay so, seen every 5 s."""
    dt, part, rng = 0.25, 20, np.random.default_rng(61)
    rate, force = LEVEL.rates_and_forces()
    estimator = Estimator(Settings(dt), every=np.inf)
    before: tuple[float | None, ...] = (None,) * 6
    turned_off = 0
    for first in range(0, 4 * 3600 * 4, part):
        noise = rng.standard_normal((part, 6)) * SIGMA / np.sqrt(dt)
        t = (first + np.arange(part)) * dt
        list(runner.rows(estimator, t, rate + noise[:, 3:], force + noise[:, :3], last=False))
        since = estimator.monitor.convergence().since
        turned_off += sum(b is not None and s is None for b, s in zip(before, since, strict=True))
        before = since
    assert all(since is not None for since in before)
    assert turned_off <= 1


def test_the_monitor_does_not_flicker_in_its_first_minutes() -> None:
    """The noise is measured on few blocks then: 60 starts of 100 s of six biases, ten hours of one, at most one off."""
    turned_off = 0
    for seed in range(60):
        clean = Clean(1000 + seed)
        clean.run(100)
        assert any(since is not None for since in clean.before)
        turned_off += clean.turned_off
    assert turned_off <= 1


@pytest.mark.parametrize("axis", range(6))
def test_a_jump_of_one_bias_takes_back_that_bias_alone(axis: int) -> None:
    clean = Clean(31 + axis)
    clean.run(100)
    assert all(since is not None for since in clean.before)
    shift = np.zeros(6)
    shift[axis] = 30.0 * SIGMA[axis] / np.sqrt(10.0)
    clean.run(9, shift)
    assert clean.before[axis] is not None, "ten seconds have not gone by"
    clean.run(11, shift)
    assert clean.before[axis] is None
    assert all(since is not None for k, since in enumerate(clean.before) if k != axis)


def test_the_verdict_comes_back_with_the_bias() -> None:
    clean = Clean(41)
    clean.run(100)
    shift = np.zeros(6)
    shift[4] = 30.0 * SIGMA[4]
    clean.run(25, shift)
    assert clean.before[4] is None
    clean.run(25)
    assert clean.before[4] > 125.0


def test_without_residuals_the_first_two_conditions_judge() -> None:
    """A trajectory without attitude says nothing of a perfect unit: small and steady is converged, no mean is told."""
    clean = Clean(51)
    clean.run(100, known=False)
    assert all(since is not None for since in clean.before)
    verdict = clean.monitor.convergence()
    assert verdict.apparent is None
    assert clean.monitor.noise() is None


def test_without_residuals_a_bias_that_is_uncertain_or_wanders_does_not_converge() -> None:
    tolerance = consistency.TOLERANCE
    uncertain, wandering = ConvergenceMonitor(0.05), ConvergenceMonitor(0.05)
    for monitor in (uncertain, wandering):
        monitor.begin(0.0)
    nothing = np.full(6, np.nan)
    for k in range(1, 100):
        steady, moved = np.zeros(6), 0.5 * k * tolerance
        uncertain.close(float(k), nothing, steady, steady, 1.01 * tolerance)
        wandering.close(float(k), nothing, moved - 0.25 * tolerance, moved, 0.1 * tolerance)
    assert uncertain.convergence().since == (None,) * 6
    assert wandering.convergence().since == (None,) * 6


def test_tolerances_are_the_resolutions_of_table_1() -> None:
    assert np.allclose(consistency.TOLERANCE[:3] / STANDARD_GRAVITY, 0.6e-3)
    assert np.allclose(np.rad2deg(consistency.TOLERANCE[3:]), 0.05)


def remainders(drift: np.ndarray, seconds: int = 120, seeds: int = 60) -> np.ndarray:
    """Ratios of six channels after so many seconds with a drift of so much a second, shape (seeds, 6)."""
    found = []
    for seed in range(seeds):
        clean = Clean(7000 + seed)
        for second in range(seconds):
            # the filter's mean follows the drift as a mean does
            clean.sum += drift * second
            clean.run(1, drift * second)
        remainder = clean.monitor.remainder()
        assert remainder.windows == consistency.REMAINDER_WINDOWS
        assert remainder.ratio is not None
        found.append(remainder.ratio)
    return np.array(found)


def test_the_remainder_is_one_where_nothing_is_wrong() -> None:
    ratios = remainders(np.zeros(6), seconds=600, seeds=15)
    assert np.sqrt(np.mean(ratios**2)) == pytest.approx(1.0, abs=0.1)
    # beyond 2.5 is chi-square of six beyond 37.5: once in a million
    assert ratios.max() < 2.5


@pytest.mark.parametrize("axis", range(6))
def test_the_remainder_shows_a_drift_that_no_sample_shows(axis: int) -> None:
    drift = np.zeros(6)
    drift[axis] = SIGMA[axis] / 40.0
    ratios = remainders(drift, seeds=10)
    assert np.all(ratios[:, axis] > 2.0)
    assert np.sqrt(np.mean(np.delete(ratios, axis, axis=1) ** 2)) == pytest.approx(1.0, abs=0.25)


def test_the_remainder_of_the_filter_itself_is_one_without_and_more_with_a_temperature_effect() -> None:
    dt, rate, force = 0.25, *LEVEL.rates_and_forces()
    for warm, low, high in ((0.0, 0.5, 1.3), (1.0, 2.0, np.inf)):
        squares = []
        for seed in range(8):
            rng = np.random.default_rng(90 + seed)
            t = np.arange(480) * dt
            noise = rng.standard_normal((480, 6)) * SIGMA / np.sqrt(dt)
            # 0.25 deg/s and 5 mg in the first minutes
            effect = np.outer(warm * (1.0 - np.exp(-t / 60.0)), [0.05] * 3 + [0.25 * np.pi / 180.0] * 3)
            estimator = Estimator(Settings(dt), every=np.inf)
            readings = noise + effect
            list(runner.rows(estimator, t, rate + readings[:, 3:], force + readings[:, :3], last=True))
            remainder = estimator.monitor.remainder()
            assert remainder.windows == consistency.REMAINDER_WINDOWS
            squares.append(remainder.ratio**2)
        rms = np.sqrt(np.mean(squares, axis=0))
        assert np.all((low < rms) & (rms < high)), rms


def test_the_remainder_is_told_from_windows_that_do_not_overlap() -> None:
    clean = Clean(3)
    counts = []
    for _ in range(90):
        clean.run(1)
        counts.append(clean.monitor.remainder().windows)
    assert counts == [min(6, second // 10) for second in range(1, 91)]
    blind = Clean(3)
    blind.run(60, known=False)
    assert blind.monitor.remainder() == consistency.Remainder(None, 0)


@pytest.mark.parametrize("begin", [8271.909925047, 29984.285970256, 74606.144272509])
def test_a_sample_a_nanosecond_before_the_end_of_a_block_ends_it(begin: float) -> None:
    """Hours on, where rounding has it just before the end and just within the tolerance: the end moves on once."""
    monitor = ConvergenceMonitor(0.05)
    monitor.begin(begin)
    t = round((monitor.end - 1e-9) * 1e9) * 1e-9
    assert monitor.end - 1e-9 <= t < monitor.end
    monitor.close(t, np.zeros(6), np.zeros(6), np.zeros(6), np.ones(6))
    assert monitor.end == begin + 2.0
