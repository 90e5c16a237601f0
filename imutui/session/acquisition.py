"""One acquisition: the consumers of its stream, in order, and the requests of viewers.

Nothing here knows threads, processes or sockets: the engine's worker calls these methods, one after the other.
"""

import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import TYPE_CHECKING

from filters import specification
from filters.errors import InputError
from filters.motion.profile import Profile
from imutui.estimate_history import HistorySnapshot
from imutui.instrument.registry import INSTRUMENTS
from imutui.logbook.log_time import Timebase
from imutui.logbook.session_info import SessionInfo
from imutui.plain_text import NOTE_LIMIT, one_line
from imutui.session.channel_statistics import ChannelStatistics, RecentPackets
from imutui.session.commanded_table import CommandedTable
from imutui.session.guidance import Guidance, describe
from imutui.session.lifecycle import Lifecycle
from imutui.session.metadata import reconfigured
from imutui.session.plan import FilterChanges, HistoryWish, Plan, RecordingWish
from imutui.session.reader_thread import BLOCK_NS, Reader, ZeroingFinished
from imutui.session.reconnection import LineLost
from imutui.session.recording import Recording
from imutui.session.snapshot import ProfileDescription, StatisticsSnapshot
from imutui.session.stream import INFORMATION, WARNING, Block, Broke, Consumer, Event, Said, Second, Why
from imutui.session.watches import ClockStepMonitor, EventLog, FoxgloveFollower, GravityCheck, LineWatch, StatusWords

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument

_LONGEST_WAIT_NS = 5_000_000_000


class Acquisition:
    """One acquisition from its first packet to its last. Not thread-safe.

    `reader` carries out what must be said to the unit, `foxglove` serves what is recorded, `table` is one under
    command. `observe` shows viewers what is public here.
    Raises InputError if the filter cannot run with the plan; the message names why.
    """

    def __init__(
        self,
        plan: Plan,
        info: SessionInfo,
        reader: Reader,
        lifecycle: Lifecycle,
        foxglove: FoxgloveFollower | None = None,
        table: CommandedTable | None = None,
    ) -> None:
        self.reader = reader
        self.lifecycle = lifecycle
        self.started_ns = time.monotonic_ns()
        self.timebase = Timebase.now()
        self._instrument = instrument = INSTRUMENTS[plan.instrument]
        scaling = instrument.scaling(info.rate_range_dps, info.accel_range_g)
        self.recording = Recording(plan, info, lifecycle, self.timebase, self.take)
        self.recent = RecentPackets(scaling, self.started_ns)
        self._statistics = ChannelStatistics(scaling, specification.of_model(info.instrument), self.started_ns)
        self.line = LineWatch(plan, info, self.timebase, instrument.packets_hz(info.rate_hz))
        self.status = StatusWords(instrument)
        self.guidance = Guidance(self.recording, self.record, table)
        self.events = EventLog(self.timebase)
        self.zeroing: Future[str] | None = None  # the answer to a request, while packets pause for it
        self._last_read_ns = 0
        self._handled_ns: int | None = None  # when that was read which is being handled
        self._last_said_ns = 0
        # the file comes first: what the others say of an event is written behind it
        self._consumers: list[Consumer] = [
            self.recording,
            self.recent,
            self._statistics,
            self.guidance,
            self.line,
            self.status,
            GravityCheck(instrument),
            ClockStepMonitor(self.timebase),
            *([] if foxglove is None else [foxglove]),
            self.events,
        ]

    # -- the stream ---------------------------------------------------------------------------------------------------

    def take(self, event: Event | ZeroingFinished) -> None:
        """Hand an event to every consumer, and what each says of it, before the next one. Raises OSError."""
        match event:
            case Block():
                self._take_block(event)
            case ZeroingFinished():
                self._zeroed(event)
            case Said():
                self._hand_out(self._stamped(event))
            case _:
                self._hand_out(event)
        if isinstance(event, LineLost) and self.zeroing is not None:
            self.abandon_zeroing(f"{event.message} Zero the rate sensors when the unit is back.")
            self.zeroing = None
            self.take(Broke(Why.ZEROED))  # whether they are zeroed is not known

    def _hand_out(self, event: Event) -> None:
        for consumer in self._consumers:
            for said in consumer.take(event):
                self.take(said)

    def _stamped(self, said: Said) -> Said:
        """Return an event with its time: now, or when that was read which it is about.

        Log time does not go back: later packets may have come meanwhile.
        """
        at_ns = time.monotonic_ns() if self._handled_ns is None else self._handled_ns
        self._last_said_ns = max(self._last_said_ns, at_ns)
        return said._replace(text=one_line(said.text, NOTE_LIMIT), at_ns=self._last_said_ns)

    @contextmanager
    def _handling(self, read_ns: int) -> Iterator[None]:
        self._handled_ns = read_ns
        try:
            yield
        finally:
            self._handled_ns = None

    def _take_block(self, block: Block) -> None:
        """Hand out packets, in parts where something happens between them: a file begins, or an event is written."""
        recording = self.recording
        # what was read while the worker was held up may be of after the end
        while block.rows.size and not recording.duration.has_all(read_ns := int(block.rows["host_ns"][0])):
            with self._handling(read_ns):
                recording.make_room(read_ns)
                is_first = recording.run.started_ns is None or not self.lifecycle.streaming.is_set()
                alone = block.gap is not None or is_first or self.line.is_away
                part, block = block.cut(1 if alone else recording.room(block.rows))
                self._last_read_ns = int(part.rows["host_ns"][-1])
                self._hand_out(part)
                if not self.lifecycle.streaming.is_set():
                    self.lifecycle.first_packet()

    def _zeroed(self, event: ZeroingFinished) -> None:
        """Go on after the pause: packets on either side of it do not belong together, nor do their biases."""
        before, patience_s = self.recent.mean(), self._instrument.zeroing_patience_s(event.argument)
        said = event.in_words(None if before is None else before[:3], patience_s)
        self.take(Broke(Why.ZEROED))
        pending, self.zeroing = self.zeroing, None
        self.event("acquisition", said, WARNING if event.seconds is None else INFORMATION)
        if pending is not None and event.seconds is None:
            pending.set_exception(InputError(said))
        elif pending is not None:
            pending.set_result(said)

    def event(self, name: str, text: str, level: int = INFORMATION) -> None:
        """Write an event or a mark into the file, if there is one, and show it to viewers; raises OSError."""
        self.take(Said(name, text, level))

    def every_second(self) -> None:
        """Have every consumer do what is due each second. Raises OSError."""
        second = self._second(time.monotonic_ns())
        with self._handling(second.written_ns):
            self._hand_out(second)
            if self.recording.is_out_of_space and self.recording.writer is not None:
                self._end_recording()
            if self.line.is_to_be_asked(second):
                self.reader.ask_again()
            for said in self.recording.run.news():
                self.take(said)

    def look_at_table(self) -> None:
        """Write what a table under command measures, and command what comes next; raises OSError."""
        if self.guidance.table is not None:
            second = self._second(time.monotonic_ns())
            is_silent = self.line.falls_silent(second)
            with self._handling(second.written_ns):
                self.guidance.look_at_table(second.now_ns, second.written_ns, lambda: not is_silent)

    def _second(self, now_ns: int) -> Second:
        """Return what there is to look at now."""
        recording, mean = self.recording, self.recent.mean()
        # packets that were read since are written behind a message of now: on a busy machine they wait longer
        longest_ns = BLOCK_NS if self.reader.last_packet_ns <= self._last_read_ns else _LONGEST_WAIT_NS
        return Second(
            now_ns,
            self._last_read_ns if now_ns - self._last_read_ns < longest_ns else now_ns,
            (now_ns - self.reader.last_packet_ns) / 1e9,
            self.zeroing is not None or not self.lifecycle.streaming.is_set(),
            None if mean is None else mean[3:6] / 1e3,
            recording.info,
            recording.motion,
        )

    def why_over(self, now_ns: int) -> str | None:
        """Return that the end has come without a request, in words; None if it has not."""
        return self.recording.why_over(now_ns) or self.guidance.why_over()

    def look_back(self) -> None:
        """Say, before the file is finished, what must be said at the end; raises OSError."""
        # as it was when the end was asked for: the unit has been stopped since
        asked_ns = self.lifecycle.stopping_since_ns
        asked = None if asked_ns is None else self._second(asked_ns)
        for finding, is_said in self.line.at_the_end(time.monotonic_ns(), asked):
            self.recording.find(finding["exit_code"], finding["text"], is_said=is_said)
        if self.lifecycle.ended_by:
            self.event("acquisition", f"ended by {self.lifecycle.ended_by}")

    def abandon_zeroing(self, message: str) -> None:
        """Answer a request to zero the rate sensors, which is not carried out any more."""
        if self.zeroing is not None:
            self.zeroing.set_exception(InputError(message))

    # -- what viewers ask for -------------------------------------------------------------------------------------

    def history(self, wish: HistoryWish) -> HistorySnapshot:
        """Return the past of the present run of samples, as far as a viewer lacks it."""
        run = self.recording.run
        return run.history.piece(run.first_stamp_ns or 0, wish)

    def channel_statistics(self, channel: int) -> StatisticsSnapshot:
        """Return Allan deviation, spectrum and histogram of a channel; InputError if there is no such channel."""
        return self._statistics.snapshot(channel, self._since_start_s())

    def begin_statistics(self) -> None:
        """Begin the statistics of the channels anew."""
        self._statistics.begin(self._since_start_s())

    def _since_start_s(self) -> float:
        return (time.monotonic_ns() - self.started_ns) / 1e9

    def mark(self, text: str, who: str = "") -> None:
        """Write the operator's mark; while guided a remark, since a mark would begin the profile's next dwell.

        `who`: who made it, for an event of its own; readers take the mark's text as it is.

        Raises InputError if nothing is being recorded.
        """
        if self.recording.writer is None:
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
        if self.recording.writer is not None:
            raise InputError(f"already recording to {self.recording.writer.path}")
        path = self.recording.record(wish)
        self.guidance.forget()
        return str(path)

    def stop_recording(self, who: str = "") -> "RunDocument":
        """Finish the file; the acquisition, its filter included, goes on without one.

        `who`: who asked for it, for an event at the end of the file.

        Raises InputError if nothing is being recorded, or the file is lost.
        Raises OSError if the disk does not take the end.
        """
        if self.recording.writer is not None and who:
            self.event("acquisition", f"recording ended by {who}")
        result = self._end_recording()
        if self.recording.lost:
            raise InputError(self.recording.lost)
        return result

    def configure(self, changes: FilterChanges) -> None:
        """Take another reference or other effects; the filter begins anew with them.

        Raises InputError if something is being recorded, the unit is zeroing, or the filter could not run with them.
        """
        self._refuse_while_zeroing()
        recording = self.recording
        if recording.writer is not None:
            raise InputError("finish the recording first: r. A file has one reference and one set of effects")
        recording.configure(*reconfigured(recording.plan, recording.info, changes))
        self.guidance.forget()
        plan = recording.plan
        source = plan.reference_file[0]
        said = f"reference {plan.reference}{f' from {source}' if source else ''}"
        said += ", with effects" if plan.effects else ", without effects"
        off = plan.filter != "none" and recording.info.filter == "none"
        said += ": recorded without the filter, to be traced afterwards" if off else ": the filter begins anew"
        self.event("acquisition", said)

    def begin_zeroing(self, argument: int) -> "Future[str]":
        """Have the unit zero its rate sensors; returns a future of what came of it, in words.

        Raises InputError if something is being recorded, it is zeroing already, or the acquisition is ending.
        """
        self._refuse_while_zeroing()
        if self.recording.writer is not None:
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
        """Return the profile that the reference comes from, if it comes from one."""
        recording = self.recording
        if not isinstance(recording.motion, Profile):
            return None
        return describe(recording.motion, *recording.plan.reference_file)

    def _refuse_while_zeroing(self) -> None:
        if self.zeroing is not None:
            raise InputError("the unit is zeroing its rate sensors; wait until it is done")

    def _end_recording(self) -> "RunDocument":
        """Finish the recording; the acquisition goes on without one."""
        result = self.recording.end()
        self.guidance.recording_ended(time.monotonic_ns())
        return result
