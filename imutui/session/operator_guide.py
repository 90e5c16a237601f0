"""Guiding the operator of a turn table through a profile, segment by segment.

The guide says where to go and waits, for ever if need be; it is told when the operator has arrived, holds for the
segment's seconds, and goes on to the next. No I/O: whoever runs it passes the monotonic clock in and writes the marks,
by which the filter joins the profile to the log ("segment 3", counted from 1; see
`filters.motion.reference.TableMotion`).
"""

import math

from filters.errors import InputError
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sampled, Segment, Sine
from imutui.logbook import reference_file
from imutui.session.snapshot import GuideSnapshot, GuideState, ProfileDescription, SegmentDescription


class Guide:
    """One way through a profile."""

    def __init__(self, profile: Profile, *, by_itself: bool = False) -> None:
        self.profile = profile
        # "go": the operator is on the way to the segment. "hold": it has begun. "done": all have been. "cancelled".
        self.state: GuideState = "go"
        self.segment = 0  # the present one; after the last, the last
        self._hold_s = hold_seconds(profile, with_ramps=not by_itself)
        self._begun: list[int | None] = [None] * len(profile.segments)
        self._until_ns = 0

    def do(self, what: str, now_ns: int, *, recording: bool) -> str | None:
        """Carry out the operator's "next", "cancel" or "resume"; returns the mark to write, if there is one.

        Raises InputError if it cannot be done now, or is none of them.
        """
        match what:
            case "next":
                return self.arrive(now_ns)
            case "cancel":
                return self.cancel(now_ns)
            case "resume" if not recording:
                raise InputError("the recording that the guide belongs to is finished; begin again")
            case "resume":
                self.resume()
                return None
        raise InputError(f'`do` is "{what}", not one of: begin, next, cancel, resume')

    @property
    def under_way(self) -> bool:
        """Whether it waits for the operator or holds."""
        return self.state in ("go", "hold")

    def awaits(self, now_ns: int) -> bool:
        """Whether the operator is on the way to a segment."""
        self.advance(now_ns)
        return self.state == "go"

    def arrive(self, now_ns: int) -> str:
        """Take it that the operator has arrived, and hold; returns the mark to write.

        Raises InputError if nobody is on the way.
        """
        self.advance(now_ns)
        if self.state == "hold":
            raise InputError(
                f"segment {self.segment + 1} is under way for another {self._left_s(now_ns):.0f} s; wait, or cancel"
            )
        self._refuse_unless_under_way()
        self.state = "hold"
        self._begun[self.segment] = now_ns
        self._until_ns = now_ns + round(self._hold_s[self.segment] * 1e9)
        return f"segment {self.segment + 1}"

    def advance(self, now_ns: int) -> None:
        """Go on to the next segment if the present one has had its time."""
        if self.state == "hold" and now_ns >= self._until_ns:
            self._go_on()

    def cancel(self, now_ns: int) -> str | None:
        """Stop guiding.

        Returns the mark to write: that the segment under way has ended before its time. Without it the table would be
          taken to rest there still.
        Raises InputError if there is nothing to cancel.
        """
        self.advance(now_ns)
        self._refuse_unless_under_way()
        was, self.state = self.state, "cancelled"
        if was == "go":
            return None
        # it has not been done, so whoever resumes does it again
        self._begun[self.segment] = None
        return f"segment {self.segment + 1} ends"

    def resume(self) -> None:
        """Go on after a cancellation, with the first segment not done; raises InputError if it was not cancelled."""
        if self.state != "cancelled":
            raise InputError(f"the guide is not cancelled but in state {self.state}; there is nothing to resume")
        self.state = "go"
        self._go_on()

    def recording_ended(self, now_ns: int) -> None:
        """Take note that what it guides is recorded no more: what was under way is cancelled, what is done stays so."""
        self.advance(now_ns)
        if self.under_way:
            self.state = "cancelled"

    def _go_on(self) -> None:
        left = [k for k, begun in enumerate(self._begun) if begun is None]
        self.state = "go" if left else "done"
        self.segment = left[0] if left else len(self._begun) - 1

    def _refuse_unless_under_way(self) -> None:
        if not self.under_way:
            next_step = "resume it" if self.state == "cancelled" else "begin again in a new recording"
            raise InputError(f"the guide is {self.state}; {next_step}")

    def _left_s(self, now_ns: int) -> float:
        return max(0.0, (self._until_ns - now_ns) / 1e9)

    def snapshot(self, now_ns: int, started_ns: int | None, turns_s: float | None = None) -> GuideSnapshot:
        """What viewers see; `started_ns` is when the run of samples began, if it has. See `GuideSnapshot`."""
        self.advance(now_ns)
        return {
            "state": self.state,
            "segment": self.segment,
            "count": len(self._begun),
            "left_s": self._left_s(now_ns) if self.state == "hold" else None,
            "begun": [
                None if t is None or started_ns is None else max(0.0, (t - started_ns) / 1e9) for t in self._begun
            ],
            "turns_s": turns_s,
        }


def begin_guide(
    motion: object, filter_name: str, present: Guide | None, *, recording: bool, by_itself: bool = False
) -> Guide:
    """Guide through the profile of an acquisition, which may be recording already; `by_itself`: under command.

    Raises InputError if there is nothing to be guided through, or not now; the message says what next.
    """
    if not isinstance(motion, Profile):
        raise InputError("there is no profile to be guided through: load one as the reference first")
    if present is not None and present.under_way:
        raise InputError("the guide is under way; cancel it first")
    if present is not None and recording:
        raise InputError("this recording has been guided already; finish it first: r. Then begin again")
    if filter_name != "none" and motion.align != "marks":
        raise InputError(
            f'the profile has align = "{motion.align}", so the filter would follow its clock and not you; write'
            ' align = "marks" into its file, and load it again'
        )
    return Guide(motion, by_itself=by_itself)


def hold_seconds(profile: Profile, *, with_ramps: bool = True) -> list[float]:
    """How long each segment takes from the operator's word on, s: a dwell rests so long, a motion has its ramps too.

    Under command it begins when they are over, and has none.
    """
    starts = [*profile.starts.tolist(), profile.duration]
    own = (Dwell,) if with_ramps else (Dwell, Rate, Sine)
    return [
        segment.seconds if isinstance(segment, own) else starts[k + 1] - starts[k]
        for k, segment in enumerate(profile.segments)
    ]


def describe(profile: Profile, name: str, text: str = "") -> ProfileDescription:
    """A profile for viewers, with its file's name and text; fields of a segment that do not apply are None."""
    segments = [
        _describe_segment(segment, seconds)
        for segment, seconds in zip(profile.segments, hold_seconds(profile), strict=True)
    ]
    return {"name": name, "about": reference_file.about(text), "align": profile.align, "segments": segments}


def _describe_segment(segment: Segment, seconds: float) -> SegmentDescription:
    said: SegmentDescription = {
        "kind": "sampled",
        "text": "run the recorded motion",
        "seconds": seconds,
        "angles_deg": None,
        "axis": None,
        "rate_dps": None,
        "amplitude_deg": None,
        "hz": None,
    }
    match segment:
        case Dwell(angles):
            outer, middle, inner = (round(math.degrees(a), 6) for a in angles)
            said["kind"], said["angles_deg"] = "dwell", [outer, middle, inner]
            said["text"] = f"go to outer {outer:g}°, middle {middle:g}°, inner {inner:g}°"
        case Rate(axis, rate):
            dps = round(math.degrees(rate), 6)
            said["kind"], said["axis"], said["rate_dps"] = "rate", axis, dps
            said["text"] = f"turn {axis} at {dps:+g} deg/s"
        case Sine(axis, amplitude, hz):
            degrees = round(math.degrees(amplitude), 6)
            said["kind"], said["axis"], said["amplitude_deg"], said["hz"] = "sine", axis, degrees, hz
            said["text"] = f"swing {axis} by ±{degrees:g}° at {hz:g} Hz"
        case Sampled():
            pass
    return said
