"""Ports, disks, signals and pipes: what goes wrong around an acquisition, with real processes."""

import json
import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers.acquisitions import mounts
from helpers.commands import imutui
from helpers.fake_devices import Device, Habits, Outcome, answers, command, error_of
from helpers.processes import LIMIT_S, started, wait_until
from reliability import files, ports

from imutui.instrument.port import Port, PortError
from imutui.logbook import reader
from imutui.session import client, ipc
from imutui.session.plan import Plan

GOOD = Habits(answers(), streams=None)


@contextmanager
def recording_to(path: Path, port: str, *arguments: str) -> Iterator["subprocess.Popen[str]"]:
    """A foreground `record --json` of which some samples are on the disk; killed at the end if it still runs."""
    line = command("record", "--port", port, "--filter", "none", "--json", "-o", str(path), *arguments)
    with started(line, cwd=path.parent) as run:
        wait_until(lambda: run.poll() is not None or holds_samples(path))
        assert run.poll() is None, run.communicate(timeout=LIMIT_S)
        yield run


def record(folder: Path, port: str, *arguments: str) -> Outcome:
    """What `imutui record --json` makes of a port."""
    done = imutui("record", "--port", port, "--json", *arguments, check=None)
    return Outcome(done.returncode, done.stdout, done.stderr, folder)


def holds_samples(path: Path) -> bool:
    """Whether a log can be read by now."""
    try:
        return bool(reader.read(path).samples.stamp_ns.size)
    except reader.UnreadableLogError:
        return False


# -- ports ------------------------------------------------------------------------------------------------------------

PORTS = {
    "/dev/no-such-port": ("/dev/no-such-port", "no such port", "imutui demo"),
    "no-such-id": ("no-such-id", "no such port"),
    "telegraph://host": ("telegraph://host", "cannot be reached"),
    "a-file": ("a-file", "no serial port"),
    "a-folder": ("a-folder", "no serial port"),
    "/dev/null": ("/dev/null", "no serial port"),
    "socket://127.0.0.1:1": ("socket://127.0.0.1:1", "cannot be reached", "terminal server"),
}


@pytest.mark.parametrize("name", PORTS)
def test_what_is_no_port_is_named_with_the_next_step(home: Path, name: str) -> None:
    (home / "a-file").write_text("kept")
    (home / "a-folder").mkdir()
    with pytest.raises(PortError) as refused:
        Port(name, 38400)
    assert all(word in str(refused.value) for word in PORTS[name])
    assert (home / "a-file").read_text() == "kept"


def test_a_port_that_was_given_back_is_open_to_everybody() -> None:
    """A virtual instrument lives on; root may open what is kept from others, so the mark itself is looked at."""
    with Device(GOOD) as device:
        states = []
        for _ in range(2):
            port = Port(device.port, 38400)
            states.append(ports.is_exclusive(device.port))
            port.close()
            states.append(ports.is_exclusive(device.port))
    assert states == [True, False] * 2


@pytest.fixture
def unprivileged() -> list[str]:
    """What makes of a command line one without root's powers."""
    line = ports.unprivileged()
    if line is None:
        pytest.skip("root cannot do without its powers here: setpriv, of the package util-linux")
    return line


def test_a_logs_folder_without_permission_is_a_matter_of_the_disk(home: Path, unprivileged: list[str]) -> None:
    (home / "logs").mkdir()
    ports.deny(home / "logs")
    with Device(GOOD) as device:
        line = [*unprivileged, *command("record", "--port", device.port, "--duration", "0.2")]
        done = subprocess.run(line, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 5, done.stderr
    assert str(home / "logs") in done.stderr
    assert "Choose another folder" in done.stderr
    (home / "logs").chmod(0o700)
    assert not any((home / "logs").iterdir())


def test_a_logs_folder_that_is_a_file_is_a_matter_of_the_disk(home: Path) -> None:
    (home / "logs").write_text("kept")
    with Device(GOOD) as device:
        outcome = record(home, device.port, "--duration", "0.2")
    error = error_of(outcome)
    assert outcome.code == 5, error
    assert str(home / "logs") in error
    assert "--force" not in error
    assert (home / "logs").read_text() == "kept"


@pytest.fixture
def small_disk(home: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A disk of 200 KiB with 32 left, of which nothing is kept free."""
    monkeypatch.setenv("IMUTUI_PATHS_MIN_FREE_MB", "0")
    with files.small_disk(home) as disk:
        yield disk


# -- disks ------------------------------------------------------------------------------------------------------------


@mounts
def test_a_full_disk_is_told_by_import_and_replay(home: Path, small_disk: Path) -> None:
    rows = "".join(f"{i / 100},{i % 97 / 7},{i % 89 / 7},{i % 83 / 7},0,0,0.998\n" for i in range(4000))
    (home / "a.csv").write_text("t,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n" + rows)
    path = small_disk / "out.mcap"
    error = imutui("import", "a.csv", "-o", path, check=5).stderr.splitlines()[-1]
    assert str(path) in error
    assert "No space left" in error
    imutui("import", "a.csv", "-o", "a.mcap", "--end", "2")
    (small_disk / "filler").write_bytes(bytes(200 * 1024 - 4096))
    done = imutui("replay", "a.mcap", "--json", "-o", small_disk / "estimates.mcap", check=5)
    assert done.stdout == ""
    assert "estimates.mcap" in done.stderr


# -- beside a running acquisition -------------------------------------------------------------------------------------


def test_a_second_acquisition_is_told_of_the_first(home: Path) -> None:
    with Device(GOOD) as device, recording_to(home / "first.mcap", device.port) as first:
        line = ("record", "--port", device.port, "--filter", "none", "--json")
        same = imutui(*line, check=4)
        other = imutui(*line, "--name", "other", check=4)
        assert first.poll() is None
        imutui("mark", "still here")
        imutui("stop", check=None)  # this unit repeats one reading, which shows after 1.5 s
        out, _ = first.communicate(timeout=LIMIT_S)
    assert same.stdout == other.stdout == ""
    assert all(words in same.stderr for words in ('"default" is running', "imutui attach", "imutui stop", "--name"))
    assert all(words in other.stderr for words in (device.port, "in use", "imutui attach"))
    assert first.returncode in (0, 1)
    assert json.loads(out)["finished"]
    assert "still here" in [event.text for event in reader.read(home / "first.mcap").events]


def test_a_mark_needs_a_recording(home: Path) -> None:
    with Device(GOOD) as device:
        connection = client.start(Plan(device.port, filter="none", logs=str(home / "logs")))
        marked = imutui("mark", "x", check=4)
        stopped = imutui("stop", "--json")
        connection.close()
    assert "nothing is being recorded" in marked.stderr
    assert "start recording" in marked.stderr
    assert json.loads(stopped.stdout) is None
    assert not (home / "logs").exists()


# -- signals and pipes ------------------------------------------------------------------------------------------------


def test_sigterm_to_the_foreground_finishes_the_file(home: Path) -> None:
    """`timeout 60 imutui record`, a service manager and a container stop it so; they expect a whole file."""
    with Device(GOOD) as device, recording_to(home / "out.mcap", device.port) as run:
        run.terminate()
        run.communicate(timeout=LIMIT_S)
        try:
            wait_until(lambda: not ipc.names(), timeout=10.0)
        finally:
            imutui("stop", check=None)
    assert reader.read(home / "out.mcap").finished


def test_a_closed_terminal_leaves_the_acquisition_running(home: Path) -> None:
    with Device(GOOD) as device, recording_to(home / "out.mcap", device.port) as run:
        connection = client.attach()
        run.send_signal(signal.SIGHUP)
        os.kill(connection.pid, signal.SIGHUP)
        out, err = run.communicate(timeout=LIMIT_S)
        before = connection.snapshot(since=2**62)["recording"]["seconds"]
        wait_until(lambda: connection.snapshot(since=2**62)["recording"]["seconds"] > before + 0.2)
        stopped = imutui("stop", "--json")
    assert run.returncode == 0, err
    assert out == ""
    assert "Traceback" not in err
    assert json.loads(stopped.stdout)["finished"]
    assert reader.read(home / "out.mcap").finished


@pytest.mark.parametrize("line", ["config", "status --json"])
def test_a_reader_that_has_enough_is_no_error(home: Path, line: str) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    streams = {"stdout": theirs, "stderr": subprocess.PIPE}
    closed = subprocess.run(command(*line.split(" ")), **streams, text=True, timeout=LIMIT_S, check=False)
    os.close(theirs)
    assert closed.stderr == ""
    assert closed.returncode in (0, 1)


def test_a_full_standard_output_is_a_matter_of_the_disk(home: Path) -> None:
    """`imutui config > file` on a full disk must not look like success."""
    with Path("/dev/full").open("wb") as full:
        streams = {"stdout": full, "stderr": subprocess.PIPE}
        done = subprocess.run(command("config"), **streams, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 5
    assert "No space left" in done.stderr
    assert "Traceback" not in done.stderr
