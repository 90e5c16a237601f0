"""The recording before this one of the same acquisition and unit: what a new file says of it.

After a crash, or when the computer was started anew, an acquisition goes on in a new file. That file names the one
before, whether that was finished, and what has happened since. It does not say that both are of one power-on, since
the unit may have lost its power meanwhile (`imutui.logbook.power_on` is for what is known).
"""

import contextlib
import stat
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from imutui.command_line import command
from imutui.logbook import summary
from imutui.logbook.session_info import SessionInfo
from imutui.plain_text import in_line

PROCESS, COMPUTER = "process", "computer"  # what was started anew since the recording before

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
_LOOKED_AT = 100
_SUFFIX = ".mcap"


@dataclass(frozen=True, slots=True)
class PreviousLog:
    """A recording that an acquisition takes up after."""

    # path, log_id: of its last file
    path: Path
    log_id: str
    finished: bool  # whether that has its end
    last_s: float  # its last sample, or if unknown when it was last written to, Unix time, s
    # "process" if this computer has run on since, "computer" if that was started anew, "" if it is not known
    restart: str

    @property
    def name(self) -> str:
        """Name of its last file."""
        return self.path.name

    def in_words(self) -> str:
        """Return what the new file's event says."""
        when = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(self.last_s))
        why = {PROCESS: "a crash" if not self.finished else "", COMPUTER: "a restart of the computer", "": ""}
        after = why[self.restart] or "an earlier recording"
        how = "was finished" if self.finished else "ended unfinished"
        whole = self.path.with_name(f"{self.path.stem}_recovered{self.path.suffix}")
        cure = "" if self.finished else f"; `{command('recover', self.path, '-o', whole)}` makes it whole"
        kept = "Whether the unit kept its power is not known"
        return f"continues after {after}: {in_line(self.name)} {how} at {when}. {kept}{cure}"


def boot_id() -> str:
    """Return the id of this run of the computer, from power-up to power-down; "" if unknown."""
    try:
        return _BOOT_ID.read_text().strip()
    except OSError:
        return ""


def find(folder: Path, info: SessionInfo, *, finished_too: bool) -> PreviousLog | None:
    """Return the last recording in a folder of the same acquisition, unit and computer as the one that begins.

    None if there is none, or if it was finished, unless `finished_too`.
    """
    for path in _newest(folder):
        try:
            found = summary.read(path)
        except OSError:  # removed meanwhile, or not for this user
            continue
        if found.state in (summary.NO_LOG, summary.WRITING) or not _same(found.session, info):
            continue
        previous = _previous(found, info)
        return previous if finished_too or not previous.finished else None
    return None


def naming(info: SessionInfo, previous: PreviousLog | None) -> SessionInfo:
    """Return metadata that name the recording before, or that none is known."""
    if previous is None:
        return replace(info, previous="", previous_id="", previous_end="", restart="")
    end = summary.FINISHED if previous.finished else summary.UNFINISHED
    return replace(
        info, previous=previous.name, previous_id=previous.log_id, previous_end=end, restart=previous.restart
    )


def _newest(folder: Path) -> Iterator[Path]:
    """Yield the newest logs of a folder, the last one first: a folder of thousands would hold up the recording."""
    stamped = list[tuple[int, Path]]()
    with contextlib.suppress(OSError):  # a share that went away; the recorder will say so
        for path in folder.glob(f"*{_SUFFIX}"):
            with contextlib.suppress(OSError):  # a link that leads nowhere, or a file that was removed
                status = path.stat()
                # a pipe of that name would be waited for
                stamped += [(status.st_mtime_ns, path)] if stat.S_ISREG(status.st_mode) else []
    return (path for _, path in sorted(stamped, reverse=True)[:_LOOKED_AT])


def _same(session: dict[str, str], info: SessionInfo) -> bool:
    """Whether a log's metadata are of the same acquisition, unit and computer."""
    keys = ("acquisition", "serial_number", "host")
    return all(session.get(key) == getattr(info, key) for key in keys)


def _previous(found: summary.Summary, info: SessionInfo) -> PreviousLog:
    booted = found.session.get("boot_id", "")
    known = booted and info.boot_id
    restart = (PROCESS if booted == info.boot_id else COMPUTER) if known else ""
    last_s = found.modified if found.started_ns is None else found.started_ns / 1e9 + (found.seconds or 0.0)
    finished = found.state == summary.FINISHED  # one that is damaged has no summary
    return PreviousLog(found.path, found.session.get("log_id", ""), finished, last_s, restart)
