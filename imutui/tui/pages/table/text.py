"""What the table page says: where the operator is in a profile, and what to do next. Pure functions."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

from imutui.report import wrapping
from imutui.session.snapshot import ControllerSnapshot, GuideSnapshot, ProfileDescription, SegmentDescription, Snapshot
from imutui.tui import formatting

if TYPE_CHECKING:
    from imutui.jobs.operator_steps import Offer, OperatorStep

LEVEL = "no profile: still and level"
LEVEL_PREVIEW = "Enter lays the profile aside: the filter takes the unit as still and level"
LOOKING = "looking for profiles…"
READY_MADE = "ready-made"
_BY_HAND = (
    "By hand: this page says where to go, and your Enter joins profile and log. Only what you hold still is used."
)
_WHO = {
    "none": "By itself: the controller runs the profile; its clock is the log's.",
    "gyro": "By itself: the controller runs the profile. When it began is found in the whole recording, so the filter"
    " is off meanwhile; t traces the recording afterwards.",
}
TAKEN = {
    "marks": "the filter goes by it from now on, and began anew",
    "gyro": "the next recording has it as its reference; the filter is off until it is laid aside",
}
"""What is said when the acquisition has taken a profile, by how it is joined."""
_NEEDED = 74
_TURNS_DPS = 0.05  # slower is said to stand
_LEAST_PLACE = 14
WORKING_OUT = "working out…"
NOTHING_NEW = "nothing new by itself"
ENDED = "The acquisition has ended.", "6 Logs has what was recorded: t there traces it. 1 connects again."
"""What the operator is to do once it has, and what then."""
_VIRTUAL = (
    "a virtual unit does not turn by hand: RED from segment 2 on, unless the scenario of"
    ' `imutui virtual --scenario FILE` has this profile (profile = "NAME")'
)
_ALIGNS = {
    "none": "profile time is the log's time",
    "marks": "joined by marks",
    "gyro": "joined by the gyros",
}
_THERE = {
    "dwell": "Enter when the table is there and at rest.",
    "rate": "Enter when it turns at that rate.",
    "sine": "Enter when it swings.",
    "sampled": "Enter when it starts.",
}
_BY_ITSELF = {
    "none": "Its clock is the log's: start it with r, at the same moment.",
    "gyro": "r records; then start the table. The gyros tell when it began.",
}
_HOLDING = {
    "dwell": "Leave the table alone.",
    "rate": "Keep it turning.",
    "sine": "Keep it swinging.",
    "sampled": "Let it move.",
}


def state_word(guide: GuideSnapshot | None, number: int) -> str:
    """Of a segment (0 is the first): "done", "left out", "now", "next" or "to do"."""
    if guide is None:
        return "to do"
    at = guide["count"] if guide["state"] == "done" else guide["segment"]
    if number < at:
        return "done" if begun(guide, number) is not None else "left out"
    if number == at:
        return "next" if guide["state"] == "cancelled" else "now"
    return "next" if number == at + 1 and guide["state"] != "cancelled" else "to do"


def begun(guide: GuideSnapshot | None, number: int) -> float | None:
    """When a segment began, s since the take began."""
    times = guide["begun"] if guide is not None else []
    return times[number] if number < len(times) else None


def left(guide: GuideSnapshot | None, number: int) -> float | None:
    """Seconds left of a segment, if it is being held."""
    if guide is None or guide["state"] != "hold" or guide["segment"] != number:
        return None
    return guide["left_s"]


def title(profile: ProfileDescription, seconds: float | None) -> str:
    """Name, number of segments, how long without the moves, how it is joined."""
    name = formatting.profile_name(profile["name"])
    length = "" if seconds is None else f", {span(seconds)} without the moves"
    joined = _ALIGNS.get(profile["align"], "")
    return f"{name}: {formatting.plural(len(profile['segments']), 'segment')}{length}{', ' + joined if joined else ''}"


def span(seconds: float) -> str:
    """A duration as m:ss."""
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"


def said(
    guide: GuideSnapshot | None,
    profile: ProfileDescription,
    recording: bool,
    by_hand: bool = True,
    recorded: bool = False,
    commanded: bool = False,
) -> tuple[str, str]:
    """What the operator is to do now, and what happens then; `commanded`: nothing, the table goes by itself."""
    segments = profile["segments"]
    if commanded:
        return _commanded(guide, segments, recording)
    if guide is None and not by_hand:
        return _by_itself(profile["align"], recording, recorded)
    if guide is None or can(guide, recording) == {"begin"}:
        first = "Segment 1 is asked for" if recording else "A recording starts, and segment 1 is asked for"
        return _before(guide, recorded), f"{first}. p takes another profile."
    number = min(guide["segment"], len(segments) - 1)
    segment = segments[number]
    of = f"Segment {number + 1} of {len(segments)}"
    match guide["state"]:
        case "go":
            return f"{of}: {segment['text']}", f"I wait for you. {_THERE[segment['kind']]}"
        case "hold":
            after = "Then I ask for the next." if number + 1 < len(segments) else "Then all is done."
            return f"{of}: {_holding(segment['text'])}", f"{_HOLDING[segment['kind']]} {after}"
        case "cancelled":
            where = f"Cancelled at segment {number + 1} of {len(segments)}."
            return where, "The recording goes on: b resumes there, r finishes the file."
    return f"All {len(segments)} segments are done.", "r finishes the file, t traces it with this profile."


def _commanded(guide: GuideSnapshot | None, segments: Sequence[SegmentDescription], recording: bool) -> tuple[str, str]:
    """What a table under command does, and what then."""
    if guide is None or can(guide, recording) == {"begin"}:
        first = "" if recording else "A recording starts. "
        return "b has the table run this, after a question.", f"{first}The table goes by itself; Esc stops it."
    number = min(guide["segment"], len(segments) - 1)
    of, what = f"Segment {number + 1} of {len(segments)}", segments[number]["text"]
    match guide["state"]:
        case "go":
            return f"{of}: {what}", "The table is on its way: keep clear. Esc stops it at once."
        case "hold":
            return f"{of}: {_holding(what)}", "The table goes on by itself. Esc stops it at once."
        case "cancelled":
            return f"Stopped at segment {number + 1} of {len(segments)}.", (
                "The table stands, mode off. b goes on after a question; r finishes the file."
            )
    return f"All {len(segments)} segments are done; the table stands, its mode is off.", (
        "r finishes the file, t traces it with the angles that were measured."
    )


def table_line(table: ControllerSnapshot | None) -> str:
    """Where a table under command is: angles and rates of its axes, mode, and what is wrong with it."""
    if table is None:
        return ""
    angles, rates = table["angles_deg"], table["rates_dps"]
    if table["error"] or angles is None or rates is None:
        return table["error"] or "no angles yet"
    parts = [
        f"{axis} {angles[k]:+.3f}°" + (f" {rates[k]:+.2f}°/s" if abs(rates[k]) >= _TURNS_DPS else "")
        for k, axis in enumerate(("outer", "middle", "inner"))
        if axis in table["axes"]
    ]
    return "  ".join([*parts, f"mode {table['mode']}", *([table["fault"]] if table["fault"] else [])])


def _by_itself(align: str, recording: bool, recorded: bool) -> tuple[str, str]:
    """What to do where the table's controller runs a profile, and what then."""
    if recording:
        return (
            "Recording: the table runs this by itself.",
            "When it has run through, r finishes the file; then t traces it.",
        )
    if recorded:
        return "Recorded: t traces the file with this profile.", "r records once more; p takes another profile."
    return "The table runs this by itself.", _BY_ITSELF.get(align, _BY_ITSELF["none"])


def warning(now: Snapshot, width: int) -> list[str]:
    """Before a guide begins: that a virtual unit does not turn by hand, in lines of at most so many characters."""
    begins = can(now["guide"], now["recording"] is not None) == {"begin"} and not now["controller"]
    if now["kind"] != "simulated" or not begins:
        return []
    return wrapping.wrap(_VIRTUAL, width)


def _before(guide: GuideSnapshot | None, recorded: bool) -> str:
    if guide is None:
        return "b begins."
    last = "done" if guide["state"] == "done" else "cancelled"
    key = "t" if recorded else "6 Logs"
    return f"The last time is {last}, its file finished ({key} traces it). b begins again."


def guided(profile: ProfileDescription, now: Snapshot) -> bool:
    """Whether the acquisition guides through a profile: the operator moves the table, and not its controller."""
    return profile["align"] == "marks" or (now["filter"] is None and profile["align"] != "gyro")


def can(guide: GuideSnapshot | None, recording: bool) -> set[str]:
    """What can be asked of the guide: one way through a profile belongs to one recording."""
    state = None if guide is None else guide["state"]
    if state in ("done", "cancelled") and recording:
        return {"resume"} if state == "cancelled" else set()
    return {"go": {"there", "cancel"}, "hold": {"cancel"}}.get(state or "", {"begin"})


def _holding(instruction: str) -> str:
    where = instruction.removeprefix("go to ")
    return f"go on: {instruction}" if where == instruction else f"hold {where}"


def bar(share: float, width: int) -> str:
    """A share as a bar of whole characters."""
    full = round(min(max(share, 0.0), 1.0) * width)
    return "█" * full + "·" * (width - full)


def testable(shows: Sequence[str] | None, width: int) -> str:
    """What a segment makes testable in at most so many characters; what does not fit is counted."""
    if shows is None:
        return WORKING_OUT
    if not shows:
        return NOTHING_NEW
    for taken in range(len(shows), 0, -1):
        line = "; ".join(shows[:taken]) + (f"; +{len(shows) - taken} more" if taken < len(shows) else "")
        if len(line) <= width:
            return line
    return formatting.shorten(shows[0], width)


def lead(now: Snapshot | None) -> str:
    """What to do with the list of profiles."""
    if now is None or now["state"] != "running":
        return "Table profiles. To follow one, connect first: 1 goes there."
    if now["recording"] is not None:
        return "Table profiles. r finishes the recording that runs; then one can be taken."
    return "Choose a table profile; Enter takes it: the filter then goes by it."


def offer_lines(offers: "Sequence[Offer]", width: int) -> list[str]:
    """Name, size and place of each profile, in a terminal of so many columns."""
    # names and places as wide as need be; if there is no room for both, places give way first
    room = max(width, _NEEDED) - 25
    names = max((len(offer.name) for offer in offers), default=0)
    places = max((len(offer.place) for offer in offers), default=0)
    place = min(places, max(room - names, _LEAST_PLACE))
    name = min(names, room - place)
    return [_offer_line(offer, name, place) for offer in offers]


def _offer_line(offer: "Offer", name: int, place: int) -> str:
    what = (
        "can't be used"
        if offer.error
        else f"{offer.segments:3d} {'segment ' if offer.segments == 1 else 'segments'} {span(offer.seconds):>6}"
    )
    return f" {formatting.shorten(offer.name, name):<{name}}  {what:<20} {formatting.shorten(offer.place, place)}"


def who(align: str) -> str:
    """What it means who moves the table, for a profile that is not joined by marks."""
    return f"{_BY_HAND}\n{_WHO.get(align, _WHO['none'])}"


def copy_name(file: str, *, ready_made: bool) -> str:
    """Name that is proposed for a copy of a profile's file."""
    stem, dot, suffix = file.replace(" ", "_").rpartition(".")
    return f"{stem}{'' if ready_made else '_copy'}{dot}{suffix}"


def about_lines(about: Sequence[str], width: int) -> list[str]:
    """What a profile's file says at the top, in three lines at most and an empty one; none of no text."""
    wrapped = textwrap.wrap(" ".join(about), width, max_lines=3, placeholder=" …")
    return [*wrapped, ""] if wrapped else []


def preview(steps: "Sequence[OperatorStep]", width: int, room: int) -> list[str]:
    """What is in a profile: a head, and a line a segment as far as there is room."""
    shown = [f"{n:3d}  {step.text.removeprefix('go to ')}, {step.seconds:g} s" for n, step in enumerate(steps, 1)]
    lines = [f"{line}   {testable(step.shows, width - len(line) - 3)}" for line, step in zip(shown, steps, strict=True)]
    if len(lines) > room:
        lines = [*lines[: room - 1], f"  …  and {len(lines) - room + 1} more segments"]
    return ["what to do, and what each segment makes testable", *lines]


def segment(told: SegmentDescription, number: int, guide: GuideSnapshot | None, room: int) -> str:
    """A segment (0 is the first) in a line, with `room` characters for what to do."""
    seconds_left, marked = left(guide, number), begun(guide, number)
    parts = [
        f"{number + 1:3d}  ",
        f"{formatting.shorten(told['text'], room):<{room}}",
        f"{told['seconds']:6.0f} s",
        f"  {state_word(guide, number):<8}",
        f"{f'{seconds_left:4.0f} s' if seconds_left is not None else '':>7}",
        f"  {formatting.clock(marked) if marked is not None else '–':>8} ",
    ]
    return "".join(parts)
