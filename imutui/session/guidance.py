"""Guides a table through a profile, segment by segment; the operator turns it by hand, or a controller is commanded.

The guide sends a mover to a segment and waits, without limit, until the mover has arrived. It then holds for the
segment's seconds, and continues with the next. The beginning of a segment is marked ("segment 3", counted from 1). The
filter joins the profile to the log by these marks, see `filters.motion.reference.TableMotion`.
"""

import time
from collections.abc import Callable, Iterable

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


class Operator:
    """Turns the table by hand; the guide sets `is_there` at "next". `CommandedTable` has the same methods."""

    has_ramps = True  # the ramps of a motion belong to its segment

    def __init__(self) -> None:
        self.is_there = False

    def go(self, profile: Profile, segment: Segment, now_ns: int) -> None:
        """Begin to go to a segment."""
        self.is_there = False

    def has_arrived(self, now_ns: int) -> bool:
        """Return whether the segment begins now; once."""
        return self.is_there

    def leave(self) -> None:
        """Stop going to a segment."""
        self.is_there = False


class Guide:
    """One pass through a profile. No I/O: the caller has the clock, and writes the marks."""

    def __init__(self, profile: Profile, mover: Operator | CommandedTable | None = None) -> None:
        self.profile = profile
        # "go": the mover is on the way to the segment. "hold": it has begun. "done": all have been. "cancelled".
        self.state: GuideState = "go"
        self.segment = 0  # the present one; the last when all are done
        self._mover = mover or Operator()
        self._is_sent = False
        self._hold_s = hold_seconds(profile, with_ramps=self._mover.has_ramps)
        self._begun: list[int | None] = [None] * len(profile.segments)
        self._until_ns = 0

    @property
    def under_way(self) -> bool:
        """True while the guide waits for the mover or holds."""
        return self.state in ("go", "hold")

    def do(self, what: str, now_ns: int, *, recording: bool) -> str | None:
        """Carry out the operator's "next", "cancel" or "resume"; returns the mark to write, if there is one.

        Raises InputError for another word, or if it cannot be done now.
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
        """Advance to the present time; returns the mark to write if a segment begins."""
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

        Returns the mark that ends the segment under way, if one is. Without it the filter would take the table to rest
          there still.
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
        """Cancel the segment under way, since its recording has ended; segments that are done stay done."""
        self._advance(now_ns)
        self._mover.leave()
        if self.under_way:
            self.state = "cancelled"

    def _left_s(self, now_ns: int) -> float:
        return max(0.0, (self._until_ns - now_ns) / 1e9)

    def snapshot(self, now_ns: int, started_ns: int | None) -> GuideSnapshot:
        """Return the guide for viewers; `started_ns`: beginning of the run of samples, if it has begun."""
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
    """The guide of an acquisition. `recorder` has the profile, `record` begins a recording.

    `table`: a table under command; None: the operator turns the table.
    """

    def __init__(
        self, recorder: Recording, record: Callable[[RecordingWish], str], table: CommandedTable | None = None
    ) -> None:
        self.guide: Guide | None = None
        self.table = table
        self._recorder, self._record = recorder, record
        # the plan has the table run the recording's profile, which begins and ends with the file
        self._is_planned = table is not None and recorder.plan.yes_move and recorder.begins_with_packet
        self._leaves_when_done = False
        self._log_ns = 0  # log time of the last reading; it does not go back

    def forget(self) -> None:
        """Drop the guide, as another recording or another reference begins."""
        self.guide = None

    def do(self, what: str, wish: RecordingWish, *, may_move: bool = False) -> None:
        """Carry out "begin", "next", "cancel" or "resume"; `wish`: of a recording that begins.

        `may_move`: the user has allowed a table under command to move.
        Raises InputError if that cannot be done now; the message has the next step.
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
        """Enable a table under command for a profile."""
        if self.table is not None:
            if not may_move:
                raise InputError(_SAY_SO)
            self.table.check(profile)
            self.table.enable()

    def _mark(self, mark: str | None) -> None:
        if mark is not None:
            self._recorder.event("mark", mark)

    def take(self, event: Event, /) -> Iterable[Said]:
        """Advance the guide each second, and stop the table if the line is lost. Raises OSError."""
        if isinstance(event, LineLost):
            self.stop("the line to the unit is lost")
        elif isinstance(event, Second):
            self._look(event.now_ns)
        return ()

    def _look(self, now_ns: int) -> None:
        if self.guide is not None:
            self._mark(self.guide.look(now_ns))

    def look_at_table(self, now_ns: int, log_ns: int, unit_is_there: Callable[[], bool]) -> None:
        """Record the controller's readings, and command the next motion; stop if something is wrong. Raises OSError."""
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
        """Stop a table under command at once, and report why."""
        if self.table is not None and self.table.moves:
            self.table.leave()
            self.table.warn(f"stopped, rate zero and mode off: {why}")

    def why_over(self) -> str | None:
        """Return in words what ended the profile that is recorded; None while it runs."""
        plan, guide = self._recorder.plan, self.guide
        if self.table is None or guide is None or not plan.yes_move or plan.duration_s is not None:
            return None
        if not plan.record or self._leaves_when_done:
            return None
        if guide.state == "done":
            return "the end of its profile"
        return "the table, which was stopped" if guide.state == "cancelled" and self.table.why_failed else None

    def recording_ended(self, now_ns: int) -> None:
        """Cancel the guide, since its recording has ended."""
        if self.guide is not None:
            self.guide.recording_ended(now_ns)

    def snapshot(self, now_ns: int, started_ns: int | None) -> GuideSnapshot | None:
        """Return the guide for viewers."""
        return None if self.guide is None else self.guide.snapshot(now_ns, started_ns)


def guided(motion: object, filter_name: str) -> Profile:
    """Return the profile of an acquisition's reference; raises InputError if it has none that can be guided."""
    if not isinstance(motion, Profile):
        raise InputError("there is no profile to be guided through: load one as the reference first")
    if filter_name != "none" and motion.align != "marks":
        raise InputError(
            f'the profile has align = "{motion.align}", so the filter would follow its clock and not you; write'
            ' align = "marks" into its file, and load it again'
        )
    return motion


def hold_seconds(profile: Profile, *, with_ramps: bool = True) -> list[float]:
    """Return the time of each segment from its mark on, s; `with_ramps`: including the ramps of a motion."""
    starts = [*profile.starts.tolist(), profile.duration]
    own = (Dwell,) if with_ramps else (Dwell, Rate, Sine)
    return [
        segment.seconds if isinstance(segment, own) else starts[k + 1] - starts[k]
        for k, segment in enumerate(profile.segments)
    ]


def describe(profile: Profile, name: str, text: str = "") -> ProfileDescription:
    """Return a profile for viewers, with the name and text of its file."""
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
