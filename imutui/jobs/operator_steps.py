"""A table profile as a list for an operator: what to do, for how long, and what each segment makes testable.

What it leaves out: where the operator is in it, which the acquisition knows.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from filters.errors import InputError
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Sampled, Segment
from filters.tracing import detectability
from filters.tracing.detectability import BIAS, TESTABLE, Quantity
from imutui import outside_file
from imutui.document_shape import VERSION
from imutui.jobs import log_files
from imutui.logbook import atomic_file, reference_file
from imutui.logbook.reference_file import NamedProfile

_ACCELS = ("ax", "ay", "az")
# what is told first is what matters most
_WORDS = {
    BIAS: "bias",
    "scale": "scale factor",
    "g_sensitivity": "g-sensitivity",
    "cross_axis": "misalignment",
    "asymmetry": "± asymmetry",
    "g_squared": "quadratic",
    "nonlinearity_quadratic": "quadratic",
    "nonlinearity_cubic": "cubic",
    "tilt": "tilt of base",
    "lever_arm": "lever arm",
    "delay": "delay",
    "earth_rate": "Earth rate",
}
_SUFFIXES = (".toml", ".csv")
_PARTNERS = ("scale", "cross_axis", "tilt")
_EXPERIMENT = "experiment.toml"
READY_MADE = "ready-made"  # place of a profile that lies in no folder


@dataclass(frozen=True, slots=True)
class Offer:
    """A profile that can be chosen."""

    name: str  # of the file, or in words of one that is ready-made
    place: str  # folder, "ready-made" without one
    text: str = ""  # content of the file, TOML or CSV by `file`; empty if it cannot be used
    file: str = ""  # name that goes with the text
    segments: int = 0  # how many
    seconds: float = 0.0  # of the motion, with the moves as fast as the profile has them
    align: str = ""  # how it is joined to a log
    error: str = ""  # why it cannot be used
    still: bool = False  # whether the table rests in one place all the time

    @property
    def about(self) -> list[str]:
        """What it is for, and what else is to be done, as its file says at the top."""
        return reference_file.about(self.text)


@dataclass(frozen=True, slots=True)
class OperatorStep:
    """A segment as the operator has it: what to do, for how long, what becomes testable."""

    text: str
    seconds: float
    shows: tuple[str, ...]


# ---------------------------------------------------------------------------------------------- profiles to choose from


def ready_made() -> list[Offer]:
    """Profiles that need no file."""
    return [_ready(made) for made in reference_file.ready_made()]


def _ready(made: NamedProfile) -> Offer:
    return _offer(made.profile, made.name, READY_MADE, made.text, made.file)


def offers(folders: Iterable[Path]) -> list[Offer]:
    """Ready-made profiles, and what looks like one in some folders (not in folders of theirs), by name."""
    return [*ready_made(), *(offer_of(path) for path in log_files.files_in(folders, _SUFFIXES, _meant_as_profile))]


def of_trace(text: str, source: str) -> Offer:
    """The motion that a trace recommends, as it is in memory."""
    return _offer(load(_EXPERIMENT, text), "experiment that the last trace wants", source, text, _EXPERIMENT)


def save(offer: Offer, path: Path) -> None:
    """Write a profile to a new file.

    Raises InputError if its name does not end as that of such a file does.
    Raises OSError if it exists, or cannot be written.
    """
    suffix = Path(offer.file).suffix.lower()
    if path.suffix.lower() != suffix:
        raise InputError(f"{path} does not end in {suffix}, as a profile of this kind does")
    atomic_file.write(path, offer.text, overwrite=False)


def offer_of(path: Path) -> Offer:
    """Profile of a file, or of a name; one that cannot be used says why."""
    place = str(path.parent)
    named = None if path.exists() else reference_file.find(str(path))
    if named is not None:
        return _ready(named)
    if path.exists() and not path.is_file():
        # a device would be read for ever, and from under whoever has it
        return Offer(path.name, place, error="is no file")
    if path.suffix.lower() not in _SUFFIXES:
        error = f"is neither .toml nor .csv by its name, nor a ready-made profile: {reference_file.listed()}"
        return Offer(path.name, place, error=error)
    try:
        content = outside_file.read(path, outside_file.TEXT_LIMIT)
        profile = reference_file.parse(path.name, content)
        if not isinstance(profile, Profile):
            raise InputError(f"{path.name} is a trajectory: nothing for an operator to follow")
        text = content.decode("utf-8-sig")
    except OSError as error:
        return Offer(path.name, place, error=f"can't be read: {error.strerror or error}")
    except InputError as error:
        return Offer(
            path.name, place, error=str(error).removeprefix(f"{path.name} ").removeprefix("is no table profile: ")
        )
    return _offer(profile, path.name, place, text, path.name)


def _offer(profile: Profile, name: str, place: str, text: str, file: str) -> Offer:
    still = len(profile.segments) == 1 and isinstance(profile.segments[0], Dwell)
    return Offer(name, place, text, file, len(profile.segments), profile.duration, profile.align, still=still)


def _meant_as_profile(path: Path) -> bool:
    """Whether a file has a profile's segments or heading; settings, effects and trajectories have neither."""
    try:
        if path.stat().st_size > outside_file.TEXT_LIMIT:
            return False
        with path.open(encoding="utf-8-sig", errors="replace") as stream:
            if path.suffix.lower() == ".csv":
                heading = stream.readline(256).split(",")
                return tuple(cell.strip() for cell in heading) == reference_file.PROFILE_COLUMNS
            return any(line.strip().startswith("[[segment]]") for line in stream)
    except OSError:
        return False


def by_hand(offer: Offer) -> Offer | None:
    """The same profile joined to a log by the operator's marks; None if nobody can follow it by hand."""
    profile = load(offer.file, offer.text)
    if any(isinstance(segment, Sampled) for segment in profile.segments):
        return None
    marked = replace(profile, align="marks")
    return replace(offer, text=reference_file.to_toml(marked, offer.about), align=marked.align)


def load(name: str, text: str) -> Profile:
    """Profile of a text; InputError with what is wrong."""
    found = reference_file.parse(name, text.encode())
    if not isinstance(found, Profile):
        raise InputError(f"{name} is a trajectory, not a table profile")
    return found


# -------------------------------------------------------------------------------------------------------- what it shows


def steps(profile: Profile) -> list[OperatorStep]:
    """Segments of a profile as an operator has them, in order."""
    shown = makes_observable(profile)
    return [
        OperatorStep(reference_file.in_words(segment), seconds_of(segment), tuple(own))
        for segment, own in zip(profile.segments, shown, strict=True)
    ]


def document(profile: Profile, name: str, steps: Sequence[OperatorStep]) -> dict[str, object]:
    """Return the steps of a profile with its name and length, JSON-ready."""
    return {
        "version": VERSION,
        "profile": name,
        "align": profile.align,
        "duration_s": profile.duration,
        "segments": [
            {"number": n, "text": step.text, "seconds": step.seconds, "makes_testable": list(step.shows)}
            for n, step in enumerate(steps, 1)
        ],
    }


def seconds_of(segment: Segment) -> float:
    """How long a segment lasts, without moves and ramps."""
    return segment.t[-1] - segment.t[0] if isinstance(segment, Sampled) else segment.seconds


def makes_observable(profile: Profile) -> list[list[str]]:
    """For each segment the effects and biases that become testable with it, in words, the most important first.

    Testable is what stands out of the noise of the segments so far and of what all others could make of it
    (`filters.tracing.detectability`); the first segment also says which biases it only shows as a sum. Made as it is
    written; of a profile that is joined by marks, at rest only.
    """
    seen: set[Quantity] = set()
    out = []
    for number, told in enumerate(detectability.of_motion(profile)):
        new = [q for q, d in told.items() if d >= TESTABLE and q not in seen]
        seen.update(new)
        items = _grouped(new)
        if number == 0:
            items += _sums(seen)
        out.append(items)
    return out


def _grouped(quantities: Sequence[Quantity]) -> list[str]:
    """One item an effect: "g-sensitivity gx gy gz to y z"; effects of one name make one item too."""
    items: dict[str, list[str]] = {}
    for effect, word in _WORDS.items():
        axes: dict[str, str] = {}
        for q in quantities:
            if q.effect == effect:
                axes[q.channel] = f"{axes.get(q.channel, '')} {q.axis}".strip()
        alike: dict[str, list[str]] = {}
        for channel, along in axes.items():
            alike.setdefault(along, []).append(channel)
        for along, channels in alike.items():
            to = f" to {along}" if along and channels[0] else along
            items.setdefault(word, []).append(f"{' '.join(channels)}{to}")
    return [f"{word} {', '.join(parts)}".strip() for word, parts in items.items()]


def _sums(seen: set[Quantity]) -> list[str]:
    hidden = [name for name in _ACCELS if Quantity(BIAS, name, "") not in seen]
    if not hidden:
        return []
    return [f"bias {' '.join(hidden)} in sum with {', '.join(_WORDS[p] for p in _PARTNERS)}"]
