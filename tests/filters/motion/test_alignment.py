from dataclasses import replace

import numpy as np
import pytest
from helpers.filtering import dwell, filtered, nees, normalised, rate, same_however_they_come
from scipy.stats import chi2

from filters import attitude, earth
from filters.imu import IMU400CD_200, Samples
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings
from filters.motion import alignment, kinematics, reference
from filters.motion.profile import Profile
from filters.motion.reference import TableMotion, Trajectory
from filters.motion.segments import Dwell, Rate
from filters.simulation import Effect, simulate
from filters.state import PAPER_SITE

SPEC = IMU400CD_200


BOTH_WAYS = Profile(
    (dwell(0, 0, 0), rate("inner", 30.0, 15.0), rate("inner", -30.0, 15.0), dwell(0, 0, 0)), align="gyro"
)
TUMBLE = Profile(
    (
        dwell(0, 0, 0),
        dwell(90, 0, 0),
        dwell(180, 0, 0),
        dwell(0, 0, 0),
        dwell(0, 90, 0),
        dwell(0, 0, 45),
        dwell(0, 0, 0),
    ),
    align="gyro",
)
TURNED = replace(TUMBLE, segments=TUMBLE.segments[:-1])
ONE_WAY = Profile((dwell(0, 0, 0), rate("inner", 30.0, 40.0), dwell(0, 0, 0)), align="gyro")
SHORT = Profile((dwell(0, 0, 0), dwell(0, 90, 0), dwell(0, 0, 0)), align="gyro")


def recorded(
    profile: Profile, offset: float, seconds: float, hz: float = 20.0, seed: int = 0
) -> tuple[Samples, np.ndarray]:
    """Log of a unit with noise and biases of Table 1 whose table starts its profile at `offset`; with the biases."""
    rng = np.random.default_rng([seed, 3])
    t = np.arange(round(seconds * hz)) / hz
    angles, rates = profile.angles(t - offset), profile.rates(t - offset)
    C = kinematics.attitudes(angles)
    bias = rng.uniform(-1.0, 1.0, 6) * np.repeat([SPEC.accel_bias_limit, SPEC.gyro_bias_limit], 3)
    gyro = kinematics.body_rate(angles, rates) + C.transpose(0, 2, 1) @ earth.earth_rate_n(
        np.array(PAPER_SITE.latitude)
    )
    accel = C.transpose(0, 2, 1) @ np.array([0.0, 0.0, -PAPER_SITE.gravity])
    gyro = gyro + bias[3:] + rng.standard_normal(gyro.shape) * SPEC.gyro_arw * np.sqrt(hz)
    accel = accel + bias[:3] + rng.standard_normal(accel.shape) * SPEC.accel_vrw * np.sqrt(hz)
    return Samples(t, gyro, accel), bias


def found(profile: Profile, samples: Samples) -> tuple[float, float]:
    return alignment.offset_of_profile(profile, samples.t, samples.gyro)


# --------------------------------------------------------------------------------------------- finding a profile's time


@pytest.mark.parametrize(("profile", "hz"), [(BOTH_WAYS, 133.0), (BOTH_WAYS, 20.0), (TUMBLE, 50.0), (ONE_WAY, 20.0)])
def test_the_offset_is_found_to_within_what_it_claims(profile: Profile, hz: float) -> None:
    errors = []
    for seed in range(20):
        offset = float(np.random.default_rng([seed, 9]).uniform(2.0, 12.0))
        samples, _ = recorded(profile, offset, profile.duration + 18.0, hz, seed)
        at, sd = found(profile, samples)
        assert 0.0 < sd < 0.01
        errors.append((at - offset) / sd)
    assert np.max(np.abs(errors)) < 4.0
    low, high = chi2.ppf([0.001, 0.999], len(errors))
    assert low < np.sum(np.square(errors)) < high


SLEWS = Profile(
    (
        *(dwell(0, 0, 0), dwell(60, 0, 0), dwell(-60, 30, 0), dwell(0, -45, 90), dwell(0, 0, 0)),
        *(rate(axis, dps, 6.0) for axis in ("outer", "middle", "inner") for dps in (60.0, -60.0)),
        dwell(0, 0, 0),
    ),
    align="gyro",
)


def joined(late: dict[str, float], seed: int) -> tuple[float, float]:
    """Offset of a profile by the gyros, beside other effects of motion, and what most channels add to it, ms."""
    others = (
        Effect("lever_arm", (), {"x_m": 0.05, "y_m": -0.08}),
        Effect("scale", ("gx",), {"relative": 4e-3}),
        Effect("scale", ("ay",), {"relative": -3e-3}),
        Effect("cross_axis", ("gz",), {"x_rad": 3e-3}),
    )
    delays = tuple(Effect("delay", (channel,), {"tau_s": 1e-3 * ms}) for channel, ms in late.items())
    samples = simulate(SLEWS, rate_hz=400 / 3, seconds=SLEWS.duration + 2.0, seed=seed, effects=(*others, *delays))[0]
    offset, _ = alignment.offset_of_profile(SLEWS, samples.t, samples.gyro)
    reading = np.hstack([samples.gyro, samples.accel])
    more = alignment.shift_of_most(SLEWS, samples.t, offset, PAPER_SITE, reading, np.zeros(6))
    return 1e3 * offset, 1e3 * more


@pytest.mark.parametrize("late", [{"gx": 6.0, "gz": 6.0}, {"gy": 8.0}])
def test_two_gyros_that_read_late_do_not_move_a_profile_that_four_channels_follow(late: dict[str, float]) -> None:
    starts = [sum(joined(late, seed)) for seed in range(4)]
    plain = [joined({}, seed)[0] for seed in range(4)]
    # without it, two thirds of 6 ms and a third of 8 ms; the gyro that is left knows it to half a millisecond
    assert np.abs(np.subtract(starts, plain)).max() < 1.5


def test_a_triad_that_reads_late_is_not_outvoted_by_the_other() -> None:
    late = sum(joined(dict.fromkeys(("gx", "gy", "gz"), 6.0), 0))
    assert late - joined({}, 0)[0] == pytest.approx(6.0, abs=0.5)


def test_channels_that_agree_leave_a_profile_where_the_gyros_put_it() -> None:
    assert not any(joined({}, seed)[1] for seed in range(20))


# begun before the log, late in it, long before its end, and in the last third of a log that is much longer
@pytest.mark.parametrize(
    ("offset", "seconds"),
    [(-3.0, 60.0), (40.0, 80.0), (60.0, 110.0), (110.0, 150.0), (103.0, 140.0), (700.0, 750.0)],
)
def test_a_profile_is_found_anywhere_in_a_log(offset: float, seconds: float) -> None:
    at, sd = found(SHORT, recorded(SHORT, offset, seconds)[0])
    assert abs(at - offset) < 4.0 * sd


def test_a_profile_that_never_turns_has_no_time_to_be_found() -> None:
    still = Profile((dwell(0, 0, 0, 20.0),), align="gyro")
    with pytest.raises(ValueError, match=r"never turns.*use marks"):
        found(still, recorded(still, 0.0, 20.0)[0])


def _other_axis(profile: Profile) -> Profile:
    """The same segments with outer taken for inner and the like."""
    turn = {"outer": "middle", "middle": "inner", "inner": "outer"}
    return replace(
        profile,
        segments=tuple(
            replace(segment, axis=turn[segment.axis])
            if isinstance(segment, Rate)
            else replace(segment, angles=segment.angles[2:] + segment.angles[:2])
            for segment in profile.segments
            if isinstance(segment, Rate | Dwell)
        ),
    )


@pytest.mark.parametrize(
    "told",
    [
        replace(BOTH_WAYS, sign=(1, 1, -1)),
        _other_axis(BOTH_WAYS),
        Profile((dwell(0, 0, 0), rate("inner", 60.0, 15.0), rate("inner", -60.0, 15.0), dwell(0, 0, 0)), align="gyro"),
        # a rate of +30 deg/s is no rate of -30 deg/s with a gyro bias of 30 deg/s, whatever the time
        replace(ONE_WAY, sign=(1, 1, -1)),
        # the last of them turns little about inner
        *(replace(TURNED, sign=sign) for sign in ((-1, 1, 1), (1, -1, 1), (1, 1, -1))),
    ],
    ids=["sign", "axis", "rate", "one way", "outer", "middle", "inner"],
)
def test_a_profile_of_another_unit_is_refused_in_words(told: Profile) -> None:
    true = next(p for p in (TURNED, ONE_WAY, BOTH_WAYS) if len(p.segments) == len(told.segments))
    with pytest.raises(ValueError, match=r"another profile, another `sign`, or another mounting"):
        found(told, recorded(true, 5.0, true.duration + 12.0)[0])


# --------------------------------------------------------------------------------------------- using an aligned profile


def test_moving_segments_are_used_once_aligned_and_only_then() -> None:
    samples, _ = recorded(BOTH_WAYS, 6.0, 60.0)
    offset, sd = found(BOTH_WAYS, samples)
    tables = [
        TableMotion(profile, PAPER_SITE, SPEC, 0.05, offset, joint)
        for profile, joint in ((BOTH_WAYS, sd), (replace(BOTH_WAYS, align="none"), None))
    ]
    aligned, apart = (table.known(samples.t, -np.inf, samples.gyro) for table in tables)
    assert (aligned[:, reference.VARIANCES] > 0.0).all()
    turning = np.abs(BOTH_WAYS.rates(samples.t - offset)[:, 2]) > np.deg2rad(29.9)
    assert turning.any()
    assert (apart[turning, reference.VARIANCES] < 0.0).all()
    down = aligned[turning, reference.VARIANCES.start + 8]
    assert np.allclose(down, reference.PAPER_R_SD[8] ** 2 + (np.deg2rad(30.0) * sd) ** 2, rtol=1e-6)


def test_biases_of_a_log_aligned_by_its_gyros_are_within_the_band() -> None:
    total = 0.0
    for seed in range(20):
        samples, bias = recorded(TUMBLE, 4.0 + 0.1 * seed, TUMBLE.duration + 10.0, seed=seed)
        offset, sd = found(TUMBLE, samples)
        settings = Settings(
            0.05, reference="profile", motion=TUMBLE, offset=offset, offset_sd=sd, measurements="drawn", seed=seed
        )
        estimator, _ = filtered(settings, samples, every=np.inf)
        total += nees(estimator, bias)
        assert estimator.rejected == 0
        assert estimator.nis_count == samples.t.size - 1
    low, high = chi2.ppf([0.001, 0.999], 120)
    assert low < total < high, f"{total:.1f} of 120"


def test_a_profile_aligned_by_gyros_is_refused_live() -> None:
    """Its place in time is found in the whole log; the error says to record and replay, or to use marks."""
    with pytest.raises(ValueError, match=r"cannot be used live.*marks"):
        Estimator(Settings(0.05, reference="profile", motion=BOTH_WAYS))


# ----------------------------------------------------------------------------- live and replay are the same, bit by bit


MARKS = [(0.2, "segment 1"), (12.33, "next"), (24.0, "segment 5"), (24.01, "no, segment 3"), (36.0, "segment 4")]


@pytest.mark.parametrize(
    ("align", "joint", "marks"),
    [("marks", None, MARKS), ("none", None, MARKS), ("none", 0.01, []), ("gyro", 0.002, [])],
)
@pytest.mark.parametrize("measurements", ["exact", "drawn"])
def test_a_profile_live_and_all_at_once_are_the_same_to_the_last_bit(
    align: str, joint: float | None, marks: list[tuple[float, str]], measurements: str
) -> None:
    samples, _ = recorded(TUMBLE, 2.5, 45.0)
    # marks at the dwells' true times; in "none" they are text and nothing else
    settings = Settings(
        0.05,
        reference="profile",
        motion=replace(TUMBLE, align=align),
        offset=2.5,
        offset_sd=joint,
        measurements=measurements,
        seed=5,
    )
    whole, estimates = same_however_they_come(settings, samples, marks)
    assert len(estimates) == samples.t.size
    assert 0 < whole.nis_count < samples.t.size


def _followed(samples: Samples, hz: float, kind: str) -> Trajectory:
    """What is known of a table's motion, written down as a trajectory every 1 / hz s, partly unknown."""
    t = np.arange(0.0, samples.t[-1], 1.0 / hz) + (0.0 if kind == "whole" else 0.013)
    values = np.tile([PAPER_SITE.latitude, PAPER_SITE.longitude, PAPER_SITE.height, 0, 0, 0, 0, 0, 0], (t.size, 1))
    values[:, 6:9] = attitude.to_rpy(kinematics.attitudes(BOTH_WAYS.angles(t - 2.5)))
    if kind == "yaw":
        values[1:, 6:8] = np.nan
        values[3::7, :3] = np.nan
    if kind == "velocity":
        values[:, 6:9] = np.nan
    return Trajectory(t, values)


@pytest.mark.parametrize("kind", ["whole", "yaw", "velocity"])
def test_a_trajectory_live_and_all_at_once_are_the_same_to_the_last_bit(kind: str) -> None:
    samples, _ = recorded(BOTH_WAYS, 2.5, 45.0)
    settings = Settings(0.05, reference="trajectory", motion=_followed(samples, 4.0, kind))
    _, estimates = same_however_they_come(settings, samples)
    assert len(estimates) == samples.t.size


def test_biases_along_a_known_trajectory_are_right() -> None:
    samples, bias = recorded(BOTH_WAYS, 2.5, 45.0)
    settings = Settings(0.05, reference="trajectory", motion=_followed(samples, 4.0, "whole"))
    estimator, _ = filtered(settings, samples)
    assert np.all(np.abs(normalised(estimator, bias)) < 4.0)
    assert estimator.rejected == 0


def test_a_trajectory_known_from_before_the_log_starts_the_filter_at_the_first_sample() -> None:
    """Rows before the first sample are the past: the filter begins with what is known then, here 90° of yaw later."""
    samples, bias = recorded(BOTH_WAYS, 2.5, 45.0)
    begin = 11.0
    known = _followed(samples, 20.0, "whole")
    use = samples.t >= begin
    part = Samples(samples.t[use] - begin, samples.gyro[use], samples.accel[use])
    settings = Settings(0.05, reference="trajectory", motion=Trajectory(known.t - begin, known.values))
    estimator, estimates = filtered(settings, part)
    expected = kinematics.attitudes(BOTH_WAYS.angles(np.array([begin - 2.5])))[0]
    assert estimator.rejected == 0
    assert np.all(np.abs(normalised(estimator, bias)) < 4.0)
    assert np.allclose(attitude.log(expected @ estimates[0].belief.nav.C_nb.T), 0.0, atol=np.deg2rad(0.5))
