from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from helpers.units import Still, served

from imutui.instrument.driver import InstrumentError
from imutui.instrument.imu400.crossbow import Mode
from imutui.instrument.imu400.driver import Imu400cd
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.port import Port
from imutui.session import client


@contextmanager
def unit(options: UnitOptions) -> Iterator[tuple[str, VirtualUnit]]:
    made = VirtualUnit(Still(), options)
    with served(made) as path:
        yield path, made


@pytest.mark.parametrize("ping", ["keeps", "stops", "resets"])
def test_the_dialogue_is_right_whatever_a_ping_does(ping: str) -> None:
    with unit(UnitOptions(ping=ping, version="IMU400CD-200 1.07")) as (path, made), Port(path, 38400) as port:  # type: ignore[arg-type]
        identity = Imu400cd(port).open(38400)
        assert identity.serial_number == "9911750"
        assert identity.version == "IMU400CD-200 1.07"
        assert made.mode is Mode.SCALED
        assert not made.streaming


def test_a_unit_left_streaming_is_stopped_first() -> None:
    """Stale packets, FF-rich as they are, are not taken for replies."""
    with unit(UnitOptions()) as (path, made), Port(path, 38400) as port:
        Imu400cd(port).open(38400)
        port.write(b"C")
        port.read(100)
        assert made.streaming
        assert Imu400cd(port).open(38400).serial_number == "9911750"
        assert not made.streaming


def test_the_line_is_moved_to_the_asked_speed_and_found_there_again() -> None:
    """Auto-baud to 57600; a later host that starts at 38400 finds the unit and moves it back."""
    with unit(UnitOptions()) as (path, made):
        with Port(path, 38400) as port:
            Imu400cd(port).open(57600)
            assert made.baud == port.baud == 57600
        with Port(path, 38400) as port:
            Imu400cd(port).open(38400)
            assert made.baud == port.baud == 38400


@pytest.mark.parametrize(
    "version", ["AHRS400CC-100 v2", "VG700MB", "IMU300CC-100", "IMU440CA-200", "IMU400CC-200", "DMU-6X"]
)
def test_another_model_is_refused_by_name(version: str) -> None:
    with (
        unit(UnitOptions(version=version)) as (path, _),
        Port(path, 38400) as port,
        pytest.raises(InstrumentError, match=version.split()[0]),
    ):
        Imu400cd(port).open(38400)


@pytest.mark.usefixtures("home")
def test_a_probe_tells_what_answers_and_leaves_the_unit_for_the_next_host() -> None:
    """Model, serial number, firmware and speed; whatever it did before it is polled afterwards, and can be used."""
    with unit(UnitOptions(version="IMU400CD-200 1.07")) as (path, made):
        with Port(path, 38400) as port:
            Imu400cd(port).open(57600)
            port.write(b"C")
            port.read(100)
        found = client.probe(path)
        assert found == {
            "port": path, "answers": True, "instrument": "IMU400CD-200", "serial_number": "9911750",
            "firmware": "IMU400CD-200 1.07", "baud": 57600, "error": None,
        }  # fmt: skip
        assert not made.streaming
        with Port(path, 38400) as port:
            assert Imu400cd(port).open(57600).serial_number == "9911750"


@pytest.mark.usefixtures("home")
def test_a_probe_of_another_model_says_which_and_why_not() -> None:
    """It answers, but cannot be used."""
    with unit(UnitOptions(version="AHRS400CC-100 v2")) as (path, _):
        found = client.probe(path)
    assert found["answers"]
    assert found["instrument"] == "AHRS400CC-100"
    assert "not an IMU400CD-200" in found["error"]


@pytest.mark.usefixtures("home")
def test_a_probe_of_a_port_that_cannot_be_opened_says_why() -> None:
    absent = client.probe("/dev/ttyNONE9")
    assert not absent["answers"]
    assert "no such port" in absent["error"]
    with unit(UnitOptions()) as (path, _), Port(path, 38400):
        busy = client.probe(path)
    assert not busy["answers"]
    assert "in use" in busy["error"]
