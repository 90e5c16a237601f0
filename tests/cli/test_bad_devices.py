"""`imutui record` on devices that are none, are others, or fail: one paragraph, exit 4, nothing lost."""

import random
import signal
import socket
import subprocess
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers.fake_devices import Device, Habits, Outcome, answers, command, environment, error_of, record
from helpers.processes import wait_until

from imutui.cli import status
from imutui.instrument.port import Port
from imutui.logbook import reader
from imutui.session import handshake, ipc

NMEA = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n"
STREAMED = 60
OLD = b"an old recording"
_noise = random.Random(7)

# habits, and what the error must say; those that take longest first
DEVICES: dict[str, tuple[Habits, tuple[str, ...]]] = {
    "random bytes": (Habits(chatter=lambda: _noise.randbytes(20)), ("not as a Crossbow IMU", "another device")),
    "a GPS receiver": (Habits(chatter=lambda: NMEA), ("not as a Crossbow IMU", "24 47 50", "another device")),
    "an echo": (Habits(echo=True), ("not as a Crossbow IMU", "another cable")),
    "silence": (Habits(), ("silent", "38400", "power")),
    "ping and no more": (Habits(answers(c=b"", S=b"", v=b"")), ("answers a ping", "Power it off and on")),
    "modes and no packets": (Habits(answers()), ("sends no packets", "Power it off and on")),
    "hangs up when asked": (Habits(answers(), hangs_up_at=b"v"), ("went away", "Check the cable")),
    "hangs up before it streams": (Habits(answers(), hangs_up_at=b"C"), ("went away", "Check the cable")),
    "hangs up while recording": (Habits(answers(), streams=STREAMED), ("went away", "Check the cable")),
    "AHRS400CC-100": (Habits(answers("AHRS400CC-100 VER 2.1")), ("AHRS400CC-100", "not an IMU400CD-200", "Connect")),
}
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
WORDS = {name: words for name, (_, words) in (DEVICES | SERVERS).items()}


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, "Future[Outcome]"]]:
    """What `record` makes of all of them; a few at a time, since most of it is waiting."""

    def attempt(port: str, folder: Path) -> Outcome:
        (folder / "out.mcap").write_bytes(OLD)
        return record(folder, port, "--duration", "1", "--filter", "none", "-o", "out.mcap", "--force")

    def on_device(habits: Habits, folder: Path) -> Outcome:
        with Device(habits) as device:
            return attempt(device.port, folder)

    def on_server(hangs_up: bool, folder: Path) -> Outcome:
        with terminal_server(hangs_up) as url:
            return attempt(url, folder)

    with ThreadPoolExecutor(max_workers=5) as pool:
        devices = {
            name: pool.submit(on_device, habits, tmp_path_factory.mktemp("device"))
            for name, (habits, _) in DEVICES.items()
        }
        servers = {
            name: pool.submit(on_server, hangs_up, tmp_path_factory.mktemp("server"))
            for name, (hangs_up, _) in SERVERS.items()
        }
        yield devices | servers


@pytest.mark.parametrize("name", list(reversed(WORDS)))
def test_what_is_no_working_imu400cd_is_named_with_the_next_step(
    outcomes: dict[str, "Future[Outcome]"], name: str
) -> None:
    """Exit 4, the port, what is wrong, what to do; and no process is left behind."""
    outcome = outcomes[name].result()
    assert outcome.code == 4, outcome
    error = error_of(outcome)
    assert "/dev/" in error or "socket://" in error
    for words in WORDS[name]:
        assert words in error
    wait_until(lambda: not ipc.is_locked(outcome.folder / "run" / "imutui" / "default.lock"))


@pytest.mark.parametrize("name", [name for name in WORDS if name != "hangs up while recording"])
def test_a_failed_attempt_leaves_the_file_it_was_to_replace(outcomes: dict[str, "Future[Outcome]"], name: str) -> None:
    """--force replaces a recording by a recording, never by nothing."""
    assert (outcomes[name].result().folder / "out.mcap").read_bytes() == OLD


@pytest.mark.parametrize("model", OTHER_MODELS)
def test_another_model_of_the_family_is_refused_by_name(model: str) -> None:
    """Same commands, other ranges or packets: its readings would be wrong by a factor."""
    with (
        Device(Habits(answers(f"{model} VER 2.1"))) as device,
        Port(device.port, 38400) as port,
        pytest.raises(handshake.InstrumentError) as refused,
    ):
        handshake.open_dialogue(port, 38400, say=lambda text: None)
    assert model in str(refused.value)
    assert "not an IMU400CD-200" in str(refused.value)


def test_what_came_before_the_hang_up_is_a_finished_file(outcomes: dict[str, "Future[Outcome]"]) -> None:
    """The last packet before the adapter went away is in it, and an event says what happened."""
    log = reader.read(outcomes["hangs up while recording"].result().folder / "out.mcap", raw=True)
    assert log.finished
    assert not log.damage
    assert len(log.raw) >= STREAMED - 1  # a packet needs a successor, or quiet, to vouch for it
    assert any("went away" in event.text for event in log.events)


def test_ctrl_c_while_connecting_leaves_no_acquisition_behind(tmp_path: Path) -> None:
    """Who gives up before the first packet must not find a recording going on unseen."""
    own = environment(tmp_path)
    with Device(Habits(answers(), streams=None)) as device:
        device.hold(b"S")
        line = command("record", "--port", device.port, "-o", str(tmp_path / "out.mcap"))
        with subprocess.Popen(line, env=own, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as run:
            device.wait_until_held()
            run.send_signal(signal.SIGINT)
            _, stderr = run.communicate(timeout=60)
        device.release()
        assert run.returncode == 130
        assert "Traceback" not in stderr
        lock = tmp_path / "run" / "imutui" / "default.lock"
        try:
            wait_until(lambda: not ipc.is_locked(lock), timeout=10.0)
        finally:
            subprocess.run(command("stop"), env=own, capture_output=True, check=False)


def test_status_says_that_an_acquisition_is_connecting(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It has not ended: it has not begun. Asked in this process: a second one would take longer than the unit may."""
    with Device(Habits(answers(), streams=None)) as device:
        device.hold(b"S")
        line = command("record", "--port", device.port, "--duration", "0.5", "--filter", "none")
        with subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
            device.wait_until_held()
            status.command()
            device.release()
            assert run.wait(60) == 0
        told = capsys.readouterr()
        assert "has ended" not in told.err
        assert "connecting" in told.out
