"""What is looked at once a second: each watch has a method `news`, and `acquisition` has the list of them.

A watch takes packets, or judges an end, by methods of its own; `line_watch` is the one with the most to say.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from filters.imu import AxisMap, format_mount, parse_mount
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from filters.motion.segments import Dwell
from imutui.instrument.counts import DataPacket
from imutui.instrument.instrument import Instrument
from imutui.logbook.session_info import SessionInfo
from imutui.session.event_log import WARNING
from imutui.session.timebase import Timebase, utc_minus_monotonic_ns

_MOST_TOLD = 20
_STEP_NS = 100_000_000
# cos 37 degrees: whoever is further off does not lie along that axis at all
_ALONG = 0.8
_TURNED_OVER = np.diag([1.0, -1.0, -1.0])

News: TypeAlias = Iterable[tuple[str, int]]  # sentences with the levels of their events


@dataclass(frozen=True, slots=True)
class Moment:
    """What there is to look at."""

    silent_s: float  # since the last packet
    expected: bool  # whether no packet is expected now
    accels_g: npt.NDArray[np.float64] | None  # what the accelerometers read, instrument axes; None before they did
    # info, motion: as they are in force
    info: SessionInfo
    motion: Profile | Trajectory | None


class StatusWords:
    """What a unit's packets say of the unit itself: told, and never a reason to drop readings."""

    def __init__(self, instrument: Instrument) -> None:
        self._instrument = instrument
        self._newest = 0
        self._new = list[int]()
        self._seen = {0}

    def take(self, packet: DataPacket) -> None:
        """Take a packet."""
        details = packet.details
        if details is None or details.status == self._newest:
            return
        self._newest = details.status
        if self._newest not in self._seen and len(self._seen) <= _MOST_TOLD:
            self._seen.add(self._newest)
            self._new.append(self._newest)

    @property
    def newest(self) -> str:
        """The newest packet's word and what it means; "" if no bit is set, or packets have none."""
        return self._instrument.status_in_words(self._newest) if self._newest else ""

    def news(self, _: Moment, /) -> News:
        """Words that came for the first time, each once."""
        new, self._new = self._new, []
        for word in new:
            said = self._instrument.status_in_words(word)
            yield f"the unit's status word (BIT) is {said}; readings count whatever it says", WARNING


class ClockStepMonitor:
    """Notices when the system's clock is set; `timebase` keeps to the clock as it was at the start."""

    def __init__(self, timebase: Timebase) -> None:
        self._timebase = timebase
        self._known_ns = 0

    def news(self, _: Moment, /) -> News:
        """By how much the clock was set since the last look; nothing of less than 0.1 s."""
        step = utc_minus_monotonic_ns() - self._timebase.utc_minus_monotonic_ns - self._known_ns
        if abs(step) > _STEP_NS:
            self._known_ns += step
            yield f"the system clock stepped by {step / 1e9:+.3f} s; stamps are not affected", WARNING


class GravityCheck:
    """Looks once, after the first second, whether gravity reads where it should on a table that begins level.

    Only of an instrument that turns its own axes something is said: of others the filter's alarms say enough.
    """

    def __init__(self, instrument: Instrument) -> None:
        self._to_be_looked_at = instrument.turns_axes

    def news(self, moment: Moment, /) -> News:
        """What is unexpected of the first readings."""
        info = moment.info
        if moment.accels_g is None or not self._to_be_looked_at or not _begins_level(info.reference, moment.motion):
            return
        self._to_be_looked_at = False
        said = unexpected_gravity(moment.accels_g, info.axes(), info.own_mount)
        if said is not None:
            yield said, WARNING


def _begins_level(reference: str, motion: Profile | Trajectory | None) -> bool:
    if not isinstance(motion, Profile):
        return reference == "level"
    first = motion.segments[0]
    # joined by marks it begins when the operator says so
    return motion.align == "none" and isinstance(first, Dwell) and first.angles[:2] == (0.0, 0.0)


def unexpected_gravity(accels_g: npt.NDArray[np.float64], axes: AxisMap, own_mount: str = "") -> str | None:
    """What to say of a unit that should lie level and reads as if it did not; None of one that reads as it should.

    Of one that lies on a side, and whose own configuration does not explain it, nothing is said: it may be a tilt that
    is meant. `accels_g` is what the accelerometers read at rest, instrument axes and sign, shape (3,); `axes` leads to
    body axes, of which Z points down, as the operator says that the unit is mounted; `own_mount` has the axes of its
    case in those of its packets, as its own configuration has them, "" if it does not say.
    """
    z = float(axes.accel_to_body(accels_g)[2])
    if z < -_ALONG:
        return None
    reads = f"level, the body's Z should read -1 g of specific force, and it reads {z:+.2f} g"
    as_configured = _turned_by_itself(accels_g, axes, own_mount)
    if z < _ALONG:
        if as_configured is None:
            return None
        return (
            f"{reads}: the unit's own configuration turns its axes so that they read like this when it is level. Name"
            f" how they lie: --mount {as_configured}"
        )
    turned_over = format_mount(_TURNED_OVER @ axes.mount)
    if as_configured is not None and as_configured != turned_over:
        return (
            f"{reads}: the unit lies upside down (--mount {turned_over}), or its own configuration turns its axes"
            f" (--mount {as_configured}). Turn it, or name which of them it is"
        )
    known = own_mount and as_configured is None
    why = "its own configuration does not explain it" if known else "or its own configuration turns its axes"
    return f"{reads}: the unit lies upside down, {why}. Turn it, or name how it lies: --mount {turned_over}"


def _turned_by_itself(accels_g: npt.NDArray[np.float64], axes: AxisMap, own_mount: str) -> str | None:
    """Mounting with what the unit's own configuration turns, if the unit reads level with it."""
    if not own_mount:
        return None
    with_its_own = replace(axes, mount=axes.mount @ parse_mount(own_mount))
    return format_mount(with_its_own.mount) if with_its_own.accel_to_body(accels_g)[2] < -_ALONG else None
