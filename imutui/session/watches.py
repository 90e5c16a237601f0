"""Watches: consumers of the stream that report on unit, line, clock and gravity, and one that keeps the reports."""

import math
import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from filters.imu import AxisMap, format_mount, parse_mount
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from filters.motion.segments import Dwell
from imutui.command_line import command
from imutui.instrument.clock import Gap
from imutui.instrument.driver import Driver
from imutui.logbook import line_advice
from imutui.logbook.line_advice import HELD_UP_S, LossAdvice
from imutui.logbook.log_time import Timebase
from imutui.logbook.polled_rate import PolledRate
from imutui.logbook.session_info import SessionInfo
from imutui.origin_gate import url
from imutui.session import lifecycle, reconnection
from imutui.session.lifecycle import EndFinding
from imutui.session.plan import Plan
from imutui.session.reconnection import LineLost, LineReturned, StillAway
from imutui.session.snapshot import EventLine, MarkLine, ReconnectingSnapshot, not_said
from imutui.session.stream import INFORMATION, WARNING, Began, Block, Broke, Event, Said, Second, Why

_MOST_TOLD = 20
_NICENESS, _END_S = 5, 3.0  # of a process that serves: the acquisition comes first
_STEP_NS = 100_000_000
# cos 37 degrees: a unit that is further off does not lie along that axis
_ALONG = 0.8
_TURNED_OVER = np.diag([1.0, -1.0, -1.0])

_EVENTS, _MARKS = 20, 50


def _said(text: str, level: int = WARNING) -> Said:
    return Said("acquisition", text, level)


class FoxgloveFollower:
    """The process `imutui foxglove`, which reads the logs of an acquisition as they grow and serves them.

    The acquisition starts it, reports its end and hands nothing to it: a crash of it costs viewers their stream only.
    """

    def __init__(self, plan: Plan) -> None:
        line = ("foxglove", "--name", plan.name, "--host", plan.foxglove_host, "--port", str(plan.foxglove_port))
        at = url(plan.foxglove_host, plan.foxglove_port)
        self._again = command(*line)
        self._unsaid = [_said(f"what is recorded is served to Foxglove at {at}", INFORMATION)]
        self._ended = False
        # stderr is the acquisition's own: its messages go into that log
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "imutui", *line], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        )
        os.setpriority(os.PRIO_PROCESS, self._process.pid, _NICENESS)

    def take(self, event: Event, /) -> Iterable[Said]:
        """Say where it serves, once packets come, and that it has ended by itself, each once."""
        if not isinstance(event, Second) or event.pauses:
            return []
        said, self._unsaid = self._unsaid, []
        if not self._ended and self._process.poll() is not None:
            self._ended = True
            said.append(_said(f"Foxglove is served no more, the recording goes on; `{self._again}` serves again"))
        return said

    def close(self) -> None:
        """Have it serve the rest of the last file, and end."""
        self._process.terminate()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class StatusWords:
    """Status words of the unit's packets: each is said once, and none is a reason to drop readings."""

    def __init__(self, instrument: type[Driver]) -> None:
        self._instrument = instrument
        self._newest = 0
        self._new = list[int]()
        self._seen = {0}

    def take(self, event: Event, /) -> Iterable[Said]:
        """Take the words of packets; say, each second, which came for the first time."""
        if isinstance(event, Block):
            words = event.rows["status"].tolist()
            for word in dict.fromkeys(words):
                if word not in self._seen and len(self._seen) <= _MOST_TOLD:
                    self._seen.add(word)
                    self._new.append(word)
            self._newest = words[-1]
        elif isinstance(event, Second):
            new, self._new = self._new, []
            for word in new:
                said = self._instrument.status_in_words(word)
                yield _said(f"the unit's status word (BIT) is {said}; readings count whatever it says")

    @property
    def newest(self) -> str:
        """The newest packet's word and what it means; "" if no bit is set, or packets have none."""
        return self._instrument.status_in_words(self._newest) if self._newest else ""


class ClockStepMonitor:
    """Notices when the system's clock is set; `timebase` keeps to the clock as it was at the start."""

    def __init__(self, timebase: Timebase) -> None:
        self._timebase = timebase
        self._known_ns = 0
        self._why_moved = timebase.why_moved()

    def take(self, event: Event, /) -> Iterable[Said]:
        """Say once that the clock is wrong, and each second by how much it was set, from 0.1 s on."""
        if not isinstance(event, Second):
            return
        if self._why_moved and not event.pauses:  # not before the first packet: there is no file yet
            yield _said(self._why_moved)
            self._why_moved = ""
        step = self._timebase.step_ns() - self._known_ns
        if abs(step) > _STEP_NS:
            self._known_ns += step
            yield _said(f"the system clock stepped by {step / 1e9:+.3f} s; stamps are not affected")


class GravityCheck:
    """Looks once, after the first second, whether gravity reads where it should on a table that begins level.

    It judges only an instrument that can turn its own axes: of others the filter's alarms say enough.
    """

    def __init__(self, instrument: type[Driver]) -> None:
        self._is_due = instrument.turns_axes

    def take(self, event: Event, /) -> Iterable[Said]:
        """Say what is unexpected of the first readings."""
        if not isinstance(event, Second) or not self._is_due or event.accels_g is None:
            return
        info = event.info
        if _begins_level(info.reference, event.motion):
            self._is_due = False
            said = unexpected_gravity(event.accels_g, info.axes(), info.own_mount)
            if said is not None:
                yield _said(said)


def _begins_level(reference: str, motion: Profile | Trajectory | None) -> bool:
    if not isinstance(motion, Profile):
        return reference == "level"
    first = motion.segments[0]
    # joined by marks it begins when the operator says so
    return motion.align == "none" and isinstance(first, Dwell) and first.angles[:2] == (0.0, 0.0)


def unexpected_gravity(accels_g: npt.NDArray[np.float64], axes: AxisMap, own_mount: str = "") -> str | None:
    """Return what to say of a unit that should lie level and reads as if it did not; None if it reads as it should.

    A unit on its side, which its own configuration does not explain, may be tilted on purpose: None.
    `accels_g` is what the accelerometers read at rest, instrument axes and sign, shape (3,); `axes` leads to body axes,
    of which Z points down, as the operator states the mounting; `own_mount` has the axes of the unit's case in those of
    its packets, as its own configuration has them, "" if unknown.
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

    def __init__(self, plan: Plan, info: SessionInfo, timebase: Timebase, stream_hz: float) -> None:
        self._plan, self._info = plan, info
        self._timebase = timebase
        polled_hz = info.rate_hz if info.sampling == "polled" else None
        self._rate_hz = polled_hz or stream_hz  # packets that would have come while the unit was away
        self._silence_s = max(_SILENCE_S, _SILENT_PERIODS / polled_hz if polled_hz else 0.0)
        self._ask_again_s = reconnection.ask_again_after_s(polled_hz)
        self._is_silent = False
        self._polled_rate = PolledRate(info.rate_hz)  # of requests, answered or not, and of pauses between them
        self._rate_said = False
        self.loss_advice = LossAdvice(info.port, info.firmware)
        self._last_stamp_ns: int | None = None  # of the newest packet, monotonic
        self._away_since_ns: int | None = None  # when the last packet was read; None while the unit is there
        self._waits_for = ""
        self._refused: set[str] = set()
        self._found = ""

    def take(self, event: Event, /) -> Iterable[Said]:
        """Take an event of the stream; says when the unit goes, comes back, falls silent or loses packets."""
        match event:
            case Block():
                yield from self._packets(event)
            case Broke(Why.UNANSWERED):
                self._polled_rate.unanswered()
            case Broke():
                self._polled_rate.interrupt()
            case Began(recording=True):  # the rate of polling is judged anew
                self._polled_rate, self._rate_said = PolledRate(self._info.rate_hz), False
            case LineLost():
                if self._away_since_ns is None:
                    self._away_since_ns = event.since_ns
                    self._refused.clear()
                self._waits_for = "the same unit to come back"
                yield _said(f"{event.message} The acquisition goes on and waits for the same unit.")
            case StillAway():
                self._waits_for = event.waits_for
                if event.refused and event.waits_for not in self._refused:
                    self._refused.add(event.waits_for)
                    yield _said(f"refused: {event.waits_for}")
            case LineReturned():  # its first packet follows, with which more can be said
                self._away_since_ns, self._found = self._last_stamp_ns, event.found
                self._polled_rate.interrupt()
            case Second():
                yield from self._news(event)

    # -- packets, and a unit that comes back --------------------------------------------------------------------------

    def _packets(self, block: Block) -> Iterator[Said]:
        rows, gap = block.rows, block.gap
        for requested_ns in filter(None, rows["requested_ns"].tolist()):
            self._polled_rate.answered(requested_ns)
        lost = 0 if gap is None else gap.lost_min
        for read_ns, late_ns in zip(
            rows["host_ns"].tolist(), (rows["host_ns"] - rows["stamp_ns"]).tolist(), strict=True
        ):
            if lost or late_ns > HELD_UP_S * 1e9:
                self.loss_advice.packet(lost, read_ns / 1e9, late_ns / 1e9)
            lost = 0
        if self._last_stamp_ns is None:
            yield from self._connected()
        self._last_stamp_ns = int(rows["stamp_ns"][-1])
        said = self._back(block) or (gap_text(gap, int(rows["uncertainty_ns"][0])) if gap is not None else "")
        if said:
            yield Said("gap", said, WARNING)

    def _connected(self) -> Iterator[Said]:
        plan, info = self._plan, self._info
        yield _said(f"connected to {info.port}, first packet", INFORMATION)
        unsaid = not_said(info.serial_number, info.firmware)
        if unsaid is not None:
            yield _said(unsaid)
        if plan.baud not in (None, info.baud):
            yield _said(
                f"the unit keeps its own speed, {info.baud} baud: {plan.baud} baud is only where it was looked for"
            )
        if plan.ends_unwatched_s is not None:
            yield _said(f"a virtual unit: all ends {plan.ends_unwatched_s:g} s after the last viewer", INFORMATION)

    @property
    def is_away(self) -> bool:
        """Whether the unit is waited for."""
        return self._away_since_ns is not None

    def _back(self, block: Block) -> str:
        """Return what to say of the first packet after the unit was away; "" of any other."""
        if not self._found or self._away_since_ns is None:
            return ""
        before_ns, found = self._away_since_ns, self._found
        self._away_since_ns, self._found = None, ""
        stamp_ns, uncertainty_ns = (int(block.rows[name][0]) for name in ("stamp_ns", "uncertainty_ns"))
        seconds = (stamp_ns - before_ns) / 1e9
        gap = block.gap or Gap(seconds, 0, math.floor(seconds * self._rate_hz * _FASTEST))
        between = f"{self._utc(before_ns)} to {self._utc(stamp_ns)} UTC"
        return f"{gap_text(gap, uncertainty_ns)}, {between}; the unit is back: {found}"

    def snapshot(self, now_ns: int) -> ReconnectingSnapshot | None:
        """Return what is waited for, for viewers; None while the unit is there."""
        if self._away_since_ns is None:
            return None
        return {"seconds": (now_ns - self._away_since_ns) / 1e9, "waits_for": self._waits_for}

    # -- silence ------------------------------------------------------------------------------------------------------

    def is_to_be_asked(self, second: Second) -> bool:
        """Return whether the unit has been silent for so long that it has to be asked who it is."""
        return second.silent_s > self._ask_again_s and not second.pauses and not self.is_away

    def _news(self, second: Second) -> Iterator[Said]:
        """Say that the unit fell silent or speaks again, and, once, that it is polled more slowly than asked."""
        silent = self.falls_silent(second)
        if not self.is_away and silent != self._is_silent:
            self._is_silent = silent
            if silent:
                yield _said(f"no packets for {second.silent_s:.1f} s: {self._advice()}")
            else:
                yield _said("packets again", INFORMATION)
        slow = self._polled_rate.finding()
        if slow is not None and not self._rate_said:
            self._rate_said = True
            yield _said(slow)

    def at_the_end(self, now_ns: int, asked: Second | None) -> Iterator[tuple[EndFinding, bool]]:
        """Yield what must be said when the acquisition ends, and whether that has been said before.

        `asked` is as it was when the end was asked for; None if that is not to be judged.
        """
        slow = self._polled_rate.finding()
        if slow is not None:
            yield {"exit_code": lifecycle.FINDINGS, "text": slow}, self._rate_said
        if self._away_since_ns is not None:
            last, away_s = self._utc(self._away_since_ns), (now_ns - self._away_since_ns) / 1e9
            text = (
                f"the unit was gone at the end: its last packet came at {last} UTC, {away_s:.0f} s before; waited for"
                f" {self._waits_for}. What came is recorded and the file is finished."
            )
        elif asked is not None and self.falls_silent(asked):
            text = (
                f"the unit was silent at the end: its last packet came {asked.silent_s:.1f} s before. What came is"
                f" recorded and the file is finished. Before the next one: {self._advice()}"
            )
        else:
            return
        yield {"exit_code": lifecycle.INSTRUMENT, "text": text}, False

    def falls_silent(self, second: Second) -> bool:
        """Return whether the unit sends nothing though it should."""
        return second.silent_s > self._silence_s and not second.pauses

    def _advice(self) -> str:
        return line_advice.of_silence(self._info.port, self._info.firmware)

    def _utc(self, monotonic_ns: int) -> str:
        utc_ns = self._timebase.utc_ns(monotonic_ns)
        return f"{time.strftime('%H:%M:%S', time.gmtime(utc_ns // 1_000_000_000))}.{utc_ns // 1_000_000 % 1000:03d}"


def gap_text(gap: Gap, uncertainty_ns: int) -> str:
    """Return words for a gap, with its bounds for programs; `uncertainty_ns` is of the stamp behind it."""
    if gap.lost_min == gap.lost_max:
        what = f"{gap.lost_max} packet{'' if gap.lost_max == 1 else 's'} lost in {gap.seconds:.4f} s"
    else:
        what = f"no packets for {gap.seconds:.4f} s; between {gap.lost_min} and {gap.lost_max} were lost"
    bounds = f"lost_min={gap.lost_min} lost_max={gap.lost_max} uncertainty_ms={uncertainty_ns / 1e6:.3f}"
    return f"{what} ({bounds})"


class EventLog:
    """Keeps the last 20 events and the last 50 marks for viewers; the file has all of them."""

    def __init__(self, timebase: Timebase) -> None:
        self._timebase = timebase
        self._events: deque[EventLine] = deque(maxlen=_EVENTS)
        # a mark's time is None if it belongs to an earlier run of samples than the present one
        self._marks: deque[tuple[int | None, str, str]] = deque(maxlen=_MARKS)

    def take(self, event: Event, /) -> Iterable[Said]:
        """Take an event of the stream."""
        match event:
            case Said(name, text):
                utc = time.strftime("%H:%M:%S", time.gmtime(self._timebase.utc_ns(event.at_ns) / 1e9))
                self._events.append({"utc": utc, "name": name, "text": text})
                if name in ("mark", "remark"):
                    self._marks.append((event.at_ns, utc, text))
            case Began():
                kept = () if event.recording else [(None, utc, text) for _, utc, text in self._marks]
                self._marks = deque(kept, _MARKS)
        return ()

    def events(self) -> list[EventLine]:
        """Return events for viewers, oldest first."""
        return list(self._events)

    def marks(self, started_ns: int | None) -> list[MarkLine]:
        """Return marks for viewers, oldest first, with times since `started_ns`, when the present run began."""
        return [{"t": _seconds(at_ns, started_ns), "utc": utc, "text": text} for at_ns, utc, text in self._marks]


def _seconds(at_ns: int | None, started_ns: int | None) -> float | None:
    return None if at_ns is None or started_ns is None else max(0.0, (at_ns - started_ns) / 1e9)
