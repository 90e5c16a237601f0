"""Acquisitions that share the memory of what they have loaded: forked from a process that loaded it before them.

The compiler, the compiled filter and the modules take far more memory than an acquisition's own data. They are the same
in each, and stay as they are; so the pages of a process that has loaded them are those of its children as well, until
one of them writes to a page. What goes wrong with one does not reach the others: each child is a process and a session
of its own, as if it had been started alone.

    with preloaded.Parent() as parent:
        one = client.start(plan, parent=parent)  # from several threads at once, if there are several

Acquisitions outlive the parent, whichever way that ends, and share their memory without it.
"""

import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from types import TracebackType
from typing import BinaryIO, Self

PLAN_LIMIT = 1 << 22  # bytes of a plan; a trajectory may be in it
LOADING = b"."
"""What the process sends once a second while it loads or compiles; a number of a process afterwards."""
_SILENT_S = 45.0  # one that sends nothing for so long hangs: compiling one function may take half of it
_END_S = 5.0


def environment() -> dict[str, str]:
    """Environment of an acquisition's process."""
    return {**os.environ, "PYTHONUNBUFFERED": "1", "OPENBLAS_NUM_THREADS": "1"}


class Parent:
    """A process that acquisitions are forked from; to be used with `with`.

    It loads, or the first time on a machine compiles, before it begins the first one. `effects`: whether filters with
    effects are among what is asked for, whose compiled step is one of its own; `filters`: whether any are.
    """

    def __init__(self, *, filters: bool = True, effects: bool = False) -> None:
        self._lock = threading.Lock()
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, PLAN_LIMIT)
        self._socket.settimeout(_SILENT_S)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "imutui.session", str(theirs.fileno()), str(filters + effects)],
            stdin=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            start_new_session=True,
            env=environment(),
        )
        theirs.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()
        try:
            # after Ctrl+C the process is not waited for: it may be compiling, or hang
            self._process.wait(0.0 if kind is not None else _END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()  # the acquisitions that it forked are processes of their own
            self._process.wait()

    def fork(self, plan: str, output: BinaryIO, log: BinaryIO) -> "Forked":
        """Begin a process as `python -m imutui.session` does, with its plan, stdout and stderr; from any thread.

        Raises OSError if the parent has gone, or does not answer in time: it is killed then.
        """
        with self._lock, output, log:
            try:
                socket.send_fds(self._socket, [plan.encode()], [output.fileno(), log.fileno()])
                while (told := self._socket.recv(64)) == LOADING:
                    pass
            except TimeoutError:
                self._process.kill()
                told = b""
        if not told:
            raise ConnectionResetError("the process that acquisitions are forked from has gone, or did not answer")
        return Forked(int(told))


class Forked:
    """A process that is no child of this one; what `subprocess.Popen` has that is needed of it."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._descriptor: int | None = None  # None of one that had ended before
        with contextlib.suppress(ProcessLookupError):
            self._descriptor = os.pidfd_open(pid)

    def __del__(self) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)

    def _send(self, number: signal.Signals) -> None:
        if self._descriptor is not None:
            with contextlib.suppress(ProcessLookupError):  # it has ended
                signal.pidfd_send_signal(self._descriptor, number)

    def terminate(self) -> None:
        """Ask it to end."""
        self._send(signal.SIGTERM)

    def kill(self) -> None:
        """End it."""
        self._send(signal.SIGKILL)

    @property
    def has_ended(self) -> bool:
        """Whether it has."""
        return self._descriptor is None or bool(select.select([self._descriptor], [], [], 0.0)[0])

    def wait(self, timeout: float | None = None) -> None:
        """Wait until it has ended; raises TimeoutExpired of `subprocess` if it has not by then."""
        if self._descriptor is not None and not select.select([self._descriptor], [], [], timeout)[0]:
            raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
