import numpy as np
import pytest
from helpers.filtering import normalised
from scipy.spatial.transform import Rotation

from filters import simulation, state
from filters.imu import IMU400CD_200, Noise
from filters.kalman import runner, spkf
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings
from filters.motion import reference
from filters.motion.profile import Profile
from filters.motion.segments import Dwell
from filters.state import PAPER_SITE

LEVEL = reference.level(PAPER_SITE)
LOOP_HZ = 400 / 3


def averaged(unit: simulation.StillUnit, seconds: float, factor: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Readings of a unit averaged down by a whole factor: t, gyro, accel."""
    n = int(seconds * LOOP_HZ) // factor
    s = unit.samples(n * factor)
    return np.arange(n) * factor / LOOP_HZ, s.gyro.reshape(n, factor, 3).mean(1), s.accel.reshape(n, factor, 3).mean(1)


def filtered(
    unit_seed: int, seconds: float = 40.0, factor: int = 7, **settings: object
) -> tuple[Estimator, simulation.Truth]:
    """Run the filter over a simulated still unit."""
    unit = simulation.StillUnit(unit_seed, LOOP_HZ)
    t, gyro, accel = averaged(unit, seconds, factor)
    estimator = Estimator(Settings(factor / LOOP_HZ, **settings), every=np.inf)  # type: ignore[arg-type]
    list(runner.run(estimator, t, gyro, accel))
    return estimator, unit.truth


def test_bias_errors_fit_their_standard_deviations_over_twenty_seeds() -> None:
    z = np.array([normalised(*filtered(seed, seconds=30.0, factor=14)) for seed in range(20)])
    total = float(np.sum(z**2))
    assert 77.0 < total < 174.0, f"{total:.1f} of 120"  # chi2.ppf([.001, .999], 120)
    assert np.all(np.abs(z) < 4.0)
    assert np.all(np.abs(z.mean(axis=0)) < 3.5 / np.sqrt(20))


def test_standard_deviations_and_convergence_meet_the_operators_bar_in_a_minute() -> None:
    estimator, _ = filtered(11, seconds=60.0)
    sd = np.sqrt(np.diag(estimator.latest.belief.P))
    assert np.all(sd[state.ACCEL_BIAS] < 0.6e-3 * 9.80665)
    assert np.all(sd[state.GYRO_BIAS] < np.deg2rad(0.05))
    assert estimator.converged
    assert estimator.alarms() == []


@pytest.mark.parametrize("kappa", [0.0, spkf.PAPER_KAPPA])
def test_drawn_measurements_make_nis_a_test_that_the_filter_passes(kappa: float) -> None:
    estimator, _ = filtered(2, measurements="drawn", seed=5, kappa=kappa)
    mean = estimator.nis_sum / estimator.nis_count
    assert abs(mean - 9.0) < 3.3 * np.sqrt(2 * 9 / estimator.nis_count)


def test_exact_measurements_make_nis_small() -> None:
    estimator, _ = filtered(2)
    assert estimator.nis_sum / estimator.nis_count < 1.0


def test_correction_is_that_of_the_information_form() -> None:
    rng = np.random.default_rng(9)
    A = rng.normal(size=(15, 15))
    P = A @ A.T + 15 * np.eye(15)
    belief, innovation = spkf.correct(spkf.Belief(LEVEL.nav, P), LEVEL.nav, LEVEL.rows, LEVEL.R_sd)
    information = np.linalg.inv(P)
    information[:9, :9] += np.diag(LEVEL.R_sd**-2)
    assert np.allclose(belief.P, np.linalg.inv(information), rtol=1e-6, atol=1e-9)
    assert innovation.nis == 0.0


def test_the_start_is_the_papers_noise_set() -> None:
    estimator = Estimator(Settings(0.05))
    runner.step(estimator, 0.0, *LEVEL.rates_and_forces())
    sd = np.sqrt(np.diag(estimator.latest.belief.P))
    assert np.allclose(sd[:9], [10, 10, 30, 0.1, 0.1, 0.1, *np.deg2rad([0.1, 0.1, 0.5])])
    assert np.allclose(sd[9:], [18e-3 * 9.80665] * 3 + [np.deg2rad(1.5)] * 3)


def test_process_noise_is_table_1_times_dt() -> None:
    sd = np.sqrt(np.diag(spkf.process_noise(Noise.of(IMU400CD_200), np.eye(3), 1.0)))
    assert np.allclose(sd[state.VELOCITY], 1 / 60)
    assert np.allclose(sd[state.ATTITUDE], np.deg2rad(0.075))
    assert np.all(sd[[0, 1, 2, 9, 10, 11, 12, 13, 14]] == 0.0)


def test_a_covariance_that_is_none_is_an_error_in_words() -> None:
    P = np.eye(15)
    P[9, 9] = -1.0
    with pytest.raises(spkf.DivergenceError, match="state covariance"):
        spkf.predict(spkf.Belief(LEVEL.nav, P), np.zeros(3), np.zeros(3), 0.1, 9.8, np.zeros((15, 15)))


def test_a_gated_correction_changes_nothing() -> None:
    belief = spkf.start(LEVEL.nav, np.ones(15))
    far = LEVEL.nav.plus(np.concatenate([np.zeros(3), [50.0], np.zeros(11)]))
    after, innovation = spkf.correct(belief, far, LEVEL.rows, LEVEL.R_sd, gate=66.0)
    assert after is belief
    assert not innovation.accepted
    assert innovation.nis > 66.0


def test_attitude_near_ninety_degrees_of_pitch_is_nothing_special() -> None:
    tilted = Profile((Dwell((0.0, np.deg2rad(89.9), 0.0), 20.0),))
    C_nb = Rotation.from_euler("XYZ", [0.0, np.deg2rad(89.9), 0.0]).as_matrix()
    rate, force = (C_nb.T @ v for v in LEVEL.rates_and_forces())
    rng = np.random.default_rng(3)
    truth = simulation.draw(1)
    gyro = rate + truth.gyro_bias + rng.normal(size=(400, 3)) * IMU400CD_200.gyro_arw / np.sqrt(0.05)
    accel = force + truth.accel_bias + rng.normal(size=(400, 3)) * IMU400CD_200.accel_vrw / np.sqrt(0.05)
    estimator = Estimator(Settings(0.05, reference="profile", motion=tilted))
    list(runner.run(estimator, np.arange(400) * 0.05, gyro, accel))
    assert np.all(np.abs(normalised(estimator, truth)) < 4.0)
    assert np.all(np.abs(normalised(estimator, simulation.Truth(np.zeros(3), np.zeros(3)))) > 1e-3)
