"""The driver of an IMU381 against a virtual unit on a pseudo-terminal, and against bytes that a real one sent."""

import binascii
import queue
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.blocks import Arrivals
from helpers.faulty_lines import FaultyLine, LineFault
from helpers.paths import ROOT
from helpers.processes import wait_until
from helpers.units import Still, served

from imutui.instrument.clock import Clock, Stamp
from imutui.instrument.driver import InstrumentError
from imutui.instrument.frame_search import Discarded
from imutui.instrument.imu400 import unit as imu400
from imutui.instrument.port import Port
from imutui.instrument.registry import which_answers
from imutui.instrument.transmitter import transfer_s
from imutui.instrument.uut.decoder import Decoder
from imutui.instrument.uut.driver import Imu381
from imutui.instrument.uut.fields import Field
from imutui.instrument.uut.frames import Frame, framed
from imutui.instrument.uut.messages import PING, Memory, PacketS1, encode, numbers
from imutui.instrument.uut.packet_makers import RecordedStream
from imutui.instrument.uut.unit import VirtualUnit
from imutui.instrument.uut.unit_options import IMU381ZA, UnitOptions
from imutui.session.reader_thread import Reader, ReaderEvent
from imutui.session.reconnection import KnownUnit, LineLost, LineReturned
from imutui.session.stream import Block, PacketArrival, Stamper

DATA = ROOT.parent / "shared" / "data"
STREAM, DECODED = DATA / "aceinna_imu381_scale1.raw", DATA / "aceinna_imu381_s1_static.npz"
OWN = tuple(int(field) for field, _ in IMU381ZA)


@contextmanager
def still(options: UnitOptions | None = None) -> Iterator[str]:
    """Port of a unit at rest, which streams by itself."""
    options = options or UnitOptions()
    with served(VirtualUnit(Still(), options)) as name:
        yield name


def acquired(host: Imu381, poll_hz: float | None, enough: Callable[[int], bool]) -> list[PacketArrival]:
    """Packets that a reader gets until they are enough."""
    events, found = queue.SimpleQueue[ReaderEvent](), list[PacketArrival]()
    reader = Reader(host, Arrivals(clock_of(host, poll_hz), found.append), poll_hz, events.put)
    reader.start()
    until = time.monotonic() + 60.0
    try:
        # asked again without an event: what the unit has sent is written down after the host has it
        while not enough(len(found)):
            assert time.monotonic() < until, f"{len(found)} packets, and they are not enough"
            with suppress(queue.Empty):
                event = events.get(timeout=0.2)
                assert isinstance(event, Block), event
    finally:
        reader.stop()
        reader.join(10.0)
    return found


def clock_of(host: Imu381, poll_hz: float | None) -> Clock:
    """A clock of its packets."""
    return Clock(transfer_s(31, 115200) * 1e9, host.counter, polled=poll_hz is not None)


def stamped(clock: Clock, arrivals: list[PacketArrival]) -> list[Stamp]:
    """What a clock makes of packets."""
    stamps = []
    for each in arrivals:
        how = {"contiguous": each.contiguous, "quiet": each.quiet, "behind": each.behind}
        stamps += clock.take(each.packet.ticks, each.host_ns, **how)
    return stamps + clock.release()


@pytest.mark.parametrize("code", [5, 2])
def test_a_unit_is_found_read_at_the_asked_rate_and_left_as_it_was(code: int) -> None:
    fields = tuple((field, code if field == Field.BAUD else value) for field, value in IMU381ZA)
    with still(UnitOptions(fields=fields)) as name, Port(name, 38400) as port:
        host = Imu381(port, 50.0)
        identity = host.open(None)
        assert (identity.serial_number, identity.version[:12]) == ("9911750", "IMU381ZA-200")
        assert f"{'115200' if code == 5 else '38400'} baud, packets S1" in identity.configuration
        assert identity.own_mount == "x,y,z"
        assert host.stream_hz == 50.0
        found = acquired(host, None, lambda n: n >= 25)
        steps = np.diff([each.packet.ticks for each in found]) % 65536
        assert set(steps.tolist()) <= {1310, 1311}
        own = {int(field): value for field, value in fields}
        assert Imu381(port).fields(OWN) == own
        assert Imu381(port).fields(OWN, Memory.EEPROM) == own


def test_packets_are_asked_for_one_by_one() -> None:
    with still() as name, Port(name, 115200) as port:
        host = Imu381(port)
        host.open(None)
        found = acquired(host, 50.0, lambda n: n >= 20)
        assert all(each.requested_ns is not None and each.requested_ns < each.host_ns for each in found)
        assert found[-1].discarded_bytes == found[-1].bad_checksums == 0


def test_a_line_that_never_falls_quiet_is_not_waited_for() -> None:
    """What streams there may be another unit, which hears no request to be quiet."""
    with served(imu400.VirtualUnit(Still())) as name, Port(name, 38400) as port:
        port.write(b"cC")
        Imu381(port, 100.0).stop()
        assert port.read(64)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_a_late_answer_is_not_taken_for_that_to_a_later_request(count: int) -> None:
    line = FaultyLine((LineFault(0.55, "backlog", count=count),))
    options, sampled = UnitOptions(), dict[int, int]()
    unit = VirtualUnit(Still(), options)

    def sent(packet: PacketS1, sampled_ns: int) -> None:
        sampled[packet.counter] = sampled_ns

    with served(unit, line=line, on_packet=sent) as name, Port(name, 115200) as port:
        host = Imu381(port)
        host.open(None)
        poller, answered = host.poller(lambda: False), 0
        while answered < 20:
            answer = poller.poll()
            if answer is not None:
                answered += 1
                # the unit answers with its newest, from a loop of 10 ms
                assert sampled[answer.packet.ticks] > answer.requested_ns - 11_000_000
            time.sleep(0.05)


def test_a_unit_tells_itself_from_the_other_kind_on_its_line() -> None:
    """Asked which instrument answers, an IMU381 says so while it streams."""
    with still() as name, Port(name, 38400) as port:
        assert which_answers(port) is Imu381


def test_a_stream_that_the_line_does_not_carry_is_refused_in_words() -> None:
    """At 9600 baud the unit would refuse 100 Hz; what fits is said."""
    fields = tuple((field, 0 if field == Field.BAUD else value) for field, value in IMU381ZA)
    slow = tuple((field, 0 if field == Field.RATE_DIVIDER else value) for field, value in fields)
    unit = still(UnitOptions(fields=slow, baud_codes=(0, 5)))
    with unit as name, Port(name, 9600) as port, pytest.raises(InstrumentError, match="25 Hz"):
        Imu381(port, 100.0).open(None)


OTHER = {Field.PACKET_TYPE: int.from_bytes(b"S0", "big"), Field.RATE_DIVIDER: 4}


def configured(**changes: Any) -> UnitOptions:
    """A unit that was found with other fields than the usual ones: packets S0 at 25 Hz unless changes say otherwise."""
    own = dict(IMU381ZA) | OTHER | {Field[name]: value for name, value in changes.items()}
    return UnitOptions(fields=tuple(own.items()), baud_codes=(0, 1, 2, 3, 5, 6))


def own_of(options: UnitOptions) -> dict[int, int]:
    return {int(field): value for field, value in options.fields}


def test_type_and_rate_that_were_changed_are_put_back() -> None:
    """A unit that sent S0 at 25 Hz does so afterwards; what is done twice is done once."""
    options = configured()
    with still(options) as name, Port(name, 115200) as port:
        host = Imu381(port, 30.0)
        host.open(None)
        # a rate that it has not: means of as many packets as the line carries
        assert host.stream_hz == 100.0
        acquired(host, None, lambda n: n >= 5)
        assert Imu381(port).fields(OWN) == own_of(options)
        Imu381(port).put({Field.RATE_DIVIDER: 2})
        assert host.leave() == ""
        assert Imu381(port).fields((Field.RATE_DIVIDER,)) == {1: 2}


def test_a_unit_that_takes_its_own_fields_only_at_power_up_is_restarted() -> None:
    """S0 at 100 Hz and 38400 baud, as some come: too much for the line by their own rule, when it is set."""
    options = configured(RATE_DIVIDER=1, BAUD=2)
    with still(options) as name, Port(name, 38400) as port:
        host = Imu381(port, 20.0)
        host.open(None)
        assert host.leave() == ""
        wait_until(lambda: Imu381(port).fields(OWN) == own_of(options))


def test_what_a_unit_does_not_take_back_is_said() -> None:
    """Fields that somebody had set until the next power-up, and that go together no more."""
    options = configured(RATE_DIVIDER=1, BAUD=2, PACKET_TYPE=int.from_bytes(b"S1", "big"))
    with still(options) as name, Port(name, 38400) as port:
        host = Imu381(port, 20.0)
        host.open(None)
        host._own = host._own | {Field.PACKET_TYPE: OTHER[Field.PACKET_TYPE]}
        said = host.leave()
    assert "was found with packets S0, rate divider 1 (100 Hz) and does not take that back: it has packets S0" in said


@pytest.mark.parametrize(
    ("options", "rate_hz", "message"),
    [
        (configured(BAUD=1, RATE_DIVIDER=2), 100.0, "does not carry 100 Hz"),
        (
            UnitOptions(fields=tuple((dict(IMU381ZA) | OTHER).items()), packet_types=(b"S0",)),
            20.0,
            "packets of type S1",
        ),
    ],
    ids=["rate", "type"],
)
def test_a_unit_that_cannot_be_used_is_left_as_it_was(options: UnitOptions, rate_hz: float, message: str) -> None:
    with still(options) as name, Port(name, 19200 if "carry" in message else 115200) as port:
        host = Imu381(port, rate_hz)
        with pytest.raises(InstrumentError, match=message):
            host.open(None)
        host.leave()
        assert Imu381(port).fields(OWN) == own_of(options)


def test_a_stream_that_is_refused_ends_in_words_and_leaves_the_unit_as_it_was() -> None:
    stream = RecordedStream(encode(PacketS1((0, 0, 0), (0, 0, 0), (0, 0, 0), 0, 0, 0)))
    fields = tuple((dict(IMU381ZA) | dict(stream.only) | {Field.RATE_DIVIDER: 0}).items())
    options, events = UnitOptions(fields=fields), queue.SimpleQueue[ReaderEvent]()
    with served(VirtualUnit(stream, options)) as name, Port(name, 115200) as port:
        host = Imu381(port, 20.0)
        reader = Reader(host, Stamper(clock_of(host, None)), None, events.put, KnownUnit(host.open(None), port.baud))
        reader.start()
        reader.join(20.0)
        lost = events.get(timeout=1.0)
        assert isinstance(lost, LineLost)
        assert lost.final
        assert "the unit refuses a stream of 20 Hz" in lost.message
        assert Imu381(port).fields(OWN) == own_of(options)


DAMAGE = tuple(
    LineFault(at, kind, count=count)
    for at, kind, count in [
        (1.0, "garbage", 40), (4.0, "drop_bytes", 3), (8.0, "drop_bytes", 28), (12.0, "bit_flips", 5),
        (20.0, "garbage", 1), (24.0, "garbage", 300), (28.0, "drop_bytes", 100), (33.0, "lose_packets", 2),
        (39.0, "bit_flips", 1), (46.0, "garbage", 31),
    ]
)  # fmt: skip


def whole_frames(data: bytes) -> list[bytes]:
    """Each S1 among bytes whose sum is right, wherever it is: found without the decoder that is judged."""
    starts = [at for at in range(len(data) - 30) if data[at : at + 5] == b"UUS1\x18"]
    frames = [data[at : at + 31] for at in starts]
    return [frame for frame in frames if binascii.crc_hqx(frame[2:29], 0x1D0F) == int.from_bytes(frame[29:])]


@pytest.mark.skipif(not STREAM.exists(), reason="the recorded stream is not here: ../shared/data")
@pytest.mark.parametrize("damage", [(), DAMAGE], ids=["as it was sent", "damaged on the way"])
def test_each_whole_frame_of_a_recorded_stream_is_acquired(damage: tuple[LineFault, ...], tmp_path: Path) -> None:
    """All 1002 that a real unit sent, or those that the line left whole, in order; counts as decoded, none invented."""
    sent = whole_frames(STREAM.read_bytes())
    last = sent[-1]
    stream = RecordedStream(STREAM.read_bytes())
    fields = {**dict(IMU381ZA), **dict(stream.only), Field.RATE_DIVIDER: 0}
    options = UnitOptions(fields=tuple(fields.items()), packet_types=(stream.kind,))
    tap = tmp_path / "tap"

    def all_came(count: int) -> bool:
        sent = tap.read_bytes()
        return sent[-31:] == last and len(whole_frames(sent)) == count

    # ten times as fast: the counter's tick is a tenth, and the stamps are the arrivals'
    with (
        tap.open("wb", buffering=0) as sink,
        served(VirtualUnit(stream, options), sink, FaultyLine(damage, seed=5), speed=10.0) as name,
        Port(name, 115200) as port,
    ):
        host = Imu381(port, 20.0)
        host.open(None)
        found = acquired(host, None, all_came)
        came = whole_frames(tap.read_bytes())
    packets = [each.packet for each in found]
    assert packets == Decoder().feed(b"".join(came))
    if damage:
        assert 980 <= len(packets) < 990
        assert found[-1].bad_checksums >= 3
        assert found[-1].discarded_bytes > 400
    else:
        assert (len(packets), found[-1].bad_checksums, found[-1].discarded_bytes) == (1002, 0, 0)
    numbers = [sent.index(frame) for frame in came]
    decoded = np.load(DECODED)
    scaling = Imu381.scaling(1.0, 1.0)
    assert np.allclose(scaling.rates_dps([p.rates for p in packets]), decoded["gyro"][numbers], atol=1e-4)
    assert np.allclose(scaling.accels_g([p.accels for p in packets]), decoded["accel"][numbers], atol=1e-6)
    assert np.allclose(scaling.temperature_degc([p.temperature for p in packets]), decoded["temp"][numbers], atol=1e-4)


def stream_of(losing: range, period_s: float = 0.05, skew: float = 1.00002) -> list[PacketArrival]:
    """Packets of a unit at 20 Hz, without those that are lost."""
    found = []
    contiguous = False
    for k in range(400):
        ticks = (65000 + round(k * period_s * 65536)) % 65536
        if k in losing:
            contiguous = False
            continue
        late_ns = 3_000_000 + (k * 7919) % 400_000
        at = round(1e12 + k * period_s * skew * 1e9) + late_ns
        packet = PacketS1((0, 0, 0), (0, 0, 0), (0, 0, 0), 0, ticks, 0)
        found.append(PacketArrival(packet, at, contiguous, not contiguous, False, 0, 0))
        contiguous = True
    return found


@pytest.mark.parametrize("losing", [range(0), range(200, 203), range(200, 240), range(200, 221)])
def test_losses_are_reported(losing: range) -> None:
    clock = Clock(transfer_s(31, 115200) * 1e9, Imu381(None).counter, period_ns=50e6)  # type: ignore[arg-type]
    stamps = stamped(clock, stream_of(losing))
    gaps = [stamp.gap for stamp in stamps if stamp.gap is not None]
    assert len(stamps) == 400 - len(losing)
    assert len(gaps) == (1 if losing else 0)
    assert all(gap.lost_min <= len(losing) <= gap.lost_max for gap in gaps)
    assert sum(stamp.by_host for stamp in stamps) <= 2
    t = np.array([stamp.monotonic_ns for stamp in stamps], float)
    assert abs(np.median(np.diff(t)) - 50e6) < 0.05e6


def test_a_unit_that_was_reset_in_mid_stream_is_set_up_again() -> None:
    options, events, ticks = UnitOptions(), queue.SimpleQueue[ReaderEvent](), list[int]()
    reset = FaultyLine((LineFault(1.0, "reset"),))
    with (
        served(VirtualUnit(Still(), options), line=reset) as name,
        Port(name, 115200) as port,
    ):
        host = Imu381(port, 20.0)
        known = KnownUnit(host.open(None), port.baud, Imu381.power_up_bauds)
        stamper = Arrivals(clock_of(host, None), lambda arrival: ticks.append(arrival.packet.ticks))
        reader = Reader(host, stamper, None, events.put, known)
        reader.start()
        try:
            seen: list[ReaderEvent] = []
            while not any(isinstance(event, LineReturned) for event in seen):
                seen.append(events.get(timeout=10.0))
            ticks.clear()
            wait_until(lambda: len(ticks) >= 4)
        finally:
            reader.stop()
            reader.join(10.0)
    assert any(isinstance(event, LineLost) and "as after power-up" in event.message for event in seen)
    assert set((np.diff(ticks) % 65536).tolist()) <= {3276, 3277}


def test_packets_that_nobody_has_asked_for_are_told_as_bytes_and_counted() -> None:
    """S2 and attitudes, of a unit that has other fields than it was told; replies are neither packets nor noise."""
    stream = Imu381(None, 20.0).packets()  # type: ignore[arg-type]
    packet, other = PacketS1((1, 2, 3), (4, 5, 6), (7, 8, 9), 10, 11, 2), framed(Frame(b"S2", bytes(28)))
    reply = encode(Frame(b"SF", numbers((Field.RATE_DIVIDER,))))
    events = stream.feed(encode(packet) + other + reply + encode(packet))
    assert events == [packet, Discarded(other, bad_checksum=False), packet]
    assert (stream.discarded_bytes, stream.bad_checksums) == (len(other), 0)


@pytest.mark.parametrize("cut_off", range(31))
def test_answers_amid_a_stream_are_counted_until_the_next_packet(cut_off: int) -> None:
    stream = Imu381(None, 20.0).packets()  # type: ignore[arg-type]
    packet, ping = encode(PacketS1((1, 2, 3), (4, 5, 6), (7, 8, 9), 10, 11, 2)), encode(PING)
    stream.feed(packet + packet[:cut_off] + ping)
    stream.pause()
    assert stream.answers == 1
    stream.feed(ping)
    stream.pause()
    assert (stream.answers, stream.discarded_bytes) == (2, cut_off)
    stream.feed(packet)
    assert stream.answers == 0
