"""A table never leaves its limits: random limits, commands and profiles on the virtual table, in simulated time."""

import math
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from filters.channels import DPS
from filters.errors import InputError
from filters.motion.profile import Profile
from filters.motion.segments import Dwell, Rate, Segment, Sine
from filters.simulation import TableModel, TurnTable
from imutui.session import commanded_table
from imutui.session.commanded_table import CommandedTable
from imutui.table import acutrol, keeper
from imutui.table.acutrol import Acutrol
from imutui.table.acutrol_virtual import VirtualAcutrol
from imutui.table.keeper import Keeper
from imutui.table.links import TableError, TableLinkError
from imutui.table.messages import Command, Report
from imutui.table.motion import Motion, Move, Swing, TableState, Turn, parse_limits

NOISE_DEG = 0.05  # of an encoder, its offset included


class Clock:
    """Time that goes on where something waits; stands in for module `time`."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def monotonic_ns(self) -> int:
        return round(self.now * 1e9)

    def sleep(self, seconds: float) -> None:
        self.now += seconds


class Wire:
    """A link to a virtual controller in this process; `latency_s` is from a question to its answer."""

    name, prefix, acknowledges, pause_s, quiet_s = "virtual", 0, True, 0.0, 0.001

    def __init__(self, controller: VirtualAcutrol, clock: Clock, latency_s: float) -> None:
        self.controller, self._clock, self._latency_s = controller, clock, latency_s
        self._answers: deque[tuple[float, bytes]] = deque()
        self.is_silent, self.is_closed = False, False
        self.sent: list[str] = []

    def send(self, data: bytes) -> None:
        if self.is_closed:
            raise TableLinkError("the link is closed.")
        self.sent.append(data.decode().strip())
        arrives = self._clock.now + self._latency_s / 2.0
        said = self.controller.carry_out(self.sent[-1], max(arrives, self.controller.table.now))
        if not self.is_silent:
            answer = ";".join(text for _, text in said).encode() + b"\n"
            self._answers.append((arrives + self._latency_s / 2.0, answer))

    def receive(self, patience_s: float) -> bytes:
        until = self._clock.now + patience_s
        if self._answers and self._answers[0][0] <= until:
            self._clock.now, answer = max(self._answers[0][0], self._clock.now), self._answers.popleft()[1]
            return answer
        self._clock.now = until
        return b""

    def close(self) -> None:
        self.is_closed = True


class NoLines:
    """An owner that is there and writes nothing."""

    stop_waits, signal = False, ""

    def look(self, wait_s: float) -> None:
        pass


@dataclass
class Kept:
    """A keeper in this process, in place of `KeptTable`; watches the true angle of an axis."""

    keeper: Keeper
    wire: Wire
    clock: Clock
    told: list[Report]
    url = identity = error = ""
    enabled, has_ended = False, False
    newest: TableState | None = None
    states: deque[TableState] = field(default_factory=deque)
    news: deque[tuple[str, bool]] = field(default_factory=deque)
    extremes: dict[str, tuple[float, float]] = field(default_factory=dict)
    looked: float = 0.0

    @property
    def limits(self) -> Any:
        return self.keeper.limits

    @property
    def axes(self) -> Any:
        return self.keeper._controller.axes

    def send(self, command: Command) -> None:
        with self.ending():
            self.keeper.carry_out(command)
        self.enabled |= command.do == "enable"

    ask = send

    def go(self, *motions: Motion) -> None:
        self.send(Command("go", motions))

    def wait(self, seconds: float) -> None:
        """Have the keeper poll for a time."""
        until = self.clock.now + seconds
        while self.clock.now < until:
            self.poll()

    def poll(self) -> None:
        with self.ending():
            self.keeper.poll()
        self.clock.now += 0.005
        self.newest = next(told.state for told in reversed(self.told) if told.state is not None)
        self.states.append(self.newest)

    @contextmanager
    def ending(self) -> Iterator[None]:
        """End the keeper where the controller does not do it, as its process does."""
        try:
            yield
        except TableError as error:
            self.error, self.has_ended = str(error), True
            self.keeper.end(str(error), is_error=True)
            raise
        finally:
            self.look()

    def look(self) -> None:
        """Take the extremes of the true angles since the last look."""
        table = self.wire.controller.table
        table.advance(self.clock.now)
        angles = np.degrees(table.angles(np.linspace(self.looked, table.now, 12)))
        self.looked = table.now
        for k, axis in enumerate(("outer", "middle", "inner")):
            low, high = self.extremes.get(axis, (0.0, 0.0))
            self.extremes[axis] = min(low, float(angles[:, k].min())), max(high, float(angles[:, k].max()))

    def check(self) -> None:
        """Assert that no axis has left its limits."""
        self.look()
        for axis, own in self.limits.items():
            low, high = self.extremes[axis]
            assert own.ends[0] - NOISE_DEG < low, (axis, low, own, self.error)
            assert high < own.ends[1] + NOISE_DEG, (axis, high, own, self.error)


@contextmanager
def kept(limits: str = "", latency_s: float = 0.002, at_deg: float = 0.0, **model: Any) -> Iterator[Kept]:
    clock = Clock()
    with pytest.MonkeyPatch.context() as patch:
        for module in (acutrol, keeper, commanded_table):
            patch.setattr(module, "time", clock)
        patch.setattr(keeper, "_wait", clock.sleep)
        controller = VirtualAcutrol(TurnTable(TableModel(seed=3, **({"axes": ("inner",)} | model))))
        for axis in controller.table.axes.values():
            axis.angle = axis._reference = axis._between = axis.demand = math.radians(at_deg)
            controller.table._past.angles[:] = math.radians(at_deg)
        wire, told = Wire(controller, clock, latency_s), list[Report]()

        def connect(asks: bool) -> Acutrol:
            wire.is_closed = False
            wire.sent.append("connected")
            return Acutrol(wire, asks=asks)  # type: ignore[arg-type]

        made = Keeper(connect, parse_limits(limits), told.append, NoLines())  # type: ignore[arg-type]
        it = Kept(made, wire, clock, told)
        it.extremes = dict.fromkeys(("outer", "middle", "inner"), (at_deg, at_deg))
        it.wait(0.02)
        it.ask(Command("enable"))
        yield it


def refusal(it: Kept) -> str:
    return next((told.refused for told in reversed(it.told) if told.refused), "")


# ---------------------------------------------------------------------------------------------------- never beyond them

sizes = st.floats(0.0, 2.7).map(lambda exponent: 10.0**exponent)  # 1 to 500, gentle ones as often as brisk ones
signs = st.sampled_from((-1.0, 1.0))
commands = st.one_of(
    st.builds(
        lambda angle, rate, accel: Move("inner", angle, min(rate, 400.0), accel), st.floats(-200.0, 200.0), sizes, sizes
    ),
    st.builds(lambda sign, rate, accel: Turn("inner", sign * min(rate, 400.0), accel), signs, sizes, sizes),
    st.builds(lambda amplitude, hz: Swing("inner", amplitude, hz, 500.0), st.floats(0.0, 60.0), st.floats(0.05, 2.0)),
    st.none(),
)
"""Motions; None: a stop."""
ends = st.tuples(st.floats(-185.0, -5.0), st.floats(5.0, 185.0))


@settings(max_examples=60, deadline=None, derandomize=True, phases=[Phase.generate])
@given(
    ends,
    st.lists(st.tuples(commands, st.floats(0.1, 3.0)), min_size=1, max_size=5),
    st.sampled_from((0.002, 0.04, 0.25)),
    st.sampled_from((2_000.0, 20_000.0)),
)
def test_no_command_takes_an_axis_beyond_its_limits(
    limits: tuple[float, float], asked: list[tuple[Motion | None, float]], latency_s: float, jerk: float
) -> None:
    low, high = limits
    with kept(f"inner=400/500/{low}/{high}", latency_s, jerk=jerk * DPS) as it:
        try:
            for motion, seconds in asked:
                it.send(Command("stop") if motion is None else Command("go", (motion,)))
                it.wait(seconds)
        except TableError:  # the keeper has stopped it
            assert it.has_ended
        it.check()


segments = st.one_of(
    st.builds(lambda angle: Dwell((0.0, 0.0, math.radians(angle)), 0.5), st.floats(-180.0, 180.0)),
    st.builds(lambda sign, rate, s: Rate("inner", math.radians(sign * rate), s), signs, sizes, st.floats(0.2, 3.0)),
    st.builds(lambda a, hz: Sine("inner", math.radians(a), hz, 2.0), st.floats(1.0, 40.0), st.floats(0.2, 1.0)),
)


def run_through(it: Kept, profile: Profile) -> None:
    """Have a profile's segments commanded one after the other, as an acquisition does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(commanded_table, "KeptTable", lambda *_, **__: it)
        table = CommandedTable("")
        table.check(profile)
        for segment in profile.segments:
            table.go(profile, segment, it.clock.monotonic_ns())
            while not table.has_arrived(it.clock.monotonic_ns()):
                it.poll()
                table.take(it.clock.monotonic_ns())
                assert not refusal(it), refusal(it)
            it.wait(segment.seconds)


@settings(max_examples=40, deadline=None, derandomize=True, phases=[Phase.generate])
@given(
    ends,
    st.lists(segments, min_size=1, max_size=3).map(tuple),
    st.floats(0.7, 2.0).map(lambda exponent: 10.0**exponent),
    st.sampled_from((0.002, 0.04)),
)
def test_a_profile_that_passes_its_check_runs_through_within_limits(
    limits: tuple[float, float], parts: tuple[Segment, ...], accel: float, latency_s: float
) -> None:
    low, high = limits
    with kept(f"inner=400/500/{low}/{high}", latency_s) as it:
        try:
            run_through(it, Profile(parts, slew=math.radians(60.0), accel=math.radians(accel)))
        except InputError:  # it goes beyond limits: nothing has moved
            assert it.extremes["inner"][1] < NOISE_DEG
        it.check()


# ---------------------------------------------------------------------------------------------------- one case of each


def test_an_axis_goes_the_way_between_its_stops_and_not_the_short_way_through_them() -> None:
    """The controller counts modulo 360: two demands of less than half a turn each, none modulo 360."""
    with kept("inner=200/200/-170/170", at_deg=160.0) as it:
        it.go(Move("inner", -160.0, 150.0, 200.0))
        it.wait(8.0)
        assert it.newest is not None
        assert it.newest.angles_deg[2] == pytest.approx(-160.0, abs=0.05)
        it.check()


@pytest.mark.parametrize(("at", "ask", "back"), [(178.0, 175.0, True), (178.0, 0.0, True), (178.0, 179.0, False)])
def test_a_table_outside_its_limits_may_move_back_and_no_farther_out(at: float, ask: float, back: bool) -> None:
    with kept("inner=200/200/-170/170", at_deg=at) as it:
        it.go(Turn("inner", 20.0, 200.0))
        assert "to its limit" in refusal(it)
        it.go(Move("inner", ask, 100.0, 200.0))
        it.wait(6.0)
        assert it.newest is not None
        assert it.newest.angles_deg[2] == pytest.approx(ask if back else at, abs=0.05)
        assert it.extremes["inner"][1] < at + NOISE_DEG


@pytest.mark.parametrize(("rate", "accel"), [(30.0, 5.0), (100.0, 100.0), (-30.0, 5.0)])
def test_a_rate_whose_own_braking_has_no_room_is_refused_and_never_sent(rate: float, accel: float) -> None:
    with kept("inner=200/200/-60/60") as it:
        it.go(Turn("inner", rate, accel))
        assert "until it stands" in refusal(it)
        it.wait(1.0)
        assert it.extremes["inner"][1] - it.extremes["inner"][0] < NOISE_DEG


def test_a_stop_amid_a_move_brakes_as_the_move_does() -> None:
    """Else it brakes with what the last rate was given, which may take it far beyond where it was sent."""
    with kept("inner=200/200/-60/60") as it:
        it.go(Turn("inner", 1.0, 1.0))
        it.wait(1.0)
        it.ask(Command("stop"))
        it.go(Move("inner", 55.0, 60.0, 100.0))
        it.wait(0.8)
        it.ask(Command("stop"))
        it.check()


def test_a_swing_that_is_made_larger_is_checked_about_its_own_centre() -> None:
    with kept("inner=200/500/-40/12") as it:
        it.go(Swing("inner", 10.0, 0.5, 500.0))
        while it.newest is None or it.newest.angles_deg[2] > -9.0:
            it.poll()
        it.go(Swing("inner", 18.0, 0.5, 500.0))
        assert "-40 to 12" in refusal(it)
        it.wait(3.0)
        it.check()


def test_a_rate_that_slows_an_axis_down_is_not_refused_next_to_its_stop() -> None:
    with kept("inner=200/200/-60/60") as it:
        it.go(Turn("inner", 30.0, 50.0))
        while it.newest is None or it.newest.angles_deg[2] < 33.0:
            it.poll()
        it.go(Turn("inner", 0.0, 50.0))
        assert refusal(it) == ""
        it.wait(2.0)
        it.check()


# -------------------------------------------------------------------------------------------------------------- a stop


def test_a_table_whose_answers_are_lost_is_stopped_before_anything_is_asked_over_each_link() -> None:
    """It stands though it never says so; the last word is the emergency stop, and nothing fails on a closed link."""
    with kept() as it:
        it.go(Turn("inner", 100.0, 100.0))
        it.wait(2.0)
        it.wire.is_silent = True
        del it.wire.sent[:]
        silent_s = it.clock.now
        with pytest.raises(TableLinkError):
            it.keeper.poll()
        it.keeper.end("no answer.", is_error=True, is_deaf=True)
        it.look()
        assert it.wire.controller.table.axes["inner"].is_idle
        assert 60.0 < it.clock.now - silent_s < 70.0
    last = next(told.error for told in reversed(it.told) if told.error)
    assert last.endswith("NOT confirmed within 60 s that the table rests. Press its emergency stop.")
    over = [link.split("|") for link in "|".join(it.wire.sent[1:]).split("|connected|")]
    assert len(over) > 5
    for sent in over:
        told = [
            line
            for line in sent[: next(k for k, line in enumerate(sent) if "?" in line)]
            if line.endswith(("1", "1,0"))
        ]
        assert told == [":demand:rate 1,0", ":mode:rate 1", ":mode:off 1"]


def test_rate_zero_comes_before_mode_off_by_what_braking_takes() -> None:
    with kept() as it:
        it.go(Turn("inner", 100.0, 50.0))
        it.wait(4.0)
        it.wire.is_silent = True
        it.keeper.end("no answer.", is_error=True, is_deaf=True)
        it.look()
        table = it.wire.controller.table
        rates = np.degrees(table.rates(np.linspace(it.clock.now - 60.0, it.clock.now, 30_000))[:, 2])
        assert np.abs(np.diff(rates)).max() / 0.002 < 55.0  # the drive brakes, and is never cut while it turns


def test_a_stop_from_another_thread_amid_the_worker_ends_its_steps_and_nothing_more_is_sent() -> None:
    with kept() as it, pytest.MonkeyPatch.context() as patch:
        patch.setattr(commanded_table, "KeptTable", lambda *_, **__: it)
        table = CommandedTable("")
        profile = Profile((Rate("inner", 0.2, 1.0), Dwell((0.0, 0.0, 0.0), 1.0)))
        table.go(profile, profile.segments[0], it.clock.monotonic_ns())
        patch.setattr(Turn, "is_there", lambda *_: bool(table.leave() or True))
        assert not table.has_arrived(it.clock.monotonic_ns())
        assert not table._steps
        sent = len(it.wire.sent)
        table.go(profile, profile.segments[1], it.clock.monotonic_ns())  # not before it is enabled again
        assert (table._steps, len(it.wire.sent)) == (deque(), sent)
        it.send(Command("go", (Turn("inner", 5.0, 5.0),), stops=0))  # decided on before the stop, written after it
        assert "stopped meanwhile" in refusal(it)
        assert len(it.wire.sent) == sent
