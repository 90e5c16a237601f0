"""Turns the table under a virtual unit of an acquisition's own, as the operator of a profile says.

A motion is a line of JSON on the standard input of the unit's process, never on its serial line; the unit moves as
`motion_of` says, and so the acquisition knows when it has come to rest.
"""

import json
import math
from collections.abc import Callable
from dataclasses import asdict

import numpy as np

from filters.errors import InputError
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Sampled, Segment, Sine

_SEGMENTS: dict[str, type[Dwell | Rate | Sine]] = {kind.__name__: kind for kind in (Dwell, Rate, Sine)}
_BEFORE_S = 0.01
# from the line's writing to the first reading that has it
_LATENCY_S = 0.2


class TableTurner:
    """Knows where the table is; `write` takes lines for the unit's process."""

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write
        self._angles = (0.0, 0.0, 0.0)  # rotations about north, east, down, rad
        self._rests_ns: int | None = None

    def turn(self, profile: Profile, segment: Segment, now_ns: int) -> None:
        """Have the table go to a dwell, or begin another motion; sampled ones are not done.

        Raises InputError if it turns still.
        """
        if self._rests_ns is not None:
            raise InputError(f"the virtual unit turns for another {self.left_s(now_ns):.0f} s; it marks by itself")
        if isinstance(segment, Sampled):
            return
        line = json.dumps(
            {
                "before": [angle * sign for angle, sign in zip(self._angles, profile.sign, strict=True)],
                "kind": type(segment).__name__,
                "segment": asdict(segment),
                "sign": profile.sign,
                "slew": profile.slew,
                "accel": profile.accel,
            }
        )
        motion = motion_of(line)
        self._write(line)
        end = motion.angles(motion.duration)[0].tolist()
        # whole turns are not unwound
        x, y, z = end if isinstance(segment, Dwell) else (math.remainder(angle, 2.0 * math.pi) for angle in end)
        self._angles = x, y, z
        # the operator's word begins a motion; of a dwell it says that the table rests
        moves_s = float(motion.rest_starts[1]) if isinstance(segment, Dwell) else 0.0
        self._rests_ns = now_ns + round((moves_s + _LATENCY_S) * 1e9)

    def left_s(self, now_ns: int) -> float | None:
        """For how long it turns still; None if nothing is awaited."""
        return None if self._rests_ns is None else max(0.0, (self._rests_ns - now_ns) / 1e9)

    def has_arrived(self, now_ns: int) -> bool:
        """Whether what was asked for last is there now; once."""
        if self._rests_ns is None or now_ns < self._rests_ns:
            return False
        self._rests_ns = None
        return True

    def leave(self) -> None:
        """Await nothing any more; what has begun comes to its end."""
        self._rests_ns = None


def motion_of(line: str) -> Profile:
    """Motion that a line asks for; raises ValueError, KeyError or TypeError if it asks for none."""
    asked = json.loads(line)
    segment = _SEGMENTS[asked["kind"]](**asked["segment"])
    x, y, z = (float(angle) for angle in np.array(asked["before"]))
    sign = tuple(asked["sign"])
    return Profile((Dwell((x, y, z), _BEFORE_S), segment), sign, slew=asked["slew"], accel=asked["accel"])
