import itertools

import numpy as np
import pytest

from filters.imu import AxisMap, format_mount, parse_mount
from filters.kalman import runner
from filters.kalman.runner import Estimator
from filters.kalman.settings import Settings
from filters.motion import reference
from filters.state import PAPER_SITE

UPSIDE_DOWN = "x,-y,-z"


def test_every_mounting_reads_back_as_it_was_written() -> None:
    for order in itertools.permutations("xyz"):
        for signs in itertools.product(("", "-"), repeat=3):
            text = ",".join(s + a for s, a in zip(signs, order, strict=True))
            assert format_mount(parse_mount(text)) == text


@pytest.mark.parametrize("text", ["x,y", "x,y,y", "a,b,c", "x;y;z", "--x,y,z", ""])
def test_a_mounting_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="mount"):
        parse_mount(text)


def test_a_left_handed_mounting_is_refused_unless_the_gyro_signs_mend_it() -> None:
    """Determinant -1 would turn rotations round."""
    with pytest.raises(ValueError, match="left-handed"):
        AxisMap(parse_mount("-x,y,z"))
    AxisMap(parse_mount("-x,y,z"), gyro_sign=np.array([1.0, -1.0, -1.0]))


@pytest.mark.parametrize("sign", [0, 2, -3])
def test_an_accelerometer_sign_is_plus_or_minus_one(sign: int) -> None:
    with pytest.raises(ValueError, match=str(sign)):
        AxisMap(accel_sign=sign)


def test_instrument_and_body_are_inverse() -> None:
    axes = AxisMap(parse_mount("-y,z,-x"), 1, np.ones(3))
    v = np.array([1.0, 2.0, 3.0])
    assert np.array_equal(axes.gyro_to_instrument(axes.gyro_to_body(v)), v)
    assert np.array_equal(axes.accel_to_instrument(axes.accel_to_body(v)), v)
    assert np.array_equal(axes.sd_to_instrument(np.abs(axes.gyro_to_body(v))), v)


@pytest.mark.parametrize(("sign", "mount"), [(-1, "x,y,z"), (1, "x,y,z"), (1, UPSIDE_DOWN), (-1, "y,-x,z")])
def test_one_truth_gives_the_same_physics_whatever_the_sign_and_the_mounting(sign: int, mount: str) -> None:
    axes = AxisMap(parse_mount(mount), sign)
    rate, force = reference.level(PAPER_SITE).rates_and_forces()
    bias_reading_gyro = np.array([0.004, -0.006, 0.008])
    bias_reading_accel = np.array([0.05, -0.02, 0.08])
    gyro = axes.gyro_to_instrument(rate) + bias_reading_gyro
    accel = axes.accel_to_instrument(force) + bias_reading_accel

    estimator = Estimator(Settings(0.05))
    body_gyro, body_accel = axes.gyro_to_body(gyro), axes.accel_to_body(accel)
    for k in range(400):
        runner.step(estimator, k * 0.05, body_gyro, body_accel)
    nav = estimator.latest.belief.nav
    assert np.allclose(axes.gyro_to_instrument(nav.gyro_bias), bias_reading_gyro, atol=2e-5)
    assert np.allclose(axes.accel_to_instrument(nav.accel_bias), bias_reading_accel, atol=2e-3)


def test_a_level_unit_with_the_crossbow_sign_reads_plus_gravity_on_z() -> None:
    """s = -1: +0.99793 g on Z at the paper's site, as the contract says."""
    _, force = reference.level(PAPER_SITE).rates_and_forces()
    reading = AxisMap().accel_to_instrument(force) / 9.80665
    assert np.allclose(reading, [0.0, 0.0, 0.99793], atol=5e-6)
