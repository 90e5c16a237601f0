"""The files of an acquisition, one after the other, and the runs of samples that go into them.

A file is begun, continued in another when it is full or out of reach, and finished. No packet is lost at the joint of
two files, and none is in both. The filter begins anew with each file, so that a replay of any one of them repeats its
live result without the others. The next file's metadata name the file before it and the power-on that both are parts
of, and hold what effects remember of temperature.
"""

import contextlib
import errno
import math
import os
import shutil
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from filters.errors import InputError
from imutui.instrument.registry import INSTRUMENTS
from imutui.logbook import log_time, power_on, schemas
from imutui.logbook.log_time import Timebase
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.summary import FINISHED
from imutui.logbook.writer import LogWriter
from imutui.session import lifecycle, metadata
from imutui.session.lifecycle import Lifecycle
from imutui.session.metadata import attach, check_live, default_path, effects_of, motion_of
from imutui.session.plan import Plan, RecordingWish
from imutui.session.reader_thread import BLOCK_NS
from imutui.session.run import Run
from imutui.session.stream import INFORMATION, WARNING, Began, Block, Broke, Event, Said, Second, Why
from imutui.verdict import sources

if TYPE_CHECKING:
    from imutui.logbook.results import PartResult, RunDocument

_MB = 1_000_000
_MIN_FILE_S = 1.0  # no file is shorter because it is full
_LEEWAY_NS = 250_000_000  # the packet that completes the last period may be on its way
_FILTER_PATIENCE_S = 0.8
_MOST_FINDINGS = 20  # a folder that is emptied each second is known by then

# answers of a disk or a network share that has gone, rather than of one that is full
_DISK_GONE = (
    *(errno.ESTALE, errno.EIO, errno.ENXIO, errno.ENODEV, errno.ENOTCONN, errno.ESHUTDOWN, errno.EHOSTDOWN),
    *(errno.EHOSTUNREACH, errno.ETIMEDOUT, errno.EREMOTEIO, errno.ENOMEDIUM),
)


class Duration:
    """Measures the time of what was recorded, from the first packet on, through all files of a recording."""

    def __init__(self, seconds: float | None) -> None:
        self._seconds = seconds
        self.begin()

    def begin(self) -> None:
        """Count anew, from the next packet on."""
        self._end_ns, self._until_ns = math.inf, 0

    def add(self, stamps_ns: np.ndarray) -> None:
        """Count packets by their stamps, monotonic, shape (N,)."""
        if self._seconds is not None and self._end_ns == math.inf:
            self._end_ns = int(stamps_ns[0]) + round(self._seconds * 1e9)
        self._until_ns = int(stamps_ns[-1])

    def has_all(self, read_ns: int) -> bool:
        """Return whether the packets reach the end, or one that was read then is too late to be waited for."""
        return self._until_ns >= self._end_ns or read_ns >= self.late_ns()

    def room(self, stamps_ns: np.ndarray) -> int:
        """Return how many of these packets reach the end, shape (N,)."""
        if self._end_ns == math.inf:
            return stamps_ns.size if self._seconds is None else 1
        return min(int(np.searchsorted(stamps_ns, self._end_ns)) + 1, stamps_ns.size)

    def is_over(self, now_ns: int) -> bool:
        """Return whether the end has come, by the packets or by the clock."""
        return self._until_ns >= self._end_ns or now_ns >= self.late_ns() + BLOCK_NS

    def late_ns(self) -> float:
        """Return when a packet is read too late to be waited for."""
        return self._end_ns + _LEEWAY_NS


class DiskSpace:
    """Keeps some of a disk free: no recording begins, and none goes on, when less is left; 0 keeps nothing.

    It measures how fast a recording fills the disk, through all its files.
    """

    _REFRESH_NS, _MIN_SPAN_S, _MAX_SIZES, _WARN_S = 1_000_000_000, 10.0, 61, 1800.0

    def __init__(self, min_free_mb: float) -> None:
        self.min_free_bytes = round(min_free_mb * _MB)
        self._found: tuple[Path, int, int | None] | None = None  # folder, when it was looked up, free bytes
        self._has_warned = False
        self._sizes: deque[tuple[int, int]] = deque(maxlen=self._MAX_SIZES)
        self._before = self._last = 0

    def free_bytes(self, folder: Path, now_ns: int) -> int | None:
        """Return the bytes that this user may still write to a folder's disk; None if unknown.

        The folder need not exist yet. The disk is asked once a second at most.
        """
        if self._found is None or self._found[0] != folder or now_ns - self._found[1] >= self._REFRESH_NS:
            self._found = folder, now_ns, _free(folder)
        return self._found[2]

    def refuse(self, folder: Path) -> None:
        """Raise OSError, with what to do, if nothing can be recorded to a folder, which need not exist yet."""
        free = _free(folder)
        if free is not None and free < self.min_free_bytes:
            why = f"{_in_mb(free)} are free, and recording leaves {_in_mb(self.min_free_bytes)} (`paths.min_free_mb`)"
            raise OSError(errno.ENOSPC, why, str(folder))

    def stop(self, path: Path, free: int | None) -> str | None:
        """Return words for the end of a recording whose disk is too full; None if it may go on."""
        if free is None or free >= self.min_free_bytes:
            return None
        return (
            f"{path.parent}: {_in_mb(free)} are free, and recording leaves {_in_mb(self.min_free_bytes)}"
            f" (`paths.min_free_mb`), so it has stopped; {path.name} is finished. Free some space, then record again."
        )

    def add_size(self, now_ns: int, size: int) -> None:
        """Add the size of the present file; a smaller one than before is that of a new file."""
        if size < self._last:
            self._before += self._last
        self._last = size
        self._sizes.append((now_ns, self._before + size))

    def bytes_per_s(self) -> float | None:
        """Return the rate over the last minute; None before there are 10 s."""
        if not self._sizes:
            return None
        (t0, first), (t1, last) = self._sizes[0], self._sizes[-1]
        seconds = (t1 - t0) / 1e9
        return (last - first) / seconds if seconds >= self._MIN_SPAN_S else None

    def seconds_left(self, free: int | None) -> float | None:
        """Return how long recording can go on; None if unknown."""
        rate = self.bytes_per_s()
        return None if free is None or not rate else max(0, free - self.min_free_bytes) / rate

    def warn(self, free: int | None) -> str | None:
        """Return words, once, when the disk has room for half an hour more."""
        seconds = self.seconds_left(free)
        if seconds is None or seconds > self._WARN_S or self._has_warned:
            return None
        self._has_warned = True
        return f"the disk has room for {seconds / 60.0:.0f} min more; free some space"


def _free(folder: Path) -> int | None:
    there = next((path for path in (folder, *folder.absolute().parents) if path.is_dir()), None)
    try:
        return shutil.disk_usage(there).free if there is not None else None
    except OSError:  # a share that went away: writing to it will say so
        return None


def _in_mb(size: float) -> str:
    return f"{size / _MB:,.{0 if size >= 10 * _MB else 1}f} MB"


def disk_message(writer: LogWriter | None, error: OSError) -> str:
    """Return words for a disk that refuses to be written to."""
    if writer is None:
        return f"{error.filename or 'disk'}: {error.strerror or error}. Choose another folder or free some space."
    said = f"{writer.path}: {error.strerror or error}."
    if writer.is_empty:
        return f"{said} Nothing had been recorded yet, and no file is left. Free some space, then record again."
    try:
        is_there = writer.path.stat().st_size == writer.size
    except OSError:
        is_there = False
    if not is_there:
        return f"{said} The file is not there any more. Choose another folder, then record again."
    return (
        f"{said} The file holds everything up to its last flush ({writer.size} bytes) and `imutui replay` reads it."
        " Free some space, then record again."
    )


def why_lost(writer: LogWriter, error: OSError | None = None) -> str:
    """Return why a file is out of reach, in words; "" if it is where it was made and its disk answers.

    `error` is the answer of its disk. That of a full disk loses no file.
    """
    try:
        if error is None and writer.is_there():
            return ""
    except OSError as refusal:
        error = refusal
    if error is None:
        return f"{writer.path} was removed, renamed or unmounted while recorded to: unless it is elsewhere, it is lost."
    if error.errno not in _DISK_GONE:
        return ""
    return (
        f"{writer.path}: {os.strerror(error.errno)}: its disk or network share has gone. Should it come back, the file"
        f" holds what was flushed, {writer.size:,} bytes, which `imutui check` reads."
    )


class Recording:
    """Runs of samples, one after the other, with a file or without. Not thread-safe.

    `plan`, `info` and `motion` are as they are in force. `run` is the present run. `writer` writes the present file,
    and is None while nothing is recorded; `file_info` and `part` are of that file. `emit` takes what is said and what
    begins, before this goes on.
    Raises InputError if the filter cannot run with the plan; the message names why.
    """

    def __init__(
        self, plan: Plan, info: SessionInfo, lifecycle: Lifecycle, timebase: Timebase, emit: Callable[[Event], None]
    ) -> None:
        self._adopt(plan, info)
        self._instrument = INSTRUMENTS[plan.instrument]
        self._lifecycle = lifecycle
        self._timebase = timebase
        self._emit = emit
        self.result: RunDocument | None = None  # of the last file that was finished
        self.duration = Duration(plan.duration_s)
        self.begins_with_packet = plan.record  # the recording that the plan asks for
        self.space = DiskSpace(plan.min_free_mb)
        self.is_out_of_space = False
        self.writer: LogWriter | None = None
        self.file_info = self._next_info = info
        self.part = 0
        self.lost = ""  # why the file that ended last was lost, in words
        self._file_plan = plan  # of the present recording
        self._first_path = Path()
        self._parts: list[PartResult] = []  # the finished files of the present recording
        self._has_recorded = False
        self.run = Run(info, timebase, None, self.motion, self._effects, self._instrument)

    def take(self, event: Event, /) -> Iterable[Said]:
        """Take an event of the stream. Raises OSError, and the exception that stopped the filter."""
        self.run.take(event)
        self._raise_defect()
        match event:
            case Block():
                self.duration.add(event.rows["stamp_ns"])
            case Broke(Why.ZEROED):
                self.begin_run()
            case Second():
                self._look_after_file(event.now_ns)
        return ()

    # -- what is said -------------------------------------------------------------------------------------------------

    def event(self, name: str, text: str, level: int = INFORMATION) -> None:
        """Write an event or a mark into the file, if there is one, and show it to viewers; raises OSError."""
        self._emit(Said(name, text, level))

    def find(self, exit_code: int, text: str, *, is_said: bool = False) -> None:
        """Keep a finding for the end, and say it now unless it is said already. Raises OSError."""
        if len(self._lifecycle.findings) < _MOST_FINDINGS:
            self._lifecycle.findings.append({"exit_code": exit_code, "text": text})
        if not is_said:
            self.event("acquisition", text, WARNING)

    def disk_message(self, error: OSError) -> str:
        """Return words for a disk that refuses to be written to, with what was found of disks before."""
        before = [finding["text"] for finding in self._lifecycle.findings if finding["exit_code"] == lifecycle.DISK]
        return " ".join([disk_message(self.writer, error), *before])

    # -- runs of samples ----------------------------------------------------------------------------------------------

    def begin_run(self, *, recording: bool = False) -> None:
        """Begin another run of samples, into the present file if there is one; `recording` if that has just begun."""
        info = self.info if self.writer is None else self.file_info
        effects = effects_of(self.plan, info) if info.memory else self._effects
        self.run = Run(info, self._timebase, self.writer, self.motion, effects, self._instrument)
        if recording or not self._has_recorded:
            self.duration.begin()
        self._emit(Began(recording))

    def configure(self, plan: Plan, info: SessionInfo) -> None:
        """Take another reference or other effects; the filter begins anew with them.

        Raises InputError, before anything is changed, if it could not run with them.
        """
        self._adopt(plan, info)
        self.begin_run()

    def _adopt(self, plan: Plan, info: SessionInfo) -> None:
        motion, effects = motion_of(plan), effects_of(plan, info)
        check_live(info, motion, effects)
        self.plan, self.info, self.motion, self._effects = plan, info, motion, effects

    def why_over(self, now_ns: int) -> str | None:
        """Return that the plan's duration is over, or the disk's room, in words; None if neither is."""
        if self.is_out_of_space and self.plan.record:
            return "the disk guard: there is no room for more"
        return f"its duration of {self.plan.duration_s:g} s" if self.duration.is_over(now_ns) else None

    def _raise_defect(self) -> None:
        """Raise the exception that stopped the filter, once; the file has all packets until then."""
        live = self.run.filter
        if live is not None and live.defect is not None:
            error, live.defect = live.defect, None
            raise error

    # -- a recording begins -------------------------------------------------------------------------------------------

    def record(self, wish: RecordingWish) -> Path:
        """Begin a recording as wished, and return its path. The wish stays for later ones, but for its note.

        Raises InputError if the disk refuses it.
        """
        said = {key: value for key, value in asdict(wish).items() if value is not None}
        note = said.pop("note", self.plan.note)
        before = self.plan, self.info
        # the plan's own note does not come back after another one, or none, was said
        self.plan = replace(self.plan, **said, note=self.plan.note if wish.note is None else "")
        self.info = replace(self.info, **{key: said[key] for key in ("operator", "place", "table") if key in said})
        try:
            return self._begin(note, None)
        except OSError as error:  # nothing has been recorded yet, so nothing is lost but this wish
            self.plan, self.info = before
            raise InputError(disk_message(None, error)) from error

    def make_room(self, read_ns: int) -> None:
        """Begin the file that a packet goes into, if it is the first of a recording or of another file. Raises OSError.

        `read_ns`: when the packet was read, monotonic.
        """
        if self.begins_with_packet:
            # not before: a unit that sends nothing must not cost the file that --force would replace
            self.begins_with_packet = False
            self._begin(self.plan.note, Path(self.plan.output) if self.plan.output else None)
            return
        end_ns = self._lifecycle.stopping_since_ns
        ends = end_ns is not None and read_ns >= end_ns
        if self.writer is not None and not ends and self._is_full(read_ns, self.writer.size):
            self._go_on()

    def room(self, rows: np.ndarray) -> int:
        """Return how many packets of a block go into the present file, at least one."""
        until_ns = min(self.duration.late_ns(), self._full_ns())
        count = rows.size if until_ns == math.inf else max(1, int(np.searchsorted(rows["host_ns"], until_ns)))
        return self.duration.room(rows["stamp_ns"][:count])

    def _begin(self, note: str, path: Path | None) -> Path:
        """Begin a recording and a run of samples in it; raises OSError."""
        plan, info = self.plan, self.info
        space = DiskSpace(plan.min_free_mb)
        space.refuse(Path(plan.logs) if path is None else path.parent)
        # what this acquisition recorded before it was started anew
        previous = None
        if not self._has_recorded:
            previous = metadata.previous_log(Path(plan.logs), info, finished_too=plan.unattended)
        own = uuid.uuid4().hex[:16]
        file_info = replace(metadata.naming(info, previous), note=note, log_id=own, power_on=own)
        self.writer = self._open_first(plan, file_info, path)
        self.space, self._file_plan, self.file_info, self._next_info = space, plan, file_info, file_info
        self._first_path, self.part, self._parts, self.lost = self.writer.path, 1, [], ""
        self.begin_run(recording=True)
        self._has_recorded = True
        self.event("acquisition", f"recording to {self._first_path.name}")
        if previous is not None:
            level = INFORMATION if file_info.previous_end == FINISHED else WARNING
            self.event("acquisition", metadata.continuation(file_info, previous), level)
        if plan.rotates != bool(plan.rotate_minutes or plan.rotate_mb):
            why = "the reference is told from one log's first sample on"
            self.event("acquisition", f"the recording stays in one file: {why}", WARNING)
        return self._first_path

    def _open_first(self, plan: Plan, info: SessionInfo, path: Path | None) -> LogWriter:
        if path is not None:
            return _open(path, info, plan, overwrite=plan.overwrite)
        while True:
            path = default_path(Path(plan.logs), plan.instrument, info.serial_number, info.note)
            with contextlib.suppress(FileExistsError):  # another unit without a number of its own began just now
                return _open(path, info, plan, overwrite=False)

    def describe(self, note: str | None, operator: str | None) -> None:
        """Change note and operator of the file that is being written; None leaves one as it is. Raises OSError.

        Raises InputError if nothing is being recorded.
        """
        if self.writer is None:
            raise InputError("nothing is being recorded, so there is no file to describe; start recording first")
        before = self.file_info
        self.file_info = now = replace(
            before,
            note=before.note if note is None else note,
            operator=before.operator if operator is None else operator,
        )
        self.run.describe(now)
        if operator:
            self.plan, self.info = replace(self.plan, operator=operator), replace(self.info, operator=operator)
        for name in schemas.DESCRIPTION:
            was, is_now = getattr(before, name), getattr(now, name)
            if was != is_now:
                self.event("acquisition", f"{name}: {is_now or 'none'} (before: {was or 'none'})")

    # -- from file to file --------------------------------------------------------------------------------------------

    def _full_ns(self) -> float:
        """Return when the present file has had its time, monotonic; infinity if that never is."""
        minutes, started_ns = self._file_plan.rotate_minutes, self.run.started_ns
        if self.writer is None or started_ns is None or not self._file_plan.rotates or not minutes:
            return math.inf
        return started_ns + 1e9 * max(_MIN_FILE_S, 60.0 * minutes)

    def _is_full(self, read_ns: int, size: int) -> bool:
        """Return whether the file has had its time or its size, and another may follow; never in its first second."""
        started_ns, limit = self.run.started_ns, self._file_plan.rotate_mb * _MB
        if started_ns is None or not self._file_plan.rotates or read_ns < started_ns + 1e9 * _MIN_FILE_S:
            return False
        return read_ns >= self._full_ns() or 0.0 < limit <= size

    def _look_after_file(self, now_ns: int) -> None:
        """See whether the file is within reach, and its disk has room. Raises OSError."""
        if self.writer is None:
            return
        self.space.add_size(now_ns, self.writer.size)
        if self._lifecycle.state == "running" and why_lost(self.writer):
            self._go_on()
            return
        free = self.free_bytes(now_ns)
        short = self.space.warn(free)
        if short is not None:
            self.event("acquisition", short, WARNING)
        full = self.space.stop(self.writer.path, free)
        if full is not None:
            self.find(lifecycle.DISK, full)
            self.is_out_of_space = True

    def free_bytes(self, now_ns: int) -> int | None:
        """Return the free space where the present recording goes, or the next one would."""
        folder = Path(self.plan.logs) if self.writer is None else self.writer.path.parent
        return self.space.free_bytes(folder, now_ns)

    def disk_failed(self, error: OSError) -> None:
        """Go on in another file if the disk of the present one has gone; raises the error if it has not."""
        if self.writer is None or self.writer.is_empty or not why_lost(self.writer, error):
            raise error
        self._go_on(error)

    def _go_on(self, error: OSError | None = None) -> None:
        """Finish the file and begin the next one. Raises OSError."""
        assert self.writer is not None
        before, path = self.writer.path.name, self._next_path()
        self._finish_file(path, error)
        plan, info = self._file_plan, self._next_info
        if self.lost:
            path.parent.mkdir(exist_ok=True)  # where there is a folder to make it in
            if plan.reference_file[0]:
                # its time begins with the recording's first sample, so the filter cannot use it in this file
                plan = self._file_plan = replace(plan, filter="none", reference="gravity", reference_file=("", ""))
                info = self._next_info = replace(info, filter="none", reference="gravity", reference_sha256="")
        self.file_info = replace(info, log_id=uuid.uuid4().hex[:16])
        self.writer = _open(path, self.file_info, plan, overwrite=False)
        self.part += 1
        self.begin_run()
        self.event("acquisition", f"part {self.part}, continues {before}{self.lost and f': {self.lost}'}")

    def _next_path(self) -> Path:
        """Return the name of the next file, which does not exist yet: that of the first, and which part it is."""
        first = self._first_path
        stem, number = f"{first.stem}_p{self.part + 1}", 2
        path = first.with_name(f"{stem}{first.suffix}")
        while path.exists():
            path, number = first.with_name(f"{stem}_{number}{first.suffix}"), number + 1
        return path

    # -- a file ends --------------------------------------------------------------------------------------------------

    def end(self) -> "RunDocument":
        """Finish the recording and return its result; the run goes on without a file, its filter included.

        Raises InputError if nothing is being recorded.
        Raises OSError if the disk refuses the end.
        """
        self.is_out_of_space = self.is_out_of_space and self.plan.record
        result = self._finish_file()
        if result["finished"]:
            self.event("acquisition", f"finished {result['log']}")
        return result

    def finish(self) -> None:
        """Finish the file, if there is one, for good. Raises OSError."""
        if self.writer is not None:
            if self._lifecycle.terminated and self.run.filter is not None:
                self.run.filter.leave_out_unless_ready(_FILTER_PATIENCE_S)
            self._finish_file()

    def finish_bare(self) -> None:
        """Finish a file that `finish` could not, without the filter's result. Raises OSError."""
        if self.writer is not None:
            self.writer, self.run.filter = None, None
            self.result = self.run.close(time.monotonic_ns())

    def _finish_file(self, following: Path | None = None, error: OSError | None = None) -> "RunDocument":
        """Finish the present file and return its result; `following` is the next one, if any. Raises OSError.

        One that is out of reach is no part of the recording: its result says that it is not finished.
        """
        if self.writer is None:
            raise InputError("nothing is being recorded")
        run, writer, now_ns = self.run, self.writer, time.monotonic_ns()
        goes_on = f"continued in {following.name}" if following is not None else ""
        self.lost = why_lost(writer, error)
        if goes_on and not self.lost:
            self.event("acquisition", goes_on)
        try:
            self.result = result = run.give_up(now_ns) if self.lost else run.finish(now_ns)
        except OSError as refusal:
            self.lost = why_lost(writer, refusal)
            if not self.lost:
                raise
            self.result = result = run.give_up(now_ns)
        self.writer = None
        if self.lost:
            self.find(lifecycle.DISK, f"{self.lost} Recording goes on: {goes_on}." if goes_on else self.lost)
        continued = power_on.continued(
            self.file_info, self.file_info, writer.path, result["log_sha256"] or "", run.first_stamp_ns or 0
        )
        memory = "" if run.filter is None else run.filter.memory()
        self._next_info = metadata.naming(replace(continued, memory=memory), None)
        if result["finished"]:
            passes, converged = sources.of_document(result).passes, "final" not in result or result["converged"]
            self._parts.append({"log": result["log"], "converged": converged, "passes": passes})
            if len(self._parts) > 1:
                result["parts"] = list(self._parts)
        self._raise_defect()
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
