"""The line is lost, or the unit falls silent, while an acquisition runs: it goes on with the same unit, in one file.

Real processes and pseudo-terminals; the unit, and what leads to it, are served by the test's own process.
"""

import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from helpers.commands import imutui
from helpers.processes import wait_until
from helpers.units import Still, served

from imutui.instrument.virtual import UnitOptions, VirtualUnit
from imutui.logbook import reader
from imutui.logbook.results import TIMINGS
from imutui.session import client
from imutui.session.client import Client
from imutui.session.plan import Plan

SERIAL = 9911750


@contextmanager
def plugged_in(link: Path, **options: Any) -> Iterator[str]:
    """A unit that has just been given power, on a pseudo-terminal that the link leads to; unplugged at the end."""
    with served(VirtualUnit(Still(), UnitOptions(**({"serial_number": SERIAL} | options)))) as device:
        link.symlink_to(device)
        try:
            yield device
        finally:
            link.unlink()


def acquired(home: Path, port: str, **fields: Any) -> Client:
    return client.start(Plan(port, **({"logs": str(home / "logs"), "record": True, "filter": "none"} | fields)))


def seen(connection: Client) -> Any:
    return connection.snapshot(2**62)


def lost(connection: Client) -> None:
    wait_until(lambda: seen(connection)["reconnecting"] is not None, timeout=20.0)


def more_packets(connection: Client, count: int = 50) -> None:
    before = seen(connection)["packets"]
    wait_until(lambda: seen(connection)["packets"] > before + count, timeout=30.0)


def events(log: Path) -> list[str]:
    return [event.text for event in reader.read(log).events]


def test_the_same_unit_returns_under_another_name_and_one_file_goes_on(home: Path) -> None:
    """Noticed at once, back soon after it is there; the gap is an event; live and replayed results are equal."""
    link = home / "imu"
    other = home / "other"  # there already, so that it has a name of its own
    with plugged_in(other) as name:
        with plugged_in(link):
            connection = acquired(home, str(link), filter="spkf")
            more_packets(connection, 100)
            unplugged = time.monotonic()
        lost(connection)
        noticed = time.monotonic() - unplugged
        link.symlink_to(name)
        plugged = time.monotonic()
        wait_until(lambda: seen(connection)["reconnecting"] is None)
        back = time.monotonic() - plugged
        more_packets(connection, 100)
        now = seen(connection)
        assert (now["state"], now["lost_packets"]) == ("running", 0)
        live: dict[str, Any] = connection.stop() or {}
    assert noticed < 10.0, "1 s is asked; a busy machine is given more"
    assert back < 10.0, "2 s are asked"
    log = Path(live["log"])
    (gap,) = [text for text in events(log) if text.startswith("gap of")]
    assert f"serial number {SERIAL}" in gap
    replayed = json.loads(imutui("replay", str(log), "--json", check=1).stdout)
    assert {k: v for k, v in live.items() if k not in TIMINGS} == {
        k: v for k, v in replayed.items() if k not in TIMINGS
    }
    assert len(live["gaps"]) == 1
    assert live["finished"]


def test_another_unit_on_the_old_port_is_refused_and_the_right_one_waited_for(home: Path) -> None:
    """Not one of its packets is in the file; the words name both serial numbers."""
    link = home / "imu"
    with plugged_in(link):
        connection = acquired(home, str(link))
        more_packets(connection)
    lost(connection)
    count = seen(connection)["packets"]
    with plugged_in(link, serial_number=17):
        wait_until(lambda: "17" in seen(connection)["reconnecting"]["waits_for"])
        status = imutui("status").stdout
        assert "RECONNECTING" in status
        assert "serial number 17" in status
    assert seen(connection)["packets"] == count
    with plugged_in(link):
        more_packets(connection)
        log = Path((connection.stop() or {})["log"])
    (refused,) = [text for text in events(log) if text.startswith("refused")]
    assert "serial number 17" in refused
    assert str(SERIAL) in refused


def test_terminated_without_the_unit_it_finishes_the_file_at_once_and_says_so(home: Path) -> None:
    """Within 2 s as ever; the file is whole up to the loss; exit code 4."""
    link = home / "imu"
    with plugged_in(link):
        connection = acquired(home, str(link))
        more_packets(connection)
        path = Path(seen(connection)["recording"]["path"])
    lost(connection)
    began = time.monotonic()
    os.kill(connection.pid, signal.SIGTERM)
    live = connection.wait(30.0) or {}
    took = time.monotonic() - began
    assert took < 10.0, "2 s are asked; a busy machine is given more"
    (finding,) = connection.findings
    assert finding["exit_code"] == 4
    assert "gone at the end" in finding["text"]
    assert live["finished"]
    log = reader.read(path)
    assert log.finished
    assert finding["text"] in [event.text for event in log.events]
