from dataclasses import replace

import numpy as np
import pytest
from helpers.filtering import bias_errors, dwell, filtered, rate

from filters import simulation
from filters.imu import IMU400CD_200, Samples
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings
from filters.motion.profile import Profile
from filters.motion.segments import AXES, Dwell, Rate
from filters.simulation import Effect, Truth

SPEC = IMU400CD_200
LIMITS = np.repeat([SPEC.accel_bias_limit, SPEC.gyro_bias_limit], 3)
CHANNELS = ("x accel", "y accel", "z accel", "x gyro", "y gyro", "z gyro")
NONE = Truth(np.zeros(3), np.zeros(3))


def run(samples: Samples, hz: float, profile: Profile | None = None, name: str = "spkf") -> Estimator:
    kind = "level" if profile is None else "profile"
    return filtered(Settings(1.0 / hz, filter=name, reference=kind, motion=profile), samples, every=np.inf)[0]


def biases(estimator: Estimator) -> tuple[np.ndarray, np.ndarray]:
    """The six estimates, accelerometer then gyro, and their standard deviations."""
    error, P = bias_errors(estimator, NONE)
    return error, np.sqrt(np.diag(P))


# ------------------------------------------------------------------------------------------------------------- alarms


@pytest.mark.parametrize("name", ["spkf", "ekf", "spkf-paper"])
def test_the_first_innovation_tells_a_wrong_accelerometer_sign(name: str) -> None:
    samples, _ = simulation.simulate(rate_hz=10.0, seconds=0.4, seed=1)
    right, wrong = run(samples, 10.0, name=name), run(replace(samples, accel=-samples.accel), 10.0, name=name)
    assert right.alarms() == []
    assert right.first_nis < 9.0
    assert wrong.first_nis > 100.0
    assert len(wrong.alarms()) == 1
    assert "NIS" in wrong.alarms()[0]
    assert "wrong accelerometer sign" in wrong.alarms()[0]


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(2.0, "wrong accelerometer sign"), (12.0, "off the reference by 2.00 g: wrong accelerometer sign")],
)
@pytest.mark.parametrize("hz", [1.0, 20.0, 133.0])
def test_a_wrong_accelerometer_sign_is_named_within_two_seconds(hz: float, seconds: float, words: str) -> None:
    samples, _ = simulation.simulate(rate_hz=hz, seconds=seconds + 1.0 / hz, seed=1)
    assert any(words in text for text in run(replace(samples, accel=-samples.accel), hz).alarms())


def test_a_wrong_accelerometer_sign_on_a_table_is_named_too() -> None:
    profile = Profile((dwell(180, 0, 0, 6.0), dwell(90, 0, 0, 6.0)))
    samples, _ = simulation.simulate(profile, rate_hz=20.0, seconds=profile.duration, seed=1)
    assert run(samples, 20.0, profile).alarms() == []
    assert any(
        "accelerometer sign" in text for text in run(replace(samples, accel=-samples.accel), 20.0, profile).alarms()
    )


def test_a_table_that_is_elsewhere_is_among_the_causes() -> None:
    profile = Profile((dwell(0, 0, 0, 6.0), dwell(90, 0, 0, 20.0)))
    samples, _ = simulation.simulate(rate_hz=20.0, seconds=profile.duration, seed=1)
    where = "attitude, or the table is not where the segment says"
    assert any(where in text for text in run(samples, 20.0, profile).alarms())
    assert not any("segment" in text for text in run(replace(samples, accel=-samples.accel), 20.0).alarms())


@pytest.mark.parametrize("channel", range(6))
def test_a_bias_of_four_times_table_1_is_named_and_one_of_two_is_not(channel: int) -> None:
    for times in (1.0, 2.0, 4.0):
        bias = np.zeros(6)
        bias[channel] = -times * LIMITS[channel]
        samples, _ = simulation.simulate(rate_hz=20.0, seconds=15.0, seed=channel, truth=Truth(bias[:3], bias[3:]))
        alarms = run(samples, 20.0).alarms()
        assert [text.split(" (")[0] for text in alarms] == ([CHANNELS[channel]] if times == 4.0 else [])


def test_the_paper_s_euler_angles_say_so_at_90_degrees_of_pitch() -> None:
    upright, slanted = (Profile((dwell(0, angle, 0, 5.0),)) for angle in (89.9, 45.0))
    samples, _ = simulation.simulate(upright, rate_hz=20.0, seconds=5.0, seed=1)
    alarms = run(samples, 20.0, upright, "spkf-paper").alarms()
    assert len(alarms) == 1
    assert "pitch is 89.9°" in alarms[0]
    assert "singular" in alarms[0]
    assert run(samples, 20.0, upright).alarms() == []
    samples, _ = simulation.simulate(slanted, rate_hz=20.0, seconds=5.0, seed=1)
    assert run(samples, 20.0, slanted, "spkf-paper").alarms() == []


def test_having_been_at_90_degrees_of_pitch_is_said_to_the_end() -> None:
    profile = Profile((dwell(0, 0, 0, 2.0), dwell(0, 89.9, 0, 4.0), dwell(0, 0, 0, 3.0)), offset_sd=0.0)
    samples, _ = simulation.simulate(profile, rate_hz=20.0, seconds=profile.duration, seed=1)
    assert any("pitch" in text for text in run(samples, 20.0, profile, "spkf-paper").alarms())


@pytest.mark.parametrize("profile", [None, Profile((dwell(0, 0, 0, 8.0), dwell(0, 90, 0, 8.0), dwell(180, 0, 0, 8.0)))])
def test_clean_data_raise_no_alarm(profile: Profile | None) -> None:
    seconds = 30.0 if profile is None else profile.duration
    for seed in range(20):
        samples, _ = simulation.simulate(profile, rate_hz=20.0, seconds=seconds, seed=seed)
        assert run(samples, 20.0, profile).alarms() == []


# ------------------------------------------------------------------ biases that the motion cannot tell


def turned(segments: tuple[Rate | Dwell, ...], effect: Effect | None) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """The six estimates of a unit without biases, their standard deviations, and what is said to be confounded."""
    profile = Profile(segments, offset_sd=0.0)
    effects = () if effect is None else (effect,)
    samples, _ = simulation.simulate(
        profile, rate_hz=133.0, seconds=profile.duration, seed=3, truth=NONE, effects=effects
    )
    estimator = run(samples, 133.0, profile)
    return *biases(estimator), estimator.confounded()


ONE_WAY = (rate("inner", 50.0, 60.0),)
BOTH_WAYS = tuple(rate("inner", sign * dps, 15.0) for dps in (30.0, 60.0) for sign in (1, -1))
SCALE = Effect("scale", ("gz",), {"relative": 0.01})
LEVER = Effect("lever_arm", (), {"x_m": 0.03})
DELAY = Effect("delay", (), {"tau_s": 0.005})
W = np.deg2rad(50.0)


def test_scale_factor_at_one_rate_is_taken_for_bias_and_said_so() -> None:
    without, _, _ = turned(ONE_WAY, None)
    estimate, sd, said = turned(ONE_WAY, SCALE)
    # the half seconds of speeding up and slowing down dilute it by less than 2 %
    assert estimate[5] - without[5] == pytest.approx(0.01 * W, rel=0.02)
    assert estimate[5] > 20.0 * sd[5]
    assert np.allclose((estimate - without)[[0, 1, 2, 3, 4]], 0.0, atol=0.05 * sd.min())
    assert any(text.startswith("z gyro bias") and "scale factor" in text for text in said)
    assert not any(text.startswith(("x gyro", "y gyro")) for text in said)


@pytest.mark.parametrize("axis", AXES)
def test_scale_factor_at_two_rates_both_ways_leaves_the_bias_right(axis: str) -> None:
    number = AXES.index(axis)
    segments = tuple(rate(axis, sign * dps, 15.0) for dps in (30.0, 60.0) for sign in (1, -1))
    effect = Effect("scale", ("g" + "xyz"[number],), {"relative": 0.01})
    estimate, sd, said = turned(segments, effect)
    bound = np.zeros(6)
    bound[3 + number] = 0.01 * np.deg2rad(60.0) / 500.0
    assert np.all(np.abs(estimate) < 3.0 * sd + bound)
    assert said == []


def test_a_lever_arm_at_one_rate_is_taken_for_bias_and_said_so() -> None:
    without, _, _ = turned(ONE_WAY, None)
    estimate, sd, said = turned(ONE_WAY, LEVER)
    assert estimate[0] - without[0] == pytest.approx(-(W**2) * 0.03, rel=0.03)
    assert estimate[0] < -3.0 * sd[0]
    assert any(text.startswith("accelerometer biases") and "lever arm" in text for text in said)


def test_a_lever_arm_at_two_rates_shifts_the_bias_by_no_more_than_its_mean_force() -> None:
    """At ±30 and ±60 deg/s nothing is confounded, but the mean of ω² r stays in the bias: no turning undoes it."""
    estimate, sd, said = turned(BOTH_WAYS, LEVER)
    mean_force = 0.5 * (np.deg2rad(30.0) ** 2 + np.deg2rad(60.0) ** 2) * 0.03
    bound = np.zeros(6)
    bound[0] = mean_force
    assert np.all(np.abs(estimate) < 3.0 * sd + bound)
    assert said == []


def test_a_lever_arm_on_a_table_that_rests_between_moves_leaves_dwells_alone() -> None:
    """Without a joint in time only dwells count, and 3 cm have no force there: all biases within 3 sd."""
    profile = Profile((dwell(0, 0, 0, 8.0), dwell(0, 90, 0, 8.0), dwell(180, 0, 0, 8.0), dwell(0, 0, 90, 8.0)))
    samples, _ = simulation.simulate(
        profile, rate_hz=133.0, seconds=profile.duration, seed=3, truth=NONE, effects=(LEVER,)
    )
    estimator = run(samples, 133.0, profile)
    estimate, sd = biases(estimator)
    assert np.all(np.abs(estimate) < 3.0 * sd)
    assert estimator.confounded() == []


@pytest.mark.parametrize("segments", [ONE_WAY, BOTH_WAYS])
def test_a_delay_shifts_the_bias_by_no_more_than_the_angle_it_lags(segments: tuple[Rate, ...]) -> None:
    """Attitude lags by ω τ and jumps when the rate changes: the z gyro bias moves by less than all jumps over T."""
    without, _, _ = turned(segments, None)
    estimate, sd, said = turned(segments, DELAY)
    profile = Profile(segments)
    jumps = 2.0 * sum(abs(segment.rate) * 0.005 for segment in segments)
    assert abs(estimate[5] - without[5]) < jumps / profile.duration
    bound = np.zeros(6)
    bound[5] = jumps / profile.duration
    assert np.all(np.abs(estimate) < 3.0 * sd + bound)
    if segments is BOTH_WAYS:
        assert said == []
    else:
        assert any("delay" in text for text in said)


def test_one_rate_is_confounded_however_short_it_is() -> None:
    """Ten seconds of 50 deg/s with half a second of ramps at each end are one rate just as sixty are."""
    for seconds in (20.0, 10.0):
        estimate, sd, said = turned((rate("inner", 50.0, seconds),), SCALE)
        assert estimate[5] > 10.0 * sd[5]
        assert any(text.startswith("z gyro bias") for text in said), f"{seconds} s"


def test_a_unit_at_rest_has_nothing_confounded() -> None:
    """Earth rate is no turning."""
    profile = Profile((dwell(0, 0, 0, 10.0),), offset_sd=0.0)
    for motion in (None, profile):
        samples, _ = simulation.simulate(motion, rate_hz=20.0, seconds=10.0, seed=1)
        assert run(samples, 20.0, motion).confounded() == []
