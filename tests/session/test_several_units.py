"""Several units on several ports, recorded at once: one list of them, and words for whoever does not say which."""

import os
import signal
import subprocess
import termios
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.commands import imutui, imutui_json
from helpers.places import own_places
from helpers.processes import command_line, end_owner, wait_until
from helpers.units import healthy, served, virtual

from imutui.instrument.uut.unit import VirtualUnit
from imutui.instrument.uut.unit_options import UnitOptions
from imutui.logbook import reader
from imutui.session import client
from imutui.session.client import Client, SessionError
from imutui.session.plan import Plan


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Client]]:
    """Acquisitions "a" and "b", each recording a unit of its own: an IMU400CD, and an IMU381, found by asking."""
    folder = tmp_path_factory.mktemp("two")
    options = UnitOptions(text="IMU381ZA-200 VIRTUAL SIM")
    imu381 = VirtualUnit(healthy(), options)
    with pytest.MonkeyPatch.context() as patch, virtual() as first, served(imu381) as second:
        runtime = own_places(patch, folder)
        ports = {"a": first, "b": second}
        asked = {
            name: Plan(port, instrument="", name=name, note=name, record=True, filter="none", logs=str(folder))
            for name, port in ports.items()
        }
        yield {name: client.start(plan) for name, plan in asked.items()}
        for lock in (runtime / "imutui").glob("*.lock"):
            end_owner(lock)


def test_one_status_lists_all(two: dict[str, Client]) -> None:
    wait_until(lambda: all(c.snapshot(2**62)["measured_hz"] for c in two.values()))
    lines = imutui("status").stdout.splitlines()
    for name in two:
        (line,) = [line for line in lines if line.startswith(f"{name} (pid {two[name].pid})")]
        asked = {"a": "asked 133 Hz measured 13", "b": "asked 100 Hz measured "}[name]
        file = {"a": "imu400cd_9911750_", "b": "imu381_9911750_"}[name]
        assert all(word in line for word in ("running", asked, "lost ", file, f"_{name}.mcap"))
    document = imutui_json("status")
    assert [(state["name"], state["state"]) for state in document] == [("a", "running"), ("b", "running")]
    assert all(state["free_bytes"] and state["recording"]["path"] for state in document)
    assert [state["name"] for state in imutui_json("status", "--name", "b")] == ["b"]
    assert "Running: a, b." in imutui("status", "--name", "c", check=4).stderr


def test_lines_of_status_fit_a_terminal(two: dict[str, Client]) -> None:
    """A path that is longer than a line is broken behind a slash, so that it can be put together again."""
    del two
    master, slave = os.openpty()
    termios.tcsetwinsize(slave, (24, 80))
    done = subprocess.run(command_line("status"), stdout=slave, env={**os.environ, "COLUMNS": "80"}, check=True)
    os.close(slave)
    said = os.read(master, 1 << 16).decode()
    os.close(master)
    assert done.returncode == 0
    assert max(map(len, said.splitlines())) <= 80
    assert "b (pid" in said
    assert said.count(".mcap") == 2


@pytest.mark.parametrize("line", [["stop"], ["mark", "door"], ["attach"]])
def test_whoever_does_not_say_which_is_told_which_there_are(two: dict[str, Client], line: list[str]) -> None:
    if line == ["attach"]:
        with pytest.raises(SessionError, match=r"a, b\. Say which with --name"):
            client.attach()
        return
    assert "a, b. Say which with --name" in imutui(*line, check=2).stderr
    assert client.running() == ["a", "b"]


def test_a_port_that_one_of_them_has_is_refused_by_that_ones_name(two: dict[str, Client]) -> None:
    port = two["b"].snapshot(2**62)["port"]
    error = imutui("record", "--port", port, "--name", "c", check=4).stderr
    assert f'{port} is in use by the acquisition "b"' in error
    assert "imutui attach --name b" in error
    assert client.running() == ["a", "b"]


def test_one_that_hangs_costs_no_other_its_line(two: dict[str, Client], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Client._ask, "__defaults__", (0.5,))
    os.kill(two["a"].pid, signal.SIGSTOP)
    try:
        text = imutui("status", check=4).stdout
        told: list[dict[str, Any]] = imutui_json("status", check=4)
    finally:
        os.kill(two["a"].pid, signal.SIGCONT)
    assert "a: its process lives, but does not answer" in text
    assert "b (pid " in text
    assert [state["state"] for state in told] == ["does not answer", "running"]


def test_each_is_stopped_by_its_name(two: dict[str, Client]) -> None:
    imutui("mark", "at b", "--name", "b")
    logs = {}
    for name, left in (("a", ["b"]), ("b", [])):
        logs[name] = Path(imutui_json("stop", "--name", name)["log"])
        assert client.running() == left
    read = {name: reader.read(log) for name, log in logs.items()}
    assert all(log.finished and log.info.acquisition == name for name, log in read.items())
    assert ["at b" in [event.text for event in log.events] for log in read.values()] == [False, True]
    assert [log.info.instrument for log in read.values()] == ["IMU400CD-200", "IMU381ZA-200"]
    assert [log.info.accel_sign for log in read.values()] == [-1, 1]
    # each on its own terms: one stands level, the other, whose readings are +1 g on Z too, upside down
    assert [round(log.samples.accel[:, 2].mean() / 9.8) for log in read.values()] == [-1, 1]
