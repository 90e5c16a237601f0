"""The processes of acquisitions: started alone, or forked from a process that has loaded what they need.

The compiler, the compiled filter and the modules take far more memory than an acquisition's own data, and nothing
writes to them. Acquisitions that are forked from a process that has loaded them therefore share these pages.

    with processes.Parent() as parent:
        one = client.start(plan, parent=parent)  # from any thread

Each acquisition is a process and a session of its own, started alone or forked: it outlives the process that started
it and its parent, and its failure does not reach another acquisition.
"""

import contextlib
import os
import select
import signal
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path
from types import TracebackType
from typing import IO, Any, BinaryIO, Self

from imutui.logbook import file_lock
from imutui.session.plan import Plan

PLAN_LIMIT = 1 << 22  # bytes of a plan; a trajectory may be in it
LOADING = b"."
"""Sent by a parent once a second while it loads or compiles; it sends the number of a process afterwards."""
_SILENT_S = 45.0  # a parent that sends nothing for so long hangs: compiling one function may take half of it
_END_S = 5.0
_GRACE_S = 10.0


class Process:
    """A process of an acquisition, of which only the number need be known."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._descriptor: int | None = None  # None of a process that had ended before
        with contextlib.suppress(ProcessLookupError):
            self._descriptor = os.pidfd_open(pid)

    def __del__(self) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)

    def send(self, number: signal.Signals) -> None:
        """Send a signal, unless the process has ended."""
        if self._descriptor is not None:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._descriptor, number)

    def has_ended(self, within_s: float | None = 0.0) -> bool:
        """Return True if the process has ended or ends within that time; None waits for its end."""
        return self._descriptor is None or bool(select.select([self._descriptor], [], [], within_s)[0])


class Parent:
    """A process that acquisitions are forked from; to be used with `with`.

    It loads, and on the first use on a machine compiles, before it forks the first acquisition. `filters`: whether an
    acquisition will filter; `effects`: whether one will filter with effects, which has a compiled step of its own.
    """

    def __init__(self, *, filters: bool = True, effects: bool = False) -> None:
        self._lock = threading.Lock()
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, PLAN_LIMIT)
        self._socket.settimeout(_SILENT_S)
        arguments = (str(theirs.fileno()), str(filters + effects))
        self._process, _ = _spawn(*arguments, stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()])
        theirs.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()
        # after Ctrl+C the process is not waited for: it may be compiling, or hang
        if not self._process.has_ended(0.0 if kind is not None else _END_S):
            self._process.send(signal.SIGKILL)  # the acquisitions that it forked are processes of their own

    def fork(self, plan: str, output: int, log: int) -> Process:
        """Fork an acquisition with its plan and the descriptors of its stdout and stderr; from any thread.

        Raises OSError if the parent has gone or does not answer in time; it is killed then.
        """
        with self._lock:
            try:
                socket.send_fds(self._socket, [plan.encode()], [output, log])
                while (answer := self._socket.recv(64)) == LOADING:
                    pass
            except TimeoutError:
                self._process.send(signal.SIGKILL)
                answer = b""
        if not answer:
            raise ConnectionResetError("the process that acquisitions are forked from has gone, or did not answer")
        return Process(int(answer))


def begin(plan: Plan, log: Path, parent: Parent | None) -> tuple[Process, BinaryIO]:
    """Begin the process of an acquisition; returns it and its stdout. Its stderr goes to the file `log`.

    Raises OSError as `Parent.fork` does.
    """
    ours, theirs = os.pipe()
    output = os.fdopen(ours, "rb")
    try:
        with os.fdopen(theirs, "wb") as its_output, log.open("ab") as its_log:
            if parent is not None:
                return parent.fork(plan.dumps(), its_output.fileno(), its_log.fileno()), output
            process, given = _spawn(stdin=subprocess.PIPE, stdout=its_output, stderr=its_log)
        assert given is not None
        with given:
            given.write(plan.dumps().encode() + b"\n")
    except BaseException:
        output.close()
        raise
    return process, output


def _spawn(*arguments: str, **streams: Any) -> tuple[Process, IO[bytes] | None]:
    """Start `python -m imutui.session` in a session of its own; return it and its stdin, if that is a pipe."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "OPENBLAS_NUM_THREADS": "1"}
    line = [sys.executable, "-P", "-m", "imutui.session", *arguments]
    child = subprocess.Popen(line, start_new_session=True, env=environment, **streams)
    process = Process(child.pid)
    # the process may outlive this one; a thread takes its exit status so that no zombie stays
    threading.Thread(target=child.wait, daemon=True).start()
    return process, child.stdin


def missing_folders(plan: Plan) -> list[Path]:
    """Return the folders that a recording would make, its own first."""
    return [one for one in (plan.folder, *plan.folder.parents) if not one.exists()]


def end_unbegun(process: Process, missing: list[Path]) -> None:
    """End a process that did not report its start: ask it to leave unit and file in order, else kill it.

    `missing` are folders that were not there before it; they are removed if they are empty.
    """
    process.send(signal.SIGTERM)
    if not process.has_ended(_GRACE_S):
        logs = open_logs(process.pid)
        process.send(signal.SIGKILL)
        process.has_ended(None)
        for log in logs:
            if not _has_messages(log):
                log.unlink(missing_ok=True)
    for folder in missing:
        with contextlib.suppress(OSError):  # it was not made, or something is in it
            folder.rmdir()


def open_logs(pid: int) -> list[Path]:
    """Return the logs that a process writes."""
    found = []
    for descriptor in Path(f"/proc/{pid}/fd").glob("*"):
        with contextlib.suppress(OSError):
            if descriptor.lstat().st_mode & stat.S_IWUSR and descriptor.is_file():
                with descriptor.open("rb") as file:
                    found += [descriptor.readlink()] if file_lock.is_held(file) else []
    return [path for path in found if path.is_file()]


def _has_messages(path: Path) -> bool:
    """Return True if anything was recorded, or if the file cannot be read."""
    from imutui.logbook import scan
    from imutui.logbook.reader import UnreadableLogError

    try:
        return scan.scan(path).chunks > 0
    except UnreadableLogError:
        return path.stat().st_size > 0
