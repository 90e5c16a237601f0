"""A virtual unit on a real pseudo-terminal, through pyserial; the unit is an IMU400CD."""

import fcntl
import os
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import serial
from helpers.faulty_lines import FaultyLine, LineFault
from helpers.processes import wait_until
from helpers.ramp import Ramp, numbers, steps
from helpers.units import Serving
from reliability.ports import is_exclusive

from filters.imu import LOOP_HZ
from imutui.instrument.imu400.crossbow import PACKET_BYTES, Mode, Packet, serial_number_frame
from imutui.instrument.imu400.decoder import packet_decoder
from imutui.instrument.imu400.unit import VirtualUnit
from imutui.instrument.pseudo_terminal import PseudoTerminal
from imutui.instrument.transmitter import transfer_s
from imutui.instrument.virtual import Wire, serve

PERIOD_S = 1 / LOOP_HZ
PACKET_S = transfer_s(PACKET_BYTES, 38400)
PATIENCE_S = 20.0  # for a loaded machine; nothing here waits so long when all is well


def opened(unit: Serving) -> serial.Serial:
    """Its port as a host opens it."""
    return serial.Serial(unit.port, 38400, timeout=PATIENCE_S)


@pytest.fixture
def served() -> Iterator[Serving]:
    """Serve a unit that measures a ramp."""
    with Serving(VirtualUnit(Ramp())) as made:
        yield made


def read_until_quiet(port: serial.Serial) -> bytes:
    """Read until 100 ms bring nothing."""
    port.timeout = 0.1
    data = b""
    while chunk := port.read(4096):
        data += chunk
    port.timeout = PATIENCE_S
    return data


def stream_from(port: serial.Serial, count: int) -> tuple[list[Packet], int]:
    """Start a stream and read so many packets: the packets, and the bytes discarded."""
    decoder = packet_decoder(Mode.SCALED, streaming=True)
    port.write(b"C")
    packets: list[Packet] = []
    while len(packets) < count:
        data = port.read(decoder.missing)
        assert data, "the stream has stopped"
        packets += [event for event in decoder.feed(data) if isinstance(event, Packet)]
    return packets, decoder.discarded_bytes


def test_a_host_streams_from_a_pty(served: Serving) -> None:
    """Over two seconds a host on pyserial gets every reading once, whole, with the counter's steps right."""
    with opened(served) as port:
        port.write(b"Pc")
        assert port.read(1) == b"C"
        packets, discarded = stream_from(port, 266)
    assert discarded == 0
    assert numbers(packets) == list(range(packets[0].rates[0], packets[0].rates[0] + 266))
    assert set(steps(packets)) <= {9493, 9494}
    assert served.log == ["P: stop stream", "c: scaled mode", "C: start stream"]


def test_a_pty_keeps_the_units_pace(served: Serving) -> None:
    """The last of 266 packets comes about two seconds after the first: never earlier, and not much later."""
    with opened(served) as port:
        port.write(b"c")
        assert port.read(1) == b"C"
        arrivals = []
        port.write(b"C")
        for _ in range(266):
            assert len(port.read(PACKET_BYTES)) == PACKET_BYTES
            arrivals.append(time.monotonic())
    assert 1.5 < arrivals[-1] - arrivals[0] < 8.0


def test_the_tap_holds_what_the_host_received(served: Serving) -> None:
    with opened(served) as port:
        port.write(b"RcvSGGP")
        received = read_until_quiet(port)
    assert received
    assert served.tap.getvalue().startswith(received)  # it may be back already, and go on


def test_the_packet_under_way_is_stale_after_a_stop(served: Serving) -> None:
    with opened(served) as port:
        port.write(b"c")
        assert port.read(1) == b"C"
        stream_from(port, 5)
        port.write(b"P")
        assert len(read_until_quiet(port)) % PACKET_BYTES == 0
        port.write(b"R")
        assert port.read(1) == b"H"
        assert port.in_waiting == 0


def test_a_host_that_does_not_read_blocks_nothing() -> None:
    """When the host's queue is full bytes are lost, as in a UART, and the unit still obeys and answers."""
    with Serving(VirtualUnit(Ramp()), speed=40.0) as served, opened(served) as port:
        port.write(b"c")
        assert port.read(1) == b"C"
        port.write(b"C")
        wait_until(lambda: port.in_waiting >= 4000)
        port.write(b"v")
        wait_until(lambda: "v: version" in served.log)
        port.write(b"P")
        wait_until(lambda: "P: stop stream" in served.log)
        stale = read_until_quiet(port)
        assert served.tap.getvalue() == b"C" + stale
        port.write(b"R")
        assert port.read(1) == b"H"


def test_bytes_left_unread_wait_for_the_next_host(served: Serving) -> None:
    with opened(served) as port:
        port.write(b"S")
        wait_until(lambda: port.in_waiting == 6)
        descriptor = os.open(served.port, os.O_RDWR | os.O_NOCTTY)
    try:
        assert os.read(descriptor, 100) == serial_number_frame(9911750)
    finally:
        os.close(descriptor)
    with opened(served) as port:
        port.write(b"R")
        assert port.read(1) == b"H"


def test_a_host_that_was_killed_leaves_the_port_to_the_next_one(served: Serving) -> None:
    """One that lives keeps it. Root may open it all the same, so the mark itself is looked at."""
    host = os.open(served.port, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(host, fcntl.LOCK_EX)
    fcntl.ioctl(host, termios.TIOCEXCL)
    for _ in range(2):  # the unit has looked at the mark when it answers for the second time
        os.write(host, b"R")
        assert os.read(host, 1) == b"H"
    assert is_exclusive(served.port)
    os.close(host)  # as the kernel does for a process that was killed
    wait_until(lambda: not is_exclusive(served.port))


def test_the_speed_of_a_pty_is_the_hosts(served: Serving) -> None:
    """The unit measures the speed that pyserial has set, and takes a wrong one for noise."""
    with opened(served) as port:
        port.write(b"b")
        assert port.read(1) == b"B"
        port.baudrate = 19200
        port.write(b"a")
        assert port.read(1) == b"A"
        port.write(b"R")
        assert port.read(1) == b"H"
        port.baudrate = 57600
        port.write(b"R")
        wait_until(lambda: "line noise: 1 bytes at 57600 baud, the unit is at 19200" in served.log)
        assert read_until_quiet(port) == b""


def test_the_link_lives_as_long_as_the_unit(tmp_path: Path) -> None:
    link = tmp_path / "imu"
    link.symlink_to("/dev/nowhere")
    with Serving(VirtualUnit(Ramp()), link=link) as served:
        assert os.path.realpath(link) == served.port
        with opened(served) as port:
            port.write(b"R")
            assert port.read(1) == b"H"
    assert not link.is_symlink()


def test_the_link_replaces_no_file(tmp_path: Path) -> None:
    link = tmp_path / "precious"
    link.write_text("data")
    with pytest.raises(FileExistsError, match="not a symbolic link"), PseudoTerminal(link):
        pass
    assert link.read_text() == "data"


def test_a_link_that_another_unit_took_over_is_left_alone(tmp_path: Path) -> None:
    link = tmp_path / "imu"
    with Serving(VirtualUnit(Ramp()), link=link), Serving(VirtualUnit(Ramp()), link=link) as second:
        first_link = link.readlink()
        second.stop.set()
        second.thread.join(PATIENCE_S)
        link.symlink_to(first_link.with_name("another"))
    assert link.is_symlink()


def test_an_interrupt_cleans_up(tmp_path: Path) -> None:
    link = tmp_path / "imu"

    def interrupt(_: str) -> None:
        assert link.is_symlink()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), PseudoTerminal(link) as pty:
        with serial.Serial(str(link), 38400) as port:
            port.write(b"R")
        serve(Wire(VirtualUnit(Ramp())), pty, log=interrupt)
    assert not link.is_symlink()


def test_the_unit_may_end_with_standard_input(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with Serving(VirtualUnit(Ramp()), while_stdin=True) as served, opened(served) as port:
            os.write(writing, b"a line\n")
            port.write(b"R")
            assert port.read(1) == b"H"
            os.close(writing)
            served.thread.join(PATIENCE_S)
            assert not served.thread.is_alive()


def test_when_each_packet_was_sampled_is_told_on_the_hosts_clock(served: Serving) -> None:
    with opened(served) as port:
        port.write(b"c")
        assert port.read(1) == b"C"
        before = time.monotonic_ns()
        packets, _ = stream_from(port, 30)
        after = time.monotonic_ns()
    assert [packet for packet, _ in served.sent][:30] == packets
    instants = np.array([at for _, at in served.sent][:30])
    assert before < instants[0]
    assert instants[-1] + PACKET_S * 1e9 < after
    np.testing.assert_allclose(np.diff(instants), PERIOD_S * 1e9, atol=2)


@pytest.mark.parametrize("linked", [True, False])
def test_a_port_hangs_up_and_comes_back_under_another_name(tmp_path: Path, linked: bool) -> None:
    link = tmp_path / "imu"
    line = FaultyLine((LineFault(0.3, "hang_up", seconds=0.3),))
    with Serving(VirtualUnit(Ramp()), link=link if linked else None, line=line) as served:
        descriptor = os.open(served.port, os.O_RDWR | os.O_NOCTTY)
        try:
            os.write(descriptor, b"cC")
            received = b""
            with pytest.raises(OSError, match="Input/output error"):
                while True:
                    more = os.read(descriptor, 4096)
                    if not more:
                        raise OSError("Input/output error: the end")
                    received += more
        finally:
            os.close(descriptor)
        assert not link.is_symlink()
        assert served.tap.getvalue().startswith(received)  # it may be back already, and go on
        wait_until(lambda: any(text.startswith("back") for text in served.log))
        name = served.log[-1].removeprefix("back: the port is ").removesuffix(" now")
        assert name != served.port
        assert not linked or os.path.realpath(link) == name
        with serial.Serial(str(link) if linked else name, 38400, timeout=PATIENCE_S) as port:
            assert len(port.read(100)) == 100, "its stream goes on"
            port.write(b"P")
            wait_until(lambda: served.log[-1].startswith("P"))
            port.read(port.in_waiting)
    assert not link.is_symlink()


def test_what_a_host_has_not_read_goes_with_the_port() -> None:
    """The tap has what the host could have received: what lay unread when the port hung up is taken out again."""
    line = FaultyLine((LineFault(0.2, "hang_up", seconds=2.0),))
    with Serving(VirtualUnit(Ramp()), line=line) as served, opened(served) as port:
        port.write(b"cC")
        wait_until(lambda: any(text.startswith("hang-up") for text in served.log))
        assert served.tap.getvalue() == b""


def test_a_burst_is_larger_than_a_hosts_queue() -> None:
    line = FaultyLine((LineFault(0.1, "backlog", count=500),))
    with Serving(VirtualUnit(Ramp()), speed=20.0, line=line) as served, opened(served) as port:
        port.write(b"c")
        assert port.read(1) == b"C"
        port.write(b"C")
        wait_until(lambda: port.in_waiting >= 4000)
        packets, discarded = stream_from(port, 600)
    assert discarded == 0
    assert numbers(packets) == list(range(packets[0].rates[0], packets[0].rates[0] + 600))
