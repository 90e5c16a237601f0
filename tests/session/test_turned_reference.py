"""A unit turned by hand over the wire: the filter runs on its first rest, live as in a replay."""

from pathlib import Path

import numpy as np
import pytest
import unit_time
from helpers.acquisitions import replayed, untimed
from helpers.turned import GYRO_BIAS, turned_run

from imutui.session import client
from imutui.session.plan import Plan


def test_live_equals_replay_of_a_unit_that_is_turned(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = turned_run(seed=71, rests=8, seconds=12.0, biased=True)
    source = home / "turned.npz"
    np.savez(source, t=run.t, gyro=np.rad2deg(run.reading[:, :3]), accel=run.reading[:, 3:] / 9.80665)
    with unit_time.virtual("--from", str(source)) as (port, environment):
        for name in ("PYTHONPATH", "IMUTUI_TEST_UNIT_TIME"):
            monkeypatch.setenv(name, environment[name])
        asked = Plan(
            port, logs=str(home / "logs"), record=True, rate_hz=50.0, duration_s=40.0, accel_sign=1, reference="turned"
        )
        live = client.start(asked).wait(120.0)
    assert live is not None
    assert untimed(live) == replayed(live["log"], code=None)
    assert live["reference"] == "turned"
    assert 10 * 50 <= live["samples"] <= 13 * 50
    assert live["duration_s"] > 39.0
    assert np.allclose(live["final"]["gyro_bias_dps"], np.rad2deg(GYRO_BIAS), atol=0.05)
