"""A terminal server: a TCP port that carries the bytes of a serial line, plainly or as RFC 2217 has it."""

import select
import socket
import threading
import time
from types import TracebackType
from typing import Any, Self

import serial
from serial import rfc2217

from helpers.processes import LIMIT_S


class TerminalServer:
    """Carries bytes between one client at a time and a serial port; use it in a `with`.

    `device`: path of the serial port.
    `scheme`: "socket" or "rfc2217".
    `number`: TCP port; 0 for any that is free.
    `url`: to connect with.
    """

    def __init__(self, device: str, scheme: str, number: int = 0) -> None:
        self._line = _Line(device, 38400, timeout=0)
        self._listener = socket.create_server(("127.0.0.1", number))
        self.number: int = self._listener.getsockname()[1]
        self.url = f"{scheme}://127.0.0.1:{self.number}"
        self._rfc2217 = scheme == "rfc2217"
        self._end = threading.Event()
        self._stalled = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._end.set()
        self._thread.join(LIMIT_S)
        self._listener.close()
        self._line.close()

    def stall(self, seconds: float) -> None:
        """Hand on nothing for a while; what comes meanwhile is kept."""
        self._stalled.set()
        time.sleep(seconds)
        self._stalled.clear()

    def _serve(self) -> None:
        while not self._end.is_set():
            if select.select([self._listener], [], [], 0.05)[0]:
                client, _ = self._listener.accept()
                with client:
                    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._carry(client)

    def _carry(self, client: socket.socket) -> None:
        manager: Any = rfc2217.PortManager(self._line, _Connection(client)) if self._rfc2217 else None
        while not self._end.is_set():
            # a server that is held up neither hears nor speaks
            readable = [] if self._stalled.wait(0.0) else select.select([client, self._line], [], [], 0.05)[0]
            if self._line in readable:
                data = self._line.read(4096)
                client.sendall(b"".join(manager.escape(data)) if manager else data)
            if client in readable:
                try:
                    data = client.recv(4096)
                except ConnectionError:
                    return
                if not data:
                    return
                self._line.write(b"".join(manager.filter(data)) if manager else data)
            if self._stalled.is_set():
                time.sleep(0.01)


class _Line(serial.Serial):
    """A pseudo-terminal, which has no modem lines, as a port that has them."""

    cts = dsr = cd = property(lambda self: True)
    ri = property(lambda self: False)

    def _update_dtr_state(self) -> None:
        pass

    def _update_rts_state(self) -> None:
        pass


class _Connection:
    """What a `PortManager` writes its own messages to."""

    def __init__(self, client: socket.socket) -> None:
        self._client = client

    def write(self, data: bytes) -> None:
        self._client.sendall(data)
