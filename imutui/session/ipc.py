"""The socket between an acquisition and its viewers: JSON lines, one reply a request.

Sockets are in the user's runtime folder, `XDG_RUNTIME_DIR` or /run/user/UID, or without either in the user's cache.
Only this user can enter the folder. Acquisitions in the cache are found from shells with a runtime folder too.
"""

import contextlib
import fcntl
import json
import math
import os
import select
import socket
import socketserver
import struct
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeAlias, TypedDict
from urllib.parse import quote

import platformdirs

from filters.errors import InputError
from imutui import defects
from imutui.document_shape import VERSION
from imutui.outside_file import can_be_written
from imutui.plain_text import NOTE_LIMIT, one_line

_LOOKERS_S = 1.0
_MAX_ADDRESS = 100
MAX_REQUEST = 1 << 20  # bytes of the longest request; a table profile or an effects file may be in it
MAX_VIEWERS = 64
_QUEUE_FULL_S = 0.01


class NameTakenError(Exception):
    """A name or a serial number is taken; the text is the name of the acquisition that has it."""


def folder() -> Path:
    """Return the folder of acquisitions that are started from here; it is made if absent, and closed to others.

    Raises PermissionError if it belongs to another user.
    """
    path = next(filter(can_be_written, _places()), Path(tempfile.gettempdir()) / f"imutui-{os.getuid()}")
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    if path.lstat().st_uid != os.getuid():
        raise PermissionError(f"{path} belongs to another user: set XDG_RUNTIME_DIR to a folder of your own")
    path.chmod(0o700)
    return path


def folders() -> list[Path]:
    """Return the folders of this user's acquisitions that exist; `folder()` is the first."""
    found = dict.fromkeys((folder(), *_places()))
    return [path for path in found if path.is_dir() and path.stat().st_uid == os.getuid()]


def _places() -> list[Path]:
    runtime = Path(os.environ.get("XDG_RUNTIME_DIR") or f"/run/user/{os.getuid()}")
    cache = Path(platformdirs.user_cache_dir("imutui")) / "run"
    return [*([runtime / "imutui"] if runtime.is_dir() else []), *([cache] if cache.is_absolute() else [])]


def _folder_of(name: str) -> Path:
    """Return the folder of the acquisition of that name; of a new one if none runs."""
    return next((path for path in folders() if is_locked(path / f"{name}.lock")), folder())


def socket_path(name: str) -> Path:
    """Return the socket of the acquisition of that name."""
    return _folder_of(name) / f"{name}.sock"


def log_path(name: str) -> Path:
    """Return the file with the stderr of the process of that name."""
    return _folder_of(name) / f"{name}.log"


def names() -> list[str]:
    """Return the names of acquisitions whose process is alive."""
    return sorted({path.stem for place in folders() for path in place.glob("*.lock") if is_locked(path)})


def lock(name: str) -> int:
    """Take the name for the life of this process; returns a descriptor that holds it.

    Raises NameTakenError if another process has it.
    """
    if name in names():
        raise NameTakenError(name)
    return _hold(folder() / f"{name}.lock", name)


def lock_serial(batch: str, serial_number: str, name: str) -> int:
    """Take a serial number within a batch as `lock` takes a name; NameTakenError has the name of its holder."""
    return _hold(folder() / f"{batch}.{quote(serial_number, safe='')}.serial", name)


def _hold(path: Path, name: str) -> int:
    """Lock a file and write the holder's name into it; the kernel gives it back however the process ends."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    deadline = time.monotonic() + _LOOKERS_S
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            # a process that looks whether the file is locked holds it for a moment
            if is_locked(path) or time.monotonic() > deadline:
                os.close(descriptor)
                raise NameTakenError(path.read_text() or "another unit") from error
            time.sleep(0.001)
        else:
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, name.encode(), 0)
            return descriptor


def is_locked(path: Path) -> bool:
    """Return True if a living process has taken that name."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        # a shared lock: several processes may look at once
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False


@contextlib.contextmanager
def _address(path: Path) -> Iterator[str]:
    """Yield a path that fits a socket address: the path itself, or one through an open descriptor of its folder."""
    if len(os.fsencode(path)) < _MAX_ADDRESS:
        yield str(path)
        return
    descriptor = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{descriptor}/{path.name}"
    finally:
        os.close(descriptor)


def connect(name: str, timeout: float) -> socket.socket:
    """Return a socket that is connected to an acquisition; raises OSError if it is not there."""
    connection, deadline = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM), time.monotonic() + timeout
    connection.settimeout(timeout)
    try:
        with _address(socket_path(name)) as address:
            while True:
                try:
                    connection.connect(address)
                except BlockingIOError:
                    # the server's queue is full for the moment; the kernel does not wait
                    if time.monotonic() > deadline:
                        raise
                    time.sleep(_QUEUE_FULL_S)
                else:
                    return connection
    except OSError:
        connection.close()
        raise


Answer: TypeAlias = Callable[[Mapping[str, object]], object]
"""Carries out a request, a JSON object with the field `ask`, and returns the field `reply` of its reply."""


class Reply(TypedDict, total=False):
    """Reply to a viewer: `reply` if its request was carried out, else `error` in words."""

    ok: bool
    reply: object
    error: str


class Server(socketserver.ThreadingMixIn, socketserver.UnixStreamServer):
    """Answers each request with the reply that `answer` returns; an InputError becomes the reply's error.

    Only this user and root are served, at most `MAX_VIEWERS` connections at a time. A line that is no request gets an
    error as its reply. `answer` is called in a thread for each connection. This process holds the lock of the
    acquisition's name.
    """

    daemon_threads = True
    block_on_close = False
    # connections that arrive at once wait to be accepted
    request_queue_size = 128

    def __init__(self, name: str, answer: Answer) -> None:
        self.answer = answer
        self.viewers: dict[socket.socket, bool] = {}  # True of one that waits for a reply
        self._unwatched_since = time.monotonic()
        self.idle = threading.Condition()
        path = socket_path(name)
        path.unlink(missing_ok=True)
        with _address(path) as address:
            super().__init__(address, _Handler)
        path.chmod(0o600)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Let an exception end its thread, and so the acquisition: see `threading.excepthook` in `__main__`."""
        raise  # the exception that the caller handles

    def wait_idle(self, timeout: float) -> None:
        """Wait until no request is being answered."""
        with self.idle:
            self.idle.wait_for(lambda: not any(self.viewers.values()), timeout)

    @property
    def unwatched_s(self) -> float:
        """Seconds since the last viewer left; 0 while one is connected."""
        with self.idle:
            # a viewer that was killed while it waited for a reply leaves only when the reply is sent
            if not all(map(_has_hung_up, self.viewers)):
                self._unwatched_since = time.monotonic()
            return time.monotonic() - self._unwatched_since

    def waits(self, connection: socket.socket, *, waits: bool) -> None:
        """Note whether a viewer waits for a reply."""
        with self.idle:
            self.viewers[connection] = waits
            self.idle.notify_all()

    def left(self, connection: socket.socket) -> None:
        """Note that a viewer has left."""
        with self.idle:
            self.viewers.pop(connection, None)
            self._unwatched_since = time.monotonic()
            self.idle.notify_all()

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Return True if the connection is of this user or root, and within `MAX_VIEWERS`; refuse it otherwise."""
        del client_address
        if peer_of(request)[0] not in (0, os.getuid()):
            _refuse(request, "this acquisition belongs to another user")
            return False
        with self.idle:
            if len(self.viewers) < MAX_VIEWERS:
                self.viewers[request] = False
                return True
        _refuse(request, f"{MAX_VIEWERS} viewers are connected already, which is the most; close one")
        return False


class _Handler(socketserver.StreamRequestHandler):
    server: Server

    def handle(self) -> None:
        try:
            while line := self.rfile.readline(MAX_REQUEST + 1):
                self.server.waits(self.request, waits=True)
                self.wfile.write(_line(reply_to(line, self._answer)))
                self.server.waits(self.request, waits=False)
                if len(line) > MAX_REQUEST:
                    return  # the start of the next request is unknown
        except OSError:
            return  # the viewer has left

    def _answer(self, request: Mapping[str, object]) -> object:
        return self.server.answer({**request, "peer": peer_of(self.request)})

    def finish(self) -> None:
        self.server.left(self.request)
        with contextlib.suppress(OSError):
            super().finish()


def reply_to(line: bytes, answer: Answer) -> Reply:
    """Return the reply to a line from a viewer."""
    try:
        return {"ok": True, "reply": answer(_request(line))}
    except (InputError, OSError) as error:
        # some errors of the system have no text
        return {"ok": False, "error": one_line(str(error) or f"it failed: {type(error).__name__}", NOTE_LIMIT)}
    except Exception as error:  # noqa: BLE001 - the viewer waits for a reply, and the other viewers go on
        return {"ok": False, "error": one_line(defects.told(error), NOTE_LIMIT)}


def _request(line: bytes) -> dict[str, object]:
    """Return the request that a line holds; raise InputError if it holds none."""
    if len(line) > MAX_REQUEST:
        raise InputError(f"the request is longer than {MAX_REQUEST} bytes")
    try:
        request = json.loads(line, parse_float=_finite, parse_constant=_finite)
    except RecursionError as error:
        raise InputError("the request is nested too deeply") from error
    except UnicodeDecodeError as error:
        raise InputError("the request is no text in UTF-8") from error
    except ValueError as error:
        raise InputError(str(error)) from error
    if not isinstance(request, dict) or "ask" not in request:
        raise InputError('a request is a JSON object with the field "ask"')
    return request


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise InputError(f"{text[:20]} is no number that a request may have")
    return number


def _line(reply: Reply) -> bytes:
    return json.dumps({"version": VERSION, **reply}).encode() + b"\n"


def _refuse(connection: socket.socket, error: str) -> None:
    with contextlib.suppress(OSError):
        # a peer that does not read must not block the server
        connection.send(_line({"ok": False, "error": error}), socket.MSG_DONTWAIT)


def peer_of(connection: socket.socket) -> tuple[int, int]:
    """Return user id and process id at the other end of a Unix socket, as the kernel knows them."""
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    pid, uid, _ = struct.unpack("3i", credentials)
    return uid, pid


def _has_hung_up(connection: socket.socket) -> bool:
    if connection.fileno() < 0:
        return True
    poll = select.poll()
    poll.register(connection, select.POLLRDHUP)
    return bool(poll.poll(0))
