"""Rows of attitude at samples: rates in three axes, at any attitude, over gaps, with noise, and stretches at rest."""

import numpy as np
import pytest

from filters.attitude import from_quaternion
from filters.motion.attitude_rows import Orientation, at_rest, at_samples, rests
from filters.motion.kinematics import attitudes, body_rate
from filters.types import Array

HZ = 100.0


def motion(t: Array) -> tuple[Array, Array]:
    """C_nb and body rate, rad/s, of fast rotations about all axes that pass middle = 90 degrees."""
    w, size, phase = np.array([2.1, 3.3, 2.7]), np.array([1.2, 2.0, 1.5]), np.array([0.0, 0.5, 1.1])
    angles = size * np.sin(w * t[:, None] + phase)
    return attitudes(angles), body_rate(angles, size * w * np.cos(w * t[:, None] + phase))


@pytest.mark.parametrize("hz", [100.0, 37.0])
def test_rates_are_those_of_the_motion(hz: float) -> None:
    """To 3e-5 of the fastest, through the attitude at which angles fail, at samples on the rows or between them."""
    t, at = np.arange(0.1, 29.9, 1.0 / hz), np.arange(3001) / HZ
    C, rate = motion(t)
    got = at_samples(t, at, motion(at)[0])
    assert np.abs(got.rate - rate)[20:-20].max() < 3e-5 * np.abs(rate).max()
    assert np.abs(from_quaternion(got.quaternion) - C)[20:-20].max() < 1e-3
    assert not got.unknown.any()


def test_noise_of_the_rows_does_not_add_up() -> None:
    """Means over 0.25 s have the noise of two rows, not of 25 differences."""
    rng, at, sd = np.random.default_rng(1), np.arange(30001) / HZ, 2e-4
    small = sd * rng.standard_normal((at.size, 3))
    got = at_samples(at, at, attitudes(small))
    means = got.rate[12 : 12 + 25 * 1190].reshape(-1, 25, 3).mean(axis=1)
    assert np.std(means) < 1.5 * sd / 0.25
    assert np.std(got.rate) > 15.0 * np.std(means)


def test_a_gap_is_unknown_and_nothing_is_taken_across_it() -> None:
    at = np.arange(3001) / HZ
    kept = (at < 10.0) | (at > 10.8)
    C, rate = motion(at)
    got = at_samples(at, at[kept], C[kept])
    assert got.unknown[~kept].all()
    assert np.count_nonzero(got.unknown) <= np.count_nonzero(~kept) + 2
    known = ~got.unknown
    known[[0, 1, -2, -1]] = False
    assert np.abs(got.rate - rate)[known].max() < 3e-3 * np.abs(rate).max()


def test_rests_are_found_and_have_one_attitude() -> None:
    rng, t = np.random.default_rng(2), np.arange(6000) / HZ
    turn = np.interp(t, [0.0, 20.0, 30.0, 60.0], [0.0, 0.0, 1.0, 1.0 + 30.0 * np.deg2rad(0.3)])
    angles = np.column_stack([0.0 * t, 0.0 * t, turn]) + 1e-3 * rng.standard_normal((t.size, 3))
    gyro = 1e-3 * rng.standard_normal((t.size, 3))
    gyro[2000:3000, 2] += 0.1 + 0.05 * np.sin(9.0 * t[2000:3000])
    known = at_samples(t, t, attitudes(angles))
    stretches = rests(t, gyro, 0.01 * rng.standard_normal((t.size, 3)), known)
    assert len(stretches) == 1
    assert stretches[0, 0] < 60
    assert 1850 < stretches[0, 1] <= 2000
    settled = at_rest(known, stretches)
    assert not settled.rate[slice(*stretches[0])].any()
    assert np.ptp(settled.quaternion[slice(*stretches[0])], axis=0).max() == 0.0
    assert np.array_equal(settled.rate[stretches[0, 1] :], known.rate[stretches[0, 1] :])


def test_nothing_is_at_rest_in_a_moving_recording() -> None:
    t = np.arange(3000) / HZ
    C, rate = motion(t)
    known: Orientation = at_samples(t, t, C)
    assert rests(t, rate, 9.8 * C[:, 2], known).size == 0
