"""The socket between an acquisition and its viewers: JSON lines, one reply a request.

It lies in XDG_RUNTIME_DIR, else in a folder under the cache that nobody else may enter. A shell on the machine and one
over SSH need not agree on XDG_RUNTIME_DIR, so the cache keeps a link to each folder in use: viewers find all of them by
name, but take up by themselves only those of their own folder.
"""

import contextlib
import fcntl
import hashlib
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
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast
from urllib.parse import quote

import platformdirs

from filters.errors import InputError
from imutui import defects
from imutui.document_shape import VERSION
from imutui.outside_file import can_be_written
from imutui.plain_text import NOTE_LIMIT, one_line
from imutui.session.requests import Refusal, Reply, Request
from imutui.session.snapshot import NO_SERIES

_LOOKERS_S = 1.0
_MAX_ADDRESS = 100
MAX_REQUEST = 1 << 20  # bytes of the longest request; a table profile or an effects file may be in it

MAX_VIEWERS = 64
RESERVED = 8  # places beyond those of viewers, for requests that are soon over
_SOON_OVER = ("stop", "stop_recording", "mark", "describe")
_FULL = f"{MAX_VIEWERS} viewers are connected already, which is the most; close one"
_QUEUE_FULL_S = 0.01
_LINK_SUFFIX = ".elsewhere"
_SERIAL_SUFFIX, _LONGEST_UNIT = ".serial", 1000


class NameTakenError(Exception):
    """An acquisition of that name is running."""


def folder() -> Path:
    """Folder of the sockets of acquisitions started from here, made if absent, closed to others."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    path = Path(runtime) / "imutui" if runtime and Path(runtime).is_dir() else _cache_folder()
    return _make_private(path if can_be_written(path) else _cache_folder())


def folders() -> list[Path]:
    """Where this user's acquisitions may lie, whatever environment they were started in; that of `folder` first."""
    links = sorted(_cache_folder().glob(f"*{_LINK_SUFFIX}"))
    found = [folder(), _cache_folder(), *(link.resolve() for link in links)]
    return [path for path in dict.fromkeys(found) if path.is_dir() and path.stat().st_uid == os.getuid()]


def _cache_folder() -> Path:
    """Return the folder that any environment of this user leads to: in the temporary folder without a home."""
    path = Path(platformdirs.user_cache_dir("imutui")) / "run"
    if path.is_absolute() and can_be_written(path):
        return path
    return Path(tempfile.gettempdir()) / f"imutui-{os.getuid()}"


def _make_private(path: Path) -> Path:
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    if path.lstat().st_uid != os.getuid():
        raise PermissionError(f"{path} belongs to another user: set XDG_RUNTIME_DIR to a folder of your own")
    path.chmod(0o700)
    return path


def _link_from_cache() -> None:
    """Let other environments find this one's folder. One without a writable cache is found from its own only."""
    here = folder()
    if here == _cache_folder():
        return
    link = _cache_folder() / f"{hashlib.sha256(os.fsencode(here)).hexdigest()[:16]}{_LINK_SUFFIX}"
    with contextlib.suppress(OSError):
        _make_private(_cache_folder())
        for other in _cache_folder().glob(f"*{_LINK_SUFFIX}"):
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


def names(*, own: bool = False) -> list[str]:
    """Acquisitions whose process is alive; `own`: only those in the folder of this environment."""
    places = [folder()] if own else folders()
    return sorted({path.stem for place in places for path in place.glob("*.lock") if is_locked(path)})


def lock(name: str) -> int:
    """Take the name for the life of this process; the kernel gives it back however the process ends.

    Raises NameTakenError if another process has it.
    """
    if name in names():
        raise NameTakenError(name)
    path = folder() / f"{name}.lock"
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    deadline = time.monotonic() + _LOOKERS_S
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            # whoever only looks whether it is taken has it for a moment
            if is_locked(path) or time.monotonic() > deadline:
                os.close(descriptor)
                raise NameTakenError(name) from error
            time.sleep(0.001)
        else:
            _link_from_cache()
            return descriptor


@contextlib.contextmanager
def claimed_serial(batch: str, serial_number: str, unit: str) -> Iterator[str | None]:
    """Hold a serial number within a batch; the kernel gives it back however the process ends.

    Yields None, or the name of the unit that holds the number already.
    """
    path = folder() / f"{batch}.{quote(serial_number, safe='')}{_SERIAL_SUFFIX}"
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            yield _holder(descriptor)
        else:
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, unit.encode(), 0)
            yield None
            os.ftruncate(descriptor, 0)
    finally:
        os.close(descriptor)


def _holder(descriptor: int) -> str:
    """Name of the unit that holds a serial number; a holder writes it just after it took the lock."""
    deadline = time.monotonic() + _LOOKERS_S
    while not (holder := os.pread(descriptor, _LONGEST_UNIT, 0)) and time.monotonic() < deadline:
        time.sleep(0.001)
    return holder.decode() or "another unit"


def is_locked(path: Path) -> bool:
    """Whether a living process has taken that name."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        # shared: several may look at once and see nobody but the owner
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False


@contextlib.contextmanager
def _address(path: Path) -> Iterator[str]:
    """A path short enough for a socket address, whatever the folder: reached through an open descriptor if need be."""
    if len(os.fsencode(path)) < _MAX_ADDRESS:
        yield str(path)
        return
    descriptor = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{descriptor}/{path.name}"
    finally:
        os.close(descriptor)


def connect(name: str, timeout: float) -> socket.socket:
    """Connected socket of that acquisition; OSError if it is not there."""
    connection, deadline = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM), time.monotonic() + timeout
    connection.settimeout(timeout)
    try:
        with _address(socket_path(name)) as address:
            while True:
                try:
                    connection.connect(address)
                except BlockingIOError:
                    # a queue that is full for the moment is waited for, which the kernel does not do
                    if time.monotonic() > deadline:
                        raise
                    time.sleep(_QUEUE_FULL_S)
                else:
                    return connection
    except OSError:
        connection.close()
        raise


class Server(socketserver.ThreadingMixIn, socketserver.UnixStreamServer):
    """Answers requests with what `answer` returns; an InputError it raises becomes the reply's error.

    Every request gets a reply, whatever it is: one that is no request is refused in words. Only this user and root are
    heard, at most `MAX_VIEWERS` at a time; beyond them are `RESERVED` places for requests that are soon over, where
    whoever has asked for nothing for the longest makes room for the next one. `answer` is called in a thread for each
    viewer; this process holds the lock of the acquisition's name.
    """

    daemon_threads = True
    block_on_close = False
    # viewers that come all at once wait here to be accepted
    request_queue_size = 128

    def __init__(self, name: str, answer: Callable[[Request], Reply]) -> None:
        self.answer = answer
        self.busy = set[socket.socket]()
        self.viewers = set[socket.socket]()
        self._reserved: dict[socket.socket, None] = {}  # who asked last stands last
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
            self.idle.wait_for(lambda: not self.busy, timeout)

    @property
    def unwatched_s(self) -> float:
        """For how long nobody has been connected."""
        with self.idle:
            # one that was killed while it waited for an answer is heard to have gone when there is one
            if not all(map(_has_hung_up, (*self.viewers, *self._reserved))):
                self._unwatched_since = time.monotonic()
            return time.monotonic() - self._unwatched_since

    @contextlib.contextmanager
    def answering(self, connection: socket.socket) -> Iterator[Callable[[Request], Reply]]:
        """While a request is being answered: what answers it."""
        with self.idle:
            self.busy.add(connection)
            reserved = connection in self._reserved
            if reserved:
                del self._reserved[connection]
                self._reserved[connection] = None
        try:
            answer, peer = self._answer_briefly if reserved else self.answer, peer_of(connection)
            yield lambda request: answer({**request, "peer": peer})
        finally:
            with self.idle:
                self.busy.discard(connection)
                self.idle.notify_all()

    def _answer_briefly(self, request: Request) -> Reply:
        looks = request["ask"] == "snapshot" and request.get("since") == NO_SERIES
        if not looks and request["ask"] not in _SOON_OVER:
            raise InputError(_FULL)
        return self.answer(request)

    def left(self, connection: socket.socket) -> None:
        """Take note that a viewer has gone."""
        with self.idle:
            self.viewers.discard(connection)
            self._reserved.pop(connection, None)
            self._unwatched_since = time.monotonic()

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Whether whoever connects is heard: this user or root, and not one too many."""
        del client_address
        if peer_of(request)[0] not in (0, os.getuid()):
            _refuse(request, "this acquisition belongs to another user")
            return False
        with self.idle:
            if len(self.viewers) < MAX_VIEWERS:
                self.viewers.add(request)
                return True
            if len(self._reserved) < RESERVED or self._make_room():
                self._reserved[request] = None
                return True
        _refuse(request, _FULL)
        return False

    def _make_room(self) -> bool:
        """Let go of whoever has been idle in a reserved place for the longest; whether there was one."""
        idle = next((one for one in self._reserved if one not in self.busy), None)
        if idle is None:
            return False
        del self._reserved[idle]
        _refuse(idle, _FULL)
        with contextlib.suppress(OSError):
            idle.shutdown(socket.SHUT_RDWR)  # its thread then ends
        return True


class _Handler(socketserver.StreamRequestHandler):
    server: Server

    def handle(self) -> None:
        try:
            while line := self.rfile.readline(MAX_REQUEST + 1):
                with self.server.answering(self.request) as answer:
                    self.wfile.write(_line(reply_to(line, answer)))
                if len(line) > MAX_REQUEST:
                    return  # where the next request begins is not known
        except OSError:
            return  # the viewer left, as viewers may

    def finish(self) -> None:
        self.server.left(self.request)
        with contextlib.suppress(OSError):
            super().finish()


def reply_to(line: bytes, answer: Callable[[Request], Reply]) -> Reply | Refusal:
    """Reply to whatever came as a line, which should be a request."""
    try:
        reply = answer(_request(line))
    except (InputError, OSError) as error:
        # some errors of the system have no text
        return {"ok": False, "error": one_line(str(error) or f"it failed: {type(error).__name__}", NOTE_LIMIT)}
    except Exception as error:  # noqa: BLE001 - a viewer that waits must hear something, and the others go on
        return {"ok": False, "error": one_line(defects.told(error), NOTE_LIMIT)}
    reply["ok"] = True
    return reply


def _request(line: bytes) -> Request:
    """Request of a line; raises InputError if it is none."""
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
    whole: Any = request
    return cast("Request", whole)


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise InputError(f"{text[:20]} is no number that a request may have")
    return number


def _line(reply: Reply | Refusal) -> bytes:
    return json.dumps({"version": VERSION, **reply}).encode() + b"\n"


def _refuse(connection: socket.socket, error: str) -> None:
    with contextlib.suppress(OSError):
        # whoever reads nothing holds nobody up
        connection.send(_line({"ok": False, "error": error}), socket.MSG_DONTWAIT)


def peer_of(connection: socket.socket) -> tuple[int, int]:
    """User id and process id at the other end of a Unix socket, as the kernel knows them."""
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    pid, uid, _ = struct.unpack("3i", credentials)
    return uid, pid


def _has_hung_up(connection: socket.socket) -> bool:
    if connection.fileno() < 0:
        return True
    poll = select.poll()
    poll.register(connection, select.POLLRDHUP)
    return bool(poll.poll(0))
