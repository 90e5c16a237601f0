"""An end that is asked for while the unit is being set up: nothing is recorded, and the unit is left as it was."""

import signal
from pathlib import Path

import pytest
from helpers.processes import LIMIT_S, command_line, started, wait_until
from helpers.units import Still, served

from imutui.instrument.uut.unit import VirtualUnit
from imutui.instrument.uut.unit_options import UnitOptions


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_a_unit_that_streamed_streams_again(number: signal.Signals, code: int, home: Path) -> None:
    options = UnitOptions(reply_delay_s=0.5)
    unit = VirtualUnit(Still(), options)
    heard: list[str] = []
    line = command_line("record", "--port", str(home / "unit"), "--instrument", "imu381", "--filter", "none")
    with served(unit, link=home / "unit", log=heard.append), started(line) as process:
        wait_until(lambda: "SF: set in RAM 0001=0000" in heard)
        process.send_signal(number)
        _, said = process.communicate(timeout=LIMIT_S)
        assert process.returncode == code
        assert unit.rate_hz == 100
    assert "nothing was recorded" in said
    assert not list(home.rglob("*.mcap"))
