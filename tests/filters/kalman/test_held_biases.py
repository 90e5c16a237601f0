"""After the reference has ended: biases are held with their covariance, nothing is integrated, however samples come."""

import itertools

import numpy as np
import pytest
from helpers.filtering import normalised, same_however_they_come

from filters import simulation
from filters.imu import Noise, Samples
from filters.kalman import layout, runner
from filters.kalman.long_gap import stretches
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings
from filters.motion import reference
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from filters.motion.segments import Dwell, Rate
from filters.state import PAPER_SITE

HZ = 20.0
MARKED = Profile((Dwell((0.0, 0.0, 0.0), 20.0), Dwell((np.pi / 2.0, 0.0, 0.0), 20.0)), align="marks")
MARKS = ((0.0, "segment 1"), (24.0, "segment 2"))
SPUN = Profile((Dwell((0.0, 0.0, 0.0), 25.0), Rate("inner", 0.5, 5.0)))
WALK = Noise((0.017,) * 3, (0.0013,) * 3, (1e-4,) * 3, (1e-5,) * 3)


def still_for(seconds: float) -> tuple[Settings, Profile]:
    """A trajectory that is level and at rest, a row a second, for so long."""
    t = np.arange(0.0, seconds + 0.5)
    values = np.zeros((t.size, 9))
    values[:, :3] = PAPER_SITE.latitude, PAPER_SITE.longitude, PAPER_SITE.height
    return Settings(1.0 / HZ, reference="trajectory", motion=Trajectory(t, values)), Profile((Dwell((0.0,) * 3, 1e3),))


CASES = {
    "trajectory": (*still_for(25.0), 27.0, ()),
    "marks": (Settings(1.0 / HZ, reference="profile", motion=MARKED), MARKED, 44.0, MARKS),
    "rate": (Settings(1.0 / HZ, reference="profile", motion=SPUN), SPUN, SPUN.duration, ()),
}  # fmt: skip


def readings(motion: Profile, seconds: float) -> Samples:
    return simulation.simulate(motion, rate_hz=HZ, seconds=seconds, seed=3)[0]


def run(
    settings: Settings, samples: Samples, marks: tuple[tuple[float, str], ...], size: int
) -> tuple[Estimator, np.ndarray]:
    """The filter over samples that come so many at once, and its rows."""
    estimator = Estimator(settings, every=0.5)
    for mark in marks:
        estimator.mark(*mark)
    made = [
        rows
        for first in range(0, samples.t.size, size)
        for rows in runner.rows(
            estimator,
            *(column[first : first + size] for column in (samples.t, samples.gyro, samples.accel)),
            last=False,
        )
    ]
    return estimator, np.concatenate(made)


@pytest.mark.parametrize("name", CASES)
def test_biases_are_held_and_nothing_is_integrated_once_the_reference_has_ended(name: str) -> None:
    settings, motion, end, marks = CASES[name]
    samples = readings(motion, 300.0)
    estimator, rows = run(settings, samples, marks, 8192)
    assert estimator.held_since == pytest.approx(end, abs=0.11)
    until = samples.t <= estimator.held_since + 1e-9
    before, _ = run(
        settings,
        Samples(samples.t[until], samples.gyro[until], samples.accel[until]),
        marks,
        8192,
    )
    last, then = estimator.latest, before.latest
    assert np.array_equal(last.belief.nav.accel_bias, then.belief.nav.accel_bias)
    assert np.array_equal(last.belief.P, then.belief.P), "Table 1 has no walk of the biases"
    assert last.t == samples.t[-1]
    assert estimator.taken == samples.t.size
    assert abs(float(last.belief.nav.height) - PAPER_SITE.height) < 100.0
    held = rows[rows[:, layout.OUT_T] > estimator.held_since]
    assert np.isnan(held[:, layout.OUT_NAV : layout.OUT_NAV + layout.NAV_BA]).all()
    assert np.isfinite(held[:, layout.OUT_NAV + layout.NAV_BA : layout.OUT_NIS]).all()
    assert np.allclose(np.diff(rows[:, layout.OUT_T]), 0.5)


@pytest.mark.parametrize("name", CASES)
def test_it_is_the_same_however_many_samples_come_at_once(name: str) -> None:
    settings, motion, _, marks = CASES[name]
    estimator, _ = same_however_they_come(settings, readings(motion, 50.0), marks, every=0.5)
    assert estimator.held_since is not None


def test_the_walk_of_the_biases_adds_to_their_covariance_while_they_are_held() -> None:
    settings, motion, end, _ = CASES["trajectory"]
    noisy = Settings(settings.period, reference="trajectory", motion=settings.motion, noise=WALK)
    sds = []
    for seconds in (60.0, 260.0):
        estimator, _ = run(noisy, readings(motion, seconds), (), 8192)
        sds.append(np.diag(estimator.latest.belief.P)[9:])
    assert np.allclose(sds[1] - sds[0], np.repeat([1e-8, 1e-10], 3) * 200.0, rtol=1e-6)
    assert end < 60.0


def test_another_mark_is_a_reference_again() -> None:
    settings, _, _, marks = CASES["marks"]
    again = Profile((*MARKED.segments, Dwell((0.0, 0.0, 0.0), 300.0)))
    samples = readings(again, 130.0)
    estimator, rows = run(settings, samples, (*marks, (100.0, "segment 1")), 8192)
    assert estimator.held_since == pytest.approx(120.0, abs=0.2) or estimator.held_since is None
    told = rows[(rows[:, layout.OUT_T] > 104.0) & (rows[:, layout.OUT_T] < 116.0)]
    assert np.isfinite(told[:, layout.OUT_NAV : layout.OUT_NIS]).all()
    assert estimator.alarms() == []


@pytest.mark.parametrize(("first", "between"), [(28.0, 0.0), (300.0, 0.0), (1.0, 300.0)])
def test_an_operator_may_take_as_long_as_it_takes(first: float, between: float) -> None:
    waits = (*(Dwell(dwell.angles, dwell.seconds + between) for dwell in MARKED.segments if isinstance(dwell, Dwell)),)
    moved = Profile((Dwell((0.0, 0.0, 0.0), first + 20.0 + between), waits[1]))
    settings, arrived = Settings(1.0 / HZ, reference="profile", motion=MARKED), moved.rest_starts[1] + 0.5
    errors = []
    for seed in range(4):
        samples, truth = simulation.simulate(moved, rate_hz=HZ, seconds=float(arrived) + 20.0, seed=seed)
        estimator, rows = run(settings, samples, ((first, "segment 1"), (float(arrived), "segment 2")), 8192)
        assert estimator.alarms() == []
        assert estimator.rejected == 0
        before = rows[(rows[:, layout.OUT_T] > 0.0) & (rows[:, layout.OUT_T] < first)]
        assert np.isnan(before[:, layout.OUT_NAV]).all()
        errors.append(normalised(estimator, truth))
    # six biases of four runs, standard normal: the mean of 24 squares is beyond 2 once in a thousand
    assert np.mean(np.square(errors)) < 2.0


def test_a_profile_by_marks_awaits_its_first_dwell() -> None:
    """Until then nothing is known, which is not the end of a reference."""
    settings, motion, _, _ = CASES["marks"]
    estimator, _ = run(settings, readings(motion, 10.0), (), 64)
    assert estimator.awaits_reference
    assert estimator.held_since is None
    estimator.mark(10.0, "segment 1")
    later = readings(motion, 15.0)
    new = later.t > 9.99
    list(runner.rows(estimator, later.t[new], later.gyro[new], later.accel[new], last=False))
    assert not estimator.awaits_reference


def test_stretches_are_in_order_and_leave_no_sample_out() -> None:
    ended, whole, nothing = (np.zeros(reference.COLUMNS) for _ in range(3))
    ended[reference.VARIANCES], nothing[reference.VARIANCES] = reference.ENDED, -1.0
    for kinds in itertools.product((ended, whole, nothing), repeat=4):
        for begun, is_held in ((0, False), (7, False), (7, True)):
            found = stretches(np.array(kinds), 4, begun, is_held=is_held)
            assert [first for first, _, _ in found] == [0, *(last for _, last, _ in found[:-1])]
            assert found[-1][1] == 4
            assert begun or not found[0][2]
    assert stretches(np.array([ended, ended]), 2, 0, is_held=False) == [(0, 1, False), (1, 2, True)]
    assert stretches(np.array([nothing, whole]), 2, 5, is_held=True) == [(0, 1, True), (1, 2, False)]
