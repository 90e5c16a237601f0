"""The socket between an acquisition and its viewers: JSON lines, one reply a request.

It lies in XDG_RUNTIME_DIR, else in a folder under the cache that nobody else may enter. A shell on the machine and one
over SSH need not agree on XDG_RUNTIME_DIR, so the cache keeps a link to each folder in use: viewers look in all.
"""

import contextlib
import fcntl
import hashlib
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
_LINK = ".elsewhere"


class Taken(Exception):  # noqa: N818 - a state of affairs, not a fault
    """An acquisition of that name is running."""


def folder() -> Path:
    """Folder of the sockets of acquisitions started from here, made if absent, closed to others."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return _own(Path(runtime) / "imutui" if runtime and Path(runtime).is_dir() else _shared())


def folders() -> list[Path]:
    """Where this user's acquisitions may lie, whatever environment they were started in; that of `folder` first."""
    links = sorted(_shared().glob(f"*{_LINK}"))
    found = [folder(), _shared(), *(link.resolve() for link in links)]
    return [path for path in dict.fromkeys(found) if path.is_dir() and path.stat().st_uid == os.getuid()]


def _shared() -> Path:
    """The folder that any environment of this user on this machine leads to."""
    return Path(platformdirs.user_cache_dir("imutui")) / "run"


def _own(path: Path) -> Path:
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = path.stat()
    if status.st_uid != os.getuid():
        raise PermissionError(f"{path} belongs to another user: set XDG_RUNTIME_DIR to a folder of your own")
    path.chmod(0o700)
    return path


def _leave_a_link() -> None:
    """Let other environments find this one's folder. One without a writable cache is found from its own only."""
    here = folder()
    if here == _shared():
        return
    link = _shared() / f"{hashlib.sha256(os.fsencode(here)).hexdigest()[:16]}{_LINK}"
    with contextlib.suppress(OSError):
        _own(_shared())
        for other in _shared().glob(f"*{_LINK}"):
            if not other.exists():
                other.unlink()
        link.symlink_to(here)


def _folder_of(name: str) -> Path:
    """Where the acquisition of that name lies; where one would be made if there is none."""
    return next((path for path in folders() if is_locked(path / f"{name}.lock")), folder())


def socket_path(name: str) -> Path:
    """Socket of the acquisition of that name."""
    return _folder_of(name) / f"{name}.sock"


def log_path(name: str) -> Path:
    """What the process of that name wrote to its stderr."""
    return _folder_of(name) / f"{name}.log"


def names() -> list[str]:
    """Acquisitions whose process is alive."""
    return sorted({path.stem for place in folders() for path in place.glob("*.lock") if is_locked(path)})


def lock(name: str) -> int:
    """Take the name for the life of this process; the kernel gives it back however the process ends.

    Raises
    ------
    Taken
        If another process has it.
    """
    if name in names():
        raise Taken(name)
    descriptor = os.open(folder() / f"{name}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        raise Taken(name) from error
    _leave_a_link()
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
