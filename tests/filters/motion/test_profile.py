"""The table's motion: moves, ramps, swings, and rates against difference quotients."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from filters import attitude
from filters.motion import kinematics
from filters.motion import profile as motion
from filters.motion.profile import Profile
from filters.motion.segments import AXES, Dwell, Rate, Sine

DEG = np.pi / 180.0
TUMBLE = Profile(
    (
        Dwell((0.0, 0.0, 0.0), 3.0),
        Dwell((90 * DEG, -30 * DEG, 45 * DEG), 4.0),
        Rate("inner", 60 * DEG, 8.0),
        Sine("middle", 10 * DEG, 0.5, 7.3),
        Dwell((0.0, 0.0, 10 * DEG), 2.0),
    ),
    sign=(1, 1, -1),
)
T_SAMPLED = np.arange(0.0, 6.0, 0.25)
SAMPLED = motion.from_samples(
    T_SAMPLED, np.sin(T_SAMPLED), 0.3 * np.cos(T_SAMPLED), np.where(T_SAMPLED < 3.0, 0.0, T_SAMPLED - 3.0)
)
PROFILES = {"tumble": TUMBLE, "sampled": SAMPLED}


def dense(profile: Profile, count: int = 20011) -> np.ndarray:
    return np.linspace(-1.0, profile.duration + 1.0, count)


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_rates_are_the_derivatives_of_angles(profile: Profile) -> None:
    t, h = dense(profile), 1e-6
    t = t[(np.abs(t) > h) & (np.abs(t - profile.duration) > h)]
    quotient = (profile.angles(t + h) - profile.angles(t - h)) / (2.0 * h)
    assert np.allclose(profile.rates(t), quotient, atol=1e-5)


def test_angles_and_rates_do_not_jump() -> None:
    """A table has inertia: between instants rates change by no more than the acceleration allows."""
    t = dense(TUMBLE)
    dt = t[1] - t[0]
    most = max(TUMBLE.accel, 10 * DEG * np.pi**2 * 1.3)
    assert np.abs(np.diff(TUMBLE.rates(t), axis=0)).max() <= 1.001 * most * dt
    assert np.abs(np.diff(TUMBLE.angles(t), axis=0)).max() <= 1.001 * TUMBLE.max_rate * dt


def test_max_rate_is_the_largest_rate_of_an_axis() -> None:
    assert pytest.approx(60 * DEG) == TUMBLE.max_rate
    assert pytest.approx(60 * DEG) == np.abs(TUMBLE.rates(dense(TUMBLE))).max()
    swing = Profile((Sine("outer", 10 * DEG, 1.0, 2.0),))
    assert pytest.approx(10 * DEG * 2 * np.pi) == swing.max_rate
    short = Profile((Dwell((0.0, 0.0, 0.0), 1.0), Dwell((1 * DEG, 0.0, 0.0), 1.0)))
    assert short.max_rate == pytest.approx(10 * DEG), "one degree at 100 deg/s² up and down never reaches 20 deg/s"
    sampled = np.abs(SAMPLED.rates(dense(SAMPLED))).max()
    assert pytest.approx(sampled, rel=1e-3) == SAMPLED.max_rate


def test_a_move_is_a_trapezoid_of_all_axes_at_once() -> None:
    assert TUMBLE.starts[1] == 3.0
    assert TUMBLE.rest_starts[1] == pytest.approx(3.0 + 90 / 20 + 20 / 100)
    assert TUMBLE.starts[2] == pytest.approx(TUMBLE.rest_starts[1] + 4.0)
    moving = TUMBLE.rates(np.linspace(3.01, 7.69, 50)) / np.array([90.0, -30.0, -45.0])
    assert np.allclose(moving, moving[:, :1])
    assert np.abs(moving[:, 0]).max() * 90 == pytest.approx(20 * DEG)


def test_seconds_of_a_rate_are_those_at_that_rate() -> None:
    profile = Profile((Rate("inner", 50 * DEG, 10.0), Dwell((0.0, 0.0, 0.0), 1.0)))
    t = np.linspace(0.0, profile.starts[1], 11001)
    at_rate = np.isclose(profile.rates(t)[:, 2], 50 * DEG)
    assert profile.starts[1] == pytest.approx(0.5 + 10.0 + 0.5)
    assert at_rate.mean() * 11.0 == pytest.approx(10.0, abs=0.01)
    assert profile.angles(10.9999)[0, 2] / DEG == pytest.approx(525.0, abs=1e-3)
    assert profile.angles(profile.duration)[0, 2] / DEG == pytest.approx(360.0), "the short way: not 525° back"


def test_a_dwell_goes_to_its_angles_the_way_they_are_written() -> None:
    """Without a rate segment before, 0 to 270 is three quarters forward and not one back."""
    profile = Profile((Dwell((0.0, 0.0, 0.0), 1.0), Dwell((0.0, 0.0, 270 * DEG), 1.0)))
    assert profile.rates(3.0)[0, 2] > 0.0
    assert profile.angles(profile.duration)[0, 2] == pytest.approx(270 * DEG)


def test_a_swing_starts_and_ends_at_rest_where_it_was() -> None:
    swing = Sine("middle", 10 * DEG, 0.5, 7.3)
    profile = Profile((Dwell((0.0, 5 * DEG, 0.0), 1.0), swing))
    assert profile.duration == pytest.approx(1.0 + 2.0 + 7.3 + 2.0)
    for t in (1.0 + 1e-9, profile.duration - 1e-9):
        assert np.allclose(profile.angles(t), [[0.0, 5 * DEG, 0.0]], atol=1e-12)
        assert np.allclose(profile.rates(t), 0.0, atol=1e-7)
    inside = np.linspace(3.0, 10.3, 999)
    expected = 5 * DEG + 10 * DEG * np.sin(np.pi * (inside - 1.0))
    assert np.allclose(profile.angles(inside)[:, 1], expected, atol=1e-12)


def test_segments_and_rest_are_told_at_every_time() -> None:
    t = np.array([-1.0, 1.0, 3.5, 8.0, 14.0, 30.0, 1e6])
    assert TUMBLE.index(t).tolist() == [0, 0, 1, 1, 2, 3, 4]
    assert TUMBLE.phase(t).tolist() == [True, True, False, True, False, False, True]
    assert np.isnan(TUMBLE.rest_starts).tolist() == [False, False, True, True, False]
    assert np.array_equal(TUMBLE.rates(t[[0, -1]]), np.zeros((2, 3)))


def test_sampled_angles_have_no_dwell_that_begins_though_they_rest() -> None:
    """Where they rest is told at every time; a dwell is what somebody planned."""
    t = np.arange(8.0)
    profile = motion.from_samples(t, np.clip(t - 2.0, 0.0, 2.0), 0.0 * t, 0.0 * t)
    assert profile.phase(np.array([0.5, 2.5, 6.5])).tolist() == [True, False, True]
    assert np.isnan(profile.rest_starts).all()


def test_rest_means_no_rate() -> None:
    t = dense(TUMBLE)
    assert not TUMBLE.rates(t)[TUMBLE.phase(t)].any()
    still = motion.from_samples([0, 1, 2, 3], [0, 0, 1, 1], [0, 0, 0, 0], [0, 0, 0, 0])
    assert still.phase([0.5, 1.5, 2.5]).tolist() == [True, False, True]
    assert np.allclose(still.angles([0.5, 2.5])[:, 0], [0.0, 1.0]), "no overshoot in a cubic beside a rest"


def test_sampled_angles_are_met_at_their_times() -> None:
    late = motion.from_samples(T_SAMPLED + 100.0, np.sin(T_SAMPLED), T_SAMPLED, -T_SAMPLED)
    expected = np.stack([np.sin(T_SAMPLED), T_SAMPLED, -T_SAMPLED], axis=-1)
    assert np.allclose(late.angles(T_SAMPLED), expected)
    assert late.duration == pytest.approx(5.75)


def test_signs_turn_the_axes_of_a_table_that_counts_the_other_way() -> None:
    t = dense(TUMBLE, 501)
    plain = Profile(TUMBLE.segments)
    assert np.array_equal(TUMBLE.angles(t), plain.angles(t) * [1, 1, -1])
    assert np.array_equal(TUMBLE.rates(t), plain.rates(t) * [1, 1, -1])


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_numbers_do_not_depend_on_how_times_are_cut(profile: Profile) -> None:
    t = dense(profile, 1013)
    angles, rates = profile.angles(t), profile.rates(t)
    body, C_nb = kinematics.body_rate(angles, rates), kinematics.attitudes(angles)
    assert np.array_equal(np.vstack([profile.angles(x) for x in t]), angles)
    assert np.array_equal(np.vstack([profile.rates(float(x)) for x in t]), rates)
    assert np.array_equal(profile.angles(t[::-3]), angles[::-3])
    for cut in np.array_split(np.arange(t.size), 17):
        assert np.array_equal(profile.rates(t[cut]), rates[cut])
        assert np.array_equal(kinematics.body_rate(angles[cut], rates[cut]), body[cut])
        assert np.array_equal(kinematics.attitudes(angles[cut]), C_nb[cut])


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-7.0, 7.0), min_size=6, max_size=6))
def test_many_attitudes_are_the_tables_one_by_one(numbers: list[float]) -> None:
    angles, rates = np.array(numbers[:3]), np.array(numbers[3:])
    assert np.allclose(kinematics.attitudes(angles[None])[0], Rotation.from_euler("XYZ", angles).as_matrix())
    h = 1e-5
    before, after = (Rotation.from_euler("XYZ", (angles + x * rates)).as_matrix() for x in (-h, h))
    turned = attitude.log(before.T @ after) / (2.0 * h)
    assert np.allclose(kinematics.body_rate(angles[None], rates[None])[0], turned, atol=1e-6)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (([0.0], [0.0], [0.0], [0.0]), "at least 2"),
        (([0.0, 1.0, 1.0], [0.0] * 3, [0.0] * 3, [0.0] * 3), "row 2"),
        (([0.0, 1.0], [0.0, np.nan], [0.0] * 2, [0.0] * 2), "row 1"),
        (([0.0, 1.0], [0.0], [0.0] * 2, [0.0] * 2), "not one length"),
    ],
)
def test_wrong_samples_are_refused_by_row(columns: tuple[list[float], ...], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        motion.from_samples(*columns)


@pytest.mark.parametrize(
    "make", [lambda: Rate("yaw", 1.0, 1.0), lambda: Dwell((0.0, 0.0, 0.0), 0.0), lambda: Profile(())]
)
def test_misuse_names_the_argument(make: Any) -> None:
    with pytest.raises(ValueError, match="`"):
        make()
    assert AXES == ("outer", "middle", "inner")
