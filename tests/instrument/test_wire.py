"""A unit and its line as one, on a time of the test's own: faults of the unit, its clock, and what it sent."""

import pytest
from helpers.faulty_lines import FaultyLine, FaultyWire, LineFault
from helpers.units import Still

from filters.imu import LOOP_HZ
from imutui.instrument.counter_spec import SPAN
from imutui.instrument.imu400.crossbow import TICK_S, Mode, Packet
from imutui.instrument.imu400.decoder import packet_decoder
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit


class Host:
    """A host that reads whatever comes when it comes, on a simulated time."""

    def __init__(self, *faults: LineFault, options: UnitOptions | None = None) -> None:
        self.sent: list[tuple[Packet, float]] = []
        self.unit = VirtualUnit(Still(), options, seed=1)
        self.wire = FaultyWire(self.unit, FaultyLine(faults), 1.0, lambda *packet: self.sent.append(packet), 0.0)
        self.now = 0.0
        self.came: list[tuple[float, bytes]] = []

    def send(self, data: bytes) -> None:
        self.wire.receive(data, self.now, 38400)

    def listen(self, seconds: float) -> bytes:
        """Read for so long, and return what came."""
        end, before = self.now + seconds, len(self.came)
        while (due := self.wire.next_event()) <= end:
            self.now = max(due, self.now)
            if data := self.wire.arrived(self.now, 38400):
                self.came.append((self.now, data))
        self.now = end
        return b"".join(data for _, data in self.came[before:]) + self.wire.arrived(end, 38400)

    def stream(self) -> None:
        """Scaled mode, and a stream from time 1 s on."""
        self.send(b"c")
        assert self.listen(1.0 - self.now) == b"C"
        self.send(b"C")


def packets(data: bytes, mode: Mode = Mode.SCALED) -> list[Packet]:
    """Packets that a decoder finds."""
    decoder = packet_decoder(mode, streaming=True)
    return [event for event in decoder.feed(data) + decoder.quiet() if isinstance(event, Packet)]


def test_what_was_sent_is_told_with_its_instant() -> None:
    host = Host()
    host.stream()
    got = packets(host.listen(1.0))
    assert [packet for packet, _ in host.sent][: len(got)] == got
    assert [at for _, at in host.sent] == pytest.approx([1.0 + n / LOOP_HZ for n in range(len(host.sent))])
    assert len(host.sent) - len(got) <= 1


def test_a_reset_breaks_off_and_leaves_the_unit_as_after_power_up() -> None:
    host = Host(LineFault(0.498, "reset"))
    host.stream()
    data = host.listen(2.0)
    assert len(data) % 18 != 0
    assert len(data) / 18 == pytest.approx(0.5 * LOOP_HZ, abs=1)
    assert (host.unit.mode, host.unit.streaming, host.unit.baud) == (Mode.VOLTAGE, False, 38400)
    host.send(b"G")
    (packet,) = packets(host.listen(0.1), Mode.VOLTAGE)
    # since the reset, but for what the reading is old
    assert (packet.ticks + 1.502 / TICK_S) % SPAN < 1 / LOOP_HZ / TICK_S


def test_a_unit_may_fall_into_the_other_mode_in_a_stream() -> None:
    host = Host(LineFault(0.5, "mode_change"))
    host.stream()
    host.listen(1.0)
    modes = [packet.mode for packet, _ in host.sent]
    change = modes.index(Mode.VOLTAGE)
    assert change / LOOP_HZ == pytest.approx(0.5, abs=0.01)
    assert set(modes[:change]) == {Mode.SCALED}
    assert set(modes[change:]) == {Mode.VOLTAGE}
    assert len(modes) - change > 0.49 * LOOP_HZ


def test_a_pause_sends_nothing_and_goes_on_with_the_newest() -> None:
    """No packet is made for 0.3 s; the first after it is of the newest instant, and the counter has run on."""
    host = Host(LineFault(0.5, "pause", seconds=0.3))
    host.stream()
    got = packets(host.listen(2.0))
    instants = [at - 1.0 for _, at in host.sent]
    gap = next(n for n, at in enumerate(instants) if at > 0.51)
    assert instants[gap - 1] == pytest.approx(0.5, abs=0.0076)
    assert instants[gap] == pytest.approx(0.8, abs=0.0076)
    assert 0.8 - instants[gap] < 1 / LOOP_HZ
    step = (got[gap - 1].ticks - got[gap].ticks) % SPAN
    assert step == pytest.approx((instants[gap] - instants[gap - 1]) / TICK_S % SPAN, abs=2)
    assert len(got) + 1 >= len(host.sent)


@pytest.mark.parametrize(
    ("fault", "streams", "serial_number"),
    [
        (LineFault(0.5, "hang_up", seconds=0.5), True, 9911750),
        (LineFault(0.5, "hang_up", seconds=0.5, power=True), False, 9911750),
        (LineFault(0.5, "hang_up", seconds=0.5, serial_number=7), False, 7),
    ],
)
def test_a_unit_whose_adapter_is_unplugged_goes_on(fault: LineFault, streams: bool, serial_number: int) -> None:
    host = Host(fault)
    host.stream()
    host.listen(0.5)
    assert host.wire.is_away(host.now)
    assert host.listen(0.499) == b""
    assert bool(host.listen(0.5)) is streams
    assert not host.wire.is_away(host.now)
    assert host.unit.streaming is streams
    assert len(host.sent) / LOOP_HZ == pytest.approx(1.5 if streams else 0.5, abs=0.01)
    host.send(b"PS")
    assert serial_number.to_bytes(4, "big") in host.listen(0.1)


def test_a_clock_may_run_fast() -> None:
    """The whole unit runs by 1000 ppm faster than the host: packets, and what its counter says of them."""
    host = Host(options=UnitOptions(clock_skew_ppm=1000.0))
    host.stream()
    host.listen(20.0)
    (first, begin), (last, end) = host.sent[0], host.sent[-1]
    assert (len(host.sent) - 1) / (end - begin) == pytest.approx(LOOP_HZ * 1.001, rel=1e-9)
    turned = (first.ticks - last.ticks) % SPAN
    assert turned == pytest.approx((end - begin) * 1.001 / TICK_S % SPAN, abs=2)


def test_a_version_may_be_plain_text() -> None:
    """As the manuals can be read: no header, no sum."""
    host = Host(options=UnitOptions(version_plain_text=True))
    host.send(b"v")
    assert host.listen(0.1) == b"IMU400CD-200 VIRTUAL 1.0"
