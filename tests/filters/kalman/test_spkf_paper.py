from types import ModuleType

import numpy as np
import pytest

from filters import attitude, simulation
from filters.imu import IMU400CD_200, STANDARD_GRAVITY, Noise
from filters.kalman import ekf, spkf, spkf_paper, strapdown
from filters.kalman.spkf_paper import PaperBelief
from filters.motion.reference import PAPER_R_SD
from filters.state import PAPER_SITE, NavState

DEG = np.pi / 180.0
GRAVITY = PAPER_SITE.gravity
ROWS = np.arange(9)
P0_SD = np.concatenate([PAPER_R_SD, np.full(3, 18e-3 * STANDARD_GRAVITY), np.full(3, 1.5 * DEG)])
LEVEL = NavState.at_rest(PAPER_SITE, np.eye(3))
NOISE = Noise.of(IMU400CD_200)


def attitude_of(roll: float, pitch: float, yaw: float) -> NavState:
    """At rest on the paper's site, angles in degrees."""
    return NavState.at_rest(PAPER_SITE, attitude.from_rpy(roll * DEG, pitch * DEG, yaw * DEG))


def filtered(
    module: ModuleType, known: NavState = LEVEL, kappa: float = 0.0, seed: int = 7, count: int = 600, rate: float = 20.0
) -> spkf.Belief:
    """What a filter holds after readings of a still unit, turned to the known attitude, in the common errors."""
    samples = simulation.StillUnit(seed, rate).samples(count)
    # the same deviations from the perfect readings at every attitude
    perfect_rate = known.C_nb.T @ (np.array([np.cos(PAPER_SITE.latitude), 0.0, -np.sin(PAPER_SITE.latitude)]) * 7.3e-5)
    level_force = np.array([0.0, 0.0, -GRAVITY])
    gyro = samples.gyro + perfect_rate
    accel = samples.accel - level_force + known.C_nb.T @ level_force
    belief = module.start(known, P0_SD)
    Q_d = spkf.process_noise(NOISE, known.C_nb, 1.0 / rate)
    for k in range(1, count):
        belief = module.predict(belief, gyro[k - 1 : k + 1], accel[k - 1 : k + 1], 1.0 / rate, GRAVITY, Q_d, kappa)
        belief, _ = module.correct(belief, known, ROWS, PAPER_R_SD, None, np.inf)
    return module.common(belief)


def difference(a: spkf.Belief, b: spkf.Belief) -> tuple[float, float]:
    """Largest difference of two estimates, and of their standard deviations, over the standard deviations of b."""
    sd = np.sqrt(np.diag(b.P))
    return float(np.max(np.abs(a.nav.minus(b.nav)) / sd)), float(np.max(np.abs(np.sqrt(np.diag(a.P)) / sd - 1.0)))


# level, and where units and angles have to be converted on the way in and out
@pytest.mark.parametrize(("known", "most"), [(LEVEL, 0.01), (attitude_of(30.0, -40.0, 110.0), 0.05)])
@pytest.mark.parametrize("module", [ekf, spkf_paper])
def test_filters_agree(module: ModuleType, known: NavState, most: float) -> None:
    estimate, sd = difference(filtered(module, known), filtered(spkf, known))
    assert estimate < most
    assert sd < 0.01


def test_both_kappas_agree_in_the_papers_case() -> None:
    estimate, sd = difference(filtered(spkf_paper, kappa=spkf.PAPER_KAPPA), filtered(spkf_paper))
    assert estimate < 1e-3
    assert sd < 1e-4


def test_yaw_at_180_degrees_is_nothing_special() -> None:
    estimates = []
    for yaw in (150.0, 180.0, -180.0):
        known = attitude_of(0.0, 0.0, yaw)
        nav = filtered(spkf_paper, known, count=200).nav
        estimates.append(np.concatenate([nav.accel_bias, nav.gyro_bias]))
    assert np.allclose(estimates[1], estimates[2], atol=1e-9)
    # the biases' gyro part hardly depends on heading; their standard deviation is 0.002 rad/s
    assert np.max(np.abs(estimates[1] - estimates[0])[3:]) < 1e-4


def test_a_mean_across_180_degrees_is_not_zero() -> None:
    belief = spkf_paper.start(attitude_of(0.0, 0.0, 179.99), P0_SD)
    rate = np.array([0.0, 0.0, 10.0]) * DEG
    after = spkf_paper.predict(belief, rate, np.array([0.0, 0.0, -GRAVITY]), 0.1, GRAVITY, np.zeros((15, 15)))
    assert abs(after.x[8] / DEG + 179.01) < 0.01
    assert np.sqrt(after.P[8, 8]) < 1.0 * DEG


def test_an_innovation_of_yaw_takes_the_short_way() -> None:
    belief = spkf_paper.start(attitude_of(0.0, 0.0, 179.0), P0_SD)
    after, innovation = spkf_paper.correct(belief, attitude_of(0.0, 0.0, -179.0), ROWS, PAPER_R_SD, None, np.inf)
    assert np.isclose(innovation.nu[8], 2.0 * DEG)
    assert np.isclose(abs(after.x[8]), np.pi)


def test_the_equations_agree_with_the_mechanisation() -> None:
    nav = attitude_of(10.0, -20.0, 170.0).plus(
        np.array([0, 0, 0, 30.0, -20.0, 10.0, 0, 0, 0, 0.01, -0.02, 0.03, 1e-3, 2e-3, -1e-3])
    )
    gyro = np.array([[4.0, -3.0, 9.0], [5.0, -2.0, 8.0]]) * DEG
    accel = np.array([[0.5, -1.0, -9.0], [0.0, 1.0, -9.5]])
    belief = spkf_paper.start(nav, P0_SD)
    x = belief.x
    for k in range(500):
        # back and forth between the two readings
        order = [0, 1] if k % 2 == 0 else [1, 0]
        x = spkf_paper.integrate(x, gyro[order], accel[order], 0.01, GRAVITY)
        nav = strapdown.propagate(nav, gyro[order], accel[order], 0.01, GRAVITY)
    error = spkf_paper.common(PaperBelief(x, belief.P)).nav.minus(nav)
    assert np.max(np.abs(error[:3])) < 1e-4
    assert np.max(np.abs(error[3:6])) < 1e-5
    assert np.max(np.abs(error[6:9])) < 1e-7


def test_a_long_step_is_cut() -> None:
    x = spkf_paper.start(LEVEL, P0_SD).x
    gyro, accel = np.array([30.0, 0.0, 100.0]) * DEG, np.array([0.0, 0.0, -GRAVITY])
    coarse, fine = spkf_paper.integrate(x, gyro, accel, 1.0, GRAVITY), x
    for _ in range(1000):
        fine = spkf_paper.integrate(fine, gyro, accel, 1e-3, GRAVITY)
    assert np.max(np.abs(coarse - fine)[6:9]) < 1e-4
    assert np.max(np.abs(coarse - fine)[3:6]) < 1e-3


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (20.0, -30.0, 70.0), (-170.0, 80.0, -120.0)])
def test_a_covariance_survives_the_way_into_the_papers_coordinates_and_back(angles: tuple[float, float, float]) -> None:
    nav = attitude_of(*angles)
    back = spkf_paper.common(spkf_paper.start(nav, P0_SD))
    assert np.max(np.abs(back.nav.minus(nav)) / P0_SD) < 1e-9
    assert np.max(np.abs(back.P - np.diag(P0_SD**2)) / np.outer(P0_SD, P0_SD)) < 1e-12


def test_prediction_is_that_of_the_tangent_space_for_small_errors() -> None:
    rng = np.random.default_rng(8)
    nav = attitude_of(30.0, 50.0, -120.0)
    sizes = np.repeat([1.0, 1e-3, 1e-5, 1e-4, 1e-5], 3)
    gyro, accel = rng.normal(size=(2, 3)), rng.normal(size=(2, 3)) * 5.0
    Q_d = spkf.process_noise(NOISE, nav.C_nb, 0.05) * 1e-6
    a = spkf_paper.common(spkf_paper.predict(spkf_paper.start(nav, sizes), gyro, accel, 0.05, GRAVITY, Q_d))
    b = spkf.predict(spkf.start(nav, sizes), gyro, accel, 0.05, GRAVITY, Q_d)
    sd = np.sqrt(np.diag(b.P))
    assert np.max(np.abs(a.P - b.P) / np.outer(sd, sd)) < 2e-3


def test_drawn_measurements_make_nis_a_test_that_the_filter_passes() -> None:
    for known in (LEVEL, attitude_of(20.0, -50.0, 160.0)):
        rng = np.random.default_rng(3)
        belief = spkf_paper.start(known, P0_SD)
        Q_d = spkf.process_noise(NOISE, known.C_nb, 0.05)
        force = known.C_nb.T @ np.array([0.0, 0.0, -GRAVITY])
        nis = []
        for _ in range(400):
            gyro = rng.normal(size=3) * IMU400CD_200.gyro_arw / np.sqrt(0.05)
            accel = force + rng.normal(size=3) * IMU400CD_200.accel_vrw / np.sqrt(0.05)
            belief = spkf_paper.predict(belief, gyro, accel, 0.05, GRAVITY, Q_d)
            belief, innovation = spkf_paper.correct(belief, known, ROWS, PAPER_R_SD, rng.normal(size=9), np.inf)
            nis.append(innovation.nis)
        assert abs(np.mean(nis) - 9.0) < 3.3 * np.sqrt(2 * 9 / 400)


def test_a_shut_gate_leaves_the_belief_alone() -> None:
    belief = spkf_paper.start(LEVEL, P0_SD)
    far = LEVEL.plus(np.array([0.0, 0.0, 3000.0, *np.zeros(12)]))
    after, innovation = spkf_paper.correct(belief, far, ROWS, PAPER_R_SD, None, 50.0)
    assert after is belief
    assert not innovation.accepted
    assert np.isclose(innovation.nu[2], 3000.0)
    assert np.isclose(innovation.S[2, 2], 2 * 30.0**2)
    assert np.isclose(innovation.nis, 3000.0**2 / (2 * 30.0**2))
    assert spkf_paper.correct(belief, LEVEL, ROWS, PAPER_R_SD, None, 50.0)[1].accepted


def test_some_rows_alone_can_be_known() -> None:
    rows, R_sd = np.array([5, 8]), PAPER_R_SD[[5, 8]]
    known = LEVEL.plus(np.array([0, 0, 0, 0, 0, 0.05, 0, 0, 0.5 * DEG, *np.zeros(6)]))
    a, i = spkf_paper.correct(spkf_paper.start(LEVEL, P0_SD), known, rows, R_sd, None, np.inf)
    b, j = spkf.correct(spkf.start(LEVEL, P0_SD), known, rows, R_sd, None, np.inf)
    assert np.allclose(i.nu, j.nu)
    assert np.isclose(i.nis, j.nis)
    assert max(difference(spkf_paper.common(a), b)) < 1e-9


def test_a_pitch_beyond_85_degrees_is_an_alarm_with_its_cause() -> None:
    assert spkf_paper.alarm(spkf_paper.start(attitude_of(0.0, 84.0, 0.0), P0_SD)) is None
    text = spkf_paper.alarm(spkf_paper.start(attitude_of(0.0, 88.3, 0.0), P0_SD))
    assert text.startswith("pitch is 88.3°: Euler angles are singular at 90°")
    assert "--filter spkf" in text
    assert "-88.3°" in str(spkf_paper.alarm(spkf_paper.start(attitude_of(0.0, -88.3, 0.0), P0_SD)))


def test_a_pitch_of_90_degrees_is_divergence() -> None:
    with pytest.raises(spkf.DivergenceError, match=r"90\.00°"):
        spkf_paper.start(attitude_of(0.0, 90.0, 0.0), P0_SD)
    belief = spkf_paper.start(attitude_of(0.0, 80.0, 0.0), P0_SD)
    with pytest.raises(spkf.DivergenceError):
        for _ in range(20):
            rate = np.array([0.0, 10.0, 0.0]) * DEG
            belief = spkf_paper.predict(belief, rate, np.array([GRAVITY, 0, 0]), 0.1, GRAVITY, np.zeros((15, 15)))


@pytest.mark.parametrize("module", [spkf, ekf, spkf_paper])
def test_bad_arguments_are_errors_in_words(module: ModuleType) -> None:
    belief, nothing = module.start(LEVEL, P0_SD), (np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="`dt` is 0"):
        module.predict(belief, *nothing, 0.0, 9.8, np.zeros((15, 15)))
    with pytest.raises(ValueError, match="`P0_sd` has shape"):
        module.start(LEVEL, P0_SD[:9])
    if module is not ekf:
        with pytest.raises(ValueError, match="`kappa` is -15"):
            module.predict(belief, *nothing, 0.1, 9.8, np.zeros((15, 15)), -15.0)
