"""The stream for Foxglove: what a viewer gets, and that none can harm the acquisition."""

import contextlib
import importlib.util
import json
import os
import select
import signal
import socket
import struct
import threading
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import pytest
from helpers.acquisitions import acquiring
from helpers.commands import imutui
from helpers.processes import LIMIT_S, command_line, free_port, started, wait_until
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from imutui.logbook import schemas
from imutui.session import client, origin_gate
from imutui.session.live_stream import TOPICS, WAITING_LIMIT, LiveStream, StreamError

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
        while len(self.channels) < len(TOPICS):
            told = json.loads(self._socket.recv(LIMIT_S))
            self.channels |= {channel["id"]: channel for channel in told["channels"]}
        wishes = [{"id": number, "channelId": number} for number in self.channels]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wishes}))
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


@pytest.fixture
def stream() -> Iterator[LiveStream]:
    with closing(LiveStream("127.0.0.1", free_port(), "imutui")) as made:
        yield made


def port_of(stream: LiveStream) -> int:
    return int(stream.url.rpartition(":")[2])


def in_file(path: Path) -> list[Message]:
    with path.open("rb") as file:
        return [(c.topic, m.log_time, m.data) for _, c, m in make_reader(file).iter_messages(log_time_order=False)]


def test_a_viewer_gets_what_the_file_gets(home: Path, stream: LiveStream) -> None:
    with acquiring(home, stream=stream) as running, Viewer(port_of(stream)) as viewer:
        wait_until(lambda: len(viewer.of(schemas.IMU)) > 20 and bool(viewer.of(schemas.TRANSFORMS)))
        running.a_second_passes()
        wait_until(lambda: running.seen()["stream"]["viewers"] == 1)
        path = running.first
        running.end()
        held = in_file(path)
        received = [message for message in viewer.messages if message[0] != schemas.TRANSFORMS]
        wait_until(lambda: viewer.messages[-1] == held[-1])
        received = [message for message in viewer.messages if message[0] != schemas.TRANSFORMS]
        assert received == [message for message in held if message[0] != schemas.TRANSFORMS][-len(received) :]
        # it came before this viewer did, once, and is sent again to who comes late
        assert viewer.of(schemas.TRANSFORMS)[0] in held
        assert {c["topic"]: c["schemaName"] for c in viewer.channels.values()} == schemas.TYPES
        assert {(c["encoding"], c["schemaEncoding"]) for c in viewer.channels.values()} == {("cdr", "ros2msg")}
        [samples] = [c for c in viewer.channels.values() if c["topic"] == schemas.IMU]
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(samples["schema"], samples["schemaName"]))
        sample: Any = store.deserialize_cdr(viewer.of(schemas.IMU)[0][2], samples["schemaName"])
        assert sample.linear_acceleration.z == pytest.approx(-9.79, abs=0.05)
        assert sample.header.frame_id == "imu_link_ned"
        stream.close()
        viewer.wait_until_closed()


def test_a_page_of_another_origin_does_not_get_the_stream(home: Path) -> None:
    more = "https://viewer.example.org http://lab:8080"
    with closing(LiveStream("127.0.0.1", free_port(), "imutui", more)) as stream:
        port = port_of(stream)
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

            def comes() -> bool:
                """Send a message again, since one that is sent before the viewer's subscription counts is not kept."""
                stream.send(schemas.IMU, b"x", 1)
                return bool(viewer.of(schemas.IMU))

            wait_until(comes)


def test_a_server_whose_acquisition_is_killed_ends_without_a_traceback(capfd: pytest.CaptureFixture[str]) -> None:
    """The kernel resets a connection in which a killed process left a report unread."""
    with closing(LiveStream("127.0.0.1", free_port(), "imutui")) as stream, Viewer(port_of(stream)) as viewer:
        assert select.select([stream._socket], [], [], LIMIT_S)[0]  # that there is a viewer
        stream._socket.close()
        viewer.wait_until_closed()
        stream._process.wait(LIMIT_S)
    assert "Traceback" not in capfd.readouterr().err


def test_the_library_behind_the_gate_is_at_no_address_that_a_page_knows(stream: LiveStream) -> None:
    inodes = {link.readlink().name for link in Path(f"/proc/{stream.pid}/fd").iterdir()}
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    listening = [row[1].split(":") for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in inodes]
    at = {socket.inet_ntoa(struct.pack("=I", int(address, 16))): int(port, 16) for address, port in listening}
    assert at.pop("127.0.0.1") == port_of(stream)
    (behind,) = at
    assert behind.startswith("127.")
    assert len({origin_gate.loopback_address() for _ in range(50)}) == 50


def test_a_server_that_hangs_costs_its_viewers_messages_and_nobody_else(stream: LiveStream) -> None:
    os.kill(stream.pid, signal.SIGSTOP)
    data = bytes(1000)
    for k in range(3 * WAITING_LIMIT):
        stream.send(schemas.IMU, data, k)
    seen = stream.snapshot()
    assert seen["dropped"] == 3 * WAITING_LIMIT - seen["sent"] - WAITING_LIMIT > 0
    os.kill(stream.pid, signal.SIGCONT)
    wait_until(lambda: stream.look() is None and stream.snapshot()["sent"] == seen["sent"] + WAITING_LIMIT)
    assert stream.snapshot()["dropped"] == seen["dropped"]


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


def test_a_viewer_that_hangs_is_told_of_and_holds_up_nobody(stream: LiveStream) -> None:
    port, sent = port_of(stream), 0
    with Viewer(port) as good, stuck_viewer(port, good.channels):
        wait_until(lambda: stream.look() is None and stream.snapshot()["viewers"] == 2)
        while not stream.snapshot()["slow"]:
            for _ in range(500):
                sent += 1
                stream.send(schemas.IMU, bytes(4000), sent)
            wait_until(lambda wanted=sent: stream.look() is None and len(good.messages) == wanted)  # type: ignore[misc]
        assert [log_ns for _, log_ns, _ in good.messages] == list(range(1, sent + 1))
        assert stream.snapshot()["dropped"] == 0


def test_a_server_that_dies_ends_the_stream_and_not_the_recording(home: Path, stream: LiveStream) -> None:
    with acquiring(home, stream=stream) as running:
        os.kill(stream.pid, signal.SIGKILL)
        running.record(60)
        running.a_second_passes()
        seen = running.seen()
        assert seen["stream"]["ended"]
        told = [event for event in seen["events"] if "Foxglove has ended by itself" in event["text"]]
        assert len(told) == 1
        assert seen["recording"]["samples"] > 60


def test_a_stream_ends_with_the_socket_of_its_acquisition(stream: LiveStream) -> None:
    """As the system closes it for a process that is killed: the server ends by itself, and its port is free again."""
    stream.close()
    assert stream._process.returncode == 0
    with closing(LiveStream("127.0.0.1", port_of(stream), "imutui")):
        pass


def test_a_stream_that_cannot_be_is_refused_before_the_unit_is_touched(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = imutui("record", "--port", "/dev/none", "--foxglove", port, check=4)
        assert f"port {port}" in done.stderr
        assert "in use" in done.stderr
    with pytest.raises(StreamError, match="no address of this computer"):
        LiveStream("203.0.113.7", port, "imutui")
    assert "TCP port" in imutui("record", "--port", "/dev/none", "--foxglove", "70000", check=2).stderr
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert "[live]" in imutui("record", "--port", "/dev/none", "--foxglove", "8765", check=2).stderr


def test_record_streams_and_status_says_so(home: Path) -> None:
    port = free_port()
    (home / "imutui.toml").write_text(f"[foxglove]\nport = {port}\n")
    line = command_line("record", "--port", "virtual", "--filter", "none", "--name", "streamed")
    with started(line) as command:
        wait_until(lambda: _answers("streamed"))
        with Viewer(port) as viewer:
            wait_until(lambda: len(viewer.of(schemas.RAW)) > 3)
            assert viewer.server["name"] == "imutui streamed"
            wait_until(lambda: "1 viewer" in imutui("status").stdout)
            imutui("stop", "--name", "streamed", check=None)
            viewer.wait_until_closed()
        command.wait(LIMIT_S)
    socket.create_server(("127.0.0.1", port)).close()


def _answers(name: str) -> bool:
    with contextlib.suppress(client.SessionError):  # it is connecting
        return client.attach(name).snapshot(2**62)["state"] == "running"
    return False
