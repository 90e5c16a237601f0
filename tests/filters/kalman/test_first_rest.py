"""The first rest of a unit turned by hand, told as the readings come: the filter runs on it, and on nothing after."""

import numpy as np
import pytest
from helpers.turned import turned_run

from filters.imu import IMU400CD_200
from filters.kalman import runner
from filters.kalman.filter_input import Readings
from filters.kalman.first_rest import FirstRest
from filters.kalman.rows import Estimate
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings

PERIOD = 0.01


def readings(seconds: float = 15.0, before: float = 0.0) -> Readings:
    """A unit that is put down for so long, after being moved for some seconds, and then turned by hand."""
    run = turned_run(seed=3, rests=4, seconds=seconds)
    gyro, accel = run.axes.gyro_to_body(run.reading[:, :3]), run.axes.accel_to_body(run.reading[:, 3:])
    if before:
        moving = round(before / PERIOD)
        swing = np.sin(2.0 * np.pi * np.arange(moving) * PERIOD)[:, None] * np.ones(3)
        gyro = np.vstack([gyro[:moving] + swing, gyro])
        accel = np.vstack([accel[:moving] + 2.0 * swing, accel])
    t = np.arange(len(gyro)) * PERIOD
    return Readings(t, gyro, accel, np.full(t.size, np.nan))


def filtered(given: Readings, size: int, reference: str = "turned") -> tuple[Estimator, list[Estimate]]:
    """An estimator after these readings, so many at a time, and its estimates."""
    estimator = Estimator(Settings(PERIOD, reference=reference), every=0.1)
    made: list[Estimate] = []
    for first in range(0, given.t.size, size):
        part = given.part(slice(first, first + size))
        last = first + size >= given.t.size
        made += runner.run(estimator, part.t, part.gyro, part.accel, part.temperature, last=last)
    return estimator, made


def test_the_filter_runs_on_the_first_rest_as_on_a_still_unit_and_holds_its_biases() -> None:
    given = readings()
    estimator, made = filtered(given, 4096)
    assert 14 * 100 <= estimator.samples <= 15 * 100
    still, alone = filtered(given.part(slice(estimator.samples)), 4096, "gravity")
    assert len(made) == len(alone)
    assert np.array_equal(made[-1].belief.P, alone[-1].belief.P)
    assert estimator.observable == still.observable
    assert estimator.first_rest is not None
    assert estimator.first_rest.over
    assert estimator.first_rest.last_t == given.t[-1]


@pytest.mark.parametrize("size", [1, 37])
def test_how_many_samples_come_at_once_changes_nothing(size: int) -> None:
    given = readings(before=3.2)
    one, made = filtered(given, size)
    all_at_once, expected = filtered(given, given.t.size)
    assert one.samples == all_at_once.samples
    assert [e.t for e in made] == [e.t for e in expected]
    assert np.array_equal(made[-1].belief.P, expected[-1].belief.P)
    assert np.array_equal(made[-1].belief.nav.gyro_bias, expected[-1].belief.nav.gyro_bias)


def test_a_rest_may_come_after_motion_and_be_shorter_than_levelling_takes() -> None:
    estimator, made = filtered(readings(seconds=5.0, before=3.2), 4096)
    assert estimator.first_rest is not None
    assert estimator.first_rest.begun == pytest.approx(4.0)
    assert 3 * 100 <= estimator.samples <= 5 * 100
    assert made[0].t >= 4.0
    assert estimator.latest is not None


def test_without_a_rest_nothing_is_used() -> None:
    given = readings()
    gyro = given.gyro + 0.5 * np.sin(3.0 * given.t)[:, None]
    estimator, made = filtered(Readings(given.t, gyro, given.accel, given.temperature), 4096)
    assert not made
    assert estimator.latest is None


def test_a_slow_turn_ends_the_rest() -> None:
    given = readings(seconds=60.0).part(slice(0, 5500))
    tilt = np.deg2rad(0.3) * np.maximum(given.t - 20.0, 0.0)
    accel = given.accel + 9.8 * np.sin(tilt)[:, None] * np.array([1.0, 0.0, 0.0])
    rest = FirstRest(PERIOD, IMU400CD_200)
    used = rest.take(Readings(given.t, given.gyro, accel, given.temperature))
    assert 19.0 < used.t[-1] < 30.0
    assert rest.over
