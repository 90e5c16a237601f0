"""`imutui foxglove`: what a viewer gets of a log, which pages may, and that none of it can harm the acquisition."""

import contextlib
import importlib.util
import json
import os
import signal
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pytest
from helpers.commands import imutui
from helpers.logs import START, recorded
from helpers.processes import LIMIT_S, children, command_line, free_port, has_ended, listens, started, wait_until
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from imutui import origin_gate
from imutui.logbook import SessionInfo, reader, schemas
from imutui.logbook.writer import LogWriter
from imutui.session import client
from imutui.session.client import SessionError

pytestmark = pytest.mark.filterwarnings("ignore:connect.. must be used as a context manager")
Message = tuple[str, int, bytes]
# of a message to a client: opcode 1, the subscription's number, log time
_HEAD = struct.Struct("<BIQ")


def handshake(port: int, *headers: str, host: str = "127.0.0.1") -> str:
    """First line of the answer to a viewer with these headers."""
    lines = ["GET / HTTP/1.1", "Host: a", "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13"]
    lines += ["Sec-WebSocket-Protocol: foxglove.sdk.v1", "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", *headers]
    with socket.create_connection((host, port), LIMIT_S) as viewer:
        for byte in "\r\n".join([*lines, "", ""]).encode():
            viewer.send(bytes([byte]))
        return viewer.recv(1000).decode("latin-1").partition("\r\n")[0]


class Viewer:
    """A client of the websocket that subscribes to everything, as Foxglove does for its panels."""

    def __init__(self, port: int) -> None:
        self._socket: ClientConnection = connect(
            f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")], open_timeout=LIMIT_S
        )
        self.server = json.loads(self._socket.recv(LIMIT_S))
        self.channels: dict[int, dict[str, Any]] = {}
        self.messages: list[Message] = []
        self._thread = threading.Thread(target=self._receive, daemon=True)
        self._thread.start()

    def _receive(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            while True:
                got = self._socket.recv()
                if isinstance(got, bytes):
                    _, number, log_ns = _HEAD.unpack_from(got)
                    self.messages.append((self.channels[number]["topic"], log_ns, got[_HEAD.size :]))
                    continue
                channels = {channel["id"]: channel for channel in json.loads(got).get("channels", ())}
                self.channels |= channels
                wishes = [{"id": number, "channelId": number} for number in channels]
                self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wishes}))

    def of(self, topic: str) -> list[Message]:
        return [message for message in list(self.messages) if message[0] == topic]

    def __enter__(self) -> "Viewer":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._socket.close()
        self._thread.join(LIMIT_S)

    def wait_until_closed(self) -> None:
        self._thread.join(LIMIT_S)
        assert not self._thread.is_alive()


@contextmanager
def serving(*arguments: object) -> Iterator[tuple[int, "subprocess.Popen[str]"]]:
    """The command with these arguments, once it serves: its port, and its process."""
    port = free_port()
    with started(command_line("foxglove", *map(str, arguments), "--port", str(port))) as process:
        assert process.stderr is not None
        line = process.stderr.readline()
        assert f"ws://127.0.0.1:{port}" in line, line + process.stderr.read()
        yield port, process


class Growing:
    """A log that this process writes, a sample at a time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.log = LogWriter(path, SessionInfo(), "", START)
        self.count = 0

    def add(self, samples: int = 1) -> None:
        """Write samples, and have them on the disk."""
        for _ in range(samples):
            self.count += 1
            stamp = START + self.count * 10_000_000
            self.log.imu(stamp, stamp, np.zeros(3), np.array([0.0, 0.0, -9.79]))
        self.log.flush()


@pytest.fixture
def growing(tmp_path: Path) -> Iterator[Growing]:
    made = Growing(tmp_path / "a.mcap")
    made.add()
    yield made
    if made.log.sha256 is None:
        made.log.finish({}, START)


def in_file(path: Path) -> list[Message]:
    with path.open("rb") as file:
        return [(c.topic, m.log_time, m.data) for _, c, m in make_reader(file).iter_messages(log_time_order=False)]


def settled(viewer: Viewer, growing: Growing) -> None:
    """Wait until a viewer gets samples: what is written before its subscription is not sent."""

    def comes() -> bool:
        growing.add()
        return bool(viewer.of(schemas.IMU))

    wait_until(comes)


def test_a_log_that_is_written_is_served_from_now_on_to_its_end(growing: Growing) -> None:
    growing.add(1000)
    with serving(growing.path) as (port, process), Viewer(port) as viewer:
        assert viewer.server["name"] == "imutui a.mcap"
        settled(viewer, growing)
        growing.add(100)
        growing.log.finish({}, START)
        viewer.wait_until_closed()
        assert process.wait(LIMIT_S) == 0
        held = in_file(growing.path)
        samples = [message for message in held if message[0] == schemas.IMU]
        assert 100 <= len(viewer.of(schemas.IMU)) < 1000
        assert viewer.of(schemas.IMU) == samples[-len(viewer.of(schemas.IMU)) :]
        # they were written before this viewer came, once, and are sent again to who comes late
        assert viewer.of(schemas.TRANSFORMS)[0] in held
        assert {c["topic"]: c["schemaName"] for c in viewer.channels.values()} == schemas.TYPES
        assert {(c["encoding"], c["schemaEncoding"]) for c in viewer.channels.values()} == {("cdr", "ros2msg")}
        [channel] = [c for c in viewer.channels.values() if c["topic"] == schemas.IMU]
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(channel["schema"], channel["schemaName"]))
        sample: Any = store.deserialize_cdr(viewer.of(schemas.IMU)[0][2], channel["schemaName"])
        assert sample.linear_acceleration.z == -9.79
        assert sample.header.frame_id == "imu_link_ned"


def test_a_finished_log_is_played_once_from_the_first_subscription_on(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap", 2)
    with serving(path) as (port, process), Viewer(port) as viewer:
        viewer.wait_until_closed()
        assert process.wait(LIMIT_S) == 0
        received = [message for message in viewer.messages if message[0] != schemas.TRANSFORMS]
        assert received == [message for message in in_file(path) if message[0] != schemas.TRANSFORMS]


def test_a_log_of_another_program_is_served_with_its_own_channels(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("Figure", "jsonschema", b"{}")
        for topic, number in (("/figure", schema), ("/bare", 0)):
            channel = writer.register_channel(topic, "json", number, {"unit": "K"})
            writer.add_message(channel, 5, b"{}", 5)
        writer.finish()
    with serving(path) as (port, process), Viewer(port) as viewer:
        viewer.wait_until_closed()
        assert process.wait(LIMIT_S) == 0
        assert viewer.messages == [("/figure", 5, b"{}"), ("/bare", 5, b"{}")]
        assert {c["topic"]: c["schemaName"] for c in viewer.channels.values()} == {"/figure": "Figure", "/bare": ""}


def test_a_damaged_log_is_served_up_to_the_damage(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap", 2)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with serving(path) as (port, process), Viewer(port) as viewer:
        viewer.wait_until_closed()
        assert process.wait(LIMIT_S) == 1
        assert process.stderr is not None
        assert "`imutui check" in process.stderr.read()
        assert viewer.of(schemas.IMU)


def test_a_page_of_another_origin_does_not_get_the_stream(home: Path, growing: Growing) -> None:
    more = "https://viewer.example.org http://lab:8080"
    (home / "imutui.toml").write_text(f'[foxglove]\norigins = "{more}"\n')
    with serving(growing.path) as (port, _):
        for allowed in (
            None,
            "https://app.foxglove.dev",
            "file://",
            "http://localhost:8080",
            "http://127.0.0.1",
            *more.split(),
        ):
            headers = () if allowed is None else (f"Origin: {allowed}",)
            assert "101 Switching" in handshake(port, *headers), allowed
        for refused in (
            "https://evil.example",
            "null",
            "",
            "https://app.foxglove.dev.evil.example",
            "https://evil.example/https://app.foxglove.dev",
            "http://localhost.evil.example",
            "http://app.foxglove.dev",
            "http://127.0.0.1.evil.example:80",
            f"http://a:{port}",
        ):
            assert "403 Forbidden" in handshake(port, f"Origin: {refused}"), refused
        assert "403" in handshake(port, "origin:https://evil.example")
        assert "403" in handshake(port, "Origin: file://", "ORIGIN: https://evil.example")
        assert "403" in handshake(port, "Origin: file://", " https://evil.example")
        with Viewer(port) as viewer:
            settled(viewer, growing)


def test_the_library_behind_the_gate_is_at_no_address_that_a_page_knows(growing: Growing) -> None:
    with serving(growing.path) as (port, process):
        inodes = {link.readlink().name for link in Path(f"/proc/{process.pid}/fd").iterdir()}
        rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    listening = [row[1].split(":") for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in inodes]
    at = {socket.inet_ntoa(struct.pack("=I", int(address, 16))): int(port, 16) for address, port in listening}
    assert at.pop("127.0.0.1") == port
    (behind,) = at
    assert behind.startswith("127.")
    assert len({origin_gate.loopback_address() for _ in range(50)}) == 50


@contextmanager
def stuck_viewer(port: int, channels: Iterable[int]) -> Iterator[None]:
    """One that subscribes and never reads, by hand: a client's library reads whether it is asked to or not."""
    with socket.create_connection(("127.0.0.1", port)) as viewer:
        key = "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
        upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n"
        viewer.sendall(f"GET / HTTP/1.1\r\nHost: a\r\n{upgrade}{key}\r\n".encode())
        assert b"101 Switching" in viewer.recv(1000)
        wishes = [{"id": number, "channelId": number} for number in channels]
        text = json.dumps({"op": "subscribe", "subscriptions": wishes}).encode()
        viewer.sendall(struct.pack(">BBHI", 0x81, 0x80 | 126, len(text), 0) + text)
        yield


def test_a_viewer_that_hangs_is_reported_and_holds_up_no_other(growing: Growing) -> None:
    with serving(growing.path) as (port, process), Viewer(port) as good:
        settled(good, growing)
        sent, said = 0, list[str]()
        threading.Thread(target=lambda: said.extend(iter(process.stderr.readline, "")), daemon=True).start()  # type: ignore[union-attr]
        with stuck_viewer(port, good.channels):
            while not said:
                for _ in range(500):
                    sent += 1
                    growing.log.encoded(schemas.EVENTS, bytes(4000), START + sent, START)
                growing.log.flush()
                wait_until(lambda wanted=sent: len(good.of(schemas.EVENTS)) == wanted)  # type: ignore[misc]
        assert "outbox" in said[0]


@contextmanager
def recording(*arguments: object) -> Iterator[tuple[int, "subprocess.Popen[str]", int]]:
    """`record --foxglove` of a virtual unit, once it records: its port, its process, and that of the follower."""
    port = free_port()
    line = ("record", "--port", "virtual", "--filter", "none", "--name", "streamed", "--foxglove", str(port))
    with started(command_line(*line, *map(str, arguments))) as command:
        wait_until(_answers)
        acquisition = client.attach("streamed").pid
        [follower] = [pid for pid in children(acquisition) if b"foxglove" in Path(f"/proc/{pid}/cmdline").read_bytes()]
        yield port, command, follower


def _answers() -> bool:
    with contextlib.suppress(SessionError):  # it is connecting
        return bool(client.attach("streamed").snapshot(2**62)["recording"])
    return False


def test_record_has_all_its_files_served_and_the_follower_ends_with_it(home: Path) -> None:
    with recording("--rotate-minutes", 0.1, "--json") as (port, command, follower):
        wait_until(lambda: listens(port))
        with Viewer(port) as viewer:
            assert viewer.server["name"] == "imutui streamed"
            wait_until(lambda: bool(viewer.of(schemas.RAW)))
            count = len([*home.glob("logs/*.mcap")])
            wait_until(lambda: len([*home.glob("logs/*.mcap")]) > count)
            now_ns = time.time_ns()
            wait_until(lambda: viewer.of(schemas.RAW)[-1][1] > now_ns)
            imutui("stop", "--name", "streamed", check=None)
            viewer.wait_until_closed()
            out, _ = command.communicate(timeout=LIMIT_S)
        assert has_ended(follower)
        socket.create_server(("127.0.0.1", port)).close()
        parts = [Path(part["log"]) for part in json.loads(out)["parts"]]
        held = [message for part in parts for message in in_file(part) if message[0] == schemas.RAW]
        received = viewer.of(schemas.RAW)
        # what a file that is finished at once still held may be missing at the end
        first = held.index(received[0])
        assert received == held[first : first + len(received)]
        assert {c["topic"]: c["schemaName"] for c in viewer.channels.values()} == schemas.TYPES
        log = reader.read(parts[0])
        assert any(f"served to Foxglove at ws://127.0.0.1:{port}" in event.text for event in log.events)


def test_each_unit_of_a_batch_is_served_at_a_port_of_its_own(home: Path) -> None:
    (home / "two.toml").write_text('rate = 20.0\nfilter = "none"\n' + '[[unit]]\nport = "virtual"\n' * 2)
    port = next(port for port in iter(free_port, 0) if not listens(port + 1))
    with started(command_line("record", "--batch", "two.toml", "--foxglove", str(port))) as command:
        for number in (1, 2):
            wait_until(lambda at=port + number - 1: listens(at))  # type: ignore[misc]
            with Viewer(port + number - 1) as viewer:
                assert viewer.server["name"] == f"imutui two:{number}"
                wait_until(lambda viewer=viewer: bool(viewer.of(schemas.IMU)))  # type: ignore[misc]
        imutui("stop", "--batch", "two", check=None)
        command.communicate(timeout=LIMIT_S)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_follower_that_dies_or_hangs_costs_no_sample(home: Path, number: signal.Signals) -> None:
    with recording("--duration", "5", "-o", home / "a.mcap", "--json") as (_, command, follower):
        os.kill(follower, number)
        out, _ = command.communicate(timeout=LIMIT_S)
        assert command.returncode == 0
        result = json.loads(out)
        log = reader.read(home / "a.mcap", raw=True)
        assert result["lost_packets"] == 0
        assert log.finished
        assert np.ptp(log.samples.stamp_ns) / 1e9 == pytest.approx(5.0, abs=0.1)
        assert np.diff(log.samples.stamp_ns).max() < 2 * 7_500_000
        assert sum("Foxglove is served no more" in event.text for event in log.events) == (number == signal.SIGKILL)
        assert has_ended(follower)


def test_a_follower_whose_acquisition_is_killed_ends_by_itself(home: Path) -> None:
    with recording(), serving("--name", "streamed") as (port, process), Viewer(port) as viewer:
        wait_until(lambda: bool(viewer.of(schemas.RAW)))
        os.kill(client.attach("streamed").pid, signal.SIGKILL)
        viewer.wait_until_closed()
        process.wait(LIMIT_S)
        assert process.stderr is not None
        assert "Traceback" not in process.stderr.read()


def test_what_cannot_be_served_is_refused_before_the_unit_is_touched(
    home: Path, monkeypatch: pytest.MonkeyPatch, growing: Growing
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for command in (("record", "--port", "/dev/none", "--foxglove"), ("foxglove", growing.path, "--port")):
            done = imutui(*command, port, check=4)
            assert f"port {port}" in done.stderr
            assert "in use" in done.stderr
    done = imutui("foxglove", growing.path, "--host", "203.0.113.7", check=4)
    assert "no address of this computer" in done.stderr
    assert "without a password" in done.stderr
    assert "0-65535" in imutui("record", "--port", "/dev/none", "--foxglove", "70000", check=4).stderr
    assert "no acquisition is running" in imutui("foxglove", check=4).stderr
    assert "--name" in imutui("foxglove", growing.path, "--name", "a", check=2).stderr
    port = free_port()
    assert "no such file" in imutui("foxglove", home / "none.mcap", "--port", port, check=3).stderr
    (home / "text.mcap").write_text("text")
    assert "not an MCAP log" in imutui("foxglove", home / "text.mcap", "--port", port, check=3).stderr
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert "[live]" in imutui("record", "--port", "/dev/none", "--foxglove", "8765", check=2).stderr
    assert "[live]" in imutui("foxglove", growing.path, check=2).stderr
