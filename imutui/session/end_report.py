"""How an acquisition ended: who or what asked for it, and its result; kept for viewers that come too late to ask.

The process writes it beside its socket before that goes. A process that was killed leaves none. Here as well: how one
is ended that did not begin in time.
"""

import contextlib
import json
import os
import stat
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, cast

from imutui import document_shape
from imutui.logbook import atomic_file, file_lock
from imutui.session import ipc
from imutui.session.plan import Plan

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument
    from imutui.session.preloaded import Forked
    from imutui.session.requests import EndFinding


_LARGEST = 1 << 20
_SUFFIX = ".ended"


class EndReport(TypedDict):
    """The end of the acquisition process `pid`; `utc` as in a snapshot, `ended_by` in words, empty if unknown."""

    version: int
    pid: int
    utc: str
    ended_by: str
    error: str | None
    findings: "list[EndFinding]"
    result: "RunDocument | None"


def write(
    name: str,
    ended_by: str,
    error: str | None,
    findings: "Sequence[EndFinding]" = (),
    result: "RunDocument | None" = None,
) -> None:
    """Leave the report of the acquisition of that name, which this process is, if the disk takes it."""
    report: EndReport = {
        "version": document_shape.VERSION,
        "pid": os.getpid(),
        "utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "ended_by": ended_by,
        "error": error,
        "findings": [*findings],
        "result": result,
    }
    path = ipc.socket_path(name).with_suffix(_SUFFIX)
    with contextlib.suppress(OSError):
        atomic_file.write(path, json.dumps(report), overwrite=True)


def read(name: str, pid: int | None = None) -> EndReport | None:
    """Report that the process of that number, or the last one, left; None if it left none, or another came since."""
    for folder in ipc.folders():
        report = _read(folder / f"{name}{_SUFFIX}")
        if report is not None and pid in (None, report["pid"]):
            return report
    return None


def forget(name: str) -> None:
    """Take away what an earlier acquisition of that name left: a process that is killed leaves nothing."""
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


_GRACE_S = 10.0


def missing_folders(plan: Plan) -> list[Path]:
    """Folders that a recording would make, its own first."""
    folder = Path(plan.output).parent if plan.output else Path(plan.logs)
    return [one for one in (folder, *folder.parents) if not one.exists()]


def end_unbegun(process: "subprocess.Popen[Any] | Forked", missing: list[Path]) -> None:
    """End a process whose start was not reported: it is asked to leave unit and file in order, else killed.

    `missing` are folders that were not there before it.
    """
    process.terminate()
    try:
        process.wait(_GRACE_S)
    except subprocess.TimeoutExpired:
        logs = open_logs(process.pid)
        process.kill()
        process.wait()
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
    """Whether anything was recorded; True of a file that can't be looked into."""
    from imutui.logbook import scan
    from imutui.logbook.reader import UnreadableLogError

    try:
        return scan.scan(path).chunks > 0
    except UnreadableLogError:
        return path.stat().st_size > 0
