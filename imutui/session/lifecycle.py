"""The state of an acquisition, from connecting to its end. Every thread of its process reads and writes it."""

import threading
import time
from typing import TYPE_CHECKING

from imutui import defects

if TYPE_CHECKING:
    from imutui.session.requests import EndFinding
    from imutui.session.snapshot import SessionState


# Exit codes of the acquisition process, which the command that follows it ends with: see docs/commands.md.

FINDINGS = 1
OWN_ERROR = 1
USAGE = 2
INSTRUMENT = 4
DISK = 5


_FILE_IS_FINISHED = "The acquisition has ended. What was recorded before is kept; `imutui check FILE` reads it."


class Lifecycle:
    """State, error and exit code of one acquisition."""

    def __init__(self) -> None:
        # "connecting" until the first packet, "stopping" once the end is asked for, "stopped" or "failed" at the end
        self.state: SessionState = "connecting"
        self.error: str | None = None  # why it failed, for the user; the first reason counts
        self.exit_code = 0  # of the process
        self.cause: BaseException | None = None  # the exception that made it fail, if one did
        self.findings: list[EndFinding] = []  # what must be said at the end of one that did not fail
        self.stopping_since_ns: int | None = None  # when the end was first asked for, monotonic
        self.ended_by = ""  # who or what asked first, in words; empty if unknown
        self.terminated = False  # by a signal, as a shutdown sends it: it is waited for some seconds only
        self.streaming = threading.Event()  # the first packet has come
        self.ended = threading.Event()  # nothing more will happen

    def first_packet(self) -> None:
        """The first packet has been used: the acquisition runs."""
        self.state = "running" if self.state == "connecting" else self.state
        self.streaming.set()

    def stop(self, by: str) -> None:
        """Begin the end, and keep who asked first; what failed or ended before stays so."""
        if self.stopping_since_ns is None:
            self.stopping_since_ns = time.monotonic_ns()
            self.ended_by = by
        self.state = "stopping" if self.state in ("connecting", "running") else self.state

    def fail(self, exit_code: int, error: str, cause: BaseException | None = None) -> None:
        """End the acquisition as failed; only the first reason is kept, since later ones follow from it."""
        if not self.exit_code:
            self.exit_code, self.error, self.cause = exit_code, error, cause

    def defect(self, error: BaseException) -> None:
        """End the acquisition as failed by an exception that no code expects, and write the report of it.

        The engine's worker looks at `exit_code` several times a second, and then finishes the file. Any thread of the
        process may call this.
        """
        self.fail(OWN_ERROR, f"{defects.told(error)} {_FILE_IS_FINISHED}", error)

    def end(self) -> None:
        """Nothing more will happen."""
        self.state = "failed" if self.exit_code else "stopped"
        self.ended.set()
