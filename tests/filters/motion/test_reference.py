from itertools import pairwise

import numpy as np
import pytest
from helpers.filtering import bias_errors, dwell, filtered, normalised
from scipy.spatial.transform import Rotation
from scipy.stats import binom, chi2

from filters import attitude, earth, simulation, state
from filters.imu import IMU400CD_200, ImuSpec, Samples
from filters.kalman.runner import Estimator
from filters.kalman.settings import P0_ACCEL_BIAS_SD, P0_GYRO_BIAS_SD, Settings
from filters.motion import kinematics, reference
from filters.motion.profile import Profile
from filters.motion.reference import TableMotion
from filters.motion.segments import AXES, Dwell, Rate
from filters.simulation import Truth
from filters.state import PAPER_SITE

SPEC = IMU400CD_200
P0_BIAS_SD = np.repeat([P0_ACCEL_BIAS_SD, P0_GYRO_BIAS_SD], 3)


# +z, ±y, -z, ±x up, then 50 deg/s both ways about each axis
TUMBLE = (
    *(dwell(outer, 0, 0, 6.0) for outer in (0, 90, 180, 270)),
    dwell(0, 90, 0, 6.0),
    dwell(0, -90, 0, 6.0),
    dwell(0, 0, 0, 6.0),
)
RATES = tuple(Rate(axis, np.deg2rad(sign * 50.0), 6.0) for axis in AXES for sign in (1, -1))
SIX_POSITIONS_AND_RATES = Profile((*TUMBLE, *RATES), offset_sd=0.0)


def run(samples: Samples, settings: Settings, marks: list[tuple[float, str]] | None = None) -> Estimator:
    return filtered(settings, samples, marks or [], every=np.inf)[0]


# ------------------------------------------------------------------------------------------- the table, perfectly known


@pytest.mark.parametrize(("hz", "seeds"), [(133.0, 8), (20.0, 30)])
def test_biases_found_on_a_table_are_as_good_as_the_filter_says(hz: float, seeds: int) -> None:
    nees, outside = 0.0, 0
    profile = SIX_POSITIONS_AND_RATES
    for seed in range(seeds):
        bias = np.random.default_rng([seed, 5]).standard_normal(6) * P0_BIAS_SD
        truth = Truth(bias[:3], bias[3:])
        samples, _ = simulation.simulate(profile, rate_hz=hz, seconds=profile.duration, seed=seed, truth=truth)
        settings = Settings(1.0 / hz, reference="profile", motion=profile, measurements="drawn", seed=seed)
        estimator = run(samples, settings)
        error, P = bias_errors(estimator, truth)
        nees += float(error @ np.linalg.solve(P, error))
        outside += int(np.sum(np.abs(error) > 3.0 * np.sqrt(np.diag(P))))
        # rows of the table were used at every sample but the first, and none was thrown out
        assert estimator.nis_count == samples.t.size - 1
        assert estimator.dof == 9.0
        assert estimator.rejected == 0
        assert estimator.observable == (True,) * 6
    low, high = chi2.ppf([0.001, 0.999], 6 * seeds)
    assert low < nees < high, f"{nees:.1f} of {6 * seeds}, band {low:.1f} to {high:.1f}"
    assert outside <= binom.ppf(0.999, 6 * seeds, 0.0027)


def test_a_table_taken_as_exact_leaves_errors_within_three_sd() -> None:
    outside = 0
    profile = SIX_POSITIONS_AND_RATES
    for seed in range(20):
        samples, truth = simulation.simulate(profile, rate_hz=20.0, seconds=profile.duration, seed=seed)
        estimator = run(samples, Settings(0.05, reference="profile", motion=profile))
        outside += int(np.sum(np.abs(normalised(estimator, truth)) > 3.0))
        assert estimator.converged
    assert outside <= binom.ppf(0.999, 120, 0.0027)


def test_an_angle_that_the_profile_has_wrong_is_no_longer_within_the_band() -> None:
    """The test above can fail: one dwell a degree off, and some bias is many sd wrong."""
    profile = SIX_POSITIONS_AND_RATES
    told = Profile((*TUMBLE[:1], dwell(91, 0, 0, 6.0), *TUMBLE[2:], *RATES), offset_sd=0.0)
    samples, truth = simulation.simulate(profile, rate_hz=20.0, seconds=profile.duration, seed=1)
    assert np.max(np.abs(normalised(run(samples, Settings(0.05, reference="profile", motion=told)), truth))) > 5.0


def test_a_perfect_unit_reads_what_the_reference_says() -> None:
    quiet = simulation.simulate(
        SIX_POSITIONS_AND_RATES,
        rate_hz=20.0,
        seconds=SIX_POSITIONS_AND_RATES.duration,
        spec=ImuSpec(gyro_arw=0.0, accel_vrw=0.0),
        truth=Truth(np.zeros(3), np.zeros(3)),
    )[0]
    known = TableMotion(SIX_POSITIONS_AND_RATES, PAPER_SITE, SPEC, 0.05).known(quiet.t, -np.inf, quiet.gyro)
    assert np.allclose(known[:, reference.RATE], quiet.gyro, rtol=0.0, atol=1e-12)
    assert np.allclose(known[:, reference.FORCE], quiet.accel, rtol=0.0, atol=1e-11)


def test_a_joint_that_is_not_exact_adds_rate_times_its_sd_to_attitude() -> None:
    profile = Profile((Rate("inner", np.deg2rad(50.0), 10.0),), offset_sd=0.01)
    known = TableMotion(profile, PAPER_SITE, SPEC, 0.05).known(np.array([5.0]), -np.inf, np.zeros((1, 3)))[0]
    expected = reference.PAPER_R_SD**2
    expected[8] += np.deg2rad(0.5) ** 2
    assert np.allclose(known[reference.VARIANCES], expected, rtol=1e-9)


def test_without_a_joint_only_settled_dwells_are_used() -> None:
    """Profile time is log time, nobody says how exactly: rows from 2 s after coming to rest, and in the first dwell."""
    profile = Profile((dwell(0, 0, 0, 5.0), dwell(0, 90, 0, 5.0), RATES[0], dwell(0, 0, 0, 5.0)))
    t = np.arange(0.0, profile.duration + 5.0, 0.05)
    table = TableMotion(profile, PAPER_SITE, SPEC, 0.05)
    gyro = kinematics.body_rate(profile.angles(t), profile.rates(t))
    used = table.known(t, -np.inf, gyro)[:, 10] >= 0.0
    expected = t < 5.0 - 1e-9
    for start, end in zip(profile.rest_starts[[1, 3]], [profile.starts[2], np.inf], strict=True):
        expected |= (t >= start + 2.0) & (t < end - 1e-9)
    near = np.abs(t[:, None] - profile.rest_starts[None, [1, 3]] - 2.0).min(axis=1) < 1e-6
    assert np.array_equal(used[~near], expected[~near])
    # a gyro that is not quiet says the table does not rest, whatever the profile says
    loud = gyro.copy()
    loud[20] = table.quiet * 1.01
    assert not table.known(t, -np.inf, loud)[20, 10] >= 0.0


# --------------------------------------------------------------------------------------------------- aligned by marks

MARKED = Profile((dwell(0, 0, 0, 8.0), dwell(0, 90, 0, 8.0), RATES[0], dwell(90, 0, 0, 8.0)), align="marks")


def rows(marks: list[tuple[float, str]], t: np.ndarray, gyro: np.ndarray | None = None) -> np.ndarray:
    table = TableMotion(MARKED, PAPER_SITE, SPEC, 0.05)
    for mark in marks:
        table.mark(*mark)
    return table.known(t, -np.inf, np.zeros((t.size, 3)) if gyro is None else gyro)


def test_rows_are_used_from_two_seconds_after_a_mark_and_never_beyond_the_dwells_end() -> None:
    t = np.arange(0.0, 60.0, 0.25)
    known = rows([(3.0, "segment 1"), (20.0, "segment 2"), (45.0, "segment 4")], t)
    used = (known[:, reference.VARIANCES] >= 0.0).all(axis=1)
    assert np.array_equal(used, (known[:, reference.VARIANCES] >= 0.0).any(axis=1))
    may = np.zeros(t.size, bool)
    for at, angles in ((3.0, (0, 0, 0)), (20.0, (0, 90, 0)), (45.0, (90, 0, 0))):
        # how much of a dwell's end is left to marks that come late is the reference's own affair, up to 2 s
        assert used[(t >= at + 2.0) & (t <= at + 6.0)].all()
        may |= (t >= at + 2.0) & (t <= at + 8.0)
        here = used & (t >= at) & (t <= at + 8.0)
        C_nb = Rotation.from_euler("XYZ", np.deg2rad(angles)).as_matrix()
        for quaternion in known[here, reference.QUATERNION]:
            assert np.allclose(attitude.from_quaternion(quaternion), C_nb, atol=1e-12)
        assert np.allclose(known[here, reference.FORCE], C_nb.T @ [0, 0, -PAPER_SITE.gravity], atol=1e-12)
        assert np.allclose(known[here, reference.RATE], C_nb.T @ earth.earth_rate_n(PAPER_SITE.latitude), atol=1e-15)
    assert not used[~may].any()
    # in between a perfect unit's readings are not known either: no residual is made of them
    assert np.isnan(known[~used, reference.RATE]).all()
    assert np.isnan(known[~used, reference.FORCE]).all()


def test_plain_marks_take_the_dwells_in_order() -> None:
    t = np.arange(0.0, 60.0, 0.25)
    told = rows([(3.0, "segment 1"), (20.0, "segment 2"), (45.0, "segment 4")], t)
    for texts in (
        ("x", "y", "z"),
        ("here", "Dwell 2 now", "next"),
        ("", "", ""),
        (" segment 1", "turned", "SEGMENT 4"),
    ):
        marks = list(zip((3.0, 20.0, 45.0), texts, strict=True))
        assert np.array_equal(rows(marks, t), told, equal_nan=True)
    # what is no dwell, or not there, changes nothing
    marks = [(3.0, "a"), (15.0, "segment 3"), (16.0, "segment 9"), (20.0, "b"), (45.0, "c"), (55.0, "one too many")]
    assert np.array_equal(rows(marks, t), told, equal_nan=True)


def test_a_dwell_that_is_said_to_end_is_used_no_more() -> None:
    t = np.arange(0.0, 60.0, 0.25)
    whole = rows([(3.0, "segment 1"), (20.0, "segment 2"), (40.0, "segment 2")], t)
    cut = rows([(3.0, "segment 1"), (20.0, "segment 2"), (24.0, "segment 2 ends"), (40.0, "segment 2")], t)
    ended = (t >= 24.0) & (t < 40.0)
    assert np.array_equal(cut[~ended], whole[~ended], equal_nan=True)
    assert np.isfinite(whole[ended, reference.RATE]).any()
    assert np.isnan(cut[ended, reference.RATE]).all()
    assert (cut[ended, reference.VARIANCES] < 0.0).all()


def test_a_gyro_that_is_not_quiet_keeps_rows_back() -> None:
    t = np.arange(5.0, 6.0, 0.05)
    quiet = TableMotion(MARKED, PAPER_SITE, SPEC, 0.05).quiet
    assert quiet == pytest.approx(3.0 * SPEC.gyro_bias_limit + 5.0 * SPEC.gyro_arw / np.sqrt(0.05))
    gyro = np.zeros((t.size, 3))
    gyro[3, 0], gyro[7, 1], gyro[9, 2], gyro[11, 2] = 1.01 * quiet, -1.01 * quiet, 1.01 * quiet, 0.99 * quiet
    used = rows([(1.0, "segment 1")], t, gyro)[:, 10] >= 0.0
    assert np.flatnonzero(~used).tolist() == [3, 7, 9]


def marked(profile: Profile, seed: int, hz: float, late: float, at_rest: bool = True) -> tuple[np.ndarray, Estimator]:
    """Normalised bias errors with a mark for each dwell, `late` s after the table comes to rest (or begins to move)."""
    samples, truth = simulation.simulate(profile, rate_hz=hz, seconds=profile.duration, seed=seed)
    starts = profile.rest_starts if at_rest else profile.starts
    dwells = [k for k, segment in enumerate(profile.segments) if isinstance(segment, Dwell)]
    estimator = run(
        samples,
        Settings(1.0 / hz, reference="profile", motion=profile),
        [(float(starts[k]) + late, f"segment {k + 1}") for k in dwells],
    )
    return normalised(estimator, truth), estimator


POSITIONS = Profile(
    (dwell(0, 0, 0, 8.0), dwell(0, 90, 0, 8.0), dwell(90, 0, 0, 8.0), RATES[0], dwell(0, -90, 0, 8.0)), align="marks"
)


@pytest.mark.parametrize(("late", "at_rest"), [(0.0, True), (1.0, True), (3.0, True), (0.0, False)])
def test_marks_that_come_late_do_not_harm_the_biases(late: float, at_rest: bool) -> None:
    outside = 0
    for seed in range(12):
        error, estimator = marked(POSITIONS, seed, 20.0, late, at_rest)
        outside += int(np.sum(np.abs(error) > 3.0))
        assert estimator.rejected == 0
        assert estimator.alarms() == []
        assert 0 < estimator.nis_count < 0.75 * POSITIONS.duration * 20.0
    assert outside <= binom.ppf(0.999, 72, 0.0027)


def test_a_late_mark_on_a_slow_table_does_not_harm_the_biases_either() -> None:
    """At 5 deg/s the gyros look quiet while the table moves on; the dwell's end by the clock is not enough."""
    slow = Profile(
        (*MARKED.segments[:2], dwell(90, 0, 0, 8.0), dwell(0, 90, 0, 8.0)), align="marks", slew=np.deg2rad(5)
    )
    error, estimator = marked(slow, 2, 133.0, 1.0)
    assert estimator.rejected == 0
    assert np.max(np.abs(error)) < 5.0


def test_a_move_is_predicted_through_and_found_where_the_table_stops() -> None:
    profile = Profile((dwell(0, 0, 0, 8.0), dwell(0, 90, 0, 8.0)), align="marks")
    samples, _ = simulation.simulate(profile, rate_hz=20.0, seconds=profile.duration, seed=4)
    marks = [(float(t), f"segment {k + 1}") for k, t in enumerate(profile.rest_starts)]
    _, estimates = filtered(Settings(0.05, reference="profile", motion=profile), samples, marks)
    t = np.array([e.t for e in estimates])
    updated = np.array([e.dof > 0 for e in estimates])
    start = profile.rest_starts[1]
    assert not updated[(t > 8.01) & (t < start + 1.99)].any()
    assert updated[(t > start + 2.01) & (t < start + 5.99)].all()
    sd = np.array([np.sqrt(e.belief.P[state.ATTITUDE.start, state.ATTITUDE.start]) for e in estimates])
    between = np.flatnonzero(~updated & (t > 8.0) & (t < start + 3.0))
    assert all(b > a for a, b in pairwise(sd[between]))
    meets = estimates[between[-1] + 1]
    assert meets.nis < chi2.ppf(0.999, 9)


# ------------------------------------------------------------------------------------------------- a part of a profile


@pytest.mark.parametrize("align", ["none", "gyro"])
def test_a_log_that_begins_in_the_middle_of_a_profile_starts_where_the_table_is(align: str) -> None:
    profile = Profile((dwell(0, 0, 0, 8.0), dwell(90, 0, 0, 20.0), dwell(0, 0, 0, 8.0)), align=align, offset_sd=0.0)
    samples, truth = simulation.simulate(profile, rate_hz=20.0, seconds=profile.duration, seed=1)
    use = samples.t >= 16.0
    part = Samples(samples.t[use] - 16.0, samples.gyro[use], samples.accel[use])
    estimator = run(part, Settings(0.05, reference="profile", motion=profile, offset=-16.0, offset_sd=0.0))
    C_nb = estimator.reference.start()[0].C_nb
    assert estimator.rejected == 0
    assert np.all(np.abs(normalised(estimator, truth)) < 4.0)
    assert np.allclose(C_nb, Rotation.from_euler("XYZ", [np.deg2rad(90.0), 0.0, 0.0]).as_matrix(), atol=1e-9)


def test_rows_of_a_part_are_those_of_the_whole() -> None:
    t = np.arange(0.0, SIX_POSITIONS_AND_RATES.duration, 0.05)
    gyro = np.zeros((t.size, 3))
    for profile in (SIX_POSITIONS_AND_RATES, Profile((*TUMBLE, *RATES))):
        whole = TableMotion(profile, PAPER_SITE, SPEC, 0.05).known(t, -np.inf, gyro)
        use = t >= 20.0
        part = TableMotion(profile, PAPER_SITE, SPEC, 0.05, offset=-20.0).known(t[use] - 20.0, -np.inf, gyro[use])
        assert np.allclose(part, whole[use], rtol=1e-9, atol=1e-12, equal_nan=True)
