import numpy as np
import pytest

from filters import attitude
from filters.imu import IMU400CD_200, Noise
from filters.kalman import ekf, spkf, strapdown
from filters.state import PAPER_SITE, NavState, Site

GRAVITY = PAPER_SITE.gravity
# a size for each error, so that entries of F in m, m/s, rad, m/s² and rad/s are compared on one scale
SIZES = np.repeat([1e3, 1.0, 1e-2, 1e-1, 1e-2], 3)


def moving(seed: int) -> tuple[NavState, np.ndarray, np.ndarray]:
    """A fast vehicle somewhere on the Earth at any attitude, its gyro and accelerometer readings."""
    rng = np.random.default_rng(seed)
    site = Site.at(rng.uniform(-75.0, 75.0), rng.uniform(-180.0, 180.0), rng.uniform(0.0, 2e4))
    C_nb = attitude.exp(rng.normal(size=3) * 2.0)
    error = np.concatenate(
        [np.zeros(3), rng.normal(size=3) * 300.0, np.zeros(3), rng.normal(size=3) * 0.1, rng.normal(size=3) * 0.01]
    )
    return NavState.at_rest(site, C_nb).plus(error), rng.normal(size=3) * 2.0, rng.normal(size=3) * 10.0


def differences(nav: NavState, gyro: np.ndarray, accel: np.ndarray, dt: float, gravity: float) -> np.ndarray:
    """Φ of the mechanisation by central differences, four points a column."""
    centre = strapdown.propagate(nav, gyro, accel, dt, gravity)

    def half(sizes: np.ndarray) -> np.ndarray:
        plus = strapdown.propagate(nav.plus(np.diag(sizes)), gyro, accel, dt, gravity).minus(centre)
        minus = strapdown.propagate(nav.plus(-np.diag(sizes)), gyro, accel, dt, gravity).minus(centre)
        return ((plus - minus) / (2.0 * sizes[:, None])).T

    return (4.0 * half(0.5 * SIZES) - half(SIZES)) / 3.0


@pytest.mark.parametrize("seed", range(20))
def test_every_column_of_the_jacobian_is_the_derivative_of_the_mechanisation(seed: int) -> None:
    nav, gyro, accel = moving(seed)
    F = ekf.jacobian(nav, accel)
    h = 4e-3
    # the mechanisation runs forward only: the one-sided rule of fourth order
    Phi = [np.eye(15)] + [differences(nav, gyro, accel, k * h, GRAVITY) for k in (1, 2, 3, 4)]
    rate = sum(w * P for w, P in zip((-25 / 12, 4.0, -3.0, 4 / 3, -1 / 4), Phi, strict=True)) / h
    error = np.abs((F - rate) * SIZES / SIZES[:, None])
    for column in range(15):
        # angles in radians leave a nanometre of rounding in position; force and rate, entries of size 0.1 and 1, show
        # the rule's own error
        velocity, turning = (1e-9, 2e-10) if column < 6 else (3e-8, 2e-10 if column < 12 else 2e-7)
        assert np.max(error[:3, column]) < 2e-8, column
        assert np.max(error[3:6, column]) < velocity, column
        assert np.max(error[6:9, column]) < turning, column
        assert np.max(error[9:, column]) < 1e-11, column


# readings that are held, and rates that turn about within 0.3 s, ten times faster than any table can: the mechanisation
# leaves out the commutator of the rates at the start and the end, which Φ does not
@pytest.mark.parametrize(("changes", "biases", "gyro_biases"), [(False, 1e-6, 1e-6), (True, 5e-6, 2e-3)])
@pytest.mark.parametrize("seed", range(10))
def test_a_transition_is_the_derivative_of_the_step(
    seed: int, changes: bool, biases: float, gyro_biases: float
) -> None:
    nav, gyro, accel = moving(seed)
    if changes:
        gyro, accel = np.array([gyro, -0.5 * gyro]), np.array([accel, 2.0 * accel + 1.0])
    end, Phi = ekf.transition(nav, gyro, accel, 0.3, GRAVITY)
    error = (Phi - differences(nav, gyro, accel, 0.3, GRAVITY)) * SIZES / SIZES[:, None]
    assert np.max(np.abs(error[:, :12])) < biases
    assert np.max(np.abs(error[:, 12:])) < gyro_biases
    assert np.max(np.abs(end.minus(strapdown.propagate(nav, gyro, accel, 0.3, GRAVITY))) / SIZES) < 1e-9


def test_the_printed_jacobian_is_wrong_where_the_docstring_says() -> None:
    """h' = -V_D has no radius in it, and the biases have columns."""
    nav, _, accel = moving(1)
    F = ekf.jacobian(nav, accel)
    assert F[2, 5] == 1.0  # down, in metres; F36 of (6) for height is minus this
    assert np.array_equal(F[3:6, 9:12], -nav.C_nb)
    assert np.array_equal(F[6:9, 12:15], -nav.C_nb)


def test_prediction_is_that_of_the_sigma_points_for_small_errors() -> None:
    rng = np.random.default_rng(8)
    C_nb = attitude.from_rpy(0.5, 1.2, -2.0)
    nav = NavState.at_rest(PAPER_SITE, C_nb)
    A = rng.normal(size=(15, 15))
    sizes = np.repeat([1e-2, 1e-4, 1e-6, 1e-5, 1e-7], 3)
    belief = ekf.Belief(nav, (A @ A.T) * np.outer(sizes, sizes))
    gyro = np.array([[0.3, -0.2, 0.5], [0.1, 0.4, -0.2]])
    force = C_nb.T @ np.array([0.0, 0.0, -GRAVITY])
    accel = np.array([force, force + 1.0])
    Q_d = spkf.process_noise(Noise.of(IMU400CD_200), C_nb, 0.05)
    a = ekf.predict(belief, gyro, accel, 0.05, GRAVITY, Q_d)
    b = spkf.predict(belief, gyro, accel, 0.05, GRAVITY, Q_d)
    sd = np.sqrt(np.diag(b.P))
    assert np.max(np.abs(a.P - b.P) / np.outer(sd, sd)) < 1e-5
    assert np.max(np.abs(a.nav.minus(b.nav)) / sd) < 1e-5


def test_a_reading_held_is_one_that_is_equal_at_both_ends() -> None:
    nav, gyro, accel = moving(3)
    belief = ekf.start(nav, SIZES)
    a = ekf.predict(belief, gyro, accel, 0.05, GRAVITY, np.zeros((15, 15)))
    b = ekf.predict(belief, np.array([gyro, gyro]), np.array([accel, accel]), 0.05, GRAVITY, np.zeros((15, 15)))
    assert np.array_equal(a.P, b.P)
