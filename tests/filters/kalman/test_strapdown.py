import numpy as np
from scipy.integrate import solve_ivp

from filters import attitude, earth
from filters.kalman import strapdown
from filters.state import PAPER_SITE, NavState

DEG = np.pi / 180


def in_ecef(state: NavState) -> np.ndarray:
    """Position (m), velocity (m/s) and attitude matrix in Earth-fixed axes, as one vector."""
    phi, lam = float(state.latitude), float(state.longitude)
    _, R_e = earth.radii(np.sin(phi))
    h = float(state.height)
    r = np.array(
        [
            (R_e + h) * np.cos(phi) * np.cos(lam),
            (R_e + h) * np.cos(phi) * np.sin(lam),
            (R_e * (1 - earth.ECCENTRICITY_SQUARED) + h) * np.sin(phi),
        ]
    )
    C_en = ned_to_ecef(phi, lam)
    return np.concatenate([r, C_en @ state.velocity_n, (C_en @ state.C_nb).ravel()])


def ned_to_ecef(phi: float, lam: float) -> np.ndarray:
    s, c, sl, cl = np.sin(phi), np.cos(phi), np.sin(lam), np.cos(lam)
    return np.array([[-s * cl, -sl, -c * cl], [-s * sl, cl, -c * sl], [c, 0.0, -s]])


def vertical(r: np.ndarray) -> np.ndarray:
    """Unit vector down, along the ellipsoid's normal, at an Earth-fixed position."""
    p, z, e2 = float(np.hypot(r[0], r[1])), float(r[2]), earth.ECCENTRICITY_SQUARED
    phi = np.arctan2(z, p * (1 - e2))
    for _ in range(6):
        phi = np.arctan2(z + e2 * earth.radii(np.sin(phi))[1] * np.sin(phi), p)
    return ned_to_ecef(float(phi), float(np.arctan2(r[1], r[0])))[:, 2]


def integrate_in_ecef(
    state: NavState, gyro: np.ndarray, accel: np.ndarray, seconds: float, gravity: float
) -> np.ndarray:
    """Independent mechanisation: Earth-fixed axes, attitude matrix, DOP853."""
    spin = np.array([0.0, 0.0, earth.EARTH_RATE])

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        r, v, C = y[:3], y[3:6], y[6:].reshape(3, 3)
        a = C @ (accel - state.accel_bias) + gravity * vertical(r) - 2 * np.cross(spin, v)
        C_dot = C @ attitude.skew(gyro - state.gyro_bias) - attitude.skew(spin) @ C
        return np.concatenate([v, a, C_dot.ravel()])

    return solve_ivp(rates, (0, seconds), in_ecef(state), method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]


def test_the_mechanisation_agrees_with_an_earth_fixed_one() -> None:
    start = NavState.at_rest(PAPER_SITE, attitude.from_rpy(0.2, -0.3, 1.0))
    start = start.plus(np.array([0, 0, 0, 3.0, -2.0, 1.0, 0, 0, 0, 0.01, -0.02, 0.03, 1e-3, 2e-3, -1e-3]))
    gyro, accel = np.array([4.0, -3.0, 6.0]) * DEG, np.array([0.5, -1.0, -9.0])
    state = start
    for _ in range(1330):
        state = strapdown.propagate(state, gyro, accel, 10.0 / 1330, PAPER_SITE.gravity)
    expected = integrate_in_ecef(start, gyro, accel, 10.0, PAPER_SITE.gravity)
    actual = in_ecef(state)
    assert np.linalg.norm(actual[:3] - expected[:3]) < 2e-5
    assert np.linalg.norm(actual[3:6] - expected[3:6]) < 2e-6
    assert np.max(np.abs(actual[6:] - expected[6:])) < 2e-9


def test_a_perfect_still_unit_stays_where_it_is() -> None:
    rate = earth.earth_rate_n(np.array(PAPER_SITE.latitude))
    C_nb = attitude.from_rpy(0.4, 0.2, -2.0)
    force = C_nb.T @ np.array([0.0, 0.0, -PAPER_SITE.gravity])
    state = NavState.at_rest(PAPER_SITE, C_nb)
    for _ in range(60):
        state = strapdown.propagate(state, C_nb.T @ rate, force, 1.0, PAPER_SITE.gravity)
    error = state.minus(NavState.at_rest(PAPER_SITE, C_nb))
    assert np.max(np.abs(error)) < 1e-6


def test_long_steps_are_cut_so_that_fast_rotation_is_integrated_right() -> None:
    start = NavState.at_rest(PAPER_SITE, np.eye(3))
    gyro, accel = np.array([0.0, 200.0, 0.0]) * DEG, np.array([0.0, 0.0, -PAPER_SITE.gravity])
    coarse = strapdown.propagate(start, gyro, accel, 1.0, PAPER_SITE.gravity)
    fine = start
    for _ in range(1000):
        fine = strapdown.propagate(fine, gyro, accel, 1e-3, PAPER_SITE.gravity)
    error = coarse.minus(fine)
    assert np.linalg.norm(error[6:9]) < 1e-6
    assert np.linalg.norm(error[3:6]) < 1e-4


def test_many_states_at_once_give_what_each_gives_alone() -> None:
    """The sigma points' array is a loop, only faster."""
    rng = np.random.default_rng(5)
    errors = rng.normal(size=(31, 15)) * np.repeat([10.0, 0.1, 0.01, 0.1, 0.01], 3)
    centre = NavState.at_rest(PAPER_SITE, attitude.from_rpy(0.1, 1.55, 3.0))
    gyro, accel = rng.normal(size=3), rng.normal(size=3) * 5
    together = strapdown.propagate(centre.plus(errors), gyro, accel, 0.05, PAPER_SITE.gravity)
    alone = strapdown.propagate(centre.plus(errors[7]), gyro, accel, 0.05, PAPER_SITE.gravity)
    assert np.allclose(together.C_nb[7], alone.C_nb, atol=1e-12)
    assert np.allclose(together.velocity_n[7], alone.velocity_n, atol=1e-9)


def test_errors_added_come_back_as_differences() -> None:
    rng = np.random.default_rng(6)
    error = rng.normal(size=15) * np.repeat([20.0, 1.0, 0.1, 0.1, 0.01], 3)
    centre = NavState.at_rest(PAPER_SITE, attitude.from_rpy(1.0, -1.5, 2.0))
    assert np.allclose(centre.plus(error).minus(centre), error, atol=1e-7)
