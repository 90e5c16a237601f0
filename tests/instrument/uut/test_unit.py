"""The virtual IMU381: a state machine on a time of the test's own, with its fields, and streams played back."""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from helpers.faulty_lines import FaultyLine, FaultyWire, LineFault
from helpers.units import IMU380ZA_200

from imutui.instrument.frame_search import Discarded
from imutui.instrument.uut.decoder import Decoder
from imutui.instrument.uut.frames import Frame, framed
from imutui.instrument.uut.messages import (
    PING,
    REFUSED,
    RESET,
    SCALING,
    PacketS0,
    PacketS1,
    encode,
    identification,
    numbers,
    pairs,
)
from imutui.instrument.uut.packet_makers import RecordedStream
from imutui.instrument.uut.unit import VirtualUnit
from imutui.instrument.uut.unit_options import UnitOptions
from imutui.instrument.virtual_instrument import Reading

Event = PacketS1 | Frame | Discarded

RATE, BAUD, TYPE, ORIENTATION = 1, 2, 3, 7
S0 = int.from_bytes(b"S0")


class Ramp:
    """A source whose X rate tells the number of the reading, in counts."""

    def __init__(self, length: int = 10**9) -> None:
        self.length = length
        self.asked: list[int] = []

    def reading(self, k: int) -> Reading | None:
        self.asked.append(k)
        lsb = SCALING.rate_lsb_dps
        return Reading((k * lsb, 1.0, 2.0), (0.0, 0.1, -1.0), 25.0) if k < self.length else None


class Host:
    """A host that reads whatever comes when it comes, on a simulated time."""

    def __init__(
        self,
        packets: Ramp | RecordedStream | None = None,
        *faults: LineFault,
        options: UnitOptions | None = None,
        baud: int = 115200,
        seed: int | None = 1,
    ) -> None:
        options = options or UnitOptions()
        self.sent: list[tuple[PacketS1, float]] = []
        self.unit = VirtualUnit(packets or Ramp(), options, seed=seed)
        line = FaultyLine(faults, seed=5)
        self.wire = FaultyWire(self.unit, line, 1.0, lambda *packet: self.sent.append(packet), 0.0)
        self.now, self.baud = 0.0, baud
        self.decoder = Decoder()
        self.raw = b""

    def send(self, *messages: Frame | bytes) -> None:
        data = b"".join(message if isinstance(message, bytes) else encode(message) for message in messages)
        self.wire.receive(data, self.now, self.baud)

    def listen(self, seconds: float) -> list[Event]:
        """Read for so long, and return what came."""
        end, got = self.now + seconds, b""
        while (due := self.wire.next_event()) <= end:
            self.now = max(due, self.now)
            got += self.wire.arrived(self.now, self.baud)
        self.now = end
        got += self.wire.arrived(end, self.baud)
        self.raw += got
        return self.decoder.feed(got)

    def ask(self, *messages: Frame | bytes) -> list[Event]:
        """What a quiet unit answers."""
        self.send(*messages)
        return self.listen(0.2) + self.decoder.pause()

    def quiet(self) -> None:
        """Let it send nothing by itself."""
        self.send(Frame(b"SF", pairs(((RATE, 0),))))
        self.listen(0.2)


def quiet_host(options: UnitOptions | None = None) -> Host:
    """A host with a unit that only answers."""
    host = Host(options=options)
    host.quiet()
    return host


def packets_of(events: Sequence[Event]) -> list[PacketS1]:
    """Packets S1 among events."""
    return [event for event in events if isinstance(event, PacketS1)]


def test_it_streams_from_power_up_on() -> None:
    """S1 at 100 Hz, 115200 baud, the time in its counter; every packet is told with its instant."""
    host = Host()
    events = host.listen(1.0)
    assert packets_of(events) == events
    assert 99 <= len(events) <= 101
    assert {(b.counter - a.counter) % 65536 for a, b in pairwise(packets_of(events))} == {655, 656}
    assert [packet for packet, _ in host.sent][: len(events)] == events
    assert [at for _, at in host.sent] == pytest.approx([(n + 1) / 100 for n in range(len(host.sent))])


def test_the_counter_starts_at_zero_but_for_a_seed() -> None:
    begun = [packets_of(Host(seed=seed).listen(0.1))[0].counter for seed in (None, None, 1, 1, 2)]
    assert begun[0] == begun[1] < 1000
    assert begun[2] == begun[3] != begun[4]
    assert begun[0] not in begun[2:]


def test_at_another_speed_it_is_noise_and_hears_nothing() -> None:
    host = Host(baud=57600)
    host.send(Frame(b"SF", pairs(((RATE, 0),))))
    assert all(isinstance(event, Discarded) for event in host.listen(1.0))
    host.baud = 115200
    assert len(packets_of(host.listen(1.0))) >= 98


def test_a_factory_new_imu380_sends_at_38400_baud() -> None:
    """S1 at 100 Hz just fits."""
    host = Host(options=UnitOptions(fields=IMU380ZA_200, baud_codes=(0, 1, 2, 3)), baud=38400)
    packets = packets_of(host.listen(1.0))
    assert len(packets) >= 98


def test_divider_zero_makes_it_quiet() -> None:
    host = quiet_host()
    assert host.listen(1.0) == []
    assert host.wire.next_event() == math.inf
    host.send(Frame(b"SF", pairs(((RATE, 5),))))
    events = host.listen(1.0)
    assert events[0] == Frame(b"SF", numbers((RATE,)))
    assert len(packets_of(events)) in (19, 20, 21)
    assert {(b.counter - a.counter) % 65536 for a, b in pairwise(packets_of(events))} <= {3276, 3277}


@pytest.mark.parametrize("ping", [encode(PING), b"UUPK"])
def test_a_ping_is_answered_amid_the_stream(ping: bytes) -> None:
    host = Host()
    before = host.listen(0.5)
    host.send(ping)
    events = before + host.listen(0.5)
    assert [event for event in events if not isinstance(event, PacketS1)] == [PING]
    assert {(b.counter - a.counter) % 65536 for a, b in pairwise(packets_of(events))} == {655, 656}


ANSWERS: list[tuple[Frame | bytes, list[Event]]] = [
    (Frame(b"CH", b"A"), [Frame(b"CH", b"A")]),
    (Frame(b"GP", b"VR"), [Frame(b"VR", bytes((1, 0, 0, 0, 0)))]),
    (Frame(b"GP", b"ID"), [Frame(b"ID", (9911750).to_bytes(4) + b"IMU381ZA-200 VIRTUAL 1.0\0")]),
    (Frame(b"GP", b"T0"), [Frame(REFUSED, b"GP")]),
    (Frame(b"GP", b"XX"), [Frame(REFUSED, b"GP")]),
    (Frame(b"GP", b"S2"), [Frame(REFUSED, b"GP")]),
    (Frame(b"RE", b"\x07\x1c\1"), [Frame(b"RE", b"\x07\x1c\1\0\x81")]),
    (Frame(b"RE", b"\x07\x1c\2"), [Frame(REFUSED, b"RE")]),
    (Frame(b"GF", numbers((1, 2, 3))), [Frame(b"GF", pairs(((1, 0), (2, 5), (3, 0x5331))))]),
    (Frame(b"RF", numbers((1,))), [Frame(b"RF", pairs(((1, 1),)))]),
    (Frame(b"GF", numbers((99, 1, 98))), [Frame(b"GF", pairs(((1, 0),))), Frame(REFUSED, b"GF")]),
    (Frame(b"RF", numbers((99,))), [Frame(REFUSED, b"RF")]),
    (Frame(b"GF", numbers((RATE,) * 63)), [Frame(b"GF", pairs(((RATE, 0),) * 63))]),
    (Frame(b"GF", numbers((RATE,) * 64)), [Frame(REFUSED, b"GF")]),
    (Frame(b"SF", pairs(((5, 1), (99, 1)))), [Frame(b"SF", numbers((5,))), Frame(REFUSED, b"SF")]),
    (Frame(b"WF", pairs(((6, 1), (1, 3)))), [Frame(b"WF", numbers((6,))), Frame(REFUSED, b"WF")]),
    (Frame(b"SF", pairs(((1, 3),))), [Frame(REFUSED, b"SF")]),
    (Frame(b"SF", pairs(((ORIENTATION, 488),))), [Frame(REFUSED, b"SF")]),
    (framed(Frame(b"SF", b"\x02\0\1\0\0")), [Frame(REFUSED, b"SF")]),
    (framed(Frame(b"GF", b"\0")), [Frame(REFUSED, b"GF")]),
    (framed(Frame(b"pG")), [Frame(REFUSED, b"pG")]),
    (encode(PING)[:-1] + b"\0", [PING]),
    (encode(Frame(b"CH", b"A"))[:-1] + b"\0", []),
    (b"noise\x55\x55", []),
]


@pytest.mark.parametrize(("request_", "answers"), ANSWERS)
def test_requests_are_answered_as_documented(request_: Frame | bytes, answers: list[Event]) -> None:
    """What is partly good twice, what is bad with a refusal, what is damaged not at all."""
    assert quiet_host().ask(request_) == answers


def test_a_measurement_is_polled() -> None:
    source = Ramp()
    host = Host(source)
    host.quiet()
    ((first,), (other,)) = host.ask(Frame(b"GP", b"S1")), host.ask(Frame(b"GP", b"S0"))
    assert isinstance(first, PacketS1)
    assert isinstance(other, PacketS0)
    assert (first.rates[0], other.rates[0]) == (0, 20)


def test_readings_begin_when_a_host_asks_for_data() -> None:
    """Until then the first one is repeated; from then on each packet has the reading of its instant."""
    host = Host()
    assert {packet.rates[0] for packet in packets_of(host.listen(1.0))} == {0}
    host.send(Frame(b"SF", pairs(((RATE, 2),))))
    assert [packet.rates[0] for packet in packets_of(host.listen(0.21))[-9:]] == list(range(2, 20, 2))


def test_a_quiet_unit_that_is_told_a_type_is_not_asked_for_data() -> None:
    host = quiet_host()
    assert host.ask(Frame(b"SF", pairs(((TYPE, S0),)))) == [Frame(b"SF", numbers((TYPE,)))]
    assert not host.unit.data_asked_for
    host.listen(1.0)
    host.send(Frame(b"SF", pairs(((RATE, 1),))))
    assert [event.rates[0] for event in host.listen(0.055) if isinstance(event, PacketS0)] == list(range(5))


@pytest.mark.parametrize("cut", [encode(Frame(b"CH", b"A" * 250))[:10], b"U"], ids=["an echo", "a byte"])
def test_a_frame_that_was_cut_off_is_given_up_four_seconds_after_it_began(cut: bytes) -> None:
    host = quiet_host()
    host.send(cut)
    answered = []
    for _ in range(11):
        host.send(b"UUPK" if cut == b"U" else encode(Frame(b"GP", b"VR")))
        answered.append(bool(host.listen(0.5)))
    assert not any(answered[:7])
    assert all(answered[9:])


def test_it_is_silent_when_there_are_no_more_readings() -> None:
    host = Host(Ramp(50))
    host.send(Frame(b"SF", pairs(((RATE, 1),))))
    assert len(packets_of(host.listen(2.0))) in (50, 51)
    assert host.ask(PING) == [PING]


def test_what_is_written_takes_effect_at_the_next_power_up() -> None:
    host = quiet_host()
    assert host.ask(Frame(b"WF", pairs(((RATE, 2),))), Frame(b"SF", pairs(((5, 7),)))) == [
        Frame(b"WF", numbers((RATE,))),
        Frame(b"SF", numbers((5,))),
    ]
    assert host.ask(Frame(b"GF", numbers((RATE, 5)))) == [Frame(b"GF", pairs(((RATE, 0), (5, 7))))]
    host.send(RESET)
    events = host.listen(1.0)
    assert events[0] == RESET
    assert 43 <= len(packets_of(events)) == len(events) - 1 <= 46
    host.quiet()
    assert host.ask(Frame(b"GF", numbers((RATE, 5))))[-1] == Frame(b"GF", pairs(((RATE, 0), (5, 0x085E))))


def test_a_rate_that_does_not_fit_the_line_is_refused() -> None:
    host = quiet_host(UnitOptions(baud_codes=(2, 3, 5), fields=IMU380ZA_200))
    host.baud = 38400
    host.quiet()
    assert host.ask(Frame(b"SF", pairs(((RATE, 1), (TYPE, S0))))) == [Frame(REFUSED, b"SF")]
    assert host.ask(Frame(b"SF", pairs(((RATE, 2), (TYPE, S0)))))[0] == Frame(b"SF", numbers((RATE, TYPE)))
    host.send(Frame(b"SF", pairs(((RATE, 1), (5, 1)))))
    answers = [event for event in host.listen(0.2) if not isinstance(event, PacketS0)]
    assert answers == [Frame(b"SF", numbers((5,))), Frame(REFUSED, b"SF")]


def test_a_new_speed_holds_from_the_reply_on() -> None:
    host = quiet_host()
    host.send(Frame(b"SF", pairs(((BAUD, 3),))))
    host.baud = 57600
    assert host.listen(0.1) == [Frame(b"SF", numbers((BAUD,)))]
    assert host.ask(PING) == [PING]
    assert host.ask(Frame(b"SF", pairs(((BAUD, 0),)))) == [Frame(REFUSED, b"SF")]


def test_an_orientation_turns_the_packets() -> None:
    host = quiet_host()
    (before,) = packets_of(host.ask(Frame(b"GP", b"S1")))
    host.ask(Frame(b"SF", pairs(((ORIENTATION, 0x006B),))))
    (after,) = packets_of(host.ask(Frame(b"GP", b"S1")))
    assert after.accels == tuple(-before.accels[k] for k in (1, 0, 2))
    assert after.rates[2] == -before.rates[2]


def test_the_beginning_of_a_frame_is_forgotten() -> None:
    """The rest may come within 4 s; what comes later begins anew."""
    host = quiet_host()
    data = encode(Frame(b"CH", b"UU"))
    host.send(data[:6])
    host.listen(3.9)
    assert host.ask(data[6:]) == [Frame(b"CH", b"UU")]
    host.send(data[:6])
    host.listen(4.1)
    assert host.ask(data[6:]) == []
    assert host.ask(PING) == [PING]


@pytest.mark.parametrize(
    ("fault", "lost"),
    [
        (LineFault(0.5, "lose_packets", count=3), 3),
        (LineFault(0.5, "drop_bytes", count=7), 1),
        (LineFault(0.5, "bit_flips", count=4), 4),
        (LineFault(0.5, "garbage", count=40), 0),
        (LineFault(0.5, "stutter", seconds=0.2), 0),
        (LineFault(0.5, "backlog", count=20), 0),
        (LineFault(0.5, "stall", seconds=0.3), 0),
        (LineFault(0.5, "pause", seconds=0.2), 20),
        (LineFault(0.5, "reset"), 11),
        (LineFault(0.5, "hang_up", seconds=0.3), 30),
    ],
)
def test_the_line_has_the_faults_that_it_has_for_other_units(fault: LineFault, lost: int) -> None:
    host = Host(None, fault)
    host.send(Frame(b"SF", pairs(((RATE, 1),))))
    got = len(packets_of(host.listen(2.0)))
    assert abs(200 - lost - got) <= 1 + (fault.kind == "hang_up")


def test_it_falls_into_another_type_and_another_unit_takes_its_place() -> None:
    host = Host(None, LineFault(0.2, "mode_change"), LineFault(0.6, "hang_up", seconds=0.2, serial_number=7))
    host.send(Frame(b"SF", pairs(((RATE, 2),))))
    assert isinstance(host.listen(0.5)[-1], PacketS0)
    host.listen(0.5)
    host.send(Frame(b"GP", b"ID"))
    assert [identification(e.payload)[0] for e in host.listen(0.2) if isinstance(e, Frame) and e.type == b"ID"] == ["7"]


def stream_of(count: int, noise: bytes = b"") -> bytes:
    """A stream at 20 Hz that a unit could have sent, with bytes between."""
    packets = [PacketS1((k, 0, 0), (0, 0, 0), (0, 0, 0), 0, int(k * 3276.8) % 65536, 2) for k in range(count)]
    return b"".join(noise + encode(packet) for packet in packets) + noise


def playing(raw: bytes, *faults: LineFault) -> Host:
    """A host with a unit that plays a stream; the unit is quiet."""
    stream = RecordedStream(raw)
    fields = {**dict(UnitOptions().fields), **dict(stream.only), RATE: 0}
    return Host(stream, *faults, options=UnitOptions(fields=tuple(fields.items()), packet_types=(stream.kind,)))


@pytest.mark.parametrize("noise", [b"", b"noise\x55"])
def test_a_stream_is_played_byte_for_byte(noise: bytes) -> None:
    raw = stream_of(30, noise)
    host = playing(raw)
    assert host.listen(1.0) == []
    assert host.ask(Frame(b"SF", pairs(((RATE, 1),)))) == [Frame(REFUSED, b"SF")]
    assert host.ask(Frame(b"SF", pairs(((ORIENTATION, 0x006B),)))) == [Frame(REFUSED, b"SF")]
    assert host.ask(Frame(b"GP", b"S1")) == Decoder().feed(stream_of(1))
    host.raw = b""
    start = host.now
    host.send(Frame(b"SF", pairs(((RATE, 5),))))
    host.listen(5.0)
    assert host.raw == encode(Frame(b"SF", numbers((RATE,)))) + raw
    assert [at for _, at in host.sent[-30:]] == pytest.approx([start + k / 20 for k in range(30)], abs=0.011)
    assert host.ask(PING)[-1] == PING
    host.send(Frame(b"SF", pairs(((RATE, 5),))))
    assert packets_of(host.listen(0.3))[0].accels[0] == 0


def test_what_is_no_stream_is_not_played() -> None:
    """Without a packet, or with packets of several types; a counter that tells no rate is taken for 100 Hz."""
    for raw in (b"", b"noise" * 100, stream_of(1) + encode(PacketS0(*((0, 0, 0),) * 3, 0, 0, 0, (0, 0, 0)))):
        with pytest.raises(ValueError, match="of one type"):
            RecordedStream(raw)
    assert RecordedStream(stream_of(1)).divider == 1
    assert RecordedStream(stream_of(9)).divider == 5


@pytest.mark.parametrize(("rate_hz", "divider"), [(200, 200), (100, 1), (25, 4), (2, 50), (1, 100)])
def test_the_rate_of_a_stream_is_told_by_its_counter(rate_hz: int, divider: int) -> None:
    """Those of later firmware too; at 1 Hz the counter stands still."""
    counters = [round(7000 + n * 65536 / rate_hz) % 65536 for n in range(40)]
    raw = b"".join(encode(PacketS1(*((0, 0, 0),) * 3, 0, counter, 0)) for counter in counters)
    assert RecordedStream(raw).divider == divider


def test_the_recording_is_played_whole_over_a_line_with_faults(recording: Callable[[str], Path]) -> None:
    """1002 frames of 1002 over a plain line; over a bad one all that no fault has touched."""
    raw = recording("aceinna_imu381_scale1.raw").read_bytes()
    frames = [raw[start : start + 31] for start in range(0, len(raw), 31)]
    for faults, lost in ((), 0), ((LineFault(3.0, "bit_flips", count=20), LineFault(9.0, "garbage", count=300)), 20):
        host = playing(raw, *faults)
        host.send(Frame(b"SF", pairs(((RATE, 5),))))
        got = [encode(packet) for packet in packets_of(host.listen(51.0))]
        assert len(got) == 1002 - lost
        assert got == frames if not lost else set(got) <= set(frames)


def test_a_driver_of_the_imu440_finds_the_unit_and_stays_in_step() -> None:
    """As it does it: a bare ping, 1000 bytes for its answer, on to the next preamble, then 31 bytes at a time."""
    host = Host()
    host.send(b"UUPK")
    host.listen(1.0)
    assert b"PK" in host.raw[:1000]
    host.listen(4.0)
    rest = host.raw[1000:].partition(b"UU")[2]
    rest = rest[3 + rest[2] + 2 :]
    packets = [rest[start : start + 31] for start in range(0, len(rest) - 30, 31)]
    assert len(packets) >= 460
    assert {packet[:5] for packet in packets} == {b"UUS1\x18"}


def test_a_cut_anywhere_in_a_request_changes_nothing() -> None:
    data = b"".join(
        encode(each) for each in (PING, Frame(b"GP", b"VR"), Frame(b"GF", numbers((1, 99))), Frame(b"CH", b"\x55\x55"))
    )
    whole, slow = quiet_host(), quiet_host()
    for byte in data:
        slow.send(bytes([byte]))
    assert slow.listen(0.2) == whole.ask(data)
    assert np.isfinite(slow.now)
