"""`imutui record` as a service runs it: a command that follows, and an acquisition beside it in one control group."""

import json
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import Popen
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from helpers.fake_devices import Device, Habits, answers
from helpers.processes import LIMIT_S, command_line, started, wait_until
from helpers.units import virtual

from imutui.cli import follow_acquisition
from imutui.logbook import reader
from imutui.session import client, ipc
from imutui.session.plan import Plan

NAME = "table"


@contextmanager
def service(port: str) -> Iterator["Popen[str]"]:
    """What the unit starts, once it records."""
    line = command_line("record", "--unattended", "--name", NAME, "--port", port, "--filter", "none", "--json")
    with started(line) as command:
        wait_until(lambda: samples() > 2)
        assert command.stderr is not None
        assert NAME in command.stderr.readline()  # it follows by now
        yield command


def samples() -> int:
    """How many the acquisition has recorded by now."""
    if NAME not in client.running():
        return 0
    try:
        return (client.attach(NAME).snapshot(2**62)["recording"] or {}).get("samples", 0)
    except client.SessionError:  # it is connecting
        return 0


def test_it_comes_back_after_a_crash_and_ends_with_a_finished_file(home: Path) -> None:
    with virtual() as port:
        with service(port) as command:
            os.kill(client.attach(NAME).pid, signal.SIGKILL)
            _, said = command.communicate(timeout=LIMIT_S)
            assert command.returncode == 1
            assert f'the acquisition "{NAME}" has ended' in said
        with service(port) as command:
            acquisition = client.attach(NAME).pid
            for process in (acquisition, command.pid):
                os.kill(process, signal.SIGTERM)
            out, said = command.communicate(timeout=LIMIT_S)
        assert command.returncode == 0, said
    result = json.loads(out)
    log = reader.read(Path(result["log"]))
    assert log.finished
    assert log.info.previous_end == "unfinished"
    assert len(list((home / "logs").glob("*.mcap"))) == 2
    assert ipc.names() == []


def test_sigterm_while_it_connects_ends_both(home: Path) -> None:
    with Device(Habits(answers(), streams=None)) as device:
        device.hold(b"S")
        with started(command_line("record", "--unattended", "--name", NAME, "--port", device.port)) as command:
            device.wait_until_held()
            command.terminate()
            command.wait(LIMIT_S)
            device.release()
        assert command.returncode == 0
        wait_until(lambda: ipc.names() == [])


@pytest.mark.parametrize(
    ("unattended", "terminated", "by_itself", "code"),
    [
        (False, False, False, 4),
        (False, True, False, 1),
        (True, False, False, 0),
        (True, True, False, 0),
        (True, False, True, 4),
    ],
)
def test_a_service_is_not_started_again_for_what_a_filter_found(
    unattended: bool, terminated: bool, by_itself: bool, code: int
) -> None:
    """Whoever stops it gets 0; one that ended by itself tells why it did; by hand the verdict counts."""
    result: Any = {"log": "a.mcap", "converged": False}
    finding = {"text": "the unit was silent at the end", "exit_code": 4}
    connection: Any = SimpleNamespace(findings=[finding], ended_by_itself=by_itself)
    asked = Plan("p", unattended=unattended)
    assert follow_acquisition._exit_code(asked, result, connection, terminated) == code


def test_a_second_sigterm_gives_up_on_an_acquisition_that_hangs() -> None:
    """The first asks it to finish and waits; whoever sends another does not want to wait."""
    asked = threading.Event()
    connection: Any = SimpleNamespace(stop=lambda by: asked.set())
    terminated = threading.Event()
    with follow_acquisition._leave_on_hangup(connection, terminated):
        os.kill(os.getpid(), signal.SIGTERM)
        assert asked.wait(LIMIT_S)
        with pytest.raises(follow_acquisition.TerminatedError):
            os.kill(os.getpid(), signal.SIGTERM)
    assert terminated.is_set()


def test_ctrl_c_just_after_the_start_leaves_no_acquisition_behind(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupts(*_: object) -> None:
        raise KeyboardInterrupt

    plan = Plan("virtual", 133.0, record=True, filter="none", logs=str(home / "logs"))
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(client, "Client", interrupts)
        client.start(plan)
    wait_until(lambda: ipc.names() == [])
    with monkeypatch.context() as patch, pytest.raises(typer.Exit) as ended:
        patch.setattr(follow_acquisition, "say", interrupts)
        follow_acquisition.follow(plan, json=True)
    assert ended.value.exit_code == 130
    wait_until(lambda: ipc.names() == [])
    assert all(reader.read(path).finished for path in (home / "logs").glob("*.mcap"))
