"""The state of an acquisition from connecting to its end, and the record of its end.

The record is one for all: the first line of a process that does not begin, the reply to viewers that stop or await an
acquisition, and a file beside the socket for viewers that come later. A process that was killed leaves no file.
"""

import contextlib
import json
import os
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, cast

from imutui import defects, document_shape
from imutui.logbook import atomic_file
from imutui.session import ipc

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument
    from imutui.session.snapshot import SessionState

# Exit codes of the acquisition process, with which the command that follows it ends: see docs/commands.md.

FINDINGS = 1
OWN_ERROR = 1
USAGE = 2
INSTRUMENT = 4
DISK = 5

_FILE_IS_FINISHED = "The acquisition has ended. What was recorded before is kept; `imutui check FILE` reads it."
_LARGEST = 1 << 20
_SUFFIX = ".ended"


class EndFinding(TypedDict):
    """A finding of an acquisition that did not fail; a `record` that follows it to its end exits with `exit_code`."""

    exit_code: int
    text: str


class EndReport(TypedDict):
    """The end of the acquisition `name`, of the process `pid`; `utc` as in a snapshot.

    `ended_by` is the program or event that asked for the end, in words, empty if unknown; `by_itself` is true if
    nothing asked for it. `error` is why the acquisition failed, None if it did not. `exit_code` is 0 of one that did
    not fail. `result` is of the last recording, None if there was none.
    """

    version: int
    name: str
    pid: int
    utc: str
    ended_by: str
    by_itself: bool
    error: str | None
    exit_code: int
    findings: list[EndFinding]
    result: "RunDocument | None"


class Lifecycle:
    """State, error and exit code of one acquisition; every thread of its process reads and writes it."""

    def __init__(self, name: str = "default") -> None:
        self.name = name  # of the acquisition
        # "connecting" until the first packet, "stopping" once the end is asked for, "stopped" or "failed" at the end
        self.state: SessionState = "connecting"
        self.error: str | None = None  # why it failed, for the user; the first reason counts
        self.exit_code = 0  # of the process
        self.cause: BaseException | None = None  # the exception that made it fail, if one did
        self.findings: list[EndFinding] = []  # reported at the end if it did not fail
        self.stopping_since_ns: int | None = None  # when the end was first asked for, monotonic
        self.ended_by = ""  # what asked first, in words; empty if unknown
        self.terminated = False  # by a signal, as a shutdown sends it: it is waited for some seconds only
        self.streaming = threading.Event()  # the first packet has come
        self.ended = threading.Event()  # nothing more will happen

    def first_packet(self) -> None:
        """Enter the state "running": the first packet has been used."""
        self.state = "running" if self.state == "connecting" else self.state
        self.streaming.set()

    def stop(self, by: str) -> None:
        """Begin the end, and keep what asked first; an acquisition that failed or ended before stays so."""
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
        """Enter the last state: nothing more will happen."""
        self.state = "failed" if self.exit_code else "stopped"
        self.ended.set()

    def report(self, *, by_itself: bool = False, result: "RunDocument | None" = None) -> EndReport:
        """Return the record of the end, of this process."""
        return {
            "version": document_shape.VERSION,
            "name": self.name,
            "pid": os.getpid(),
            "utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "ended_by": self.ended_by,
            "by_itself": by_itself,
            "error": self.error,
            "exit_code": self.exit_code,
            "findings": self.findings,
            "result": result,
        }


def failed(name: str, exit_code: int, error: str) -> EndReport:
    """Return the record of the end of an acquisition that did not begin."""
    lifecycle = Lifecycle(name)
    lifecycle.fail(exit_code, error)
    return lifecycle.report()


def write_end(report: EndReport) -> None:
    """Write the record of an end beside the acquisition's socket, if the disk takes it."""
    path = ipc.socket_path(report["name"]).with_suffix(_SUFFIX)
    with contextlib.suppress(OSError):
        atomic_file.write(path, json.dumps(report), overwrite=True)


def read_end(name: str, pid: int | None = None) -> EndReport | None:
    """Return the record that the process of that number, or the last one, left; None if there is none of it."""
    for folder in ipc.folders():
        report = _read(folder / f"{name}{_SUFFIX}")
        if report is not None and pid in (None, report["pid"]):
            return report
    return None


def forget_end(name: str) -> None:
    """Remove the record that an earlier acquisition of that name left."""
    for folder in ipc.folders():
        (folder / f"{name}{_SUFFIX}").unlink(missing_ok=True)


def _read(path: Path) -> EndReport | None:
    try:
        if path.stat().st_size > _LARGEST:
            return None
        found = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    return None if document_shape.wrong_version(found) else cast("EndReport", found)
