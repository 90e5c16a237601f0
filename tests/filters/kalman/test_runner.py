from collections.abc import Callable

import numpy as np
import pytest
from helpers.filtering import normalised, same_however_they_come
from scipy import stats

from filters import attitude
from filters.imu import IMU400CD_200, Noise
from filters.kalman import consistency, engines, layout, runner, spkf
from filters.kalman.filter_input import FilterInput, draws
from filters.kalman.kernels.correction import MAX_REJECTIONS
from filters.kalman.rows import Estimate, estimate_of
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings
from filters.motion import alignment, reference
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from filters.motion.segments import Dwell, Rate
from filters.state import PAPER_SITE, NavState

DT = 0.05
RATE, FORCE = reference.level(PAPER_SITE).rates_and_forces()


def noisy(
    n: int, seed: int = 0, C_nb: np.ndarray | None = None, bias: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples at 20 Hz of a still unit with Table 1 noise, body axes: t, gyro, accel; bias is accel then gyro."""
    rng = np.random.default_rng(seed)
    C_nb = np.eye(3) if C_nb is None else C_nb
    bias = np.zeros(6) if bias is None else bias
    gyro = C_nb.T @ RATE + bias[3:] + rng.normal(size=(n, 3)) * np.deg2rad(0.075) / np.sqrt(DT)
    accel = C_nb.T @ FORCE + bias[:3] + rng.normal(size=(n, 3)) / 60 / np.sqrt(DT)
    return np.arange(n) * DT, gyro, accel


def feed(estimator: Estimator, samples: tuple[np.ndarray, np.ndarray, np.ndarray], last: bool = True) -> list[Estimate]:
    return list(runner.run(estimator, *samples, last=last))


def test_drawn_noise_depends_on_seed_and_sample_number_alone() -> None:
    samples = noisy(20)

    def innovations(seed: int) -> list[float]:
        estimator = Estimator(Settings(DT, measurements="drawn", seed=seed))
        return [e.nis for e in feed(estimator, samples) if e.dof]

    assert innovations(3) == innovations(3)
    assert innovations(3) != innovations(4)


@pytest.mark.parametrize("name", ["spkf", "spkf-paper", "ekf"])
def test_one_by_one_and_all_at_once_are_the_same_to_the_last_bit(name: str) -> None:
    n = 600 if name == "spkf" else 250
    t, gyro, accel = noisy(n, bias=np.array([0.05, 0, 0, 0, 0.01, 0]))
    for reference_name, measurements in (("level", "exact"), ("gravity", "drawn")):
        settings = Settings(DT, filter=name, reference=reference_name, measurements=measurements, seed=3)
        _, estimates = same_however_they_come(settings, (t, gyro, accel))
        assert len(estimates) == n


def test_the_compiled_step_is_the_readable_one() -> None:
    rng = np.random.default_rng(5)
    n = 300
    t = np.arange(n) * DT
    t[200:] += 3.0
    turn = np.zeros((n, 3))
    turn[60:160] = np.deg2rad([40.0, -90.0, 150.0])
    gyro = RATE + turn + rng.normal(size=(n, 3)) * 5e-3
    accel = FORCE + rng.normal(size=(n, 3)) * 0.1
    noise = Noise((0.02, 0.01, 0.03), (1e-3, 2e-3, 3e-3), (1e-4, 0.0, 0.0), (0.0, 1e-5, 0.0))
    still = alignment.level_by_gravity(PAPER_SITE, attitude.from_rpy(0.3, -1.3, 0.0).T @ FORCE, 0.1)
    for linear, found in ((False, reference.level(PAPER_SITE)), (True, still)):
        run = Settings(DT, noise=noise), linear, 0.0
        fast, slow = engines.Compiled(*run), engines.Stepwise(spkf, *run)
        nav, P0_sd = found.start()
        known = np.repeat(found.known(t, -np.inf, gyro), n, axis=0)
        # rows are known now and then only, as on a table that moves
        known[60:200, reference.VARIANCES] = -1.0
        known[::3, reference.VARIANCES][:, 2:5] = -1.0
        samples = FilterInput(t, gyro, accel, known, draws(7, 0, n))
        for engine in (fast, slow):
            engine.start(nav, np.append(P0_sd, [0.2] * 3 + [0.03] * 3))
        k = 0
        while k < n:
            after = fast.advance(samples, k, np.inf)
            assert after == slow.advance(samples, k, np.inf)
            a, b = (engine.out[: after[1]] for engine in (fast, slow))
            for x, y in zip(a, b, strict=True):
                p, q = (estimate_of(row).belief for row in (x, y))
                sd = np.sqrt(np.diag(q.P))
                assert np.max(np.abs(p.nav.minus(q.nav)) / sd) < 1e-6
                assert np.max(np.abs(p.P - q.P) / np.outer(sd, sd)) < 1e-6
                assert x[layout.OUT_DOF] == y[layout.OUT_DOF]
                assert np.allclose(x[layout.OUT_NIS], y[layout.OUT_NIS], rtol=1e-6, equal_nan=True)
            k = after[0]
        assert np.allclose(fast.sums, slow.sums, rtol=1e-6)


@pytest.mark.parametrize("name", ["spkf", "ekf", "spkf-paper"])
def test_a_gap_is_counted_and_widens_the_band_as_a_held_sample_does(name: str) -> None:
    """Five seconds missing: one gap, and the attitude's variance grows as N² T²/period, not N² T."""
    t, gyro, accel = noisy(105)
    t[100:] += 5.0
    estimator = Estimator(Settings(DT, filter=name))
    estimates = feed(estimator, (t, gyro, accel))
    assert len(estimator.gaps) == 1
    assert estimator.gaps[0] == pytest.approx((4.95, 5.05))
    predicted = spkf.process_noise(Noise.of(IMU400CD_200), np.eye(3), 5.05, 5.05 / DT)
    assert np.isclose(np.sqrt(predicted[6, 6]), np.deg2rad(0.075) * 5.05 / np.sqrt(DT))
    # after the update the reference is all that is left of attitude
    assert np.sqrt(estimates[100].belief.P[6, 6]) == pytest.approx(np.deg2rad(0.1), rel=0.05)
    assert np.sqrt(estimates[99].belief.P[6, 6]) < np.deg2rad(0.06)


def test_flagged_and_missing_samples_leave_errors_within_their_band() -> None:
    total = 0.0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        bias = np.concatenate([rng.uniform(-0.1, 0.1, 3), rng.uniform(-0.015, 0.015, 3)])
        t, gyro, accel = noisy(500, seed=seed, bias=bias)
        keep = rng.random(500) > 0.2
        estimator = Estimator(Settings(DT), every=np.inf)
        feed(estimator, (t[keep], gyro[keep], accel[keep]))
        total += float(np.sum(normalised(estimator, bias) ** 2))
    assert 177.0 < total < 312.0, f"{total:.1f} of 240"  # chi2.ppf([.001, .999], 240)


@pytest.mark.parametrize(
    ("name", "kind", "seeds"),
    [("spkf", "level", 20), ("spkf", "gravity", 20), ("ekf", "level", 6), ("spkf-paper", "level", 2)],
)
def test_behind_a_long_gap_the_biases_are_as_good_as_before_and_as_the_filter_says(
    name: str, kind: str, seeds: int
) -> None:
    n, total = 160, 0.0
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        bias = np.concatenate([rng.uniform(-0.1, 0.1, 3), rng.uniform(-0.015, 0.015, 3)])
        t, gyro, accel = noisy(2 * n, seed=seed, bias=bias)
        t[n:] += 30.0
        estimator = Estimator(Settings(DT, filter=name, reference=kind))
        estimates = feed(estimator, (t, gyro, accel))
        assert estimator.rejected == 0
        before, first, last = (np.diag(estimates[k].belief.P) for k in (n - 1, n, -1))
        assert np.all(first[9:] >= 0.99 * before[9:])
        assert np.all(last[9:] < before[9:])
        # navigation is known by the reference alone, as at the start
        known = slice(0, 9 if kind == "level" else 6)
        assert first[known] == pytest.approx(reference.PAPER_R_SD[known] ** 2, rel=0.05)
        total += float(np.sum((normalised(estimator, bias) ** 2)[2:]))
    low, high = stats.chi2.ppf([0.001, 0.999], 4 * seeds)
    assert low < total < high, f"{total:.1f} of {4 * seeds}"


def test_behind_a_gap_that_ends_in_motion_navigation_begins_anew_at_rest() -> None:
    """A table that turns while samples come again: nothing is known of it before the next dwell."""
    profile = Profile((Dwell((0.0, 0.0, 0.0), 10.0), Rate("inner", 9.0, 10.0), Dwell((0.0, 0.0, 90.0), 20.0)))
    n = 800
    t, gyro, accel = noisy(n, seed=1)
    turning = (t >= 10.0) & (t < 20.0)
    gyro[turning, 2] += np.deg2rad(9.0)
    keep = (t < 8.0) | (t > 15.0)
    estimator = Estimator(Settings(DT, reference="profile", motion=profile))
    estimates = feed(estimator, (t[keep], gyro[keep], accel[keep]))
    assert estimator.rejected == 0
    assert not estimator.alarms()
    nav, P = estimates[-1].belief.nav, estimates[-1].belief.P
    assert np.all(np.abs(nav.gyro_bias) < 4.0 * np.sqrt(np.diag(P)[12:]))


@pytest.mark.parametrize("name", ["spkf", "ekf", "spkf-paper"])
def test_a_long_gap_is_the_same_however_samples_come(name: str) -> None:
    t, gyro, accel = noisy(120)
    t[50:] += 7.0
    t[90:] += 3600.0
    whole, _ = same_however_they_come(Settings(DT, filter=name), (t, gyro, accel))
    assert [seconds for _, seconds in whole.gaps] == pytest.approx([7.0 + DT, 3600.0 + DT])


def test_outliers_of_a_reference_are_left_out_and_counted() -> None:
    n = 400
    t, gyro, accel = noisy(n)
    values = np.tile([PAPER_SITE.latitude, PAPER_SITE.longitude, PAPER_SITE.height, 0, 0, 0, 0, 0, 0], (n, 1))
    values[200, 3] = 3.0
    settings = Settings(DT, reference="trajectory", motion=Trajectory(t, values))
    estimator = Estimator(settings)
    estimates = feed(estimator, (t, gyro, accel))
    assert estimator.rejected == 1
    assert abs(estimates[200].belief.nav.velocity_n[0]) < 0.1
    assert estimator.alarms() == []
    values[200:, 3] = 3.0
    lasting = Estimator(Settings(DT, reference="trajectory", motion=Trajectory(t, values)))
    feed(lasting, (t, gyro, accel))
    assert lasting.rejected >= MAX_REJECTIONS
    assert any("left out as outliers" in alarm for alarm in lasting.alarms())


def test_a_partly_known_attitude_corrects_what_it_knows() -> None:
    n = 200
    bias = np.array([0, 0, 0, 0, 0, 0.01])
    t, gyro, accel = noisy(n, bias=bias)
    values = np.tile([PAPER_SITE.latitude, PAPER_SITE.longitude, PAPER_SITE.height, 0, 0, 0, np.nan, np.nan, 0], (n, 1))
    values[0, 6:] = 0.0
    sds = []
    for unknown in (False, True):
        values[1:, 8] = np.nan if unknown else 0.0
        estimator = Estimator(Settings(DT, reference="trajectory", motion=Trajectory(t, values)))
        last = feed(estimator, (t, gyro, accel))[-1]
        sds.append(np.sqrt(last.belief.P[14, 14]))
        if not unknown:
            assert abs(last.belief.nav.gyro_bias[2] - 0.01) < 4 * sds[0]
            assert estimator.observable[5]
        else:
            assert not estimator.observable[5]
    assert sds[0] < 0.1 * sds[1]


def test_attitude_is_found_from_a_trajectory_that_moves() -> None:
    rng = np.random.default_rng(8)
    n = 2400
    t = np.arange(n) * DT
    speed = np.clip(t - 40.0, 0.0, 15.0)
    heading = 2.2 + 0.1 * np.clip(t - 50.0, 0.0, None)
    velocity = np.stack([speed * np.cos(heading), speed * np.sin(heading), np.zeros(n)], axis=1)
    gyro, accel = np.empty((n, 3)), np.empty((n, 3))
    change = np.gradient(velocity, DT, axis=0)
    bias = np.array([0.01, -0.006, 0.004])
    position = np.cumsum(velocity, axis=0) * DT
    values = np.full((n, 9), np.nan)
    nav = NavState.at_rest(PAPER_SITE, np.eye(3))
    for k in range(n):
        C = attitude.from_rpy(0.1, -0.05, float(heading[k]))
        gyro[k] = C.T @ (RATE + np.array([0, 0, 0.1 * (t[k] > 50.0)])) + bias + rng.normal(size=3) * 1e-3 / np.sqrt(DT)
        accel[k] = C.T @ (change[k] + FORCE) + rng.normal(size=3) * 0.01 / np.sqrt(DT)
        moved = nav.plus(np.concatenate([position[k], np.zeros(12)]))
        if k % 5 == 0:
            values[k, :6] = moved.latitude, moved.longitude, moved.height, *velocity[k]
    fixes = Trajectory(t[::5], values[::5])
    estimator = Estimator(Settings(DT, reference="trajectory", motion=fixes))
    estimates = feed(estimator, (t, gyro, accel))
    assert len(estimates) == n
    assert abs(attitude.to_rpy(estimates[0].belief.nav.C_nb)[2] - 2.2) < np.deg2rad(10)
    nav, sd = estimates[-1].belief.nav, np.sqrt(np.diag(estimates[-1].belief.P))
    assert np.all(np.abs(nav.gyro_bias - bias) < 4 * sd[12:])
    assert sd[14] < np.deg2rad(0.2)


def test_gravity_reference_finds_the_attitude_and_the_vertical_bias() -> None:
    C_nb = attitude.from_rpy(np.deg2rad(12), np.deg2rad(-16), 0.0)
    bias = np.array([0.0, 0.0, 0.08, 0.004, -0.003, 0.006])
    estimator = Estimator(Settings(DT, reference="gravity"))
    estimates = feed(estimator, noisy(1200, C_nb=C_nb, bias=bias))
    assert len(estimates) == 1200
    assert estimator.observable == (False, False, True, True, True, True)
    nav, sd = estimates[-1].belief.nav, np.sqrt(np.diag(estimates[-1].belief.P))
    assert np.all(np.abs(nav.gyro_bias - bias[3:]) < 4 * sd[12:] + np.deg2rad(0.0042))
    assert abs(nav.accel_bias[2] - bias[2]) < 4 * sd[11]
    assert np.all(sd[9:11] > 5e-3 * 9.8), "horizontal accelerometer biases must not look known"
    assert np.all(np.abs(attitude.to_rpy(nav.C_nb)[:2] - np.deg2rad([12, -16])) < np.deg2rad(1.0))


def test_a_bias_that_jumps_loses_its_convergence_after_ten_seconds() -> None:
    estimator = Estimator(Settings(DT))
    jump = np.array([0, 0, 0, 0, np.deg2rad(3.0), 0])
    feed(estimator, noisy(800), last=False)
    assert estimator.converged
    for t, gyro, accel in zip(*noisy(700, seed=1, bias=jump), strict=True):
        runner.step(estimator, float(t) + 40.0, gyro, accel)
        since = estimator.monitor.convergence().since
        if since[4] is None:
            break
    assert since[4] is None
    assert since[3] is not None
    assert 49.0 <= t + 40.0 <= 62.0


def test_noise_is_measured_through_drift_and_steps() -> None:
    rng = np.random.default_rng(13)
    monitor = consistency.ConvergenceMonitor(0.1)
    monitor.begin(0.0)
    for t in range(1, 600):
        residual = rng.normal(size=6) * 0.02 + 1e-4 * t + 0.5 * (t > 300)
        monitor.close(float(t), residual, np.zeros(6), np.zeros(6), np.ones(6))
    noise = monitor.noise()
    assert noise is not None
    assert np.all(np.abs(noise / 0.02 - 1.0) < 0.15)


def test_spread_is_the_scatter_after_convergence() -> None:
    estimator = Estimator(Settings(DT))
    estimates = feed(estimator, noisy(900))
    moments = estimator.after_convergence
    errors = np.array([e.belief.nav.minus(reference.level(PAPER_SITE).nav) for e in estimates[-moments.count :]])
    assert np.allclose(moments.mean, errors.mean(axis=0), rtol=1e-6, atol=1e-12)
    assert np.max(np.abs(moments.covariance - np.cov(errors.T)) / np.outer(errors.std(0), errors.std(0))) < 1e-6


def test_draws_are_standard_normal_and_each_samples_own() -> None:
    whole = draws(4, 0, 10_000)
    assert np.array_equal(draws(4, 500, 20), whole[500:520])
    assert abs(whole.mean()) < 4 / np.sqrt(whole.size)
    assert abs(whole.var() - 1.0) < 4 * np.sqrt(2 / whole.size)
    assert np.max(np.abs(np.corrcoef(whole.T) - np.eye(9))) < 0.05


def turning(period: float) -> list[Estimate]:
    """Five samples at 20 deg/s."""
    turn = np.tile(np.deg2rad([0, 0, 20.0]), (5, 1))
    return feed(Estimator(Settings(period)), (np.arange(5) * period, turn, np.tile(FORCE, (5, 1))))


FAST = Profile((Dwell((0.0, 0.0, 0.0), 5.0), Dwell((0.0, 1.5, 0.0), 5.0)))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: turning(10.0), r"200 deg between two samples .* nothing is known of the rate"),
        (lambda: Estimator(Settings(10.0, reference="profile", motion=FAST)), r"deg between two samples at 0\.1 Hz"),
        (lambda: feed(Estimator(Settings(DT)), (np.zeros(2), *noisy(2)[1:])), "sample 1: time must increase"),
        (lambda: alignment.level_by_gravity(PAPER_SITE, np.array([0.0, 5.0, -5.0]), 0.1), "not at rest"),
        (lambda: Settings(DT, filter="nonsense"), '`filter` is "nonsense", not one of'),
        (lambda: Settings(DT, reference="nonsense"), '`reference` is "nonsense", not one of'),
        (lambda: Settings(DT, measurements="nonsense"), '`measurements` is "nonsense", not one of'),
    ],
)
def test_what_no_filter_can_use_is_refused_with_the_reason(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()


def test_rotation_between_fast_samples_is_welcome() -> None:
    assert len(turning(DT)) == 5
