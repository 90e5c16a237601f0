"""The gate in front of the websocket for Foxglove: it refuses browsers' pages of origins that are not allowed.

foxglove-sdk has no check of `Origin`, so that any page in a browser of this network could read the stream. The library
therefore listens at a random address of the loopback network and a random port, which no page can guess, and this gate
at the address that viewers know. It reads the head of each connection's first request; from then on it passes bytes on.

A program that is no browser names no origin and is let in. The gate knows pages, not users.
"""

import contextlib
import errno
import re
import secrets
import socket
import sys
import threading
import time
from collections.abc import Callable

from imutui.plain_text import in_line

FOXGLOVE = ("https://app.foxglove.dev", "file://")
"""Origins of Foxglove: the page, and the program, whose pages are files."""

_LOCAL = re.compile(r"https?://(localhost|127(\.\d{1,3}){3}|\[::1\])(:\d{1,5})?")
_HEAD_LIMIT, _HEAD_S = 1 << 14, 10.0
_CONNECTIONS = 64
_PIECE = 1 << 16
_LAST_S = 1.0


def loopback_address() -> str:
    """Return a random address of the loopback network 127.0.0.0/8."""
    return ".".join(["127", *(str(1 + secrets.randbelow(253)) for _ in range(3))])


def is_allowed(head: bytes, more: frozenset[str] = frozenset()) -> bool:
    """Return whether the head of a request names no origin, or one that may read the stream.

    Allowed are Foxglove's, pages that this computer serves to itself, and `more`.
    """
    lines = head.decode("latin-1").split("\r\n")[1:]
    found = [
        line.partition(":")[2].strip().lower() for line in lines if line.partition(":")[0].strip().lower() == "origin"
    ]
    is_folded = any(line[:1] in (" ", "\t") for line in lines)
    return not is_folded and all(one in FOXGLOVE or one in more or _LOCAL.fullmatch(one) for one in found)


class AddressError(Exception):
    """The stream cannot be served at an address; the message says why and what to do."""


def url(host: str, port: int) -> str:
    """Return the address that viewers connect to."""
    return f"ws://{f'[{host}]' if ':' in host else host}:{port}"


def listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens there.

    Raises AddressError if the address is none of this computer, or the port is taken.
    """
    try:
        return socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except (OSError, OverflowError) as error:
        raise AddressError(_refusal(host, port, error)) from error


def _refusal(host: str, port: int, error: Exception) -> str:
    code = getattr(error, "errno", None)
    if code == errno.EADDRINUSE:
        taken = f"port {port}, where Foxglove is to be served, is in use at {host}, maybe by another acquisition"
        return f"{taken}. Name another, such as {port % 65535 + 1}."
    if code == errno.EADDRNOTAVAIL or isinstance(error, socket.gaierror):
        return f'"{host}" is no address of this computer: Foxglove cannot be served there. Name one that is.'
    return f"Foxglove cannot be served at {host}, port {port}: {error}. Name another address or port."


class OriginGate:
    """Pass viewers that are allowed on to `behind`.

    `listener`: where viewers connect, of `listen`.
    `more`: further origins that are allowed, such as `https://viewer.example.org`.
    """

    def __init__(self, listener: socket.socket, behind: tuple[str, int], more: frozenset[str]) -> None:
        self._listener, self._behind, self._more = listener, behind, more
        self._free = threading.Semaphore(_CONNECTIONS)
        self._threads: list[threading.Thread] = []
        self._refused = 0
        _started(self._accept)

    def _accept(self) -> None:
        while True:
            try:
                viewer, _ = self._listener.accept()
            except OSError:  # closed
                return
            if not self._free.acquire(blocking=False):
                viewer.close()
                continue
            self._threads = [thread for thread in self._threads if thread.is_alive()]
            self._threads.append(_started(lambda viewer=viewer: self._serve(viewer)))  # type: ignore[misc]

    def _serve(self, viewer: socket.socket) -> None:
        try:
            with viewer, contextlib.suppress(OSError):
                head = _head(viewer)
                if head is None:
                    return
                if not is_allowed(head.partition(b"\r\n\r\n")[0], self._more):
                    self._refuse(viewer, head)
                    return
                with socket.create_connection(self._behind, _HEAD_S) as server:
                    server.sendall(head)
                    _join(viewer, server)
        finally:
            self._free.release()

    def _refuse(self, viewer: socket.socket, head: bytes) -> None:
        body = b"This origin may not read the stream. imutui: foxglove.origins names origins that may.\n"
        answer = b"HTTP/1.1 403 Forbidden\r\nConnection: close\r\nContent-Length: %d\r\n\r\n%s"
        viewer.sendall(answer % (len(body), body))
        self._refused += 1
        if self._refused == 1:
            found = re.search(rb"(?im)^origin:\s*([^\r\n]*)", head)
            origin = in_line(found[1].decode("latin-1")[:200]) if found else ""
            print(f'stream for Foxglove: a page of "{origin}" was refused; foxglove.origins allows it', file=sys.stderr)

    def close(self) -> None:
        """Take no more viewers, and wait a moment until each has what was sent to it."""
        # a thread that waits in accept wakes up at this, not at close
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        deadline = time.monotonic() + _LAST_S
        for thread in self._threads:
            thread.join(max(0.0, deadline - time.monotonic()))


def _started(run: Callable[[], None]) -> threading.Thread:
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread


def _head(viewer: socket.socket) -> bytes | None:
    """Return what a viewer sends up to the end of its request's head, or None if that does not come."""
    deadline, head = time.monotonic() + _HEAD_S, b""
    while b"\r\n\r\n" not in head:
        left_s = deadline - time.monotonic()
        if left_s <= 0.0 or len(head) > _HEAD_LIMIT:
            return None
        viewer.settimeout(left_s)
        piece = viewer.recv(_PIECE)
        if not piece:
            return None
        head += piece
    return head


def _join(viewer: socket.socket, server: socket.socket) -> None:
    """Pass bytes on in both directions until both have ended."""
    for end in (viewer, server):
        end.settimeout(None)
        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    back = _started(lambda: _pass_on(viewer, server))
    _pass_on(server, viewer)
    # the library has ended: a viewer that stays has nothing to wait for
    with contextlib.suppress(OSError):
        viewer.shutdown(socket.SHUT_RDWR)
    back.join()


def _pass_on(source: socket.socket, sink: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while piece := source.recv(_PIECE):
            sink.sendall(piece)
    for end, how in ((sink, socket.SHUT_WR), (source, socket.SHUT_RD)):
        with contextlib.suppress(OSError):
            end.shutdown(how)
