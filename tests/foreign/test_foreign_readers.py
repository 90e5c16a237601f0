"""A recorded file opens in other people's libraries."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import imutui
from helpers.places import own_places
from helpers.processes import LIMIT_S
from helpers.shared import once
from helpers.units import virtual
from rosbags.highlevel import AnyReader

from imutui.logbook import reader, schemas

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short recording over the virtual instrument's wire."""

    def make(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch, virtual() as port:
            own_places(patch, folder)
            wish = ("--rate", "20", "--duration", "3", "-o", str(folder / "a.mcap"))
            imutui("record", "--port", port, *wish, check=1)

    return once(tmp_path_factory, "foreign", make) / "a.mcap"


def test_rosbags_decodes_what_was_recorded(log: Path) -> None:
    """Angular velocity and specific force of every sample, as our own reader has them."""
    own = reader.read(log)
    with AnyReader([log]) as bag:
        imu = [bag.deserialize(data, c.msgtype) for c, _, data in bag.messages() if c.topic == schemas.IMU]
    assert np.array_equal(
        [[m.linear_acceleration.x, m.linear_acceleration.y, m.linear_acceleration.z] for m in imu], own.accel
    )
    assert imu[0].linear_acceleration.z == pytest.approx(-9.79, abs=0.5)


def test_the_typescript_library_decodes_what_was_recorded(log: Path) -> None:
    """@mcap/core reads index, chunks and schemas: stock types and our own, with the values that were recorded."""
    modules = os.environ.get("NPM_READERS")
    if shutil.which("node") is None or modules is None:
        pytest.skip("needs node, and NPM_READERS naming a folder where `npm install` was run on package.json")
    line = ["node", HERE / "read.mjs", log]
    done = subprocess.run(line, cwd=modules, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stderr
    read = json.loads(done.stdout)
    own = reader.read(log, raw=True)
    assert read["profile"] == "ros2"
    first = read["topics"][schemas.IMU]["first"]
    assert read["topics"][schemas.IMU]["count"] == own.stamp_ns.size
    assert [first["linear_acceleration"][a] for a in "xyz"] == own.accel[0].tolist()
    assert [first["angular_velocity"][a] for a in "xyz"] == own.gyro[0].tolist()
    assert read["topics"][schemas.RAW]["count"] == len(own.raw)
    assert read["topics"][schemas.RAW]["first"]["counts"] == list(own.raw[0].counts)
    assert set(read["topics"]) >= {schemas.REFERENCE, schemas.DIAGNOSTICS, schemas.ESTIMATE, schemas.TEMPERATURE}
