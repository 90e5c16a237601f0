"""Where an acquisition stands, from connecting to its end; asked and told by every thread of its process."""

import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from imutui.session.requests import EndFinding
    from imutui.session.snapshot import SessionState


# Exit codes of the acquisition process, which the command that follows it ends with: see docs/commands.md.

FINDINGS = 1
OWN_ERROR = 1
USAGE = 2
INSTRUMENT = 4
DISK = 5


class Lifecycle:
    """State, error and exit code of one acquisition."""

    def __init__(self) -> None:
        # "connecting" until the first packet, "stopping" once the end is asked for, "stopped" or "failed" at the end
        self.state: SessionState = "connecting"
        self.error: str | None = None  # why it failed, for the user; the first reason counts
        self.exit_code = 0  # of the process
        self.findings: list[EndFinding] = []  # what must be said at the end of one that did not fail
        self.stopping_since_ns: int | None = None  # when the end was first asked for, monotonic
        self.ended_by = ""  # who or what asked first, in words; empty if nobody did, or did not say
        self.terminated = False  # by a signal, as a shutdown sends it: it is waited for some seconds only
        self.streaming = threading.Event()  # the first packet has come
        self.ended = threading.Event()  # nothing more will happen

    def first_packet(self) -> None:
        """The first packet has been used; a viewer may be told that the acquisition runs."""
        self.state = "running" if self.state == "connecting" else self.state
        self.streaming.set()

    def stop(self, by: str) -> None:
        """Take note that the end is asked for, and by whom; what failed or ended before stays so."""
        if self.stopping_since_ns is None:
            self.stopping_since_ns = time.monotonic_ns()
            self.ended_by = by
        self.state = "stopping" if self.state in ("connecting", "running") else self.state

    def fail(self, exit_code: int, error: str) -> None:
        """Something makes it end; what comes after the first reason is its consequence and is not kept."""
        if not self.exit_code:
            self.exit_code, self.error = exit_code, error

    def end(self) -> None:
        """Nothing more will happen."""
        self.state = "failed" if self.exit_code else "stopped"
        self.ended.set()
