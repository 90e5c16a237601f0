"""The end of an acquisition process that did not begin in time: what is left of it holds something, or is not left."""

import contextlib
import subprocess
from pathlib import Path
from typing import Any

from imutui.session.plan import Plan

_GRACE_S = 10.0


def missing_folders(plan: Plan) -> list[Path]:
    """Folders that a recording would make, its own first."""
    folder = Path(plan.output).parent if plan.output else Path(plan.logs)
    return [one for one in (folder, *folder.parents) if not one.exists()]


def end(process: "subprocess.Popen[Any]", missing: list[Path]) -> None:
    """End the process: asked to, it leaves unit and file in order; one that does not answer is killed.

    `process`: nobody was told that it runs.
    `missing`: folders that were not there before it.
    """
    process.terminate()
    try:
        process.wait(_GRACE_S)
    except subprocess.TimeoutExpired:
        logs = _open_logs(process.pid)
        process.kill()
        process.wait()
        for log in logs:
            if not _has_messages(log):
                log.unlink(missing_ok=True)
    for folder in missing:
        with contextlib.suppress(OSError):  # it was not made, or something is in it
            folder.rmdir()


def _open_logs(pid: int) -> list[Path]:
    """Logs that a process writes to."""
    found = []
    for descriptor in Path(f"/proc/{pid}/fd").glob("*"):
        with contextlib.suppress(OSError):
            found.append(descriptor.readlink())
    return [path for path in found if path.suffix == ".mcap" and path.is_file()]


def _has_messages(path: Path) -> bool:
    """Whether anything was recorded; True of a file that can't be looked into."""
    from imutui.logbook import scan
    from imutui.logbook.reader import UnreadableLogError

    try:
        pieces = scan.scan(path).pieces
    except UnreadableLogError:
        return path.stat().st_size > 0
    return any(piece.last_ns for piece in pieces)
