"""What an acquisition does with packets, requests and the passing of time.

Nothing here knows threads, processes or sockets: the engine's worker calls these methods, one after the other.
"""

import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import TYPE_CHECKING

import numpy as np

from filters import specification
from filters.errors import InputError
from filters.motion.profile import Profile
from imutui.estimate_history import HistorySnapshot
from imutui.instrument.clock import Clock, Stamp
from imutui.instrument.registry import INSTRUMENTS
from imutui.logbook.line_advice import HELD_UP_S, LossAdvice
from imutui.logbook.session_info import SessionInfo
from imutui.session.channel_statistics import ChannelStatistics
from imutui.session.commanded_table import CommandedTable
from imutui.session.event_log import INFORMATION, WARNING
from imutui.session.guidance import Guidance, describe
from imutui.session.identity import not_said
from imutui.session.lifecycle import Lifecycle
from imutui.session.metadata import reconfigured
from imutui.session.plan import HistoryWish, Plan, RecordingWish
from imutui.session.reader_thread import BLOCK_NS, PacketArrival, Reader, ZeroingFinished
from imutui.session.recent_packets import RecentPackets
from imutui.session.reconnection import LineLost, LineReturned, StillAway
from imutui.session.recorder import Recorder
from imutui.session.requests import FilterChanges
from imutui.session.snapshot import ProfileDescription, StatisticsSnapshot
from imutui.session.timebase import Timebase
from imutui.session.watches import (
    ClockStepMonitor,
    FoxgloveFollower,
    GravityCheck,
    LineWatch,
    Moment,
    News,
    StatusWords,
    gap_text,
)

if TYPE_CHECKING:
    from filters.health.finding import HealthEntry
    from imutui.logbook.results import RunDocument

_LONGEST_WAIT_NS = 5_000_000_000


class Acquisition:
    """One acquisition from its first packet to its last. Not thread-safe.

    `clock` makes stamps of the unit's counter, `reader` carries out what must be said to the unit, `foxglove`
    serves what is recorded, `table` is one under command. `observe` shows viewers what is public here.
    Raises InputError if the filter could not run with what is asked; the message names it.
    """

    def __init__(
        self,
        plan: Plan,
        info: SessionInfo,
        clock: Clock,
        reader: Reader,
        lifecycle: Lifecycle,
        foxglove: FoxgloveFollower | None = None,
        table: CommandedTable | None = None,
    ) -> None:
        self._clock = clock
        self._unstamped: deque[PacketArrival] = deque()  # they wait until the clock is sure of when they were sampled
        self.reader = reader
        self.lifecycle = lifecycle
        self.started_ns = time.monotonic_ns()
        self.timebase = Timebase.now()
        self.recorder = Recorder(plan, info, lifecycle, self.timebase)
        self._instrument = INSTRUMENTS[plan.instrument]
        scaling = self._instrument.scaling(plan.rate_range_dps, plan.accel_range_g)
        self.recent = RecentPackets(scaling)
        self._statistics = ChannelStatistics(scaling, specification.of_model(info.instrument))
        self.status = StatusWords(self._instrument)
        self.guidance = Guidance(self.recorder, self.record, table)
        self.zeroing: Future[str] | None = None  # what will be said of it, while packets pause for it
        self._line_errors = (0, 0, 0)
        self._last_stamp_ns = self.started_ns
        self._last_read_ns = 0
        self.line = LineWatch(info, self.timebase, self._instrument.packets_hz(plan.rate_hz))
        watches = self.line, self.status, GravityCheck(self._instrument), ClockStepMonitor(self.timebase)
        self._news: list[Callable[[Moment], News]] = [watch.news for watch in watches]
        if foxglove is not None:
            self._news.append(foxglove.news)
        self.loss_advice = LossAdvice(info.port, info.firmware)
        self.health: list[HealthEntry] = []  # faults of the channels in the present run of samples

    # -- what comes from the reader -------------------------------------------------------------------------------

    def packets(self, arrivals: Sequence[PacketArrival]) -> None:
        """Use packets, each as soon as its stamp is sure. Raises OSError if the disk is full."""
        self._unstamped += arrivals
        stamps = list[Stamp]()
        for arrival in arrivals:
            stamps += self._clock.take(
                arrival.packet.ticks,
                arrival.host_ns,
                contiguous=arrival.contiguous,
                quiet=arrival.quiet,
                behind=arrival.behind,
                requested_ns=arrival.requested_ns,
            )
        self._use(stamps)

    def held_packets(self, until_ns: int) -> None:
        """Use packets that were held long enough for others to make their stamps sure. Raises OSError.

        `until_ns`: until when packets that came were handed on; later ones may be on their way.
        """
        if self._unstamped:
            self._use(self._clock.due(until_ns))

    def _use(self, stamps: list[Stamp]) -> None:
        arrivals, events = [self._unstamped.popleft() for _ in stamps], self.recorder.events
        first = 0
        try:
            # what was read while the worker was held up may be of after the end
            while first < len(stamps) and not self.recorder.duration.has_all(arrivals[first].host_ns):
                events.handled_ns = arrivals[first].host_ns
                if self.recorder.begins_with_packet:
                    self.line.begin_recording()
                    self.recorder.begin_planned()
                else:
                    self.recorder.rotate_if_full(arrivals[first].host_ns)
                last = self._together(arrivals, stamps, first)
                self._use_block(arrivals[first:last], stamps[first:last])
                first = last
        finally:
            events.handled_ns = None

    def _together(self, arrivals: list[PacketArrival], stamps: list[Stamp], first: int) -> int:
        """End of the packets of which nothing is to be told; one of which something is stands alone."""
        is_first = self.recorder.pipeline.started_ns is None or not self.lifecycle.streaming.is_set()
        if stamps[first].gap is not None or is_first or self.line.is_away:
            return first + 1
        full_ns = self.recorder.full_ns()
        last = first + 1
        while last < len(stamps) and stamps[last].gap is None and arrivals[last].host_ns < full_ns:
            last += 1
        return self.recorder.duration.until(stamps, first, last)

    def _use_block(self, arrivals: list[PacketArrival], stamps: list[Stamp]) -> None:
        pipeline, newest, stamp = self.recorder.pipeline, arrivals[-1], stamps[-1]
        bad, discarded, doubled = self._line_errors
        self._line_errors = newest.bad_checksums, newest.discarded_bytes, newest.doubled
        pipeline.add_line_errors(
            newest.bad_checksums - bad, newest.discarded_bytes - discarded, newest.doubled - doubled
        )
        lost = pipeline.counters.lost_packets
        stamped = [(each.packet, at, each.host_ns) for each, at in zip(arrivals, stamps, strict=True)]
        counts = pipeline.packets(stamped)
        self.recorder.raise_defect()
        lost = pipeline.counters.lost_packets - lost
        for _, at, host_ns in stamped:
            if lost or host_ns - at.monotonic_ns > HELD_UP_S * 1e9:
                self.loss_advice.packet(lost, host_ns / 1e9, (host_ns - at.monotonic_ns) / 1e9)
        self._last_stamp_ns, self._last_read_ns = stamp.monotonic_ns, newest.host_ns
        t = (np.array([at.monotonic_ns for at in stamps]) - self.started_ns) / 1e9
        self.recent.add(t, counts)
        self.status.take(packet for packet, _, _ in stamped)
        if stamp.gap is not None:
            self._statistics.interrupt()
        self._statistics.add(t, counts)
        for each in arrivals:
            if each.requested_ns is not None:
                self.line.polled_rate.answered(each.requested_ns)
        if not self.lifecycle.streaming.is_set():
            self._first_packet()
        back = self.line.back(stamp)
        if back is not None or stamp.gap is not None:
            self.event("gap", back or gap_text(stamp), WARNING)
        self.recorder.duration.add(stamps[0].monotonic_ns)
        self.recorder.duration.add(stamp.monotonic_ns)

    def _first_packet(self) -> None:
        info = self.recorder.info
        self.lifecycle.first_packet()
        self.event("acquisition", f"connected to {info.port}, first packet")
        unsaid = not_said(info.serial_number, info.firmware)
        if unsaid is not None:
            self.event("acquisition", unsaid, WARNING)
        plan = self.recorder.plan
        if "baud" in plan.explicit and plan.baud != info.baud:
            said = f"the unit keeps its own speed, {info.baud} baud: {plan.baud} baud is only where it was looked for"
            self.event("acquisition", said, WARNING)
        if plan.ends_unwatched_s is not None:
            self.event("acquisition", f"a virtual unit: all ends {plan.ends_unwatched_s:g} s after the last viewer")

    def poll_unanswered(self) -> None:
        """Take note of a poll that was not answered."""
        self.recorder.pipeline.poll_unanswered()
        self._statistics.interrupt()
        self.line.polled_rate.unanswered()

    def zeroing_finished(self, event: ZeroingFinished) -> None:
        """Go on after the pause: packets on either side of it do not belong together, nor do their biases."""
        before = self.recent.mean()
        self._use(self._clock.interrupt())
        self.recent.interrupt()
        self._statistics.interrupt()
        self.line.polled_rate.interrupt()
        self.recorder.begin_run()
        pending, self.zeroing = self.zeroing, None
        said = event.in_words(
            None if before is None else before[:3], self._instrument.zeroing_patience_s(event.argument)
        )
        self.event("acquisition", said, WARNING if event.seconds is None else INFORMATION)
        if pending is not None and event.seconds is None:
            pending.set_exception(InputError(said))
        elif pending is not None:
            pending.set_result(said)

    def line_changed(self, event: LineLost | StillAway | LineReturned) -> None:
        """The line is lost, something else is waited for, or the unit is back: packets on either side stand apart."""
        match event:
            case LineLost():
                said: str | None = self.line.lost(event)
                self.guidance.stop("the line to the unit is lost")
                if self.zeroing is not None:
                    self.abandon_zeroing(f"{event.message} Zero the rate sensors when the unit is back.")
                    self.zeroing = None
                    self.recorder.begin_run()  # whether they are zeroed is not known
            case StillAway():
                said = self.line.still_away(event)
            case LineReturned():
                said = None  # with the first packet, which is next
                self._use(self._clock.interrupt(lossy=True))
                self.line.returned(event, self._last_stamp_ns)
                self.recent.interrupt()
                self._statistics.interrupt()
        if said is not None:
            self.event("acquisition", said, WARNING)

    def every_second(self) -> None:
        """See everything onto the disk, advance the guide, and look whether packets stopped or the clock was set."""
        now = time.monotonic_ns()
        self.recorder.events.handled_ns = written_ns = self._written_ns(now)
        try:
            self.recorder.pipeline.flush(written_ns)
            if self.recorder.look_after_file(now):
                self._end_recording()
            self.guidance.look(now)
            moment = self._moment(now)
            if self.line.is_to_be_asked(moment):
                self.reader.ask_again()
            for news in self._news:
                for text, level in news(moment):
                    self.event("acquisition", text, level)
            self._look_at_health()
            for name, text in self.recorder.pipeline.news():
                self.event(name, text, WARNING if name == "cause" else INFORMATION)
        finally:
            self.recorder.events.handled_ns = None

    def _look_at_health(self) -> None:
        """Look for faults of the channels; each one is an event when it is found."""
        known = {(entry["channel"], entry["kind"]) for entry in self.health}
        self.health = self.recorder.pipeline.health()
        for entry in self.health:
            if (entry["channel"], entry["kind"]) not in known:
                self.event("health", entry["said"], WARNING)

    def _written_ns(self, now_ns: int) -> int:
        """Return the time at which a message of now is written: packets that were read since are written behind it.

        On a busy machine they wait for longer than a block.
        """
        longest_ns = BLOCK_NS if self.reader.last_packet_ns <= self._last_read_ns else _LONGEST_WAIT_NS
        return self._last_read_ns if now_ns - self._last_read_ns < longest_ns else now_ns

    def look_at_table(self) -> None:
        """Write what a table under command measures, and command what comes next; raises OSError."""
        if self.guidance.table is not None:
            now = time.monotonic_ns()
            self.recorder.events.handled_ns = written_ns = self._written_ns(now)
            try:
                self.guidance.look_at_table(now, written_ns, lambda: not self._is_silent(now))
            finally:
                self.recorder.events.handled_ns = None

    def _is_silent(self, now_ns: int) -> bool:
        """Return True if the unit has been silent for so long that a table is stopped."""
        return self.line.falls_silent(self._moment(now_ns))

    def _moment(self, now_ns: int) -> Moment:
        silent_s = (now_ns - self.reader.last_packet_ns) / 1e9
        expected = self.zeroing is not None or not self.lifecycle.streaming.is_set()
        recorder, mean = self.recorder, self.recent.mean()
        accels_g = None if mean is None else mean[3:6] / 1e3
        return Moment(silent_s, expected, accels_g, recorder.info, recorder.motion)

    def why_over(self, now_ns: int) -> str | None:
        """That the end has come without anybody's asking, in words; None if it has not."""
        return self.recorder.why_over(now_ns) or self.guidance.why_over()

    def look_back(self) -> None:
        """Take note, before the file is finished, of what must be said at the end; raises OSError."""
        # as it was when the end was asked for: since then the unit was told to be quiet
        asked_ns = self.lifecycle.stopping_since_ns
        then = None if asked_ns is None else self._moment(asked_ns)
        for finding, is_said in self.line.at_the_end(time.monotonic_ns(), then):
            self.recorder.find(finding["exit_code"], finding["text"], is_said=is_said)
        if self.lifecycle.ended_by:
            self.event("acquisition", f"ended by {self.lifecycle.ended_by}")

    def use_held(self) -> None:
        """Use the packets that still wait for others to make their stamps sure; none comes any more. Raises OSError."""
        self._use(self._clock.release())

    def finish(self) -> None:
        """Finish the file, if there is one. Raises OSError."""
        self.recorder.finish()

    def finish_bare(self) -> None:
        """Finish a file that `finish` could not, without the filter's result. Raises OSError."""
        self.recorder.finish_bare()

    def abandon_zeroing(self, message: str) -> None:
        """Let whoever waits for the unit to zero its rate sensors know that nothing comes any more."""
        if self.zeroing is not None:
            self.zeroing.set_exception(InputError(message))

    # -- what viewers ask for -------------------------------------------------------------------------------------

    def history(self, wish: HistoryWish) -> HistorySnapshot:
        """The past of the present run of samples, as far as a viewer lacks it."""
        pipeline = self.recorder.pipeline
        return pipeline.history.piece(pipeline.first_stamp_ns or 0, wish)

    def channel_statistics(self, channel: int) -> StatisticsSnapshot:
        """Allan deviation, spectrum and histogram of a channel; InputError if there is no such channel."""
        return self._statistics.snapshot(channel, self._since_start_s())

    def begin_statistics(self) -> None:
        """Begin the statistics of the channels anew."""
        self._statistics.begin(self._since_start_s())

    def _since_start_s(self) -> float:
        return (time.monotonic_ns() - self.started_ns) / 1e9

    def mark(self, text: str, who: str = "") -> None:
        """Write the operator's mark; while guided a remark, since a mark would begin the profile's next dwell.

        `who`: who made it, which an event of its own says; readers take the mark's text as it is.

        Raises InputError if nothing is being recorded.
        """
        if self.recorder.recording is None:
            raise InputError(
                "nothing is being recorded, so there is no file to put the mark into; start recording first"
            )
        name = "mark" if self.guidance.guide is None else "remark"
        self.event(name, text)
        if who:
            self.event("acquisition", f'{name} "{text}" by {who}')

    def guide(self, do: str, wish: RecordingWish, who: str, *, may_move: bool) -> None:
        """Carry out a request of the guide, see `Guidance.do`; an event says first who asked for it."""
        self.event("acquisition", f"guide: {do}, asked by {who}")
        self.guidance.do(do, wish, may_move=may_move)

    def record(self, wish: RecordingWish) -> str:
        """Begin a recording; returns its path. What is wished but the note stays for later ones.

        Raises InputError if something is being recorded, the unit is zeroing, or the disk does not take it.
        """
        self._refuse_while_zeroing()
        if self.recorder.recording is not None:
            raise InputError(f"already recording to {self.recorder.recording.writer.path}")
        self.recorder.record(wish)
        self.guidance.forget()
        self.line.begin_recording()
        assert self.recorder.recording is not None
        return str(self.recorder.recording.writer.path)

    def stop_recording(self, who: str = "") -> "RunDocument":
        """Finish the file; the acquisition, its filter included, goes on without one.

        `who`: who asked for it, for an event at the end of the file.

        Raises InputError if nothing is being recorded, or the file is lost.
        Raises OSError if the disk does not take the end.
        """
        recording = self.recorder.recording
        if recording is not None and who:
            self.event("acquisition", f"recording ended by {who}")
        result = self._end_recording()
        if recording is not None and recording.vanished is not None and not result["finished"]:
            raise InputError(recording.vanished.words)
        return result

    def configure(self, changes: FilterChanges) -> None:
        """Take another reference or other effects; the filter begins anew with them.

        Raises InputError if something is being recorded, the unit is zeroing, or the filter could not run with them.
        """
        self._refuse_while_zeroing()
        recorder = self.recorder
        if recorder.recording is not None:
            raise InputError("finish the recording first: r. A file has one reference and one set of effects")
        recorder.configure(*reconfigured(recorder.plan, recorder.info, changes))
        self.guidance.forget()
        plan = recorder.plan
        source = plan.reference_file[0]
        said = f"reference {plan.reference}{f' from {source}' if source else ''}"
        said += ", with effects" if plan.effects else ", without effects"
        off = plan.filter != "none" and recorder.info.filter == "none"
        said += ": recorded without the filter, to be traced afterwards" if off else ": the filter begins anew"
        self.event("acquisition", said)

    def begin_zeroing(self, argument: int) -> "Future[str]":
        """Have the unit zero its rate sensors; returns what will say what came of it.

        Raises InputError if something is being recorded, it is zeroing already, or the acquisition is ending.
        """
        self._refuse_while_zeroing()
        if self.recorder.recording is not None:
            raise InputError("finish the recording first: r. Zeroing would put a step into the file")
        if self.lifecycle.state != "running":
            raise InputError(f"the acquisition is {self.lifecycle.state}; zero the rate sensors while it runs")
        if self.line.is_away:
            raise InputError("the unit is away; zero its rate sensors when it is back")
        self.zeroing = Future()
        self.event("acquisition", f"zeroing the rate sensors (argument {argument}); packets pause")
        self.reader.zero(argument)
        return self.zeroing

    def profile(self) -> ProfileDescription | None:
        """The profile that the reference comes from, if it comes from one."""
        recorder = self.recorder
        if not isinstance(recorder.motion, Profile):
            return None
        return describe(recorder.motion, *recorder.plan.reference_file)

    # -- one after the other --------------------------------------------------------------------------------------

    def event(self, name: str, text: str, level: int = INFORMATION) -> None:
        """Write an event or a mark into the file, if there is one, and show it to viewers; raises OSError."""
        self.recorder.event(name, text, level)

    def _refuse_while_zeroing(self) -> None:
        if self.zeroing is not None:
            raise InputError("the unit is zeroing its rate sensors; wait until it is done")

    def _end_recording(self) -> "RunDocument":
        """Finish the recording; the acquisition goes on without one."""
        self._use(self._clock.release())
        result = self.recorder.end_recording()
        self.guidance.recording_ended(time.monotonic_ns())
        return result
