"""The operator's terminal over a real SSH link: cut, frozen, watched by two, and found from any shell.

What was sent is known from the unit's side of the wire (`imutui virtual --tap`): losing a link costs not one packet.
"""

import contextlib
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers import loopback, ros_messages
from helpers.loopback import SshServer, Terminal, processes_with
from helpers.processes import command_line, family, wait_until
from helpers.tap import packets_of
from helpers.units import virtual

from imutui.instrument.counter_spec import SPAN
from imutui.logbook import reader
from imutui.session import client
from imutui.session.client import Client
from imutui.session.plan import Plan

_PERIOD_S = 0.0075


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SshServer]:
    if lacking := loopback.missing():
        pytest.skip(lacking)
    made = SshServer(tmp_path_factory.mktemp("sshd"))
    yield made
    made.close()


Login = Callable[..., Terminal]


@pytest.fixture
def login(home: Path, server: SshServer) -> Iterator[Login]:
    """Run imutui over SSH, with the test's own folders, as PAM gives a log-in the runtime folder of its user.

    An empty variable is left out. What is compiled is that of all tests: to compile it takes longer than such a
    recording.
    """
    opened: list[Terminal] = []
    names = ("XDG_RUNTIME_DIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "NUMBA_CACHE_DIR")

    def run(*arguments: str, **environ: str) -> Terminal:
        own = {name: os.environ[name] for name in names}
        variables = {name: value for name, value in (own | environ).items() if value}
        opened.append(Terminal(server.client(), command_line(*arguments), home, variables))
        return opened[-1]

    yield run
    for terminal in opened:
        terminal.close()
    for pid in ours(home):
        os.kill(pid, signal.SIGKILL)


@pytest.fixture
def unit(home: Path) -> Iterator[str]:
    """Port of a virtual instrument on the machine; what it sends is noted in the file `sent`."""
    with virtual(home / "sent") as port:
        yield port


def ours(home: Path) -> set[int]:
    """Processes of this test, wherever they were started."""
    return processes_with(f"XDG_CACHE_HOME={home / 'cache'}")


def packets(connection: Client) -> int:
    """Packets that the acquisition has had."""
    return int(connection.snapshot(2**62)["packets"])


def goes_on(connection: Client, seconds: float = 1.0) -> None:
    """Wait for so many more seconds of packets."""
    enough = packets(connection) + seconds / _PERIOD_S
    wait_until(lambda: packets(connection) > enough)


def attached() -> Client:
    """The running acquisition, in whatever runtime folder it is, when it records."""
    wait_until(lambda: client.running() != [])
    found: list[Client] = []

    def records() -> bool:
        try:
            found[:] = [client.attach(client.running()[0])]
        except client.SessionConnectingError:
            return False
        return found[0].snapshot(2**62)["recording"] is not None

    wait_until(records)
    return found[0]


def sockets(connection: Client) -> int:
    """Open sockets of the acquisition: one that listens, and one for each viewer."""
    found = 0
    for descriptor in Path(f"/proc/{connection.pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # closed meanwhile
            found += str(descriptor.readlink()).startswith("socket:")
    return found


def nobody_else_watches(connection: Client) -> bool:
    """Whether ours is the only connection to the acquisition."""
    return sockets(connection) == 2


def assert_gapless(log: reader.Log) -> None:
    """A finished file, and each packet one period of the unit's loop after the last by the unit's own ticks."""
    assert log.finished
    assert [packet.sequence for packet in ros_messages.packets(log)] == list(range(len(ros_messages.packets(log))))
    steps = -np.diff([packet.ticks for packet in ros_messages.packets(log)]) % SPAN
    assert np.all(np.abs(steps - np.median(steps)) < 0.1 * np.median(steps))


def assert_all_recorded(log: reader.Log, tap: Path, seen: int) -> None:
    """Word for word what the unit sent, from the first packet to one after the last that was seen before the end."""
    assert [(*packet.counts, packet.temperature, packet.ticks) for packet in ros_messages.packets(log)] == packets_of(
        tap
    )[: len(ros_messages.packets(log))]
    assert len(ros_messages.packets(log)) >= seen


def test_a_cut_link_costs_no_packet_and_leaves_nothing_behind(
    home: Path, login: Login, server: SshServer, unit: str
) -> None:
    """Client killed under `record`, sshd under the UI: all goes on; two viewers come back; every packet is there."""
    before = ours(home)
    recording = login("record", "--port", unit, "--rate", "20", "--note", "remote")
    recording.wait_for("Ctrl+C finishes")
    connection = attached()
    screen = login("attach")
    screen.wait_for("● REC", "asked 20", "? help")
    assert sockets(connection) >= 3

    recording.close()
    for pid in server.sessions():
        with contextlib.suppress(ProcessLookupError):  # that of the closed link may have ended meanwhile
            os.kill(pid, signal.SIGKILL)
    wait_until(lambda: ours(home) == before | {connection.pid} and nobody_else_watches(connection))
    goes_on(connection)

    path = Path(connection.snapshot(2**62)["recording"]["path"])
    again, second = login("attach"), login("attach")
    for terminal in (again, second):
        terminal.wait_for("● REC", unit.removeprefix("/dev/"), "asked 20", "? help")
    again.press("m")
    again.wait_for("Mark in the recording")
    again.press("back again\r")
    again.wait_for("marked: back again")
    second.press("3")
    second.wait_for("RECORDING", "back again")
    seen = packets(connection)
    again.press("q")
    again.wait_for("finish the file, stop")
    again.press("s")
    second.wait_for("the acquisition has ended")
    assert again.process.wait(60.0) == 0
    wait_until(lambda: client.running() == [])
    log = reader.read(path, raw=True)
    assert_gapless(log)
    assert_all_recorded(log, home / "sent", seen)
    assert "back again" in [event.text for event in log.events if event.name == "mark"]


def test_a_recording_begun_on_the_screen_outlives_its_link(home: Path, login: Login, server: SshServer) -> None:
    """It runs without a runtime folder, and a log-in that has one finds it and shows it."""
    first = login(XDG_RUNTIME_DIR=str(home / "none"), IMUTUI_ACQUISITION_RATE_HZ="20")
    # the line that says what Enter does comes last: a key that is pressed before would move on from there
    first.wait_for("virtual instrument", "20 Hz, stream")
    while "virtual, 20 Hz" not in (before := first.screen()):
        first.press("\x1b[B")
        wait_until(lambda before=before: first.screen() != before)  # type: ignore[misc]
    first.press("\r")
    first.wait_for("asked 20", "not recording")
    first.press("r")
    first.wait_for("A note for this recording")
    first.press("\r")
    first.wait_for("● REC")
    connection = attached()
    first.close()
    wait_until(lambda: ours(home) == set(family(connection.pid)) and nobody_else_watches(connection))
    goes_on(connection)
    login("status").wait_for(f"{connection.name} (pid {connection.pid})")
    login("attach").wait_for("● REC", "asked 20")
    result = connection.stop()["result"]
    assert result is not None
    assert result["lost_packets"] == 0
    assert_gapless(reader.read(Path(result["log"]), raw=True))


def test_a_frozen_link_costs_no_packet(home: Path, login: Login, server: SshServer, unit: str) -> None:
    """Started on the machine, watched over SSH; no end takes a byte for 3 s of packets; then the screen goes on."""
    connection = client.start(Plan(unit, rate_hz=20.0, record=True, logs=str(home / "logs")))
    screen = login("attach")
    screen.wait_for("● REC", "asked 20", "? help")
    screen.send(signal.SIGSTOP)
    for pid in server.sessions():
        os.kill(pid, signal.SIGSTOP)  # else buffers on the way would take the screens of minutes
    goes_on(connection, 3.0)
    for pid in server.sessions():
        os.kill(pid, signal.SIGCONT)
    screen.send(signal.SIGCONT)
    screen.press("4")
    screen.wait_for("Table 1 limit", "NIS")
    seen = packets(connection)
    connection.stop()
    (path,) = (home / "logs").glob("*.mcap")
    log = reader.read(path, raw=True)
    assert_gapless(log)
    assert_all_recorded(log, home / "sent", seen)
