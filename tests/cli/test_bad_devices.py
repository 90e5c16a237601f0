"""`imutui record` on devices that are none, are others, or fail: one paragraph, exit 4, nothing lost."""

import os
import pickle
import random
import signal
import socket
import subprocess
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers import ros_messages
from helpers.fake_devices import Device, Habits, Outcome, answers, command, error_of, record
from helpers.places import variables_of
from helpers.processes import LIMIT_S, started, wait_until
from helpers.shared import once

from imutui.cli import status
from imutui.instrument.driver import InstrumentError
from imutui.instrument.imu400.driver import Imu400cd
from imutui.instrument.port import Port, PortError
from imutui.instrument.registry import INSTRUMENTS
from imutui.logbook import reader
from imutui.session import client, ipc
from imutui.session.client import SessionError
from imutui.session.plan import Plan

NMEA = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n"
STREAMED = 60
OLD = b"an old recording"
_noise = random.Random(7)

# habits, and what the error must say: what is found out before there is a first packet to wait for ...
STRANGERS: dict[str, tuple[Habits, tuple[str, ...]]] = {
    "random bytes": (Habits(chatter=lambda: _noise.randbytes(20)), ("not as a Crossbow IMU", "another device")),
    "a GPS receiver": (Habits(chatter=lambda: NMEA), ("not as a Crossbow IMU", "24 47 50", "another device")),
    "an echo": (Habits(echo=True), ("not as a Crossbow IMU", "another cable")),
    "ping and no more": (Habits(answers(c=b"", S=b"", v=b"")), ("answers a ping", "Power it off and on")),
    "AHRS400CC-100": (Habits(answers("AHRS400CC-100 VER 2.1")), ("AHRS400CC-100", "not an IMU400CD-200", "Connect")),
}
# ... and what a command makes of that, and of units that fail later
DEVICES: dict[str, tuple[Habits, tuple[str, ...]]] = {
    "silence": (Habits(), ("silent", "38400", "power")),
    "modes and no packets": (Habits(answers()), ("sends no packets", "Power it off and on")),
    "hangs up when asked": (Habits(answers(), hangs_up_at=b"v"), ("went away", "Check the cable")),
    "hangs up before it streams": (Habits(answers(), hangs_up_at=b"C"), ("went away", "Check the cable")),
}
# ... and one that fails when there is something to keep
HANGS_UP = Habits(answers(), streams=STREAMED)
OTHER_MODELS = (
    "AHRS400CC-100",
    "AHRS400CD-200",
    "VG700CA-200",
    "VG700MB-206",
    "IMU440CA-200",
    "IMU300CC-100",
    "IMU400CC-200",
    "IMU400CD-100",
    "DMU-6X-003",
    "NAV440",
)


@contextmanager
def terminal_server(hangs_up: bool) -> Iterator[str]:
    """A terminal server with nothing behind it; yields its URL."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        peers = []

        def serve() -> None:
            try:
                while True:
                    peer, _ = server.accept()
                    peer.close() if hangs_up else peers.append(peer)
            except OSError:
                return

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"socket://127.0.0.1:{server.getsockname()[1]}"
        server.shutdown(socket.SHUT_RDWR)
        thread.join()
        for peer in peers:
            peer.close()


SERVERS = {
    "a terminal server that hangs up": (True, ("went away", "Check the cable")),
    "a terminal server with nothing behind it": (False, ("silent", "power")),
}


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Outcome]:
    """What `record` makes of devices; all at once, since most of it is waiting."""

    def attempt(habits: Habits, folder: Path) -> Outcome:
        folder.mkdir()
        (folder / "out.mcap").write_bytes(OLD)
        with Device(habits) as device:
            return record(folder, device.port, "--duration", "1", "--filter", "none", "-o", "out.mcap", "--force")

    def make(folder: Path) -> None:
        habits = {name: habits for name, (habits, _) in DEVICES.items()} | {"hangs up while recording": HANGS_UP}
        with ThreadPoolExecutor(len(habits)) as pool:
            found = dict(zip(habits, pool.map(attempt, habits.values(), map(folder.joinpath, habits)), strict=True))
        (folder / "outcomes").write_bytes(pickle.dumps(found))

    return dict(pickle.loads((once(tmp_path_factory, "bad_devices", make) / "outcomes").read_bytes()))


@pytest.mark.parametrize("name", DEVICES)
def test_a_command_names_the_next_step_and_ends(outcomes: dict[str, Outcome], name: str) -> None:
    outcome = outcomes[name]
    assert outcome.code == 4, outcome
    error = error_of(outcome)
    assert "/dev/" in error
    for words in DEVICES[name][1]:
        assert words in error
    wait_until(lambda: not ipc.is_locked(outcome.folder / "run" / "imutui" / "default.lock"))


@pytest.mark.parametrize("name", DEVICES)
def test_a_failed_attempt_leaves_the_file_it_was_to_replace(outcomes: dict[str, Outcome], name: str) -> None:
    """--force replaces a recording by a recording, never by nothing."""
    assert (outcomes[name].folder / "out.mcap").read_bytes() == OLD


def refused(url: str) -> str:
    """What an acquisition says of what is no working unit before it has a first packet to wait for."""
    with pytest.raises((PortError, InstrumentError)) as error, Port(url, 38400) as port:
        Imu400cd(port).open(38400)
    return str(error.value)


def test_what_is_no_working_imu400cd_is_named_with_the_next_step() -> None:
    """The port, what is wrong, what to do. All at once, since most of it is waiting."""

    def of_device(habits: Habits) -> str:
        with Device(habits) as device:
            return refused(device.port)

    def of_server(hangs_up: bool) -> str:
        with terminal_server(hangs_up) as url:
            return refused(url)

    with ThreadPoolExecutor(len(STRANGERS | SERVERS)) as pool:
        said = {name: pool.submit(of_device, habits) for name, (habits, _) in STRANGERS.items()}
        said |= {name: pool.submit(of_server, hangs_up) for name, (hangs_up, _) in SERVERS.items()}
    for name, (_, words) in (STRANGERS | SERVERS).items():
        text = said[name].result()
        assert "/dev/" in text or "socket://" in text
        assert all(word in text for word in words), (name, text)


def test_a_line_that_echoes_is_no_unit_of_either_kind() -> None:
    """A ping comes back as an IMU381 answers it; one question more tells them apart."""
    with Device(Habits(echo=True)) as device:
        found = client.probe(device.port)
        assert not found["answers"]
        assert "not as a Crossbow IMU" in str(found["error"])
        with Port(device.port, 115200) as port, pytest.raises(InstrumentError, match="no question is answered"):
            INSTRUMENTS["imu381"](port).find()


@pytest.mark.parametrize("model", OTHER_MODELS)
def test_another_model_of_the_family_is_refused_by_name(model: str) -> None:
    """Same commands, other ranges or packets: its readings would be wrong by a factor."""
    with Device(Habits(answers(f"{model} VER 2.1"))) as device:
        said = refused(device.port)
    assert model in said
    assert "not an IMU400CD-200" in said


@pytest.mark.usefixtures("home")
def test_who_names_the_unit_is_told_that_no_other_was_looked_for() -> None:
    with (
        Device(Habits(answers("NAV440 VER 2.1"))) as device,
        pytest.raises(SessionError, match="Only an imu400cd was looked for; without --instrument the unit is asked"),
    ):
        client.start(Plan(device.port, instrument="imu400cd"))


def test_what_came_before_the_hang_up_is_a_finished_file(outcomes: dict[str, Outcome]) -> None:
    outcome = outcomes["hangs up while recording"]
    assert outcome.code == 4, outcome
    assert "gone at the end" in outcome.stderr
    log = reader.read(outcome.folder / "out.mcap", raw=True)
    assert log.finished
    assert not log.damage
    assert len(ros_messages.packets(log)) >= STREAMED - 1  # a packet needs a successor, or quiet, to vouch for it
    assert any("went away" in event.text for event in log.events)


def test_ctrl_c_while_connecting_leaves_no_acquisition_behind(tmp_path: Path) -> None:
    """Who gives up before the first packet must not find a recording going on unseen."""
    own = os.environ | variables_of(tmp_path)
    with Device(Habits(answers(), streams=None)) as device:
        device.hold(b"S")
        line = command("record", "--port", device.port, "-o", str(tmp_path / "out.mcap"))
        with started(line, env=own, cwd=tmp_path) as run:
            device.wait_until_held()
            run.send_signal(signal.SIGINT)
            _, stderr = run.communicate(timeout=LIMIT_S)
        device.release()
        assert run.returncode == 130
        assert "Traceback" not in stderr
        lock = tmp_path / "run" / "imutui" / "default.lock"
        try:
            wait_until(lambda: not ipc.is_locked(lock), timeout=10.0)
        finally:
            subprocess.run(command("stop"), env=own, capture_output=True, timeout=LIMIT_S, check=False)


def test_status_says_that_an_acquisition_is_connecting(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It has not ended: it has not begun. Asked in this process: a second one would take longer than the unit may."""
    with Device(Habits(answers(), streams=None)) as device:
        device.hold(b"S")
        line = command("record", "--port", device.port, "--duration", "0.5", "--filter", "none")
        with started(line) as run:
            device.wait_until_held()
            status.command()
            device.release()
            run.communicate(timeout=LIMIT_S)
            assert run.returncode == 0
        told = capsys.readouterr()
        assert "has ended" not in told.err
        assert "connecting" in told.out
