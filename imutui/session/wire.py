"""The socket between an acquisition and its viewers: JSON lines, one reply a request.

It lies in XDG_RUNTIME_DIR, else in a folder under the user's cache that nobody else may enter.
"""

import fcntl
import json
import os
import socket
import socketserver
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import platformdirs

_LONGEST = 100
_LARGEST = 1 << 20


class Taken(Exception):  # noqa: N818 - a state of affairs, not a fault
    """An acquisition of that name is running."""


def folder() -> Path:
    """Folder of the sockets, made if absent, closed to others."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    base = Path(runtime) if runtime and Path(runtime).is_dir() else Path(platformdirs.user_cache_dir("imutui"))
    path = base / "imutui" if runtime and base == Path(runtime) else base / "run"
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = path.stat()
    if status.st_uid != os.getuid():
        raise PermissionError(f"{path} belongs to another user: set XDG_RUNTIME_DIR to a folder of your own")
    path.chmod(0o700)
    return path


def socket_path(name: str) -> Path:
    """Socket of the acquisition of that name."""
    return folder() / f"{name}.sock"


def log_path(name: str) -> Path:
    """What the process of that name wrote to its stderr."""
    return folder() / f"{name}.log"


def names() -> list[str]:
    """Acquisitions whose process is alive."""
    return sorted(path.stem for path in folder().glob("*.lock") if is_locked(path))


def lock(name: str) -> int:
    """Take the name for the life of this process; the kernel gives it back however the process ends.

    Raises
    ------
    Taken
        If another process has it.
    """
    descriptor = os.open(folder() / f"{name}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        raise Taken(name) from error
    return descriptor


def is_locked(path: Path) -> bool:
    """Whether a living process has taken that name."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False


class _Short:
    """A path short enough for a socket address, whatever the folder: reached through an open descriptor if need be."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._descriptor: int | None = None

    def __enter__(self) -> str:
        if len(os.fsencode(self._path)) < _LONGEST:
            return str(self._path)
        self._descriptor = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY)
        return f"/proc/self/fd/{self._descriptor}/{self._path.name}"

    def __exit__(self, *_: object) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)


def connect(name: str, timeout: float) -> socket.socket:
    """Connected socket of that acquisition; OSError if it is not there."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.settimeout(timeout)
    try:
        with _Short(socket_path(name)) as address:
            connection.connect(address)
    except OSError:
        connection.close()
        raise
    return connection


class Server(socketserver.ThreadingMixIn, socketserver.UnixStreamServer):
    """Answers requests with what `answer` returns; a ValueError it raises becomes the reply's error.

    Parameters
    ----------
    name : str
        Of the acquisition, whose lock this process holds.
    answer : callable
        From request to reply, both JSON objects; called in a thread for each viewer.
    """

    daemon_threads = True
    block_on_close = False

    def __init__(self, name: str, answer: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        self.answer = answer
        self.busy = 0
        self.idle = threading.Condition()
        path = socket_path(name)
        path.unlink(missing_ok=True)
        with _Short(path) as address:
            super().__init__(address, _Handler)
        path.chmod(0o600)

    def wait_idle(self, timeout: float) -> None:
        """Wait until no request is being answered."""
        with self.idle:
            self.idle.wait_for(lambda: self.busy == 0, timeout)


class _Handler(socketserver.StreamRequestHandler):
    server: Server

    def handle(self) -> None:
        try:
            while line := self.rfile.readline(_LARGEST):
                with self.server.idle:
                    self.server.busy += 1
                try:
                    self.wfile.write(json.dumps(self._reply(line)).encode() + b"\n")
                finally:
                    with self.server.idle:
                        self.server.busy -= 1
                        self.server.idle.notify_all()
        except OSError:
            return  # the viewer left, as viewers may

    def _reply(self, line: bytes) -> dict[str, Any]:
        try:
            request = json.loads(line)
            return {"ok": True} | self.server.answer(request)
        except (ValueError, KeyError, TypeError) as error:
            return {"ok": False, "error": str(error)}
        except OSError as error:
            return {"ok": False, "error": str(error)}
