"""Serves a virtual controller on a port of this machine, to several hosts at once.

The end of a connection does not stop the table, as is assumed of a real one.
"""

import selectors
import socket
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from filters.errors import InputError
from filters.simulation.scenario import TableFault
from imutui.table.acutrol_virtual import VirtualAcutrol

_LOOK_UP_S = 0.02
_LOOPBACK = ("127.0.0.1", "localhost", "::1")

LONGEST_LINE = 4096
"""Bytes after which a line without an end is given up."""

# the eight characters are made up: a driver cuts them off unread, and compares the rest with "OK"
TCP = b"00000000"
BUS = b""
"""As on GPIB, and assumed of a serial line: no prefix, a line end, and no answer to a command that asks nothing."""


@dataclass(slots=True)
class _Host:
    """A connection, and the answers that it waits for."""

    socket: socket.socket
    lines: "Lines" = field(default_factory=lambda: Lines())
    waiting: deque[tuple[float, bytes]] = field(default_factory=deque)  # when it is due, and what


class Lines:
    """Bytes from a host in, lines out."""

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, data: bytes) -> list[str]:
        """Take bytes from the line; returns the lines that have ended and are not empty."""
        *lines, self._begun = (self._begun + data).split(b"\n")
        if len(self._begun) > LONGEST_LINE:
            lines, self._begun = [*lines, self._begun], b""
        return [text for line in lines if (text := line.decode("ascii", "replace").strip())]


def encode_answer(said: Sequence[tuple[bool, str]], prefix: bytes) -> bytes:
    """Return the answers of `VirtualAcutrol.carry_out` as a line: `TCP` or `BUS`, by its prefix."""
    texts = [text for asks, text in said if asks or prefix]
    return prefix + ";".join(texts).encode("ascii", "replace") + b"\n" * (not prefix) if texts else b""


class TableServer:
    """Serves a controller until it is closed; within a `with`.

    `address`: of loopback; port 0 takes one that is free.
    `clock`: the table's time, s.
    `prefix`: of its answers, `TCP` or `BUS`.
    `faults`: those of the link are used; others are the controller's.
    `ahead_s`: time by which the table is ahead of the clock, so that a unit on it is moved in greater steps; commands
      act so much later.
    `log`: called with each line that is no question.
    Raises InputError for an address elsewhere, OSError for one that is taken.
    """

    def __init__(
        self,
        controller: VirtualAcutrol,
        address: tuple[str, int],
        clock: Callable[[], float],
        *,
        prefix: bytes = TCP,
        faults: Sequence[TableFault] = (),
        ahead_s: float = 0.0,
        log: Callable[[str], None] = lambda text: None,
    ) -> None:
        if address[0] not in _LOOPBACK:
            raise InputError(f"a virtual controller is served on loopback only, such as 127.0.0.1:0, not {address[0]}")
        self._controller, self._clock, self._prefix, self._log = controller, clock, prefix, log
        self._ahead_s = ahead_s
        self._of_link = [fault for fault in faults if fault.kind in ("silent", "cut", "slow")]
        self._lock = threading.Lock()
        self._listener = socket.create_server(address, family=socket.AF_INET6 if ":" in address[0] else socket.AF_INET)
        self.port = int(self._listener.getsockname()[1])
        self._hosts: list[_Host] = []
        self._wake_up, self._waker = socket.socketpair()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="table", daemon=True)

    def known(self) -> float:
        """Advance the table; returns the time until which its motion is known, s."""
        with self._lock:
            self._controller.advance(self._clock() + self._ahead_s)
            return self._controller.table.now

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._closing.set()
        self._waker.send(b".")
        self._thread.join()
        for each in (self._listener, self._wake_up, self._waker, *(host.socket for host in self._hosts)):
            each.close()

    def _serve(self) -> None:
        with selectors.DefaultSelector() as selector:
            for each in (self._listener, self._wake_up):
                selector.register(each, selectors.EVENT_READ)
            while not self._closing.is_set():
                ready = [key.data or key.fileobj for key, _ in selector.select(self._patience())]
                self.known()
                if self._listener in ready:
                    host = _Host(self._listener.accept()[0])
                    host.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._hosts.append(host)
                    selector.register(host.socket, selectors.EVENT_READ, host)
                for host in list(self._hosts):
                    if not self._served(host, host in ready):
                        selector.unregister(host.socket)
                        host.socket.close()
                        self._hosts.remove(host)

    def _patience(self) -> float:
        due = [host.waiting[0][0] for host in self._hosts if host.waiting]
        # the table's time may run faster than the wall's, never slower
        return min(max(min(due) - self._clock(), 0.0), _LOOK_UP_S) if due else _LOOK_UP_S

    def _served(self, host: _Host, is_ready: bool) -> bool:
        """Carry out the lines of a host and send the answers that are due; returns False if it has gone."""
        now = self._clock()
        if self._fault("cut", now) is not None:
            return False
        try:
            if is_ready:
                data = host.socket.recv(4096)
                if not data:
                    return False
                self._hear(host, data, now)
            while host.waiting and host.waiting[0][0] <= now:
                host.socket.sendall(host.waiting.popleft()[1])
        except OSError:  # it has gone
            return False
        return True

    def _hear(self, host: _Host, data: bytes, now: float) -> None:
        slow = self._fault("slow", now)
        due = now if slow is None else now + slow.delay
        for line in host.lines.feed(data):
            with self._lock:
                said = self._controller.carry_out(line, now)
            if not all(asks for asks, _ in said):
                self._log(line)
            answer = encode_answer(said, self._prefix)
            if answer and self._fault("silent", now) is None:
                host.waiting.append((due, answer))

    def _fault(self, kind: str, now: float) -> TableFault | None:
        return next((f for f in self._of_link if f.kind == kind and f.at <= now < f.at + f.seconds), None)
