"""What is looked at once a second: each watch has a method `news`, and `acquisition` has the list of them.

A watch takes packets, or judges an end, by methods of its own; the one of the line, which may be away, silent or slower
than asked, has the most to say.
"""

import math
import os
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from filters.imu import AxisMap, format_mount, parse_mount
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from filters.motion.segments import Dwell
from imutui.command_line import command
from imutui.instrument.clock import Gap, Stamp
from imutui.instrument.counts import DataPacket
from imutui.instrument.driver import Driver
from imutui.logbook import line_advice
from imutui.logbook.polled_rate import PolledRate
from imutui.logbook.session_info import SessionInfo
from imutui.origin_gate import url
from imutui.session import lifecycle, reconnection
from imutui.session.event_log import INFORMATION, WARNING
from imutui.session.plan import Plan
from imutui.session.reconnection import LineLost, LineReturned, StillAway
from imutui.session.requests import EndFinding
from imutui.session.snapshot import ReconnectingSnapshot
from imutui.session.timebase import Timebase

_MOST_TOLD = 20
_NICENESS, _END_S = 5, 3.0  # of a process that serves: the acquisition comes first
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


class FoxgloveFollower:
    """The process `imutui foxglove`, which reads the logs of an acquisition as they grow and serves them.

    The acquisition starts it, reports its end and hands nothing to it: a crash of it, or of the library in it, costs
    viewers their stream and nothing else.
    """

    def __init__(self, plan: Plan) -> None:
        line = ("foxglove", "--name", plan.name, "--host", plan.foxglove_host, "--port", str(plan.foxglove_port))
        at = url(plan.foxglove_host, plan.foxglove_port)
        self._again = command(*line)
        self._unsaid = [(f"what is recorded is served to Foxglove at {at}", INFORMATION)]
        self._ended = False
        # stderr is the acquisition's own: its messages go into that log
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "imutui", *line], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        )
        os.setpriority(os.PRIO_PROCESS, self._process.pid, _NICENESS)

    def news(self, moment: Moment, /) -> News:
        """Where it serves, once packets come, and that it has ended by itself, each once."""
        if moment.expected:
            return []
        said, self._unsaid = self._unsaid, []
        if not self._ended and self._process.poll() is not None:
            self._ended = True
            said.append((f"Foxglove is served no more, the recording goes on; `{self._again}` serves again", WARNING))
        return said

    def close(self) -> None:
        """Have it serve what the last file holds, and end."""
        self._process.terminate()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class StatusWords:
    """What a unit's packets say of the unit itself: told, and never a reason to drop readings."""

    def __init__(self, instrument: type[Driver]) -> None:
        self._instrument = instrument
        self._newest = 0
        self._new = list[int]()
        self._seen = {0}

    def take(self, packets: Iterable[DataPacket]) -> None:
        """Take packets."""
        for packet in packets:
            if packet.details is None:
                return
            if packet.details.status == self._newest:
                continue
            self._newest = packet.details.status
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
        self._why_moved = timebase.why_moved()

    def news(self, moment: Moment, /) -> News:
        """Yield once that the clock is wrong, and by how much it was set since the last look, from 0.1 s on."""
        if self._why_moved and not moment.expected:  # not before the first packet: there is no file yet
            yield self._why_moved, WARNING
            self._why_moved = ""
        step = self._timebase.step_ns() - self._known_ns
        if abs(step) > _STEP_NS:
            self._known_ns += step
            yield f"the system clock stepped by {step / 1e9:+.3f} s; stamps are not affected", WARNING


class GravityCheck:
    """Looks once, after the first second, whether gravity reads where it should on a table that begins level.

    Only of an instrument that turns its own axes something is said: of others the filter's alarms say enough.
    """

    def __init__(self, instrument: type[Driver]) -> None:
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


# the unit's own rate is known to less than a percent
_FASTEST = 1.01
# no pause between two packets: so long at least, and so many periods of polling
_SILENCE_S = 1.0
_SILENT_PERIODS = 3.0


class LineWatch:
    """Follows one acquisition's line; `stream_hz` packets a second at most come of a unit that streams."""

    def __init__(self, info: SessionInfo, timebase: Timebase, stream_hz: float) -> None:
        self._info = info
        self._timebase = timebase
        polled_hz = info.rate_hz if info.sampling == "polled" else None
        self._rate_hz = polled_hz or stream_hz  # packets that would have come while the unit was away
        self._silence_s = max(_SILENCE_S, _SILENT_PERIODS / polled_hz if polled_hz else 0.0)
        self._ask_again_s = reconnection.ask_again_after_s(polled_hz)
        self._is_silent = False
        self.polled_rate = PolledRate(info.rate_hz)  # of requests, answered or not, and of pauses between them
        self._rate_said = False
        self._away_since_ns: int | None = None  # when the last packet was read; None while the unit is there
        self._waits_for = ""
        self._refused: set[str] = set()
        self._found = ""

    def begin_recording(self) -> None:
        """Judge the rate of polling anew."""
        self.polled_rate, self._rate_said = PolledRate(self._info.rate_hz), False

    # -- the unit goes, and comes back ----------------------------------------------------------------------------

    @property
    def is_away(self) -> bool:
        """Whether the unit is waited for."""
        return self._away_since_ns is not None

    def lost(self, event: LineLost) -> str:
        """The line is lost; returns what to say."""
        if self._away_since_ns is None:
            self._away_since_ns = event.since_ns
            self._refused.clear()
        self._waits_for = "the same unit to come back"
        return f"{event.message} The acquisition goes on and waits for the same unit."

    def still_away(self, event: StillAway) -> str | None:
        """Something else is waited for; returns what to say, once of each unit that is refused."""
        self._waits_for = event.waits_for
        if not event.refused or event.waits_for in self._refused:
            return None
        self._refused.add(event.waits_for)
        return f"refused: {event.waits_for}"

    def returned(self, event: LineReturned, before_ns: int) -> None:
        """The unit is back; its first packet is awaited to say more. `before_ns` is the last stamp before."""
        self._away_since_ns = before_ns
        self._found = event.found
        self.polled_rate.interrupt()

    def back(self, stamp: Stamp) -> str | None:
        """A packet has come; returns what to say if it is the first one after the unit was away."""
        if not self._found or self._away_since_ns is None:
            return None
        before_ns, found = self._away_since_ns, self._found
        self._away_since_ns, self._found = None, ""
        if stamp.gap is None:
            seconds = (stamp.monotonic_ns - before_ns) / 1e9
            stamp = replace(stamp, gap=Gap(seconds, 0, math.floor(seconds * self._rate_hz * _FASTEST)))
        between = f"{self._utc(before_ns)} to {self._utc(stamp.monotonic_ns)} UTC"
        return f"{gap_text(stamp)}, {between}; the unit is back: {found}"

    def snapshot(self, now_ns: int) -> ReconnectingSnapshot | None:
        """What is waited for, for viewers; None while the unit is there."""
        if self._away_since_ns is None:
            return None
        return {"seconds": (now_ns - self._away_since_ns) / 1e9, "waits_for": self._waits_for}

    # -- what is said of it ---------------------------------------------------------------------------------------

    def is_to_be_asked(self, moment: Moment) -> bool:
        """Whether the unit has been silent for so long that it has to be asked who it is."""
        return moment.silent_s > self._ask_again_s and not moment.expected and not self.is_away

    def news(self, moment: Moment, /) -> News:
        """That the unit fell silent or speaks again, and, once, that it is polled more slowly than asked."""
        silent = self.falls_silent(moment)
        if not self.is_away and silent != self._is_silent:
            self._is_silent = silent
            if silent:
                yield f"no packets for {moment.silent_s:.1f} s: {self._advice()}", WARNING
            else:
                yield "packets again", INFORMATION
        slow = self.polled_rate.finding()
        if slow is not None and not self._rate_said:
            self._rate_said = True
            yield slow, WARNING

    def at_the_end(self, now_ns: int, moment: Moment | None) -> Iterator[tuple[EndFinding, bool]]:
        """What must be said when the acquisition ends, and whether that has been said before.

        `moment` is as it was when the end was asked for; None if that is not to be judged.
        """
        slow = self.polled_rate.finding()
        if slow is not None:
            yield {"exit_code": lifecycle.FINDINGS, "text": slow}, self._rate_said
        if self._away_since_ns is not None:
            last, away_s = self._utc(self._away_since_ns), (now_ns - self._away_since_ns) / 1e9
            text = (
                f"the unit was gone at the end: its last packet came at {last} UTC, {away_s:.0f} s before; waited for"
                f" {self._waits_for}. What came is recorded and the file is finished."
            )
        elif moment is not None and self.falls_silent(moment):
            text = (
                f"the unit was silent at the end: its last packet came {moment.silent_s:.1f} s before. What came is"
                f" recorded and the file is finished. Before the next one: {self._advice()}"
            )
        else:
            return
        yield {"exit_code": lifecycle.INSTRUMENT, "text": text}, False

    def falls_silent(self, moment: Moment) -> bool:
        """Whether the unit sends nothing though it should."""
        return moment.silent_s > self._silence_s and not moment.expected

    def _advice(self) -> str:
        return line_advice.of_silence(self._info.port, self._info.firmware)

    def _utc(self, monotonic_ns: int) -> str:
        utc_ns = self._timebase.utc_ns(monotonic_ns)
        return f"{time.strftime('%H:%M:%S', time.gmtime(utc_ns // 1_000_000_000))}.{utc_ns // 1_000_000 % 1000:03d}"


def gap_text(stamp: Stamp) -> str:
    """Words for the gap before a stamp's packet, with its bounds for programs; "" if there is none."""
    gap = stamp.gap
    if gap is None:
        return ""
    if gap.lost_min == gap.lost_max:
        what = f"{gap.lost_max} packet{'' if gap.lost_max == 1 else 's'} lost in {gap.seconds:.4f} s"
    else:
        what = f"no packets for {gap.seconds:.4f} s; between {gap.lost_min} and {gap.lost_max} were lost"
    bounds = f"lost_min={gap.lost_min} lost_max={gap.lost_max} uncertainty_ms={stamp.uncertainty_ns / 1e6:.3f}"
    return f"{what} ({bounds})"
