"""A campaign: which logs lack their row, the rows made one way or another, and the folder that they go into.

The way (`local`, `cluster`) takes tasks as it needs them and gives them back with their rows; nothing accumulates.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias, TypedDict

from imutui.document_shape import VERSION
from imutui.jobs.campaign.log_list import LogList, Shard
from imutui.jobs.campaign.one_log import Rows, Settings, Task
from imutui.jobs.campaign.results_folder import Known, ResultsFolder
from imutui.jobs.campaign.rows import HeadFields, Row
from imutui.logbook.reading import digest

_SHOWN = 3


Way: TypeAlias = Callable[[Iterator[Task], int], Rows]
"""How tasks, so many of them, become rows."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """What is asked for."""

    logs: LogList  # all logs, of which a shard takes its own
    settings: Settings  # how each is taken
    results: Path  # folder for the results
    shard: Shard | None = None  # which part of the logs; None for all
    retry: bool = False  # whether rows with an error are tried again though nothing has changed
    again: bool = False  # whether all rows are made anew
    mode: int = 0o640  # permissions of what is written

    def own_logs(self) -> list[str]:
        """Logs of the shard."""
        return [log for log in self.logs.logs if self.shard is None or self.shard.has(log)]

    def head(self, logs: int) -> HeadFields:
        """What the results say of it."""
        return {
            "version": VERSION,
            "root": self.logs.root,
            "shard": None if self.shard is None else str(self.shard),
            "logs": logs,
            "settings": self.settings.document(),
            "settings_sha256": digest(self.settings.document()),
            "complete": False,
        }


class RunDocument(TypedDict):
    """What a run has come to, as `imutui campaign --json` prints it."""

    version: int
    results: str
    table: str | None  # where `results.parquet` is; None without pyarrow
    root: str
    shard: str | None
    logs: int
    kept: int
    computed: int
    unchanged: int  # of those kept: touched since, and still the same
    errors: int
    not_fine: int  # without an error, but not converged, RED, damaged or not traceable
    beyond: int  # rows in the results of logs that this run was not asked for
    other_settings: int  # rows of other settings, which are left out of `results.json`
    broken_lines: int
    wall_s: float
    per_minute: float | None
    first_errors: list[str]


def run(campaign: Campaign, way: Way, tell: "Callable[[Pace], None]" = lambda pace: None) -> RunDocument:
    """Compute the rows that lack, into the folder of results; what is there already stays.

    Interrupted at any time, it leaves the rows that were done, and `results.json` of them.

    `way`: `local.rows` or `cluster.rows`.
    `tell`: told how far it is, after each log.
    Raises InputError if another run writes to the folder, or it has results of another root.
    Raises UnreadableLogError if what is in the folder is no result of a campaign.
    Raises OSError if the disk does not take the results.
    """
    logs = campaign.own_logs()
    with ResultsFolder(campaign.results, campaign.head(len(logs)), campaign.mode) as folder:
        known = folder.known
        wanted = [
            log for log in logs
            if _is_anew(campaign, known.get(log)) or _has_changed(known.get(log), campaign.logs.path(log))
        ]  # fmt: skip
        pace = Pace(len(wanted))
        tell(pace)
        try:
            for task, row in way(_tasks(campaign, folder, wanted), len(wanted)) if wanted else ():
                if row is None:
                    row = _touched(folder.row(task.log), Path(task.path))
                    pace.unchanged += 1
                folder.add(row)
                pace.count(row)
                tell(pace)
                folder.publish_now_and_then()
        except BaseException:
            folder.finish(complete=False)
            raise
        table = folder.finish(complete=True)
        return _document(campaign, folder, logs, pace, table)


def _is_anew(campaign: Campaign, known: Known | None) -> bool:
    """Whether a log's row is made again even if the log is the same."""
    return known is None or known.retry or campaign.again or (campaign.retry and known.failed)


def _tasks(campaign: Campaign, folder: ResultsFolder, wanted: list[str]) -> Iterator[Task]:
    settings_sha256 = digest(campaign.settings.document())
    for log in wanted:
        known = folder.known.get(log)
        unless = None if known is None or _is_anew(campaign, known) else known.sha256
        yield Task(log, campaign.logs.path(log), campaign.settings, settings_sha256, unless)


def _has_changed(known: Known | None, path: str) -> bool:
    if known is None:
        return True
    try:
        now = Path(path).stat()
    except OSError:
        return False  # it was there a moment ago, and its row still says what it held
    return (now.st_size, now.st_mtime_ns) != (known.bytes, known.mtime_ns)


def _touched(row: Row, path: Path) -> Row:
    """The row of a log that has another time than it says, and the same content."""
    now = path.stat()
    return {**row, "log_bytes": now.st_size, "log_mtime_ns": now.st_mtime_ns}


class Pace:
    """How far a run is: logs to compute, done, of these with an error or unchanged; and how fast it goes on."""

    def __init__(self, wanted: int) -> None:
        self.wanted = wanted
        self.done = self.errors = self.unchanged = 0
        self.started = time.monotonic()
        self._first: float | None = None

    def count(self, row: Row) -> None:
        """Count a row that has come."""
        self.done += 1
        self.errors += row["error"] is not None
        self._first = self._first or time.monotonic()

    def per_second(self) -> float | None:
        """Rows a second since the first one, with which the workers were ready; None before the second one."""
        if self._first is None or self.done < 2:
            return None
        return (self.done - 1) / max(time.monotonic() - self._first, 1e-6)


def _document(
    campaign: Campaign, folder: ResultsFolder, logs: list[str], pace: Pace, table: Path | None
) -> RunDocument:
    own = [folder.known[log] for log in logs]
    failed = [log for log in logs if folder.known[log].failed]
    rate = pace.per_second()
    computed = pace.done - pace.unchanged
    return {
        "version": VERSION,
        "results": str(campaign.results.resolve()),
        "table": None if table is None else str(table.resolve()),
        "root": campaign.logs.root,
        "shard": None if campaign.shard is None else str(campaign.shard),
        "logs": len(logs),
        "kept": len(logs) - computed,
        "computed": computed,
        "unchanged": pace.unchanged,
        "errors": len(failed),
        "not_fine": sum(not known.fine and not known.failed for known in own),
        "beyond": len(folder.known) - len(own),
        "other_settings": folder.others,
        "broken_lines": folder.broken,
        "wall_s": time.monotonic() - pace.started,
        "per_minute": None if rate is None else 60.0 * rate,
        "first_errors": [_error(folder.row(log)) for log in failed[:_SHOWN]],
    }


def _error(row: Row) -> str:
    """What is wrong with a log, which is named in it."""
    error = row["error"] or ""
    return error if row["log"] in error else f"{row['log']}: {error}"
