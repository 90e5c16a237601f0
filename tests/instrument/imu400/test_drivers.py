"""Drivers by others, by the bytes that they send and the times that they wait, are served by the virtual unit.

Each opens the port as it does, whatever the one before left behind; what it makes of the bytes is its own affair.
"""

import fcntl
import os
import select
import signal
import subprocess
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise

import pytest
from helpers.processes import LIMIT_S, wait_until
from helpers.units import Still, served

from filters.imu import LOOP_HZ
from imutui.instrument.counter_spec import SPAN
from imutui.instrument.imu400.crossbow import PACKET_BYTES, TICK_S, framed, serial_number_frame
from imutui.instrument.imu400.unit import VirtualUnit

PATIENCE_S = 20.0
SERIAL = serial_number_frame(9911750)
VERSION = framed(b"IMU400CD-200 VIRTUAL 1.0")


class Driver:
    """The host's end of a port, opened as a C program does: raw, and nothing thrown away."""

    def __init__(self, device: str) -> None:
        self.descriptor = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self.descriptor, termios.TCSANOW)
        self._unread = b""

    def send(self, letters: bytes) -> None:
        os.write(self.descriptor, letters)

    def wait(self, seconds: float) -> None:
        """Do nothing for as long as the driver does."""
        time.sleep(seconds)

    def flush(self) -> None:
        """Throw away what has come."""
        termios.tcflush(self.descriptor, termios.TCIFLUSH)
        self._unread = b""

    def baud(self, speed: int) -> None:
        attributes = termios.tcgetattr(self.descriptor)
        attributes[4] = attributes[5] = speed
        termios.tcsetattr(self.descriptor, termios.TCSADRAIN, attributes)

    def _more(self) -> None:
        assert select.select([self.descriptor], [], [], PATIENCE_S)[0], "nothing comes"
        self._unread += os.read(self.descriptor, 4096)

    def expect(self, reply: bytes) -> None:
        """Read on until the reply has come; what was before it is passed over."""
        while reply not in self._unread:
            self._more()
        self._unread = self._unread.partition(reply)[2]

    def ask(self, letters: bytes, reply: bytes) -> None:
        self.send(letters)
        self.expect(reply)

    def packets(self, count: int) -> None:
        """Read a stream by header and sum, sliding by one byte; then it is whole, and its counter runs on."""
        ticks: list[int] = []
        while len(ticks) < count:
            while len(self._unread) < PACKET_BYTES:
                self._more()
            frame = self._unread[:PACKET_BYTES]
            good = frame[0] == 0xFF and sum(frame[1:17]) & 0xFF == frame[17] and frame[1:15] == _WORDS
            assert good or not ticks, "a byte is missing in mid-stream"
            ticks += [int.from_bytes(frame[15:17])] if good else []
            self._unread = self._unread[PACKET_BYTES if good else 1 :]
        steps = [(a - b) % SPAN for a, b in pairwise(ticks)]
        assert all(abs(step - 1 / LOOP_HZ / TICK_S) < 2 for step in steps), "a packet is missing"

    def poll(self, count: int) -> None:
        """Ask for packets one by one, each asked for on a quiet line."""
        for _ in range(count):
            self.send(b"G")
            self.packets(1)
        assert not self._unread


_BENCH = VirtualUnit(Still())
_BENCH.receive(b"cG", 0.0, 38400)
_WORDS = _BENCH.transmit(1.0, 38400)[2:16]


def gavlab(host: Driver) -> None:
    """D1, IMU400CC: stops by `G`, asks for everything, polls, then streams."""
    host.send(b"G")
    host.wait(0.1)
    host.flush()
    host.ask(b"R", b"H")
    host.ask(b"v", VERSION)
    host.ask(b"S", SERIAL)
    host.ask(b"c", b"C")
    host.poll(3)
    host.send(b"C")
    host.packets(10)
    host.send(b"G")


def rhd(host: Driver) -> None:
    """D2, IMU400: pings up to twenty times."""
    host.send(b"P")
    host.wait(0.1)
    host.ask(b"R", b"H")
    host.ask(b"c", b"C")
    host.send(b"C")
    host.packets(10)
    host.send(b"P")


def xbow6x(host: Driver) -> None:
    """D3, DMU-6X: `R` comes first, into whatever runs; neither a stop nor a flush before it."""
    host.ask(b"R", b"H")
    host.ask(b"c", b"C")
    host.send(b"C")
    host.packets(10)
    host.send(b"R")


def xbow4x(host: Driver) -> None:
    """D4, AHRS400: `R` stops; modes one after the other; after an error `R` and everything again."""
    host.ask(b"R", b"H")
    host.ask(b"v", VERSION)
    host.ask(b"S", SERIAL)
    host.ask(b"r", b"R")
    for _ in range(2):
        host.ask(b"R", b"H")
        host.ask(b"c", b"C")
        host.send(b"C")
        host.packets(10)


def fdas3(host: Driver) -> None:
    """D5, AHRS400: waits a second after its stop."""
    host.send(b"P")
    host.wait(1.0)
    host.flush()
    host.ask(b"R", b"H")
    host.ask(b"c", b"C")
    host.send(b"C")
    host.packets(10)
    host.send(b"P")


def rtai_ahrs(host: Driver) -> None:
    """D6, AHRS400CD: tells the speed again by auto-baud, reads 10 ms after `C`."""
    host.send(b"P")
    host.wait(0.1)
    host.flush()
    host.ask(b"R", b"H")
    host.ask(b"b", b"B")
    host.baud(termios.B38400)
    host.ask(b"a", b"A")
    host.ask(b"S", SERIAL)
    host.ask(b"v", VERSION)
    host.ask(b"c", b"C")
    host.send(b"C")
    host.wait(0.01)
    host.packets(10)


def ahrs400_driver(host: Driver) -> None:
    """D7, AHRS400: polls, at another speed, which it gives back."""
    host.send(b"P")
    host.wait(0.1)
    host.flush()
    host.ask(b"v", VERSION)
    host.ask(b"S", SERIAL)
    for speed in (termios.B57600, termios.B38400):
        host.ask(b"b", b"B")
        host.baud(speed)
        host.ask(b"a", b"A")
        host.ask(b"c", b"C")
        host.poll(3)


def xbow_reader(host: Driver) -> None:
    """D8, VG and HDX: a stop, a ping and a stream, and an angle mode that this unit does not have."""
    host.send(b"P")
    host.wait(0.05)
    host.flush()
    host.ask(b"R", b"H")
    host.send(b"a")
    host.ask(b"c", b"C")
    host.send(b"C")
    host.packets(10)


def vrpn(host: Driver) -> None:
    """D9, RGA300CA: 50 ms after its stop everything is asked for, rates are zeroed, packets are polled."""
    host.send(b"P")
    host.wait(0.05)
    host.flush()
    host.ask(b"R", b"H")
    host.ask(b"S", SERIAL)
    host.ask(b"v", VERSION)
    host.ask(b"c", b"C")
    host.poll(2)
    host.ask(b"z\x00", b"Z")
    host.poll(3)


DRIVERS = [gavlab, rhd, xbow6x, xbow4x, fdas3, rtai_ahrs, ahrs400_driver, xbow_reader, vrpn]

# opens the port, starts a stream, says so and waits for the end
_KILLED = """
import os, sys, termios, time, tty
fd = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
tty.setraw(fd, termios.TCSANOW)
os.write(fd, b"cC")
while True:
    os.read(fd, 18)
    print("streams", flush=True)
"""


def kill_while_streaming(device: str) -> None:
    """A client starts a stream and is killed: the unit streams on, and its bytes lie unread."""
    client = subprocess.Popen([sys.executable, "-S", "-c", _KILLED, device], stdout=subprocess.PIPE)
    assert client.stdout is not None
    try:
        assert client.stdout.readline() == b"streams\n"
    finally:
        client.send_signal(signal.SIGKILL)
        client.wait(LIMIT_S)
        client.stdout.close()


def unread(descriptor: int) -> int:
    """How many bytes lie in the queue of a port."""
    return int.from_bytes(fcntl.ioctl(descriptor, termios.FIONREAD, bytes(4)), sys.byteorder)


@contextmanager
def opened(device: str) -> Iterator[Driver]:
    host = Driver(device)
    try:
        yield host
    finally:
        os.close(host.descriptor)


@pytest.mark.parametrize("killed", [False, True], ids=["after power-up", "after a kill"])
@pytest.mark.parametrize("driver", DRIVERS, ids=lambda driver: driver.__name__)
def test_a_driver_by_others_is_served(driver: Callable[[Driver], None], killed: bool) -> None:
    with served(VirtualUnit(Still())) as device:
        if killed:
            kill_while_streaming(device)
        with opened(device) as host:
            if killed:
                wait_until(lambda: unread(host.descriptor) > 10 * PACKET_BYTES)
            driver(host)


def test_one_driver_after_the_other_is_served() -> None:
    with served(VirtualUnit(Still())) as device:
        for driver in [*DRIVERS[::-1], *DRIVERS]:
            if driver is not fdas3:  # its second of waiting has been tried
                with opened(device) as host:
                    driver(host)
