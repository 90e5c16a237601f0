"""Findings on the health of a channel: their kinds, how much each one matters, and what helps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypedDict

Kind = Literal[
    "dead", "frozen", "copy", "clipped", "invalid", "coarse", "repeated", "noisy", "quiet", "moving", "temperature"
]
Level = Literal["wait", "bad"]

ADVICE: dict[Kind, str] = {
    "dead": "check the sensor and its wiring: its bias is not known",
    "frozen": "restart the unit and check the channel: its bias is not known",
    "copy": "check the wiring and the program that read the unit: at least one of the two channels is not measured",
    "clipped": "use a larger range, or remove what drives the channel to its limit",
    "invalid": "leave the invalid readings out, and check the line and the program that read the unit",
    "coarse": "record the full resolution of the unit, without rounding",
    "repeated": "record each reading once, at the rate at which the unit makes them",
    "noisy": "check the mounting, the supply and the units of the readings",
    "quiet": "check the units (deg/s, g) of the readings and their low-pass; if both are right: --set filter.noise=log",
    "moving": "wait until the bias is steady, or record again",
    "temperature": "check the temperature sensor: effects of temperature cannot be judged",
}
"""What to do about each kind. The kinds come in the order of their weight."""

BAD: tuple[Kind, ...] = ("dead", "frozen", "copy", "clipped")
NO_BIAS: tuple[Kind, ...] = ("dead", "frozen")
"""Kinds that leave nothing to estimate a bias from."""


class HealthEntry(TypedDict):
    """A finding as JSON has it."""

    channel: str
    kind: Kind
    since_s: float
    level: Level
    said: str


@dataclass(frozen=True, slots=True)
class HealthFinding:
    """One fault of one channel."""

    channel: str  # gx, gy, gz, ax, ay, az or T
    kind: Kind
    since_s: float  # when it began, or was first seen, s since the first reading
    said: str  # a sentence without its full stop
    level: Level = "wait"

    @property
    def todo(self) -> str:
        """What helps."""
        return ADVICE[self.kind]


def without_bias(entries: Sequence[HealthEntry], channel: str) -> str | None:
    """Return why a channel has no bias, such as `gy is frozen`; None for a channel that measures something."""
    kinds = [one["kind"] for one in entries if one["channel"] == channel and one["kind"] in NO_BIAS]
    return f"{channel} is {kinds[0]}" if kinds else None


def of_kind(kind: Kind, channel: str, since_s: float, said: str) -> HealthFinding:
    """Make a finding with the level of its kind."""
    return HealthFinding(channel, kind, since_s, said, "bad" if kind in BAD else "wait")
