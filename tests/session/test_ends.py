"""How acquisitions end: by their duration, by signals, when a start fails, unattended; and when a unit is silent."""

import json
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import Popen
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from helpers.acquisitions import acquiring
from helpers.commands import imutui
from helpers.fake_devices import Device, Habits, answers
from helpers.faulty_lines import FaultyLine, LineFault
from helpers.processes import LIMIT_S, command_line, started, wait_until
from helpers.units import Still, served, virtual

from imutui.cli import follow_acquisition
from imutui.instrument.imu400 import unit as imu400_unit
from imutui.instrument.uut import unit as uut_unit
from imutui.logbook import reader, summary
from imutui.session import client, ipc, processes
from imutui.session.plan import VIRTUAL_PORT, Plan

SILENT_FROM_S = 0.4
FOR_EVER_S = 1e6


@contextmanager
def falling_silent(seconds: float = FOR_EVER_S) -> Iterator[str]:
    """Port of a unit that is not heard for so long, from 0.4 s after it was first asked for data."""
    line = FaultyLine([LineFault(SILENT_FROM_S, "silence", seconds=seconds)])
    with served(imu400_unit.VirtualUnit(Still()), line=line) as path:
        yield path


@pytest.mark.parametrize("sampling", ["stream", "polled"])
def test_the_duration_is_over_by_the_clock_though_the_unit_is_silent(home: Path, sampling: str) -> None:
    with (
        falling_silent() as path,
        acquiring(home, path, packets=0, rate_hz=20.0, sampling=sampling, duration_s=2.0) as run,
    ):
        result, engine = run.wait_until_ended(), run.engine
    assert engine.lifecycle.error is None
    assert engine.lifecycle.state == "stopped"
    assert engine.exit_code == 4
    # on a busy machine a polled rate may not have been kept before, which is told too
    [finding] = [each for each in engine.lifecycle.findings if "silent at the end" in each["text"]]
    assert finding["exit_code"] == 4
    log = reader.read(Path(result["log"]))
    assert log.finished
    assert any("silent at the end" in event.text for event in log.events)
    assert log.events[-1].text == "ended by its duration of 2 s"


def test_a_gap_counts_as_time_and_a_unit_that_is_back_by_the_end_is_fine(home: Path) -> None:
    with falling_silent(1.2) as path, acquiring(home, path, packets=0, duration_s=2.5) as run:
        result = run.wait_until_ended()
    assert (run.engine.exit_code, run.findings()) == (0, [])
    seconds = reader.read(Path(result["log"])).seconds()
    assert seconds[-1] == pytest.approx(2.5, abs=0.5)


def test_silence_alone_ends_nothing_and_whoever_asks_for_the_end_gets_it(home: Path) -> None:
    with falling_silent() as path, acquiring(home, path, packets=0, rate_hz=20.0) as run:
        # longer than what counts as a silence, and looked at once a second
        wait_until(lambda: "no packets for" in str(run.seen()["events"]))
        assert run.seen()["state"] == "running"
        run.end()
    assert run.engine.exit_code == 0
    assert "silent at the end" in run.engine.lifecycle.findings[0]["text"]


def test_the_command_says_that_the_unit_was_silent_at_the_end(home: Path) -> None:
    record = ("record", "--rate", "20", "--filter", "none", "--duration", "2", "--json", "-o", "a.mcap")
    with falling_silent() as path:
        done = imutui(*record, "--port", path, check=4)
    assert json.loads(done.stdout)["finished"]
    assert "silent at the end" in done.stderr
    assert reader.read(home / "a.mcap").finished


def test_status_and_stop_say_that_the_unit_is_silent(home: Path) -> None:
    with falling_silent() as path:
        connection = client.start(Plan(path, rate_hz=20.0, logs=str(home / "logs"), record=True, filter="none"))
        wait_until(lambda: (connection.snapshot(2**62)["silent_s"] or 0.0) > 1.1)
        assert "NO DATA" in imutui("status").stdout
        assert "silent at the end" in imutui("stop", check=1).stderr
        [log] = (home / "logs").glob("*.mcap")
        assert reader.read(log).finished


# A start that times out leaves a recording that holds something, or nothing at all

# as an acquisition that is held up for ever with its file just made, or with something in it
HELD_UP = """
import signal, sys, time
from pathlib import Path
from imutui.logbook import schemas
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import LogWriter
signal.signal(signal.SIGTERM, signal.SIG_IGN)
writer = LogWriter(Path(sys.argv[1]), SessionInfo(), "", time.time_ns())
if sys.argv[2] == "one":
    now = time.time_ns()
    writer.encoded(schemas.EVENTS, schemas.encode_event(now, "mark", "here"), now, now)
    writer.flush()
print("ready", flush=True)
signal.pause()
"""


@pytest.mark.parametrize("messages", ["none", "one"])
def test_a_file_without_a_message_is_not_left_and_one_with_a_message_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, messages: str
) -> None:
    monkeypatch.setattr(processes, "_GRACE_S", 0.1)
    log = tmp_path / "made" / "for it" / "a.mcap"
    missing = processes.missing_folders(Plan(VIRTUAL_PORT, output=str(log)))
    assert missing == [log.parent, log.parent.parent]
    with started([sys.executable, "-c", HELD_UP, str(log), messages]) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        assert log.exists()
        processes.end_unbegun(processes.Process(process.pid), missing)
    if messages == "none":
        assert list(tmp_path.iterdir()) == []
    else:
        assert summary.read(log).state == summary.UNFINISHED


def test_a_start_that_times_out_is_ended_in_order(home: Path) -> None:
    with pytest.raises(client.SessionError, match="did not begin within 0 s"):
        client.start(Plan(VIRTUAL_PORT, logs=str(home / "logs"), record=True), timeout=0.0)
    assert not (home / "logs").exists()
    assert client.running() == []


# An end that is asked for while the unit is being set up: nothing is recorded, and the unit is left as it was


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_a_unit_that_streamed_streams_again(number: signal.Signals, code: int, home: Path) -> None:
    unit = uut_unit.VirtualUnit(Still())
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


# `imutui record` as a service runs it: a command that follows, and an acquisition beside it in one control group

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
    result: Any = {"log": "a.mcap", "converged": False, "health": [], "alarms": [], "parts": []}
    finding = {"text": "the unit was silent at the end", "exit_code": 4}
    end: Any = {"name": "a", "findings": [finding], "by_itself": by_itself, "result": result}
    asked = Plan("p", unattended=unattended)
    assert follow_acquisition.exit_code(asked, end, terminated) == code


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

    plan = Plan("virtual", rate_hz=133.0, record=True, filter="none", logs=str(home / "logs"))
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
