"""A virtual unit of an acquisition's own turns as the operator of a profile says, and what is recorded is right."""

from pathlib import Path

import numpy as np
import pytest
from helpers.processes import wait_until

from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate
from filters.simulation import Scenario
from imutui.cli.demo import truth
from imutui.cli.virtual_readings import SimulatedReadings, TurnedReadings
from imutui.logbook import reader
from imutui.session import client, table_turner
from imutui.session.plan import VIRTUAL_PORT, Plan
from imutui.session.table_turner import TableTurner

PROFILE = """
align = "marks"
slew_dps = 60.0

[[segment]]
kind = "dwell"
angles_deg = [0.0, 0.0, 0.0]
seconds = 10.0

[[segment]]
kind = "dwell"
angles_deg = [90.0, 0.0, 0.0]
seconds = 10.0

[[segment]]
kind = "dwell"
angles_deg = [0.0, -90.0, 0.0]
seconds = 10.0
"""


def test_the_unit_reads_the_motion_that_the_turner_knows() -> None:
    lines: list[str] = []
    turner = TableTurner(lines.append)
    steps = [Dwell((np.pi / 2, 0.0, 0.0), 5.0), Dwell((np.pi / 2, 0.0, 1.0), 5.0), Rate("inner", 0.5, 2.0)]
    profile = Profile(tuple(steps), sign=(1, 1, -1), align="marks")
    now = 0
    still = SimulatedReadings(Scenario(seed=3))
    turned = TurnedReadings(SimulatedReadings(Scenario(seed=3)), still.unit)
    rate_hz, k = still.unit.rate_hz, 0
    for step in steps:
        turner.turn(profile, step, now)
        with pytest.raises(ValueError, match="turns for another"):
            turner.turn(profile, step, now)
        turned.turn(lines[-1])
        motion = table_turner.motion_of(lines[-1])
        angle = np.zeros(3)
        for _ in range(int((motion.duration + 0.1) * rate_hz)):
            difference = np.subtract(turned.reading(k).rates_dps, still.reading(k).rates_dps)
            angle += difference / rate_hz
            k += 1
        # of what turns about the vertical, and by less than the whole, only the axis that is vertical tells
        moved = np.rad2deg(motion.angles(motion.duration) - motion.angles(0.0))[0]
        assert np.abs(np.abs(angle).max() - np.abs(moved).max()) < 0.5
        assert not turner.has_arrived(now)
        now += round((motion.duration + 1.0) * 1e9)
        assert turner.has_arrived(now)
        assert not turner.has_arrived(now)
    x, y, z = turned.reading(k).accels_g
    assert abs(np.hypot(x, y) - 1.0) < 0.1  # on its side, as the first of them left it
    assert abs(z) < 0.1


def test_a_profile_is_gone_through_on_a_virtual_unit_and_its_biases_are_found(home: Path) -> None:
    plan = Plan(
        VIRTUAL_PORT,
        20.0,
        logs=str(home / "logs"),
        reference="profile",
        reference_file=("three.toml", PROFILE),
        virtual=("--seed", "3"),
    )
    connection = client.start(plan, timeout=90.0)

    def guide() -> dict:  # type: ignore[type-arg]
        return dict(connection.snapshot(2**62)["guide"] or {})

    connection.guide("begin")
    for step in range(3):
        wait_until(lambda step=step: (guide()["state"], guide()["segment"]) == ("go", step))  # type: ignore[misc]
        connection.guide("next")
        if step:
            assert guide()["turns_s"] > 0.0
        wait_until(lambda: guide()["state"] in ("hold", "done"))
    wait_until(lambda: guide()["state"] == "done")
    result = connection.stop() or {}
    marks = [event.text for event in reader.read(Path(result["log"])).events if event.name == "mark"]
    assert marks == ["segment 1", "segment 2", "segment 3"]
    found, true = result["final"], truth(3)
    for name in ("gyro_bias_dps", "accel_bias_mg"):
        error = np.subtract(found[name], true[name]) / result["sd"][name]
        assert np.abs(error).max() < 3.0, (name, error)
