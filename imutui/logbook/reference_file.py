"""A reference that travels in a log, or lies in a file beside it, as the motion that the filter takes.

A table profile as a TOML document (angles in degrees; what segments mean is in `filters.motion.segments`)::

    align = "marks"               # "none", "marks" or "gyro": how profile time is joined to log time
    sign = [1, 1, -1]             # of each axis, default 1
    offset_sd_s = 0.05            # standard deviation of that joint, s; absent where it is not known
    slew_dps = 20.0               # of moves
    accel_dps2 = 100.0            # of moves and of ramps

    [[segment]]
    kind = "dwell"
    angles_deg = [0.0, 90.0, 0.0] # outer, middle, inner
    seconds = 30.0

    [[segment]]
    kind = "rate"
    axis = "inner"
    rate_dps = 30.0
    seconds = 12.0

    [[segment]]
    kind = "sine"
    axis = "middle"
    amplitude_deg = 10.0
    hz = 0.5
    seconds = 20.0
"""

import csv
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, Required, TypedDict

import numpy as np

from filters.errors import InputError
from filters.motion import profile
from filters.motion.profile import ALIGNS, Profile
from filters.motion.reference import Trajectory
from filters.motion.segments import AXES, SIX, TWELVE, Dwell, Rate, Sampled, Segment, Sine, positions, turns
from imutui import declared, toml_text
from imutui.declared import Meta
from imutui.logbook import reference_file, trajectory_file
from imutui.plain_text import NOTE_LIMIT, one_line
from imutui.toml_text import Document

ATTACHMENTS = ("reference.toml", "reference.csv")  # names under which a reference travels
PROFILE_COLUMNS = ("t", "outer", "middle", "inner")
_NEAREST_S, _SMALLEST = 1e-6, 1e-15


@dataclass(frozen=True, slots=True)
class ReferenceFile:
    """A reference as it travels in a log."""

    kind: str  # "trajectory" or "profile"
    # name, media_type: of the attachment: reference.csv or reference.toml
    name: str
    media_type: str
    content: bytes  # as the file has it

    def motion(self) -> Profile | Trajectory:
        """What it says; raises InputError if that cannot be."""
        return parse(self.name, self.content)


def parse(name: str, content: bytes) -> Profile | Trajectory:
    """Motion of a file's content: a profile (TOML, or CSV of table angles) or a trajectory (CSV).

    `name`: of the file, for its suffix and for messages.
    `content`: UTF-8 text.
    Raises InputError if it is neither; the message names file, line or key.
    """
    text = text_of(content, name)
    if name.lower().endswith(".toml"):
        try:
            return from_document(toml_text.parse(content))
        except InputError as error:
            raise InputError(f"{name} is no table profile: {error}") from error
    first = next(csv.reader([text.splitlines()[0] if text else ""]), [])
    if tuple(cell.strip() for cell in first) == PROFILE_COLUMNS:
        return parse_angles(text, name)
    return trajectory_file.parse(text, name)


def text_of(content: bytes, name: str) -> str:
    """Text of a file's bytes, which are to be UTF-8; raises InputError if they are not."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{name} is not a text file ({error})") from error


def parse_angles(text: str, name: str) -> Profile:
    """Profile of a CSV text `t, outer, middle, inner` (s, deg).

    Raises InputError if a cell is no number, or time does not increase; the message names the line.
    """
    columns = trajectory_file.table(text, name, PROFILE_COLUMNS, PROFILE_COLUMNS, empty=False)
    t, *angles = (columns[column] for column in PROFILE_COLUMNS)
    near = np.diff(t) < _NEAREST_S
    if near.any():
        raise InputError(f"{name}, row {int(np.argmax(near)) + 3}: time does not increase by a microsecond at least")
    for values in (t, *angles):
        values[np.abs(values) < _SMALLEST] = 0.0  # what is left of a zero by other programs' arithmetic
    outer, middle, inner = map(np.deg2rad, angles)
    try:
        return profile.from_samples(t, outer, middle, inner)
    except InputError as error:
        raise InputError(f"{name}: {error} (rows counted from 0, after the heading)") from error


# -------------------------------------------------------------------------------------- a profile as a TOML document


def from_document(document: Document, where: str = "") -> Profile:
    """Return the profile in the content of a TOML file; the module shows one.

    `document`: as `tomllib` gives it; its content is not trusted.
    `where`: table in the file that the document is; empty for the whole file.
    Raises InputError if a key is missing, unknown, or has a value that does not fit; the message names it.
    """
    if "samples" in document:
        raise InputError(
            "`samples` is for a virtual unit's profile (`imutui virtual --scenario`); here name the CSV file itself,"
            f" whose heading is {','.join(PROFILE_COLUMNS)}"
        )
    return declared.make(document, _Profile, Profile, where)


def _turning(dps: float) -> float:
    if dps == 0.0:
        raise InputError("`rate_dps` is 0, and a dwell rests")
    return math.radians(dps)


_Radians = Annotated[float, Meta(make=math.radians)]
_Positive = Annotated[float, Meta(above=0.0)]
_PositiveRadians = Annotated[float, Meta(above=0.0, make=math.radians)]
_Sign = Literal[-1, 1]
_Axis = Annotated[str, Meta(allowed=AXES)]


class _Dwell(TypedDict):
    kind: Literal["dwell"]
    angles_deg: Annotated[
        tuple[_Radians, _Radians, _Radians], Meta(to="angles", words="three angles: [outer, middle, inner]")
    ]
    seconds: _Positive


class _Rate(TypedDict):
    kind: Literal["rate"]
    axis: _Axis
    rate_dps: Annotated[float, Meta(to="rate", make=_turning)]
    seconds: _Positive


class _Sine(TypedDict):
    kind: Literal["sine"]
    axis: _Axis
    amplitude_deg: Annotated[_PositiveRadians, Meta(to="amplitude")]
    hz: _Positive
    seconds: _Positive


_SEGMENTS: dict[str, type[Segment]] = {"dwell": Dwell, "rate": Rate, "sine": Sine}
_Segment = Annotated[_Dwell | _Rate | _Sine, Meta(make=lambda made: _SEGMENTS[made.pop("kind")](**made))]


class Joint(TypedDict, total=False):
    """Keys of a profile that say how its angles and its time are joined to those of a log."""

    align: Annotated[str, Meta(allowed=ALIGNS)]
    sign: tuple[_Sign, _Sign, _Sign]
    offset_sd_s: Annotated[float, Meta(least=0.0, to="offset_sd")]


class _Profile(Joint, total=False):
    slew_dps: Annotated[_PositiveRadians, Meta(to="slew")]
    accel_dps2: Annotated[_PositiveRadians, Meta(to="accel")]
    segment: Required[Annotated[list[_Segment], Meta(to="segments", make=tuple)]]


def about(text: str) -> list[str]:
    """What the comment at the top of a document says, a line each: what it is for, what else to do."""
    said = itertools.takewhile(lambda line: line.startswith("#"), text.lstrip("\ufeff").splitlines())
    return [line.removeprefix("#").strip() for line in said]


def to_toml(profile: Profile, about: Sequence[str] = ()) -> str:
    """Text of a TOML document that `from_document` reads as the same profile, to a billionth of a degree.

    `profile`: without sampled angles, which belong into a CSV file.
    `about`: lines of a comment at the top.
    Raises InputError if a segment is sampled.
    """
    head = {"align": profile.align, "sign": profile.sign, "offset_sd_s": profile.offset_sd}
    head |= {"slew_dps": _degrees(profile.slew), "accel_dps2": _degrees(profile.accel)}
    said = [f"# {one_line(line, NOTE_LIMIT)}" for line in about]
    return "\n\n".join(["\n".join([*said, _lines(head)]), *map(_segment_text, profile.segments)]) + "\n"


def _lines(table: Mapping[str, object]) -> str:
    return "\n".join(f"{key} = {toml_text.value(of)}" for key, of in table.items() if of is not None)


def _segment_text(segment: Segment) -> str:
    own: dict[str, object]
    match segment:
        case Dwell():
            own = {"kind": "dwell", "angles_deg": [_degrees(angle) for angle in segment.angles]}
        case Rate():
            own = {"kind": "rate", "axis": segment.axis, "rate_dps": _degrees(segment.rate)}
        case Sine():
            own = {"kind": "sine", "axis": segment.axis, "amplitude_deg": _degrees(segment.amplitude)}
            own["hz"] = float(segment.hz)
        case Sampled():
            raise InputError("`profile` has sampled angles: they belong into a CSV file")
    return f"[[segment]]\n{_lines(own | {'seconds': float(segment.seconds)})}"


def in_words(segment: Segment) -> str:
    """Return a segment as an instruction to the operator of the table."""
    match segment:
        case Dwell():
            outer, middle, inner = (f"{_degrees(angle):z.6g}°" for angle in segment.angles)
            return f"go to outer {outer}, middle {middle}, inner {inner}"
        case Rate():
            return f"turn {segment.axis} at {_degrees(segment.rate):+.6g} deg/s"
        case Sine():
            return f"swing {segment.axis} by ±{_degrees(segment.amplitude):.6g}° at {segment.hz:.6g} Hz"
        case Sampled():
            return "follow the recorded angles"


def _degrees(radians: float) -> float:
    # what was written in degrees comes back as it was written
    return round(math.degrees(radians), 9)


# ----------------------------------------------------------------------------------------------------- named profiles
# Table profiles that need no file: they have names, which do wherever the path of a profile's file does.
#
# A file of that name goes first, so that nothing that lies in a folder is ever out of reach.

_LONG_S, _BRIEF_S = 30.0, 20.0


@dataclass(frozen=True, slots=True)
class NamedProfile:
    """A profile that is ready-made."""

    name: str  # in words
    file: str  # name of a file of it
    profile: Profile  # its motion

    @property
    def text(self) -> str:
        """As a TOML document."""
        return reference_file.to_toml(self.profile)


def ready_made() -> tuple[NamedProfile, ...]:
    """All there are."""
    six = positions(SIX, _LONG_S)
    eighteen = positions((*SIX, *TWELVE), _BRIEF_S)
    rates = [math.radians(rate) for rate in (30.0, -30.0, 90.0, -90.0)]
    spins = [segment for axis in reversed(AXES) for segment in turns(axis, rates)]
    return (
        NamedProfile(f"six positions, {_LONG_S:.0f} s each", "six positions.toml", Profile(tuple(six), align="marks")),
        NamedProfile(
            f"eighteen positions, {_BRIEF_S:.0f} s each",
            "eighteen positions.toml",
            Profile(tuple(eighteen), align="marks"),
        ),
        NamedProfile(
            "six positions, each axis ±30 ±90 deg/s",
            "six positions and rates.toml",
            Profile((*six, *spins), align="gyro"),
        ),
    )


def find(name: str) -> NamedProfile | None:
    """The profile of a name, None if none has it; capitals and spaces don't count, and +- is ±."""
    wanted = _plain(name)
    return next((made for made in ready_made() if _plain(made.name) == wanted), None)


def _plain(name: str) -> str:
    return "".join(name.replace("+-", "±").casefold().split())


def listed() -> str:
    """The names, for a message to somebody who used another."""
    return "; ".join(f'"{made.name}"' for made in ready_made())
