"""Through a table's profile, segment by segment: the operator turns the table by hand, or a controller is commanded.

The guide sends a mover to a segment and waits, without limit, until the mover has arrived. It then holds for the
segment's seconds, and goes on to the next. When a segment begins it is marked ("segment 3", counted from 1): by the
marks the filter joins the profile to the log, see `filters.motion.reference.TableMotion`.
"""

import time
from collections.abc import Callable, Iterable
from typing import Protocol

from filters.errors import InputError
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Segment, Sine
from imutui.logbook import reference_file
from imutui.session import lifecycle
from imutui.session.commanded_table import CommandedTable
from imutui.session.plan import RecordingWish
from imutui.session.reconnection import LineLost
from imutui.session.recording import Recording
from imutui.session.snapshot import GuideSnapshot, GuideState, ProfileDescription
from imutui.session.stream import INFORMATION, WARNING, Event, Said, Second

_TABLE = "table"  # events of the table under command
_SAY_SO = "the table would move by itself: say that it may (yes, or --yes-move) when nobody is near it"


class Mover(Protocol):
    """Takes a table from segment to segment."""

    has_ramps: bool  # whether a motion is taken to be there when it begins, its ramps included

    def go(self, profile: Profile, segment: Segment, now_ns: int) -> None:
        """Begin to go to a segment."""
        ...

    def has_arrived(self, now_ns: int) -> bool:
        """Return whether the segment begins now; once."""
        ...

    def leave(self) -> None:
        """Go nowhere any more."""
        ...


class Operator:
    """Turns the table by hand; `is_there` is set when the operator says so."""

    has_ramps = True

    def __init__(self) -> None:
        self.is_there = False

    def go(self, profile: Profile, segment: Segment, now_ns: int) -> None:
        self.is_there = False

    def has_arrived(self, now_ns: int) -> bool:
        return self.is_there

    def leave(self) -> None:
        self.is_there = False


class Guide:
    """One way through a profile. No I/O: the caller has the clock, and writes the marks."""

    def __init__(self, profile: Profile, mover: Mover | None = None) -> None:
        self.profile = profile
        # "go": the mover is on the way to the segment. "hold": it has begun. "done": all have been. "cancelled".
        self.state: GuideState = "go"
        self.segment = 0  # the present one; after the last, the last
        self._mover = mover or Operator()
        self._is_sent = False
        self._hold_s = hold_seconds(profile, with_ramps=self._mover.has_ramps)
        self._begun: list[int | None] = [None] * len(profile.segments)
        self._until_ns = 0

    @property
    def under_way(self) -> bool:
        """Whether it waits for the mover or holds."""
        return self.state in ("go", "hold")

    def do(self, what: str, now_ns: int, *, recording: bool) -> str | None:
        """Carry out the operator's "next", "cancel" or "resume"; returns the mark to write, if there is one.

        Raises InputError if it cannot be done now, or is none of them.
        """
        self._advance(now_ns)
        match what:
            case "next":
                return self._next(now_ns)
            case "cancel":
                return self.cancel(now_ns)
            case "resume" if not recording:
                raise InputError("the recording that the guide belongs to is finished; begin again")
            case "resume" if self.state != "cancelled":
                raise InputError(f"the guide is not cancelled but in state {self.state}; there is nothing to resume")
            case "resume":
                self._go_on()
                return None
        raise InputError(f'`do` is "{what}", not one of: begin, next, cancel, resume')

    def _next(self, now_ns: int) -> str | None:
        if not isinstance(self._mover, Operator):
            raise InputError("the table goes from segment to segment by itself; Esc stops it")
        if self.state == "hold":
            raise InputError(
                f"segment {self.segment + 1} is under way for another {self._left_s(now_ns):.0f} s; wait, or cancel"
            )
        self._refuse_unless_under_way()
        self.look(now_ns)
        self._mover.is_there = True
        return self.look(now_ns)

    def look(self, now_ns: int) -> str | None:
        """Go on to where the mover and the time have come; returns the mark to write if a segment begins."""
        self._advance(now_ns)
        if self.state != "go":
            return None
        if not self._is_sent:
            self._is_sent = True
            self._mover.go(self.profile, self.profile.segments[self.segment], now_ns)
        if not self._mover.has_arrived(now_ns):
            return None
        self.state = "hold"
        self._begun[self.segment] = now_ns
        self._until_ns = now_ns + round(self._hold_s[self.segment] * 1e9)
        return f"segment {self.segment + 1}"

    def _advance(self, now_ns: int) -> None:
        if self.state == "hold" and now_ns >= self._until_ns:
            self._go_on()

    def _go_on(self) -> None:
        left = [k for k, begun in enumerate(self._begun) if begun is None]
        self.state, self._is_sent = "go" if left else "done", False
        self.segment = left[0] if left else len(self._begun) - 1

    def cancel(self, now_ns: int) -> str | None:
        """Stop guiding, and the mover.

        Returns the mark to write: that the segment under way has ended before its time. Without it the table would be
          taken to rest there still.
        Raises InputError if there is nothing to cancel.
        """
        self._advance(now_ns)
        self._mover.leave()
        self._refuse_unless_under_way()
        was, self.state = self.state, "cancelled"
        if was == "go":
            return None
        self._begun[self.segment] = None  # a segment that was not held to its end is done again on resuming
        return f"segment {self.segment + 1} ends"

    def _refuse_unless_under_way(self) -> None:
        if not self.under_way:
            next_step = "resume it" if self.state == "cancelled" else "begin again in a new recording"
            raise InputError(f"the guide is {self.state}; {next_step}")

    def recording_ended(self, now_ns: int) -> None:
        """Cancel what is under way, since it is recorded no more; what is done stays done."""
        self._advance(now_ns)
        self._mover.leave()
        if self.under_way:
            self.state = "cancelled"

    def _left_s(self, now_ns: int) -> float:
        return max(0.0, (self._until_ns - now_ns) / 1e9)

    def snapshot(self, now_ns: int, started_ns: int | None) -> GuideSnapshot:
        """Return what viewers see; `started_ns` is when the run of samples began, if it has. See `GuideSnapshot`."""
        self._advance(now_ns)
        return {
            "state": self.state,
            "segment": self.segment,
            "count": len(self._begun),
            "left_s": self._left_s(now_ns) if self.state == "hold" else None,
            "begun": [
                None if t is None or started_ns is None else max(0.0, (t - started_ns) / 1e9) for t in self._begun
            ],
        }


class Guidance:
    """Where an acquisition is in a profile. `recorder` has the profile, `record` begins a recording.

    `table` is one under command; without it the operator turns the table.
    """

    def __init__(
        self, recorder: Recording, record: Callable[[RecordingWish], str], table: CommandedTable | None = None
    ) -> None:
        self.guide: Guide | None = None
        self.table = table
        self._recorder, self._record = recorder, record
        # of a plan that has the table run the recording's profile: it begins, and ends, with the file
        self._is_planned = table is not None and recorder.plan.yes_move and recorder.begins_with_packet
        self._leaves_when_done = False
        self._log_ns = 0  # of the last reading: log time does not go back

    def forget(self) -> None:
        """Forget the guide: another recording, or another reference, begins."""
        self.guide = None

    def do(self, what: str, wish: RecordingWish, *, may_move: bool = False) -> None:
        """Carry out "begin", "next", "cancel" or "resume"; a recording that begins is as wished.

        `may_move`: somebody has said that a table under command may move.
        Raises InputError if that cannot be done now; the message says what next.
        """
        recording = self._recorder.writer is not None
        if what == "begin":
            self._begin(wish, recording=recording, may_move=may_move)
        elif self.guide is None:
            raise InputError("no guide is under way; begin one first")
        else:
            if what == "resume" and recording and self.guide.state == "cancelled":
                self._free(self.guide.profile, may_move=may_move)
            self._mark(self.guide.do(what, time.monotonic_ns(), recording=recording))
        self._leaves_when_done = what in ("begin", "resume")

    def _begin(self, wish: RecordingWish, *, recording: bool, may_move: bool) -> None:
        recorder, present = self._recorder, self.guide
        profile = guided(recorder.motion, recorder.info.filter)
        if present is not None and present.under_way:
            raise InputError("the guide is under way; cancel it first")
        if present is not None and recording:
            raise InputError("this recording has been guided already; finish it first: r. Then begin again")
        self._free(profile, may_move=may_move)
        if not recording:
            self._record(wish)
        self.guide = Guide(profile, self.table)
        who = "guide through" if self.table is None else "the table is commanded through"
        recorder.event("acquisition", f"{who} {recorder.plan.reference_file[0]} begins")

    def _free(self, profile: Profile, *, may_move: bool) -> None:
        """Have a table under command ready to move."""
        if self.table is not None:
            if not may_move:
                raise InputError(_SAY_SO)
            self.table.check(profile)
            self.table.enable()

    def _mark(self, mark: str | None) -> None:
        if mark is not None:
            self._recorder.event("mark", mark)

    def take(self, event: Event, /) -> Iterable[Said]:
        """Have the guide go on each second, and stop the table where the line is lost. Raises OSError."""
        if isinstance(event, LineLost):
            self.stop("the line to the unit is lost")
        elif isinstance(event, Second):
            self._look(event.now_ns)
        return ()

    def _look(self, now_ns: int) -> None:
        if self.guide is not None:
            self._mark(self.guide.look(now_ns))

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
        if guide is not None and guide.under_way and table.why_failed:
            self._leaves_when_done = False
            self._mark(guide.cancel(now_ns))
            why = f"the table was stopped in segment {guide.segment + 1}: {table.why_failed}"
            recorder.find(lifecycle.INSTRUMENT, why)
        self._look(now_ns)
        if guide is not None and guide.state == "done" and self._leaves_when_done:
            self._leaves_when_done = False
            table.leave()
            recorder.event(_TABLE, "the profile is over: the table is left where it is, mode off")

    def stop(self, why: str) -> None:
        """Stop a table under command at once, and report why; nothing where there is none."""
        if self.table is not None and self.table.moves:
            self.table.leave()
            self.table.warn(f"stopped, rate zero and mode off: {why}")

    def why_over(self) -> str | None:
        """Return in words that a profile that the recording is of is over, or was stopped; None while it is not."""
        plan, guide = self._recorder.plan, self.guide
        if self.table is None or guide is None or not plan.yes_move or plan.duration_s is not None:
            return None
        if not plan.record or self._leaves_when_done:
            return None
        if guide.state == "done":
            return "the end of its profile"
        return "the table, which was stopped" if guide.state == "cancelled" and self.table.why_failed else None

    def recording_ended(self, now_ns: int) -> None:
        """Take note that what was guided is recorded no more."""
        if self.guide is not None:
            self.guide.recording_ended(now_ns)

    def snapshot(self, now_ns: int, started_ns: int | None) -> GuideSnapshot | None:
        """Return what viewers see; see `Guide.snapshot`."""
        return None if self.guide is None else self.guide.snapshot(now_ns, started_ns)


def guided(motion: object, filter_name: str) -> Profile:
    """Return the profile of an acquisition's reference; raises InputError if nobody can be guided through it."""
    if not isinstance(motion, Profile):
        raise InputError("there is no profile to be guided through: load one as the reference first")
    if filter_name != "none" and motion.align != "marks":
        raise InputError(
            f'the profile has align = "{motion.align}", so the filter would follow its clock and not you; write'
            ' align = "marks" into its file, and load it again'
        )
    return motion


def hold_seconds(profile: Profile, *, with_ramps: bool = True) -> list[float]:
    """Return how long each segment takes from its mark on, s; `with_ramps`: a motion has its ramps too."""
    starts = [*profile.starts.tolist(), profile.duration]
    own = (Dwell,) if with_ramps else (Dwell, Rate, Sine)
    return [
        segment.seconds if isinstance(segment, own) else starts[k + 1] - starts[k]
        for k, segment in enumerate(profile.segments)
    ]


def describe(profile: Profile, name: str, text: str = "") -> ProfileDescription:
    """Return a profile for viewers, with its file's name and text."""
    segments = zip(profile.segments, hold_seconds(profile), strict=True)
    return {
        "name": name,
        "text": text,
        "about": reference_file.about(text),
        "align": profile.align,
        "segments": [
            {"kind": type(segment).__name__.lower(), "text": reference_file.in_words(segment), "seconds": seconds}
            for segment, seconds in segments
        ],
    }
