"""A recorded file opens in other people's libraries, however it came about, and a validator finds no fault in it."""

from pathlib import Path

import numpy as np
import pytest
from helpers import readers
from helpers.commands import imutui
from helpers.units import virtual
from reliability import endings, lines
from reliability.shared import once_measured
from rosbags.highlevel import AnyReader

from imutui.logbook import reader, schemas


def in_parts(folder: Path) -> list[Path]:
    """A short recording over the virtual instrument's wire, in three files: the last two go on from the one before."""
    wish = ("--rate", "20", "--duration", "3.5", "--rotate-minutes", "0.02", "-o", str(folder / "a.mcap"))
    with virtual() as port:
        imutui("record", "--port", port, *wish, check=1)
    return sorted(folder.glob("a*.mcap"))


@pytest.fixture
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return once_measured(tmp_path_factory, "foreign", in_parts)[0][0]


@pytest.fixture(params=["rotated", "reconnected", "recovered"])
def any_log(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished file: one that goes on from another, one with a gap and an event of it, one made of what was left."""
    if request.param == "rotated":
        parts = once_measured(tmp_path_factory, "foreign", in_parts)[0]
        assert len(parts) == 3
        return parts[1]
    if request.param == "reconnected":
        _, folder = once_measured(tmp_path_factory, "unplugged", lines.unplugged)
        return next((folder / "logs").glob("*.mcap"))
    _, folder = once_measured(tmp_path_factory, "killed", endings.kill_nine)
    return next((folder / "logs").glob("*_recovered.mcap"))


def test_rosbags_decodes_what_was_recorded(log: Path) -> None:
    own = reader.read(log)
    with AnyReader([log]) as bag:
        imu = [bag.deserialize(data, c.msgtype) for c, _, data in bag.messages() if c.topic == schemas.IMU]
    assert np.array_equal(
        [[m.linear_acceleration.x, m.linear_acceleration.y, m.linear_acceleration.z] for m in imu], own.samples.accel
    )
    assert imu[0].linear_acceleration.z == pytest.approx(-9.79, abs=0.5)


def test_the_typescript_library_decodes_what_was_recorded(log: Path) -> None:
    read = readers.typescript_document(log)
    if read is None:
        pytest.skip("needs node, and NPM_READERS naming a folder where `npm install` was run on package.json")
    own = reader.read(log, raw=True)
    assert read["profile"] == "ros2"
    first = read["topics"][schemas.IMU]["first"]
    assert read["topics"][schemas.IMU]["count"] == len(own.samples)
    assert [first["linear_acceleration"][a] for a in "xyz"] == own.samples.accel[0].tolist()
    assert [first["angular_velocity"][a] for a in "xyz"] == own.samples.gyro[0].tolist()
    assert read["topics"][schemas.RAW]["count"] == len(own.packets)
    assert read["topics"][schemas.RAW]["first"]["counts"] == own.packets["counts"][0].tolist()
    assert set(read["topics"]) >= {schemas.REFERENCE, schemas.DIAGNOSTICS, schemas.ESTIMATE, schemas.TEMPERATURE}


def test_every_reader_finds_every_message(any_log: Path) -> None:
    found = [count for count in (read(any_log) for read in readers.READERS.values()) if count is not None]
    assert len(found) >= 2
    assert all(count == found[0] for count in found)
    own = reader.read(any_log, raw=True)
    assert (found[0][schemas.IMU], found[0][schemas.RAW]) == (len(own.samples), len(own.packets))


def test_a_validator_finds_no_fault(any_log: Path) -> None:
    verdict = readers.by_doctor(any_log)
    if verdict is None:
        pytest.skip("needs pymcap-cli")
    assert (verdict.errors, verdict.warnings) == (0, 0), verdict.texts
