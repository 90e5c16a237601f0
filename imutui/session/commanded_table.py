"""The table under an acquisition's command: it carries out a profile's segments, one after the other, by itself.

A segment begins when the table is there: a dwell once it has settled, a rate once it turns at it, a sine once it
swings. The keeper, a process of its own, has the link and is the gate of all commands; see `imutui.table.keeper`.
"""

import itertools
import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from filters.errors import InputError
from filters.motion.profile import Profile
from filters.motion.segments import AXES, Dwell, Rate, Sampled, Segment, Sine
from imutui.instrument.driver import InstrumentError
from imutui.session.snapshot import ControllerSnapshot
from imutui.table import gate
from imutui.table.controller import RESTS_DPS, TableError, TableState
from imutui.table.gate import in_degrees
from imutui.table.owner import KeptTable

SETTLED_DEG, SETTLED_S = 0.02, 1.0
"""A dwell begins when all axes have been so near to where they should be, and stood still, for so long."""
_RATE_S, _RATE_SHARE, _RATE_DPS = 0.3, 0.01, 0.05
_SETTLE_PATIENCE_S = 60.0
_KEPT_S = 1.5 * SETTLED_S
_SWINGS, _PERIODS = 0.9, 3.0  # a sine begins at this share of its amplitude, or after so many periods at half of it
_MOVING = 0.1  # deg/s: what is told as a table that moves


@dataclass(frozen=True, slots=True)
class _Step:
    """A command, and when the next one may be sent."""

    command: dict[str, object]
    is_there: Callable[[], bool]
    seconds: float  # that it takes, about


class CommandedTable:
    """Commands a table through its keeper. `url`, `limits_text`: as `KeptTable` has them.

    `slack`: how much more patience than usual: the times that time runs faster.
    Raises InstrumentError if there is no controller.
    """

    def __init__(self, url: str, limits_text: str = "", slack: float = 1.0) -> None:
        self.lives: Callable[[], bool] = lambda: True  # whether whoever commands does its work still
        self._url, self._limits_text = url, limits_text
        self._slack = slack
        self._kept = self._begin()
        self._recent: deque[TableState] = deque()
        self._steps: deque[_Step] = deque()
        self._counter = itertools.count(1)
        self._stops = self._seen_stops = 0  # how often the table was told to stop, and how often the worker has seen it
        self._keep_s = _KEPT_S  # how far back readings are looked at
        self._sent_ns = 0  # when the present step's command was sent
        self._until_ns: int | None = None  # by when the present step must be done
        self._turned: Rate | Sine | None = None
        self.why_failed = ""  # why the table was stopped, where somebody must look at it

    def _begin(self) -> KeptTable:
        try:
            return KeptTable(self._url, self._limits_text, lambda: self.lives())
        except TableError as error:
            raise InstrumentError(str(error)) from error

    @property
    def identity(self) -> str:
        """What the controller says of itself."""
        return self._kept.identity

    def check(self, profile: Profile) -> None:
        """Refuse a profile that goes beyond the table's limits anywhere; raises InputError that names the segment."""
        newest = self._kept.newest
        gate.check_profile(profile, self._kept.limits, (0.0,) * 3 if newest is None else newest.angles_deg)

    def enable(self) -> None:
        """Close the interlock: somebody has said that the table may move. Raises InputError if it does not close."""
        try:
            if self._kept.has_ended:
                self._kept = self._begin()
            self._heed()
            self._kept.ask(do="enable", stops=self._seen_stops)
        except (TableError, InstrumentError) as error:
            raise InputError(str(error)) from error
        self.why_failed = ""

    @property
    def failed(self) -> bool:
        """Whether the table was stopped for a reason that somebody must look at."""
        return bool(self.why_failed)

    def tell(self, why: str) -> None:
        """Have it told why the table was stopped from here."""
        self._kept.news.append((why, True))

    # -- a profile's segments -----------------------------------------------------------------------------------------

    @property
    def is_idle(self) -> bool:
        """True if the table is on the way to nothing."""
        self._heed()
        return not self._steps

    def _heed(self) -> None:
        """Forget the steps if the table was told to stop: any thread may do that, and only the worker has steps."""
        stops = self._stops
        if stops != self._seen_stops:
            self._seen_stops = stops
            self._steps.clear()
            self._turned = None

    def turn(self, profile: Profile, segment: Segment, now_ns: int) -> None:
        """Begin to go to a segment; `has_arrived` says when it is there. Raises InputError of one that can't be."""
        self._heed()
        pace = gate.pace(profile, self._kept.limits)
        slowest = min(rate for rate, _ in pace.values())
        self._end_turning(pace)
        match segment:
            case Dwell(angles):
                targets = [in_degrees(angle) for angle in angles]
                # one rate for all axes: that of the slowest
                move = {"do": "move", "angles_deg": targets, "rate_dps": slowest}
                move["accel_dps2"] = min(accel for _, accel in pace.values())
                self._add(move, lambda: self._settled(targets), self._farthest(targets) / slowest + SETTLED_S)
            case Rate(axis, rate_rps):
                dps, (_, accel) = in_degrees(rate_rps), pace[axis]
                turn = {"do": "rate", "axis": axis, "rate_dps": dps, "accel_dps2": accel}
                self._add(turn, lambda: self._turns_at(axis, dps), abs(dps) / accel + SETTLED_S)
                self._turned = segment
            case Sine(axis, amplitude, hz):
                size = in_degrees(amplitude)
                swing = {"do": "oscillate", "axis": axis, "amplitude_deg": size, "hz": hz}
                self._keep_s = max(_KEPT_S, 1.2 / hz)
                self._add(swing, lambda: self._swings(axis, size, 1.0 / hz), 3.0 / hz)
                self._turned = segment
            case Sampled():
                raise InputError("a controller is commanded by dwells, rates and sines; this is a row of angles")
        self._send_first(now_ns)

    def _farthest(self, targets: Sequence[float]) -> float:
        """Return the longest way of an axis to its target, deg."""
        now = targets if self._kept.newest is None else self._kept.newest.angles_deg
        return max(360.0, *(abs(there - here) for there, here in zip(targets, now, strict=True)))

    def _end_turning(self, pace: Mapping[str, tuple[float, float]]) -> None:
        turned, self._turned = self._turned, None
        if isinstance(turned, Rate):
            still = {"do": "rate", "axis": turned.axis, "rate_dps": 0.0, "accel_dps2": pace[turned.axis][1]}
            self._add(still, self._stands, abs(in_degrees(turned.rate)) / pace[turned.axis][1] + SETTLED_S)
        elif isinstance(turned, Sine):
            end = {"do": "oscillate", "axis": turned.axis, "amplitude_deg": 0.0, "hz": turned.hz}
            self._add(end, self._stands, SETTLED_S + 1.0 / turned.hz)

    def _add(self, command: dict[str, object], is_there: Callable[[], bool], seconds: float) -> None:
        # the keeper refuses a command that was decided on before a stop and comes after it
        self._steps.append(_Step(command | {"stops": self._seen_stops}, is_there, seconds))

    def _send_first(self, now_ns: int) -> None:
        step = self._steps[0]
        # what was read before the command says nothing of what comes of it
        self._recent.clear()
        self._sent_ns = now_ns
        self._until_ns = now_ns + round((step.seconds + _SETTLE_PATIENCE_S * self._slack) * 1e9)
        self._kept.send(**step.command)

    def has_arrived(self, now_ns: int) -> bool:
        """Whether the segment that it was sent to begins now; once."""
        self._heed()
        is_there = bool(self._steps) and self._steps[0].is_there()
        self._heed()  # it may have been told to stop meanwhile
        if not is_there or not self._steps:
            return False
        self._steps.popleft()
        if self._steps:
            self._send_first(now_ns)
        return not self._steps

    def left_s(self, now_ns: int) -> float | None:
        """Nothing is known of when it will be there."""
        return None

    def leave(self) -> None:
        """Stop: rate zero, then mode off; safe from any thread and signal."""
        self._stops = stops = next(self._counter)
        if self._kept.enabled and not self._kept.has_ended:
            self._kept.send(do="stop", stops=stops)

    def close(self) -> None:
        """Stop, and give up the link."""
        self._kept.close()

    # -- what it measures ---------------------------------------------------------------------------------------------

    def take(self, now_ns: int) -> list[TableState]:
        """What the controller said since the last time."""
        self._heed()
        kept, found = self._kept, list[TableState]()
        while kept.states:
            found.append(kept.states.popleft())
        self._recent += found
        while self._recent and self._recent[0].stamp_ns < self._recent[-1].stamp_ns - self._keep_s * 1e9:
            self._recent.popleft()
        if self._steps and self._until_ns is not None and now_ns > self._until_ns:
            self.leave()
            self.tell("the table does not come to rest where it was sent: stopped, rate zero and mode off")
        return found

    def news(self) -> list[tuple[str, bool]]:
        """What is to be told, and whether it is a warning; after one the table stands, or does nothing new."""
        found = list[tuple[str, bool]]()
        while self._kept.news:
            found.append(self._kept.news.popleft())
        self.why_failed = next((text for text, is_warning in reversed(found) if is_warning), self.why_failed)
        return found

    def _passed_s(self, since_ns: int) -> float:
        return (self._recent[-1].stamp_ns - since_ns) / 1e9 if self._recent else 0.0

    def _last(self, seconds: float) -> list[TableState]:
        """Readings of the last seconds; none if they do not go back so far."""
        if not self._recent or self._passed_s(self._recent[0].stamp_ns) < seconds:
            return []
        since_ns = self._recent[-1].stamp_ns - seconds * 1e9
        return [state for state in self._recent if state.stamp_ns >= since_ns]

    def _stands(self) -> bool:
        """Whether rates are zero but for their noise; of an axis that swings their mean is, and its angles are not."""
        states = self._last(SETTLED_S / 2.0)
        angles = zip(*(s.angles_deg for s in states), strict=True)
        slow = all(abs(_mean([s.rates_dps[k] for s in states])) < RESTS_DPS for k in range(3)) if states else False
        return slow and all(max(each) - min(each) < SETTLED_DEG for each in angles)

    def _settled(self, targets: Sequence[float]) -> bool:
        states = self._last(SETTLED_S)
        axes = [k for k, axis in enumerate(AXES) if axis in self._kept.axes]
        near = all(abs(self._off(k, s.angles_deg[k], targets[k])) < SETTLED_DEG for s in states for k in axes)
        return bool(states) and near and self._stands()

    def _off(self, k: int, angle: float, target: float) -> float:
        """Return how far an axis is from a target; whole turns count only where it has stops."""
        limits = self._kept.limits.get(AXES[k])
        off = angle - target
        return off if limits is not None and limits.has_stops else math.remainder(off, 360.0)

    def _turns_at(self, axis: str, dps: float) -> bool:
        states, k = self._last(_RATE_S), AXES.index(axis)
        off = abs(_mean([s.rates_dps[k] for s in states]) - dps) if states else math.inf
        return off < max(_RATE_DPS, _RATE_SHARE * abs(dps))

    def _swings(self, axis: str, amplitude: float, period_s: float) -> bool:
        angles = [s.angles_deg[AXES.index(axis)] for s in self._last(period_s)]
        share = (max(angles) - min(angles)) / (2.0 * amplitude) if angles else 0.0
        return share > _SWINGS or (share > 0.5 and self._passed_s(self._sent_ns) > _PERIODS * period_s)

    @property
    def moves(self) -> bool:
        """Whether it moves under command, or is about to."""
        newest = self._kept.newest
        turns = newest is not None and newest.mode != "off" and max(map(abs, newest.rates_dps)) > _MOVING
        waits = self._stops == self._seen_stops and bool(self._steps or self._turned)
        return self._kept.enabled and not self._kept.has_ended and (turns or waits)

    def snapshot(self, *, investigates: bool) -> ControllerSnapshot:
        """Return the part of a snapshot that is about the table."""
        kept, newest = self._kept, self._kept.newest
        return {
            "url": kept.url,
            "identity": kept.identity,
            "axes": list(kept.axes),
            "angles_deg": None if newest is None else list(newest.angles_deg),
            "rates_dps": None if newest is None else list(newest.rates_dps),
            "mode": "off" if newest is None else newest.mode,
            "fault": "" if newest is None else newest.fault,
            "age_s": None if newest is None else (time.monotonic_ns() - newest.stamp_ns) / 1e9,
            "moves": self.moves,
            "error": kept.error,
            "investigates": investigates,
        }


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
