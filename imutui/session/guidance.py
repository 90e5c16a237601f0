"""Through a table's profile: the operator is guided, a virtual unit turns by itself, or a controller is commanded."""

import time
from collections.abc import Callable, Iterable

from filters.errors import InputError
from filters.motion.profile import Profile
from imutui.session import lifecycle, operator_guide
from imutui.session.commanded_table import CommandedTable
from imutui.session.plan import RecordingWish
from imutui.session.reconnection import LineLost
from imutui.session.recording import Recording
from imutui.session.snapshot import GuideSnapshot
from imutui.session.stream import INFORMATION, WARNING, Event, Said, Second
from imutui.session.table_turner import TableTurner

_TABLE = "table"  # events of the table under command
_SAY_SO = "the table would move by itself: say that it may (yes, or --yes-move) when nobody is near it"


class Guidance:
    """Where an acquisition is in a profile. `recorder` has the profile, `record` begins a recording.

    `turner` turns the table under a virtual unit, `table` is one under command; without either the operator turns it.
    """

    def __init__(
        self,
        recorder: Recording,
        record: Callable[[RecordingWish], str],
        turner: TableTurner | None = None,
        table: CommandedTable | None = None,
    ) -> None:
        self.guide: operator_guide.Guide | None = None
        self.table = table
        self._recorder, self._record, self._turner = recorder, record, turner
        # of a plan that has the table run the recording's profile: it begins, and ends, with the file
        self._is_planned = table is not None and recorder.plan.yes_move and recorder.begins_with_packet
        self._leaves_when_done = False
        self._log_ns = 0  # of the last reading: log time does not go back

    def forget(self) -> None:
        """Another recording, or another reference, begins."""
        self.guide = None

    def do(self, what: str, wish: RecordingWish, *, may_move: bool = False) -> None:
        """Carry out "begin", "next", "cancel" or "resume"; a recording that begins is as wished.

        `may_move`: somebody has said that a table under command may move.
        Raises InputError if that cannot be done now; the message says what next.
        """
        recorder, table = self._recorder, self.table
        recording, now = recorder.writer is not None, time.monotonic_ns()
        if what == "begin":
            self._begin(wish, may_move=may_move)
            return
        guide = self.guide
        if guide is None:
            raise InputError("no guide is under way; begin one first")
        if table is not None and what == "next":
            raise InputError("the table goes from segment to segment by itself; Esc stops it")
        if what == "next" and self._turner is not None and guide.awaits(now):
            self._turner.turn(guide.profile, guide.profile.segments[guide.segment], now)
            return
        if table is not None and what == "resume":
            self._free(guide.profile, table, may_move=may_move)
        self._leave()
        mark = guide.do(what, now, recording=recording)
        self._leaves_when_done = what == "resume"
        if mark is not None:
            self._recorder.event("mark", mark)

    def _begin(self, wish: RecordingWish, *, may_move: bool) -> None:
        recorder, table = self._recorder, self.table
        recording = recorder.writer is not None
        begun = operator_guide.begin_guide(
            recorder.motion, recorder.info.filter, self.guide, recording=recording, by_itself=table is not None
        )
        if table is not None:
            self._free(begun.profile, table, may_move=may_move)
        if not recording:
            self._record(wish)
        self.guide, self._leaves_when_done = begun, True
        who = "guide through" if table is None else "the table is commanded through"
        recorder.event("acquisition", f"{who} {recorder.plan.reference_file[0]} begins")

    @staticmethod
    def _free(profile: Profile, table: CommandedTable, *, may_move: bool) -> None:
        if not may_move:
            raise InputError(_SAY_SO)
        table.check(profile)
        table.enable()

    def take(self, event: Event, /) -> Iterable[Said]:
        """Advance the guide each second; stop the table where the line is lost."""
        if isinstance(event, LineLost):
            self.stop("the line to the unit is lost")
        elif isinstance(event, Second) and self.guide is not None:
            self.guide.advance(event.now_ns)
            if self._turner is not None and self._turner.has_arrived(event.now_ns):
                yield Said("mark", self.guide.arrive(event.now_ns))

    def look_at_table(self, now_ns: int, log_ns: int, unit_is_there: Callable[[], bool]) -> None:
        """Write what the controller said, and command what comes next; stop if something is wrong. Raises OSError."""
        table, recorder = self.table, self._recorder
        if table is None:
            return
        self._log_ns = max(self._log_ns, log_ns)
        recorder.run.table_states(table.take(now_ns), self._log_ns)
        if table.moves and not unit_is_there():
            self.stop("the unit has fallen silent")
        for text, is_warning in table.news():
            recorder.event(_TABLE, text, WARNING if is_warning else INFORMATION)
        if self._is_planned and recorder.writer is not None:
            self._is_planned = False
            try:
                self.do("begin", RecordingWish(), may_move=True)
            except InputError as error:
                recorder.find(lifecycle.INSTRUMENT, f"the profile was not run: {error}")
        guide = self.guide
        if guide is not None and guide.under_way and table.failed:
            self._interrupt(guide, now_ns)
        elif guide is not None and guide.awaits(now_ns):
            if table.is_idle:
                table.turn(guide.profile, guide.profile.segments[guide.segment], now_ns)
            elif table.has_arrived(now_ns):
                recorder.event("mark", guide.arrive(now_ns))
        elif guide is not None and guide.state == "done" and self._leaves_when_done:
            self._leaves_when_done = False
            table.leave()
            recorder.event(_TABLE, "the profile is over: the table is left where it is, mode off")

    def _interrupt(self, guide: operator_guide.Guide, now_ns: int) -> None:
        mark, self._leaves_when_done = guide.cancel(now_ns), False
        if mark is not None:
            self._recorder.event("mark", mark)
        why = self.table.why_failed if self.table is not None else ""
        self._recorder.find(lifecycle.INSTRUMENT, f"the table was stopped in segment {guide.segment + 1}: {why}")

    def stop(self, why: str) -> None:
        """Stop a table under command at once, for a reason that is to be told; nothing where there is none."""
        if self.table is not None and self.table.moves:
            self.table.leave()
            self.table.tell(f"stopped, rate zero and mode off: {why}")

    def why_over(self) -> str | None:
        """That a profile that the recording is of is over, or was stopped, in words; None while it is not."""
        recorder, guide = self._recorder, self.guide
        if self.table is None or guide is None or not recorder.plan.yes_move or recorder.plan.duration_s is not None:
            return None
        if not recorder.plan.record or self._leaves_when_done:
            return None
        if guide.state == "done":
            return "the end of its profile"
        return "the table, which was stopped" if guide.state == "cancelled" and self.table.failed else None

    def recording_ended(self, now_ns: int) -> None:
        """What was guided is recorded no more."""
        if self.guide is not None:
            self._leave()
            self.guide.recording_ended(now_ns)

    def _leave(self) -> None:
        if self._turner is not None:
            self._turner.leave()
        if self.table is not None:
            self.table.leave()

    def snapshot(self, now_ns: int, started_ns: int | None) -> GuideSnapshot | None:
        """What viewers see; see `Guide.snapshot`."""
        turns_s = None if self._turner is None else self._turner.left_s(now_ns) or 0.0
        return None if self.guide is None else self.guide.snapshot(now_ns, started_ns, turns_s)
