"""The present run of samples of an acquisition, the file that it goes into, and where the next one begins.

Nothing here knows packets' stamps, the line or viewers: `imutui.session.acquisition` calls these methods.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from filters.errors import InputError
from imutui.instrument.clock import Stamp
from imutui.instrument.registry import INSTRUMENTS
from imutui.logbook.session_info import SessionInfo
from imutui.plain_text import NOTE_LIMIT, one_line
from imutui.session import lifecycle, previous_log
from imutui.session.disk_space import FreeSpace, disk_message
from imutui.session.event_log import INFORMATION, WARNING, EventLog
from imutui.session.lifecycle import Lifecycle
from imutui.session.metadata import check_live, effects_of, motion_of
from imutui.session.plan import Plan, RecordingWish
from imutui.session.reader_thread import BLOCK_NS
from imutui.session.recording import MIN_FILE_S, Recording, close_file
from imutui.session.sample_pipeline import SamplePipeline
from imutui.session.timebase import Timebase

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument


# the packet that completes the last period may be on its way
_LEEWAY_NS = 250_000_000


class Duration:
    """Follows the time of what was recorded, from the first packet on, through all files of a recording."""

    def __init__(self, seconds: float | None) -> None:
        self._seconds = seconds
        self._from_ns: int | None = None
        self._until_ns = 0

    def begin(self) -> None:
        """Count anew, from the next packet on."""
        self._from_ns = None

    def add(self, stamp_ns: int) -> None:
        """Take a packet's stamp, monotonic."""
        self._from_ns = stamp_ns if self._from_ns is None else self._from_ns
        self._until_ns = stamp_ns

    def has_all(self, read_ns: int) -> bool:
        """Whether the packets reach the end, or one that was read then is too late to be waited for."""
        end_ns = self._end_ns()
        return end_ns is not None and (self._until_ns >= end_ns or read_ns >= self.late_ns())

    def until(self, stamps: Sequence[Stamp], first: int, last: int) -> int:
        """Of packets from `first` to before `last`, which there is nothing between: up to where they are recorded."""
        end_ns = self._end_ns()
        if end_ns is None:
            return last if self._seconds is None else first + 1
        return next((k + 1 for k in range(first, last) if stamps[k].monotonic_ns >= end_ns), last)

    def is_over(self, now_ns: int) -> bool:
        """Whether the end has come, by the packets or by the clock."""
        end_ns = self._end_ns()
        return end_ns is not None and (self._until_ns >= end_ns or now_ns >= end_ns + _LEEWAY_NS + BLOCK_NS)

    def late_ns(self) -> float:
        """When a packet is read too late to be waited for."""
        end_ns = self._end_ns()
        return math.inf if end_ns is None else end_ns + _LEEWAY_NS

    def _end_ns(self) -> int | None:
        if self._seconds is None or self._from_ns is None:
            return None
        return self._from_ns + round(self._seconds * 1e9)


_FILTER_PATIENCE_S = 0.8
_MOST_FINDINGS = 20


class Recorder:
    """Runs of samples, one after the other, with a file or without. Not thread-safe.

    `plan` and `info` are as they are in force, `motion` is what the reference says of it; `pipeline` is the present
    run, `recording` the file that it goes into, if there is one.
    Raises InputError if the filter could not run with what is asked; the message names it.
    """

    def __init__(
        self,
        plan: Plan,
        info: SessionInfo,
        lifecycle: Lifecycle,
        timebase: Timebase,
    ) -> None:
        self._take(plan, info)
        self._instrument = INSTRUMENTS[plan.instrument]
        self.result: RunDocument | None = None  # of the last recording that was finished
        self.recording: Recording | None = None
        self.duration = Duration(plan.duration_s)
        self.events = EventLog(timebase)
        self.begins_with_packet = plan.record  # the plan's recording
        self._lifecycle = lifecycle
        self._timebase = timebase
        self._free_space = FreeSpace()
        self._has_recorded = False
        self._is_out_of_space = False
        self.pipeline = SamplePipeline(info, timebase, None, self.motion, self._effects, self._instrument)

    # -- what is told ---------------------------------------------------------------------------------------------

    def event(self, name: str, text: str, level: int = INFORMATION) -> None:
        """Write an event or a mark into the file, if there is one, and show it to viewers; raises OSError."""
        text = one_line(text, NOTE_LIMIT)
        self.pipeline.event(name, text, self.events.add(name, text), level)

    def find(self, exit_code: int, text: str, *, is_said: bool = False) -> None:
        """Take note of what must be said at the end, and say it now unless it is said already. Raises OSError."""
        if len(self._lifecycle.findings) < _MOST_FINDINGS:  # a folder that is emptied each second is known by then
            self._lifecycle.findings.append({"exit_code": exit_code, "text": text})
        if not is_said:
            self.event("acquisition", text, WARNING)

    def disk_message(self, error: OSError) -> str:
        """Words for a disk that does not take what is written."""
        said = disk_message(None if self.recording is None else self.recording.writer, error)
        before = [finding["text"] for finding in self._lifecycle.findings if finding["exit_code"] == lifecycle.DISK]
        return " ".join([said, *before])

    # -- runs of samples ------------------------------------------------------------------------------------------

    def begin_run(self) -> None:
        """Begin another run of samples, into the present file if there is one."""
        recording = self.recording
        info, writer = (self.info, None) if recording is None else (recording.info, recording.writer)
        effects = effects_of(self.plan, info) if info.memory else self._effects
        self.pipeline = SamplePipeline(info, self._timebase, writer, self.motion, effects, self._instrument)
        self.events.forget_mark_times()
        if not self._has_recorded:
            self.duration.begin()

    def configure(self, plan: Plan, info: SessionInfo) -> None:
        """Take another reference or other effects; the filter begins anew with them.

        Raises InputError, before anything is changed, if it could not run with them.
        """
        self._take(plan, info)
        self.begin_run()

    def _take(self, plan: Plan, info: SessionInfo) -> None:
        motion, effects = motion_of(plan), effects_of(plan, info)
        check_live(info, motion, effects)
        self.plan, self.info, self.motion, self._effects = plan, info, motion, effects

    def why_over(self, now_ns: int) -> str | None:
        """That the plan's duration is over, or the disk's room, in words; None if neither is."""
        if self._is_out_of_space:
            return "the disk guard: there is no room for more"
        return f"its duration of {self.plan.duration_s:g} s" if self.duration.is_over(now_ns) else None

    # -- files ----------------------------------------------------------------------------------------------------

    def record(self, wish: RecordingWish) -> None:
        """Begin a recording as wished. What is wished stays for later ones, but not the note: it is of one recording.

        Raises InputError if the disk does not take it.
        """
        said = {key: value for key, value in asdict(wish).items() if value is not None}
        note = said.pop("note", self.plan.note)
        before = self.plan, self.info
        # the plan's own note does not come back after another one, or none, was said
        self.plan = replace(self.plan, **said, note=self.plan.note if wish.note is None else "")
        self.info = replace(self.info, **{key: said[key] for key in ("operator", "place", "table") if key in said})
        try:
            self.begin(note, None)
        except OSError as error:  # nothing has been recorded yet, so nothing is lost but this wish
            self.plan, self.info = before
            raise InputError(disk_message(None, error)) from error

    def describe(self, note: str | None, operator: str | None) -> None:
        """Change note and operator of the file that is being written; None leaves one as it is. Raises OSError.

        Raises InputError if nothing is being recorded.
        """
        if self.recording is None:
            raise InputError("nothing is being recorded, so there is no file to describe; start recording first")
        before = self.recording.info
        self.recording.describe(note, operator)
        now = self.recording.info
        self.pipeline.describe(now)
        if operator:
            self.plan, self.info = replace(self.plan, operator=operator), replace(self.info, operator=operator)
        for name in ("note", "operator"):
            was, is_now = getattr(before, name), getattr(now, name)
            if was != is_now:
                self.event("acquisition", f"{name}: {is_now or 'none'} (before: {was or 'none'})")

    def begin_planned(self) -> None:
        """Begin the recording that the plan asks for. Raises OSError."""
        # not before the first packet: a unit that sends nothing must not cost the file that --force would replace
        self.begins_with_packet = False
        self.begin(self.plan.note, Path(self.plan.output) if self.plan.output else None)

    def begin(self, note: str, path: Path | None) -> None:
        """Begin a recording and a run of samples in it; raises OSError."""
        previous = None
        if not self._has_recorded:  # what this acquisition recorded before it was started anew, if that is to be told
            previous = previous_log.find(Path(self.plan.logs), self.info, finished_too=self.plan.unattended)
        recording = Recording(self.plan, previous_log.told(self.info, previous), note, path)
        self.recording = recording
        self.begin_run()
        self._has_recorded = True
        self.duration.begin()
        self.events.clear_marks()
        self.event("acquisition", f"recording to {recording.writer.path.name}")
        if previous is not None:
            self.event("acquisition", previous.in_words(), INFORMATION if previous.finished else WARNING)
        if self.plan.rotates != bool(self.plan.rotate_minutes or self.plan.rotate_mb):
            why = "the reference is told from one log's first sample on"
            self.event("acquisition", f"the recording stays in one file: {why}", WARNING)

    def rotate_if_full(self, now_ns: int) -> None:
        """Go on in another file, from this packet on, if the present one is as long as it may be. Raises OSError."""
        started, end_ns = self.pipeline.started_ns, self._lifecycle.stopping_since_ns
        if self.recording is None or started is None or (end_ns is not None and now_ns >= end_ns):
            return
        if self.recording.is_full((now_ns - started) / 1e9):
            self._rotate(self.recording)

    def full_ns(self) -> float:
        """When the present file has had its time, or all has, monotonic; infinity if that never is."""
        started, limited = self.pipeline.started_ns, self.plan.rotates and self.plan.rotate_minutes > 0.0
        late_ns = self.duration.late_ns()
        if self.recording is None or started is None or not limited:
            return late_ns
        return min(late_ns, started + 1e9 * max(MIN_FILE_S, 60.0 * self.plan.rotate_minutes))

    def look_after_file(self, now_ns: int) -> bool:
        """See whether the file is where it was made; returns whether its disk is too full to go on. Raises OSError."""
        recording = self.recording
        if recording is None:
            return False
        recording.guard.add_size(now_ns, recording.writer.size)
        if self._lifecycle.state == "running" and recording.look() is not None:
            self._rotate(recording)
            return False
        path, guard = recording.writer.path, recording.guard
        free = self._free_space.free_bytes(path.parent, now_ns)
        short = guard.warn(free)
        if short is not None:
            self.event("acquisition", short, WARNING)
        full = guard.stop(path, free)
        if full is not None:
            self.find(lifecycle.DISK, full)
            self._is_out_of_space = self.plan.record
        return full is not None

    def free_bytes(self, now_ns: int) -> int | None:
        """Free space where the present recording goes, or the next one would."""
        folder = Path(self.plan.logs) if self.recording is None else self.recording.writer.path.parent
        return self._free_space.free_bytes(folder, now_ns)

    def disk_failed(self, error: OSError) -> None:
        """Go on in another file if the disk of the present one has gone; raises the error if that is not what it is."""
        recording = self.recording
        if recording is None or recording.writer.is_empty or recording.look(error) is None:
            raise error
        self._rotate(recording)

    def _rotate(self, recording: Recording) -> None:
        self._finish_file(recording, recording.next_path())
        before, vanished = recording.writer.path.name, recording.vanished
        recording.next_file()
        self.recording = recording
        self.begin_run()
        why = "" if vanished is None else f": {vanished.words}"
        self.event("acquisition", f"part {recording.part}, continues {before}{why}")

    def _finish_file(self, recording: Recording, following: Path | None = None) -> "RunDocument":
        """Finish the present file, and say so if it is not where it was made; `following` is the next one, if any."""
        vanished = recording.look()
        goes_on = None if following is None else f"continued in {following.name}"
        if vanished is not None and vanished.is_lost:
            self.pipeline.release_file()
        if vanished is not None:
            self.find(lifecycle.DISK, vanished.words + (f" Recording goes on: {goes_on}." if goes_on else ""))
        elif goes_on is not None:
            self.event("acquisition", goes_on)
        self.result = recording.finish_file(self.pipeline, time.monotonic_ns())
        self.recording = None
        self.raise_defect()
        if recording.vanished is not vanished and recording.vanished is not None:
            self.find(lifecycle.DISK, recording.vanished.words)
        return self.result

    def raise_defect(self) -> None:
        """Raise the exception by which the filter stopped, once; the file has all packets until then."""
        live = self.pipeline.filter
        if live is not None and live.defect is not None:
            error, live.defect = live.defect, None
            raise error

    def end_recording(self) -> "RunDocument":
        """Finish the recording; the run of samples, its filter included, goes on without a file.

        Raises InputError if nothing is being recorded.
        Raises OSError if the disk does not take the end.
        """
        if self.recording is None:
            raise InputError("nothing is being recorded")
        result = self._finish_file(self.recording)
        if result["finished"]:
            self.event("acquisition", f"finished {result['log']}")
        return result

    def finish(self) -> None:
        """Finish the file, if there is one; nothing comes any more. Raises OSError."""
        if self.recording is not None:
            if self._lifecycle.terminated and self.pipeline.filter is not None:
                self.pipeline.filter.leave_out_unless_ready(_FILTER_PATIENCE_S)
            self._finish_file(self.recording)

    def finish_bare(self) -> None:
        """Finish a file that `finish` could not, with nothing that the filter has to say. Raises OSError."""
        if self.recording is not None:
            recording, self.recording, self.pipeline.filter = self.recording, None, None
            self.result = close_file(recording.writer, self.pipeline, time.monotonic_ns())
