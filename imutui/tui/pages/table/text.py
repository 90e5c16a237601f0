"""What the table page says: where the operator is in a profile, and what to do next. Pure functions."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from imutui.tui import formatting

Guide = Mapping[str, Any]
WORKING_OUT = "working out…"
NOTHING_NEW = "nothing new by itself"
_VIRTUAL = (
    "a virtual unit does not turn by hand: from segment 2 on its filter will say RED, unless its scenario follows this"
    " profile"
)
_ALIGNS = {
    "none": "profile time is the log's time",
    "marks": "joined by your marks",
    "gyro": "joined by the gyros",
}
_THERE = {
    "dwell": "Enter when the table is there and at rest.",
    "rate": "Enter when it turns at that rate.",
    "sine": "Enter when it swings.",
    "sampled": "Enter when it starts.",
}
_BY_ITSELF = {
    "none": ("The table runs this by itself.", "Its clock is the log's: start it with r, at the same moment."),
    "gyro": ("The table runs this by itself.", "r records; then start the table. The gyros tell when it began."),
}
_HOLDING = {
    "dwell": "Leave the table alone.",
    "rate": "Keep it turning.",
    "sine": "Keep it swinging.",
    "sampled": "Let it move.",
}


def state_word(guide: Guide | None, number: int) -> str:
    """Of a segment (0 is the first): "done", "left out", "now", "next" or "to do"."""
    if guide is None:
        return "to do"
    at = int(guide["count"]) if guide["state"] == "done" else int(guide["segment"])
    if number < at:
        return "done" if begun(guide, number) is not None else "left out"
    if number == at:
        return "next" if guide["state"] == "cancelled" else "now"
    return "next" if number == at + 1 and guide["state"] != "cancelled" else "to do"


def begun(guide: Guide | None, number: int) -> float | None:
    """When a segment began, s since the take began."""
    times = list(guide["begun"]) if guide is not None else []
    return times[number] if number < len(times) else None


def left(guide: Guide | None, number: int) -> float | None:
    """Seconds left of a segment, if it is being held."""
    if guide is None or guide["state"] != "hold" or guide["segment"] != number:
        return None
    return None if guide["left_s"] is None else float(guide["left_s"])


def title(profile: Mapping[str, Any], seconds: float | None) -> str:
    """Name, number of segments, how long without the moves, how it is joined."""
    name = formatting.profile_name(str(profile["name"]))
    length = "" if seconds is None else f", {span(seconds)} without the moves"
    joined = _ALIGNS.get(str(profile.get("align", "")), "")
    return f"{name}: {formatting.plural(len(profile['segments']), 'segment')}{length}{', ' + joined if joined else ''}"


def span(seconds: float) -> str:
    """m:ss."""
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"


def said(guide: Guide | None, profile: Mapping[str, Any], recording: bool, guided: bool = True) -> tuple[str, str]:
    """What the operator is to do now, and what happens then."""
    segments = profile["segments"]
    if guide is None and not guided:
        return _BY_ITSELF.get(str(profile.get("align")), _BY_ITSELF["none"])
    if guide is None or can(guide, recording) == {"begin"}:
        first = "Segment 1 is asked for" if recording else "A recording starts, and segment 1 is asked for"
        return _before(guide), f"{first}. p takes another profile."
    number = min(int(guide["segment"]), len(segments) - 1)
    segment = segments[number]
    of = f"Segment {number + 1} of {len(segments)}"
    match guide["state"]:
        case "go":
            return f"{of}: {segment['text']}", f"I wait for you. {_THERE[segment['kind']]}"
        case "hold":
            after = "Then I ask for the next." if number + 1 < len(segments) else "Then all is done."
            return f"{of}: {_holding(str(segment['text']))}", f"{_HOLDING[segment['kind']]} {after}"
        case "cancelled":
            where = f"Cancelled at segment {number + 1} of {len(segments)}."
            return where, "The recording goes on: b resumes there, r finishes the file."
    return f"All {len(segments)} segments are done.", "r finishes the file; then 6 (Logs) traces it."


def warning(now: Mapping[str, Any], width: int) -> list[str]:
    """Before a guide begins: that a virtual unit stays where it is, in lines of at most so many characters."""
    begins = can(now.get("guide"), now.get("recording") is not None) == {"begin"}
    if now.get("kind") != "simulated" or not begins:
        return []
    return textwrap.wrap(_VIRTUAL, width)


def _before(guide: Guide | None) -> str:
    if guide is None:
        return "b begins."
    last = "done" if guide["state"] == "done" else "cancelled"
    return f"The last time is {last}, its file finished (6 Logs traces it). b begins again."


def can(guide: Guide | None, recording: bool) -> set[str]:
    """What can be asked of the guide: one way through a profile belongs to one recording."""
    state = None if guide is None else guide["state"]
    if state in ("done", "cancelled") and recording:
        return {"resume"} if state == "cancelled" else set()
    return {"go": {"there", "cancel"}, "hold": {"cancel"}}.get(str(state), {"begin"})


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
