"""Table profiles that need no file: they have names, which do wherever the path of a profile's file does.

A file of that name goes first, so that nothing that lies in a folder is ever out of reach.
"""

import math
from dataclasses import dataclass

from filters.motion.profile import Profile
from filters.motion.segments import AXES, SIX, TWELVE, positions, turns
from imutui.logbook import reference_file

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
