"""Four virtual units, each with an acquisition of its own, on the rack page: what a newcomer does in a morning."""

import os
import re
import signal
from contextlib import ExitStack
from pathlib import Path

from helpers.commands import imutui
from helpers.fake_client import FakeClient
from helpers.pilot import SMALLEST, See
from helpers.units import served

from imutui import batch_file, scenario
from imutui.cli.virtual_readings import SIMULATED, SimulatedReadings
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.logbook import reader
from imutui.session import batch, client
from imutui.session.plan import VIRTUAL_PORT, Plan
from imutui.tui.app import ImutuiApp
from imutui.tui.connection.rack import Rack

SCENARIO = "[temperature]\nconstant_degc = 25.0\n[biases]\ngyro_dps = [0.1, 0.2, -0.1]\naccel_mg = [1.0, -1.0, {az}]\n"


def unit(home: Path, number: int, az_mg: float) -> VirtualUnit:
    """A unit that stands level; `az_mg` is its z accelerometer's bias, within 12 mg of a good one."""
    path = home / f"{number}.toml"
    path.write_text(SCENARIO.format(az=az_mg))
    readings = SimulatedReadings(scenario.load_scenario(path))
    return VirtualUnit(readings, UnitOptions(version=SIMULATED, serial_number=9900000 + number))


def lot(home: Path) -> Path:
    """The table of four units, by their ports."""
    path = home / "lot.toml"
    path.write_text("rate = 20.0\n" + "".join(f'[[unit]]\nport = "{home}/u{n}"\n' for n in range(1, 5)))
    return path


def row(screen: str, serial: str) -> str:
    return next(line for line in screen.splitlines() if serial in line[3:13])


async def test_a_batch_of_four_is_started_watched_and_mended_from_the_page_alone(home: Path) -> None:
    """One unit has a bad axis, and the process of another dies: both are told apart, and the others go on."""
    logs, asked = home / "logs", batch_file.read(lot(home))
    batch.begin(asked, batch.base_of(asked, Plan(VIRTUAL_PORT, logs=str(logs), record=True)))
    rack = Rack("lot")
    app = ImutuiApp(rack=rack, defaults=Plan(VIRTUAL_PORT, logs=str(logs)))
    with ExitStack() as stack:
        for n in range(1, 5):
            stack.enter_context(served(unit(home, n, 40.0 if n == 3 else 2.0), link=home / f"u{n}"))
        async with app.run_test(size=SMALLEST) as pilot:
            see = See(pilot, FakeClient())
            await see("→ batch lot  4 units  4 × RED | × ENDED | not started yet | S starts it again")
            await see("x x x x S → started: 4 units | ● REC 4 of 4 | 9900001 | 9900002 | 9900003 | 9900004")
            screen = await see("escape → × RED | z accel | !WAIT")
            assert re.search("×  25.0  × RED   .*z accel", row(screen, "9900003"))
            assert not any("×" in row(screen, serial) for serial in ("9900001", "9900002", "9900004"))
            await see("w home → worst first | 9900003: IMU400CD | z accel")
            await see("4 → z accel | 0 Rack | × RED")
            await see("0 w m 'door closed' enter → marked: door closed: 4 units")
            os.kill(client.attach("lot:2").pid, signal.SIGKILL)
            screen = await see("→ × ENDED | ● REC 3 of 4")
            assert "× ENDED" in row(screen, "9900002")
            await see("home j S → started: 1 unit | ● REC 4 of 4 | !ENDED")
            assert "Running: lot." in imutui("attach", "--batch", "other", check=4).stderr
            assert "needs a terminal" in imutui("attach", "--batch", "lot", check=2).stderr
            await see("q s →")
            await see.until(lambda: app.return_code is not None)
        app.finish()
    assert app.farewell == ["stopped: 4 units"]
    found = [reader.read(path) for path in sorted(logs.glob("*.mcap"))]
    assert sorted(log.info.serial_number for log in found) == [f"990000{n}" for n in (1, 2, 2, 3, 4)]
    assert [log.info.batch for log in found] == ["lot"] * 5
    assert sorted(log.finished for log in found) == [False, True, True, True, True]
    marked = [log for log in found if "door closed" in [event.text for event in log.events]]
    # a kill may cost the last second, and with it the mark of the unit that was killed
    assert sum(log.finished for log in marked) == 3
