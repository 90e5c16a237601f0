"""Acquisitions of every kind of unit and line: nothing crashes, the file holds what came.

Of an IMU400CD and of an IMU381, whose packets tell a loss in ways of their own.

The acquisition runs in this process, on pseudo-terminals, many at a time: most of each is waiting.
"""

import re
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import ros_messages
from helpers.faulty_lines import FaultyLine, LineFault
from helpers.processes import wait_until
from helpers.units import served
from mcap.reader import make_reader
from mcap.records import Message

from filters.simulation import Effect, Scenario
from imutui.cli.virtual_readings import SimulatedReadings
from imutui.instrument.driver import InstrumentError
from imutui.instrument.imu400 import unit as imu400_unit
from imutui.instrument.imu400.crossbow import POWER_UP_BAUD, Mode, Packet
from imutui.instrument.imu400.unit import UnitOptions
from imutui.instrument.port import Port
from imutui.instrument.registry import INSTRUMENTS
from imutui.instrument.uut import unit as uut_unit
from imutui.instrument.uut.messages import PacketS1
from imutui.instrument.uut.unit_options import UnitOptions as UutOptions
from imutui.instrument.virtual_instrument import Reading, Source, VirtualInstrument
from imutui.jobs import check
from imutui.logbook import reader, schemas
from imutui.session import lifecycle, observe, reconnection
from imutui.session.engine import Engine
from imutui.session.lifecycle import EndFinding
from imutui.session.plan import Plan
from imutui.session.snapshot import NO_SERIES, Snapshot

LIMIT_S = 60.0
_AT_ONCE = 6
_HELD_UP_S, _ATTEMPTS = 0.015, 5
_WHILE_NS, _FEWEST = int(0.1e9), 3


class Numbered:
    """Readings of a unit at rest but about X, where each tells its number, so that packets can be told apart."""

    def __init__(self, count_dps: float = 300.0 / 2**15) -> None:
        self._count_dps = count_dps

    def reading(self, k: int) -> Reading:
        return Reading((k % 8192 * self._count_dps, -0.2, 0.3), (0.0, 0.0, 0.998), 25.0)


@dataclass
class Run:
    """One acquisition of a second or two, and what its unit did."""

    instrument: str  # name of the unit's kind
    refused: str = ""  # why it did not begin
    # rates, forces, temperature and counter of each packet that the unit sent
    sent: list[tuple[int, ...]] = field(default_factory=list)
    sampled: list[int] = field(default_factory=list)  # when, on the host's monotonic clock, ns
    lost: int = 0  # packets between the first and the last that were recorded, less those
    # what the unit meant by each that it sent; None of units that have one way only
    modes: list[Mode | None] = field(default_factory=list)
    recorded_modes: set[Mode | None] = field(default_factory=set)  # those of the packets that were recorded
    exit_code: int = 0
    findings: list[EndFinding] = field(default_factory=list)
    seen: Snapshot | None = None  # its last
    log: reader.Log = field(default_factory=lambda: reader.Log(Path()))

    @property
    def lost_said(self) -> int:
        """What the acquisition counted."""
        assert self.seen is not None
        return self.seen["lost_packets"]

    def messages(self, topic: str) -> list[Message]:
        """All messages of a topic, with their times."""
        with self.log.path.open("rb") as stream:
            return [message for _, _, message in make_reader(stream).iter_messages([topic])]

    @property
    def events(self) -> list[str]:
        return [event.text for event in self.log.events]

    def event(self, *words: str) -> str:
        """The one event that has these words."""
        (text,) = [text for text in self.events if all(word in text for word in words)]
        return text


def bounded(run: Run) -> None:
    """What was lost lies within what is said of it: counted where it is certain, within bounds where it is not."""
    assert not run.refused
    assert run.exit_code == 0
    most = sum(int(most) for text in run.events for most in re.findall(r"lost_max=(\d+)", text))
    assert run.lost_said <= run.lost <= most


def went_well(run: Run) -> None:
    """Nothing was lost, and none is said to be lost for certain."""
    bounded(run)
    assert run.lost == 0


def losing(count: int) -> Callable[[Run], None]:
    """So many were lost, and are counted: the bytes before and after decide it."""

    def check(run: Run) -> None:
        bounded(run)
        assert run.lost == run.lost_said == count

    return check


def doubling(run: Run) -> None:
    """Each packet is recorded once, those that came again are counted, and time goes on."""
    went_well(run)
    assert run.log.diagnostics["doubled_packets"] == "5"
    assert np.all(np.diff(run.log.samples.stamp_ns) > 1_000_000)
    codes = [finding["code"] for finding in check.check(run.log.path)["findings"]]
    assert "doubled" in codes
    assert "counter" not in codes


def silent(run: Run) -> None:
    """Longer than the counter's wrap: how many were lost can be bounded only."""
    bounded(run)
    assert run.lost == pytest.approx(0.3 * INSTRUMENTS[run.instrument].most_rate_hz, abs=1)


def found_again(run: Run) -> None:
    """Set up as at the beginning, after a gap in the same file."""
    bounded(run)
    assert run.event("the unit is back", "serial number 9911750")


def refused_another(run: Run) -> None:
    """The other unit is named, the file ends with the loss, and that is said at the end."""
    assert "serial number 7" in run.event("refused")
    assert [finding["exit_code"] for finding in run.findings] == [lifecycle.INSTRUMENT]
    assert run.lost == 0


def set_up_again(run: Run) -> None:
    """Not one packet of voltages is taken for a reading; the unit is set up again."""
    found_again(run)
    assert run.event("measures in volts")
    assert run.recorded_modes == {Mode.SCALED}


def stuck(run: Run) -> None:
    """Recorded as it came: what it means is told by a trace."""
    went_well(run)
    assert len({packet.counts[1] for packet in ros_messages.packets(run.log)[60:]}) == 1
    assert len({packet.counts[2] for packet in ros_messages.packets(run.log)[60:]}) > 10


def known_by_its_text(run: Run) -> None:
    """The version counts as it came, without a frame around it."""
    went_well(run)
    assert run.log.info.firmware == "VIRTUAL SIM PLAIN"


def for_a_second(seen: Snapshot) -> bool:
    """Whether the packets of a second and more have come; faults are at half a second."""
    return seen["packets"] > 160


def another_is_refused(seen: Snapshot) -> bool:
    return seen["reconnecting"] is not None and "serial number 7" in seen["reconnecting"]["waits_for"]


@dataclass(frozen=True)
class Personality:
    """What a unit and its line are like, and what must be true of a recording of it."""

    check: Callable[[Run], None] = went_well
    faults: tuple[LineFault, ...] = ()
    unit: UnitOptions | UutOptions = field(default_factory=UnitOptions)
    source: Callable[[], Source] = Numbered
    bursts_s: float = 0.0
    until: Callable[[Snapshot], bool] = for_a_second
    baud: int = POWER_UP_BAUD

    @property
    def instrument(self) -> str:
        """Name of the unit's kind."""
        return "imu400cd" if isinstance(self.unit, UnitOptions) else "imu381"

    def made(self) -> VirtualInstrument[Any, Any]:
        """The unit that has this personality."""
        if isinstance(self.unit, UnitOptions):
            return imu400_unit.VirtualUnit(self.source(), self.unit, seed=3)
        return uut_unit.VirtualUnit(self.source(), self.unit, seed=3)


def imu381(**how: Any) -> Personality:
    """One of an IMU381; what its options are called is one of those."""
    options = {key: how.pop(key) for key in list(how) if key not in Personality.__dataclass_fields__}
    rest: dict[str, Any] = {"baud": 115200, "source": lambda: Numbered(1260.0 / 2**16), **how}
    return Personality(unit=UutOptions(**options), **rest)


def with_stuck_channel() -> Source:
    """Readings whose rate about Y stays what it was at 0.2 s."""
    effect = Effect("stuck", ("gy",), {"at_s": 0.2, "seconds": 60.0})
    return SimulatedReadings(Scenario(seed=3, effects=(effect,)))


def fault(kind: str, at: float = 0.5, **how: Any) -> tuple[LineFault, ...]:
    return (LineFault(at, kind, **how),)


OF_BOTH: dict[str, dict[str, Any]] = {
    "is plain": {},
    "drops bytes": {"check": losing(1), "faults": fault("drop_bytes", count=7)},
    "adds garbage": {"faults": fault("garbage", count=40)},
    "turns bits": {"check": losing(3), "faults": fault("bit_flips", count=3)},
    "loses packets": {"check": losing(2), "faults": fault("lose_packets", count=2)},
    "sends twice": {"check": doubling, "faults": fault("double_packets", count=5)},
    "sends twice and stalls": {
        "check": doubling,
        "faults": (*fault("stall", seconds=0.7), *fault("double_packets", 0.6, count=5)),
    },
    "is silent": {"check": silent, "faults": fault("silence", seconds=0.3)},
    "stalls": {"faults": fault("stall", seconds=0.7)},
    "has a backlog": {"faults": fault("backlog", count=60)},
    "stutters": {"faults": fault("stutter", seconds=0.2)},
    "pauses": {"faults": fault("pause", seconds=0.5)},
    "bursts and loses": {"check": losing(3), "faults": fault("lose_packets", count=3), "bursts_s": 0.016},
    "stalls and loses": {
        "check": losing(1),
        "faults": (*fault("stall", seconds=0.6), *fault("lose_packets", 0.8, count=1)),
    },
    "is reset": {"check": found_again, "faults": fault("reset")},
    "hangs up": {"check": found_again, "faults": fault("hang_up", seconds=0.3)},
    "loses its power": {"check": found_again, "faults": fault("hang_up", seconds=0.3, power=True)},
    "is another": {
        "check": refused_another,
        "faults": fault("hang_up", seconds=0.3, serial_number=7),
        "until": another_is_refused,
    },
}
PERSONALITIES = {
    **{name: Personality(**how) for name, how in OF_BOTH.items()},
    **{f"(an IMU381) {name}": imu381(**how) for name, how in OF_BOTH.items()},
    "bursts": Personality(bursts_s=0.016),
    "loses over a slow line": Personality(losing(1), fault("lose_packets", count=1), baud=9600),
    "stalls over a slow line": Personality(went_well, fault("stall", seconds=0.7), baud=9600),
    "loses over a line that halves": Personality(losing(2), fault("lose_packets", count=2), baud=19200),
    "runs fast": Personality(unit=UnitOptions(clock_skew_ppm=200.0)),
    "answers in plain text": Personality(
        known_by_its_text, unit=UnitOptions(version="VIRTUAL SIM PLAIN", version_plain_text=True)
    ),
    "has a stuck channel": Personality(stuck, source=with_stuck_channel),
    "keeps at a ping": Personality(unit=UnitOptions(ping="keeps")),
    "resets at a ping": Personality(unit=UnitOptions(ping="resets")),
    "falls into voltage mode": Personality(set_up_again, fault("mode_change")),
    "(an IMU381) loses some": imu381(check=losing(2), faults=fault("lose_packets", count=2)),
    "(an IMU381) runs fast": imu381(clock_skew_ppm=200.0),
}


def words_of(packet: Packet | PacketS1) -> tuple[int, ...]:
    """Rates, forces, temperature and counter, as a log has them."""
    if isinstance(packet, Packet):
        return (*packet.rates, *packet.accels, packet.temperature, packet.ticks)
    return (*packet.rates, *packet.accels, packet.rate_temperatures[0], packet.counter)


def acquired(it: Personality, folder: Path) -> Run:
    """Record a unit of this personality, and compare what was recorded with what it sent."""
    run = Run(it.instrument)
    instrument = INSTRUMENTS[it.instrument]
    line = FaultyLine(it.faults, seed=3, bursts_s=it.bursts_s)
    folder.mkdir()

    def sent(packet: Packet | PacketS1, sampled_ns: int) -> None:
        run.sent.append(words_of(packet))
        run.modes.append(packet.mode if isinstance(packet, Packet) else None)
        run.sampled.append(sampled_ns)

    device = served(it.made(), line=line, link=folder / "imu", on_packet=sent)
    with device as path, Port(path, instrument.power_up_bauds[0]) as port:
        plan = Plan(
            path, rate_hz=instrument.most_rate_hz, instrument=it.instrument, logs=str(folder), record=True,
            filter="none",
            baud=it.baud, accel_sign=instrument.accel_sign,
        )  # fmt: skip
        host = instrument(port, plan.rate_hz)
        try:
            identity = host.open(plan.baud)
        except InstrumentError as error:
            run.refused = str(error)
            return run
        engine = Engine(plan, host, identity)
        engine.start()
        wait_until(lambda: it.until(looked_at(engine)), LIMIT_S)
        engine.request_stop()
        assert engine.lifecycle.ended.wait(LIMIT_S)
        assert engine.lifecycle.error is None
        assert engine.result is not None
        run.seen = looked_at(engine)
        run.exit_code, run.findings = engine.exit_code, engine.lifecycle.findings
    run.log = reader.read(Path(engine.result["log"]), raw=True)
    assert run.log.finished
    assert not run.log.damage
    numbers = recorded(run)
    run.recorded_modes = {run.modes[number] for number in numbers}
    run.lost = numbers[-1] - numbers[0] + 1 - len(numbers)
    stamped_as_said(run, numbers)
    checked_as_said(run)
    return run


def checked_as_said(run: Run) -> None:
    """`check` finds what the recording says that was lost, and nothing that did not happen."""
    found = [finding for finding in check.check(run.log.path)["findings"] if finding["code"] == "lost"]
    assert bool(found) == any("lost_max" in text for text in run.events), found


def stamped_as_said(run: Run, numbers: list[int]) -> None:
    """No stamp is further from the truth than the file says each second, nor later than its packet's arrival."""
    said = [schemas.decode_diagnostics(message.data) or {} for message in run.messages(schemas.DIAGNOSTICS)]
    uncertain_ns = max(float(values["stamp_uncertainty_ms"] or 0.0) for values in said) * 1e6
    off = []
    for message, packet, number in zip(run.messages(schemas.RAW), ros_messages.packets(run.log), numbers, strict=True):
        assert message.publish_time <= message.log_time
        off.append(message.publish_time - message.log_time + packet.host_monotonic_ns - run.sampled[number])
    if not always_late(run, numbers):
        assert max(map(abs, off)) <= uncertain_ns


def always_late(run: Run, numbers: list[int]) -> bool:
    """Whether the machine was so busy that for a while packets came at their pace, but all of them a wrap late.

    The bytes of such a while are those of a unit that paused.
    """
    read = [packet.host_monotonic_ns for packet in ros_messages.packets(run.log)]
    late = [ns - run.sampled[number] for ns, number in zip(read, numbers, strict=True)]
    ends = np.searchsorted(read, np.array(read) + _WHILE_NS).tolist()
    return any(end - k >= _FEWEST and min(late[k:end]) > 45e6 for k, end in enumerate(ends) if end < len(read))


def looked_at(engine: Engine) -> Snapshot:
    return engine.call(lambda acquisition: observe.snapshot(acquisition, NO_SERIES), late=True)


def recorded(run: Run) -> list[int]:
    """Number among those sent of each packet that was recorded; each was sent, and they are in order."""
    words = [(*packet.counts, packet.temperature, packet.ticks) for packet in ros_messages.packets(run.log)]
    # before it is asked for data a unit reads the same all the time, and its counter wraps: the last like it is the one
    start = len(run.sent) - 1 - run.sent[::-1].index(words[0])
    numbers = []
    for each in words:
        start = run.sent.index(each, start) + 1
        numbers.append(start - 1)
    return numbers


@contextmanager
def longest_hold_up() -> Iterator[list[float]]:
    """For how long this process did not get the processor, at most, s: what a busy machine does to unit and host."""
    longest, over = [0.0], threading.Event()

    def watch() -> None:
        before = time.monotonic()
        while not over.wait(0.005):
            now = time.monotonic()
            longest[0], before = max(longest[0], now - before), now

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield longest
    finally:
        over.set()
        thread.join()


def test_a_host_lives_with_every_personality(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing crashes or is invented, what is missing is what was lost, what cannot go well is said. All at once.

    A unit that was held up for a few packets was another one than asked: it is run again, alone.
    """
    monkeypatch.setattr(reconnection, "_LEAST_SILENCE_S", 1.0)  # a unit that was reset is asked sooner than usual
    void = list[str]()

    def went(name: str, attempt: int = 0) -> str:
        it = PERSONALITIES[name]
        with longest_hold_up() as longest:
            try:
                it.check(acquired(it, home / f"{name} {attempt}"))
            except Exception:  # noqa: BLE001 - of all, what went wrong with which
                text = f"--- a unit that {name} (held up for {longest[0]:.3f} s):\n{traceback.format_exc()}"
            else:
                return ""
        if longest[0] < _HELD_UP_S or attempt == _ATTEMPTS:
            return text
        void.append(name)
        return ""

    with ThreadPoolExecutor(_AT_ONCE) as pool:
        wrong = [text for text in pool.map(went, PERSONALITIES) if text]
    for attempt in range(1, _ATTEMPTS + 1):
        again, void[:] = void[:], []
        wrong += [text for name in again if (text := went(name, attempt))]
    assert not wrong, "\n".join(wrong)
