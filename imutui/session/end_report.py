"""How an acquisition ended: who or what asked for it, and its result; kept for viewers that come too late to ask.

The process writes it beside its socket before that goes. A process that was killed leaves none.
"""

import contextlib
import getpass
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from imutui.plain_text import NOTE_LIMIT, one_line
from imutui.session import ipc

if TYPE_CHECKING:
    from imutui.logbook.results import ResultDocument
    from imutui.session.requests import EndFinding

_LARGEST = 1 << 20
_SUFFIX = ".ended"


class EndReport(TypedDict):
    """The end of the acquisition process `pid`; `utc` as in a snapshot, `ended_by` in words, empty if nobody asked."""

    pid: int
    utc: str
    ended_by: str
    error: str | None
    findings: "list[EndFinding]"
    result: "ResultDocument | None"


def write(name: str, report: EndReport) -> None:
    """Leave the report of the acquisition of that name, which this process is; a disk that does not take it is let go.

    `name`: of the acquisition.
    """
    path = ipc.socket_path(name).with_suffix(_SUFFIX)
    part = path.with_name(f"{path.name}.part")
    with contextlib.suppress(OSError):
        part.write_text(json.dumps(report))
        part.replace(path)


def read(name: str, pid: int) -> EndReport | None:
    """Report that the process of that number left; None if it left none, or another one came since."""
    for folder in ipc.folders():
        report = _read(folder / f"{name}{_SUFFIX}")
        if report is not None and report["pid"] == pid:
            return report
    return None


def _read(path: Path) -> EndReport | None:
    try:
        if path.stat().st_size > _LARGEST:
            return None
        found = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    if not isinstance(found, dict) or not EndReport.__annotations__.keys() <= found.keys():
        return None
    report: EndReport = {**found}  # type: ignore[typeddict-item]
    return report


def who(what: str) -> str:
    """Who asks for an end: what does, its user, terminal and process, such as `imutui stop, ana on pts/3, pid 42`."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # a user id without a name
        user = str(os.getuid())
    return one_line(f"{what}, {user}{_on_terminal()}, pid {os.getpid()}", NOTE_LIMIT)


def _on_terminal() -> str:
    for stream in (0, 2, 1):
        with contextlib.suppress(OSError):
            return f" on {os.ttyname(stream).removeprefix('/dev/')}"
    return ""
