"""The demo: a unit with an effect to be found; and how long it, and any virtual unit of its own, goes on."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from helpers.processes import LIMIT_S, children, command_line, has_ended, started, wait_until
from helpers.runs import run_of
from helpers.units import virtual

from filters.tracing import trace
from imutui.logbook import reader
from imutui.scenario import load_scenario
from imutui.session import client, ipc
from imutui.session.plan import VIRTUAL_PORT, Plan, demo


def test_the_demo_leaves_the_configuration_of_real_units_out() -> None:
    plan = demo(Plan("/dev/x", rate_hz=133.0, logs="/data", operator="ana", mount="x,-y,-z", accel_sign=1), seed=3)
    assert (plan.port, plan.rate_hz, plan.record, plan.logs, plan.operator) == (
        VIRTUAL_PORT,
        20.0,
        True,
        "/data",
        "ana",
    )
    assert (plan.mount, plan.accel_sign) == ("x,y,z", None)  # as the unit has them
    assert plan.virtual[:2] == ("--seed", "3")


def test_two_minutes_of_the_demo_are_traced_to_its_effect() -> None:
    """What a newcomer records first has a finding: the y gyro's 0.13 Hz, with its amplitude, and nothing else.

    And the error is less with it.
    """
    scenario = load_scenario(Path(demo(Plan(VIRTUAL_PORT)).virtual[3]))
    document = trace.trace([run_of(replace(scenario, seed=0), seconds=120.0)], None).document
    found = document["findings"]
    error = next(e for e in document["error"] if (e["metric"], e["channel"]) == ("e10", "gy"))
    assert error["after"] is not None
    assert error["before"] is not None
    assert error["after"] < 0.75 * error["before"]
    assert [(finding["effect"], finding["channels"]) for finding in found] == [("tone", ["gy"])]
    values = {param["name"]: param["value"] for param in found[0]["params"]}
    assert abs(values["frequency"] - 0.13) < 0.002


def acquired(home: Path, port: str, unwatched_s: float) -> client.Client:
    plan = Plan(port, rate_hz=20.0, logs=str(home / "logs"), record=True, filter="none", unwatched_s=unwatched_s)
    return client.start(plan)


def test_a_virtual_unit_ends_when_nobody_looks_on_with_its_file_finished(home: Path) -> None:
    connection = acquired(home, VIRTUAL_PORT, unwatched_s=3.0)
    assert connection.snapshot()["ends_unwatched_s"] == 3.0
    path = Path((connection.snapshot()["recording"] or {})["path"])
    (unit,) = children(connection.pid)
    connection.close()
    again = client.attach(connection.name)
    begun = again.snapshot()["since_start_s"]
    wait_until(lambda: again.snapshot()["since_start_s"] > begun + 6.0)  # who looks on keeps it
    again.close()
    wait_until(lambda: has_ended(connection.pid) and has_ended(unit))
    log = reader.read(path)
    assert log.finished
    assert any("nobody had looked on for 3 s" in event.text for event in log.events)


def test_a_virtual_unit_ends_though_nobody_ever_looked(home: Path) -> None:
    """Whoever started it was killed before it had connected."""
    wanted: dict[str, Any] = {"logs": str(home / "logs"), "record": True, "filter": "none", "unwatched_s": 0.5}
    plan = Plan(VIRTUAL_PORT, rate_hz=20.0, name="demo", **wanted)
    line = [sys.executable, "-P", "-m", "imutui.session"]
    with started(line, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL) as process:
        assert process.stdin is not None
        process.stdin.write(plan.dumps() + "\n")
        process.stdin.close()
        assert process.wait(LIMIT_S) == 0
    (log,) = (home / "logs").glob("*.mcap")
    assert reader.read(log).finished


def test_a_unit_that_is_not_virtual_is_recorded_on_without_a_viewer(home: Path) -> None:
    """The port is what counts: this one may be anything."""
    with virtual() as port:
        connection = acquired(home, port, unwatched_s=0.1)
        path = Path((connection.snapshot()["recording"] or {})["path"])
        connection.close()
        size = path.stat().st_size
        wait_until(lambda: path.stat().st_size > size + 10_000)  # some seconds of 20 Hz
        again = client.attach(connection.name)
        assert again.snapshot()["ends_unwatched_s"] is None
        assert (again.stop()["result"] or {})["finished"]


def test_a_virtual_unit_does_not_outlive_an_acquisition_that_was_killed(home: Path) -> None:
    """SIGKILL leaves no time to tell it: its standard input ends."""
    connection = acquired(home, VIRTUAL_PORT, unwatched_s=60.0)
    (unit,) = children(connection.pid)
    os.kill(connection.pid, signal.SIGKILL)
    wait_until(lambda: has_ended(unit))


def test_a_headless_demo_has_its_follower_for_a_viewer(home: Path) -> None:
    """However long it was to last, it ends a minute after the terminal that follows it."""
    with started(command_line("demo", "--headless", "--seconds", "3600"), cwd=home) as follower:
        name = f"demo-{follower.pid}"
        wait_until(lambda: name in client.running() and ipc.socket_path(name).exists())
        connection = client.attach(name)
        assert connection.snapshot()["ends_unwatched_s"] == 60.0
        connection.stop()
        assert follower.wait(LIMIT_S) in (0, 1)
