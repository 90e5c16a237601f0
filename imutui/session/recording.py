"""The life of a recording: its file is begun, continued in another when it is full, and finished.

What goes into the file is written by `sample_pipeline`. No packet is lost at the joint of two files, and none is in
both. The filter begins anew with each, so that a replay of any one of them repeats its live result without the others;
what effects remember of temperature is in the next file's metadata, as are the file before it and the power-on that
they are parts of.
"""

import contextlib
import uuid
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from imutui.instrument.registry import INSTRUMENTS
from imutui.logbook import log_time, power_on, schemas
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.session import previous_log
from imutui.session.disk_space import DiskGuard, VanishedFile, vanished
from imutui.session.metadata import attach, default_path
from imutui.session.plan import Plan
from imutui.session.sample_pipeline import SamplePipeline
from imutui.verdict import sources

if TYPE_CHECKING:
    from imutui.logbook.results import PartResult, RunDocument


_MB = 1_000_000
MIN_FILE_S = 1.0


def is_full(plan: Plan, seconds: float, size: int) -> bool:
    """Whether a file has had its time or its size, and another may follow; never before it is a second long."""
    if seconds < MIN_FILE_S or not plan.rotates:
        return False
    return 0.0 < plan.rotate_minutes * 60.0 <= seconds or 0.0 < plan.rotate_mb * _MB <= size


class Recording:
    """One recording, in one file or several; begins the first file at once, `path` or one named by itself.

    `info` and `writer` are of the present file, `vanished` is what became of it if it is not where it was made.
    Raises FileExistsError if the file exists and the plan does not let it be replaced.
    Raises OSError if the disk does not take it, or has no room for it.
    """

    def __init__(
        self,
        plan: Plan,
        info: SessionInfo,
        note: str,
        path: Path | None,
    ) -> None:
        self.guard = DiskGuard(plan.min_free_mb)
        self.guard.refuse(Path(plan.logs) if path is None else path.parent)
        own = uuid.uuid4().hex[:16]
        self.info = replace(info, note=note, log_id=own, power_on=own)
        self._next_info = self.info
        self._plan = plan
        self._first, self.writer = self._begin(path)
        self.part = 1  # number of the present file
        # of each finished file: `log`, and `converged` and `passes`, which are true where no filter ran
        self._finished: list[PartResult] = []
        self.vanished: VanishedFile | None = None

    def _begin(self, path: Path | None) -> tuple[Path, LogWriter]:
        """Make the first file."""
        plan = self._plan
        if path is not None:
            return path, _open(path, self.info, plan, overwrite=plan.overwrite)
        while True:
            path = default_path(Path(plan.logs), plan.instrument, self.info.serial_number, self.info.note)
            with contextlib.suppress(FileExistsError):  # another unit without a number of its own began just now
                return path, _open(path, self.info, plan, overwrite=False)

    def is_full(self, seconds: float) -> bool:
        """See the function; `seconds` of the present file, by a clock that nobody sets."""
        return is_full(self._plan, seconds, self.writer.size)

    def next_path(self) -> Path:
        """Name of the next file, which does not exist yet: that of the first, and which part it is."""
        stem, suffix = f"{self._first.stem}_p{self.part + 1}", self._first.suffix
        path, number = self._first.with_name(f"{stem}{suffix}"), 2
        while path.exists():
            path, number = self._first.with_name(f"{stem}_{number}{suffix}"), number + 1
        return path

    def look(self, error: OSError | None = None) -> VanishedFile | None:
        """What became of the present file, if it vanished; `error` is what its disk answered, if not that it is full.

        It is found once: a file that was renamed is the present one under its new name, and is finished there.
        """
        if self.vanished is None:
            self.vanished = vanished(self.writer, error)
            if self.vanished is not None and self.vanished.now_at is not None:
                self.writer.path = self.vanished.now_at
        return self.vanished

    def next_file(self) -> None:
        """Begin the next file; the present one is finished. Raises OSError.

        After one that vanished the folder is made again, where there is one to make it in.
        """
        path = self.next_path()
        if self.vanished is not None:
            path.parent.mkdir(exist_ok=True)
            self.vanished = None
            if self._plan.reference_file[0]:
                # it is told from the recording's first sample on, so this file can't be filtered with it
                self._plan = replace(self._plan, filter="none", reference="gravity", reference_file=("", ""))
                self._next_info = replace(self._next_info, filter="none", reference="gravity", reference_sha256="")
        self.info = replace(self._next_info, log_id=uuid.uuid4().hex[:16])
        self.part += 1
        self.writer = _open(path, self.info, self._plan, overwrite=False)

    def describe(self, note: str | None, operator: str | None) -> None:
        """Change what the present file, and those after it, say as note and operator; None leaves it as it is."""
        note = self.info.note if note is None else note
        operator = self.info.operator if operator is None else operator
        self.info = replace(self.info, note=note, operator=operator)

    def finish_file(self, pipeline: SamplePipeline, now_ns: int) -> "RunDocument":
        """Finish the present file; returns its result, with all parts so far if there are several. Raises OSError.

        One that is lost is given up: its result says that it is not finished, and it is no part.
        """
        try:
            is_lost = self.vanished is not None and self.vanished.is_lost
            result = None if is_lost else finish_file(self.writer, pipeline, now_ns)
        except OSError as error:
            if self.look(error) is None:
                raise
            result = None
        if result is None:
            result = _given_up(self.writer, pipeline, now_ns)
        # what the next file says of this one, should there be a next one
        sha256, first_ns = result["log_sha256"] or "", pipeline.first_stamp_ns or 0
        following = power_on.continued(self.info, self.info, self.writer.path, sha256, first_ns)
        memory = "" if pipeline.filter is None else pipeline.filter.memory()
        self._next_info = previous_log.told(replace(following, memory=memory), None)
        if result["finished"]:
            passes, converged = sources.of_document(result).passes, "final" not in result or result["converged"]
            self._finished.append({"log": result["log"], "converged": converged, "passes": passes})
            if len(self._finished) > 1:
                result["parts"] = list(self._finished)
        return result


def finish_file(writer: LogWriter, pipeline: SamplePipeline, now_ns: int) -> "RunDocument":
    """Filter what still waits, finish the file and return its result; the pipeline goes on without a file.

    Raises OSError if the disk does not take the end; the file then ends with its last flush.
    """
    pipeline.use_waiting(now_ns)
    pipeline.flush(now_ns)
    return close_file(writer, pipeline, now_ns)


def close_file(writer: LogWriter, pipeline: SamplePipeline, now_ns: int) -> "RunDocument":
    """Finish the file with what was used so far, and return its result. Raises OSError as `finish_file` does."""
    document = result_document(pipeline, writer.path, None)
    # of its result the file keeps all, and the verdict on it in a word
    kept = {**document, "verdict": sources.of_document(document).word}
    writer.finish(kept, pipeline.utc_ns(now_ns))
    pipeline.release_file()
    return result_document(pipeline, writer.path, writer.sha256)


def _given_up(writer: LogWriter, pipeline: SamplePipeline, now_ns: int) -> "RunDocument":
    """Result of a run of samples whose file is lost."""
    pipeline.release_file()
    pipeline.use_waiting(now_ns)
    writer.give_up()
    result = result_document(pipeline, writer.path, None)
    result["finished"] = False
    return result


def result_document(pipeline: SamplePipeline, path: Path, log_sha256: str | None) -> "RunDocument":
    """Result of a run of samples after its last one; `log_sha256` is None before the file is finished."""
    # loads statistics: not before a recording ends
    from imutui.logbook import results

    info, counters, live = pipeline.info, pipeline.counters, pipeline.filter
    lost, health = (counters.lost_packets, counters.bad_checksums), pipeline.health(final=True)
    result: RunDocument = results.of_readings(info, path, pipeline.samples, lost, health, log_sha256)
    if live is not None and live.estimator is not None and live.estimator.latest is not None:
        result = results.document(result, live.estimator, info, live.seconds, 0.0)
    if live is not None and live.failure is not None:
        result["alarms"].append(live.failure)
    return result


def _open(path: Path, info: SessionInfo, plan: Plan, *, overwrite: bool) -> LogWriter:
    now = log_time.now_ns()
    writer = LogWriter(
        path,
        info,
        plan.configuration(),
        now,
        overwrite=overwrite,
        mode=plan.mode,
        raw_type=schemas.raw_type(details=INSTRUMENTS[plan.instrument].status_names is not None),
    )
    attach(writer, plan, now)
    return writer
