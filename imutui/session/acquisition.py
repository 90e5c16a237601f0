"""What an acquisition does with packets, requests and the passing of time.

Nothing here knows threads, processes or sockets: the engine's worker calls these methods, one after the other.
"""

import time
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from filters.motion.profile import Profile
from imutui.instrument.clock import Clock, Stamp
from imutui.instrument.crossbow import Scaling
from imutui.logbook.line_advice import LossAdvice
from imutui.logbook.session_info import SessionInfo
from imutui.plain_text import NOTE_LIMIT, one_line
from imutui.session import exit_codes, observe, operator_guide, previous_log, zeroing
from imutui.session.disk_space import FreeSpace, disk_message
from imutui.session.duration import Duration
from imutui.session.event_log import EventLog
from imutui.session.identity import not_said
from imutui.session.lifecycle import Lifecycle
from imutui.session.line_watch import LineState, LineWatch
from imutui.session.metadata import check_live, effects_of, motion_of, reconfigured
from imutui.session.observe import AcquisitionView
from imutui.session.packet_stamps import PacketStamps, StampedPacket, gap_text
from imutui.session.plan import Plan, RecordingWish
from imutui.session.reader_thread import PacketArrival, Reader, ZeroingFinished
from imutui.session.recent_packets import RecentPackets
from imutui.session.reconnection import LineLost, LineReturned, StillAway
from imutui.session.recording import Recording
from imutui.session.requests import FilterChanges
from imutui.session.sample_pipeline import SamplePipeline
from imutui.session.snapshot import ProfileDescription, Snapshot
from imutui.session.timebase import ClockStepMonitor, EventClock, Timebase

if TYPE_CHECKING:
    from imutui.logbook.results import ResultDocument

INFORMATION, WARNING, ERROR = 20, 30, 40
"""Levels of events, as /rosout has them."""

_FILTER_PATIENCE_S = 0.8
_MOST_FINDINGS = 20


class Acquisition:
    """One acquisition from its first packet to its last. Not thread-safe.

    Parameters
    ----------
    plan : Plan
        What is asked.
    info : SessionInfo
        Metadata of its logs.
    clock : Clock
        From the unit's time counter to stamps.
    reader : Reader
        Carries out what must be said to the unit.
    lifecycle : Lifecycle
        Where it stands.

    Attributes
    ----------
    result : ResultDocument or None
        Of the last recording that was finished.

    Raises
    ------
    ValueError
        If the filter could not run with what is asked; the message names it.
    """

    def __init__(self, plan: Plan, info: SessionInfo, clock: Clock, reader: Reader, lifecycle: Lifecycle) -> None:
        self.result: ResultDocument | None = None
        self._plan = plan
        self._info = info
        self._stamps = PacketStamps(clock)
        self._reader = reader
        self._lifecycle = lifecycle
        self._started_ns = time.monotonic_ns()
        self._timebase = Timebase.now()
        self._clock_steps = ClockStepMonitor(self._timebase)
        self._events = EventLog(self._timebase)
        self._recent = RecentPackets(Scaling(plan.rate_range_dps, plan.accel_range_g))
        self._free_space = FreeSpace()
        self._motion = motion_of(plan)
        self._effects = effects_of(plan, info)
        check_live(info, self._motion, self._effects)
        self._pipeline = SamplePipeline(info, self._timebase, None, self._motion, self._effects)
        self._recording: Recording | None = None
        self._guide: operator_guide.Guide | None = None
        self._zeroing: Future[str] | None = None
        self._begins_recording = plan.record
        self._line_errors = (0, 0)
        self._last_stamp_ns = self._started_ns
        self._event_clock = EventClock()
        self._line = LineWatch(info, self._timebase)
        self._loss_advice = LossAdvice(info.port, info.firmware)
        self._duration = Duration(plan.duration_s)
        self._has_recorded = False
        self._is_out_of_space = False

    # -- what comes from the reader -------------------------------------------------------------------------------

    def packet(self, arrival: PacketArrival) -> None:
        """Use a packet, as soon as its stamp is sure. Raises OSError if the disk is full."""
        self._use(self._stamps.take(arrival))

    def held_packets(self) -> None:
        """Use packets that were held long enough for others to make their stamps sure. Raises OSError."""
        self._use(self._stamps.due(time.monotonic_ns()))

    def _use(self, packets: list[StampedPacket]) -> None:
        for one in packets:
            # what was read while the worker was held up may be of after the end
            if not self._duration.has_all():
                with self._event_clock.at(one.arrival.host_ns):
                    self._use_one(one.arrival, one.stamp)

    def _use_one(self, arrival: PacketArrival, stamp: Stamp) -> None:
        packet = arrival.packet
        if self._begins_recording:
            # not before: a unit that sends nothing must not cost the file that --force would replace
            self._begins_recording = False
            self._begin_recording(self._plan.note, Path(self._plan.output) if self._plan.output else None)
        elif self._recording is not None and self._is_full(self._recording, arrival.host_ns):
            self._rotate(self._recording)
        bad, discarded = self._line_errors
        self._line_errors = arrival.bad_checksums, arrival.discarded_bytes
        self._pipeline.add_line_errors(arrival.bad_checksums - bad, arrival.discarded_bytes - discarded)
        lost = self._pipeline.counters.lost_packets
        self._pipeline.packet(packet, stamp, arrival.host_ns)
        late_s = (arrival.host_ns - stamp.monotonic_ns) / 1e9
        self._loss_advice.packet(self._pipeline.counters.lost_packets - lost, arrival.host_ns / 1e9, late_s)
        self._last_stamp_ns = stamp.monotonic_ns
        self._recent.add((stamp.monotonic_ns - self._started_ns) / 1e9, packet)
        if arrival.requested_ns is not None:
            self._line.answered(arrival.requested_ns)
        if not self._lifecycle.streaming.is_set():
            self._lifecycle.first_packet()
            self.event("acquisition", f"connected to {self._info.port}, first packet")
            unsaid = not_said(self._info.serial_number, self._info.firmware)
            if unsaid is not None:
                self.event("acquisition", unsaid, WARNING)
        back = self._line.back(stamp)
        if back is not None or stamp.gap is not None:
            self.event("gap", back or gap_text(stamp), WARNING)
        self._duration.add(stamp.monotonic_ns)

    def poll_unanswered(self) -> None:
        """Take note of a poll that was not answered."""
        self._pipeline.poll_unanswered()
        self._line.unanswered()

    def zeroing_finished(self, event: ZeroingFinished) -> None:
        """Go on after the pause: packets on either side of it do not belong together, nor do their biases."""
        before = self._recent.rates_dps()
        self._use(self._stamps.interrupt())
        self._recent.interrupt()
        self._line.interrupt()
        self._begin_run(None)
        pending, self._zeroing = self._zeroing, None
        if event.seconds is None:
            said = zeroing.unanswered(event.argument)
            self.event("acquisition", said, WARNING)
            if pending is not None:
                pending.set_exception(ValueError(said))
            return
        said = zeroing.in_words(event.argument, event.seconds, before)
        self.event("acquisition", said)
        if pending is not None:
            pending.set_result(said)

    def line_changed(self, event: LineLost | StillAway | LineReturned) -> None:
        """The line is lost, something else is waited for, or the unit is back: packets on either side stand apart."""
        match event:
            case LineLost():
                said: str | None = self._line.lost(event)
                if self._zeroing is not None:
                    self.abandon_zeroing(f"{event.message} Zero the rate sensors when the unit is back.")
                    self._zeroing = None
                    self._begin_run(None)  # whether they are zeroed is not known
            case StillAway():
                said = self._line.still_away(event)
            case LineReturned():
                said = None  # with the first packet, which is next
                self._use(self._stamps.interrupt(lossy=True))
                self._line.returned(event, self._last_stamp_ns)
                self._recent.interrupt()
        if said is not None:
            self.event("acquisition", said, WARNING)

    def every_second(self) -> None:
        """See everything onto the disk, advance the guide, and look whether packets stopped or the clock was set."""
        now = time.monotonic_ns()
        with self._event_clock.at(now):
            self._pipeline.flush(now)
            if self._recording is not None:
                self._look_after_file(self._recording, now)
            if self._guide is not None:
                self._guide.advance(now)
            line = self._line_state(now)
            if self._line.is_to_be_asked(line):
                self._reader.ask_again()
            for text, warns in self._line.each_second(line):
                self.event("acquisition", text, WARNING if warns else INFORMATION)
            step = self._clock_steps.check()
            if step is not None:
                self.event(
                    "acquisition", f"the system clock stepped by {step:+.3f} s; stamps are not affected", WARNING
                )

    def _line_state(self, now_ns: int) -> LineState:
        silent_s = (now_ns - self._reader.last_packet_ns) / 1e9
        expected = self._zeroing is not None or not self._lifecycle.streaming.is_set()
        return LineState(silent_s, expected)

    def is_over(self, now_ns: int) -> bool:
        """Whether the plan's duration is over, or the disk's room."""
        return self._is_out_of_space or self._duration.is_over(now_ns)

    def look_back(self) -> None:
        """Take note, before the file is finished, of what must be said at the end; raises OSError."""
        # as it was when the end was asked for: since then the unit was told to be quiet
        asked_ns = self._lifecycle.stopping_since_ns
        line = None if asked_ns is None else self._line_state(asked_ns)
        for finding, is_said in self._line.at_the_end(time.monotonic_ns(), line):
            self._find(finding["exit_code"], finding["text"], is_said=is_said)

    def _find(self, exit_code: int, text: str, *, is_said: bool = False) -> None:
        if len(self._lifecycle.findings) < _MOST_FINDINGS:  # a folder that is emptied each second is known by then
            self._lifecycle.findings.append({"exit_code": exit_code, "text": text})
        if not is_said:
            self.event("acquisition", text, WARNING)

    def finish(self) -> None:
        """Finish the file, if there is one; nothing comes any more. Raises OSError."""
        self._use(self._stamps.release())
        if self._recording is not None:
            if self._lifecycle.terminated and self._pipeline.filter is not None:
                self._pipeline.filter.leave_out_unless_ready(_FILTER_PATIENCE_S)
            self._finish_recording(self._recording)

    def abandon_zeroing(self, message: str) -> None:
        """Let whoever waits for the unit to zero its rate sensors know that nothing comes any more."""
        if self._zeroing is not None:
            self._zeroing.set_exception(ValueError(message))

    def disk_message(self, error: OSError) -> str:
        """Words for a disk that does not take what is written."""
        said = disk_message(None if self._recording is None else self._recording.writer, error)
        before = [finding["text"] for finding in self._lifecycle.findings if finding["exit_code"] == exit_codes.DISK]
        return " ".join([said, *before])

    def disk_failed(self, error: OSError) -> None:
        """Go on in another file if the disk of the present one has gone; raises the error if that is not what it is."""
        recording = self._recording
        if recording is None or recording.writer.is_empty or recording.look(error) is None:
            raise error
        self._rotate(recording)

    # -- what viewers ask for -------------------------------------------------------------------------------------

    def snapshot(self, since: int) -> Snapshot:
        """State for viewers, with packets from number `since` on."""
        now = time.monotonic_ns()
        writer = None if self._recording is None else self._recording.writer
        folder = Path(self._plan.logs) if writer is None else writer.path.parent
        view = AcquisitionView(
            now_ns=now,
            started_ns=self._started_ns,
            last_packet_ns=self._reader.last_packet_ns,
            utc_ns=self._timebase.utc_ns(now),
            loss_advice=self._loss_advice.brief,
            plan=self._plan,
            info=self._info,
            state=self._lifecycle.state,
            error=self._lifecycle.error,
            findings=tuple(finding["text"] for finding in self._lifecycle.findings),
            zeroing=self._zeroing is not None,
            reconnecting=self._line.snapshot(now),
            follows_profile=isinstance(self._motion, Profile),
            pipeline=self._pipeline,
            recording=self._recording,
            free_bytes=self._free_space.free_bytes(folder, now),
            recent=self._recent,
            events=self._events,
            guide=self._guide,
        )
        return observe.snapshot(view, since)

    def mark(self, text: str) -> None:
        """Write the operator's mark; while guided a remark, since a mark would begin the profile's next dwell.

        Raises
        ------
        ValueError
            If nothing is being recorded.
        """
        if self._recording is None:
            raise ValueError(
                "nothing is being recorded, so there is no file to put the mark into; start recording first"
            )
        self.event("mark" if self._guide is None else "remark", text)

    def record(self, wish: RecordingWish) -> str:
        """Begin a recording; returns its path. What is wished but the note stays for later ones.

        Raises
        ------
        ValueError
            If something is being recorded, the unit is zeroing, or the disk does not take it.
        """
        self._refuse_while_zeroing()
        if self._recording is not None:
            raise ValueError(f"already recording to {self._recording.writer.path}")
        asked = {key: getattr(wish, key) for key in ("operator", "place", "table") if getattr(wish, key)}
        limits = {key: getattr(wish, key) for key in ("rotate_minutes", "rotate_mb") if getattr(wish, key) is not None}
        before = self._plan, self._info
        self._plan = replace(self._plan, **asked, **limits)
        self._info = replace(self._info, **asked)
        try:
            return self._begin_recording(wish.note or self._plan.note, None)
        except OSError as error:  # nothing has been recorded yet, so nothing is lost but this wish
            self._plan, self._info = before
            raise ValueError(disk_message(None, error)) from error

    def stop_recording(self) -> "ResultDocument":
        """Finish the file; the acquisition, its filter included, goes on without one.

        Raises
        ------
        ValueError
            If nothing is being recorded, or the file is lost.
        OSError
            If the disk does not take the end.
        """
        if self._recording is None:
            raise ValueError("nothing is being recorded")
        recording = self._recording
        result = self._end_recording(recording)
        if recording.vanished is not None and not result["finished"]:
            raise ValueError(recording.vanished.words)
        return result

    def configure(self, changes: FilterChanges) -> None:
        """Take another reference or other effects; the filter begins anew with them.

        Raises
        ------
        ValueError
            If something is being recorded, the unit is zeroing, or the filter could not run with them.
        """
        self._refuse_while_zeroing()
        if self._recording is not None:
            raise ValueError("finish the recording first: r. A file has one reference and one set of effects")
        # refuses, before anything is changed, what the filter could not run with
        setup = reconfigured(self._plan, self._info, changes)
        self._plan, self._info, self._motion, self._effects = setup.plan, setup.info, setup.motion, setup.effects
        self._guide = None
        self._begin_run(None)
        source = self._plan.reference_file[0]
        said = f"reference {self._plan.reference}{f' from {source}' if source else ''}"
        said += ", with effects" if self._plan.effects else ", without effects"
        self.event("acquisition", f"{said}: the filter begins anew")

    def begin_zeroing(self, argument: int) -> "Future[str]":
        """Have the unit zero its rate sensors; returns what will say what came of it.

        Raises
        ------
        ValueError
            If something is being recorded, it is zeroing already, or the acquisition is ending.
        """
        self._refuse_while_zeroing()
        if self._recording is not None:
            raise ValueError("finish the recording first: r. Zeroing would put a step into the file")
        if self._lifecycle.state != "running":
            raise ValueError(f"the acquisition is {self._lifecycle.state}; zero the rate sensors while it runs")
        if self._line.is_away:
            raise ValueError("the unit is away; zero its rate sensors when it is back")
        self._zeroing = Future()
        self.event("acquisition", f"zeroing the rate sensors (argument {argument}); packets pause")
        self._reader.zero(argument)
        return self._zeroing

    def profile(self) -> ProfileDescription | None:
        """The profile that the reference comes from, if it comes from one."""
        if not isinstance(self._motion, Profile):
            return None
        return operator_guide.describe(self._motion, self._plan.reference_file[0])

    def guide(self, do: str, wish: RecordingWish) -> None:
        """Guide the operator through the profile: begin, next, cancel, resume; a recording that begins is as wished.

        Raises
        ------
        ValueError
            If that cannot be done now; the message says what next.
        """
        recording = self._recording is not None
        if do == "begin":
            begun = operator_guide.begin_guide(self._motion, self._plan.filter, self._guide, recording=recording)
            if not recording:
                self.record(wish)
            self._guide = begun
            self.event("acquisition", f"guide through {self._plan.reference_file[0]} begins")
            return
        if self._guide is None:
            raise ValueError("no guide is under way; begin one first")
        mark = self._guide.do(do, time.monotonic_ns(), recording=recording)
        if mark is not None:
            self.event("mark", mark)

    # -- files and runs of samples --------------------------------------------------------------------------------

    def event(self, name: str, text: str, level: int = INFORMATION) -> None:
        """Write an event or a mark into the file, if there is one, and show it to viewers; raises OSError."""
        now, text = self._event_clock.now_ns(), one_line(text, NOTE_LIMIT)
        self._events.add(name, text, now)
        self._pipeline.event(name, text, now, level)

    def _refuse_while_zeroing(self) -> None:
        if self._zeroing is not None:
            raise ValueError("the unit is zeroing its rate sensors; wait until it is done")

    def _begin_run(self, recording: Recording | None) -> None:
        """Begin another run of samples, into the recording's present file if there is one."""
        info, writer = (self._info, None) if recording is None else (recording.info, recording.writer)
        effects = effects_of(self._plan, info) if info.memory else self._effects
        self._pipeline = SamplePipeline(info, self._timebase, writer, self._motion, effects)
        self._events.forget_mark_times()
        if not self._has_recorded:
            self._duration.begin()

    def _begin_recording(self, note: str, path: Path | None) -> str:
        previous = None if self._has_recorded else self._previous_log()
        recording = Recording(self._plan, previous_log.told(self._info, previous), note, path)
        self._begin_run(recording)
        self._recording, self._guide = recording, None
        self._has_recorded = True
        self._duration.begin()
        self._line.begin_recording()
        self._events.clear_marks()
        self.event("acquisition", f"recording to {recording.writer.path.name}")
        if previous is not None:
            self.event("acquisition", previous.in_words(), INFORMATION if previous.finished else WARNING)
        if self._plan.rotates != bool(self._plan.rotate_minutes or self._plan.rotate_mb):
            why = "the reference is told from one log's first sample on"
            self.event("acquisition", f"the recording stays in one file: {why}", WARNING)
        return str(recording.writer.path)

    def _previous_log(self) -> previous_log.PreviousLog | None:
        """What this acquisition recorded before it was started anew, if that is to be told."""
        return previous_log.find(Path(self._plan.logs), self._info, finished_too=self._plan.unattended)

    def _is_full(self, recording: Recording, now_ns: int) -> bool:
        """Whether the recording goes on in another file, from this packet on."""
        started = self._pipeline.started_ns
        end_ns = self._lifecycle.stopping_since_ns
        if started is None or (end_ns is not None and now_ns >= end_ns):
            return False
        return recording.is_full((now_ns - started) / 1e9)

    def _look_after_file(self, recording: Recording, now_ns: int) -> None:
        """See whether the file is where it was made, and how much room its disk has."""
        recording.measure_growth(now_ns)
        if self._lifecycle.state == "running" and recording.look() is not None:
            self._rotate(recording)
            return
        path, guard = recording.writer.path, recording.guard
        free = self._free_space.free_bytes(path.parent, now_ns)
        short = guard.warn(guard.seconds_left(free, recording.growth.bytes_per_s()))
        if short is not None:
            self.event("acquisition", short, WARNING)
        full = guard.stop(path, free)
        if full is not None:
            self._find(exit_codes.DISK, full)
            self._end_recording(recording)
            self._is_out_of_space = self._plan.record

    def _rotate(self, recording: Recording) -> None:
        self._finish_recording(recording, recording.parts.next_path())
        before, vanished = recording.writer.path.name, recording.vanished
        recording.next_file()
        self._recording = recording
        self._begin_run(recording)
        why = "" if vanished is None else f": {vanished.words}"
        self.event("acquisition", f"part {recording.parts.number}, continues {before}{why}")

    def _finish_recording(self, recording: Recording, following: Path | None = None) -> "ResultDocument":
        """Finish the present file, and say so if it is not where it was made; `following` is the next one, if any."""
        vanished = recording.look()
        goes_on = None if following is None else f"continued in {following.name}"
        if vanished is not None and vanished.is_lost:
            self._pipeline.release_file()
        if vanished is not None:
            self._find(exit_codes.DISK, vanished.words + (f" Recording goes on: {goes_on}." if goes_on else ""))
        elif goes_on is not None:
            self.event("acquisition", goes_on)
        self.result = recording.finish_file(self._pipeline, time.monotonic_ns())
        self._recording = None
        if recording.vanished is not vanished and recording.vanished is not None:
            self._find(exit_codes.DISK, recording.vanished.words)
        return self.result

    def _end_recording(self, recording: Recording) -> "ResultDocument":
        """Finish the recording; the acquisition goes on without one."""
        self._use(self._stamps.release())
        result = self._finish_recording(recording)
        if self._guide is not None:
            self._guide.recording_ended(time.monotonic_ns())
        if result["finished"]:
            self.event("acquisition", f"finished {result['log']}")
        return result
