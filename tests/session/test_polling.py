"""Polled sampling: what was asked for and did not come is lost, what came late is not; on a real pseudo-terminal."""

import os
import random
import threading
import time
import tty
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from helpers.blocks import Arrivals
from helpers.commands import imutui
from helpers.fake_devices import packet
from helpers.faulty_lines import FaultyLine, LineFault
from helpers.processes import LIMIT_S, command_line, started, wait_until
from helpers.units import served

from filters.imu import LOOP_HZ
from imutui.instrument.clock import Clock
from imutui.instrument.driver import Answer, Poller
from imutui.instrument.imu400.crossbow import POWER_UP_BAUD, Command, Mode
from imutui.instrument.imu400.driver import COUNTER, Imu400cd
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.port import Port
from imutui.instrument.virtual_instrument import Reading
from imutui.jobs.check import check
from imutui.logbook import reader
from imutui.logbook.polled_rate import PolledRate
from imutui.session import client
from imutui.session.reader_thread import Reader
from imutui.session.stream import Broke, PacketArrival, Why

LOOP_S = 1.0 / LOOP_HZ
Fate = Callable[[float], tuple[bool, float]]


class Numbered:
    """Each reading says which of the unit's loop it is."""

    def reading(self, k: int) -> Reading:
        return Reading(((k % 5000) / 100.0, 0.0, 0.0), (0.0, 0.0, 0.998), 25.0)


class HardOfHearing(VirtualUnit):
    """Does not hear some of the requests, by their number from 0."""

    def __init__(self, missed: frozenset[int] = frozenset()) -> None:
        super().__init__(Numbered(), UnitOptions())
        self._missed = missed
        self.asked = -1

    def receive(self, data: bytes, now: float, host_baud: int) -> list[Command]:
        heard = b""
        for byte in data:
            self.asked += byte == ord("G")
            heard += bytes([byte]) if byte != ord("G") or self.asked not in self._missed else b""
        return super().receive(heard, now, host_baud)


@dataclass
class Polled:
    """What a reader made of a unit."""

    unit: HardOfHearing
    port: Port
    events: list[Any] = field(default_factory=list)
    doubled: int = 0  # once it has ended

    @property
    def arrivals(self) -> list[PacketArrival]:
        return [event for event in self.events if isinstance(event, PacketArrival)]

    @property
    def lost(self) -> int:
        return sum(event == Broke(Why.UNANSWERED) for event in self.events)

    @property
    def silent(self) -> bool:
        """Whether an answer is overdue."""
        return bool(self.arrivals) and time.monotonic_ns() - self.arrivals[-1].host_ns > 200_000_000

    @property
    def sent(self) -> int:
        return self.unit.asked + 1

    def starts_s(self) -> Iterator[tuple[float, float]]:
        """Between which instants the unit's loop must have started, by each answer: see it as its request's own."""
        for arrival in self.arrivals:
            loop = round(arrival.packet.rates[0] * 300.0 / 2**15 * 100.0) * LOOP_S
            yield (arrival.requested_ns or 0) / 1e9 - LOOP_S - loop, arrival.host_ns / 1e9 - loop


@contextmanager
def polling(
    hz: float, fate: Fate | None = None, *faults: LineFault, missed: frozenset[int] = frozenset()
) -> Iterator[Polled]:
    """A unit that is polled until the block ends; then its reader has ended too."""
    unit = HardOfHearing(missed)
    with served(unit, line=FaultyLine(faults, fate)) as path, Port(path, POWER_UP_BAUD) as port:
        Imu400cd(port).open(None)
        polled = Polled(unit, port)
        clock = Clock(4.7e6, COUNTER, polled=True)
        reader = Reader(Imu400cd(port), Arrivals(clock, polled.events.append), hz, polled.events.append)
        reader.start()
        try:
            yield polled
        finally:
            reader.stop()
            wait_until(lambda: not reader.is_alive())
            polled.doubled = reader._repeated.count


def by_number(hz: float, late: dict[int, float]) -> Fate:
    """How late the answer to the request nearest to a time is."""
    return lambda t: (False, late.get(round(t * hz), 0.0))


def assert_each_answer_is_its_own_requests(polled: Polled) -> None:
    """It was sampled a loop before its request at the earliest, and before it arrived: one start suits all of them."""
    earliest, latest = zip(*polled.starts_s(), strict=True)
    assert max(earliest) <= min(latest)


def test_a_late_answer_is_used_and_is_not_taken_for_the_next_one() -> None:
    """0.6 s late, twice as long as was once waited: nothing is lost, and no later packet is one request behind."""
    with polling(20.0, by_number(20.0, {10: 0.6})) as polled:
        wait_until(lambda: len(polled.arrivals) > 20)
    assert polled.lost == 0
    assert polled.sent == len(polled.arrivals)
    waits = [(a.host_ns - (a.requested_ns or 0)) / 1e9 for a in polled.arrivals]
    assert sum(wait > 0.5 for wait in waits) == 1
    assert_each_answer_is_its_own_requests(polled)
    assert polled.arrivals[-1].discarded_bytes == 0
    assert polled.arrivals[-1].bad_checksums == 0


def test_an_answer_that_comes_twice_is_one_packet_and_no_noise() -> None:
    with polling(20.0, None, LineFault(0.3, "double_packets", 3)) as polled:
        wait_until(lambda: len(polled.arrivals) > 15)
    assert (polled.doubled, polled.lost) == (3, 0)
    assert polled.sent == len(polled.arrivals)
    assert_each_answer_is_its_own_requests(polled)
    last = polled.arrivals[-1]
    assert (last.discarded_bytes, last.bad_checksums) == (0, 0)


def campaign(hz: float) -> Polled:
    """A few dozen requests at most, of which some are not heard, some answers are lost, late, or damaged."""
    random_ = random.Random(round(hz))

    def fate(t: float) -> tuple[bool, float]:
        del t
        what = random_.random()
        return what < 0.08, random_.uniform(0.2, 0.5) if what > 0.94 else 0.0

    missed = frozenset(random_.sample(range(1, 60), 5)) if hz > 1.0 else frozenset([1])
    flips = LineFault(0.4, "bit_flips", 1)
    with polling(hz, fate, flips, missed=missed) as polled:
        threading.Event().wait(2.3)
    return polled


def test_what_is_reported_as_lost_is_what_was_sent_less_what_came() -> None:
    """At 133, 20, 1 and 0.1 Hz, whatever became of requests and answers. All at once, since most of it is waiting."""
    rates = (133.0, 20.0, 1.0, 0.1)
    with ThreadPoolExecutor(len(rates)) as pool:
        for hz, polled in zip(rates, pool.map(campaign, rates), strict=True):
            # a unit that was asked again within its loop gives the same packet twice
            assert polled.lost + polled.doubled == polled.sent - len(polled.arrivals), hz
            if polled.arrivals:
                assert_each_answer_is_its_own_requests(polled)
            if hz > 1.0:
                assert polled.lost > 0
                assert len(polled.arrivals) > 10


def test_a_silence_costs_one_request_and_whoever_comes_back_in_another_mode_is_told_again() -> None:
    with polling(20.0, None, LineFault(0.3, "silence", seconds=1.0)) as polled:
        wait_until(lambda: polled.silent)
        polled.port.write(b"r")
        wait_until(lambda: polled.lost > 0)
        before = len(polled.arrivals)
        wait_until(lambda: len(polled.arrivals) > before + 4)
    assert polled.lost == polled.sent - len(polled.arrivals) == 1
    assert polled.unit.mode is Mode.SCALED
    assert_each_answer_is_its_own_requests(polled)


@contextmanager
def asked(before: bytes = b"") -> Iterator[tuple[int, Poller, "Future[Answer | None]"]]:
    """The unit's end of a line on which a packet has just been asked for, who asked, and what comes of the request."""
    master, slave = os.openpty()
    tty.setraw(slave)
    with ThreadPoolExecutor(1) as pool, Port(os.ttyname(slave), POWER_UP_BAUD) as port:
        os.write(master, before)
        wait_until(lambda: port.waiting() == len(before))
        poller = Imu400cd(port).poller(lambda: False)
        found = pool.submit(poller.poll)
        assert os.read(master, 1) == b"G"
        yield master, poller, found
    os.close(master)
    os.close(slave)


def test_a_packet_that_waits_when_a_request_is_sent_is_not_its_answer() -> None:
    with asked(before=packet(3)) as (line, poller, found):
        os.write(line, packet(7))
        answer = found.result(10.0)
    assert answer is not None
    assert answer.packet.ticks == int.from_bytes(packet(7)[15:17], "big")
    assert poller.discarded_bytes == 18


def test_a_packet_that_stutters_is_whole_in_the_end() -> None:
    with asked() as (line, _, found):
        os.write(line, packet(7)[:9])
        assert os.read(line, 1) == b"c"
        os.write(line, packet(7)[9:] + b"C")
        answer = found.result(10.0)
    assert answer is not None
    assert answer.packet.ticks == int.from_bytes(packet(7)[15:17], "big")


def test_half_a_packet_is_lost_once_the_unit_says_something_else_alone() -> None:
    """Its reply, right behind the half, may be a byte of it: asked once more, it says that the packet is lost."""
    with asked() as (line, _, found):
        os.write(line, packet(7)[:9])
        for _ in range(2):
            assert os.read(line, 1) == b"c"
            assert not found.done()
            os.write(line, b"C")
        assert found.result(10.0) is None


def test_a_rate_that_polling_cannot_keep_is_said_everywhere(home: Path) -> None:
    record = ("--rate", "100", "--sampling", "polled", "--baud", "9600", "--filter", "none", "-o", "a.mcap")
    with (
        served(HardOfHearing()) as path,
        started(command_line("record", "--port", path, *record, "--duration", "3")) as run,
    ):
        wait_until(lambda: "100 Hz were asked for" in status())
        _, said = run.communicate(timeout=LIMIT_S)
    assert run.returncode == 1
    assert "100 Hz were asked for" in said
    log = reader.read(home / "a.mcap")
    assert sum("100 Hz were asked for" in event.text for event in log.events) >= 1
    [finding] = [f for f in check(home / "a.mcap")["findings"] if f["code"] == "rate"]
    assert "100 Hz were asked for" in finding["what"]


def status() -> str:
    """What `imutui status` says by now."""
    return imutui("status").stdout if client.running() else ""


def test_a_rate_that_is_not_kept_is_told_from_losses_and_stalls() -> None:
    """One in five lost and ten seconds of silence, or one late answer: so many were asked for as should be."""
    lossy, stalled, halved = PolledRate(20.0), PolledRate(20.0), PolledRate(100.0)
    for k in range(200):
        if k % 5 == 2:
            lossy.unanswered()
        elif not 100 <= k < 140:
            lossy.answered(k * 50_000_000 + (k >= 140) * 10_000_000_000)
    for k in range(40):
        stalled.answered(k * 50_000_000 + (k >= 20) * 700_000_000)
    for k in range(5):
        halved.answered(k * 20_000_000)
    assert (lossy.finding(), stalled.finding()) == (None, None)
    assert halved.finding() is None  # by so few requests
    halved.answered(5 * 20_000_000)
    assert "100 Hz were asked for, 50 Hz came" in str(halved.finding())
    for k in range(40):
        stalled.answered(k * 500_000_000 + 2_800_000_000)
    assert "20 Hz were asked for" in str(stalled.finding())
