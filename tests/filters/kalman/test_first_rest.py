"""The first rest of a unit turned by hand, told as the readings come: the filter runs on it, and on nothing after."""

import numpy as np
import pytest
from helpers import filtering
from helpers.turned import turned_run

from filters.imu import IMU400CD_200
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


def filtered(given: Readings, reference: str = "turned") -> tuple[Estimator, list[Estimate]]:
    """An estimator after these readings, and its estimates."""
    columns = given.t, given.gyro, given.accel, given.temperature
    return filtering.filtered(Settings(PERIOD, reference=reference), columns, every=0.1)


def test_the_filter_runs_on_the_first_rest_as_on_a_still_unit_and_holds_its_biases() -> None:
    given = readings()
    estimator, made = filtered(given)
    assert 14 * 100 <= estimator.samples <= 15 * 100
    still, alone = filtered(given.part(slice(estimator.samples)), "gravity")
    assert len(made) == len(alone)
    assert np.array_equal(made[-1].belief.P, alone[-1].belief.P)
    assert estimator.observable == still.observable
    assert estimator.first_rest.over
    assert estimator.first_rest.last_t == given.t[-1]


def test_how_many_samples_come_at_once_changes_nothing() -> None:
    given = readings(before=3.2)
    columns = given.t, given.gyro, given.accel, given.temperature
    filtering.same_however_they_come(Settings(PERIOD, reference="turned"), columns, every=0.1)


def test_a_rest_may_come_after_motion_and_be_shorter_than_levelling_takes() -> None:
    estimator, made = filtered(readings(seconds=5.0, before=3.2))
    assert estimator.first_rest.begun == pytest.approx(4.0)
    assert 3 * 100 <= estimator.samples <= 5 * 100
    assert made[0].t >= 4.0
    assert estimator.latest is not None


def test_without_a_rest_nothing_is_used() -> None:
    given = readings()
    gyro = given.gyro + 0.5 * np.sin(3.0 * given.t)[:, None]
    estimator, made = filtered(Readings(given.t, gyro, given.accel, given.temperature))
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
