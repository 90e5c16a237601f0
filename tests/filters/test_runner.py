import numpy as np
import pytest

from filters import attitude, consistency, reference, runner, simulation, spkf
from filters.runner import Estimator, Settings
from filters.state import PAPER_SITE

DT = 0.05
RATE, FORCE = reference.level(PAPER_SITE).rates_and_forces()


def noisy(
    n: int, seed: int = 0, C_nb: np.ndarray | None = None, bias: np.ndarray | None = None
) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Samples at 20 Hz of a still unit with Table 1 noise, body axes; bias is accel then gyro."""
    rng = np.random.default_rng(seed)
    C_nb = np.eye(3) if C_nb is None else C_nb
    bias = np.zeros(6) if bias is None else bias
    gyro = C_nb.T @ RATE + bias[3:] + rng.normal(size=(n, 3)) * np.deg2rad(0.075) / np.sqrt(DT)
    accel = C_nb.T @ FORCE + bias[:3] + rng.normal(size=(n, 3)) / 60 / np.sqrt(DT)
    return [(k * DT, gyro[k], accel[k]) for k in range(n)]


def test_equal_samples_give_equal_estimates_bit_for_bit() -> None:
    """Two runs over the same samples agree in every bit of state and covariance."""
    samples = noisy(200)
    first, second = (list(runner.run(Estimator(Settings(DT)), samples)) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a.belief.P, b.belief.P)
        assert np.array_equal(a.belief.nav.gyro_bias, b.belief.nav.gyro_bias)


def test_drawn_noise_depends_on_seed_and_sample_number_alone() -> None:
    """The same seed repeats the innovations, another one does not."""
    samples = noisy(20)

    def innovations(seed: int) -> list[float]:
        estimator = Estimator(Settings(DT, measurements="drawn", seed=seed))
        return [e.innovation.nis for e in runner.run(estimator, samples) if e.innovation is not None]

    assert innovations(3) == innovations(3)
    assert innovations(3) != innovations(4)


def test_a_gap_is_counted_and_widens_the_band_as_a_held_sample_does() -> None:
    """Ten seconds missing: one gap, and the attitude's variance grows as N² T²/period, not N² T."""
    samples = noisy(100)
    late = [(t + 10.0, g, a) for t, g, a in noisy(5, seed=1)]
    estimator = Estimator(Settings(DT))
    for sample in samples:
        runner.step(estimator, *sample)
    assert estimator.latest is not None
    predicted = spkf.process_noise(Settings(DT).spec, 5.05, 5.05 / DT)
    assert np.isclose(np.sqrt(predicted[6]), np.deg2rad(0.075) * 5.05 / np.sqrt(DT))
    for sample in late:
        runner.step(estimator, *sample)
    assert len(estimator.gaps) == 1
    assert estimator.gaps[0] == pytest.approx((4.95, 5.05))


def test_time_that_does_not_increase_is_refused() -> None:
    """The error names the sample and both times."""
    estimator = Estimator(Settings(DT))
    runner.step(estimator, 0.0, RATE, FORCE)
    with pytest.raises(ValueError, match="sample 1"):
        runner.step(estimator, 0.0, RATE, FORCE)


@pytest.mark.parametrize("field", ["filter", "reference", "measurements"])
def test_a_name_that_is_none_is_refused_with_those_there_are(field: str) -> None:
    """Settings say what they may be."""
    with pytest.raises(ValueError, match=f'`{field}` is "nonsense", not one of'):
        Settings(DT, **{field: "nonsense"})


def test_gravity_reference_finds_the_attitude_and_the_vertical_bias() -> None:
    """Tilted by 20°: gyro biases and the vertical accelerometer bias within 4 sd; horizontals are not observable."""
    C_nb = attitude.from_rpy(np.deg2rad(12), np.deg2rad(-16), 0.0)
    bias = np.array([0.0, 0.0, 0.08, 0.004, -0.003, 0.006])
    estimator = Estimator(Settings(DT, reference="gravity"))
    estimates = list(runner.run(estimator, noisy(1200, C_nb=C_nb, bias=bias)))
    assert len(estimates) == 1200
    assert estimator.observable == (False, False, True, True, True, True)
    nav, sd = estimates[-1].belief.nav, np.sqrt(np.diag(estimates[-1].belief.P))
    assert np.all(np.abs(nav.gyro_bias - bias[3:]) < 4 * sd[12:] + np.deg2rad(0.0042))
    assert abs(nav.accel_bias[2] - bias[2]) < 4 * sd[11]
    assert np.all(sd[9:11] > 5e-3 * 9.8), "horizontal accelerometer biases must not look known"
    assert np.all(np.abs(attitude.to_rpy(nav.C_nb)[:2] - np.deg2rad([12, -16])) < np.deg2rad(1.0))


def test_a_log_shorter_than_the_alignment_is_used_all_the_same() -> None:
    """Five seconds with reference gravity give a hundred estimates at the end."""
    assert len(list(runner.run(Estimator(Settings(DT, reference="gravity")), noisy(100)))) == 100


def test_a_moving_unit_has_no_gravity_reference() -> None:
    """A mean force that is not gravity is an error, not an attitude."""
    with pytest.raises(ValueError, match="not at rest"):
        reference.gravity(PAPER_SITE, np.array([0.0, 5.0, -5.0]), 0.1)


def test_a_wrong_accelerometer_sign_raises_an_alarm_that_names_it() -> None:
    """The filter would converge on a bias of 2 g; the alarm says what is wrong instead."""
    estimator = Estimator(Settings(DT))
    for t, gyro, accel in noisy(400):
        runner.step(estimator, t, gyro, -accel)
    assert any("accelerometer sign" in alarm for alarm in estimator.alarms())


def test_a_bias_of_several_times_the_limit_raises_an_alarm_that_names_it() -> None:
    """5 deg/s on x is five times Table 1."""
    estimator = Estimator(Settings(DT))
    for sample in noisy(400, bias=np.array([0, 0, 0, np.deg2rad(5.0), 0, 0])):
        runner.step(estimator, *sample)
    assert ["x gyro" in alarm for alarm in estimator.alarms()] == [True]


def test_a_bias_that_jumps_loses_its_convergence_after_ten_seconds() -> None:
    """Ten seconds of residuals outside the band take the verdict back, on that axis alone."""
    estimator = Estimator(Settings(DT))
    jump = np.array([0, 0, 0, 0, np.deg2rad(3.0), 0])
    for sample in noisy(800):
        runner.step(estimator, *sample)
    assert estimator.converged
    for t, gyro, accel in noisy(700, seed=1, bias=jump):
        runner.step(estimator, t + 40.0, gyro, accel)
        since = estimator.gauge.convergence().since
        if since[4] is None:
            break
    assert since[4] is None
    assert since[3] is not None
    assert 49.0 <= t + 40.0 <= 62.0


def test_a_clean_hour_never_loses_its_convergence() -> None:
    """3600 s of clean blocks at 1 Hz: once declared, no bias is taken back."""
    rng = np.random.default_rng(12)
    gauge = consistency.Gauge(1.0)
    sigma = np.repeat([1 / 60, np.deg2rad(0.075)], 3)
    sums = np.zeros(6)
    lost = 0
    before: tuple[float | None, ...] = (None,) * 6
    for k in range(1, 3601):
        residual = rng.normal(size=6) * sigma
        sums += residual
        gauge.add(float(k), residual, sums / k, sigma / np.sqrt(k))
        since = gauge.convergence().since
        lost += sum(b is not None and s is None for b, s in zip(before, since, strict=True))
        before = since
    assert all(s is not None for s in before)
    assert lost == 0


def test_noise_is_measured_through_drift_and_steps() -> None:
    """The median of block differences gives the white level within 15 % though the mean wanders and jumps."""
    rng = np.random.default_rng(13)
    gauge = consistency.Gauge(0.1)
    for k in range(6000):
        t = k * 0.1
        residual = rng.normal(size=6) * 0.02 / np.sqrt(0.1) + 1e-4 * t + 0.5 * (t > 300)
        gauge.add(t, residual, np.zeros(6), np.ones(6))
    noise = gauge.noise()
    assert noise is not None
    assert np.all(np.abs(noise / 0.02 - 1.0) < 0.15)


def test_the_nis_band_is_that_of_the_mean_of_chi_squares() -> None:
    """9 rows, 1000 updates: 8.74 to 9.26."""
    low, high = consistency.nis_band(9, 1000)
    assert (round(low, 2), round(high, 2)) == (8.74, 9.26)


def test_spread_is_the_scatter_after_convergence() -> None:
    """The moments over converged samples are those of numpy."""
    rng = np.random.default_rng(14)
    errors = rng.normal(size=(50, 15))
    moments = runner.Moments()
    for error in errors:
        moments.add(error)
    assert np.allclose(moments.mean, errors.mean(axis=0))
    assert np.allclose(moments.scatter / 49, np.cov(errors.T))


def test_simulated_readings_go_forward_only() -> None:
    """A block that is gone is an error, not a wrong number."""
    unit = simulation.StillUnit(0, 133.0)
    unit.reading(5000)
    with pytest.raises(ValueError, match="gone"):
        unit.reading(10)


def test_equal_seeds_make_equal_units_and_others_do_not() -> None:
    """Truth and readings are functions of the seed."""
    a, b, c = (simulation.StillUnit(seed, 133.0).samples(10) for seed in (1, 1, 2))
    assert np.array_equal(a.gyro, b.gyro)
    assert not np.array_equal(a.gyro, c.gyro)
    assert np.all(np.abs(simulation.draw(1).gyro_bias) <= np.deg2rad(1.0))
