"""Where an acquisition stands, from connecting to its end; asked and told by every thread of its process."""

import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from imutui.session.requests import EndFinding
    from imutui.session.snapshot import SessionState


class Lifecycle:
    """State, error and exit code of one acquisition.

    `state`: "connecting" until the first packet, then "running"; "stopping" once the end is asked for; "stopped", or
      "failed", at the end.
    `error`: why it failed, for the user; the first reason counts.
    `exit_code`: of the process; 0 unless it failed.
    `findings`: what must be said at the end of one that did not fail.
    `stopping_since_ns`: when the end was first asked for, monotonic.
    `ended_by`: who or what asked first, in words; empty if nobody did, or did not say.
    `terminated`: whether a signal asked for the end, as who shuts the machine down does: it is waited for some seconds
      only.
    `streaming`, `ended`: set with the first packet, and when nothing more will happen.
    """

    def __init__(self) -> None:
        self.state: SessionState = "connecting"
        self.error: str | None = None
        self.exit_code = 0
        self.findings: list[EndFinding] = []
        self.stopping_since_ns: int | None = None
        self.ended_by = ""
        self.terminated = False
        self.streaming = threading.Event()
        self.ended = threading.Event()

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
