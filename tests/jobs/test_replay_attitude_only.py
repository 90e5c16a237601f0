"""Replay where only the attitude is known: gyro biases and attitude, and null for what cannot be seen."""

from pathlib import Path

import numpy as np
import pytest
from helpers.traces import arrays, imported

from filters.attitude import to_quaternion
from filters.motion.kinematics import attitudes
from imutui.jobs.replay import replay
from imutui.logbook import results
from imutui.logbook.reading import Reading

BIAS_DPS = (0.30, -0.20, 0.10)
ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


@pytest.mark.parametrize("late_s", [0.0, 3.0])
def test_attitude_gives_attitude_and_gyro_biases(tmp_path: Path, late_s: float) -> None:
    given = arrays(90.0, 50.0)
    quaternion = np.array([to_quaternion(C) for C in ENU.T @ attitudes(np.deg2rad(given.pop("ang")))])
    del given["rate"]
    quaternion[given["t"] < late_s] = np.nan
    quaternion[1000:1200] = np.nan
    rng = np.random.default_rng(1)
    given["gyro"] = given["gyro"] + np.array(BIAS_DPS) + 0.1 * rng.standard_normal(given["gyro"].shape)
    given["ref_quat"] = quaternion
    got = replay(imported(tmp_path / "a.mcap", given), Reading())
    assert got["unobservable"] == [*results.PLACE, "accel_bias_x", "accel_bias_y", "accel_bias_z"]
    final, sd = got["final"], got["sd"]
    assert final["position_deg_m"] == final["velocity_mps"] == final["accel_bias_mg"] == [None] * 3
    assert sd["position_m"] == sd["velocity_mps"] == sd["accel_bias_mg"] == [None] * 3
    for bias, estimate, s in zip(BIAS_DPS, final["gyro_bias_dps"], sd["gyro_bias_dps"], strict=True):
        assert estimate is not None
        assert s is not None
        assert s < 0.02
        assert abs(estimate - bias) < 3.0 * s
    assert got["alarms"] == []
    assert got["converged"]
