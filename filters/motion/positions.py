"""Motions that many profiles are made of: rests in given positions, turns of one axis between rests."""

import math
from collections.abc import Sequence

from filters.motion.segments import Dwell, Rate, Segment

LEVEL = Dwell((0.0, 0.0, 0.0), 10.0)  # a short rest, level
SIX = ((0, 0, 0), (90, 0, 0), (180, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0))
"""Each axis up and down: outer, middle, inner, deg."""
TWELVE = (
    *((0, 0, 90), (0, 0, 180), (45, 0, 0), (-45, 0, 30), (0, 45, 60), (0, -45, 0)),
    *((45, 45, 0), (30, -45, 90), (135, 0, 0), (-135, 0, 0), (90, 0, 90), (-90, 0, 45)),
)
"""Twelve more, in between."""


def positions(angles_deg: Sequence[tuple[float, float, float]], seconds: float) -> list[Segment]:
    """Dwells at angles, and back to level."""
    made = [Dwell((math.radians(o), math.radians(m), math.radians(i)), seconds) for o, m, i in angles_deg]
    return [*made, LEVEL]


def turns(axis: str, rates: Sequence[float]) -> list[Segment]:
    """One axis turned at each of some rates, rad/s, between rests."""
    return [LEVEL, *(Rate(axis, rate, 24.0) for rate in rates), LEVEL]
